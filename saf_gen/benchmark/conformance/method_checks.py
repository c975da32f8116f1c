"""Checks of a whole method, on small recordings and before a running camera."""

import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from saf_gen.benchmark.conformance._answer_checks import check_frame
from saf_gen.benchmark.conformance._check_result import CheckFailure, CheckWarning
from saf_gen.benchmark.conformance._check_runner import Check, CheckLimits
from saf_gen.benchmark.conformance._test_scene import BEST_FOCUS, write_recordings
from saf_gen.benchmark.conformance.estimating_search_checks import find_accepted_length
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.view import RecordingView, WindowCounts
from saf_gen.parts import Answer, commands
from saf_gen.stream.stream_file import open_stream

__all__ = ["method_checks"]

LEAST = 4000  # frames: windows are long enough for a spike or two
NEAR = 0.1  # of the travel
ACTUATOR = "voice_coil_hall"


def method_checks(method: Method, limits: CheckLimits) -> dict[str, Check]:
    """The checks of one method, by name."""
    live = partial(running_camera, method, limits)
    if commands(method.search):
        return {"running camera": live}
    return {"recordings": partial(recordings, method), "running camera": live}


def recordings(method: Method) -> str:
    """On streams without a spike, with every spike, of too much light, and on a sweep: the same twice."""
    frames = max(find_accepted_length(method.search), LEAST)
    answers: dict[str, Answer] = {}
    with tempfile.TemporaryDirectory(prefix="saf-gen-") as folder:
        for name, path in write_recordings(Path(folder), frames).items():
            with open_stream(path) as stream:
                counts = WindowCounts(stream)
                answers[name] = check_frame(
                    method.search(RecordingView(counts, method.measure)), frames, name
                )
                if method.search(RecordingView(counts, method.measure)) != answers[name]:
                    raise CheckFailure(
                        f"the {name} stream gets another answer the second time",
                        "draw nothing by chance, and keep nothing between calls",
                    )
    said = {n: "none" if a.frame is None else f"{a.frame / frames:.3f}" for n, a in answers.items()}
    listed = ", ".join(f"{name} {at}" for name, at in said.items())
    seen = f"fractions of {frames:,} frames: {listed}; focus at {BEST_FOCUS}"
    swept = answers["swept"].frame
    if swept is None or abs(swept / frames - BEST_FOCUS) > NEAR:
        raise CheckWarning(seen, f"within {NEAR:g} is what one expects of a sweep in constant light")
    return seen


def running_camera(method: Method, limits: CheckLimits) -> str:
    """Before a camera in usual light, none, and too much: within travel and budget, the same twice."""
    from saf_gen.benchmark.conformance._closed_loop_trial import (  # reads OpenEXR files
        LIGHT_FACTORS,
        describe_run,
        run_on_test_scene,
    )

    said, missed = [], False
    for name, light in LIGHT_FACTORS.items():
        first, again = (
            run_on_test_scene(method, ACTUATOR, limits, best=BEST_FOCUS, light=light) for _ in range(2)
        )
        if first.answer != again.answer or not np.array_equal(first.path, again.path):
            raise CheckFailure(
                f"with {name} the same camera gets another answer: {again.answer}, not {first.answer}",
                "draw nothing by chance, and keep nothing between calls",
            )
        said.append(f"{name}: {describe_run(first)}")
        missed |= light == 1 and abs(float(first.path[-1]) - BEST_FOCUS) > NEAR
    seen = f"the lens ends at {'; '.join(said)}; focus at {BEST_FOCUS}"
    if missed:
        raise CheckWarning(seen, f"within {NEAR:g} is what one expects in a usual light")
    return seen
