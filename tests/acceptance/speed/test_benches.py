"""The benches run and yield every documented figure; their speed is not tested."""

import importlib
import json
import math
import re
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from capture_dataset import write_moving_plane
from small_dataset import HERE
from written_scenes import needs_llvm

from saf_gen.acceptance import speed
from saf_gen.acceptance.speed import (
    BENCHES,
    BenchFigure,
    BenchResults,
    BenchSize,
    SceneResult,
    bench_encode,
    bench_grain,
    bench_rates,
    bench_stack,
    bench_stream,
    fresh_process,
    grain_by_scene,
    run_benches,
    synthetic_recording,
)
from saf_gen.authoring import scene_grain
from saf_gen.benchmark.records import read_records
from saf_gen.camera import get_sensor
from saf_gen.cli import main
from saf_gen.cli._terminal import out
from saf_gen.errors import BadInput, SafGenError
from saf_gen.generate.cost import read_rates_for_plan
from saf_gen.render import backend

PLACES = ("best focus", "a quarter away", "position 0", "position 1")
BENCHMARKS = HERE.parent / "benchmarks"
SMALL = BenchSize(
    sensor=str(HERE / "small_sensor.yaml"),
    frames=400,
    positions=(5, 9),
    samples=16,
    reference=32,
    public_frames=4,
    sequences=2,
    reads=500,
    jobs=20,
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
    "rates": {"pixel_frames_per_s": None, "pixel_frames_per_core_s": None, "job_s": None, "sequence_s": None},
    "score": {"10 methods, 2 sequences of 400 frames": 30.0, "time of the methods, relative to their measures": None},
    "job": {
        "recipe to leaderboard": 120.0,
        "under a new light, stacks there, 1 recorded": None,
        "pieces of stacks rendered for them": 0.0,
    },
}


def measured(name, size=SMALL):
    """Run a bench in this process; return what it yields and the stages that it reported."""
    stages = []
    bench = importlib.import_module(f"saf_gen.acceptance.speed.bench_{name}")
    return list(bench.run_bench(size, lambda *reported: stages.append(reported))), stages


def assert_promised(name, figures):
    for figure in figures:
        assert figure.bench == name
        assert math.isfinite(figure.value)
        assert figure.value > 0 or figure.unit in ("dB", "%", "pieces"), figure
        assert figure.unit
    for words, target in PROMISED[name].items():
        assert [f.target for f in figures if words in f.what][:1] == [target], words


@pytest.mark.parametrize("name", ["encode", "stream", "windows", "score", pytest.param("stack", marks=needs_llvm)])
@pytest.mark.slow
def test_a_bench_gives_every_figure_promised(name):
    found, stages = measured(name)
    assert_promised(name, [f for f in found if isinstance(f, BenchFigure)])
    assert [f for f in found if isinstance(f, str)] == []
    assert {done for _, done in stages} >= {0.0, 1.0}


@pytest.mark.slow
def test_a_plan_reads_the_rates_that_the_bench_measures(tmp_path, monkeypatch):
    """Rendering is so short that the load of the machine may hide its rate; a remark then replaces the figures."""
    monkeypatch.setattr(bench_rates, "REPEATS", 5)
    found, stages = measured("rates")
    figures = [f for f in found if isinstance(f, BenchFigure)]
    assert {"recording", "rendering", "scheduler"} == {stage for stage, _ in stages}
    assert_promised("rates", figures)
    assert any(f.what == "20 of 20 jobs that do nothing, two workers" for f in figures)
    names = {f.what for f in figures}
    assert {"cores", "pixel_frames_per_s", "pixel_frames_per_core_s", "job_s", "sequence_s"} <= names
    assert ("paths_per_s" in names) is ("load_s" in names) is (len(figures) == len(found))
    path = tmp_path / "rates.json"
    path.write_text(json.dumps([asdict(figure) for figure in figures]))
    rates = read_rates_for_plan(path)
    assert {f.what: f.value for f in figures if hasattr(rates, f.what)}.items() <= asdict(rates).items()


@pytest.mark.slow
@needs_llvm
def test_the_grain_of_a_moving_scene_is_measured_at_rest_and_in_slices(tmp_path, monkeypatch):
    """Slices of 16 samples have more grain than stills of 64, by a factor of 2 for independent samples.

    With shared shading the factor is smaller, because the shading of a slice is estimated from paths of nine slices.
    """
    write_moving_plane(tmp_path, monkeypatch)
    sensor = tmp_path / "smaller.yaml"
    sensor.write_text(Path(SMALL.sensor).read_text().replace("rows: 40\ncolumns: 64", "rows: 20\ncolumns: 32"))
    found, stages = measured("grain", replace(SMALL, sensor=str(sensor), positions=(9, 17), scenes=("plane",)))
    assert_promised("grain", found)
    values = {f.what: f.value for f in found}
    for place in PLACES:
        ratio = values[f"plane, slice, {place}: rms over mean"] / values[f"plane, still, {place}: rms over mean"]
        assert 1.1 < ratio < 3
    worst = {f.what.partition(" (")[0]: f for f in bench_grain.find_worst_benched_grain(found)}
    assert {what: f.target for what, f in worst.items()} == {
        "worst slice: rms over mean": 4.0,
        "worst slice away from focus: noise over signal in C²": 5.0,
        "worst still: noise over signal in C²": 1.0,
    }
    rms = [f.value for f in found if "slice, " in f.what and f.what.endswith("rms over mean")]
    assert worst["worst slice: rms over mean"].value == max(rms)
    cells = [f.cell for f in found if f.cell is not None]
    assert len(set(cells)) == len(cells) == 2 * 4 * 6, "still and slice, four places, six figures"
    assert all(f.low <= f.value <= f.high for f in found if f.low is not None)
    assert {stage for stage, _ in stages} == {"plane, at rest", "plane, time slices", "plane, later slices"}


@needs_llvm
def test_a_scene_whose_grain_cannot_be_measured_is_named(tmp_path, monkeypatch):
    folder = write_moving_plane(tmp_path, monkeypatch)
    (folder / "scene.py").write_text("def build(params):\n    return {}\n")
    (remark,) = measured("grain", replace(SMALL, scenes=("plane",)))[0]
    assert remark.startswith("grain: plane is left out: ")


def test_grain_is_measured_with_the_samples_of_the_projects_recipes():
    renders = [yaml.safe_load(path.read_text())["render"] for path in (HERE.parent / "recipes").glob("sa[df]_*.yaml")]
    assert {r["samples"] for r in renders} == {BenchSize().still_samples} == {scene_grain.STILL_SAMPLES}
    slices = {r["slice_samples"] for r in renders if "slice_samples" in r}
    assert slices == {BenchSize().slice_samples} == {scene_grain.SLICE_SAMPLES}


@pytest.fixture
def three_scenes(tmp_path, monkeypatch):
    """The folder of scenes a, b and c, of which c moves."""
    for name in "abc":
        shutil.copytree(HERE / "scenes/plane", tmp_path / "scenes" / name)
        card = tmp_path / "scenes" / name / "scene.yaml"
        card.write_text(card.read_text().replace("id: plane", f"id: {name}"))
    with card.open("a") as last:
        last.write("motion: {plane: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: [0, 0, 0.01]}]}}\n")
        last.write("slices_per_s: 100\n")
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path / "scenes"))
    return tmp_path / "scenes"


ONE, THREE = replace(SMALL, scenes=("a",)), replace(SMALL, scenes=("a", "b", "c"))


def bench_scenes(size, measure, folder=None):
    return list(grain_by_scene.bench_each_scene(size, measure=measure, folder=folder))


def measure_with(log, *, fails=()):
    """Return a bench of one scene that logs the scene's name, and fails for scenes in ``fails``."""

    def measure(size):
        (name,) = size.scenes
        log.append(name)
        if name in fails:
            raise SafGenError("its process died")
        return [BenchFigure("grain", f"{name}: rms", math.inf, "%", 4.0, low=1.0, cell=("still", "rms")), "a remark"]

    return measure


def test_a_stopped_bench_of_grain_goes_on_with_the_scenes_that_are_left(three_scenes, tmp_path):
    """Scene b has failed and is tried again; the figures of a and c are kept."""
    log, folder = [], tmp_path / "kept"
    stopped = grain_by_scene.bench_each_scene(THREE, measure=measure_with(log, fails="b"), folder=folder)
    first = [next(stopped), next(stopped)]  # killed here
    assert first[1].found == ("grain: b is left out: its process died",)
    again = bench_scenes(THREE, measure_with(log), folder)
    assert log == ["a", "b", "b", "c"]
    assert again[0].found == first[0].found
    assert [(scene.scene, scene.number, scene.count) for scene in again] == [("a", 1, 3), ("b", 2, 3), ("c", 3, 3)]
    assert bench_scenes(THREE, measure_with(log), folder)[2] == again[2]
    assert len(log) == 4


def test_a_scene_that_was_left_out_is_not_kept(three_scenes, tmp_path):
    """LLVM may be installed by the next run. The peak memory of the process is measured nevertheless."""
    log = []

    def measure(size):
        log.append(size.scenes)
        return ["grain: a is left out: no LLVM", BenchFigure("grain", "peak memory of a process", 0.5, "GiB", 2.0)]

    for _ in range(2):
        bench_scenes(ONE, measure, tmp_path / "kept")
    assert len(log) == 2


def test_grain_of_a_scene_that_is_edited_during_the_bench_is_not_kept(three_scenes, tmp_path):
    log, folder = [], tmp_path / "kept"

    def measure(size):
        script = three_scenes / "a/scene.py"
        script.write_text(script.read_text() + "# another\n")
        return measure_with(log)(size)

    bench_scenes(ONE, measure, folder)
    bench_scenes(ONE, measure_with(log), folder)
    assert log == ["a", "a"]


@pytest.mark.parametrize("what", ["samples", "scene", "card", "code", "damaged"])
def test_grain_of_another_workload_scene_or_code_is_measured_again(three_scenes, tmp_path, monkeypatch, what):
    log, size, folder = [], ONE, tmp_path / "kept"
    bench_scenes(size, measure_with(log), folder)
    if what == "samples":
        size = replace(size, still_samples=128)
    elif what == "scene":
        script = three_scenes / "a/scene.py"
        script.write_text(script.read_text() + "# another\n")
    elif what == "card":
        with (three_scenes / "a/scene.yaml").open("a") as card:
            card.write("still_s: 0.25\n")
    elif what == "code":
        (tmp_path / "package").mkdir()
        (tmp_path / "package/__init__.py").write_text("")
        monkeypatch.setattr(grain_by_scene.saf_gen, "__file__", str(tmp_path / "package/__init__.py"))
    else:
        (folder / "a.json").write_text('{"of"')
    bench_scenes(size, measure_with(log), folder)
    assert log == ["a", "a"]


def test_the_time_left_is_estimated_from_the_time_taken(three_scenes, tmp_path, monkeypatch):
    """A moving scene counts as four still ones; scenes that were kept take no time."""
    clock = iter([0.0, 10.0, 20.0, 60.0])
    monkeypatch.setattr(grain_by_scene, "perf_counter", lambda: next(clock))
    assert [s.seconds_left for s in bench_scenes(THREE, measure_with([]), tmp_path)] == [50.0, 40.0, 0.0]
    (tmp_path / "b.json").unlink()
    clock = iter([0.0, 10.0, 20.0])
    assert [s.seconds_left for s in bench_scenes(THREE, measure_with([]), tmp_path)] == [None, 0.0, 0.0]


def test_a_broken_scene_is_left_out_of_all_and_refused_by_name(three_scenes, monkeypatch):
    (three_scenes / "a/scene.yaml").write_text("id: a\n")
    monkeypatch.setattr(grain_by_scene, "scene_names", lambda: ["a", "b"])
    log = []
    found = bench_scenes(replace(THREE, scenes=()), measure_with(log))
    assert [scene.scene for scene in found] == log == ["a", "b"]
    with pytest.raises(BadInput, match="a/scene.yaml"):
        bench_scenes(THREE, measure_with(log))


def test_a_folder_that_cannot_be_written_is_refused_before_grain_is_measured(three_scenes, tmp_path):
    (tmp_path / "file").write_text("")
    log = []
    with pytest.raises(BadInput, match="file/kept cannot be written"):
        bench_scenes(THREE, measure_with(log), tmp_path / "file/kept")
    assert log == []


def test_the_grain_of_a_scene_is_printed_as_soon_as_it_is_measured_in_eighty_columns(capsys, monkeypatch):
    """The table goes to stdout and the time left to stderr; the figures are not printed again at the end."""
    monkeypatch.setattr(out, "_force_terminal", True)
    monkeypatch.setattr(out, "_width", 80)
    rows, columns = (
        [f"{p}, {at}" for p in ("still", "slice") for at in PLACES],
        ("rms", "on target", *bench_grain.COLUMNS.values()),
    )
    values = [0.00123, 12.345, 1234.5, 99_999.0, 123_456.0, math.nan]
    ends = [(0.0, 0.002), (11.1, 12.3), (1100.0, math.inf), (99_000.0, 1e5), (0.0, math.inf), (math.nan, math.nan)]
    table = [
        BenchFigure("grain", f"fan, {row}: {column}", value, "%", 4.0, True, low, high, (row, column))
        for row in rows
        for column, value, (low, high) in zip(columns, values, ends, strict=True)
    ]
    table.append(BenchFigure("grain", "fan, slice: correlation", 12.0, "%", low=3.0, high=20.0))
    worst = BenchFigure(
        "grain", "worst slice away from focus: noise over signal in C² " * 2, 12.345, "%", 4.0, at_most=True
    )

    def run_benches(names, size, *, show, **options):
        show(SceneResult("fan", tuple(table), 1, 2, 600.0))
        shown.append(capsys.readouterr())
        show(SceneResult("odd", ("grain: odd is left out",), 2, 2, 0.0))
        return BenchResults((*table, worst), ("grain: odd is left out",), {})

    shown = []
    monkeypatch.setattr(speed, "run_benches", run_benches)
    with pytest.raises(SystemExit):
        main(["bench", "grain"])
    (first, err), (last, remarks) = shown[0], capsys.readouterr()
    assert "grain: fan is done, 1 of 2, about 10 min left" in err
    assert max(map(len, (first + last).splitlines())) <= 80
    for figure in ("<0.01", "! 12.3", "11.1–12.3", "! 1234", "≥ 1100", ">1e5", "unknown", "12 (3 to 20) %"):
        assert figure in first
    assert "! marks figures above their target: 4 % in" in first
    assert "<0.01–<0.01" not in first
    assert "…" not in first + last
    assert "worst slice" in last
    assert "correlation" not in last
    assert "odd is left out" in remarks


@pytest.mark.parametrize("option", [("--scene", "camel"), ("--out", "kept")])
def test_options_of_the_bench_of_grain_are_refused_with_others(call, option):
    code, _, err = call("bench", "encode", "score", *option)
    assert code == 2
    assert f"{option[0]} is for the bench grain, which is not among encode, score" in err


def test_the_grain_of_an_unknown_scene_is_refused(call):
    code, _, err = call("bench", "grain", "--scene", "camell")
    assert code == 2
    assert "did you mean 'camel'" in err


@pytest.mark.slow
def test_the_bench_of_a_complete_job_renders_nothing_for_another_light(test_scenes, small_recipe):
    found, stages = measured("job", BenchSize(recipe=str(small_recipe)))
    assert_promised("job", found)
    assert [f.value for f in found if f.unit == "pieces"] == [0]
    assert any("record" in stage for stage, _ in stages)


@pytest.mark.slow
def test_benches_run_in_separate_processes_and_the_others_run_after_one_that_fails():
    held = np.ones(1 << 29, np.uint8)
    stages = []
    missing = BenchSize(**{**vars(SMALL), "recipe": "missing.yaml"})
    results = run_benches(["stream", "job"], missing, report=lambda stage, done: stages.append(stage))
    peak = results.figures[-1]
    assert peak.what == "peak memory of a process"
    assert peak.target == 2.0
    assert 0 < peak.value < held.nbytes / 2**30, "the memory of the child, not of its parent"
    assert fresh_process.peak_memory_of_bench_gib() > 0.5
    assert stages[0].startswith("stream: ")
    assert isinstance(results.failed["job"], BadInput)
    assert "missing.yaml does not exist" in str(results.failed["job"])


def test_an_unknown_bench_is_refused_with_the_nearest_name():
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


def test_a_figure_that_cannot_be_measured_is_replaced_by_a_remark(monkeypatch):
    monkeypatch.setattr(bench_encode.saf_gen, "__file__", "/nowhere/saf_gen/__init__.py")
    monkeypatch.setattr(bench_stream, "bytes_read_by_bench", lambda: None)
    assert bench_encode.load_encoders_to_bench() is None
    remarks = [f for f in measured("stream")[0] if isinstance(f, str)]
    assert len(remarks) == 3
    assert all("the system does not count" in remark for remark in remarks)
    monkeypatch.setattr(bench_encode, "_bench_memory", lambda size, report: iter(()))
    remarks = [f for f in measured("encode")[0] if isinstance(f, str)]
    assert remarks == ["encode: the public encoders are left out: benchmarks/ is not next to the package"]


def test_without_llvm_the_stack_bench_says_what_to_install(monkeypatch):
    monkeypatch.setattr(backend, "probe_backends", lambda: backend.BackendProbe(None, False))
    with pytest.raises(BadInput, match="install LLVM"):
        bench_stack.set_up_benched_scene(SMALL.sensor)


RESULTS = BenchResults(
    (
        BenchFigure("stream", "size", 0.25, "bit", 0.32, at_most=True),
        BenchFigure("stream", "read", 3.0, "s", low=2.0, high=math.inf),
    ),
    ("stream: a thing is left out",),
    {},
)


def command(capsys, monkeypatch, results, *arguments):
    monkeypatch.setattr(speed, "run_benches", lambda names, size, **options: results)
    with pytest.raises(SystemExit) as ended:
        main(["bench", *arguments])
    return ended.value.code, *capsys.readouterr()


def test_json_holds_one_object_a_figure(capsys, monkeypatch):
    code, out, err = command(capsys, monkeypatch, RESULTS, "--json")
    assert code == 0
    keys = ["bench", "what", "value", "unit", "target", "at_most", "low", "high", "cell", "met"]
    assert [list(figure) for figure in json.loads(out)] == [keys, keys]
    assert [figure["met"] for figure in json.loads(out)] == [True, None]
    assert [figure["high"] for figure in json.loads(out)] == [None, None], "JSON has no infinity"
    assert "a thing is left out" in err


def test_the_table_has_the_target_next_to_the_figure(capsys, monkeypatch):
    _, out, _ = command(capsys, monkeypatch, RESULTS)
    (line,) = [line for line in out.splitlines() if "size" in line]
    cells = re.split(r"\s{2,}", line.strip())
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


# Public encoders.


@pytest.fixture(scope="module")
def public():
    return bench_encode.load_encoders_to_bench()


def test_every_public_encoder_gives_a_spike_or_none_at_our_rate(public):
    grey = np.full((3, 40, 50), 51, np.uint8)
    for encoder in public.ENCODERS:
        spikes = encoder.run(grey, np.random.default_rng(1))
        assert spikes.shape == grey.shape
        assert set(np.unique(spikes)) <= {0, 1}
    many = np.broadcast_to(grey[:1], (500, 40, 50))
    for encoder in public.ENCODERS[:3]:
        rate = encoder.run(many, np.random.default_rng(2)).mean()
        # 2,000 pixels, 500 readouts; SCSim's pixels differ by 8 % rms, so their mean by 0.2 %.
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


def test_the_vectorised_simulator_equals_the_one_pixel_by_pixel(public):
    """Without noise bits agree; with noise rates agree within 5 sd, for 8,000 pixel·frames each and one seed."""
    video = np.random.default_rng(5).integers(20, 200, (40, 10, 20), dtype=np.uint8)
    simulators = (public.simulate, public.simulate_pixel_by_pixel)
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


# Scripts in benchmarks/, at small sizes.


@pytest.fixture
def script(monkeypatch):
    """A function that imports a script of benchmarks/ as `python benchmarks/NAME.py` would."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    yield lambda name: importlib.import_module(name)
    for name in ("growth", "error", "drawing", "chunks", "bias_maps", "noisy_sensor"):
        sys.modules.pop(name, None)


@pytest.mark.slow
@needs_llvm
def test_growth_is_drawn_and_written(script, tmp_path, test_scenes, small_recipe):
    growth = script("growth")
    plan = growth.Plan(
        **{**vars(growth.SMALL), "sensor": SMALL.sensor, "recipe": str(small_recipe), "sequences": (1, 2)}
    )
    in_this_process = lambda function, *arguments: function(*arguments, report=lambda stage, done: None)  # noqa: E731
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
def test_the_thin_lens_error_falls_as_the_root_of_samples(script, tmp_path, test_scenes):
    """The exponent is -1/2 within 0.1, for 2,560 pixels at five positions, 4 to 16 samples, and one seed."""
    error = script("error")
    plan = error.Plan(sensor=SMALL.sensor, positions=5, samples=(4, 8, 16), reference=128, batch=16)
    error.main(["--out", str(tmp_path), "--scene", "plane"], plan=plan)
    found = json.loads((tmp_path / "error.json").read_text())
    assert found["slope_of_error"]["thin_lens"] == pytest.approx(-0.5, abs=0.1)
    for method in ("one_pass", "thin_lens"):
        assert all(a > b > 0 for a, b in zip(found[method]["error"], found[method]["error"][1:], strict=False))
        assert len(found[method]["psnr_db"]) == 3
    assert (tmp_path / "error.png").stat().st_size > 10_000


def test_planted_bias_and_noise_are_separated(script):
    """Plain and filtered renders of 40,000 pixels have noise of 10 %, and a bias of 2 %, or 4 % in a tenth of them.

    The mean of half the renders has noise of 7 %, and a product of two differences 0.1²; the mean of both products
    has 0.0087. Over N pixels the standard error of the squared bias is 0.0087/√N, and that of the mean 0.1/√(2N).
    Bounds are five standard errors.
    """
    bias_maps = script("bias_maps")
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
def test_bias_maps_are_drawn_and_plain_renders_kept(script, tmp_path, test_scenes, monkeypatch):
    bias_maps = script("bias_maps")
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


@needs_llvm
@pytest.mark.slow
def test_two_sensors_are_compared_on_the_same_stacks(script, tmp_path, test_scenes, small_recipe, capsys):
    """With twenty times the threshold noise every stream differs; stacks are shared, and a second run reads records."""
    own = Path(__file__).parents[2] / "small_sensor.yaml"
    noisy = tmp_path / "noisy.yaml"
    noisy.write_text(own.read_text().replace("threshold_noise_rms: 0.0058", "threshold_noise_rms: 0.12"))
    (tmp_path / "methods.txt").write_text("sd+argmax\nbrenner+argmax\n")
    arguments = ["--out", str(tmp_path / "out"), "--recipe", str(small_recipe), "--sensor", str(own), str(noisy)]
    arguments += ["--methods", str(tmp_path / "methods.txt")]
    noisy_sensor = script("noisy_sensor")
    noisy_sensor.main(arguments)
    first = capsys.readouterr().out
    assert "| method | success, `small_sensor` | error | success, `noisy` | error |" in first
    assert "| `sd+argmax` | " in first
    assert "Of 6 answers " in first
    folder = tmp_path / "out" / "small"
    assert len(list((folder / "dataset" / "stacks").iterdir())) == 1
    a, b = (read_records(folder / f"{name}.jsonl") for name in ("small_sensor", "noisy"))
    assert {r.data for r in a}.isdisjoint({r.data for r in b})
    shutil.rmtree(folder / "dataset")
    noisy_sensor.main(arguments)
    assert capsys.readouterr().out == first
