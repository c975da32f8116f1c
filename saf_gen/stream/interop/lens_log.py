"""What is known beside the spikes of a real camera: where its lens was, and where it should have been."""

from pathlib import Path

import numpy as np

from saf_gen.core.config.document import read_text
from saf_gen.core.csv_table import parse_csv_columns
from saf_gen.core.focus_crossings import find_focus_crossings
from saf_gen.errors import BadInput
from saf_gen.stream.metadata import Truth

HEADINGS = ("frame", "position"), ("seconds", "position")


def read_lens_log(path: str | Path, *, frames: int, readout_hz: float) -> np.ndarray:
    """Return the position of the lens at each readout, float32 (frames,), fraction of its travel.

    The file is a CSV table with the heading ``frame,position`` or ``seconds,position``; its first column rises. A
    frame stands for the middle of its readout. Between two rows the lens moves in a straight line, before the first and
    after the last it rests.

    Raises BadInput for another heading, a row that does not fit, a position outside 0 to 1, and a table that has no row
    within the recording.
    """
    text = read_text(Path(path))
    lines = (line for line in text.splitlines() if line.strip() and not line.startswith("#"))
    heading = tuple(cell.strip() for cell in next(lines, "").split(","))
    if heading not in HEADINGS:
        raise BadInput(
            f"the columns are {','.join(heading)!r}",
            where=str(path),
            allowed=" or ".join(",".join(names) for names in HEADINGS),
        )
    when, position = parse_csv_columns(text, heading, name=str(path))
    outside = position[(position < 0) | (position > 1)]
    if outside.size:
        raise BadInput(
            f"position {outside[0]:g}", where=str(path), allowed="fractions of the travel, 0 to 1", hint="scale the log"
        )
    at = when if heading[0] == "frame" else when * readout_hz - 0.5
    if at[-1] < 0 or at[0] > frames - 1:
        raise BadInput(
            f"the log covers frames {at[0]:.0f} to {at[-1]:.0f}", where=str(path), allowed=f"a row in 0 to {frames - 1}"
        )
    return np.interp(np.arange(frames), at, position).astype(np.float32)


def truth_from_text(
    text: str, *, focus_position: np.ndarray | None, depth_of_focus: tuple[float, float] | None = None
) -> Truth:
    """Return the true focus that a user names: a position such as "0.42", or a frame of the lens log, "frame:812".

    ``depth_of_focus`` are the positions, near and far, between which the target is sharp: with them answers can be
    counted as right, without them they have errors alone. Raises BadInput for a text that is neither, a value that is
    not allowed, a frame without a log, and a depth of focus that does not hold the truth.
    """
    kind, _, number = text.rpartition(":")
    try:
        value = float(number)
    except ValueError:
        value = np.nan
    lens = np.empty(0) if focus_position is None else focus_position
    if kind == "frame" and not lens.size:
        raise BadInput(f"truth is {text!r} without a lens log", allowed="a position from 0 to 1", hint="add --focus")
    if kind not in ("", "frame") or not 0 <= value <= (lens.size - 1 if kind else 1):
        allowed = "a position from 0 to 1, or frame:N" + (f" with N from 0 to {lens.size - 1}" if lens.size else "")
        raise BadInput(f"truth is {text!r}", allowed=allowed)
    if kind:
        frame, position = value, float(np.interp(value, np.arange(lens.size), lens))
    else:
        passed = find_focus_crossings(lens, value)
        frame, position = (float(passed[0]) if passed.size else np.nan), value
    if depth_of_focus is None:
        return Truth(position, frame=frame)
    if not 0 <= depth_of_focus[0] <= position <= depth_of_focus[1] <= 1:
        raise BadInput(
            f"depth of focus is {depth_of_focus[0]:g} to {depth_of_focus[1]:g}",
            allowed=f"two positions from 0 to 1, the truth {position:g} between them",
        )
    return Truth(position, depth_of_focus, frame)
