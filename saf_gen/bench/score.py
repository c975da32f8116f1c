"""Ten methods on six recordings: the time from file to answer, and what it is above the measures' own."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from saf_gen.bench import workload
from saf_gen.bench.child import timed
from saf_gen.bench.figure import Figure, Size, array
from saf_gen.camera import get_sensor
from saf_gen.cluster import Tell
from saf_gen.errors import SafGenError
from saf_gen.evaluate import evaluate
from saf_gen.records import Record

__all__ = ["METHODS", "measure"]

METHODS = (
    *(f"{measure}+argmax" for measure in ("sd", "sd_code", "gradient_code", "mfdct_code")),
    *(
        f"{measure}+{search}"
        for measure in ("sd_code", "gradient_code", "mfdct_code")
        for search in ("egs_code", "sgfs_code")
    ),
)
MOST_S = 30.0


def measure(size: Size, tell: Tell) -> Iterator[Figure | str]:
    """Record sequences under three lights in turn, then run every method on each, over the whole frame."""
    sensor = get_sensor(size.sensor)
    charge = workload.charge(sensor, size.positions[0])
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{number}.h5" for number in range(size.sequences)]
        for number, path in enumerate(paths):
            tell("sequences to score", number / len(paths))
            light = workload.LIGHTS[number % len(workload.LIGHTS)]
            workload.record(path, sensor, charge, size.frames, light=light, number=number)
        tell("sequences to score", 1.0)
        evaluate(paths[0], methods=METHODS, region="frame")  # compiles
        records: list[Record] = []
        took = 0.0
        for number, path in enumerate(paths):
            tell(f"{len(METHODS)} methods", number / len(paths))
            found, this = timed(evaluate, path, methods=METHODS, region="frame")
            records += found.records
            took += this
        tell(f"{len(METHODS)} methods", 1.0)
    for record in records:
        if record.status == "failed":
            raise SafGenError(f"{record.method} failed on {record.sequence}: {record.note}")
    shape = array((sensor.rows, sensor.columns))
    what = f"{len(METHODS)} methods, {len(paths)} sequences of {size.frames:,} frames, {shape}"
    yield Figure("score", what, took, "s", MOST_S, at_most=True)
    measures = sum(record.seconds for record in records)
    yield Figure("score", "of which in the measures", measures, "s")
    what = "cost of a method over its measure's, reading and counting included"
    yield Figure("score", what, took / measures, "×")
