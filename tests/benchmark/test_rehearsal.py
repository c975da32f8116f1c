"""A closed loop says before it runs which searches its budget is too short for."""

import math

import numpy as np
import pytest

from saf_gen import get_search, write_stream
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.rehearsal import describe_short_budget, seconds_needed
from saf_gen.optics.actuators import get_actuator

METHODS = [parse_method(f"sd+{search}") for search in ("golden_section", "hill_climb", "argmax")]


def test_a_faster_drive_needs_less_and_a_hand_more():
    golden = get_search("golden_section")
    needed = [
        seconds_needed(golden, get_actuator(name), readout_hz=20_000.0) for name in ("ideal", "voice_coil_hall", "hand")
    ]
    assert needed == sorted(needed)
    assert needed[0] >= 11 * 100 / 20_000  # eleven samples of a hundred frames
    assert (
        seconds_needed(get_search("golden_section", dt=100_000), get_actuator("ideal"), readout_hz=20_000.0) == math.inf
    )


@pytest.mark.parametrize(
    ("drive", "budget_s", "named"),
    [
        ("voice_coil", None, ["golden_section", "hill_climb"]),
        ("voice_coil_hall", 0.22, ["hill_climb"]),
        ("voice_coil_hall", 0.3, []),
    ],
)
def test_searches_that_need_more_than_the_budget_are_named_with_what_they_need(tmp_path, drive, budget_s, named):
    write_stream(tmp_path / "a.h5", np.zeros((8000, 2, 2), np.uint8), readout_hz=20_000.0)
    line = describe_short_budget(
        tmp_path / "a.h5", METHODS, protocol=ClosedLoopProtocol(get_actuator(drive), budget_s=budget_s)
    )
    assert [
        word for word in line.replace(":", "").split() if word in ("golden_section", "hill_climb", "argmax")
    ] == named
    assert line.startswith(f"{1e3 * (budget_s or 0.4):g} ms with ") or not named


def test_a_stream_that_cannot_be_read_is_left_to_the_evaluation(tmp_path):
    assert (
        describe_short_budget(tmp_path / "none.h5", METHODS, protocol=ClosedLoopProtocol(get_actuator("ideal"))) == ""
    )
