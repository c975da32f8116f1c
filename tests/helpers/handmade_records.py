"""Records made by hand, for tests of the leaderboard, its figures and its page."""

from dataclasses import replace

from saf_gen.benchmark.records import Record

BLANK = Record(
    method="sd+argmax", sequence="s0", split="test", scene="camel", light="constant", status="answered",
    position=0.5, frame=400.0, truth=0.5, truth_frame=400.0, error=0.0, error_frames=0.0, error_dof=0.0, blur_px=0.0,
    success_half_dof=True, success_1dof=True, success_2dof=True, trace=(), frames=800, frames_seen=800,
    lens_travel=1.5, windows=8, seconds=0.25, note="", region="target", data="d0", code="c0", rig="r0",
)  # fmt: skip


def record(method, sequence, error_dof, *, scene="camel", light="constant", **more):
    """Return an answer ``error_dof`` from the truth; a depth of focus is a tenth of the travel, or 80 frames."""
    within = [None if error_dof is None else abs(error_dof) <= limit for limit in (0.5, 1, 2)]
    plain = {
        "error_dof": error_dof,
        "error": None if error_dof is None else error_dof / 10,
        "error_frames": None if error_dof is None else error_dof * 80,
        "success_half_dof": within[0],
        "success_1dof": within[1],
        "success_2dof": within[2],
        "data": f"sha-{sequence}",
        "code": f"code-{method}",
    }
    return replace(BLANK, method=method, sequence=sequence, scene=scene, light=light, **{**plain, **more})


def failed(method, sequence, status, **more):
    no_success = dict.fromkeys(("success_half_dof", "success_1dof", "success_2dof"), False)
    return replace(record(method, sequence, None, **more), status=status, frame=None, position=None, **no_success)
