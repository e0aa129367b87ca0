"""Export to the target: C99 source and FMUs."""

from dryfric_control.export.c_code import export_c

__all__ = ["export_c"]
