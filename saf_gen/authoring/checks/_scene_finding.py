"""The finding of a check."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class SceneFinding:
    """One line of one check: its level, and what was measured or what to do."""

    check: str
    level: Literal["ok", "warning", "error"]
    text: str


def scene_check_ok(check: str, text: str) -> SceneFinding:
    """Return the finding that all is well, with the value that shows it."""
    return SceneFinding(check, "ok", text)


def scene_check_warning(check: str, text: str) -> SceneFinding:
    """Return the finding that the scene can be used but should be improved, with what to do."""
    return SceneFinding(check, "warning", text)


def scene_check_error(check: str, text: str) -> SceneFinding:
    """Return the finding that the scene cannot be used as it is."""
    return SceneFinding(check, "error", text)
