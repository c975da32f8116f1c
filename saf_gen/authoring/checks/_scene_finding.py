"""What a check has found."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["SceneFinding", "error", "ok", "warning"]


@dataclass(frozen=True)
class SceneFinding:
    """One line of one check: ``ok``, ``warning`` or ``error``, and what to do where something is wrong."""

    check: str
    level: Literal["ok", "warning", "error"]
    text: str


def ok(check: str, text: str) -> SceneFinding:
    """All is well, with the figure that says so."""
    return SceneFinding(check, "ok", text)


def warning(check: str, text: str) -> SceneFinding:
    """The scene can be used, but not as well as it might."""
    return SceneFinding(check, "warning", text)


def error(check: str, text: str) -> SceneFinding:
    """The scene cannot be used so."""
    return SceneFinding(check, "error", text)
