"""Ten methods on six recordings: the time from file to answer, also relative to the time of the measures alone."""

import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import Record
from saf_gen.camera import get_sensor
from saf_gen.errors import SafGenError
from studies.speed import synthetic
from studies.speed.bench import Figure, Size, main, shape_text, timed

METHODS = (
    *(f"{measure}+argmax" for measure in ("sd", "sd_code", "gradient_code", "mfdct_code")),
    *(
        f"{measure}+{search}"
        for measure in ("sd_code", "gradient_code", "mfdct_code")
        for search in ("egs_code", "sgfs_code")
    ),
)
MAX_S = 30.0


def run(size: Size) -> Iterator[Figure | str]:
    """Yield the time of all methods on recordings under three lights, with the whole frame as region."""
    sensor = get_sensor(size.sensor)
    charge = synthetic.sweep_charge(sensor, size.positions[0])
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{number}.h5" for number in range(size.sequences)]
        for number, path in enumerate(paths):
            light = synthetic.LIGHT_KINDS[number % len(synthetic.LIGHT_KINDS)]
            synthetic.record_sweep(path, sensor, charge=charge, frames=size.frames, light=light, number=number)
        evaluate(paths[0], methods=METHODS, region="frame")  # compiles
        records: list[Record] = []
        total = 0.0
        for path in paths:
            result, seconds = timed(evaluate, path, methods=METHODS, region="frame")
            records += result.records
            total += seconds
    for record in records:
        if record.judgement.status == "failed":
            raise SafGenError(f"{record.who.method} failed on {record.what.sequence}: {record.judgement.note}")
    shape = shape_text((sensor.rows, sensor.columns))
    what = f"{len(METHODS)} methods, {len(paths)} sequences of {size.frames:,} frames, {shape}"
    yield Figure(what, total, "s", MAX_S, at_most=True)
    measures = sum(record.judgement.seconds for record in records)
    yield Figure("of which in the measures", measures, "s")
    what = "time of the methods, relative to their measures, reading and counting included"
    yield Figure(what, total / measures, "×")


if __name__ == "__main__":
    sys.exit(main(run))
