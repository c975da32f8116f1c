"""Actuators that move the lens of a running camera: voice coil, stepper, liquid lens, hand."""

from saf_gen.optics.actuators.actuated_lens import ActuatedLens
from saf_gen.optics.actuators.actuator import Actuator, actuator_names, get_actuator

__all__ = ["ActuatedLens", "Actuator", "actuator_names", "get_actuator"]
