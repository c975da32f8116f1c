"""The stream file: writing, size, the time from file to scores, and three patterns of reading.

Files are in the page cache, so that the work of reading is measured and not the disk. The operating system counts how
much of a file is read, metadata included.
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.camera import get_sensor
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.stream_file import SpikeStream, open_stream
from saf_gen.stream.stream_writer import StreamWriter
from studies.speed import synthetic
from studies.speed.bench import Figure, Size, bytes_read, main, shape_text, timed

WINDOWS = 200
BOX = 64  # largest side of the region in pixels


def run(size: Size) -> Iterator[Figure | str]:
    """Yield the speed of writing a recording, and of reading windows and a region of it."""
    sensor = get_sensor(size.sensor)
    shape = (sensor.rows, sensor.columns)
    charge = synthetic.sweep_charge(sensor, size.positions[0])
    spikes = list(synthetic.encode_sweep(sensor, charge, frames=size.frames))
    work = size.frames * shape[0] * shape[1]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bench.h5"

        def write() -> None:
            with StreamWriter(path, shape=(size.frames, *shape), readout_hz=sensor.readout_hz) as writer:
                for block in spikes:
                    writer.write(block)

        workload = f"{shape_text(shape)}, {size.frames:,} frames, mean rate {synthetic.MEAN_RATE}"
        rate = work / timed(write)[1] / 1e9
        yield Figure(f"write, verified: {workload}", rate, "10⁹ pixel·frames/s", 3.0)
        bits = path.stat().st_size * 8 / work
        yield Figure(f"size: {workload}, all noise", bits, "bit/pixel·frame", 0.32, at_most=True)
        spikes.clear()
        yield from _bench_reading(path)


def _bench_reading(path: Path) -> Iterator[Figure | str]:
    with open_stream(path) as stream:
        frames, rows, columns = stream.shape
    window = max(1, frames // WINDOWS)
    middle = frames // 2 // window * window  # first frame of a block, as searches use them
    box = _centred(rows), _centred(columns)

    def score_windows(stream: SpikeStream) -> None:
        view = RecordingView(WindowCounts(stream), get_measure("sd"))
        for first in range(0, frames - window + 1, window):
            view.score(first, first + window)

    def count_windows(stream: SpikeStream) -> None:
        for first in range(0, frames - window + 1, window):
            stream.counts(first, first + window)

    _time_read(path, score_windows)  # compiles
    seconds, _ = _time_read(path, score_windows)
    what = f"SD of {frames // window} windows of all pixels, file to scores"
    yield Figure(what, seconds, "s", 0.5, at_most=True)
    side = shape_text((box[0].stop - box[0].start, box[1].stop - box[1].start))
    patterns = (
        (f"counts of {frames // window} windows, all pixels", count_windows),
        (f"counts of one window of {window} frames, all pixels", lambda s: s.counts(middle, middle + window)),
        (f"counts of a region of {side}, all time", lambda s: s.counts(0, frames, region=box)),
    )
    for what, read in patterns:
        seconds, fraction = _time_read(path, read)
        yield Figure(what, seconds, "s")
        if read is count_windows:
            rate = frames * rows * columns / seconds / 1e9
            yield Figure(f"read: {what}", rate, "10⁹ pixel·frames/s")
        if fraction is None:
            yield f"stream: the fraction of the file read for {what} is left out, because the system does not count it"
        else:
            yield Figure(f"fraction of the file read for {what}", 100 * fraction, "%")


def _centred(length: int) -> slice:
    begin = max(0, length - BOX) // 2
    return slice(begin, begin + min(length, BOX))


def _time_read(path: Path, read: Callable[[SpikeStream], object]) -> tuple[float, float | None]:
    """Return the seconds from opening the file to the end of ``read``, and the fraction of the file that was read.

    The fraction is None if the system does not count bytes.
    """
    before = bytes_read()

    def work() -> None:
        with open_stream(path) as stream:
            read(stream)

    (_, seconds), after = timed(work), bytes_read()
    if before is None or after is None:
        return seconds, None
    return seconds, (after - before) / path.stat().st_size


if __name__ == "__main__":
    sys.exit(main(run))
