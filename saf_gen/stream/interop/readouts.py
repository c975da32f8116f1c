"""Readouts that a recording holds twice or has lost, as a table of its frame counters or time stamps states them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.stream.interop.bad_pixels import read_table

SECONDS = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6}
NUMBERS = ("readout", "counter")
MAX_DRIFT = 0.02
"""Largest difference of the mean step of many time stamps from one readout."""
MAX_JITTER = 0.3
"""Largest distance of a step between two time stamps from whole readouts."""


@dataclass(frozen=True, eq=False)
class Readouts:
    """The readout that each frame of a file is.

    Attributes
    ----------
    number : ndarray of int64, shape (frames of the file,)
        Number of the camera's readout, from 0: equal to that of the frame before for a copy, and higher by more than 1
        after lost readouts.
    """

    number: np.ndarray

    @property
    def kept(self) -> np.ndarray:
        """The frames that are not copies, bool (frames of the file,)."""
        return np.diff(self.number, prepend=-1) > 0

    @property
    def of_kept(self) -> np.ndarray:
        """Number of the readout of each frame that is kept, int64."""
        return self.number[self.kept]

    @property
    def of_gaps(self) -> np.ndarray | None:
        """The same, or None if no readout is lost, so that they follow each other."""
        return None if (np.diff(self.of_kept) == 1).all() else self.of_kept

    def at(self, frame: np.ndarray) -> np.ndarray:
        """Return the readout, possibly fractional, at a possibly fractional frame of the file."""
        inside = np.interp(frame, np.arange(self.number.size), self.number)
        return inside + np.minimum(frame, 0) + np.maximum(frame - (self.number.size - 1), 0)

    def kept_frame(self, frame: float) -> float:
        """Return the frame among those that are kept of a possibly fractional frame of the file."""
        return float(np.interp(frame, np.arange(self.number.size), np.cumsum(self.kept) - 1))

    def describe(self) -> list[str]:
        """Return a line on copies and a line on lost readouts, where there are any."""
        steps = np.diff(self.number)
        copies, gaps = np.flatnonzero(steps == 0) + 1, np.flatnonzero(steps > 1) + 1
        lost = int((steps[steps > 1] - 1).sum())
        lines = []
        if copies.size:
            lines.append(f"doubled readouts: {copies.size:,}, left out ({_list_frames(copies)})")
        if gaps.size:
            many = f"{lost:,} in {gaps.size:,} {'gap' if gaps.size == 1 else 'gaps'}"
            lines.append(f"lost readouts: {many} (before {_list_frames(gaps)})")
        return lines


def _list_frames(frames: np.ndarray) -> str:
    shown = ", ".join(f"{frame:,}" for frame in frames[:5].tolist())
    return f"{'frame' if frames.size == 1 else 'frames'} {shown}{', …' * (frames.size > 5)}"


def read_times(path: Path, *, frames: int, total: int, readout_hz: float) -> Readouts:
    """Return the readouts that a CSV file states, for the first ``frames`` frames of a recording of ``total`` frames.

    The file has one row for each frame of the recording, with its time (``seconds``, ``milliseconds`` or
    ``microseconds``) or the camera's own number (``readout`` or ``counter``); a column ``frame`` may stand before it.

    Raises BadInput if the table cannot be read, has another number of rows, counts frames otherwise than from 0, or
    goes back; or if time stamps step by anything else than whole readouts.
    """
    kinds = (*NUMBERS, *SECONDS)
    table = read_table(path, (*kinds, *(f"frame,{kind}" for kind in kinds)))
    frame = table.pop("frame", None)
    ((kind, value),) = table.items()
    if value.size not in (frames, total):
        raise BadInput(
            f"has {value.size} rows", where=str(path), allowed=f"{total}, one for each frame of the recording"
        )
    if frame is not None and (wrong := np.flatnonzero(frame != np.arange(frame.size))).size:
        raise BadInput(f"frame is {frame[wrong[0]]:g} in row {wrong[0]}", where=str(path), allowed="0, 1, 2 and so on")
    if kind in NUMBERS and (wrong := np.flatnonzero(value % 1)).size:
        raise BadInput(f"{kind} is {value[wrong[0]]:g}", where=str(path), allowed="whole numbers")
    steps = np.diff(value[:frames])
    if (back := np.flatnonzero(steps < 0)).size:
        raise BadInput(
            f"{kind} goes from {value[back[0]]:g} to {value[back[0] + 1]:g}", where=str(path),
            allowed="a column that never falls", hint="add the size of the counter where it began again",
        )  # fmt: skip
    if kind in SECONDS:
        steps = _whole_steps(steps * SECONDS[kind] * readout_hz, path=path, readout_hz=readout_hz)
    return Readouts(np.concatenate([[0], np.cumsum(steps)]).astype(np.int64))


def _whole_steps(steps: np.ndarray, *, path: Path, readout_hz: float) -> np.ndarray:
    """Return steps between time stamps, in readouts, as whole numbers; raise BadInput if they are not nearly whole."""
    single = steps[np.abs(steps - 1) < 0.5]
    usual = float(single.mean()) if single.size else float(np.median(steps)) if steps.size else 1.0
    if abs(usual - 1) > MAX_DRIFT + MAX_JITTER / np.sqrt(max(single.size, 1)):
        raise BadInput(
            f"the usual step of the time stamps is {usual:.4g} readouts", where=str(path), allowed="about 1",
            hint=f"is the unit of time right, and --rate {readout_hz:g}?",
        )  # fmt: skip
    steps = steps / usual
    whole = np.rint(steps)
    if (uneven := np.flatnonzero(np.abs(steps - whole) > MAX_JITTER)).size:
        raise BadInput(
            f"the time stamps step by {steps[uneven[0]]:.2f} readouts after frame {uneven[0]}", where=str(path),
            allowed=f"whole readouts within {MAX_JITTER}", hint="a column `readout` says which readout a frame is",
        )  # fmt: skip
    return whole
