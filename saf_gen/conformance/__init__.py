"""Checks of anybody's method: it ends, keeps to travel and budget, and gives the same again.

for finding in check("my_measure.py:Mine+argmax"): ...

They hold for every measure and search that is registered; the tests of this project run them over all.
"""

from collections.abc import Iterator

from saf_gen.conformance._finding import Finding
from saf_gen.conformance._runner import Limits, run_checks
from saf_gen.conformance.estimating import estimating_checks
from saf_gen.conformance.measures import measure_checks
from saf_gen.conformance.methods import method_checks
from saf_gen.conformance.named import named
from saf_gen.methods import Method
from saf_gen.parts import Measure, Search, commands

__all__ = ["Finding", "Limits", "check", "check_measure", "check_method", "check_search"]

LIMITS = Limits()


def check(name: str, limits: Limits = LIMITS) -> Iterator[Finding]:
    """Findings on a method, ``MEASURE+SEARCH`` or ``@FILE``, or on a measure or a search alone, as they come.

    Raises BadInput at once for a name that is none of these.
    """
    part = named(name)
    if isinstance(part, Method):
        return check_method(part, limits)
    room, alone = part
    return check_measure(alone, limits) if room == "measures" else check_search(alone, limits)


def check_measure(measure: Measure, limits: Limits = LIMITS) -> Iterator[Finding]:
    """Findings on a focus measure."""
    return run_checks("measure", measure_checks(measure), limits)


def check_search(search: Search, limits: Limits = LIMITS) -> Iterator[Finding]:
    """Findings on a search, one that estimates or one that commands the lens."""
    if commands(search):
        from saf_gen.conformance.commanding import commanding_checks  # reads OpenEXR files

        return run_checks("search", commanding_checks(search, limits), limits)
    return run_checks("search", estimating_checks(search, limits), limits)


def check_method(method: Method, limits: Limits = LIMITS) -> Iterator[Finding]:
    """Findings on a measure, a search, and both together; not on the whole where a half fails."""
    failed = False
    for findings in (check_measure(method.measure, limits), check_search(method.search, limits)):
        for finding in findings:
            failed |= finding.level == "fail"
            yield finding
    if failed:
        yield Finding("method", "whole", "warn", "not run: a half of it fails", "mend that first")
        return
    yield from run_checks("method", method_checks(method, limits), limits)
