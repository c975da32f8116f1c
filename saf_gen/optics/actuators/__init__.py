"""What moves the lens of a camera that is running: voice coil, stepper, liquid lens, hand."""

from saf_gen.optics.actuators.actuated_lens import ActuatedLens
from saf_gen.optics.actuators.actuator import Actuator, actuator_names, get_actuator, is_actuator_file

__all__ = ["ActuatedLens", "Actuator", "actuator_names", "get_actuator", "is_actuator_file"]
