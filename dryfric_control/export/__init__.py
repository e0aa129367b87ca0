"""Export to the target: C99 source and FMUs."""

from dryfric_control.export.c_code import export_c
from dryfric_control.export.fmu import export_fmu

__all__ = ["export_c", "export_fmu"]
