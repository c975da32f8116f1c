"""What is in a stream, in words."""

import numpy as np
import pytest

import saf_gen
from saf_gen.core.focus_crossings import find_focus_crossings
from saf_gen.motions import lens_motion_at_readouts
from saf_gen.stream.inspection import describe_stream_file


def test_a_stream_with_truth_is_described(tmp_path):
    frames = np.zeros((80, 4, 6), dtype=np.uint8)
    frames[::4] = 1
    saf_gen.write_stream(
        tmp_path / "a.h5",
        frames,
        readout_hz=40_000,
        focus_position=np.linspace(0, 1, 80, dtype=np.float32),
        gain=np.linspace(0.5, 2, 80, dtype=np.float32)[:, None],
        light_names=("lamp",),
        truth={"position": 0.25, "depth_of_focus": (0.2, 0.3), "frame": 19.5},
        provenance={"variant": "llvm"},
    )
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        facts = describe_stream_file(stream)
    assert facts["pixels"] == "6×4"
    assert facts["frames"] == "80 at 40000 Hz (0.002 s)"
    assert facts["mean rate"] == "0.2500 spikes per pixel and readout"
    assert facts["light lamp"] == "gain 0.5 to 2"
    assert facts["true focus"] == "0.25000 of the travel, at frame 19.5"
    assert facts["depth of focus"] == "0.20000 to 0.30000 of the travel"
    assert facts["variant"] == "llvm"


@pytest.mark.parametrize(
    ("motion", "path", "passed"),
    [
        ({"kind": "sweep", "from": 0.8, "to": 0.0}, "0.795 to 0.005 of the travel", "at frame 54.5"),
        (
            {"kind": "sweep_and_return"},
            "0.0125 to 0.0125 of the travel with turns, within 0.0125 to 0.9875",
            "at frame 9.5, the first of 2 times",
        ),
        ({"kind": "hold", "position": 0.5}, "0.5 of the travel throughout", "never passed"),
    ],
)
def test_the_path_of_the_lens_is_described(tmp_path, motion, path, passed):
    lens = lens_motion_at_readouts(motion, 80, readout_hz=80.0)
    when = find_focus_crossings(lens, 0.25)
    saf_gen.write_stream(
        tmp_path / "a.h5",
        np.zeros((80, 4, 6), dtype=np.uint8),
        focus_position=lens,
        truth={"position": 0.25, "frame": when[0] if when.size else np.nan},
    )
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        facts = describe_stream_file(stream)
    assert facts["focus"] == path
    assert facts["true focus"] == f"0.25000 of the travel, {passed}"


def test_a_stream_without_truth_says_so(tmp_path):
    saf_gen.write_stream(tmp_path / "a.h5", np.zeros((8, 2, 2), dtype=np.uint8))
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        facts = describe_stream_file(stream)
    assert facts["true focus"] == "unknown"
    assert facts["focus"] == "not recorded"
