"""The sequence viewer, which shows one picture of a sweep at a time, and a cursor on the focus curves below."""

import math
from dataclasses import dataclass

import numpy as np

from saf_gen.benchmark.judgement import judged_dof
from saf_gen.benchmark.results import SweepSummary
from saf_gen.benchmark.thumbnails import Thumbnails
from saf_gen.leaderboard.figures import Cursor, ImageStrip, build_figure_image_strip, build_figure_spike_strip

MAX_TFP_BYTES, MAX_TFI_BYTES = 100_000, 80_000
"""Largest sizes of the image strips of a viewer. With spikes at 1 bit per pixel, about 55,000 bytes, twelve viewers
take 4 MB."""


@dataclass(frozen=True)
class SequenceViewer:
    """The pictures of a sweep, each with its position on the curves and a description."""

    sequence: str
    strips: tuple[tuple[str, str, ImageStrip], ...]
    """Name, meaning and pictures of each way to display spikes; all show the same moments."""
    cursor: Cursor
    descriptions: tuple[str, ...]
    start: int
    """Number of the picture shown first: the nearest to the focus or, if the focus is unknown, the middle one."""
    region_box: tuple[float, float, float, float]
    """Top, left, bottom and right edges of the region where measures look, as fractions of the picture."""


def build_report_viewer(sweep: SweepSummary, cursor: Cursor) -> SequenceViewer | None:
    """Return the viewer of a sweep, or None if the sweep has no pictures."""
    pictures = sweep.thumbnails
    if pictures is None:
        return None
    offsets = _focus_offsets(sweep, pictures)
    known = np.isfinite(offsets).any()
    return SequenceViewer(
        sweep.sequence,
        (
            ("TFP", "spikes counted", build_figure_image_strip(pictures.images, max_bytes=MAX_TFP_BYTES)),
            ("TFI", "time between two spikes", build_figure_image_strip(pictures.textures, max_bytes=MAX_TFI_BYTES)),
            ("spikes", "one readout, magnified", build_figure_spike_strip(pictures.spikes)),
        ),
        cursor,
        tuple(_describe(sweep, float(f), offset=o) for f, o in zip(pictures.frames, offsets, strict=True)),
        int(np.nanargmin(np.abs(offsets))) if known else len(offsets) // 2,
        pictures.box,
    )


def _focus_offsets(sweep: SweepSummary, pictures: Thumbnails) -> np.ndarray:
    """Return lens minus true focus at each picture, as a fraction of the travel; NaN if either is unknown."""
    lens = sweep.focus_position
    if lens is None:
        return np.full(len(pictures.frames), math.nan)
    frames = np.arange(len(lens))
    truth = sweep.truth if sweep.track is None else np.interp(pictures.frames, frames, sweep.track)
    return np.asarray(np.interp(pictures.frames, frames, lens) - truth)


def _describe(sweep: SweepSummary, frame: float, *, offset: float) -> str:
    parts = [f"frame {frame:,.0f}"]
    if (lens := sweep.focus_position) is not None:
        parts.append(f"lens at {np.interp(frame, np.arange(len(lens)), lens):.3f}")
    if math.isfinite(offset) and (depth := judged_dof(sweep.depth_of_focus)) is not None:
        parts.append(f"{offset / depth:+.1f} DoF from the focus".replace("-", "−"))
    if len(sweep.rate):
        parts.append(f"{np.interp(frame, sweep.frames, sweep.rate):.3f} spikes per pixel and readout")
    return ", ".join(parts)
