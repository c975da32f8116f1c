"""Folders of the scenes and recipes that come with saf_gen: at the top of a checkout, or in an installed package."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


def shipped_folder(kind: str) -> Path:
    """Return the folder of the scenes or recipes that come with saf_gen; ``kind`` is "scenes" or "recipes"."""
    installed = _PACKAGE / "shipped" / kind
    return installed if installed.is_dir() else _PACKAGE.parent / kind
