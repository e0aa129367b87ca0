"""Compiled loops: one sampled step of the axis and everything built on it."""

from dryfric_control.compiled.cached import keep_compiled_code

keep_compiled_code()
