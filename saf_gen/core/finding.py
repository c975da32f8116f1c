"""The finding of a check: of a scene, or of a method."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    Attributes
    ----------
    check : str
        Name of the check.
    level : {'ok', 'warning', 'error'}
        ``warning`` if what was checked can be used but should be improved, ``error`` if it cannot be used as it is.
    text : str
        What was measured or observed, on one line.
    to_do : str
        How to correct it, on one line; '' if nothing is wrong, or if ``text`` says it.
    part : str
        Checked part of a method: ``measure``, ``search`` or ``method``; '' for everything else.
    """

    check: str
    level: Literal["ok", "warning", "error"]
    text: str
    to_do: str = ""
    part: str = ""
