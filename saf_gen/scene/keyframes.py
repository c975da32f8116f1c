"""Rigid motion of shapes, given by poses at a few times and interpolated linearly in between."""

import math
from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from pydantic import Field, model_validator

from saf_gen.core.config.document import FrozenModel

Vector = tuple[float, float, float]


class Keyframe(FrozenModel):
    """The pose of a shape at ``time_s``: rotated about the axis of its motion, then translated."""

    time_s: float
    """Seconds from the beginning of the recording; must increase from keyframe to keyframe."""
    translate_m: Vector = (0.0, 0.0, 0.0)
    """Translation of the shape, m, world axes."""
    rotate_deg: float = 0.0
    """Rotation of the shape about the axis, degrees."""


class RigidMotion(FrozenModel):
    """The rigid motion of one shape, in addition to the pose that the scene gives it; world axes.

    Translation and angle are linear in time between keyframes, and constant before the first and after the last. The
    axis passes through ``centre_m``, a point of the shape in the pose that the scene gives it.
    """

    keyframes: tuple[Keyframe, ...] = Field(min_length=2)
    """Poses at two or more times, with linear interpolation in between."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Direction of the axis of rotation, world axes."""
    centre_m: Vector = (0.0, 0.0, 0.0)
    """A point on the axis of rotation, m."""

    @model_validator(mode="after")
    def _check_keyframes(self) -> "RigidMotion":
        if any(b <= a for a, b in pairwise([k.time_s for k in self.keyframes])):
            raise ValueError("keyframes with increasing time_s")
        if math.hypot(*self.axis) < 1e-9:
            raise ValueError("an axis that is not zero")
        return self

    def pose_at(self, time_s: float) -> np.ndarray:
        """Return the matrix that moves the shape in world coordinates at this time, float64 (4, 4)."""
        times, shift = [k.time_s for k in self.keyframes], self.shift_at(time_s)
        angle = math.radians(float(np.interp(time_s, times, [k.rotate_deg for k in self.keyframes])))
        turn = _rotation(np.asarray(self.axis, dtype=np.float64), angle)
        centre = np.asarray(self.centre_m, dtype=np.float64)
        matrix = np.eye(4)
        matrix[:3, :3] = turn
        matrix[:3, 3] = centre - turn @ centre + shift
        return matrix

    def shift_at(self, time_s: float) -> np.ndarray:
        """Return the translation of the shape at this time in world axes, float64 (3,), metres."""
        times = [k.time_s for k in self.keyframes]
        return np.array([np.interp(time_s, times, [k.translate_m[j] for k in self.keyframes]) for j in range(3)])


def motion_end_s(motions: Mapping[str, RigidMotion], *, recording_s: float) -> float:
    """Return the last time in seconds at which one of these shapes still moves during a recording.

    If all keyframes are before the recording, return the end of the recording.
    """
    last = max(frame.time_s for motion in motions.values() for frame in motion.keyframes)
    return min(last, recording_s) if last > 0 else recording_s


def _rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the matrix of a rotation by an angle in radians about an axis, float64 (3, 3), by Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)
