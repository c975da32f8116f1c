"""Peaks of noise-free curves: of stripes of two widths that are sharp at two positions, at rest and moving."""

from dataclasses import replace

import numpy as np
import pytest
from small_dataset import make_sequence

import saf_gen
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.camera import get_sensor
from saf_gen.core.region import bounding_box
from saf_gen.generate import record
from saf_gen.optics import ImageDistanceDrive
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.focal_stack import FocalStack, StackSpec
from saf_gen.stack.noise_free import MEASURES, find_optima, noise_free_sharpness
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
from saf_gen.stack.true_focus import find_true_focus
from saf_gen.stream.metadata import Truth
from saf_gen.stream.optima import curve_peak, fitted_peak, optima_of_stream, optima_to_text

SIZE, POSITIONS = 64, 129
DRIVE = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))
SENSOR = get_sensor("ideal", rows=SIZE, columns=SIZE, pitch_m=10e-6)
FOCUS = np.linspace(0, 1, POSITIONS)
WIDE, NARROW = 16, 16 / 3  # periods in pixels
APART, WIDTH = 0.04, 0.08  # narrow stripes are sharp at the truth plus APART
SWEEP = (np.arange(400) + 0.5) / 400
WHOLE = {"box": (slice(0, SIZE), slice(0, SIZE)), "sharpness": np.zeros(POSITIONS), "position": SWEEP}


def bell(p, middle):
    return np.exp(-(((p - middle) / WIDTH) ** 2))


def stack(truth=0.5, *, moment=None, wide=1.0, narrow=1.0, apart=APART):
    x = np.arange(SIZE) * 2 * np.pi
    light = 1 + 0.2 * wide * bell(FOCUS, truth)[:, None] * np.cos(x / WIDE)
    light += 0.2 * narrow * bell(FOCUS, truth + apart)[:, None] * np.cos(x / NARROW)
    light = np.broadcast_to(light[:, None], (POSITIONS, SIZE, SIZE)).astype(np.float32)[None]
    spec = StackSpec("plane", "0" * 64, ("lamp",), DRIVE, SIZE, SIZE, 10e-6, POSITIONS, 16, 4)
    if moment is not None:
        spec = replace(spec, time_s=moment / 20_000, window=(0, POSITIONS - 1))
    depth = np.full((SIZE, SIZE), float(DRIVE.focus_depth(truth)), np.float32)
    return FocalStack(spec, light, depth, np.ones((SIZE, SIZE), bool), "llvm")


def optima_of(source, position=SWEEP):
    truth, _ = find_true_focus(source, position)
    charge = ChargeSource(source, SENSOR)
    box = bounding_box(truth.target)
    (sharpness,) = noise_free_sharpness(charge, [box], position=position)
    return find_optima(charge, truth, box=box, sharpness=sharpness, position=position), truth


def structure(period, apart):
    """Mean squared difference, over rows, of stripes of amplitude 1."""
    return 2 * np.sin(np.pi * apart / period) ** 2


WEIGHTS = {
    "sd": lambda p: 0.5,
    "squared_gradient": lambda p: structure(p, 1),
    "brenner": lambda p: structure(p, 2),
    "tenengrad": lambda p: 16 * structure(p, 2),
    "energy_of_laplacian": lambda p: 18 * (2 - 2 * np.cos(2 * np.pi / p)) ** 2,
    "variance_of_laplacian": lambda p: (2 - 2 * np.cos(2 * np.pi / p)) ** 2 / 72,
    "vollath_f4": lambda p: (np.cos(2 * np.pi / p) - np.cos(4 * np.pi / p)) / 2,
    "vollath_f5": lambda p: np.cos(2 * np.pi / p) / 2,
    "mid_band_power": lambda p: 0.5 * (4 <= p <= 8),
    "octave_structure": lambda p: sum((structure(p, 2 * n) - structure(p, n)) / n for n in (1, 2, 4)),
    "structure_calibrated": lambda p: sum(structure(p, n) / n for n in (1, 2, 4, 8)),
}


def peak_of(measure):
    """Where the weighted squares of the two bells are largest, relative to the truth."""
    p = np.linspace(-0.1, 0.2, 30_001)
    w = WEIGHTS[measure]
    return float(p[np.argmax(w(WIDE) * bell(p, 0) ** 2 + w(NARROW) * bell(p, APART) ** 2)])


def test_each_measure_peaks_where_its_weights_of_two_stripes_say():
    """Within 3e-3 of a travel: stripes end within a period, and brightness changes by 1 % over the curve."""
    found, _ = optima_of(PlaneSource.from_stack(stack()))
    assert set(found) == set(MEASURES) == set(WEIGHTS) - {"sd"}
    expected = {name: peak_of(name) for name in MEASURES}
    assert found == pytest.approx(expected, abs=3e-3)
    assert np.ptp(list(expected.values())) > 0.02


def test_a_scene_that_blur_does_not_change_has_no_optimum():
    """Only the bellows change its brightness. Nor has a black one."""
    made = stack()
    for radiance in (np.repeat(made.radiance[:, 64:65], POSITIONS, axis=1), np.zeros_like(made.radiance)):
        source = PlaneSource.from_stack(replace(made, radiance=radiance))
        truth, _ = find_true_focus(source, SWEEP)
        assert find_optima(ChargeSource(source, SENSOR), truth, **WHOLE) == {}


def test_under_lamps_whose_mix_changes_nothing_is_said():
    source = PlaneSource.from_stack(stack())
    truth, _ = find_true_focus(source, SWEEP)
    truth = replace(truth, track=np.full(400, 0.5, np.float32))
    assert find_optima(ChargeSource(source, SENSOR), truth, **WHOLE) == {}


@pytest.mark.parametrize("motion", [0.0, 0.3])
def test_in_a_moving_scene_the_peak_of_sd_is_off_the_moving_truth(motion):
    """The stripes move in depth; a lens that meets them sees both bells wider and farther apart, by the same factor."""
    at = tuple(range(0, 401, 20))
    made = [stack(0.5 + motion * (moment / 400 - 0.5), moment=moment) for moment in at]
    light = lambda j, first, stop: made[j].radiance[:, first:stop]  # noqa: E731
    source = PlaneSource(
        TimeResolvedStack(at, tuple(one.spec for one in made)),
        light,
        lambda j: (made[j].depth, made[j].target),
        "d",
        "llvm",
    )
    found, truth = optima_of(source)
    assert set(found) == {"sd"}
    assert truth.track is not None
    assert found["sd"] == pytest.approx(APART / 2, abs=3e-3)


def test_a_fitted_peak_stands_scatter_and_says_when_it_does_not():
    """200 draws (seed 5) of 0.5 % scatter around a bell: 95 % of the peaks given are within 0.05 depths of focus."""
    random = np.random.default_rng(5)
    curve, dof = bell(FOCUS, 0.513) ** 2, 0.08
    assert fitted_peak(curve, dof=dof) == pytest.approx(0.513, abs=0.02 * dof)
    found = [fitted_peak(curve * (1 + 0.005 * random.standard_normal(POSITIONS)), dof=dof) for _ in range(200)]
    given = np.array([one for one in found if one is not None])
    assert given.size > 150
    assert np.mean(np.abs(given - 0.513) < 0.05 * dof) > 0.95
    noisy = [fitted_peak(1 + 0.1 * random.standard_normal(POSITIONS), dof=dof) for _ in range(50)]
    assert sum(one is not None for one in noisy) <= 5


@pytest.mark.parametrize(
    "curve", [None, np.ones(129), np.full(129, np.nan), np.arange(129.0), np.ones(9), np.zeros(129)]
)
def test_a_curve_without_a_peak_is_not_fitted(curve):
    assert fitted_peak(curve, dof=0.08) is None


def test_optima_are_stored_beside_the_content_which_keeps_its_digest(tmp_path, monkeypatch):
    def written(name):
        recorder = record.Recorder(SENSOR, 400, device_seed=1, provenance={})
        source = PlaneSource.from_stack(stack())
        digest = recorder.record(make_sequence(mean_rate=0.2), source, path=tmp_path / name, fingerprint="")
        with saf_gen.open_stream(tmp_path / name) as stream:
            return digest, optima_of_stream(stream.metadata.provenance)

    with_optima = written("new.h5")
    monkeypatch.setattr(record, "find_optima", lambda *which, **more: {})
    assert written("old.h5") == (with_optima[0], {})
    assert with_optima[1]["brenner"] == pytest.approx(peak_of("brenner"), abs=3e-3)


def test_a_recording_states_curves_and_optima_inside_its_target_apart_from_those_of_its_box(tmp_path):
    """Wide stripes on the target, narrow ones, sharp elsewhere, beside it in the box, which a row of it spans."""
    left, beside = stack(narrow=0.0), stack(wide=0.0)
    target = np.zeros((SIZE, SIZE), bool)
    target[:, :40] = target[0] = True
    light = np.where(target, left.radiance, beside.radiance)
    source = PlaneSource.from_stack(replace(left, radiance=light, target=target))
    recorder = record.Recorder(SENSOR, 400, device_seed=1, provenance={})
    recorder.record(make_sequence(mean_rate=0.2), source, path=tmp_path / "a.h5", fingerprint="")
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        truth, provenance = stream.truth, stream.metadata.provenance
        records = evaluate(tmp_path / "a.h5", methods=["brenner+argmax", "brenner+argmax@inside"]).records
    assert truth.inside == (3, 61, 3, 37)
    image = ChargeSource(source, SENSOR).nominal_image(0.0, 0.25)[3:61, 3:37].astype(float)
    assert truth.sharpness_inside[32] == pytest.approx(image.var() / image.mean() ** 2, rel=1e-6)
    assert curve_peak(truth.sharpness_inside, dof=WIDTH) == pytest.approx(truth.position, abs=3e-3)
    assert curve_peak(truth.sharpness, dof=WIDTH) > truth.position + 5e-3
    of_box, inside = (optima_of_stream(provenance, region) for region in ("target", "inside"))
    assert inside["brenner"] == pytest.approx(0, abs=3e-3)
    assert of_box["brenner"] > 0.03
    stated = {r.who.region: r.judgement.optimum - r.judgement.truth for r in records}
    assert stated == pytest.approx({"target": of_box["brenner"], "inside": inside["brenner"]})


@pytest.mark.parametrize("text", ["", "[]", "{", '{"sd": "near"}', '{"sd": null}', '{"sd": 1e999}', "3", '{"sd": [1]}'])
def test_a_text_that_states_no_optima_is_read_as_none(text):
    assert optima_of_stream({"optima": text}) == {}
    assert optima_of_stream({}) == {}
    assert optima_of_stream({"optima": optima_to_text({"sd": -0.0123456789})}) == {"sd": -0.0123457}


def test_whole_targets_of_recordings_follow_from_what_they_hold():
    """A slanted target in steps of a tenth; a flat one; one of a file that says no more than its depth of focus."""
    plain = Truth(position=0.5, depth_of_focus=(0.55, 0.45))
    assert plain.whole_target == (0.45, 0.55)
    best = np.linspace(0.4, 0.6, 11, dtype=np.float32)[None]
    tilted = replace(plain, best_position=best, target=np.ones((1, 11), bool))
    assert tilted.whole_target == pytest.approx((0.37, 0.63), abs=1e-6)
    assert replace(tilted, best_position=np.full((1, 11), 0.5001)).whole_target == (0.45, 0.55)
    assert replace(tilted, target=np.zeros((1, 11), bool)).whole_target == (0.45, 0.55)
    assert replace(tilted, in_focus=(0.3, 0.8)).whole_target == (0.3, 0.8)
