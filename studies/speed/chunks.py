"""Compare chunk shapes of streams: size on disk, and the time of writing and of three patterns of reading.

    python -m studies.speed.chunks [--out studies/speed/pictures] [--frames 20000]

Packed spikes (row, col, bytes along time) of a sweep with all noise are stored in chunks of each shape with isa-l's
deflate on threads, as in streams, and read back as counts of all windows of a sweep, of one window of all pixels, and
of a region of 64×64 pixels over all time. Windows have 104 frames, which are complete bytes, so that the windows are
the same for every shape. Times are medians of three, with the file in the page cache. The script writes chunks.json
and prints a table.
"""

import argparse
import json
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

import h5py
import numpy as np
from isal import isal_zlib

from saf_gen.camera import get_sensor
from saf_gen.core.cores import usable_cores
from saf_gen.core.files import atomic_file
from studies.speed import synthetic

HERE = Path(__file__).resolve().parent
WINDOW = 13  # bytes: 104 frames
SHAPES = (
    (10, 400, 250),  # the shape in streams: some rows, all columns, 2,000 frames
    (250, 400, 10),  # all pixels, 80 frames
    (50, 400, 50),
    (1, 400, 2500),  # a row over all time
    (2, 400, 1250),
    (64, 64, 250),
    (32, 32, 1000),
    (16, 16, 2500),
    (5, 400, 250),
    (40, 400, 250),
)
Box = tuple[slice, slice, slice]


def store(path: Path, spikes: np.ndarray, *, chunk: tuple[int, int, int], pool: ThreadPoolExecutor) -> None:
    """Write spikes, uint8 (row, col, byte), in chunks of a given shape, compressed on threads."""
    with h5py.File(path, "w") as file:
        made = file.create_dataset("spikes", spikes.shape, np.uint8, chunks=chunk, compression=1)
        corners = list(product(*(range(0, n, c) for n, c in zip(spikes.shape, chunk, strict=True))))

        def deflate(corner: tuple[int, ...]) -> bytes:
            part = spikes[tuple(slice(a, a + c) for a, c in zip(corner, chunk, strict=True))]
            whole = part
            if part.shape != chunk:
                whole = np.zeros(chunk, np.uint8)
                whole[tuple(slice(0, n) for n in part.shape)] = part
            return isal_zlib.compress(np.ascontiguousarray(whole), 1, isal_zlib.MAX_WBITS)

        for corner, data in zip(corners, pool.map(deflate, corners), strict=True):
            made.id.write_direct_chunk(corner, data)


def read_chunks(file: h5py.File, box: Box, *, pool: ThreadPoolExecutor) -> Iterator[tuple[tuple[int, ...], np.ndarray]]:
    """Yield the corner and the content of every chunk that overlaps a box, decompressed on threads."""
    spikes = file["spikes"]
    starts = (range(s.start // c * c, s.stop, c) for s, c in zip(box, spikes.chunks, strict=True))
    corners = list(product(*starts))
    raw = [spikes.id.read_direct_chunk(corner)[1] for corner in corners]

    def inflate(data: bytes) -> np.ndarray:
        return np.frombuffer(isal_zlib.decompress(data), np.uint8).reshape(spikes.chunks)

    yield from zip(corners, pool.map(inflate, raw), strict=True)


def counts(path: Path, box: Box, *, pool: ThreadPoolExecutor) -> np.ndarray:
    """Return the spikes of each pixel of a box in each window, uint16 (window, row, col)."""
    lengths = [s.stop - s.start for s in box]
    ones = np.zeros(lengths, np.uint8)
    with h5py.File(path) as file:
        for corner, chunk in read_chunks(file, box, pool=pool):
            here, there = [], []
            for start, c, s in zip(corner, chunk.shape, box, strict=True):
                first, last = max(start, s.start), min(start + c, s.stop)
                here.append(slice(first - start, last - start))
                there.append(slice(first - s.start, last - s.start))
            ones[tuple(there)] = np.bitwise_count(chunk[tuple(here)])
    edges = np.arange(0, lengths[2], WINDOW)
    return np.add.reduceat(ones, edges, axis=2, dtype=np.uint16).transpose(2, 0, 1)


def measure(spikes: np.ndarray, chunk: tuple[int, int, int], *, folder: Path) -> dict[str, float]:
    """Return the bits per pixel and frame, and the seconds of writing and of each pattern of reading."""
    path = folder / "trial.h5"
    rows, columns, length = spikes.shape
    whole, middle = slice(0, rows), length // 2
    patterns: dict[str, Box] = {
        "all windows": (whole, slice(0, columns), slice(0, length)),
        "one window": (whole, slice(0, columns), slice(middle, middle + WINDOW)),
        "one region": (slice(rows // 4, rows // 4 + 64), slice(columns // 4, columns // 4 + 64), slice(0, length)),
    }
    with ThreadPoolExecutor(usable_cores()) as pool:
        out = {"write": _median(lambda: store(path, spikes, chunk=chunk, pool=pool))}
        for name, box in patterns.items():
            out[name] = _median(partial(counts, path, box, pool=pool))
    out["bits"] = path.stat().st_size * 8 / (spikes.size * 8)
    return out


def _median(work: Callable[[], object]) -> float:
    took = []
    for _ in range(3):
        begin = perf_counter()
        work()
        took.append(perf_counter() - begin)
    return median(took)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE / "pictures")
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--sensor", default="vidar_400x250")
    options = parser.parse_args()
    sensor = get_sensor(options.sensor)
    charge = synthetic.sweep_charge(sensor, 129)
    spikes = np.concatenate(list(synthetic.encode_sweep(sensor, charge, frames=options.frames)), axis=2)
    found = {}
    print(f"{'rows, columns, bytes':24}{'bit':>7}{'write':>9}{'sweep':>9}{'window':>9}{'region':>9}  seconds")
    with TemporaryDirectory() as folder:
        for shape in SHAPES:
            chunk = tuple(min(c, n) for c, n in zip(shape, spikes.shape, strict=True))
            one = measure(spikes, chunk, folder=Path(folder))
            found["x".join(map(str, chunk))] = one
            times = "".join(f"{one[k]:9.4f}" for k in ("write", "all windows", "one window", "one region"))
            print(f"{chunk!s:24}{one['bits']:7.3f}{times}")
    options.out.mkdir(parents=True, exist_ok=True)
    with atomic_file(options.out / "chunks.json") as part:
        part.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
