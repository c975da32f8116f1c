"""What an evaluation gives: records, and what its figures need."""

from dataclasses import dataclass

import numpy as np

from saf_gen.benchmark.records import Record
from saf_gen.benchmark.thumbnails import Thumbnails

__all__ = ["Evaluation", "FocusCurve", "LensPath", "SequenceFailure", "SweepSummary"]


@dataclass(frozen=True)
class FocusCurve:
    """What argmax looked at: a measure's score of each block, and the frame it took."""

    measure: str
    frames: np.ndarray
    """(B,) centres of the blocks, frames."""
    scores: np.ndarray
    answer: float | None


@dataclass(frozen=True)
class SweepSummary:
    """One recording as a figure needs it: lens, light, truth and the focus curves."""

    sequence: str
    split: str | None
    scene: str
    light: str | None
    focus_position: np.ndarray | None
    frames: np.ndarray
    """(B,) centres of the blocks of ``rate``, frames."""
    rate: np.ndarray
    """(B,) mean counts in the region, spikes a pixel and readout."""
    truth: float
    depth_of_focus: tuple[float, float]
    truth_frame: float
    """When the lens first passes the truth."""
    curves: tuple[FocusCurve, ...]
    track: np.ndarray | None = None
    """(T,) the truth over time, where it moves."""
    scene_motion: str | None = None
    thumbnails: Thumbnails | None = None
    """Of some sequences only: they cost a reading of the whole frame."""


@dataclass(frozen=True)
class LensPath:
    """Where a method took the lens, as a figure needs it."""

    method: str
    sequence: str
    split: str | None
    scene: str
    light: str | None
    seconds: np.ndarray
    """(n,)"""
    position: np.ndarray
    """(n,) fraction of the travel."""
    truth: np.ndarray
    """(n,) best focus at these times; NaN where it is unknown."""
    depth_of_focus: float | None
    problem: str


@dataclass(frozen=True)
class SequenceFailure:
    """A sequence that could not be read, and why."""

    sequence: str
    problem: str


@dataclass(frozen=True)
class Evaluation:
    """All that came out: records (sequence by sequence, methods in the order given), sweeps, failures.

    ``lens_paths`` are those of the closed loop, a record each; it has no sweeps.
    """

    records: tuple[Record, ...]
    sweeps: tuple[SweepSummary, ...]
    failures: tuple[SequenceFailure, ...]
    lens_paths: tuple[LensPath, ...] = ()
