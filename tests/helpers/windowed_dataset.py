"""A dataset of three short streams, to cut windows from: no renderer, no sensor, but blocks, truths and a sweep."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from saf_gen.stream.manifest import Manifest, SequenceEntry, write_manifest
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_writer import write_stream

SHAPE, FRAMES, TRUTH = (6, 9), 1_000, 0.4
ENTRY = SequenceEntry("", "train", "plane", 0, "static", "sweep", "constant", 0, 1, "", FRAMES, "f", "c")


def make_spikes(seed: int) -> np.ndarray:
    return (np.random.default_rng(seed).random((FRAMES, *SHAPE)) < 0.3).astype(np.uint8)


def make_truth() -> Truth:
    target = np.zeros(SHAPE, bool)
    target[1:3, 6:8] = True
    plane = np.zeros(SHAPE, np.float32)
    return Truth(TRUTH, (0.3, 0.5), 12.5, plane, target, plane, np.arange(5.0))


def make_windowed_dataset(folder: Path) -> Path:
    """Write s0 and s1 of the split train, and s2 of the split test, and return the folder."""
    entries = []
    for n in range(3):
        entry = replace(ENTRY, id=f"s{n}", split="test" if n == 2 else "train", file=f"s{n}.h5")
        position = np.linspace(0, 1, FRAMES, dtype=np.float32)
        digest = write_stream(folder / entry.file, make_spikes(n), focus_position=position, truth=make_truth())
        entries.append(replace(entry, content_sha256=digest))
    write_manifest(folder, Manifest("made", "abc", "llvm", tuple(entries)))
    return folder
