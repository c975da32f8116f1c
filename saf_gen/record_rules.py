"""What can be true of a record: the range of its numbers, and what follows from what.

The rules are those of :mod:`saf_gen.scores` and of both tracks, read backwards. Tables divide by these
numbers and believe them, so what breaks a rule is refused where it is read.
"""

from itertools import pairwise
from typing import TYPE_CHECKING

from saf_gen.scores import WITHIN

if TYPE_CHECKING:
    from saf_gen.records import Record

__all__ = ["LONG", "MOST", "RANGES", "contradiction"]

MOST = 2**53
"""Of whole numbers: a float holds each of them up to here."""
LONG = 1e9
"""Seconds or travels: more than there will be, and means of it are finite."""
FAR = 1e100
"""Positions and errors, in any unit: the same."""
RANGES = {
    "frames": (1, MOST),
    "frames_seen": (0, MOST),
    "windows": (0, MOST),
    "variant": (0, MOST),
    "reversals": (0, MOST),
    "seconds": (0, LONG),
    "time_to_focus_s": (0, LONG),
    "lens_travel": (0, LONG),
    "mean_rate": (0, LONG),
    "light_ratio": (1, LONG),
    "blur_px": (0, FAR),
    "focus_place": (0, 1),
    "focus_off_dof": (0, FAR),
    **dict.fromkeys(("position", "truth", "truth_first", "truth_frame"), (-FAR, FAR)),
    **dict.fromkeys(("error", "error_frames", "error_dof"), (-FAR, FAR)),
}
"""The least and the most that a number of a record can be, where it is known."""


def contradiction(r: "Record") -> tuple[str, str] | None:
    """What in a record cannot be true at once, and what could; None where all can.

    An answer is a success where its error is within the limit. An abstention is one where no answer could
    have been, and has no error; where the truth is unknown there is neither. A frame of the closed loop
    is when the method was done, of an abstention too. A focus that the lens stays away from lies nowhere.
    """
    if r.frames_seen > r.frames:
        return f"frames_seen is {r.frames_seen} of {r.frames} frames", f"0 to {r.frames}"
    success = (r.success_half_dof, r.success_1dof, r.success_2dof)
    if len({s is None for s in success}) > 1:
        return "success is known within some limits and not within others", "all three, or null in all"
    if r.status != "answered":
        for name in ("position", "error", "error_frames", "error_dof", "blur_px", "time_to_focus_s"):
            if getattr(r, name) is not None:
                return f"{r.status}, with {name} {getattr(r, name):g}", "null where there is no answer"
    if r.status == "failed" and any(success):
        return "failed, with success", "false, or null where the truth is unknown"
    if r.status == "abstained" and any(far and not near for near, far in pairwise(success)):
        return "abstained, right within a larger limit and not within a smaller one", "the other way round"
    off = r.focus_off_dof
    if off is not None and off > WITHIN[1] and r.focus_place is not None:
        return f"focus_place is {r.focus_place:g}, and the lens stays {off:g} DoF away", "null beyond 1 DoF"
    if r.track == "recorded" and r.status == "abstained" and off is not None and success[0] is not None:
        right = tuple(off > limit for limit in WITHIN)
        if success != right:
            said = ", ".join(map(str, success))
            return f"abstained {off:g} DoF from the focus, and success {said}", ", ".join(map(str, right))
    if r.track == "recorded" and (r.frame is not None) != (r.status == "answered"):
        return f"{r.status}, with frame {r.frame}", "a frame where there is an answer, else null"
    if r.frame is not None and not -0.5 <= r.frame <= r.frames:
        return f"frame is {r.frame:g} of {r.frames} frames", f"-0.5 to {r.frames}"
    if r.error is not None and r.truth is None:
        return f"error is {r.error:g}, and there is no truth", "null where the truth is unknown"
    if r.error is None and (r.error_dof is not None or r.blur_px is not None):
        return "an error in depths of focus or a blur, and error is null", "null in all three"
    if r.error_dof is not None:
        right = tuple(abs(r.error_dof) <= limit for limit in WITHIN)
        if success != right:
            said = ", ".join(map(str, success))
            return f"error_dof is {r.error_dof:g}, and success {said}", ", ".join(map(str, right))
    elif r.status == "answered" and any(success):
        return "a success, and error_dof is null", "success false or null where the error is unknown"
    return None
