"""The benches run and yield every documented figure; their speed is not tested."""

import importlib
import json
import math
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from capture_dataset import write_moving_plane
from small_dataset import HERE
from written_scenes import needs_llvm

from saf_gen.authoring.checks import grain as goals
from saf_gen.camera import get_sensor
from saf_gen.errors import BadInput
from saf_gen.render import backend
from studies import drawing
from studies.speed import bench, bias_maps, chunks, error, grain, growth, public_encoders, stack, stream, synthetic
from studies.speed.__main__ import BENCHES, main
from studies.speed.bench import Figure, Size

PLACES = ("best focus", "a quarter away", "position 0", "position 1")
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
# For each bench, parts of the texts of its figures, with the target of each figure.
PROMISED = {
    "stack": {
        "one pass, 5 positions, 64×40, 16 samples": None,
        "times faster than 5 thin-lens": 45.0,
        "times faster than 9 thin-lens": 150.0,
        "light paths": None,
        "relative to the thin lens at equal samples": 0.2,
        "error of shared shading at 64 samples": None,
        "thin-lens renders of equal error": 100.0,
    },
    "encode": {
        "64×40, 400 frames, all noise on": 2.5,
        "camera of 40 kHz": 1.0,
        "times faster, all noise on, than SpikeCV's image": None,
        "times faster, all noise on, than SpikeCV's video": None,
        "times faster, all noise on, than SCSim's simulator as published": None,
        "time per frame of 4,000 frames, relative to 400": 1.1,
        "peak memory, 4,000 frames": 2.0,
        "difference of the two": 10.0,
    },
    "stream": {
        "write, verified": 3.0,
        "size": 0.32,
        "SD of 200 windows": 0.5,
        "counts of 200 windows, all pixels": None,
        "counts of one window of 2 frames": None,
        "counts of a region of 64×40": None,
    },
    "grain": {
        "plane, still, best focus: rms over mean": None,
        "plane, still, position 1: noise over signal in C²": 1.0,
        "plane, slice, best focus: rms over mean": 4.0,
        "plane, slice, best focus: noise over signal in C²": None,
        "plane, slice, a quarter away: noise over signal in C²": 5.0,
        "plane, slice, position 0: noise over signal in Brenner": None,
        "plane, slice, position 0: noise over signal in Tenengrad": None,
        "plane, slice, position 0: noise over signal in the variance of the Laplacian": None,
        "correlation of grain with the next slice": None,
        "correlation of grain with the slice 8 on": None,
        "loaded, rendered at two positions and stored": None,
    },
    "windows": {
        "random windows of 100 frames, 64×40, 2 processes": 1_500.0,
        "in the first pass": None,
        "peak memory of a process that reads": 1.0,
    },
    "score": {"10 methods, 2 sequences of 400 frames": 30.0, "time of the methods, relative to their measures": None},
    "job": {
        "recipe to leaderboard": 120.0,
        "under a new light, stacks there, 1 recorded": None,
        "pieces of stacks rendered for them": 0.0,
    },
}


def measured(name, size=SMALL):
    return list(importlib.import_module(f"studies.speed.{name}").run(size))


def assert_promised(name, figures):
    for figure in figures:
        assert math.isfinite(figure.value)
        assert figure.value > 0 or figure.unit in ("dB", "%", "pieces"), figure
        assert figure.unit
    for words, target in PROMISED[name].items():
        assert [f.target for f in figures if words in f.what][:1] == [target], words


@pytest.mark.parametrize("name", ["encode", "stream", "windows", "score", pytest.param("stack", marks=needs_llvm)])
@pytest.mark.slow
def test_a_bench_gives_every_figure_promised(name):
    assert_promised(name, measured(name))


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
    found = measured("grain", replace(SMALL, sensor=str(sensor), positions=(9, 17), scenes=("plane",)))
    assert_promised("grain", found)
    values = {f.what: f.value for f in found}
    for place in PLACES:
        ratio = values[f"plane, slice, {place}: rms over mean"] / values[f"plane, still, {place}: rms over mean"]
        assert 1.1 < ratio < 3
    worst = {f.what.partition(" (")[0]: f for f in found if f.what.startswith("worst")}
    assert {what: f.target for what, f in worst.items()} == {
        "worst slice: rms over mean": 4.0,
        "worst slice away from focus: noise over signal in C²": 5.0,
        "worst still: noise over signal in C²": 1.0,
    }
    rms = [f.value for f in found if "slice, " in f.what and f.what.endswith("rms over mean")]
    assert worst["worst slice: rms over mean"].value == max(rms)
    assert all(f.low <= f.value <= f.high for f in found if f.low is not None)


@needs_llvm
def test_a_scene_whose_grain_cannot_be_measured_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(grain, "fresh", lambda function, *arguments: function(*arguments))
    folder = write_moving_plane(tmp_path, monkeypatch)
    (folder / "scene.py").write_text("def build(params):\n    return {}\n")
    found = grain.run(replace(SMALL, scenes=("plane",)))
    assert next(found).startswith("plane is left out: ")
    with pytest.raises(BadInput):  # the only one
        next(found)
    with pytest.raises(BadInput, match="did you mean 'camel'"):
        measured("grain", replace(SMALL, scenes=("camell",)))


def test_grain_is_measured_with_the_samples_of_the_projects_recipes():
    renders = [yaml.safe_load(path.read_text())["render"] for path in (HERE.parent / "recipes").glob("sa[df]_*.yaml")]
    assert {r["samples"] for r in renders} == {Size().still_samples} == {goals.STILL_SAMPLES}
    slices = {r["slice_samples"] for r in renders if "slice_samples" in r}
    assert slices == {Size().slice_samples} == {goals.SLICE_SAMPLES}


@pytest.mark.slow
def test_the_bench_of_a_complete_job_renders_nothing_for_another_light(test_scenes, small_recipe):
    found = measured("job", Size(recipe=str(small_recipe)))
    assert_promised("job", found)
    assert [f.value for f in found if f.unit == "pieces"] == [0]


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


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["encode", "steam"], "unknown bench 'steam'; allowed: "), (["encode", "--scene", "fan"], "for the bench grain")],
)
def test_benches_that_cannot_be_meant_are_refused(arguments, said, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_the_other_benches_run_after_one_that_fails(monkeypatch, capsys):
    ran = []

    def run(command):
        ran.append(command[2:])
        return subprocess.CompletedProcess(command, int("encode" in command[2]))

    monkeypatch.setattr(subprocess, "run", run)
    assert main(["encode", "grain", "--scene", "fan"]) == 1
    assert ran == [["studies.speed.encode"], ["studies.speed.grain", "--scene=fan"]]
    assert "encode failed" in capsys.readouterr().err


def test_every_bench_is_a_module_with_promised_figures():
    assert set(BENCHES) == set(PROMISED)
    assert all(callable(importlib.import_module(f"studies.speed.{name}").run) for name in BENCHES)


def test_a_target_is_met_on_its_own_side():
    assert Figure("speed", 3.0, "x/s", 2.5).met is True
    assert Figure("speed", 2.0, "x/s", 2.5).met is False
    assert Figure("time", 0.4, "s", 0.5, at_most=True).met is True
    assert Figure("size", 0.4, "bit").met is None


def test_bytes_that_the_system_does_not_count_are_a_remark(monkeypatch):
    monkeypatch.setattr(stream, "bytes_read", lambda: None)
    remarks = [f for f in measured("stream") if isinstance(f, str)]
    assert len(remarks) == 3
    assert all("the system does not count" in remark for remark in remarks)


def test_without_llvm_the_stack_bench_says_what_to_install(monkeypatch):
    monkeypatch.setattr(backend, "probe_backends", lambda: backend.BackendProbe(None, False))
    with pytest.raises(BadInput, match="install LLVM"):
        stack.set_up_scene(SMALL.sensor)


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


def test_image_to_spikes_has_the_staircase_of_a_hard_reset():
    for level in (0.3, 0.5, 0.6, 0.99):
        period = math.ceil(1.0 / (0.5 * level))
        spikes = public_encoders.image_to_spikes(np.full((2, 3), level), 20 * period)
        assert spikes.mean() == pytest.approx(1 / period)


def test_video_to_spikes_fires_at_grey_over_threshold_to_one_spike():
    video = np.random.default_rng(3).integers(0, 256, (60, 8, 9), dtype=np.uint8)
    spikes = public_encoders.video_to_spikes(video, np.random.default_rng(4), threshold=2.0)
    collected = np.minimum(video / 255 / 2.0, 1).sum(axis=0)
    assert np.abs(spikes.sum(axis=0) - collected).max() <= 1


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


@pytest.mark.slow
@needs_llvm
def test_growth_is_drawn_and_written(tmp_path, test_scenes, small_recipe):
    plan = growth.Plan(
        **{**vars(growth.SMALL), "sensor": SMALL.sensor, "recipe": str(small_recipe), "sequences": (1, 2)}
    )
    in_this_process = lambda function, *arguments: function(*arguments)  # noqa: E731
    growth.main(["--out", str(tmp_path)], plan=plan, call=in_this_process)
    found = json.loads((tmp_path / "growth.json").read_text())["curves"]
    assert list(found) == list(growth.CURVES)
    for curve in found.values():
        assert len(curve["size"]) == len(curve["seconds"]) == len(curve["peak_gib"]) >= 2
        assert min(curve["seconds"] + curve["peak_gib"]) > 0
        assert math.isfinite(curve["slope_seconds"])
    assert (tmp_path / "growth.png").stat().st_size > 10_000


@needs_llvm
@pytest.mark.slow
def test_the_thin_lens_error_falls_as_the_root_of_samples(tmp_path, test_scenes):
    """The exponent is -1/2 within 0.1, for 2,560 pixels at five positions, 4 to 16 samples, and one seed."""
    plan = error.Plan(sensor=SMALL.sensor, positions=5, samples=(4, 8, 16), reference=128, batch=16)
    error.main(["--out", str(tmp_path), "--scene", "plane"], plan=plan)
    found = json.loads((tmp_path / "error.json").read_text())
    assert found["slope_of_error"]["thin_lens"] == pytest.approx(-0.5, abs=0.1)
    for method in ("one_pass", "thin_lens"):
        assert all(a > b > 0 for a, b in zip(found[method]["error"], found[method]["error"][1:], strict=False))
        assert len(found[method]["psnr_db"]) == 3
    assert (tmp_path / "error.png").stat().st_size > 10_000


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


def test_the_slope_is_the_exponent():
    x = [1.0, 3.0, 10.0, 30.0]
    assert drawing.slope(x, [1.0, *(5 * n**1.5 for n in x[1:])]) == pytest.approx(1.5)


def test_every_chunk_shape_counts_the_same_spikes(tmp_path):
    camera = replace(get_sensor("vidar_400x250"), rows=90, columns=90)
    charge = synthetic.sweep_charge(camera, 5)
    spikes = np.concatenate(list(synthetic.encode_sweep(camera, charge, frames=2_080)), axis=2)
    box = (slice(3, 67), slice(20, 84), slice(13, 156))
    ones = np.unpackbits(spikes[box], axis=2)
    expected = ones.reshape(64, 64, -1, 8 * chunks.WINDOW).sum(axis=3).transpose(2, 0, 1)
    with ThreadPoolExecutor(2) as pool:
        for shape in ((10, 90, 250), (90, 90, 10), (1, 90, 260), (64, 64, 250), (16, 16, 33)):
            path = tmp_path / "trial.h5"
            chunk = tuple(min(c, n) for c, n in zip(shape, spikes.shape, strict=True))
            chunks.store(path, spikes, chunk=chunk, pool=pool)
            assert np.array_equal(chunks.counts(path, box, pool=pool), expected)
    found = chunks.measure(spikes, (10, 90, 250), folder=tmp_path)
    assert 0.1 < found["bits"] < 0.6
    assert min(found.values()) > 0
