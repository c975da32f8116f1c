"""What is in a stream, in words."""

import numpy as np

import saf_gen
from saf_gen.inspection import describe


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
        facts = describe(stream)
    assert facts["pixels"] == "6×4"
    assert facts["frames"] == "80 at 40000 Hz (0.002 s)"
    assert facts["mean rate"] == "0.2500 spikes a pixel and readout"
    assert facts["light lamp"] == "gain 0.5 to 2"
    assert facts["true focus"] == "0.25000 of the travel, at frame 19.5"
    assert facts["depth of focus"] == "0.20000 to 0.30000 of the travel"
    assert facts["variant"] == "llvm"


def test_a_stream_without_truth_says_so(tmp_path):
    saf_gen.write_stream(tmp_path / "a.h5", np.zeros((8, 2, 2), dtype=np.uint8))
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        facts = describe(stream)
    assert facts["true focus"] == "unknown"
    assert facts["focus"] == "not recorded"
