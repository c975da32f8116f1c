"""How one answer is judged: error, blur, success, lens travel. Pure functions of numpy arrays.

Error is answer minus truth. The truth is the optical focus of the target, never a frame chosen by hand, so
a stream whose position of best focus is unknown gets no error at all, in no unit. An abstention or a failure
has no error either: it is counted beside the errors, not as a large one.
"""

import math
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

__all__ = [
    "WITHIN",
    "Judgement",
    "Record",
    "depth_of_focus",
    "judge",
    "lens_travel",
    "position_at",
    "record_to_json",
]

WITHIN = (0.5, 1.0, 2.0)
"""Success is judged within these many depths of focus of the truth."""


@dataclass(frozen=True)
class Judgement:
    """What an answer was worth. None stands for unknown, everywhere."""

    position: float | None
    """Lens at the answer, fraction of the travel."""
    error: float | None
    """Answer minus truth, fraction of the travel."""
    error_frames: float | None
    """Answer minus the frame at which the sweep passes the truth; None where it never does."""
    error_dof: float | None
    """``error`` over the depth of focus, the distance between its near and far end."""
    blur_px: float | None
    """Diameter of the target's blur at the answer, pixels."""
    success: tuple[bool | None, ...]
    """For each of WITHIN: whether the answer lies so near."""
    lens_travel: float | None
    """Way of the lens, fraction of the travel (see lens_travel)."""


@dataclass(frozen=True)
class Record:
    """One method on one sequence. None is unknown or not there; positions are fractions of the travel."""

    method: str
    sequence: str
    split: str | None
    scene: str
    light: str | None
    status: Literal["answered", "abstained", "failed"]
    position: float | None
    frame: float | None
    truth: float | None
    truth_frame: float | None
    error: float | None
    error_frames: float | None
    error_dof: float | None
    blur_px: float | None
    success_half_dof: bool | None
    success_1dof: bool | None
    success_2dof: bool | None
    trace: tuple[float, ...]
    frames: int
    frames_seen: int
    lens_travel: float | None
    windows: int
    seconds: float
    note: str
    region: str
    data: str
    """content_sha256 of the stream."""
    code: str
    """Method.code."""


def position_at(frame: float, focus_position: np.ndarray) -> float:
    """Lens position at a fractional 0-based frame, fraction of the travel, linear between readouts.

    ``focus_position`` (T,) is the lens at the middle of each readout; beyond its ends the ends hold.
    """
    return float(np.interp(frame, np.arange(len(focus_position)), focus_position))


def depth_of_focus(ends: tuple[float, float]) -> float | None:
    """Distance between the near and the far end, fraction of the travel; None unless it is above zero."""
    width = abs(ends[1] - ends[0])
    return width if math.isfinite(width) and width > 0 else None


def lens_travel(frames_seen: int, answer: float | None, focus_position: np.ndarray) -> float:
    """Way of the lens to an answer, in travels: the sweep over the frames seen, then back to the answer.

    A full sweep with the focus half way costs 1.5. An abstention (``answer`` None) brings the lens
    nowhere, so it costs the sweep alone.
    """
    seen = np.asarray(focus_position[: max(frames_seen, 0)], dtype=np.float64)
    if seen.size == 0:
        return 0.0
    way = float(np.abs(np.diff(seen)).sum())
    return way if answer is None else way + abs(float(seen[-1]) - position_at(answer, focus_position))


def judge(
    frame: float | None,
    *,
    frames_seen: int,
    focus_position: np.ndarray | None,
    truth: float = math.nan,
    truth_frame: float = math.nan,
    ends: tuple[float, float] = (math.nan, math.nan),
) -> Judgement:
    """Judge the answer ``frame`` (0-based, fractional; None abstains) of one recording.

    Parameters
    ----------
    frames_seen : the recording as far as the method looked at it, frames.
    focus_position : (T,) lens at the middle of each readout, fraction of the travel; None if not recorded.
    truth, ends : best focus and the ends of the depth of focus, fraction of the travel; NaN if unknown.
    truth_frame : the frame at which the sweep passes the truth; NaN if it never does.

    An abstention succeeds only where no answer could have: no position of the sweep lies within the limit.

    The blur grows linearly with the distance from the truth and is one pixel at each end of the depth of
    focus, so it is ``|position - truth|`` over half the depth of focus, in pixels: exact for the
    ``image_distance`` and ``focal_length`` drives and a flat target (c = 2R·|1 - v/v_o| and
    c = 2R·v·|1/u_o - 1/u|, both linear in the drive's coordinate), and to first order for the stage.
    """
    if focus_position is None or len(focus_position) == 0:
        return Judgement(None, None, None, None, None, (None,) * len(WITHIN), None)
    position = None if frame is None else position_at(frame, focus_position)
    way = lens_travel(frames_seen, frame, focus_position)
    if not math.isfinite(truth):
        return Judgement(position, None, None, None, None, (None,) * len(WITHIN), way)
    dof = depth_of_focus(ends)
    if frame is None or position is None:
        success: tuple[bool | None, ...] = (None,) * len(WITHIN)
        if dof is not None:
            nearest = float(np.abs(np.asarray(focus_position, dtype=np.float64) - truth).min()) / dof
            success = tuple(nearest > limit for limit in WITHIN)
        return Judgement(None, None, None, None, None, success, way)
    error = position - truth
    error_frames = frame - truth_frame if math.isfinite(truth_frame) else None
    if dof is None:
        return Judgement(position, error, error_frames, None, None, (None,) * len(WITHIN), way)
    error_dof = error / dof
    success = tuple(abs(error_dof) <= limit for limit in WITHIN)
    return Judgement(position, error, error_frames, error_dof, 2 * abs(error_dof), success, way)


def record_to_json(record: Record) -> dict[str, Any]:
    """The record as JSON knows it: a number that is not finite is null, a tuple a list."""
    return {f.name: _plain(getattr(record, f.name)) for f in fields(record)}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
