"""Measured data: records and the files they come from."""

from dryfric_control.records.read import load_record, read_bam, read_record
from dryfric_control.records.record import Record
from dryfric_control.records.record_warning import RecordWarning
from dryfric_control.records.scaling import Scaling

__all__ = ["Record", "RecordWarning", "Scaling", "load_record", "read_bam", "read_record"]
