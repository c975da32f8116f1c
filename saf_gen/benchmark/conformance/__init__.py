"""Checks of third-party methods: whether a method ends, stays in travel and budget, and repeats its answers.

>>> for result in check_by_name("my_measure.py:Mine+argmax"): ...  # doctest: +SKIP

Every registered measure and search passes these checks in the tests of this project.
"""

from collections.abc import Iterator

from saf_gen.benchmark.conformance._check_result import CheckResult
from saf_gen.benchmark.conformance._check_runner import CheckLimits, run_checks
from saf_gen.benchmark.conformance.estimating_search_checks import estimating_checks
from saf_gen.benchmark.conformance.measure_checks import measure_checks
from saf_gen.benchmark.conformance.method_checks import method_checks
from saf_gen.benchmark.conformance.name_resolution import resolve_name
from saf_gen.benchmark.method_spec import Method
from saf_gen.parts import Measure, Search, commands

__all__ = ["CheckLimits", "CheckResult", "check_by_name", "check_measure", "check_method", "check_search"]

LIMITS = CheckLimits()


def check_by_name(name: str, limits: CheckLimits = LIMITS) -> Iterator[CheckResult]:
    """Run the checks of a method, or of a single measure or search, and yield their results.

    Parameters
    ----------
    name : str
        ``MEASURE+SEARCH``, ``@FILE`` of a tuned method, or the name of a measure or a search with options.
    limits : CheckLimits, optional
        Numbers of scores and seconds after which a plug-in is stopped.

    Yields
    ------
    CheckResult
        Result of each check.

    Raises
    ------
    BadInput
        If the name is none of these; the call itself raises it, before the first result.
    """
    found = resolve_name(name)
    if isinstance(found, Method):
        return check_method(found, limits)
    kind, plug_in = found
    return check_measure(plug_in, limits) if kind == "measures" else check_search(plug_in, limits)


def check_measure(measure: Measure, limits: CheckLimits = LIMITS) -> Iterator[CheckResult]:
    """Run the checks of a focus measure and yield their results."""
    return run_checks("measure", measure_checks(measure), limits=limits)


def check_search(search: Search, limits: CheckLimits = LIMITS) -> Iterator[CheckResult]:
    """Run the checks of a search, some of which depend on whether it commands the lens, and yield their results."""
    if commands(search):
        # Imported here because this loads the reader of OpenEXR files.
        from saf_gen.benchmark.conformance.commanding_search_checks import commanding_checks

        return run_checks("search", commanding_checks(search, limits), limits=limits)
    return run_checks("search", estimating_checks(search, limits), limits=limits)


def check_method(method: Method, limits: CheckLimits = LIMITS) -> Iterator[CheckResult]:
    """Run the checks of the measure, of the search and, if neither fails, of both together; yield their results."""
    failed = False
    for results in (check_measure(method.measure, limits), check_search(method.search, limits)):
        for result in results:
            failed |= result.level == "fail"
            yield result
    if failed:
        yield CheckResult("method", "whole", "warn", "not run: the measure or the search fails", "correct that first")
        return
    yield from run_checks("method", method_checks(method, limits), limits=limits)
