"""The sequence viewer: a sweep as pictures, one at a time, with a cursor on the curves under it."""

import base64
import json
import math
from dataclasses import dataclass

import numpy as np

from saf_gen.contest.results import Sweep
from saf_gen.figures import Cursor, Film, film
from saf_gen.report._html import escaped
from saf_gen.rig.thumbnails import Thumbnails
from saf_gen.scores import depth_of_focus

__all__ = ["FILM_BYTES", "Reel", "plot_markup", "reel_markup", "reel_of"]

FILM_BYTES = 220_000
"""Of one film: twelve of them and the figures stay below 6 MB of page."""


@dataclass(frozen=True)
class Reel:
    """A film, where each of its pictures lies on the curves, what to say of it, which to begin with."""

    sequence: str
    film: Film
    cursor: Cursor
    words: tuple[str, ...]
    start: int
    box: tuple[float, float, float, float]


def reel_of(sweep: Sweep, cursor: Cursor) -> Reel | None:
    """The viewer of a sweep that has pictures."""
    pictures = sweep.thumbnails
    if pictures is None:
        return None
    away = _away(sweep, pictures)
    return Reel(
        sweep.sequence,
        film(pictures, most_bytes=FILM_BYTES),
        cursor,
        tuple(_words(sweep, float(frame), apart) for frame, apart in zip(pictures.frames, away, strict=True)),
        int(np.nanargmin(np.abs(away))) if np.isfinite(away).any() else len(away) // 2,
        pictures.box,
    )


def reel_markup(reel: Reel, *, name: str) -> str:
    """The film as a contact sheet, which the script turns into a viewer with a slider."""
    data = {"across": reel.film.across, "down": reel.film.down, "words": reel.words, "x": reel.cursor.across}
    top, left, bottom, right = (f"{100 * edge:.4g}%" for edge in reel.box)
    width, height = reel.film.size
    sheet = base64.b64encode(reel.film.jpeg).decode()
    alt = f"{reel.film.count} pictures of the sweep of {reel.sequence}, from its first frame to its last"
    shape = f"--shape:{width}/{height};--across:{reel.film.across};--down:{reel.film.down}"
    return (
        f'<div class="reel" data-reel="{escaped(json.dumps(data, separators=(",", ":")))}">'
        f'<div class="view" style="{shape}">'
        f'<img alt="{escaped(alt)}" src="data:image/jpeg;base64,{sheet}">'
        f'<span class="box" hidden style="top:{top};left:{left};bottom:calc(100% - {bottom});'
        f'right:calc(100% - {right})"></span></div>'
        f'<label hidden for="{escaped(name)}-at">Picture of the sweep of {escaped(reel.sequence)}</label>'
        f'<input hidden type="range" id="{escaped(name)}-at" min="0" max="{reel.film.count - 1}" '
        f'value="{reel.start}"><output hidden for="{escaped(name)}-at"></output></div>'
    )


def plot_markup(svg: str, reel: Reel | None) -> str:
    """A figure; over the curves of a film a cursor, which the script moves."""
    if reel is None:
        return f'<div class="plot">{svg}</div>'
    top, bottom = (f"{100 * edge:.4g}%" for edge in (reel.cursor.top, reel.cursor.bottom))
    line = f'<i class="cursor" hidden style="top:{top};bottom:calc(100% - {bottom})"></i>'
    return f'<div class="plot scrub">{svg}{line}</div>'


def _away(sweep: Sweep, pictures: Thumbnails) -> np.ndarray:
    """Lens minus truth at each picture, fraction of the travel; NaN where either is unknown."""
    lens = sweep.focus_position
    if lens is None:
        return np.full(len(pictures.frames), math.nan)
    every = np.arange(len(lens))
    truth = sweep.truth if sweep.track is None else np.interp(pictures.frames, every, sweep.track)
    away: np.ndarray = np.interp(pictures.frames, every, lens) - truth
    return away


def _words(sweep: Sweep, frame: float, away: float) -> str:
    said = [f"frame {frame:,.0f}"]
    if sweep.focus_position is not None:
        every = np.arange(len(sweep.focus_position))
        said.append(f"lens at {np.interp(frame, every, sweep.focus_position):.3f}")
    if math.isfinite(away) and (dof := depth_of_focus(sweep.depth_of_focus)) is not None:
        said.append(f"{away / dof:+.1f} DoF from the focus".replace("-", "−"))
    if len(sweep.rate):
        said.append(f"{np.interp(frame, sweep.frames, sweep.rate):.3f} spikes a pixel and readout")
    return ", ".join(said)
