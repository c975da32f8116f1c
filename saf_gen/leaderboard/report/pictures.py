"""Pictures of the page: viewers of sweeps, and the target as the camera saw it where each of some methods answered."""

import itertools
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from math import isfinite, nan

import numpy as np

from saf_gen.benchmark.judgement import judged_dof
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import SweepSummary
from saf_gen.benchmark.thumbnails import Thumbnails
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.core.region import Region
from saf_gen.errors import BadInput
from saf_gen.leaderboard.agreement import Agreement
from saf_gen.leaderboard.board import Leaderboard
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.pictures.image_strip import ImageStrip, PictureSheet, lay_out_pictures, shrink_picture
from saf_gen.stream.pictures.timeline import WINDOW
from saf_gen.stream.recordings import Recording, open_recording
from saf_gen.stream.stream_file import SpikeStream, open_stream

WIDTH = 280
"""Largest width of one picture, in pixels."""
WHITE_QUANTILE = 0.998  # glints, the brightest pixels, are clipped
QUALITIES, SHRINKAGES = (60, 40, 25, 15), (1, 1.5, 2, 3)
EFFORT = 2  # of WebP, 0 to 6: half the time of the usual 4, for files that are a few percent larger
TRIED_FIRST, MARGIN = 8, 1.2
"""Every eighth picture is encoded first. If these exceed their part of the bytes by more than a factor of 1.2, the next
quality or size is tried, because all pictures would be too large."""
MAX_TFP_BYTES, MAX_TFI_BYTES = 100_000, 80_000
"""Largest sizes of the image strips of a viewer. With spikes at 1 bit per pixel, about 55,000 bytes, twelve viewers
take 4 MB."""


@dataclass(frozen=True)
class SequenceViewer:
    """The pictures of a sweep, each with its position on the axis of the curves and a description."""

    sequence: str
    strips: tuple[tuple[str, str, ImageStrip], ...]
    """Name, meaning and pictures of each way to display spikes; all show the same moments."""
    x: tuple[float, ...]
    """Position of each picture on the axis of the sweep's chart: in travels, or in frames."""
    descriptions: tuple[str, ...]
    start: int
    """Number of the picture shown first: the nearest to the focus or, if that is unknown, to the answer of all
    measures; the middle one without either."""
    region_box: tuple[float, float, float, float]
    """Top, left, bottom and right edges of the region where measures look, as fractions of the picture."""


def build_viewer(sweep: SweepSummary, answer: float | None = None) -> SequenceViewer | None:
    """Return the viewer of a sweep, or None if the sweep has no pictures.

    Without a truth, it first shows the frame of the ``answer``.
    """
    pictures = sweep.thumbnails
    if pictures is None:
        return None
    offsets = _focus_offsets(sweep, pictures)
    middle = float(pictures.frames[len(offsets) // 2])
    away = offsets if np.isfinite(offsets).any() else pictures.frames - (middle if answer is None else answer)
    return SequenceViewer(
        sweep.sequence,
        (
            ("TFP", "spikes counted", image_strip(pictures.images, max_bytes=MAX_TFP_BYTES)),
            ("TFI", "time between two spikes", image_strip(pictures.textures, max_bytes=MAX_TFI_BYTES)),
            ("spikes", "one readout, magnified", spike_strip(pictures.spikes)),
        ),
        tuple(round(float(x), 4) for x in frames_to_axis(sweep)(pictures.frames)),
        tuple(_describe_picture(sweep, float(f), offset=o) for f, o in zip(pictures.frames, offsets, strict=True)),
        int(np.nanargmin(np.abs(away))),
        pictures.box,
    )


def position_axis(sweep: SweepSummary) -> np.ndarray | None:
    """Return the focus position (T,) if it can be the axis, because the lens never turns back or rests; else None."""
    lens = sweep.focus_position
    if lens is None or len(lens) < 2:
        return None
    moves = np.sign(float(lens[-1]) - float(lens[0])) * np.diff(lens)
    centres = np.interp(sweep.frames, np.arange(len(lens)), lens)
    steps = np.abs(np.diff(centres)) if centres.size > 1 else np.abs(moves)
    return lens if moves.min() >= 0 and moves.any() and steps.min() > 0.02 * steps.mean() else None


def frames_to_axis(sweep: SweepSummary) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function that maps frames to the axis: the focus position if it can be the axis, else the frame."""
    lens = position_axis(sweep)
    if lens is None:
        return lambda frames: frames
    return lambda frames: np.interp(frames, np.arange(len(lens)), lens)


def _focus_offsets(sweep: SweepSummary, pictures: Thumbnails) -> np.ndarray:
    """Return lens minus true focus at each picture, as a fraction of the travel; NaN if either is unknown."""
    lens = sweep.focus_position
    if lens is None:
        return np.full(len(pictures.frames), nan)
    frames = np.arange(len(lens))
    truth = sweep.truth if sweep.track is None else np.interp(pictures.frames, frames, sweep.track)
    return np.asarray(np.interp(pictures.frames, frames, lens) - truth)


def _describe_picture(sweep: SweepSummary, frame: float, *, offset: float) -> str:
    parts = [f"frame {frame:,.0f}"]
    if (lens := sweep.focus_position) is not None:
        parts.append(f"lens at {np.interp(frame, np.arange(len(lens)), lens):.3f}")
    if isfinite(offset) and (depth := judged_dof(sweep.depth_of_focus)) is not None:
        parts.append(f"{offset / depth:+.1f} DoF from the focus".replace("-", "−"))
    if len(sweep.rate):
        parts.append(f"{np.interp(frame, sweep.frames, sweep.rate):.3f} spikes per pixel and readout")
    return ", ".join(parts)


def image_strip(images: np.ndarray, *, max_bytes: int) -> ImageStrip:
    """Return pictures of linear light (n, h, w) as WebP, in at most ``max_bytes`` if any quality and size allows it.

    The quality is reduced first, then the size, because noise needs many bytes and averages out in smaller pictures.
    All pictures have the same white level, so that less light looks darker. A few pictures are encoded first to skip
    qualities and sizes that would be too large.
    """
    white = white_level(images, quantile=WHITE_QUANTILE)
    few = images[::TRIED_FIRST]
    max_few_bytes = MARGIN * max_bytes * len(few) / len(images)

    @cache
    def sheet(shrinkage: float, *, all_of_them: bool) -> PictureSheet:
        return _lay_out(images if all_of_them else few, white, shrinkage=shrinkage)

    def encode(shrinkage: float, quality: int, *, all_of_them: bool = True) -> ImageStrip:
        return sheet(shrinkage, all_of_them=all_of_them).encode("WEBP", quality=quality, method=EFFORT)

    *larger, last = itertools.product(SHRINKAGES, QUALITIES)
    for shrinkage, quality in larger:
        if len(encode(shrinkage, quality, all_of_them=False).file) <= max_few_bytes:
            strip = encode(shrinkage, quality)
            if len(strip.file) <= max_bytes:
                return strip
    return encode(*last)


def _lay_out(images: np.ndarray, white: float, *, shrinkage: float) -> PictureSheet:
    rows, columns = images.shape[1:]
    width = max(round(min(columns, WIDTH) / shrinkage), 1)
    size = width, max(round(rows * width / columns), 1)
    greys = (255 * display_gamma(shrink_picture(image, size), white) for image in images)
    return lay_out_pictures((grey.round().astype(np.uint8) for grey in greys), count=len(images))


def spike_strip(spikes: np.ndarray) -> ImageStrip:
    """Return readouts (n, h, w) of 0 and 1 as PNG with one bit per pixel, in which spikes are white."""
    greys = (np.asarray(frame, dtype=np.uint8) * 255 for frame in spikes)
    return lay_out_pictures(greys, count=len(spikes), two_tone=True).encode("PNG", optimize=True)


SHOWN = 5
"""Largest number of methods."""
PART = 100
"""A picture counts the spikes of this part of the recording, around the answer."""
DETAIL_PX = 112
"""Side of the square detail, in pixels of the sensor."""
MAX_PLACE_WIDTH = 400
"""Largest width of a picture of the whole frame, in pixels."""


@dataclass(frozen=True)
class Delivered:
    """Pictures of one recording at the answers of methods, the best method first."""

    sequence: str
    strip: ImageStrip
    answers: tuple[tuple[str, str], ...]
    """Method of each picture, and its error in depths of focus; without a truth, which answer it is, and where."""
    frames: int
    """Readouts that a picture counts."""


def picture_answers(tasks: Sequence[SequenceTask], board: Leaderboard) -> Delivered | None:
    """Return pictures of a typical recording at the answers of the first method, the last, and some between.

    Where nothing is judged, the pictures show the recording on which the fewest measures agree: at their answer and, if
    they disagree, at the other place.

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
    if board.lacks_truth:
        return _picture_places(tasks, board.agreements)
    found = {
        (r.who.method, r.what.sequence): r
        for r in board.records
        if r.judgement.error_dof is not None and r.judgement.frame is not None
    }
    ranked = [method for method in board.methods if any((method, task.id) in found for task in tasks)]
    if len(ranked) < 2 or any(record.what.track != "recorded" for record in board.records):
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
            pictures = [_count(stream, record.judgement.frame or 0.0, frames=frames, region=detail) for record in shown]
        errors = ((r.who.method, f"{r.judgement.error_dof or 0.0:+.2f} DoF".replace("-", "−")) for r in shown)
        return Delivered(task.id, _strip_of(pictures), tuple(errors), frames)
    return None


def _picture_places(tasks: Sequence[SequenceTask], agreements: Sequence[Agreement]) -> Delivered | None:
    """Return pictures of the whole frame at the places of the least agreement, or None if there is none."""
    path_of = {task.id: task.path for task in tasks}
    answered = [one for one in agreements if one.places and one.sequence in path_of]
    with suppress(BadInput, OSError, ValueError):
        least = min(answered, key=lambda one: one.share)
        with open_recording(path_of[least.sequence]) as stream:
            frames = 1 if stream.form == "frames" else min(WINDOW, -(-stream.shape[0] // 10))
            pictures = [_count(stream, place.frame, frames=frames, region=None) for place in least.places]
        width = min(pictures[0].shape[1], MAX_PLACE_WIDTH)
        size = width, max(round(pictures[0].shape[0] * width / pictures[0].shape[1]), 1)
        words = ("the answer" if least.agrees else "where most agree", "where others agree")
        named = tuple(zip(words, map(str, least.places), strict=False))
        shown = [shrink_picture(one, size) for one in pictures]
        shown = [one / white_level(one, quantile=WHITE_QUANTILE) for one in shown]  # one lamp may be far darker
        return Delivered(least.sequence, _strip_of(shown), named, frames)
    return None


def _strip_of(pictures: Sequence[np.ndarray]) -> ImageStrip:
    """Return pictures of linear light (h, w) side by side, with the same white level."""
    white = white_level(*pictures, quantile=WHITE_QUANTILE)
    greys = [(255 * display_gamma(picture, white)).round().astype(np.uint8) for picture in pictures]
    return lay_out_pictures(greys, count=len(greys)).encode("PNG", optimize=True)


def _size(record: Record) -> float:
    return abs(record.judgement.error_dof or 0.0)


def _count(stream: Recording, frame: float, *, frames: int, region: Region | None) -> np.ndarray:
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
