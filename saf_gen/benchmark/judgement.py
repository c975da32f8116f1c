"""How one answer is judged: error, blur, success, lens travel. Pure functions of numpy arrays.

An error is answer minus truth. The truth is the optical focus of the target, never a frame chosen by hand, so
a stream whose best focus is unknown gives no error, in any unit. An abstention or a failure has no error
either: it is counted beside the errors, not as a large one.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from saf_gen.optics.focus_crossings import find_focus_crossings

SUCCESS_LIMITS_DOF = (0.5, 1.0, 2.0)
"""The distances from the truth, in depths of focus, within which success is judged."""
MIN_GAIN_RATIO = 1e-3
"""A gain below this fraction of the light's brightest counts as this fraction."""


@dataclass(frozen=True)
class Judgement:
    """The errors, blur, success and lens travel of one answer; None means unknown."""

    position: float | None = None
    """Lens position at the answer, fraction of the travel."""
    error: float | None = None
    """Answer minus truth, fraction of the travel."""
    error_frames: float | None = None
    """Answer minus ``truth_frame``, frames; None where the lens never crosses the truth."""
    truth: float | None = None
    """Best focus at the answer, fraction of the travel; without an answer, when the lens first meets it."""
    truth_frame: float | None = None
    """Frame of the crossing of the truth that is nearest to the answer; of the first crossing without an answer."""
    error_dof: float | None = None
    """``error`` over the depth of focus, the distance between its near and far end."""
    blur_px: float | None = None
    """Diameter of the target's blur at the answer, pixels; where waves count, in widths that the camera resolves."""
    success: tuple[bool | None, ...] = (None,) * len(SUCCESS_LIMITS_DOF)
    """For each of SUCCESS_LIMITS_DOF, whether the answer lies that near."""
    lens_travel: float | None = None
    """Distance that the lens moved, fraction of the travel (see lens_travel)."""


def position_of_method_answer(frame: float, focus_position: np.ndarray) -> float:
    """Return the lens position at a fractional 0-based frame, a fraction of the travel.

    ``focus_position`` (T,) is the lens at the middle of each readout. It is linear between readouts, and its
    end values hold beyond them.
    """
    return float(np.interp(frame, np.arange(len(focus_position)), focus_position))


def judged_depth_of_focus(ends: tuple[float, float]) -> float | None:
    """Return the distance between the near and the far end, fraction of the travel; None unless above 0."""
    width = abs(ends[1] - ends[0])
    return width if math.isfinite(width) and width > 0 else None


def find_judged_focus_crossing(frame: float | None, *, away: np.ndarray, truth_frame: float = math.nan) -> float | None:
    """Return the frame nearest to ``frame`` at which the lens crosses the truth; None for no crossing.

    ``away`` (T,) is the signed distance of the lens from the truth, in travels. A lens that comes back crosses the
    truth more than once; while it rests at the truth, every frame is a crossing. With ``frame`` None the first crossing
    is returned. ``truth_frame`` replaces the first crossing where the stream states it.
    """
    found = find_focus_crossings(away, 0.0)
    if math.isfinite(truth_frame):
        found = np.concatenate(([truth_frame], found[1:]))
    if found.size == 0 or frame is None:
        return float(found[0]) if found.size else None
    if position_of_method_answer(frame, away) == 0:
        return frame
    return float(found[np.abs(found - frame).argmin()])


def lens_travel_to_method_answer(frames_seen: int, answer: float | None, *, focus_position: np.ndarray) -> float:
    """Return how far the lens moved, in travels: over the frames seen, and then back to the answer.

    A full sweep with the focus half way costs 1.5. An abstention (``answer`` None) costs the frames seen alone.
    """
    seen = np.asarray(focus_position[: max(frames_seen, 0)], dtype=np.float64)
    if seen.size == 0:
        return 0.0
    travelled = float(np.abs(np.diff(seen)).sum())
    if answer is None:
        return travelled
    return travelled + abs(float(seen[-1]) - position_of_method_answer(answer, focus_position))


def light_ratio_for_record(gain: np.ndarray | None) -> float | None:
    """Return the brightest over the darkest gain of a light, 1 ... 1/MIN_GAIN_RATIO.

    ``gain`` is (T, G), for each readout and light; with several lights the largest of their ratios counts. A light that
    goes out has 1/MIN_GAIN_RATIO. None where the gains are unknown or no light is ever on.
    """
    if gain is None or gain.size == 0 or not np.isfinite(gain).all():
        return None
    brightest = np.max(gain, axis=0).astype(np.float64)
    on = brightest > 0
    if not on.any():
        return None
    darkest = np.maximum(np.min(gain, axis=0), MIN_GAIN_RATIO * brightest)
    return float((brightest[on] / darkest[on]).max())


def judge_method_answer(
    frame: float | None,
    *,
    frames_seen: int,
    focus_position: np.ndarray | None,
    truth: float = math.nan,
    track: np.ndarray | None = None,
    truth_frame: float = math.nan,
    ends: tuple[float, float] = (math.nan, math.nan),
) -> Judgement:
    """Judge an answer on one recording.

    Parameters
    ----------
    frame : the answer, 0-based and fractional; None abstains.
    frames_seen : how far the method looked at the recording, frames.
    focus_position : (T,) lens at the middle of each readout, fraction of the travel; None if not recorded.
    truth, ends : best focus and the ends of the depth of focus, fraction of the travel; NaN if unknown.
    track : (T,) best focus over time where the target moves in depth; ``truth`` then holds at ``truth_frame``.
    truth_frame : frame at which the lens first crosses the truth; where NaN, it is looked for in ``focus_position``.

    Notes
    -----
    An abstention succeeds only where no answer could have: where no position of the recording lies within
    the limit. So a larger limit makes more answers right and fewer abstentions, and a success rate within a
    small limit can exceed that within a larger one.

    A lens or a track that is not finite in every frame counts as not recorded: what it decides is None, for
    an answer and an abstention alike, wherever the answer lies. So all methods are judged on the same
    recordings, and none gains by answering where nobody knows.

    The blur grows linearly with the distance from the truth and is one pixel at each end of the depth of
    focus, so it is ``|position - truth|`` over half the depth of focus, in pixels: exact for the
    ``image_distance`` and ``focal_length`` drives and a flat target (c = 2R·|1 - v/v_o| and
    c = 2R·v·|1/u_o - 1/u|, both linear in the drive's coordinate), and to first order for the stage.
    """
    if track is not None and not (math.isfinite(truth) and np.isfinite(track).all()):
        truth, truth_frame, track = math.nan, math.nan, None
    if focus_position is None or len(focus_position) == 0 or not np.isfinite(focus_position).all():
        return Judgement(truth=_known(truth), truth_frame=_known(truth_frame))
    lens = np.asarray(focus_position, dtype=np.float64)
    away = lens - (truth if track is None else track)
    crossing = find_judged_focus_crossing(frame, away=away, truth_frame=truth_frame)
    position = None if frame is None else position_of_method_answer(frame, lens)
    known = Judgement(
        position=position,
        truth=_known(truth if frame is None or track is None else position_of_method_answer(frame, track)),
        truth_frame=crossing,
        lens_travel=lens_travel_to_method_answer(frames_seen, frame, focus_position=lens),
    )
    if known.truth is None:
        return known
    dof = judged_depth_of_focus(ends)
    if frame is None or position is None:
        if dof is None:
            return known
        nearest = float(np.abs(away).min()) / dof
        return replace(known, success=tuple(nearest > limit for limit in SUCCESS_LIMITS_DOF))
    error = position - known.truth
    known = replace(known, error=error, error_frames=None if crossing is None else frame - crossing)
    if dof is None:
        return known
    error_dof = error / dof
    success = tuple(abs(error_dof) <= limit for limit in SUCCESS_LIMITS_DOF)
    return replace(known, error_dof=error_dof, blur_px=2 * abs(error_dof), success=success)


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
