"""Results of an evaluation: records, and the data that charts need in addition."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from saf_gen.benchmark.curve_quality import AssessedCurve
from saf_gen.benchmark.plugin_description import PluginDescription
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.thumbnails import Thumbnails

Drawn = Literal["", "sweep", "pictures"]
"""Parts of a sequence that charts show: none, its sweep, or its sweep and pictures."""


@dataclass(frozen=True)
class FocusCurve:
    """The scores of a measure for the blocks that ``argmax`` looked at, and the frame that ``argmax`` found."""

    measure: str
    frames: np.ndarray
    """Centres of the blocks, in frames, shape (B,)."""
    scores: np.ndarray
    answer: float | None


@dataclass(frozen=True)
class SweepSummary:
    """The data of one recording for charts: lens, light, truth and focus curves."""

    sequence: str
    split: str | None
    scene: str
    light: str | None
    focus_position: np.ndarray | None
    frames: np.ndarray
    """Centres of the blocks of ``rate``, in frames, shape (B,)."""
    rate: np.ndarray
    """Mean counts in the region, in spikes per pixel and readout, shape (B,)."""
    truth: float
    depth_of_focus: tuple[float, float]
    truth_frame: float
    """Frame at which the lens first crosses the truth."""
    curves: tuple[FocusCurve, ...]
    track: np.ndarray | None = None
    """The truth over time, shape (T,), if the target moves."""
    scene_motion: str | None = None
    thumbnails: Thumbnails | None = None
    """Small pictures; None for most sequences, because making them requires reading whole frames."""


@dataclass(frozen=True)
class LensPath:
    """The path along which a method moved the lens, for charts."""

    method: str
    sequence: str
    split: str | None
    scene: str
    light: str | None
    seconds: np.ndarray
    """Times since the beginning, in seconds, shape (n,)."""
    position: np.ndarray
    """Lens positions at these times, as fractions of the travel, shape (n,)."""
    truth: np.ndarray
    """Best focus at these times, as fractions of the travel, shape (n,); NaN if unknown."""
    depth_of_focus: float | None
    """Depth of focus, as a fraction of the travel."""
    problem: str
    """Why the method failed, or ''."""


@dataclass(frozen=True)
class SequenceFailure:
    """A sequence that could not be evaluated, and why."""

    sequence: str
    problem: str


@dataclass(frozen=True)
class Evaluation:
    """The results of an evaluation.

    Attributes
    ----------
    records : tuple of Record
        Records, sequence by sequence, with the methods in the given order.
    sweeps : tuple of SweepSummary
        Sweeps of the sequences that are drawn; empty in the closed loop.
    failures : tuple of SequenceFailure
        Sequences that could not be evaluated.
    lens_paths : tuple of LensPath
        Closed loop: one path for each record of the sequences that are drawn.
    plugins : tuple of PluginDescription
        Descriptions of the measures and searches of the methods, as far as their code is available.
    curves : tuple of AssessedCurve
        Quality of the focus curves of all sequences.
    """

    records: tuple[Record, ...]
    sweeps: tuple[SweepSummary, ...]
    failures: tuple[SequenceFailure, ...]
    lens_paths: tuple[LensPath, ...] = ()
    plugins: tuple[PluginDescription, ...] = ()
    curves: tuple[AssessedCurve, ...] = ()
