"""Judgement of one run: where the lens was at the answer, the truth at that moment, and what the answer cost.

An error is the answer minus the truth. The truth is the optical focus of the target, never a frame chosen by hand, so
a stream whose best focus is unknown gives no error in any unit. An abstention or a failure has no error either: it is
counted separately, not as a large error.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.benchmark.records import UNJUDGED, Judgement, Obstacle
from saf_gen.benchmark.search_run import withhold
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.parts import Answer
from saf_gen.stream.metadata import Truth
from saf_gen.stream.optima import sharpness_lost

MIN_GAIN_RATIO = 1e-3
"""Smallest gain, as a fraction of the light's largest gain; a smaller gain is replaced by it."""
ARRIVAL_TOLERANCE_DOF = 0.25
"""Distance from its last position, in depths of focus, within which the lens counts as arrived."""
DEFAULT_DEPTH_OF_FOCUS = 0.01
"""Depth of focus, as a fraction of the travel, that is assumed for ARRIVAL_TOLERANCE_DOF if it is unknown."""


@dataclass(frozen=True, eq=False)
class Run:
    """What a method did on a sequence.

    Attributes
    ----------
    answer : Answer
        Answer of the method.
    problem : str
        Why the method failed, or ''.
    path : ndarray of float, shape (T,)
        Lens position at each frame, as fractions of the travel. Recorded track: at each frame of the recording; empty
        if it states none. Closed loop: at each frame up to the end, when the lens stands where the method sent it.
    frames_seen : int
        Number of frames up to the last one that the method looked at; in the closed loop, until the method was done.
    windows : int
        Number of windows that the method scored or looked at.
    seconds : float
        Computing time of the method, in seconds.
    operations : float or None
        Operations that the method declares, of all windows that it scored or looked at; None if it is charged none.
    reference_rate : float or None
        Operations per second of a reference measure on the same region; None if ``operations`` is.
    commands : tuple of float
        Closed loop: initial position of the lens, followed by every position to which it was sent. () in the recorded
        track, where no method moves the lens.
    """

    answer: Answer
    problem: str
    path: np.ndarray
    frames_seen: int
    windows: int
    seconds: float
    operations: float | None = None
    reference_rate: float | None = None
    commands: tuple[float, ...] = ()


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


def judge(run: Run, truth: Truth, *, end_s: Callable[[int], float], obstacle: Obstacle | None = None) -> Judgement:
    """Judge what a method did on a sequence, on either track.

    Parameters
    ----------
    run : Run
        The run of the method.
    truth : Truth
        Truth of the recording. If the target moves in depth, ``track`` has its best focus at each frame.
    end_s : callable
        Returns the seconds from the beginning to the end of a number of frames.
    obstacle : str, optional
        What keeps every method from the focus; with one of UNJUDGED, no answer counts.

    Returns
    -------
    Judgement
        Answer, truth and cost; optimum and grain of the measure are left out.

    Notes
    -----
    The tracks differ in the moment that is judged. In a recording it is the frame that a method answers with, wherever
    it looked; the lens goes on, and is brought back to that frame, at the cost of the way. A method of the closed loop
    moves the lens itself, and is judged by where the lens stands in the end; the truth is that of the end, too, even
    if the method gives no answer.

    A lens or a track that is not finite in every frame is treated as not recorded. Everything that depends on it is
    None for answers and abstentions alike, whatever the frame of the answer. All methods are thus judged on the same
    recordings, and no method gains by answering where the truth is unknown.
    """
    answer = withhold(run.answer, f"the recording has {obstacle}" if obstacle in UNJUDGED else "")
    answered = not run.problem and (answer.frame is not None or answer.position is not None)
    in_loop, dof, path = bool(run.commands), judged_dof(truth.depth_of_focus), _finite_path(run.path)
    moment = None if path is None else float(len(path) - 1) if in_loop else answer.frame
    best, first_frame, track = truth.position, truth.frame, truth.track
    if track is not None and not (math.isfinite(best) and np.isfinite(track).all()):
        best, first_frame, track = math.nan, math.nan, None
    focus = best if moment is None or track is None else lens_position(moment, track)
    position = lens_position(moment, path) if answered and moment is not None and path is not None else None
    if in_loop or path is None:  # where a method moves the lens past the focus is its own making, and no truth
        truth_frame = None if in_loop else _finite_or_none(first_frame)
    else:
        offset = path - (best if track is None else track)
        truth_frame = focus_crossing(answer.frame, offset=offset, truth_frame=first_frame)
    travel = None
    if path is not None:
        stop = len(path) if in_loop else run.frames_seen
        travel = travel_to_answer(stop, moment if answered else None, focus_position=path)
    looked = bool(run.windows if in_loop else run.frames_seen)
    if not looked and not travel:  # neither looked nor moved: there is no cost to compare
        travel = None
    arrived = run.frames_seen
    if in_loop and path is not None and position is not None:
        off = np.abs(path[arrived:] - position) > ARRIVAL_TOLERANCE_DOF * (dof or DEFAULT_DEPTH_OF_FOCUS)
        arrived += int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
    at_rest = position if track is None else None  # curves of moving scenes are not kept
    done = float(run.frames_seen) if in_loop and not run.problem else answer.frame
    return Judgement(
        status="failed" if run.problem else "answered" if answered else "abstained",
        frames_seen=run.frames_seen,
        position=position,
        frame=None if done is None else float(done),
        truth=_finite_or_none(focus),
        truth_frame=truth_frame,
        depth_of_focus=dof,
        trace=tuple(float(x) for x in answer.trace),
        note=run.problem or answer.note,
        windows=run.windows,
        seconds=run.seconds,
        operations=run.operations,
        reference_rate=run.reference_rate,
        lens_travel=travel,
        reversals=count_reversals(run.commands) if in_loop else None,
        time_to_focus_s=end_s(arrived) if answered and (looked or travel) else None,
        sharpness_lost=None if at_rest is None or dof is None else sharpness_lost(truth.sharpness, at_rest, dof=dof),
    )


def count_reversals(positions: Sequence[float]) -> int:
    """Return the number of times that a lens changes direction if it is sent to these positions in turn."""
    directions = np.sign(np.diff(positions))
    directions = directions[directions != 0]
    return int((directions[1:] != directions[:-1]).sum())


def _finite_path(path: np.ndarray) -> np.ndarray | None:
    """Return a path as float64, None if it is empty or unknown in any frame."""
    return np.asarray(path, dtype=np.float64) if len(path) and np.isfinite(path).all() else None


def _finite_or_none(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
