"""Parts of a stream: some of its frames, rows and columns, with what the file says of them."""

import os
from dataclasses import replace
from json import dumps
from typing import Any

import numpy as np

from saf_gen.core import bits
from saf_gen.core.files import check_apart
from saf_gen.core.region import Region, validate_region, validate_window
from saf_gen.errors import BadInput
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.stream.defocus_blur import PROVENANCE_KEY as LENS_KEY
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.stream_file import SpikeStream, open_stream
from saf_gen.stream.stream_writer import StreamWriter

_FRAMES = 2_000  # frames that are copied at a time: whole bytes


def cut_stream(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    first: int = 0,
    stop: int | None = None,
    region: Region | None = None,
) -> str:
    """Write frames ``first <= t < stop`` of a stream, in a region, as the file ``out``; return its content_sha256.

    Lens, light and truth follow. The frame of best focus counts from the new beginning; it is NaN if the lens does not
    pass the focus in these frames. Of the provenance, the sensor and the lens stay, and a text ``cut`` names the stream
    and its part: a part cannot be recorded again as its whole could. Noise-free sharpness and the
    rectangle inside the target stay if they are still those of the part: in a scene at rest whose rows and columns are
    all kept.

    Parameters
    ----------
    source : str or Path
        Stream file.
    out : str or Path
        Stream file to write.
    first, stop : int
        Window of at least one frame; by default all.
    region : Region, optional
        Rows and columns; by default all.

    Raises
    ------
    BadInput
        If the stream cannot be read, the window or the region is empty or extends beyond the stream, or ``out`` is
        ``source`` or cannot be written.
    """
    with open_stream(source) as stream:
        check_apart(source, out)
        total, height, width = stream.shape
        window = validate_window(first, total if stop is None else stop, total=total)
        rows, columns = box = validate_region(region, (height, width))
        shape = (len(window), rows.stop - rows.start, columns.stop - columns.start)
        metadata = _cut_metadata(stream, window, box=box)
        with StreamWriter(out, shape=shape, readout_hz=stream.readout_hz, metadata=metadata) as writer:
            for begin in range(window.start, window.stop, _FRAMES):
                frames = stream.frames(begin, min(begin + _FRAMES, window.stop), region=box)
                writer.write(bits.pack_bits(frames))
    return writer.content_sha256


def _cut_metadata(stream: SpikeStream, window: range, *, box: Region) -> Metadata:
    held, (rows, columns) = stream.metadata, box
    span = slice(window.start, window.stop)
    in_time: dict[str, Any] = {
        name: None if (values := getattr(held, name)) is None else values[span]
        for name in ("focus_position", "image_distance", "object_distance", "gain")
    }
    part = {
        "stream": stream.content_sha256, "frames": [window.start, window.stop],
        "rows": [rows.start, rows.stop], "columns": [columns.start, columns.stop],
    }  # fmt: skip
    kept = {name: text for name, text in held.provenance.items() if name in ("sensor", LENS_KEY)}
    whole = (rows.stop - rows.start, columns.stop - columns.start) == stream.shape[1:]
    still = whole and stream.truth.track is None
    lapsed: dict[str, Any] = {} if still else dict.fromkeys(("sharpness", "inside", "sharpness_inside"))
    lens = None if held.lens_position is None else held.lens_position[span]
    truth = _cut_truth(stream.truth, window, lens=lens)
    target, mask = _crop(truth.target, box), _crop(held.mask, box)
    if mask is not None and mask.all():
        raise BadInput("every pixel of the part is masked", where=str(stream.path), hint="choose other rows or columns")
    readout = None if held.readout is None else held.readout[span] - held.readout[window.start]
    return replace(
        held,
        **in_time,
        mask=mask if mask is not None and mask.any() else None,
        readout=readout if readout is not None and readout[-1] >= len(window) else None,
        truth=replace(
            truth,
            depth=_crop(truth.depth, box),
            target=target if target is not None and target.any() else None,
            best_position=_crop(truth.best_position, box),
            **lapsed,
        ),
        provenance={**kept, "cut": dumps(part)},
    )


def _crop(image: np.ndarray | None, box: Region) -> np.ndarray | None:
    return None if image is None else image[box]


def _cut_truth(truth: Truth, window: range, *, lens: np.ndarray | None) -> Truth:
    """Return the truth of some frames, with the frame at which the lens first passes it among them."""
    track = None if truth.track is None else truth.track[window.start : window.stop]
    truth = truth if truth.lens is None else replace(truth, lens=lens)
    if not truth.known:
        return replace(truth, track=track)
    frame = truth.frame - window.start
    if not -0.5 <= frame <= len(window) - 0.5:  # it is not the first in these frames, or unknown
        best = truth.position if track is None else track
        crossings = np.empty(0) if lens is None else focus_crossings(np.asarray(lens, np.float64) - best, 0.0)
        frame = float(crossings[0]) if crossings.size else np.nan
    if track is None:
        return replace(truth, frame=frame)
    at = frame
    if np.isnan(frame):  # the position is then that of the frame in which the lens is nearest
        at = 0 if lens is None else float(np.abs(lens - track).argmin())
    return replace(truth, frame=frame, track=track, position=float(np.interp(at, np.arange(len(track)), track)))
