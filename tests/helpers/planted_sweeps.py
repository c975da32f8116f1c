"""Small focus sweeps with a planted focus, and datasets of them, for tests of the evaluator."""

from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.stream.manifest import Manifest, SequenceEntry, write_manifest
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

SHAPE = (800, 48, 64)


def make_spikes(peak: float, *, gain: np.ndarray | float = 1.0, shape: tuple[int, int, int] = SHAPE) -> np.ndarray:
    """Return frames, uint8 (T, H, W), of a checkerboard whose contrast is largest at frame ``peak``.

    Pixels integrate without noise from random phases, so counts differ from the light by less than one spike.
    """
    frames, height, width = shape
    t = np.arange(frames)
    contrast = 0.05 + 0.9 * np.exp(-(((t - peak) / 90) ** 2))
    board = np.where(np.add.outer(np.arange(height) // 4, np.arange(width) // 4) % 2, 1.0, -1.0)
    rate = (0.25 * np.broadcast_to(gain, frames))[:, None, None] * (1 + contrast[:, None, None] * board)
    phase = np.random.default_rng(7).random((height, width))
    total = np.floor(phase + np.cumsum(rate, axis=0))
    return np.diff(total, axis=0, prepend=0.0).clip(0, 1).astype(np.uint8)


def make_truth(peak: float, *, frames: int = SHAPE[0], dof: float = 0.1, **more) -> Truth:
    """Return the truth of a sweep whose lens is at t / (frames - 1) in frame t."""
    position = peak / (frames - 1)
    return Truth(position=position, depth_of_focus=(position - dof / 2, position + dof / 2), frame=peak, **more)


def write_sweep(path: Path, peak: float, *, known: bool = True, gain: np.ndarray | float = 1.0) -> str:
    """Write a stream file of a sweep and return its content_sha256."""
    optional = {"truth": make_truth(peak)} if known else {}
    lens = np.linspace(0, 1, SHAPE[0], dtype=np.float32)
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_stream(path, make_spikes(peak, gain=gain), focus_position=lens, **optional)


def write_three_sweeps(folder: Path) -> Path:
    """Write the dataset of the sweeps one, two and three, each with a scene of its name, in the split train."""
    names = ("one", "two", "three")
    for n, name in enumerate(names):
        write_sweep(folder / "train" / f"{name}.h5", 200.0 + 200 * n)
    return list_streams(folder, *({"id": name, "split": "train", "scene": name} for name in names))


def list_streams(folder: Path, *sequences: dict[str, Any]) -> Path:
    """Write the manifest of the streams ``folder/SPLIT/ID.h5``, with these fields and defaults for the others."""
    entries = []
    for fields in sequences:
        usual = {"split": "test", "scene": "board", "variant": 0, "scene_motion": "static", "lens_motion": "sweep"}
        usual |= {"light": "constant", "repeat": 0, "seed": 1, "fingerprint": "f"} | fields
        file = f"{usual['split']}/{usual['id']}.h5"
        with open_stream(folder / file) as stream:
            found = {"frames": stream.shape[0], "content_sha256": stream.content_sha256}
        entries.append(SequenceEntry(file=file, **usual, **found))
    write_manifest(folder, Manifest("small", "r", "scalar_rgb", tuple(entries)))
    return folder
