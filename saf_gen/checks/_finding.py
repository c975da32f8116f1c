"""What a check has found."""

from dataclasses import dataclass
from typing import Literal

__all__ = ["Finding", "error", "ok", "warning"]


@dataclass(frozen=True)
class Finding:
    """One line of one check: ``ok``, ``warning`` or ``error``, and what to do where something is wrong."""

    check: str
    level: Literal["ok", "warning", "error"]
    text: str


def ok(check: str, text: str) -> Finding:
    """All is well, with the figure that says so."""
    return Finding(check, "ok", text)


def warning(check: str, text: str) -> Finding:
    """The scene can be used, but not as well as it might."""
    return Finding(check, "warning", text)


def error(check: str, text: str) -> Finding:
    """The scene cannot be used so."""
    return Finding(check, "error", text)
