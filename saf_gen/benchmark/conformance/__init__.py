"""Checks of anybody's method: it ends, keeps to travel and budget, and gives the same again.

for finding in check_named("my_measure.py:Mine+argmax"): ...

They hold for every measure and search that is registered; the tests of this project run them over all.
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

__all__ = ["CheckLimits", "CheckResult", "check_measure", "check_method", "check_named", "check_search"]

LIMITS = CheckLimits()


def check_named(name: str, limits: CheckLimits = LIMITS) -> Iterator[CheckResult]:
    """Findings on a method, ``MEASURE+SEARCH`` or ``@FILE``, or on a measure or a search alone, as they come.

    Raises BadInput at once for a name that is none of these.
    """
    part = resolve_name(name)
    if isinstance(part, Method):
        return check_method(part, limits)
    room, alone = part
    return check_measure(alone, limits) if room == "measures" else check_search(alone, limits)


def check_measure(measure: Measure, limits: CheckLimits = LIMITS) -> Iterator[CheckResult]:
    """Findings on a focus measure."""
    return run_checks("measure", measure_checks(measure), limits)


def check_search(search: Search, limits: CheckLimits = LIMITS) -> Iterator[CheckResult]:
    """Findings on a search, one that estimates or one that commands the lens."""
    if commands(search):
        from saf_gen.benchmark.conformance.commanding_search_checks import (
            commanding_checks,  # reads OpenEXR files
        )

        return run_checks("search", commanding_checks(search, limits), limits)
    return run_checks("search", estimating_checks(search, limits), limits)


def check_method(method: Method, limits: CheckLimits = LIMITS) -> Iterator[CheckResult]:
    """Findings on a measure, a search, and both together; not on the whole where a half fails."""
    failed = False
    for findings in (check_measure(method.measure, limits), check_search(method.search, limits)):
        for finding in findings:
            failed |= finding.level == "fail"
            yield finding
    if failed:
        yield CheckResult("method", "whole", "warn", "not run: a half of it fails", "mend that first")
        return
    yield from run_checks("method", method_checks(method, limits), limits)
