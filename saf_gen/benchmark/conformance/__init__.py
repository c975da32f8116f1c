"""Checks of third-party methods: whether a method ends, stays in travel and budget, and repeats its answers.

>>> for result in check_by_name("my_measure.py:Mine+argmax"): ...  # doctest: +SKIP

Every registered measure and search passes these checks in the tests of this project.
"""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from saf_gen.benchmark.conformance._check_runner import (
    Check,
    CheckLimits,
    CheckWarning,
    check_answer_frame,
    check_same_answers,
    run_checks,
)
from saf_gen.benchmark.conformance._samples import BEST_FOCUS, write_recordings
from saf_gen.benchmark.conformance.estimating_search_checks import estimating_checks, recording_length
from saf_gen.benchmark.conformance.measure_checks import measure_checks
from saf_gen.benchmark.method_spec import Half, Method, build_method, find_plugin, nested_plugins, resolve_name
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.core.finding import Finding
from saf_gen.parts import Answer, Measure, Search, commands, wants_polarities
from saf_gen.stream.stream_file import open_stream

__all__ = ["CheckLimits", "check_by_name", "check_measure", "check_method", "check_parts", "check_search", "find_parts"]

LIMITS = CheckLimits()
MIN_FRAMES = 4000  # makes windows long enough to contain a spike or two
TOLERANCE = 0.1  # fraction of the travel
ACTUATOR = "voice_coil_hall"


def check_by_name(name: str, limits: CheckLimits = LIMITS) -> Iterator[Finding]:
    """Run the checks of a method, or of a single measure or search, and yield their results.

    Parameters
    ----------
    name : str
        ``MEASURE+SEARCH``, ``@FILE`` of a tuned method, or the name of a measure or a search with options.
    limits : CheckLimits, optional
        Numbers of scores and seconds after which a plug-in is stopped.

    Yields
    ------
    Finding
        Result of each check.

    Raises
    ------
    BadInput
        If the name is none of these; the call itself raises it, before the first result.
    """
    found = resolve_name(name)
    if isinstance(found, Method):
        return check_method(found, limits)
    return check_parts({found[0]: found[1]}, limits)


def find_parts(halves: Sequence[Half], kind: str = "") -> dict[str, Any]:
    """Return the measure and the search of a method, or a single plug-in of this or an unknown kind, by kind.

    Raises BadInput if one is unknown or refuses its options.
    """
    if len(halves) == 1:
        return dict([find_plugin(halves[0], kind)])
    method = build_method(*halves)
    return {"measures": method.measure, "searches": method.search}


def check_parts(parts: Mapping[str, Any], limits: CheckLimits = LIMITS) -> Iterator[Finding]:
    """Run the checks of a measure, of a search, or of both as a method, and yield their results."""
    if len(parts) == 2:
        return check_method(Method("measure+search", parts["measures"], parts["searches"], code=""), limits)
    return check_measure(parts["measures"], limits) if "measures" in parts else check_search(parts["searches"], limits)


def check_measure(measure: Measure, limits: CheckLimits = LIMITS) -> Iterator[Finding]:
    """Run the checks of a focus measure and yield their results."""
    return run_checks("measure", measure_checks(measure), limits=limits)


def check_search(search: Search, limits: CheckLimits = LIMITS) -> Iterator[Finding]:
    """Run the checks of a search, some of which depend on whether it commands the lens, and yield their results."""
    if commands(search):
        # Imported here because this loads the reader of OpenEXR files.
        from saf_gen.benchmark.conformance.commanding_search_checks import commanding_checks

        return run_checks("search", commanding_checks(search, limits), limits=limits)
    return run_checks("search", estimating_checks(search, limits), limits=limits)


def check_method(method: Method, limits: CheckLimits = LIMITS) -> Iterator[Finding]:
    """Run the checks of the measure, of the search and, if neither fails, of both together; yield their results."""
    failed = False
    for results in (check_measure(method.measure, limits), check_search(method.search, limits)):
        for result in results:
            failed |= result.level == "error"
            yield result
    if failed:
        yield Finding("whole", "warning", "not run: the measure or the search fails", "correct that first", "method")
        return
    if any(map(wants_polarities, nested_plugins(method.search))):
        yield Finding("whole", "ok", "not run: the samples are of a spike camera, and it needs events", "", "method")
        return
    yield from run_checks("method", _method_checks(method, limits), limits=limits)


def _method_checks(method: Method, limits: CheckLimits) -> dict[str, Check]:
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
    from saf_gen.benchmark.conformance.commanding_search_checks import (
        LIGHT_FACTORS,
        describe_run,
        run_on_scene,
        run_twice,
    )

    run = partial(run_on_scene, method, limits=limits)
    runs = {
        name: run_twice(run, ACTUATOR, light=light, condition=f"with {name} ") for name, light in LIGHT_FACTORS.items()
    }
    ends = "; ".join(f"{name}: {describe_run(end)}" for name, end in runs.items())
    seen = f"the lens ends at {ends}; focus at {BEST_FOCUS}"
    if abs(float(runs["a usual light"].path[-1]) - BEST_FOCUS) > TOLERANCE:
        raise CheckWarning(seen, f"an error within {TOLERANCE:g} is expected in usual light")
    return seen
