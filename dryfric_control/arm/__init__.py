"""The whole arm: joints with the coupling torque that its model knows."""

from dryfric_control.arm.arm_records import ArmRecords, arm_records
from dryfric_control.arm.diagnose_arm import ArmDiagnoses, diagnose_arm
from dryfric_control.arm.model_errors import ModelError

__all__ = ["ArmDiagnoses", "ArmRecords", "ModelError", "arm_records", "diagnose_arm"]
