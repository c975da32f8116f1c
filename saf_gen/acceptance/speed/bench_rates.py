"""The rates of this machine, under the names that `saf-gen plan --rates` reads.

Processor time is measured for figures that other work on the machine would change.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

from saf_gen.acceptance.speed.bench_figure import BenchFigure, BenchSize
from saf_gen.acceptance.speed.fresh_process import time_benched_call
from saf_gen.acceptance.speed.no_work import NoWork
from saf_gen.acceptance.speed.synthetic_recording import make_bench_charge, record_bench_sweep
from saf_gen.camera import get_sensor
from saf_gen.core.cores import usable_cores
from saf_gen.core.execution.executor import run_jobs
from saf_gen.core.execution.job import ReportProgress
from saf_gen.errors import BadInput
from saf_gen.generate.cost import MachineRates
from saf_gen.generate.jobs import RenderJob
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.shipped_recipes import find_recipe
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import TimeResolvedStack
from saf_gen.stream.stream_file import open_stream

SCENE = "usaf_target"
FEW, MANY = 4, 64
"""Samples per pixel of two stacks; the difference between their times is the time of the light paths alone."""
RECIPE, REPEATS, OPENINGS = "quickstart", 100, 100


def run_bench(size: BenchSize, report: ReportProgress) -> Iterator[BenchFigure | str]:
    """Yield the fields of MachineRates that can be measured here."""
    yield BenchFigure("rates", "cores", usable_cores(), "cores")
    with TemporaryDirectory() as temporary:
        yield from _measure_recording(size, Path(temporary), report=report)
        yield from _measure_rendering(size, Path(temporary), report=report)
        yield from _measure_scheduler(size, Path(temporary), report=report)


def _measure_recording(size: BenchSize, folder: Path, *, report: ReportProgress) -> Iterator[BenchFigure]:
    report("recording", 0.0)
    sensor, path = get_sensor(size.sensor), folder / "recording.h5"
    charge = make_bench_charge(sensor, 9)
    for frames in (min(size.frames, 1000), size.frames):  # the first compiles kernels
        processor, wall = process_time(), perf_counter()
        record_bench_sweep(path, sensor, charge=charge, frames=frames)
        with open_stream(path) as stream:
            stream.verify()
        processor, wall = process_time() - processor, perf_counter() - wall
    pixel_frames = size.frames * sensor.rows * sensor.columns
    yield BenchFigure("rates", "pixel_frames_per_s", pixel_frames / wall, "/s")
    yield BenchFigure("rates", "pixel_frames_per_core_s", pixel_frames / processor, "/s of a processor")
    report("recording", 1.0)


def _measure_rendering(size: BenchSize, folder: Path, *, report: ReportProgress) -> Iterator[BenchFigure | str]:
    """Yield the rates of rendering, or a remark if this machine has no fast renderer or is too busy."""
    report("rendering", 0.0)
    try:
        from saf_gen.render import backend
    except BadInput as error:
        yield f"rates of rendering are left out: {error.problem}"
        return
    if (chosen := backend.choose_backend("auto")) == "scalar":
        yield f"rates of rendering are left out: {backend.ADVICE}"
        return
    scene = find_scene(SCENE)
    spec = StackSpec.from_scene(
        scene,
        get_sensor(size.sensor),
        positions=size.positions[0],
        samples=FEW,
        max_depth=6,
        estimator="plain",
        time_s=0.0,
        wavelength_m=0.0,
    )
    seconds = []
    for samples in (FEW - 1, FEW, MANY):  # the first compiles kernels
        stack = TimeResolvedStack((0,), (replace(spec, samples=samples),))
        job = RenderJob("bench", scene, stack, folder / "stacks", chosen, measure_grain=False)
        seconds.append(time_benched_call(job.run, lambda name, done: None)[1])
    _, few, many = seconds
    if many <= few:
        yield "rates of rendering are left out: the machine was too busy to measure them"
        return
    pixels, groups, usual = spec.rows * spec.columns, len(spec.groups), MachineRates()
    rate = pixels * groups * (MANY - FEW) / (many - few)
    load = few / groups - pixels * (FEW / rate + spec.positions * usual.plane_s_per_pixel)
    yield BenchFigure("rates", "paths_per_s", rate, "/s")
    yield BenchFigure("rates", "load_s", max(load, 0.01), "s")
    report("rendering", 1.0)


def _measure_scheduler(size: BenchSize, folder: Path, *, report: ReportProgress) -> Iterator[BenchFigure]:
    report("scheduler", 0.0)
    processor, wall, done = process_time(), perf_counter(), 0
    for _, _, error in run_jobs([NoWork(i) for i in range(size.jobs)], workers=2, report=lambda name, part: None):
        done += error is None
    yield BenchFigure("rates", "job_s", (process_time() - processor) / size.jobs, "s of a processor")
    what = f"{done:,} of {size.jobs:,} jobs that do nothing, two workers"
    yield BenchFigure("rates", what, (perf_counter() - wall) / size.jobs, "s per job")
    report("scheduler", 0.5)
    data = read_recipe(find_recipe(RECIPE)).model_dump(mode="json")
    for split in data["splits"].values():
        split["repeats"] = REPEATS
    recipe = folder / "many.yaml"
    recipe.write_text(json.dumps(data))
    processor = process_time()
    drawing = len(resolve_recipe(recipe).sequences)
    drawn = (process_time() - processor) / drawing
    processor = process_time()
    for _ in range(OPENINGS):
        with open_stream(folder / "recording.h5") as stream:
            done += bool(stream.metadata.provenance)
    listed = (process_time() - processor) / OPENINGS
    yield BenchFigure("rates", "sequence_s", drawn + listed, "s of a processor")
    report("scheduler", 1.0)
