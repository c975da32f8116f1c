"""Scenes and recipes that come with saf_gen: at the top of a checkout, inside the package where it was installed."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


def shipped_folder(kind: str) -> Path:
    """Return the folder of all "scenes" or "recipes" that come with saf_gen."""
    installed = _PACKAGE / "shipped" / kind
    return installed if installed.is_dir() else _PACKAGE.parent / kind
