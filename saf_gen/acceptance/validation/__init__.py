"""Validation: saf_gen is run as a user runs it, and compared with theory, itself, published figures and other code.

Each check tests one law (:class:`Check`). The checks of a subject are in one module of this folder; to add a check,
add it to the ``CHECKS`` of its module. :func:`saf_gen.acceptance.validation.runner.run_validation_checks` runs checks,
saves their results and resumes an interrupted run; :mod:`saf_gen.acceptance.validation.validation_page` writes the
page.
"""

from importlib import import_module

from saf_gen.acceptance.validation.check import Check, Comparison, Curve, Finding, Plot, Verdict
from saf_gen.errors import unknown

__all__ = [
    "Check",
    "Comparison",
    "Curve",
    "Finding",
    "Plot",
    "Verdict",
    "all_validation_checks",
    "choose_validation_checks",
]

SUBJECTS = {
    "optics": "optics",
    "radiometry": "radiometry",
    "noise": "noise",
    "light": "light",
    "truth": "truth",
    "convergence": "convergence",
    "crossfade": "cross_fade",
    "dispersion": "dispersion",
    "referee": "emva_referee",
}
"""Module that holds the checks of each subject, in the order of the page."""


def all_validation_checks() -> dict[str, Check]:
    """Return every check by its name, in the order of the page."""
    modules = (import_module(f"saf_gen.acceptance.validation.{module}") for module in SUBJECTS.values())
    return {check.name: check for module in modules for check in module.CHECKS}


def choose_validation_checks(names: list[str]) -> list[Check]:
    """Return the checks with these names, or all checks if ``names`` is empty; a subject selects all its checks.

    Raises BadInput if a name is neither a check nor a subject.
    """
    checks = all_validation_checks()
    for name in names:
        if name not in checks and name not in SUBJECTS:
            raise unknown("check", name, allowed=[*SUBJECTS, *checks])
    return [check for check in checks.values() if not names or check.name in names or check.subject in names]
