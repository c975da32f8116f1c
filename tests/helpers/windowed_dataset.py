"""A dataset of three short random streams with truths and a sweep, made without renderer and sensor."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from saf_gen.stream.manifest import Manifest, SequenceEntry, write_manifest
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

SHAPE, FRAMES, TRUTH = (6, 9), 1_000, 0.4
ENTRY = SequenceEntry("", "train", "plane", 0, "static", "sweep", "constant", 0, 1, "", FRAMES, "f", "c")


def make_spikes(seed: int, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    return (np.random.default_rng(seed).random((FRAMES, *shape)) < 0.3).astype(np.uint8)


def make_truth(shape: tuple[int, int] = SHAPE) -> Truth:
    target = np.zeros(shape, bool)
    target[1:3, 6:8] = True
    plane = np.zeros(shape, np.float32)
    return Truth(TRUTH, (0.3, 0.5), 12.5, plane, target, plane, np.arange(5.0))


def make_windowed_dataset(
    folder: Path, shape: tuple[int, int] = SHAPE, *, splits: tuple[str, ...] = ("train", "train", "test")
) -> Path:
    """Write sweeps s0, s1, ... of these splits, and return the folder."""
    for n, split in enumerate(splits):
        position, truth = np.linspace(0, 1, FRAMES, dtype=np.float32), make_truth(shape)
        file = folder / f"{split}/s{n}.h5"
        write_stream(file, make_spikes(n, shape), focus_position=position, truth=truth)
    return list_windowed(folder)


def list_windowed(folder: Path) -> Path:
    """Write the manifest of all streams in a folder, as they are now, and return the folder."""
    entries = []
    for file in sorted(folder.glob("*/s*.h5"), key=lambda file: file.stem):
        entry = replace(ENTRY, id=file.stem, split=file.parent.name, file=f"{file.parent.name}/{file.name}")
        with open_stream(file) as stream:
            entries.append(replace(entry, frames=stream.shape[0], content_sha256=stream.content_sha256))
    write_manifest(folder, Manifest("made", "abc", "llvm", tuple(entries)))
    return folder
