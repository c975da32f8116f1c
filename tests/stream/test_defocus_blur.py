"""The signed blur of every pixel against the thin lens equation, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from refusals import assert_says, refusal
from windowed_dataset import FRAMES, SHAPE, list_windowed, make_spikes, make_truth, make_windowed_dataset

import saf_gen
from saf_gen import SpikeWindows
from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.stream.defocus_blur import DefocusBlur, lens_to_text

MACRO = ImageDistanceDrive(focal_length_m=0.035, f_number=2.0, focus_range_m=(0.9, 0.4))
LIQUID = FocalLengthDrive(image_distance_m=0.035, f_number=2.0, focus_range_m=(0.9, 0.4))
TABLE = Stage(focal_length_m=0.05, f_number=2.0, magnification=0.25, travel_m=(0.06, -0.04))
PITCH = 20e-6
POSITION = np.linspace(0, 1, FRAMES, dtype=np.float32)
DEPTH = np.linspace(0.35, 3.0, SHAPE[0] * SHAPE[1], dtype=np.float32).reshape(SHAPE)


def write(path, drive=MACRO, *, depth=DEPTH, sequence=None, lens=None, **fields):
    """Write a stream that states its lens and depth; ``lens`` replaces its text."""
    texts = {"lens": lens_to_text(drive, pitch_m=PITCH) if lens is None else lens, "sequence": sequence}
    truth = fields.pop("truth", make_truth())
    fields = {"focus_position": POSITION, **fields}
    saf_gen.write_stream(
        path,
        make_spikes(0),
        truth=replace(truth, depth=depth),
        provenance={name: text for name, text in texts.items() if text},
        **{name: value for name, value in fields.items() if value is not None},
    )
    return path


def blur_of_images(aperture_m, focal_m, *, image_m, depth_m):
    """The diameter A·|v - v'|/v' in pixels with its sign, from where the lens equation images each depth."""
    v_of_depth = 1 / (1 / focal_m - 1 / depth_m.astype(np.float64))
    return aperture_m * (image_m - v_of_depth) / v_of_depth / PITCH


def test_blur_is_the_law_of_the_thin_lens_in_every_frame(tmp_path):
    with saf_gen.open_stream(write(tmp_path / "a.h5")) as stream:
        for frame in (0, 400, FRAMES - 1):
            v = float(MACRO.image_distance(float(POSITION[frame])))
            law = blur_of_images(0.035 / 2.0, 0.035, image_m=v, depth_m=DEPTH)
            found = stream.blur(frame)
            assert (found.dtype, found.shape) == (np.float32, SHAPE)
            assert np.abs(law).max() > 5
            assert found == pytest.approx(law, abs=0.01)


def test_a_liquid_lens_and_a_stage_obey_it_too():
    for drive in (LIQUID, TABLE):
        blur = DefocusBlur(drive, PITCH, DEPTH.astype(float), POSITION)
        for frame in (0, 700):
            p = float(POSITION[frame])
            v, u = float(drive.image_distance(p)), float(drive.object_distance(p))
            away = DEPTH - float(drive.shift(p))
            law = blur_of_images(2 * drive.aperture_radius_m, 1 / (1 / u + 1 / v), image_m=v, depth_m=away)
            assert blur.at(frame) == pytest.approx(law, abs=0.01)


def test_what_is_behind_the_plane_in_focus_is_positive():
    depth = np.array([[0.0, 0.41, 0.9, 2.0, np.inf]])
    found = DefocusBlur(MACRO, PITCH, depth, POSITION).at(FRAMES // 2)
    assert found[0, 0] == -np.inf
    assert np.array_equal(np.sign(found[0]), [-1, -1, 1, 1, 1])
    assert found[0, 4] > found[0, 3] > found[0, 2]
    assert np.isfinite(found[0, 1:]).all()


def test_blur_and_size_agree_with_the_depth_of_focus():
    ends = np.array(MACRO.depth_of_focus(0.5, PITCH))
    blur = DefocusBlur(MACRO, PITCH, np.full((1, 1), float(MACRO.focus_depth(0.5))), ends)
    assert sorted(float(blur.at(n)[0, 0]) for n in (0, 1)) == pytest.approx([-1, 1], abs=1e-4)


def test_where_an_actuator_moved_the_lens_the_blur_is_that_of_the_lens_not_of_its_log(tmp_path):
    lens = np.full(FRAMES, 0.25, np.float32)
    with saf_gen.open_stream(write(tmp_path / "a.h5", truth=replace(make_truth(), lens=lens))) as stream:
        assert np.array_equal(stream.blur(0), stream.blur(900))
        assert stream.blur(0) == pytest.approx(DefocusBlur(MACRO, PITCH, DEPTH.astype(float), lens).at(0))


def test_a_recording_of_the_sample_is_sharp_on_its_target_where_its_truth_says():
    with saf_gen.open_stream(next(saf_gen.sample().rglob("*constant-00.h5"))) as stream:
        frame, target = round(stream.truth.frame), stream.truth.target
        assert np.abs(stream.blur(frame)[target]).mean() < 0.1
        image_m, object_m = stream.metadata.image_distance, stream.metadata.object_distance
        focal_m = 1 / (1 / float(image_m[0]) + 1 / float(object_m[0]))
        depth = stream.truth.depth
        # The aperture does not enter the ratio of two blurs, which the file's own distances give.
        first, last = (
            blur_of_images(1.0, focal_m, image_m=float(image_m[t]), depth_m=depth) for t in (0, len(image_m) - 1)
        )
        assert stream.blur(0) / stream.blur(len(image_m) - 1) == pytest.approx(first / last, rel=1e-3)


def test_a_stream_that_does_not_state_its_lens_is_refused(tmp_path):
    with saf_gen.open_stream(write(tmp_path / "a.h5", lens="")) as stream:
        assert_says(refusal(stream.blur, 0), "does not state the aperture of its lens | /provenance/lens")


MOVES = json.dumps({"scene_motion": "dynamic"})
REFUSED = {
    "no depth": ({"depth": None}, "does not state the depth"),
    "no depth of photographs": ({"depth": np.full(SHAPE, np.nan, np.float32)}, "does not state the depth"),
    "no lens positions": ({"focus_position": None}, "does not state the positions of its lens"),
    "a scene that moves": ({"sequence": MOVES}, "its scene moves | scenes at rest | stream.truth.depth"),
    "a track of unknown origin": (
        {"truth": replace(make_truth(), track=np.full(FRAMES, 0.4, np.float32))},
        "its scene moves",
    ),
    "no JSON": ({"lens": "f/2"}, "its /provenance/lens is 'f/2' | pitch_m and drive"),
    "a list": ({"lens": "[1]"}, "its /provenance/lens"),
    "no pitch": ({"lens": json.dumps({"drive": MACRO.as_dict()})}, "its /provenance/lens"),
    "no width of pixels": ({"lens": lens_to_text(MACRO, pitch_m=0.0)}, "its /provenance/lens"),
    "a drive that nobody knows": ({"lens": '{"pitch_m": 1e-5, "drive": {"kind": "zoom"}}'}, "its /provenance/lens"),
    "a lens without aperture": (
        {"lens": json.dumps({"pitch_m": PITCH, "drive": {**MACRO.as_dict(), "f_number": 0}})},
        "its /provenance/lens",
    ),
    "a lens of text": (
        {"lens": json.dumps({"pitch_m": PITCH, "drive": {**MACRO.as_dict(), "f_number": "two"}})},
        "its /provenance/lens",
    ),
    "an aperture without end": (
        {"lens": json.dumps({"pitch_m": PITCH, "drive": {**MACRO.as_dict(), "f_number": float("nan")}})},
        "its /provenance/lens",
    ),
    "no lens at all": ({"lens": ""}, "does not state the aperture of its lens"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_stream_that_does_not_tell_is_refused_in_one_line(tmp_path, name):
    how, says = REFUSED[name]
    with saf_gen.open_stream(write(tmp_path / "a.h5", **how)) as stream:
        error = refusal(stream.blur, 0)
    assert_says(error, f"a.h5 | {says}")


@pytest.mark.parametrize("frame", [-1, FRAMES, 1.5, "0", None, np.nan])
def test_a_frame_that_is_not_there_is_refused(tmp_path, frame):
    with saf_gen.open_stream(write(tmp_path / "a.h5")) as stream:
        assert_says(refusal(stream.blur, frame), f"a whole number, 0 to {FRAMES - 1}")


def test_light_that_changes_its_colour_is_no_motion(tmp_path):
    rest = json.dumps({"scene_motion": "static"})
    truth = replace(make_truth(), track=np.full(FRAMES, 0.4, np.float32))
    with saf_gen.open_stream(write(tmp_path / "a.h5", truth=truth, sequence=rest)) as stream:
        assert np.isfinite(stream.blur(5)).all()


def test_windows_give_depth_and_blur_of_the_pixels_that_are_counted(tmp_path):
    dataset = make_windowed_dataset(tmp_path)
    for n in range(3):
        write(next(dataset.rglob(f"s{n}.h5")))
    list_windowed(dataset)
    box = (slice(0, 4), slice(4, 9))
    depths = SpikeWindows(dataset, "all", window=100, stride=50, crop=(4, 5), target="depth")
    blurs = SpikeWindows(dataset, "all", window=100, stride=50, crop=(4, 5), target="blur")
    with saf_gen.open_stream(dataset / "train/s0.h5") as stream:
        for number in (0, 7):
            (counts, depth), (_, blur) = depths[number], blurs[number]
            assert counts.shape == (1, *depth.shape)
            assert (depth.dtype, blur.dtype) == (np.float32, np.float32)
            assert np.array_equal(depth, DEPTH[box])
            assert np.array_equal(blur, stream.blur(50 * number + 50)[box])
    depths[0][1][:] = 0  # by somebody who scales it in place
    assert np.array_equal(depths[0][1], DEPTH[box])


@pytest.mark.parametrize("target", ["depth", "blur"])
def test_windows_of_scenes_that_move_have_no_dense_targets(tmp_path, target):
    dataset = make_windowed_dataset(tmp_path)
    write(dataset / "train/s0.h5", sequence=MOVES)
    list_windowed(dataset)
    assert_says(
        refusal(SpikeWindows(dataset, "all", window=100, target=target).__getitem__, 0), "s0.h5 | its scene moves"
    )
