"""The hybrid model: axis, friction, effects, friction laws, loops and blocks."""
