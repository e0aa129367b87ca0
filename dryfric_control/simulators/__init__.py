"""What was found, in the files of simulators that people use."""

from dryfric_control.simulators.isaac import to_isaac
from dryfric_control.simulators.modelica import to_modelica
from dryfric_control.simulators.mujoco_file import to_mjcf
from dryfric_control.simulators.simscape import to_simscape
from dryfric_control.simulators.urdf import to_urdf

__all__ = ["to_isaac", "to_mjcf", "to_modelica", "to_simscape", "to_urdf"]
