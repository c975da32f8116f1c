"""Judgement of one answer: error, blur, success and lens travel, computed by pure functions of numpy arrays.

An error is the answer minus the truth. The truth is the optical focus of the target, never a frame chosen by hand, so
a stream whose best focus is unknown gives no error in any unit. An abstention or a failure has no error either: it is
counted separately, not as a large error.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from saf_gen.optics.focus_crossings import focus_crossings

SUCCESS_LIMITS_DOF = (0.5, 1.0, 2.0)
"""Largest distances from the truth, in depths of focus, that count as a success."""
MIN_GAIN_RATIO = 1e-3
"""Smallest gain, as a fraction of the light's largest gain; a smaller gain is replaced by it."""


@dataclass(frozen=True)
class Judgement:
    """The errors, blur, success and lens travel of one answer; None means unknown."""

    position: float | None = None
    """Lens position at the answer, as a fraction of the travel."""
    error: float | None = None
    """Answer minus truth, as a fraction of the travel."""
    error_frames: float | None = None
    """Answer minus ``truth_frame``, in frames; None if the lens never crosses the truth."""
    truth: float | None = None
    """Best focus at the answer, or at the first crossing if there is no answer, as a fraction of the travel."""
    truth_frame: float | None = None
    """Frame of the focus crossing nearest to the answer, or of the first crossing if there is no answer."""
    error_dof: float | None = None
    """``error`` divided by the depth of focus, which is the distance between its near and far ends."""
    blur_px: float | None = None
    """Diameter of the target's blur at the answer, in pixels, or in widths that the camera resolves if waves matter."""
    success: tuple[bool | None, ...] = (None,) * len(SUCCESS_LIMITS_DOF)
    """For each of SUCCESS_LIMITS_DOF, whether the answer is a success within that limit."""
    lens_travel: float | None = None
    """Distance that the lens moved, in travels; see travel_to_answer."""


def lens_position(frame: float, focus_position: np.ndarray) -> float:
    """Return the lens position at a frame, as a fraction of the travel.

    Parameters
    ----------
    frame : float
        Frame, counted from 0; may be fractional.
    focus_position : ndarray of float, shape (T,)
        Lens position at the middle of each readout. It is interpolated linearly between readouts, and constant before
        the first and after the last.

    Returns
    -------
    float
        Position, in the unit of ``focus_position``.
    """
    return float(np.interp(frame, np.arange(len(focus_position)), focus_position))


def judged_dof(ends: tuple[float, float]) -> float | None:
    """Return the depth of focus from its two ends, as a fraction of the travel; None unless finite and above 0."""
    width = abs(ends[1] - ends[0])
    return width if math.isfinite(width) and width > 0 else None


def focus_crossing(frame: float | None, *, offset: np.ndarray, truth_frame: float = math.nan) -> float | None:
    """Return the frame nearest to ``frame`` at which the lens crosses the truth, or None if it never does.

    A lens that comes back crosses the truth more than once; while it rests at the truth, every frame is a crossing.

    Parameters
    ----------
    frame : float or None
        Frame of the answer; with None, the first crossing is returned.
    offset : ndarray of float, shape (T,)
        Signed distance of the lens from the truth, in travels.
    truth_frame : float, optional
        Frame of the first crossing that the stream states, used instead of the computed frame; NaN if unknown.

    Returns
    -------
    float or None
        Frame, counted from 0; may be fractional.
    """
    found = focus_crossings(offset, 0.0)
    if math.isfinite(truth_frame):
        found = np.concatenate(([truth_frame], found[1:]))
    if found.size == 0 or frame is None:
        return float(found[0]) if found.size else None
    if lens_position(frame, offset) == 0:
        return frame
    return float(found[np.abs(found - frame).argmin()])


def travel_to_answer(frames_seen: int, answer: float | None, *, focus_position: np.ndarray) -> float:
    """Return the distance that the lens moves during the frames seen and then back to the answer, in travels.

    A full sweep with the focus half way gives 1.5. For an abstention (``answer`` is None), only the frames seen count.
    """
    seen = np.asarray(focus_position[: max(frames_seen, 0)], dtype=np.float64)
    if seen.size == 0:
        return 0.0
    travelled = float(np.abs(np.diff(seen)).sum())
    if answer is None:
        return travelled
    return travelled + abs(float(seen[-1]) - lens_position(answer, focus_position))


def light_ratio(gain: np.ndarray | None) -> float | None:
    """Return the largest gain of a light divided by its smallest gain.

    Parameters
    ----------
    gain : ndarray of float, shape (T, G), or None
        Gain in each readout of each light.

    Returns
    -------
    float or None
        Light ratio, from 1 to 1/MIN_GAIN_RATIO, the value for a light that goes out. With several lights it is the
        largest of their ratios. None if the gains are unknown or no light is ever on.
    """
    if gain is None or gain.size == 0 or not np.isfinite(gain).all():
        return None
    brightest = np.max(gain, axis=0).astype(np.float64)
    on = brightest > 0
    if not on.any():
        return None
    darkest = np.maximum(np.min(gain, axis=0), MIN_GAIN_RATIO * brightest)
    return float((brightest[on] / darkest[on]).max())


def judge(
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
    frame : float or None
        Frame of the answer, counted from 0; may be fractional. None is an abstention.
    frames_seen : int
        Number of frames from the beginning that the method looked at.
    focus_position : ndarray of float, shape (T,), or None
        Lens position at the middle of each readout, as fractions of the travel; None if not recorded.
    truth : float, optional
        Best focus, as a fraction of the travel; NaN if unknown.
    track : ndarray of float, shape (T,), optional
        Best focus over time if the target moves in depth; ``truth`` is then its value at ``truth_frame``.
    truth_frame : float, optional
        Frame at which the lens first crosses the truth; if NaN, it is determined from ``focus_position``.
    ends : tuple of float, optional
        Near and far ends of the depth of focus, as fractions of the travel; NaN if unknown.

    Returns
    -------
    Judgement
        Errors, blur, success and lens travel.

    Notes
    -----
    An abstention is a success only if no answer could have been one, that is, if no lens position of the recording is
    within the limit. A larger limit therefore makes more answers right and fewer abstentions right, and the success
    rate within a small limit can exceed the rate within a larger limit.

    A lens or a track that is not finite in every frame is treated as not recorded. Everything that depends on it is
    None for answers and abstentions alike, whatever the frame of the answer. All methods are thus judged on the same
    recordings, and no method gains by answering where the truth is unknown.

    The blur grows linearly with the distance from the truth and is one pixel at each end of the depth of focus. In
    pixels it is therefore ``|position - truth|`` divided by half the depth of focus. This is exact for a flat target
    and the ``image_distance`` and ``focal_length`` drives (c = 2R·|1 - v/v_o| and c = 2R·v·|1/u_o - 1/u|, both linear
    in the drive's coordinate), and holds to first order for the stage.
    """
    if track is not None and not (math.isfinite(truth) and np.isfinite(track).all()):
        truth, truth_frame, track = math.nan, math.nan, None
    if focus_position is None or len(focus_position) == 0 or not np.isfinite(focus_position).all():
        return Judgement(truth=_finite_or_none(truth), truth_frame=_finite_or_none(truth_frame))
    lens = np.asarray(focus_position, dtype=np.float64)
    offset = lens - (truth if track is None else track)
    crossing = focus_crossing(frame, offset=offset, truth_frame=truth_frame)
    position = None if frame is None else lens_position(frame, lens)
    known = Judgement(
        position=position,
        truth=_finite_or_none(truth if frame is None or track is None else lens_position(frame, track)),
        truth_frame=crossing,
        lens_travel=travel_to_answer(frames_seen, frame, focus_position=lens),
    )
    if known.truth is None:
        return known
    dof = judged_dof(ends)
    if frame is None or position is None:
        if dof is None:
            return known
        nearest = float(np.abs(offset).min()) / dof
        return replace(known, success=tuple(nearest > limit for limit in SUCCESS_LIMITS_DOF))
    error = position - known.truth
    known = replace(known, error=error, error_frames=None if crossing is None else frame - crossing)
    if dof is None:
        return known
    error_dof = error / dof
    success = tuple(abs(error_dof) <= limit for limit in SUCCESS_LIMITS_DOF)
    return replace(known, error_dof=error_dof, blur_px=2 * abs(error_dof), success=success)


def _finite_or_none(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
