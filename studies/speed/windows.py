"""Random windows for training: the number that two processes read per second, in the first pass and afterwards.

The processes start together. Files are in the page cache, so that the work of reading is measured and not the disk.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from time import perf_counter, sleep

import numpy as np

from saf_gen.camera import get_sensor
from saf_gen.core.execution.executor import run_jobs
from saf_gen.core.execution.job import ReportProgress
from saf_gen.core.seeds import make_generator
from saf_gen.optics import ImageDistanceDrive
from saf_gen.stream.defocus_blur import PROVENANCE_KEY, lens_to_text
from saf_gen.stream.manifest import Manifest, SequenceEntry, write_manifest
from saf_gen.stream.spike_windows import SpikeWindows
from saf_gen.stream.stream_writer import write_stream
from studies.speed import synthetic
from studies.speed.bench import Figure, Size, main, peak_gib, shape_text

WINDOW, PROCESSES = 100, 2
MIN_PER_SECOND, MIN_DENSE_PER_SECOND, MAX_GIB = 1_500.0, 1_000.0, 1.0
DENSE_FRAMES = 400
DENSE = ("depth", "blur")


def run(size: Size) -> Iterator[Figure | str]:
    """Yield the windows per second that two processes read in random order, and the larger of their peak memories."""
    sensor = get_sensor(size.sensor)
    with TemporaryDirectory() as folder:
        _make_dataset(Path(folder), size)
        jobs = [_Reader(folder, number, size.reads) for number in range(PROCESSES)]
        found = []
        for _, result, error in run_jobs(jobs, workers=PROCESSES, report=lambda stage, done: None):
            if error is not None:
                raise error
            found.append(result)
    first, later = (sum(rates) for rates in zip(*((a, b) for a, b, _ in found), strict=True))
    windows = f"windows of {WINDOW} frames, {shape_text((sensor.rows, sensor.columns))}, {PROCESSES} processes"
    yield Figure(f"random {windows}", later, "/s", MIN_PER_SECOND)
    yield Figure("random windows in the first pass, which counts and caches them", first, "/s")
    memory = max(gib for *_, gib in found)
    yield Figure("peak memory of a process that reads", memory, "GiB", MAX_GIB, at_most=True)
    for target in DENSE:
        rate = _dense_rate(size, target=target)
        yield Figure(f"the same in one process, with the {target} of every pixel", rate, "/s", MIN_DENSE_PER_SECOND)


def _dense_rate(size: Size, *, target: str) -> float:
    """Return the windows per second that one process reads in random order from kept counts, with a dense target."""
    sensor = get_sensor(size.sensor)
    shape, random = (sensor.rows, sensor.columns), make_generator("bench", "dense")
    lens = ImageDistanceDrive(focal_length_m=0.035, f_number=2.0, focus_range_m=(0.9, 0.4))
    with TemporaryDirectory() as folder:
        digest = write_stream(
            Path(folder, "0.h5"),
            random.integers(0, 2, (DENSE_FRAMES, *shape), dtype=np.uint8),
            focus_position=np.linspace(0, 1, DENSE_FRAMES, dtype=np.float32),
            truth={"position": 0.5, "depth": random.uniform(0.4, 2.0, shape).astype(np.float32)},
            provenance={PROVENANCE_KEY: lens_to_text(lens, pitch_m=sensor.pitch_m)},
        )
        entry = SequenceEntry(
            "0", "train", "bench", 0, "static", "sweep", "constant", 0, 0, "0.h5", DENSE_FRAMES, "", digest
        )
        write_manifest(Path(folder), Manifest("bench", "", "none", (entry,)))
        windows = SpikeWindows(folder, window=WINDOW, stride=10, target=target)
        windows[0]  # counts and keeps them
        begin = perf_counter()
        for number in random.integers(len(windows), size=size.reads):
            windows[int(number)]
        return size.reads / (perf_counter() - begin)


def _make_dataset(folder: Path, size: Size) -> None:
    """Write one recording under as many names as there are sequences; its content does not matter here."""
    sensor = get_sensor(size.sensor)
    charge = synthetic.sweep_charge(sensor, size.positions[0])
    paths = [folder / f"{number}.h5" for number in range(size.sequences)]
    digest = synthetic.record_sweep(paths[0], sensor, charge=charge, frames=size.frames)
    for path in paths[1:]:
        copyfile(paths[0], path)
    what = "train", "bench", 0, "static", "sweep", "constant", 0, 0
    entries = [SequenceEntry(path.stem, *what, path.name, size.frames, "", digest) for path in paths]
    write_manifest(folder, Manifest("bench", "", "none", tuple(entries)))


@dataclass(frozen=True)
class _Reader:
    """Reads windows once all readers have started; returns the rates of both passes and its peak memory (GiB)."""

    folder: str
    number: int
    reads: int
    takes_all_cores: bool = False
    wants_gpu: bool = False

    @property
    def name(self) -> str:
        return f"reader {self.number}"

    def run(self, report: ReportProgress) -> tuple[float, float, float]:
        windows = SpikeWindows(self.folder, window=WINDOW, target=lambda *_: 0.0)
        random = make_generator("bench", "windows", self.number)
        SpikeWindows(self.folder, window=WINDOW, stride=10_000, crop=(1, 1), target=lambda *_: 0.0)[0]  # compiles
        mine = [n for n, window in enumerate(windows.windows) if int(window.sequence.id) % PROCESSES == self.number]
        return (
            self._read(windows, random.permutation(mine), stage="first"),
            self._read(windows, random.integers(len(windows), size=self.reads), stage="later"),
            peak_gib(),
        )

    def _read(self, windows: SpikeWindows, numbers: np.ndarray, *, stage: str) -> float:
        Path(self.folder, f"{stage}-{self.number}").touch()
        patience = perf_counter() + 60  # the other process may have failed
        while len(list(Path(self.folder).glob(f"{stage}-*"))) < PROCESSES and perf_counter() < patience:
            sleep(0.01)
        begin = perf_counter()
        for number in numbers:
            windows[number]
        return len(numbers) / (perf_counter() - begin)


if __name__ == "__main__":
    sys.exit(main(run))
