"""The stream file: writing, size, the time from file to scores, and three patterns of reading.

Files are in the page cache, so that the work of reading is measured and not the disk. The operating system counts how
much of a file is read, metadata included.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from saf_gen.acceptance.speed import synthetic_recording
from saf_gen.acceptance.speed.bench_figure import BenchFigure, BenchSize, format_bench_shape
from saf_gen.acceptance.speed.fresh_process import bytes_read_by_bench, time_benched_call
from saf_gen.benchmark.view import RecordingView, WindowCounts
from saf_gen.camera import get_sensor
from saf_gen.core.execution.job import ReportProgress
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.stream_file import SpikeStream, open_stream
from saf_gen.stream.stream_writer import StreamWriter

WINDOWS = 200
BOX = 64  # largest side of the region in pixels


def run_bench(size: BenchSize, report: ReportProgress) -> Iterator[BenchFigure | str]:
    """Yield the speed of writing a recording, and of reading windows and a region of it."""
    sensor = get_sensor(size.sensor)
    shape = (sensor.rows, sensor.columns)
    report("spikes to write", 0.0)
    charge = synthetic_recording.make_bench_charge(sensor, size.positions[0])
    spikes = list(synthetic_recording.encode_bench_blocks(sensor, charge, frames=size.frames))
    report("spikes to write", 1.0)
    work = size.frames * shape[0] * shape[1]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bench.h5"

        def write() -> None:
            with StreamWriter(path, shape=(size.frames, *shape), readout_hz=sensor.readout_hz) as writer:
                for block in spikes:
                    writer.write(block)

        workload = f"{format_bench_shape(shape)}, {size.frames:,} frames, mean rate {synthetic_recording.MEAN_RATE}"
        rate = work / time_benched_call(write)[1] / 1e9
        yield BenchFigure("stream", f"write, verified: {workload}", rate, "10⁹ pixel·frames/s", 3.0)
        bits = path.stat().st_size * 8 / work
        yield BenchFigure("stream", f"size: {workload}, all noise", bits, "bit/pixel·frame", 0.32, at_most=True)
        spikes.clear()
        report("read", 0.0)
        yield from _bench_reading(path)
        report("read", 1.0)


def _bench_reading(path: Path) -> Iterator[BenchFigure | str]:
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
    yield BenchFigure("stream", what, seconds, "s", 0.5, at_most=True)
    side = format_bench_shape((box[0].stop - box[0].start, box[1].stop - box[1].start))
    patterns = (
        (f"counts of {frames // window} windows, all pixels", count_windows),
        (f"counts of one window of {window} frames, all pixels", lambda s: s.counts(middle, middle + window)),
        (f"counts of a region of {side}, all time", lambda s: s.counts(0, frames, region=box)),
    )
    for what, read in patterns:
        seconds, fraction = _time_read(path, read)
        yield BenchFigure("stream", what, seconds, "s")
        if read is count_windows:
            rate = frames * rows * columns / seconds / 1e9
            yield BenchFigure("stream", f"read: {what}", rate, "10⁹ pixel·frames/s")
        if fraction is None:
            yield f"stream: the fraction of the file read for {what} is left out, because the system does not count it"
        else:
            yield BenchFigure("stream", f"fraction of the file read for {what}", 100 * fraction, "%")


def _centred(length: int) -> slice:
    begin = max(0, length - BOX) // 2
    return slice(begin, begin + min(length, BOX))


def _time_read(path: Path, read: Callable[[SpikeStream], object]) -> tuple[float, float | None]:
    """Return the seconds from opening the file to the end of ``read``, and the fraction of the file that was read.

    The fraction is None if the system does not count bytes.
    """
    before = bytes_read_by_bench()

    def work() -> None:
        with open_stream(path) as stream:
            read(stream)

    (_, seconds), after = time_benched_call(work), bytes_read_by_bench()
    if before is None or after is None:
        return seconds, None
    return seconds, (after - before) / path.stat().st_size
