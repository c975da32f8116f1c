"""Checks of a whole method, on small recordings and before a running camera."""

import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from saf_gen.conformance._answer import check_frame
from saf_gen.conformance._finding import Doubt, Fault
from saf_gen.conformance._runner import Check, Limits
from saf_gen.conformance._stage import BEST, write_recordings
from saf_gen.conformance.estimating import fitting_length
from saf_gen.methods import Method
from saf_gen.parts import Answer, commands
from saf_gen.rig import Counts, Recording
from saf_gen.stream import open_stream

__all__ = ["method_checks"]

LEAST = 4000  # frames: windows are long enough for a spike or two
NEAR = 0.1  # of the travel
ACTUATOR = "voice_coil_hall"


def method_checks(method: Method, limits: Limits) -> dict[str, Check]:
    """The checks of one method, by name."""
    live = partial(running_camera, method, limits)
    if commands(method.search):
        return {"running camera": live}
    return {"recordings": partial(recordings, method), "running camera": live}


def recordings(method: Method) -> str:
    """On streams without a spike, with every spike, of too much light, and on a sweep: the same twice."""
    frames = max(fitting_length(method.search), LEAST)
    answers: dict[str, Answer] = {}
    with tempfile.TemporaryDirectory(prefix="saf-gen-") as folder:
        for name, path in write_recordings(Path(folder), frames).items():
            with open_stream(path) as stream:
                counts = Counts(stream)
                answers[name] = check_frame(method.search(Recording(counts, method.measure)), frames, name)
                if method.search(Recording(counts, method.measure)) != answers[name]:
                    raise Fault(
                        f"the {name} stream gets another answer the second time",
                        "draw nothing by chance, and keep nothing between calls",
                    )
    said = {n: "none" if a.frame is None else f"{a.frame / frames:.3f}" for n, a in answers.items()}
    seen = f"shares of {frames:,} frames: {', '.join(f'{n} {at}' for n, at in said.items())}; focus at {BEST}"
    swept = answers["swept"].frame
    if swept is None or abs(swept / frames - BEST) > NEAR:
        raise Doubt(seen, f"within {NEAR:g} is what one expects of a sweep in constant light")
    return seen


def running_camera(method: Method, limits: Limits) -> str:
    """Before a camera in usual light, none, and too much: within travel and budget, the same twice."""
    from saf_gen.conformance._live import LIGHTS, filmed, told  # reads OpenEXR files

    said, missed = [], False
    for name, light in LIGHTS.items():
        first, again = (filmed(method, ACTUATOR, limits, best=BEST, light=light) for _ in range(2))
        if first.answer != again.answer or not np.array_equal(first.path, again.path):
            raise Fault(
                f"with {name} the same camera gets another answer: {again.answer}, not {first.answer}",
                "draw nothing by chance, and keep nothing between calls",
            )
        said.append(f"{name}: {told(first)}")
        missed |= light == 1 and abs(float(first.path[-1]) - BEST) > NEAR
    seen = f"the lens ends at {'; '.join(said)}; focus at {BEST}"
    if missed:
        raise Doubt(seen, f"within {NEAR:g} is what one expects in a usual light")
    return seen
