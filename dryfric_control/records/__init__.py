"""Measured data: records and the files they come from."""

from dryfric_control.records.record import Record, read_bam, read_record
from dryfric_control.records.record_checks import RecordWarning

__all__ = ["Record", "RecordWarning", "read_bam", "read_record"]
