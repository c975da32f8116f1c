"""Records made by hand, for tests of the leaderboard, its figures and its page."""

from dataclasses import fields, replace

from saf_gen.benchmark.records import Judgement, Record, What, Who

BLANK = Record(
    Who("sd+argmax", "c0", "target"),
    What("s0", split="test", scene="camel", light="constant", frames=800, data="d0", rig="r0", focus_off_dof=0.0),
    Judgement(
        "answered", 800, position=0.0, frame=400.0, truth=0.0, truth_frame=400.0, depth_of_focus=0.125, lens_travel=1.5,
        windows=8, seconds=0.25,
    ),
)  # fmt: skip


def change(record, **values):
    """Return a record with other values, by their keys in a line of ``records.jsonl``."""
    for name in ("who", "what", "judgement"):
        part = getattr(record, name)
        own = {f.name: values.pop(f.name) for f in fields(part) if f.name in values}
        record = replace(record, **{name: replace(part, **own)})
    assert not values, f"no keys of a record: {values}"
    return record


def record(method, sequence, error_dof, *, scene="camel", light="constant", **more):
    """Return an answer ``error_dof`` from the truth, exactly; None means that the truth is unknown.

    A depth of focus is an eighth of the travel, or 100 frames; the frame is at most at an end of the recording.
    """
    error = error_dof or 0.0
    plain = {
        "position": error / 8,
        "frame": min(max(400.0 + 100 * error, 0.0), 800.0),
        "data": f"sha-{sequence}",
        "code": f"code-{method}",
    }
    plain |= {"truth": None, "truth_frame": None} if error_dof is None else {}
    return change(BLANK, method=method, sequence=sequence, scene=scene, light=light, **{**plain, **more})


def failed(method, sequence, status, **more):
    """Return a failure or an abstention, which is wrong, because the lens came to the focus."""
    return change(record(method, sequence, 0.0, **more), status=status, frame=None, position=None)
