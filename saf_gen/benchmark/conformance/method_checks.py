"""Checks of a complete method, on small recordings and on a running camera."""

import tempfile
from functools import partial
from pathlib import Path

from saf_gen.benchmark.conformance._answer_checks import check_answer_frame, check_same_answers
from saf_gen.benchmark.conformance._check_result import CheckWarning
from saf_gen.benchmark.conformance._check_runner import Check, CheckLimits
from saf_gen.benchmark.conformance._conformance_scene import BEST_FOCUS, write_recordings
from saf_gen.benchmark.conformance.estimating_search_checks import recording_length
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.view import RecordingView, WindowCounts
from saf_gen.parts import Answer, commands
from saf_gen.stream.stream_file import open_stream

MIN_FRAMES = 4000  # makes windows long enough to contain a spike or two
TOLERANCE = 0.1  # fraction of the travel
ACTUATOR = "voice_coil_hall"


def method_checks(method: Method, limits: CheckLimits) -> dict[str, Check]:
    """Return the checks of a method, by name."""
    closed_loop: dict[str, Check] = {"running camera": partial(_check_on_running_camera, method, limits)}
    if commands(method.search):
        return closed_loop
    return {"recordings": partial(_check_on_recordings, method), **closed_loop}


def _check_on_recordings(method: Method) -> str:
    """Check that the method repeats its answers on empty, full and saturated recordings, and on a sweep."""
    frames = max(recording_length(method.search), MIN_FRAMES)
    answers: dict[str, Answer] = {}
    with tempfile.TemporaryDirectory(prefix="saf-gen-") as folder:
        for name, path in write_recordings(Path(folder), frames).items():
            with open_stream(path) as stream:
                counts = WindowCounts(stream)
                first, again = (method.search(RecordingView(counts, method.measure)) for _ in range(2))
                answers[name] = check_answer_frame(first, frames, recording=name)
                check_same_answers(first, again, cause=f"the {name} stream gets another answer the second time")
    found = {name: None if a.frame is None else a.frame / frames for name, a in answers.items()}
    listed = ", ".join(f"{name} {'none' if at is None else f'{at:.3f}'}" for name, at in found.items())
    seen = f"fractions of {frames:,} frames: {listed}; focus at {BEST_FOCUS}"
    if found["swept"] is None or abs(found["swept"] - BEST_FOCUS) > TOLERANCE:
        raise CheckWarning(seen, f"an error within {TOLERANCE:g} is expected for a sweep in constant light")
    return seen


def _check_on_running_camera(method: Method, limits: CheckLimits) -> str:
    """Check that the method stays in travel and budget and repeats its run, in usual light, excess light and none."""
    # Imported here because this loads the reader of OpenEXR files.
    from saf_gen.benchmark.conformance import _checked_runs as checked_runs

    run = partial(checked_runs.run_on_scene, method, limits=limits)
    runs = {
        name: checked_runs.run_twice(run, ACTUATOR, light=light, condition=f"with {name} ")
        for name, light in checked_runs.LIGHT_FACTORS.items()
    }
    ends = "; ".join(f"{name}: {checked_runs.describe_run(end)}" for name, end in runs.items())
    seen = f"the lens ends at {ends}; focus at {BEST_FOCUS}"
    if abs(float(runs["a usual light"].path[-1]) - BEST_FOCUS) > TOLERANCE:
        raise CheckWarning(seen, f"an error within {TOLERANCE:g} is expected in usual light")
    return seen
