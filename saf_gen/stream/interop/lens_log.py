"""Logs of a real camera that are stored with its spikes: light, position of the lens, and true focus."""

from pathlib import Path

import numpy as np

from saf_gen.core.config.document import read_text
from saf_gen.core.csv_table import MAX_LOG_BYTES, find_heading, parse_columns
from saf_gen.errors import BadInput
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.stream.interop.readouts import SECONDS, Readouts
from saf_gen.stream.metadata import Truth

TIMES = ("frame", *SECONDS)
MIN_COVERED = 0.5
"""Fraction of a recording that its log should cover; elsewhere, the lens is taken to rest."""
MAX_LENGTHS = 2.0
"""Length of a log, in recordings, above which its times or the readout rate may have another unit."""


def import_lens_log(
    path: str | Path, *, frames: int, readout_hz: float, readouts: Readouts | None = None
) -> np.ndarray:
    """Return the position of the lens at each readout, float32 (frames,), as a fraction of its travel.

    The file is a CSV table with the heading ``frame,position`` or ``seconds,position`` (or ``milliseconds``,
    ``microseconds``), in which the first column increases. A frame number means the middle of that readout. Positions
    between two rows are interpolated linearly; the lens rests before the first row and after the last. ``readouts``
    says which readouts the frames of the file are, if some were lost or doubled; the result is then for its ``frames``
    that are kept.

    Raises BadInput if the heading differs, a row does not match it, a position is outside 0 to 1, or no part of the
    log is within the recording.
    """
    (position,) = _read_log(Path(path), "position", frames=frames, readout_hz=readout_hz, readouts=readouts).values()
    outside = position[(position < 0) | (position > 1)]
    if outside.size:
        raise BadInput(
            f"a position is {outside[0]:g}",
            where=str(path),
            allowed="fractions of the travel, 0 to 1",
            hint="scale the log",
        )
    return position


def import_light_log(
    path: str | Path, *, frames: int, readout_hz: float, readouts: Readouts | None = None
) -> dict[str, np.ndarray]:
    """Return the gain of each light at each readout, float32 (frames,), by name; 1 is nominal.

    The file is a CSV table like that of :func:`import_lens_log`, with one column for each light: ``seconds,lamp`` or
    ``frame,lamp,window``.

    Raises BadInput if the heading differs, a row does not match it, names are empty or equal, a gain is below 0, or no
    part of the log is within the recording.
    """
    gains = _read_log(Path(path), None, frames=frames, readout_hz=readout_hz, readouts=readouts)
    for name, gain in gains.items():
        if gain.min() < 0:
            raise BadInput(f"a gain of {name} is {gain.min():g}", where=str(path), allowed="0 and above")
    return gains


def _read_log(
    path: Path, column: str | None, *, frames: int, readout_hz: float, readouts: Readouts | None
) -> dict[str, np.ndarray]:
    """Return the columns after the first at each readout, by name; if ``column`` is given, no other is allowed."""
    at, columns = _read_table(path, column, readout_hz=readout_hz, readouts=readouts)
    wanted = np.arange(frames) if readouts is None else readouts.of_kept
    if at[-1] < -0.5 or at[0] > wanted[-1] + 0.5:
        raise BadInput(
            f"the log covers frames {at[0]:.0f} to {at[-1]:.0f}",
            where=str(path),
            allowed=f"at least one row in frames 0 to {wanted[-1]}",
        )
    return {name: np.interp(wanted, at, values).astype(np.float32) for name, values in columns.items()}


def describe_coverage(
    path: str | Path, *, frames: int, readout_hz: float, readouts: Readouts | None = None
) -> tuple[str, bool]:
    """Return a line on how much of a recording a log covers, and whether that is suspicious.

    It is if less than MIN_COVERED of the recording is covered, or if the log is longer than MAX_LENGTHS recordings.
    Raises BadInput if the log cannot be read.
    """
    at, _ = _read_table(Path(path), None, readout_hz=readout_hz, readouts=readouts)
    length = frames if readouts is None else int(readouts.number[-1]) + 1
    covered = max(min(at[-1], length - 0.5) - max(at[0], -0.5), 0.0) / length
    lengths = (at[-1] - at[0]) / length
    line = f"{len(at)} rows, which cover {covered:.0%} of the recording"
    if lengths > MAX_LENGTHS:
        line += f" and are {lengths:.3g} times as long: is the unit of time right, and --rate {readout_hz:g}?"
    elif covered < MIN_COVERED:
        line += f": the lens is taken to rest elsewhere; is the unit of time right, and --rate {readout_hz:g}?"
    return line, covered < MIN_COVERED or lengths > MAX_LENGTHS


def _read_table(
    path: Path, column: str | None, *, readout_hz: float, readouts: Readouts | None
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the readout of each row, possibly fractional, and the columns after the first by name."""
    text = read_text(path, max_bytes=MAX_LOG_BYTES).removeprefix("\ufeff")
    heading = tuple(cell.strip() for cell in find_heading(text)[1].split(","))
    kinds = heading[1:]
    fits = kinds == (column,) if column else kinds and all(kinds) and len(set(kinds)) == len(kinds)
    if heading[0] not in TIMES or not fits:
        raise BadInput(
            f"the columns are {','.join(heading)!r}",
            where=str(path),
            allowed=" or ".join(f"{time},{column or 'NAME,NAME…'}" for time in TIMES),
        )
    when, *values = parse_columns(text, heading, name=str(path))
    if heading[0] == "frame":
        at = when if readouts is None else readouts.at(when)
    else:
        at = when * SECONDS[heading[0]] * readout_hz - 0.5
    return at, dict(zip(kinds, values, strict=True))


def truth_from_text(
    text: str,
    *,
    focus_position: np.ndarray | None,
    depth_of_focus: tuple[float, float] | None = None,
    readouts: Readouts | None = None,
) -> Truth:
    """Return the true focus that a user states: a position such as "0.42", or a frame of the lens log, "frame:812".

    ``focus_position`` holds a position for each frame that is kept of the file, whose ``readouts`` say which these are.
    ``depth_of_focus`` holds the two positions between which the target is sharp. With it, answers can be counted as
    successes; without it, they have only errors.

    Raises BadInput if the text is neither a position nor a frame, a value is not allowed, a frame is stated without a
    log, or the depth of focus does not contain the truth.
    """
    kind, _, number = text.rpartition(":")
    try:
        value = float(number)
    except ValueError:
        value = np.nan
    lens = np.empty(0) if focus_position is None else focus_position
    if kind == "frame" and not lens.size:
        raise BadInput(
            f"truth is {text!r}, but there is no lens log", allowed="a position from 0 to 1", hint="add --focus"
        )
    last = lens.size - 1 if readouts is None else readouts.number.size - 1
    if kind not in ("", "frame") or not 0 <= value <= (last if kind else 1):
        allowed = "a position from 0 to 1, or frame:N" + (f" with N from 0 to {last}" if lens.size else "")
        raise BadInput(f"truth is {text!r}", allowed=allowed)
    if kind:
        frame = value if readouts is None else readouts.kept_frame(value)
        position = float(np.interp(frame, np.arange(lens.size), lens))
    else:
        passed = focus_crossings(lens, value)
        frame, position = (float(passed[0]) if passed.size else np.nan), value
    if depth_of_focus is None:
        return Truth(position, frame=frame)
    if not 0 <= depth_of_focus[0] <= position <= depth_of_focus[1] <= 1:
        raise BadInput(
            f"depth of focus is {depth_of_focus[0]:g} to {depth_of_focus[1]:g}",
            allowed=f"two positions from 0 to 1, the truth {position:g} between them",
        )
    return Truth(position, depth_of_focus, frame)
