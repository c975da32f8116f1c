"""A dataset of three short random streams with truths and a sweep, made without renderer and sensor."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from saf_gen.stream.manifest import Manifest, SequenceEntry, write_manifest
from saf_gen.stream.metadata import Truth
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
    entries = []
    for n, split in enumerate(splits):
        entry = replace(ENTRY, id=f"s{n}", split=split, file=f"{split}/s{n}.h5")
        position, truth = np.linspace(0, 1, FRAMES, dtype=np.float32), make_truth(shape)
        digest = write_stream(folder / entry.file, make_spikes(n, shape), focus_position=position, truth=truth)
        entries.append(replace(entry, content_sha256=digest))
    write_manifest(folder, Manifest("made", "abc", "llvm", tuple(entries)))
    return folder
