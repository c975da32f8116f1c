"""The benches run and yield every figure that was promised; how fast they are is not tested."""

import importlib
import json
import math
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from capture_dataset import write_moving_plane
from small_dataset import HERE

from saf_gen import speed
from saf_gen.camera import get_sensor
from saf_gen.cli import main
from saf_gen.errors import BadInput, SafGenError
from saf_gen.render import backend
from saf_gen.speed import (
    BENCHES,
    BenchFigure,
    BenchResults,
    BenchSize,
    bench_encode,
    bench_job,
    bench_stack,
    bench_stream,
    fresh_process,
    run_benches,
    synthetic_recording,
)

BENCHMARKS = HERE.parent / "benchmarks"
SMALL = BenchSize(
    sensor=str(HERE / "small_sensor.yaml"),
    frames=400,
    positions=(5, 9),
    samples=16,
    reference=128,
    public_frames=4,
    sequences=2,
)
# Part of a figure's text, with its target.
PROMISED = {
    "stack": {
        "one pass, 5 positions, 64×40, 16 samples": None,
        "times faster than 5 thin-lens": 45.0,
        "times faster than 9 thin-lens": 150.0,
        "light paths": None,
        "over the thin lens's at equal samples": 0.2,
    },
    "encode": {
        "64×40, 400 frames, all noise on": 2.5,
        "camera of 40 kHz": 1.0,
        "times faster, all noise on, than SpikeCV's image": None,
        "times faster, all noise on, than SpikeCV's video": None,
        "times faster, all noise on, than SCSim's simulator as published": None,
        "time per frame of 4,000 frames over that of 400": 1.1,
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
        "worst slice: rms": 4.0,
        "worst slice away from focus": 5.0,
        "worst still": 1.0,
    },
    "score": {"10 methods, 2 sequences of 400 frames": 30.0, "cost of a method over its measure's": None},
    "job": {
        "recipe to leaderboard": 120.0,
        "under a new light, stacks there, 1 recorded": None,
        "pieces of stacks rendered for them": 0.0,
    },
}
needs_llvm = pytest.mark.skipif(
    not backend.probe_render_backends().llvm_usable, reason=backend.probe_render_backends().llvm_description
)


def measured(name, size=SMALL):
    """Return what a bench yields, run in this process, and the stages that it reported."""
    stages = []
    found = list(
        importlib.import_module(f"saf_gen.speed.bench_{name}").run_bench(size, lambda *told: stages.append(told))
    )
    return found, stages


def promises_kept(name, figures):
    for figure in figures:
        assert figure.bench == name
        assert math.isfinite(figure.value)
        assert figure.value > 0 or figure.unit in ("dB", "%", "pieces"), figure
        assert figure.unit
    for words, target in PROMISED[name].items():
        assert [f.target for f in figures if words in f.what][:1] == [target], words


@pytest.mark.parametrize("name", ["encode", "stream", "score", pytest.param("stack", marks=needs_llvm)])
@pytest.mark.slow
def test_a_bench_gives_every_figure_promised(name):
    found, stages = measured(name)
    promises_kept(name, [f for f in found if isinstance(f, BenchFigure)])
    assert [f for f in found if isinstance(f, str)] == []
    assert {done for _, done in stages} >= {0.0, 1.0}


@pytest.mark.slow
@needs_llvm
def test_the_grain_of_a_moving_scene_is_measured_at_rest_and_in_slices(tmp_path, monkeypatch):
    """Slices of 16 samples have more grain than stills of 64, by a factor of 2 where noise is plain.

    Shared shading has less than that: nine moments tell a slice's."""
    write_moving_plane(tmp_path, monkeypatch)
    found, stages = measured("grain", replace(SMALL, positions=(9, 17), samples=64, scenes=("plane",)))
    promises_kept("grain", found)
    values = {f.what: f.value for f in found}
    for place in ("best focus", "a quarter away", "position 0", "position 1"):
        ratio = values[f"plane, slice, {place}: rms over mean"] / values[f"plane, still, {place}: rms over mean"]
        assert 1.1 < ratio < 3
    worst = max(f.value for f in found if "slice, " in f.what and f.what.endswith("rms over mean"))
    assert next(f.value for f in found if f.what.startswith("worst slice: rms")) == worst
    assert all(f.low <= f.value <= f.high for f in found if f.low is not None)
    assert {stage for stage, _ in stages} == {"plane, at rest", "plane, time slices", "plane, later slices"}


@needs_llvm
def test_a_scene_whose_grain_cannot_be_measured_is_named(tmp_path, monkeypatch):
    folder = write_moving_plane(tmp_path, monkeypatch)
    (folder / "scene.py").write_text("def build(params):\n    return {}\n")
    (remark,) = measured("grain", replace(SMALL, scenes=("plane",)))[0]
    assert remark.startswith("grain: plane is left out: ")


def test_the_grain_of_an_unknown_scene_is_refused(call):
    code, _, err = call("bench", "grain", "--scene", "camell")
    assert code == 2
    assert "did you mean 'camel'" in err


@pytest.mark.slow
def test_the_whole_job_renders_nothing_for_another_light(test_scenes, small_recipe):
    found, stages = measured("job", BenchSize(recipe=str(small_recipe)))
    promises_kept("job", found)
    assert [f.value for f in found if f.unit == "pieces"] == [0]
    assert any("record" in stage for stage, _ in stages)


@pytest.mark.slow
def test_benches_run_in_processes_of_their_own_and_one_that_fails_leaves_the_others():
    held = np.ones(1 << 29, np.uint8)
    stages = []
    missing = BenchSize(**{**vars(SMALL), "recipe": "missing.yaml"})
    results = run_benches(["stream", "job"], missing, report=lambda stage, done: stages.append(stage))
    peak = results.figures[-1]
    assert peak.what == "peak memory of a process"
    assert peak.target == 2.0
    assert 0 < peak.value < held.nbytes / 2**30, "the child's memory is its own, not its parent's"
    assert fresh_process.peak_memory_gib() > 0.5
    assert stages[0].startswith("stream: ")
    assert isinstance(results.failed["job"], BadInput)
    assert "missing.yaml does not exist" in str(results.failed["job"])


def test_an_unknown_bench_is_told_with_the_nearest():
    with pytest.raises(BadInput, match=r"unknown bench 'steam'; allowed: encode, .*; did you mean 'stream'\?"):
        run_benches(["encode", "steam"], SMALL)


def test_every_bench_has_a_module_of_its_own():
    files = {p.stem for p in Path(speed.__file__).parent.glob("*.py")}
    assert set(BENCHES) == set(PROMISED)
    assert {f"bench_{name}" for name in BENCHES} <= files


def test_a_target_is_met_on_its_own_side():
    assert BenchFigure("b", "speed", 3.0, "x/s", 2.5).met is True
    assert BenchFigure("b", "speed", 2.0, "x/s", 2.5).met is False
    assert BenchFigure("b", "time", 0.4, "s", 0.5, at_most=True).met is True
    assert BenchFigure("b", "size", 0.4, "bit").met is None


def test_what_cannot_be_measured_here_is_left_out_and_said(monkeypatch):
    monkeypatch.setattr(bench_encode.saf_gen, "__file__", "/nowhere/saf_gen/__init__.py")
    monkeypatch.setattr(bench_job, "PAPER_RECIPE", Path("/nowhere/recipes/sad_core.yaml"))
    monkeypatch.setattr(bench_stream, "bytes_read", lambda: None)
    assert bench_encode.load_public_encoders() is None
    remarks = [f for f in measured("stream")[0] if isinstance(f, str)]
    assert len(remarks) == 3
    assert all("the system does not count" in remark for remark in remarks)
    assert measured("job")[0] == ["job: left out: recipes/ is not beside the package"]
    monkeypatch.setattr(bench_encode, "_bench_memory", lambda size, report: iter(()))
    remarks = [f for f in measured("encode")[0] if isinstance(f, str)]
    assert remarks == ["encode: the public encoders are left out: benchmarks/ is not beside the package"]


def test_without_llvm_the_stack_bench_says_what_to_install(monkeypatch):
    monkeypatch.setattr(backend, "probe_render_backends", lambda: backend.BackendProbe(None, False))
    with pytest.raises(BadInput, match="install LLVM"):
        bench_stack.set_up_timed_scene(SMALL.sensor)


RESULTS = BenchResults(
    (
        BenchFigure("stream", "size", 0.25, "bit", 0.32, at_most=True),
        BenchFigure("stream", "read", 3.0, "s", low=2.0, high=math.inf),
    ),
    ("stream: a thing is left out",),
    {},
)


def command(capsys, monkeypatch, results, *arguments):
    monkeypatch.setattr(speed, "run_benches", lambda names, size, report: results)
    with pytest.raises(SystemExit) as ended:
        main(["bench", *arguments])
    return ended.value.code, *capsys.readouterr()


def test_json_holds_one_object_a_figure(capsys, monkeypatch):
    code, out, err = command(capsys, monkeypatch, RESULTS, "--json")
    assert code == 0
    keys = ["bench", "what", "value", "unit", "target", "at_most", "low", "high", "met"]
    assert [list(figure) for figure in json.loads(out)] == [keys, keys]
    assert [figure["met"] for figure in json.loads(out)] == [True, None]
    assert [figure["high"] for figure in json.loads(out)] == [None, None], "JSON has no infinity"
    assert "a thing is left out" in err


def test_the_table_has_the_target_beside_the_figure(capsys, monkeypatch):
    _, out, _ = command(capsys, monkeypatch, RESULTS)
    (line,) = [line for line in out.splitlines() if "size" in line]
    cells = [cell.strip() for cell in line.split("│")[1:-1]]
    assert cells == ["stream", "size", "0.25", "bit", "≤ 0.32", "yes"]
    assert "3 (2 to inf)" in out


def test_a_failed_bench_is_named_after_the_figures_of_the_others(capsys, monkeypatch):
    failed = BenchResults(RESULTS.figures, (), {"job": SafGenError("it broke")})
    code, out, err = command(capsys, monkeypatch, failed)
    assert code == 1
    assert "size" in out
    assert "bench job failed: it broke" in err
    code, _, err = command(capsys, monkeypatch, BenchResults((), (), {"stack": BadInput("no LLVM")}), "stack")
    assert code == 2


# The public encoders are what their sources say: they have the rates of their own laws.


@pytest.fixture(scope="module")
def public():
    return bench_encode.load_public_encoders()


def test_every_public_encoder_gives_a_spike_or_none_at_our_rate(public):
    grey = np.full((3, 40, 50), 51, np.uint8)
    for encoder in public.ENCODERS:
        spikes = encoder.run(grey, np.random.default_rng(1))
        assert spikes.shape == grey.shape
        assert set(np.unique(spikes)) <= {0, 1}
    many = np.broadcast_to(grey[:1], (500, 40, 50))
    for encoder in public.ENCODERS[:3]:
        rate = encoder.run(many, np.random.default_rng(2)).mean()
        # 2,000 pixels of 500 readouts; SCSim's pixels differ by 8 % rms, 0.2 % on their mean.
        assert rate == pytest.approx(0.2, rel=0.05), encoder.name


def test_image_to_spikes_has_the_staircase_of_a_hard_reset(public):
    for level in (0.3, 0.5, 0.6, 0.99):
        period = math.ceil(1.0 / (0.5 * level))
        spikes = public.image_to_spikes(np.full((2, 3), level), 20 * period)
        assert spikes.mean() == pytest.approx(1 / period)


def test_video_to_spikes_fires_at_grey_over_threshold_to_one_spike(public):
    video = np.random.default_rng(3).integers(0, 256, (60, 8, 9), dtype=np.uint8)
    spikes = public.video_to_spikes(video, np.random.default_rng(4), threshold=2.0)
    collected = np.minimum(video / 255 / 2.0, 1).sum(axis=0)
    assert np.abs(spikes.sum(axis=0) - collected).max() <= 1


def test_the_simulator_in_pictures_is_the_one_pixel_by_pixel(public):
    """Without noise bit for bit; with it in rate: 8,000 pixel·frames each, one seed, within 5 sd."""
    video = np.random.default_rng(5).integers(20, 200, (40, 10, 20), dtype=np.uint8)

    ways = (public.simulate, public.simulate_pixel_by_pixel)
    pictures, pixels = (way(video, np.random.default_rng(6)) for way in ways)
    # Counts of a pixel scatter by less than one; the two devices' means by 8 %/sqrt(200) each.
    sd = math.sqrt(2 * (0.08**2 * 200 * pixels.sum(axis=0).mean() ** 2 + 200)) / 200
    assert abs(pictures.sum(axis=0).mean() - pixels.sum(axis=0).mean()) < 5 * sd
    pictures, pixels = (way(video, Quiet()) for way in ways)
    assert np.array_equal(pictures, pixels)
    assert 0.1 < pictures.mean() < 0.9


class Quiet:
    """A generator without noise: every draw is its mean, phases rise over the pixels."""

    def random(self, shape):
        return np.linspace(0, 4, math.prod(shape)).reshape(shape)

    def normal(self, mean, sd, shape=None):
        return mean if shape is None else np.full(shape, mean)

    def poisson(self, mean):
        return mean


# The scripts of benchmarks/ run, small, and write what the README shows.


@pytest.fixture
def script(monkeypatch):
    """Imports a script of benchmarks/ as `python benchmarks/NAME.py` would."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    yield lambda name: importlib.import_module(name)
    for name in ("growth", "error", "drawing", "chunks"):
        sys.modules.pop(name, None)


@pytest.mark.slow
@needs_llvm
def test_growth_is_drawn_and_written(script, tmp_path, test_scenes, small_recipe):
    growth = script("growth")
    plan = growth.Plan(
        **{**vars(growth.SMALL), "sensor": SMALL.sensor, "recipe": str(small_recipe), "sequences": (1, 2)}
    )
    told = lambda function, *given: function(*given, report=lambda stage, done: None)  # noqa: E731  (in this process)
    growth.main(["--out", str(tmp_path)], plan=plan, call=told)
    found = json.loads((tmp_path / "growth.json").read_text())["curves"]
    assert list(found) == list(growth.CURVES)
    for curve in found.values():
        assert len(curve["size"]) == len(curve["seconds"]) == len(curve["peak_gib"]) >= 2
        assert min(curve["seconds"] + curve["peak_gib"]) > 0
        assert math.isfinite(curve["slope_seconds"])
    assert (tmp_path / "growth.png").stat().st_size > 10_000


@needs_llvm
def test_the_thin_lens_error_falls_as_the_root_of_samples(script, tmp_path, test_scenes):
    """Over 2,560 pixels at five positions, 4 to 16 samples, one seed: the exponent is -1/2 within 0.1."""
    error = script("error")
    plan = error.Plan(sensor=SMALL.sensor, positions=5, samples=(4, 8, 16), reference=128, batch=16)
    error.main(["--out", str(tmp_path), "--scene", "plane"], plan=plan)
    found = json.loads((tmp_path / "error.json").read_text())
    assert found["slope_of_error"]["thin_lens"] == pytest.approx(-0.5, abs=0.1)
    for way in ("one_pass", "thin_lens"):
        assert all(a > b > 0 for a, b in zip(found[way]["error"], found[way]["error"][1:], strict=False))
        assert len(found[way]["psnr_db"]) == 3
    assert (tmp_path / "error.png").stat().st_size > 10_000


def test_the_slope_is_the_exponent(script):
    x = [1.0, 3.0, 10.0, 30.0]
    assert script("drawing").slope(x, [1.0, *(5 * n**1.5 for n in x[1:])]) == pytest.approx(1.5)


def test_every_chunk_shape_counts_the_same_spikes(script, tmp_path):
    chunks = script("chunks")
    camera = replace(get_sensor("vidar_400x250"), rows=90, columns=90)
    charge = synthetic_recording.make_bench_charge(camera, 5)
    spikes = np.concatenate(list(synthetic_recording.encode_bench_blocks(camera, charge, frames=2_080)), axis=2)
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
