"""Findings of checks."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class SceneFinding:
    """One line of a check: its level, and the value that was measured or the advice."""

    check: str
    level: Literal["ok", "warning", "error"]
    text: str


def scene_check_ok(check: str, text: str) -> SceneFinding:
    """Return a finding that a check passed; ``text`` states the measured value."""
    return SceneFinding(check, "ok", text)


def scene_check_warning(check: str, text: str) -> SceneFinding:
    """Return a finding that the scene can be used but should be improved; ``text`` says what to do."""
    return SceneFinding(check, "warning", text)


def scene_check_error(check: str, text: str) -> SceneFinding:
    """Return a finding that the scene cannot be used as it is."""
    return SceneFinding(check, "error", text)
