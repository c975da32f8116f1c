"""What methods delivered: the target as the camera saw it where each of some methods answered, on one recording."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from saf_gen.benchmark.records import Record
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.core.region import Region
from saf_gen.errors import BadInput
from saf_gen.leaderboard.board import Leaderboard
from saf_gen.leaderboard.report.viewer import WHITE_QUANTILE
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.pictures.image_strip import ImageStrip, lay_out_pictures
from saf_gen.stream.stream_file import SpikeStream, open_stream

SHOWN = 5
"""Largest number of methods."""
PART = 100
"""A picture counts the spikes of this part of the recording, around the answer."""
DETAIL_PX = 112
"""Side of the square detail, in pixels of the sensor."""


@dataclass(frozen=True)
class Delivered:
    """Pictures of one recording at the answers of methods, the best method first."""

    sequence: str
    strip: ImageStrip
    answers: tuple[tuple[str, float], ...]
    """Method of each picture, and its error in depths of focus."""
    frames: int
    """Readouts that a picture counts."""


def picture_answers(tasks: Sequence[SequenceTask], board: Leaderboard) -> Delivered | None:
    """Return pictures of a typical recording at the answers of the first method, the last, and some between.

    Of the recordings on which the first and the last method answered and the truth is known, the typical one has the
    median difference of their errors. All pictures count equally many readouts and have the same white level.

    Parameters
    ----------
    tasks : sequence of SequenceTask
        The sequences, with the paths of their streams.
    board : Leaderboard
        The leaderboard of their evaluation.

    Returns
    -------
    Delivered or None
        The pictures; None in the closed loop, whose spikes are not stored, if no recording has two answers to compare,
        or if its stream cannot be read any more.
    """
    found = {(r.method, r.sequence): r for r in board.records if r.error_dof is not None and r.frame is not None}
    ranked = [method for method in board.methods if any((method, task.id) in found for task in tasks)]
    if len(ranked) < 2 or any(record.track != "recorded" for record in board.records):
        return None
    best, worst = ranked[0], ranked[-1]
    both = [task for task in tasks if (best, task.id) in found and (worst, task.id) in found]
    if not both:
        return None
    by_gap = sorted(both, key=lambda t: _size(found[worst, t.id]) - _size(found[best, t.id]))
    task = by_gap[len(by_gap) // 2]
    answered = [found[method, task.id] for method in ranked if (method, task.id) in found]
    places = np.linspace(0, len(answered) - 1, min(SHOWN, len(answered))).round().astype(int)
    shown = [answered[place] for place in places]
    with suppress(BadInput, OSError):
        with open_stream(task.path) as stream:
            frames = max(stream.shape[0] // PART, 1)
            detail = _find_detail(stream, choose_region(stream, "target")[0])
            pictures = [_count(stream, record.frame or 0.0, frames=frames, region=detail) for record in shown]
        white = white_level(*pictures, quantile=WHITE_QUANTILE)
        greys = [(255 * display_gamma(picture, white)).round().astype(np.uint8) for picture in pictures]
        strip = lay_out_pictures(greys, count=len(greys)).encode("PNG", optimize=True)
        errors = tuple((record.method, record.error_dof or 0.0) for record in shown)
        return Delivered(task.id, strip, errors, frames)
    return None


def _size(record: Record) -> float:
    return abs(record.error_dof or 0.0)


def _count(stream: SpikeStream, frame: float, *, frames: int, region: Region) -> np.ndarray:
    """Return the spikes of each pixel in the readouts around a frame, float32 (row, col)."""
    first = min(max(math.floor(frame + 0.5 - frames / 2), 0), stream.shape[0] - frames)
    return stream.counts(first, first + frames, region=region).astype(np.float32)


def _find_detail(stream: SpikeStream, box: Region | None) -> Region:
    """Return the square in the box whose counts vary most over the part of the recording around the true focus."""
    frames, rows, columns = stream.shape
    box = box or (slice(0, rows), slice(0, columns))
    middle = stream.truth.frame if math.isfinite(stream.truth.frame) else frames / 2
    image = _count(stream, middle, frames=max(frames // PART, 1), region=box)
    side = min(DETAIL_PX, *image.shape)
    step = max(side // 4, 1)
    corners = [
        (y, x) for y in range(0, image.shape[0] - side + 1, step) for x in range(0, image.shape[1] - side + 1, step)
    ]
    y, x = max(corners, key=lambda corner: float(image[corner[0] :, corner[1] :][:side, :side].var()))
    top, left = box[0].start + y, box[1].start + x
    return slice(top, top + side), slice(left, left + side)
