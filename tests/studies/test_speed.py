"""The benches run and yield every documented figure; their speed is not tested."""

import importlib
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from capture_dataset import write_moving_plane
from small_dataset import HERE
from written_scenes import needs_llvm

from saf_gen.camera import get_sensor
from saf_gen.errors import BadInput
from studies.speed import bench, bias_maps, grain, public_encoders
from studies.speed.bench import Figure, Size

SMALL = Size(
    sensor=str(HERE / "small_sensor.yaml"),
    frames=400,
    positions=(5, 9),
    samples=16,
    reference=32,
    public_frames=4,
    sequences=2,
    reads=500,
)


def measured(name, size=SMALL):
    return list(importlib.import_module(f"studies.speed.{name}").run(size))


def assert_promised(figures):
    """Assert that each figure is a number with a unit; return the figures by what they state, without remarks."""
    figures = [figure for figure in figures if isinstance(figure, Figure)]
    assert figures
    for figure in figures:
        assert math.isfinite(figure.value)
        assert figure.value > 0 or figure.unit in ("dB", "%", "pieces", "s"), figure  # a difference of times may be 0
        assert figure.unit
    return {figure.what: figure for figure in figures}


@pytest.mark.parametrize(
    "name",
    [
        "encode",
        "cameras",
        "events",
        "stream",
        "score",
        pytest.param("stack", marks=needs_llvm),
        pytest.param("windows", marks=pytest.mark.long),
    ],
)
@pytest.mark.slow
def test_a_bench_gives_its_figures(name):
    assert_promised(measured(name))


@pytest.mark.slow
def test_the_bench_of_a_complete_job_renders_nothing_for_another_light(test_scenes, small_recipe):
    found = assert_promised(measured("job", Size(recipe=str(small_recipe))))
    assert [figure.value for figure in found.values() if figure.unit == "pieces"] == [0]


@pytest.mark.slow
@needs_llvm
def test_the_grain_of_a_moving_scene_is_measured_at_rest_and_in_slices(tmp_path, monkeypatch):
    """Slices of 16 samples have more grain than stills of 64, by a factor of 2 for independent samples.

    With shared shading the factor is smaller, because the shading of a slice is estimated from paths of nine slices.
    """
    write_moving_plane(tmp_path, monkeypatch)
    sensor = tmp_path / "smaller.yaml"
    sensor.write_text(Path(SMALL.sensor).read_text().replace("rows: 40\ncolumns: 64", "rows: 20\ncolumns: 32"))
    monkeypatch.setattr(grain, "fresh", lambda function, *arguments: function(*arguments))
    found = assert_promised(measured("grain", replace(SMALL, sensor=str(sensor), positions=(9, 17), scenes=("plane",))))
    slices = []
    for place in ("best focus", "a quarter away", "position 0", "position 1"):
        still, moving = (found[f"plane, {kind}, {place}: rms over mean"].value for kind in ("still", "slice"))
        assert 1.1 < moving / still < 3
        slices.append(moving)
    worst = [figure for what, figure in found.items() if what.startswith("worst slice: rms over mean")]
    assert [(figure.value, figure.target) for figure in worst] == [(max(slices), 4.0)]
    assert all(figure.low <= figure.value <= figure.high for figure in found.values() if figure.low is not None)


@pytest.mark.slow
def test_a_fresh_process_has_its_own_peak_memory_and_its_errors_are_raised_here():
    held = np.ones(1 << 29, np.uint8)
    assert 0 < bench.fresh(bench.peak_gib) < held.nbytes / 2**30 < bench.peak_gib()
    with pytest.raises(BadInput, match="unknown sensor 'vidr_400x250'"):
        bench.fresh(get_sensor, "vidr_400x250")


def test_a_bench_prints_its_figures_and_memory_or_why_it_cannot_run(capsys):
    def found(size):
        yield Figure("size", 0.25, "bit", 0.32, at_most=True)
        yield Figure("speed", 1234.5, "/s", 2000.0, low=1000.0, high=math.inf)
        yield "a thing is left out"

    def broken(size):
        yield "begun"
        raise BadInput("no LLVM", hint="install LLVM")

    assert bench.main(found, []) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["size: 0.25 bit; target ≤ 0.32", "speed: 1,234 (1,000 to inf) /s; target ≥ 2000, MISSED"]
    assert lines[2] == "a thing is left out"
    assert lines[3].startswith("peak memory of a process: ")
    assert bench.main(broken, []) == 2
    assert "no LLVM" in capsys.readouterr().err


# Public encoders.


def test_every_public_encoder_gives_a_spike_or_none_at_our_rate():
    grey = np.full((3, 40, 50), 51, np.uint8)
    for encoder in public_encoders.ENCODERS:
        spikes = encoder.run(grey, np.random.default_rng(1))
        assert spikes.shape == grey.shape
        assert set(np.unique(spikes)) <= {0, 1}
    many = np.broadcast_to(grey[:1], (500, 40, 50))
    for encoder in public_encoders.ENCODERS[:3]:
        rate = encoder.run(many, np.random.default_rng(2)).mean()
        # 2,000 pixels, 500 readouts; SCSim's pixels differ by 8 % rms, so their mean by 0.2 %.
        assert rate == pytest.approx(0.2, rel=0.05), encoder.name


def test_the_vectorised_simulator_equals_the_one_pixel_by_pixel():
    """Without noise bits agree; with noise rates agree within 5 sd, for 8,000 pixel·frames each and one seed."""
    video = np.random.default_rng(5).integers(20, 200, (40, 10, 20), dtype=np.uint8)
    simulators = (public_encoders.simulate, public_encoders.simulate_pixel_by_pixel)
    pictures, pixels = (simulate(video, np.random.default_rng(6)) for simulate in simulators)
    # The counts of each pixel scatter by less than one; the mean of each device by 8 %/sqrt(200).
    sd = math.sqrt(2 * (0.08**2 * 200 * pixels.sum(axis=0).mean() ** 2 + 200)) / 200
    assert abs(pictures.sum(axis=0).mean() - pixels.sum(axis=0).mean()) < 5 * sd
    pictures, pixels = (simulate(video, Quiet()) for simulate in simulators)
    assert np.array_equal(pictures, pixels)
    assert 0.1 < pictures.mean() < 0.9


class Quiet:
    """A generator without noise: each draw is its mean, and phases rise from pixel to pixel."""

    def random(self, shape):
        return np.linspace(0, 4, math.prod(shape)).reshape(shape)

    def normal(self, mean, sd, shape=None):
        return mean if shape is None else np.full(shape, mean)

    def poisson(self, mean):
        return mean


# Scripts, at small sizes.


def test_planted_bias_and_noise_are_separated():
    """Plain and filtered renders of 40,000 pixels have noise of 10 %, and a bias of 2 %, or 4 % in a tenth of them.

    The mean of half the renders has noise of 7 %, and a product of two differences 0.1²; the mean of both products
    has 0.0087. Over N pixels the standard error of the squared bias is 0.0087/√N, and that of the mean 0.1/√(2N).
    Bounds are five standard errors.
    """
    random, shape = np.random.default_rng(1), (200, 200)
    truth = np.full(shape, 5.0)
    biased = truth * 1.02
    biased[:20] = truth[:20] * 1.04
    plain, filtered = (mean * (1 + 0.1 * random.standard_normal((4, *shape))) for mean in (truth, biased))
    tenth, everywhere = np.arange(200)[:, None] + 0 * truth < 20, np.ones(shape, dtype=bool)
    for mask, rms, mean in ((everywhere, np.sqrt(0.9 * 0.02**2 + 0.1 * 0.04**2), 0.022), (tenth, 0.04, 0.04)):
        found = bias_maps.measure_errors(plain, filtered, mask)
        assert found.bias**2 == pytest.approx(rms**2, abs=5 * 0.0087 / np.sqrt(mask.sum()))
        assert found.mean == pytest.approx(mean, abs=5 * 0.1 / np.sqrt(2 * mask.sum()))
        assert found.noise == pytest.approx(0.1 * (1 + rms), rel=0.05)
        assert found.share == mask.mean()


@needs_llvm
@pytest.mark.slow
def test_bias_maps_are_drawn_and_plain_renders_kept(tmp_path, test_scenes, monkeypatch):
    monkeypatch.setattr(bias_maps, "CASES", (bias_maps.Case("plane", 0.25, (24, 32)),))
    plan = bias_maps.Plan(plain=2, batch=8, filtered=2, slice_samples=4, still_samples=4)
    arguments = ["--out", str(tmp_path / "out"), "--references", str(tmp_path / "kept")]
    bias_maps.main(arguments, plan=plan)
    first = json.loads((tmp_path / "out" / "bias.json").read_text())["plane-quarter"]
    assert abs(first["all"]["mean"]) < 0.05
    assert first["all"]["share"] == 1
    assert (tmp_path / "out" / "bias-plane-quarter.png").stat().st_size > 10_000
    kept = sorted((tmp_path / "kept").iterdir())
    assert [path.name for path in kept] == ["plane_quarter_0.npy", "plane_quarter_1.npy"]
    np.save(kept[0], 2 * np.load(kept[0]))
    bias_maps.main(arguments, plan=plan)
    again = json.loads((tmp_path / "out" / "bias.json").read_text())["plane-quarter"]
    assert again["all"]["mean"] == pytest.approx((1 + first["all"]["mean"]) / 1.5 - 1, abs=0.02)
