"""Compiled loops: one sampled step of the axis and everything built on it."""
