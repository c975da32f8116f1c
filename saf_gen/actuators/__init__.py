"""What moves the lens of a camera that is running: voice coil, stepper, liquid lens, hand."""

from saf_gen.actuators.actuator import Actuator, actuator_names, get_actuator, is_actuator_file
from saf_gen.actuators.lens import Lens

__all__ = ["Actuator", "Lens", "actuator_names", "get_actuator", "is_actuator_file"]
