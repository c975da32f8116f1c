"""Folders that come with saf_gen, such as that of its scenes: at the top of a checkout, or in an installed package."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]


def shipped_folder(kind: str) -> Path:
    """Return a folder that comes with saf_gen; ``kind`` is "scenes", "recipes" or "datasets"."""
    installed = _PACKAGE / "shipped" / kind
    return installed if installed.is_dir() else _PACKAGE.parent / kind
