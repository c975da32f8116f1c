"""The sequence viewer: a sweep as pictures, one at a time, with a cursor on the curves under it."""

import base64
import json
import math
from dataclasses import dataclass

import numpy as np

from saf_gen.benchmark.judgement import depth_of_focus
from saf_gen.benchmark.results import SweepSummary
from saf_gen.benchmark.thumbnails import Thumbnails
from saf_gen.leaderboard.figures import Cursor, ImageStrip, build_image_strip
from saf_gen.leaderboard.report._html import escape_html

__all__ = ["MAX_STRIP_BYTES", "SequenceViewer", "build_viewer", "format_plot", "format_viewer"]

MAX_STRIP_BYTES = 220_000
"""Of one film: twelve of them and the figures stay below 6 MB of page."""


@dataclass(frozen=True)
class SequenceViewer:
    """A film, where each of its pictures lies on the curves, what to say of it, which to begin with."""

    sequence: str
    strip: ImageStrip
    cursor: Cursor
    descriptions: tuple[str, ...]
    start: int
    region_box: tuple[float, float, float, float]


def build_viewer(sweep: SweepSummary, cursor: Cursor) -> SequenceViewer | None:
    """The viewer of a sweep that has pictures."""
    pictures = sweep.thumbnails
    if pictures is None:
        return None
    away = _away(sweep, pictures)
    return SequenceViewer(
        sweep.sequence,
        build_image_strip(pictures, max_bytes=MAX_STRIP_BYTES),
        cursor,
        tuple(_words(sweep, float(frame), apart) for frame, apart in zip(pictures.frames, away, strict=True)),
        int(np.nanargmin(np.abs(away))) if np.isfinite(away).any() else len(away) // 2,
        pictures.box,
    )


def format_viewer(viewer: SequenceViewer, *, name: str) -> str:
    """The film as a contact sheet, which the script turns into a viewer with a slider."""
    data = {
        "across": viewer.strip.columns,
        "down": viewer.strip.rows,
        "words": viewer.descriptions,
        "x": viewer.cursor.across,
    }
    top, left, bottom, right = (f"{100 * edge:.4g}%" for edge in viewer.region_box)
    width, height = viewer.strip.size
    sheet = base64.b64encode(viewer.strip.jpeg).decode()
    alt = f"{viewer.strip.count} pictures of the sweep of {viewer.sequence}, from its first frame to its last"
    shape = f"--shape:{width}/{height};--across:{viewer.strip.columns};--down:{viewer.strip.rows}"
    return (
        f'<div class="reel" data-reel="{escape_html(json.dumps(data, separators=(",", ":")))}">'
        f'<div class="view" style="{shape}">'
        f'<img alt="{escape_html(alt)}" src="data:image/jpeg;base64,{sheet}">'
        f'<span class="box" hidden style="top:{top};left:{left};bottom:calc(100% - {bottom});'
        f'right:calc(100% - {right})"></span></div>'
        f'<label hidden for="{escape_html(name)}-at">'
        f"Picture of the sweep of {escape_html(viewer.sequence)}</label>"
        f'<input hidden type="range" id="{escape_html(name)}-at" min="0" max="{viewer.strip.count - 1}" '
        f'value="{viewer.start}"><output hidden for="{escape_html(name)}-at"></output></div>'
    )


def format_plot(svg: str, viewer: SequenceViewer | None) -> str:
    """A figure; over the curves of a film a cursor, which the script moves."""
    if viewer is None:
        return f'<div class="plot">{svg}</div>'
    top, bottom = (f"{100 * edge:.4g}%" for edge in (viewer.cursor.top, viewer.cursor.bottom))
    line = f'<i class="cursor" hidden style="top:{top};bottom:calc(100% - {bottom})"></i>'
    return f'<div class="plot scrub">{svg}{line}</div>'


def _away(sweep: SweepSummary, pictures: Thumbnails) -> np.ndarray:
    """Lens minus truth at each picture, fraction of the travel; NaN where either is unknown."""
    lens = sweep.focus_position
    if lens is None:
        return np.full(len(pictures.frames), math.nan)
    every = np.arange(len(lens))
    truth = sweep.truth if sweep.track is None else np.interp(pictures.frames, every, sweep.track)
    away: np.ndarray = np.interp(pictures.frames, every, lens) - truth
    return away


def _words(sweep: SweepSummary, frame: float, away: float) -> str:
    said = [f"frame {frame:,.0f}"]
    if sweep.focus_position is not None:
        every = np.arange(len(sweep.focus_position))
        said.append(f"lens at {np.interp(frame, every, sweep.focus_position):.3f}")
    if math.isfinite(away) and (dof := depth_of_focus(sweep.depth_of_focus)) is not None:
        said.append(f"{away / dof:+.1f} DoF from the focus".replace("-", "−"))
    if len(sweep.rate):
        said.append(f"{np.interp(frame, sweep.frames, sweep.rate):.3f} spikes a pixel and readout")
    return ", ".join(said)
