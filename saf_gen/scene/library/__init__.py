"""Modules that the scripts of several scenes share, one frozen file per version.

A card names what its ``scene.py`` imports: with ``library: {letters: broad_pen_1}`` on the card,
``import letters`` loads ``broad_pen_1.py`` of this folder. The scene's digest counts the module's bytes as if
the file ``letters.py`` lay in the scene's own folder.

A module here is never edited, because every edit would render all scenes that use it anew. An improved
module gets a new name, with the next version number at its end.
"""

from pathlib import Path

from saf_gen.errors import unknown

__all__ = ["library_module"]

MODULES = {path.stem: path for path in Path(__file__).parent.glob("[!_]*.py")}


def library_module(name: str, *, where: str = "") -> Path:
    """Return the file of a library module; raise BadInput, located at ``where``, for an unknown name."""
    if name not in MODULES:
        raise unknown("library module", name, allowed=MODULES, where=where)
    return MODULES[name]
