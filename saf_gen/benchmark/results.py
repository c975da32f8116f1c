"""The outcome of an evaluation: records, and what figures need beside them."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from saf_gen.benchmark.curve_quality import AssessedCurve
from saf_gen.benchmark.plugin_description import PluginDescription
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.thumbnails import Thumbnails

Drawn = Literal["", "sweep", "pictures"]
"""What figures show of a sequence: nothing, its sweep, or pictures of it too."""


@dataclass(frozen=True)
class FocusCurve:
    """A measure's score of each block that argmax looked at, and the frame that it answered."""

    measure: str
    frames: np.ndarray
    """(B,) centres of the blocks, frames."""
    scores: np.ndarray
    answer: float | None


@dataclass(frozen=True)
class SweepSummary:
    """One recording as figures need it: lens, light, truth and the focus curves."""

    sequence: str
    split: str | None
    scene: str
    light: str | None
    focus_position: np.ndarray | None
    frames: np.ndarray
    """(B,) centres of the blocks of ``rate``, frames."""
    rate: np.ndarray
    """(B,) mean counts in the region, spikes per pixel and readout."""
    truth: float
    depth_of_focus: tuple[float, float]
    truth_frame: float
    """Frame at which the lens first crosses the truth."""
    curves: tuple[FocusCurve, ...]
    track: np.ndarray | None = None
    """(T,) the truth over time, where the target moves."""
    scene_motion: str | None = None
    thumbnails: Thumbnails | None = None
    """Kept for some sequences only, because they cost a reading of the whole frame."""


@dataclass(frozen=True)
class LensPath:
    """Where a method took the lens, as figures need it."""

    method: str
    sequence: str
    split: str | None
    scene: str
    light: str | None
    seconds: np.ndarray
    """(n,) times since the beginning."""
    position: np.ndarray
    """(n,) lens positions at these times, fractions of the travel."""
    truth: np.ndarray
    """(n,) best focus at these times, fractions of the travel; NaN where it is unknown."""
    depth_of_focus: float | None
    problem: str


@dataclass(frozen=True)
class SequenceFailure:
    """A sequence that could not be read, and why."""

    sequence: str
    problem: str


@dataclass(frozen=True)
class Evaluation:
    """Records (sequence by sequence, methods in the order given), and what figures and failures need.

    ``sweeps`` and ``lens_paths`` are those of the sequences that are drawn; ``curves`` has the quality of the focus
    curves of all. ``lens_paths`` has one entry per record of the closed loop, which has no sweeps; ``plugins``
    describes the measures and searches of the methods, as far as their code is at hand.
    """

    records: tuple[Record, ...]
    sweeps: tuple[SweepSummary, ...]
    failures: tuple[SequenceFailure, ...]
    lens_paths: tuple[LensPath, ...] = ()
    plugins: tuple[PluginDescription, ...] = ()
    curves: tuple[AssessedCurve, ...] = ()
