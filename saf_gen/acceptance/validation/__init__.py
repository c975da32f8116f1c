"""Validation: the product, run as a user runs it, held against theory, itself, published figures and other code.

A check is one law (:class:`Check`). The checks of one subject stand in one module of this folder; nothing else must be
told of a new one but its module's list. :func:`run_validation_checks` runs them, keeps what they find, and goes on
after a stop; :mod:`saf_gen.acceptance.validation.page` writes the page.
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
"""The module of the checks of each subject, in the order of the page."""


def all_validation_checks() -> dict[str, Check]:
    """Return every check by its name, in the order of the page."""
    modules = (import_module(f"saf_gen.acceptance.validation.{module}") for module in SUBJECTS.values())
    return {check.name: check for module in modules for check in module.CHECKS}


def choose_validation_checks(names: list[str]) -> list[Check]:
    """Return the checks of these names, or all if there are none; a subject stands for all its checks.

    Raises BadInput for a name that is neither a check nor a subject.
    """
    checks = all_validation_checks()
    for name in names:
        if name not in checks and name not in SUBJECTS:
            raise unknown("check", name, allowed=[*SUBJECTS, *checks])
    return [check for check in checks.values() if not names or check.name in names or check.subject in names]
