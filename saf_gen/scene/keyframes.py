"""Rigid motion of shapes: poses at a few moments, linear in time between them."""

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
    """Seconds from the beginning of the recording, rising from keyframe to keyframe."""
    translate_m: Vector = (0.0, 0.0, 0.0)
    """How far the shape has moved, m, world axes."""
    rotate_deg: float = 0.0
    """How far it has turned about the axis, degrees."""


class RigidMotion(FrozenModel):
    """The rigid motion of one shape, on top of the pose that the scene gives it; world axes.

    Translation and angle are linear in time between keyframes and constant before the first and after the
    last. The axis goes through ``centre_m``, a point of the shape where the scene puts it.
    """

    keyframes: tuple[Keyframe, ...] = Field(min_length=2)
    """Poses at two moments or more; between them straight lines."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Direction of the axis of rotation, world axes."""
    centre_m: Vector = (0.0, 0.0, 0.0)
    """A point of that axis, m."""

    @model_validator(mode="after")
    def _can_be_followed(self) -> "RigidMotion":
        if any(b <= a for a, b in pairwise([k.time_s for k in self.keyframes])):
            raise ValueError("keyframes with rising time_s")
        if math.hypot(*self.axis) < 1e-9:
            raise ValueError("an axis with a direction")
        return self

    def pose_at(self, time_s: float) -> np.ndarray:
        """Return the world-to-world matrix of the shape at this time, float64 (4, 4)."""
        times, shift = [k.time_s for k in self.keyframes], self.shift_at(time_s)
        angle = math.radians(float(np.interp(time_s, times, [k.rotate_deg for k in self.keyframes])))
        turn = _rotation(np.asarray(self.axis, dtype=np.float64), angle)
        centre = np.asarray(self.centre_m, dtype=np.float64)
        matrix = np.eye(4)
        matrix[:3, :3] = turn
        matrix[:3, 3] = centre - turn @ centre + shift
        return matrix

    def shift_at(self, time_s: float) -> np.ndarray:
        """Return by how much the shape's centre has moved at this time, in world axes, float64 (3,) m."""
        times = [k.time_s for k in self.keyframes]
        return np.array([np.interp(time_s, times, [k.translate_m[j] for k in self.keyframes]) for j in range(3)])


def scene_motion_end_s(motions: Mapping[str, RigidMotion], *, recording_s: float) -> float:
    """Return the last moment (s) of a recording at which one of these shapes still moves.

    Where all keyframes lie before the recording, the end of the recording is returned.
    """
    last = max(frame.time_s for motion in motions.values() for frame in motion.keyframes)
    return min(last, recording_s) if last > 0 else recording_s


def _rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation by an angle (radians) about an axis, by Rodrigues' formula, float64 (3, 3)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)
