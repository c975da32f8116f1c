import math

import numpy as np
import pytest
from pydantic import ValidationError

from saf_gen.scene.keyframes import Keyframe, RigidMotion

POINT = np.array([0.3, -0.2, 0.5, 1.0])


def motion(*frames, **options):
    return RigidMotion(keyframes=tuple(Keyframe(**frame) for frame in frames), **options)


def test_a_shift_is_linear_in_time_and_holds_outside():
    car = motion({"time_s": 1.0}, {"time_s": 3.0, "translate_m": (4.0, 0.0, -2.0)})
    assert np.allclose(car.pose_at(1.5) @ POINT - POINT, [1.0, 0, -0.5, 0])
    assert np.array_equal(car.pose_at(-5), np.eye(4))
    assert np.array_equal(car.pose_at(9), car.pose_at(3))


@pytest.mark.parametrize(("axis", "time_s"), [((0, 3, 0), 0.5), ((1, 2, -2), 0.13), ((1, 2, -2), 0.77)])
def test_a_turn_keeps_lengths_its_axis_and_its_centre(axis, time_s):
    centre = (0.1, 0.2, 0.3)
    fan = motion({"time_s": 0}, {"time_s": 1, "rotate_deg": 3600}, axis=axis, centre_m=centre)
    pose = fan.pose_at(time_s)
    turn = pose[:3, :3]
    assert np.allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1)
    assert np.allclose(turn @ axis, axis)
    assert np.allclose(pose @ [*centre, 1], [*centre, 1])
    assert np.trace(turn) == pytest.approx(1 + 2 * math.cos(math.radians(3600 * time_s)))


def test_a_turn_is_right_handed():
    fan = motion({"time_s": 0}, {"time_s": 1, "rotate_deg": 90})
    assert np.allclose(fan.pose_at(1) @ [1, 0, 0, 1], [0, 1, 0, 1])


def test_a_turn_comes_before_the_shift():
    fan = motion({"time_s": 0}, {"time_s": 1, "rotate_deg": 180, "translate_m": (0, 0, 1)}, centre_m=(1, 0, 0))
    assert np.allclose(fan.pose_at(1) @ [2, 0, 0, 1], [0, 0, 1, 1])


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({"keyframes": [{"time_s": 0}]}, "at least 2"),
        ({"keyframes": [{"time_s": 1}, {"time_s": 1}]}, "keyframes with increasing time_s"),
        ({"keyframes": [{"time_s": 0}, {"time_s": 1}], "axis": (0, 0, 0)}, "an axis that is not zero"),
        ({"keyframes": [{"time_s": 0}, {"time_s": 1, "rotate": 3}]}, "rotate"),
    ],
)
def test_motion_that_cannot_be_followed_is_refused(document, message):
    with pytest.raises(ValidationError, match=message):
        RigidMotion(**document)
