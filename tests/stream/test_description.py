"""The description of a stream in words, on a terminal and in a notebook."""

import json

import numpy as np
import pytest

import saf_gen
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.plugins.motions import lens_positions
from saf_gen.stream.description import describe_content, describe_in_numbers, describe_provenance
from saf_gen.stream.metadata import Truth


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
        facts, making = describe_content(stream), describe_provenance(stream)
    assert facts["pixels"] == "6×4"
    assert facts["frames"] == "80 at 40000 Hz (0.002 s)"
    assert facts["mean rate"] == "0.2500 spikes per pixel and readout"
    assert facts["light lamp"] == "gain 0.5 to 2"
    assert facts["true focus"] == "0.25000 of the travel, at frame 19.5"
    # 8 of 80 steps of 1/79 are between 0.2 and 0.3.
    assert facts["depth of focus"] == "0.20000 to 0.30000 of the travel, where the lens is in 10.0% of the frames"
    assert making["variant"] == "llvm"


def test_a_program_reads_numbers(tmp_path, call):
    frames = np.zeros((80, 4, 6), dtype=np.uint8)
    frames[::4] = 1
    saf_gen.write_stream(
        tmp_path / "a.h5",
        frames,
        readout_hz=40_000,
        focus_position=np.linspace(0, 1, 80, dtype=np.float32),
        gain=np.linspace(0.5, 2, 80, dtype=np.float32)[:, None],
        light_names=("lamp",),
        truth={"position": 0.25, "depth_of_focus": (0.2, 0.3)},
        provenance={"variant": "llvm", "lens": '{"f_number": 2.0}'},
    )
    facts = json.loads(call("inspect", tmp_path / "a.h5", "--json")[1])
    assert (facts["frames"], facts["rows"], facts["columns"], facts["readout_hz"]) == (80, 4, 6, 40_000)
    assert facts["seconds"] == pytest.approx(0.002)
    assert facts["mean_rate"] == pytest.approx(0.25)
    assert facts["gain"] == {"lamp": [0.5, 2]}
    assert facts["focus_position"] == [0, 1]
    assert facts["truth"]["position"] == 0.25
    assert facts["truth"]["depth_of_focus"] == [0.2, 0.3]
    assert facts["truth"]["frame"] is None  # it was not stated
    assert facts["provenance"] == {"variant": "llvm", "lens": {"f_number": 2.0}}


def test_a_tilted_target_and_a_lens_that_blurs_are_described(tmp_path):
    truth = {
        "position": 0.5, "depth_of_focus": (0.45, 0.55), "least_blur": 0.4,
        "in_focus": (0.41, 0.6), "least_blur_in_focus": (0.3, 0.52),
    }  # fmt: skip
    saf_gen.write_stream(tmp_path / "a.h5", np.zeros((80, 4, 6), np.uint8), truth=truth)
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        facts = describe_content(stream)
        assert (stream.truth.in_focus, stream.truth.least_blur_in_focus) == ((0.41, 0.6), (0.3, 0.52))
    assert facts["depth of focus"] == "0.45000 to 0.55000 of the travel"
    assert facts["target in focus"] == "0.41000 to 0.60000 of the travel, something of its middle 80 %"
    assert facts["least blur"].endswith("within a resolved width from 0.30000 to 0.52000")


def test_the_rectangle_inside_the_target_is_described(tmp_path):
    target = np.zeros((60, 80), bool)
    target[5:55, 10:50] = True
    for mask, words, ends in (
        (target, "rows 8 to 51, columns 13 to 46", [8, 52, 13, 47]),
        (target[:, ::-1] & target, "no rectangle that is large enough", None),
    ):
        saf_gen.write_stream(tmp_path / "a.h5", np.zeros((80, 60, 80), np.uint8), truth={"target": mask})
        with saf_gen.open_stream(tmp_path / "a.h5") as stream:
            assert describe_content(stream)["inside it"] == words
            assert describe_in_numbers(stream)["truth"]["inside"] == ends


@pytest.mark.parametrize(
    ("motion", "path", "passed"),
    [
        ({"kind": "sweep", "from": 0.8, "to": 0.0}, "0.795 to 0.005 of the travel", "at frame 54.5"),
        (
            {"kind": "sweep_and_return"},
            "0.0125 to 0.0125 of the travel, reversing within 0.0125 to 0.9875",
            "at frame 9.5, the first of 2 times",
        ),
        ({"kind": "hold", "position": 0.5}, "0.5 of the travel throughout", "never passed"),
    ],
)
def test_the_path_of_the_lens_is_described(tmp_path, motion, path, passed):
    lens = lens_positions(motion, 80, readout_hz=80.0)
    truth = {"position": 0.25, "frame": min(focus_crossings(lens, 0.25), default=np.nan)}
    saf_gen.write_stream(tmp_path / "a.h5", np.zeros((80, 4, 6), np.uint8), focus_position=lens, truth=truth)
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        facts = describe_content(stream)
    assert (facts["focus"], facts["true focus"]) == (path, f"0.25000 of the travel, {passed}")


def test_rates_are_described_over_time_and_over_pixels(tmp_path):
    frames = np.zeros((100, 10, 10), np.uint8)
    frames[50:, :, 5:] = 1  # half the pixels fire, in the second half
    saf_gen.write_stream(tmp_path / "a.h5", frames)
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        facts = describe_content(stream)
    assert facts["mean rate"] == "0.2500 spikes per pixel and readout"
    assert (facts["true focus"], facts["focus"]) == ("unknown", "not recorded")
    assert facts["rate over time"] == "0 to 0.5, in 50 parts of the recording"
    assert facts["rate of pixels"] == "0 to 0.5 for 98 % of them, 50 of 100 never fire"


def test_the_content_of_a_stream_is_described_before_its_making(tmp_path, call):
    plan = '{"scene": "fan", "scene_motion": "dynamic", "light": "flicker", "motion": {"kind": "sweep"}}'
    digest = "0" * 64
    saf_gen.write_stream(
        tmp_path / "a.h5", np.ones((8, 2, 2), np.uint8), provenance={"sequence": plan, "fingerprint": digest}
    )
    code, out, _ = call("inspect", tmp_path / "a.h5")
    assert code == 0
    content, making = out.split("how it was made")
    for words in ("fan, dynamic", "flicker", "sweep", "mean rate", "true focus"):
        assert words in content
    assert digest not in content
    assert digest in making
    saf_gen.write_stream(tmp_path / "b.h5", np.ones((8, 2, 2), np.uint8), provenance={"sequence": "[] no JSON"})
    assert call("inspect", tmp_path / "b.h5")[0] == 0


def test_a_truth_shows_numbers_and_the_shapes_of_arrays():
    truth = Truth(0.5, (0.4, 0.6), depth=np.ones((3, 4), np.float32))
    assert repr(truth) == "Truth(position=0.5, depth_of_focus=(0.4, 0.6), depth=float32 (3, 4))"
    assert "<th>depth</th><td>float32 (3, 4)</td>" in truth._repr_html_()
    assert repr(Truth()) == "Truth()"


def test_a_notebook_shows_pictures_and_facts_and_says_when_the_stream_is_closed(tmp_path):
    path = tmp_path / "<b>.h5"
    frames = np.random.default_rng(5).integers(0, 2, (300, 6, 9), np.uint8)
    saf_gen.write_stream(path, frames, truth={"position": 0.25}, light_names=("<lamp>",), gain=np.ones((300, 1)))
    with saf_gen.open_stream(path) as stream:
        shown = stream._repr_html_()
        assert repr(stream) == "<SpikeStream <b>.h5: 300 frames of 9×6 at 20000 Hz, true focus 0.250>"
    assert "data:image/jpeg;base64," in shown
    assert "5 pictures: 30 frames each" in shown
    assert "&lt;b&gt;.h5" in shown
    assert "light &lt;lamp&gt;" in shown
    assert "<lamp>" not in shown
    assert stream._repr_html_() is None
    assert repr(stream).endswith(", closed>")
