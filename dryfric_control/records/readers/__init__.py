"""Columns of numbers out of files, frames and mappings, in SI units."""
