"""Ten methods on six recordings: the time from file to answer, also relative to the time of the measures alone."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from saf_gen.acceptance.speed import synthetic_recording
from saf_gen.acceptance.speed.bench_figure import BenchFigure, BenchSize, format_bench_shape
from saf_gen.acceptance.speed.fresh_process import time_benched_call
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import Record
from saf_gen.camera import get_sensor
from saf_gen.core.execution.job import ReportProgress
from saf_gen.errors import SafGenError

METHODS = (
    *(f"{measure}+argmax" for measure in ("sd", "sd_code", "gradient_code", "mfdct_code")),
    *(
        f"{measure}+{search}"
        for measure in ("sd_code", "gradient_code", "mfdct_code")
        for search in ("egs_code", "sgfs_code")
    ),
)
MAX_S = 30.0


def run_bench(size: BenchSize, report: ReportProgress) -> Iterator[BenchFigure | str]:
    """Yield the time of all methods on recordings under three lights, with the whole frame as region."""
    sensor = get_sensor(size.sensor)
    charge = synthetic_recording.make_bench_charge(sensor, size.positions[0])
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{number}.h5" for number in range(size.sequences)]
        for number, path in enumerate(paths):
            report("sequences to score", number / len(paths))
            light = synthetic_recording.LIGHT_KINDS[number % len(synthetic_recording.LIGHT_KINDS)]
            synthetic_recording.record_bench_sweep(
                path, sensor, charge=charge, frames=size.frames, light=light, number=number
            )
        report("sequences to score", 1.0)
        evaluate(paths[0], methods=METHODS, region="frame")  # compiles
        records: list[Record] = []
        total = 0.0
        for number, path in enumerate(paths):
            report(f"{len(METHODS)} methods", number / len(paths))
            result, seconds = time_benched_call(evaluate, path, methods=METHODS, region="frame")
            records += result.records
            total += seconds
        report(f"{len(METHODS)} methods", 1.0)
    for record in records:
        if record.status == "failed":
            raise SafGenError(f"{record.method} failed on {record.sequence}: {record.note}")
    shape = format_bench_shape((sensor.rows, sensor.columns))
    what = f"{len(METHODS)} methods, {len(paths)} sequences of {size.frames:,} frames, {shape}"
    yield BenchFigure("score", what, total, "s", MAX_S, at_most=True)
    measures = sum(record.seconds for record in records)
    yield BenchFigure("score", "of which in the measures", measures, "s")
    what = "time of the methods, relative to their measures, reading and counting included"
    yield BenchFigure("score", what, total / measures, "×")
