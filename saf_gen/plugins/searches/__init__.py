"""Searches by name: each looks at windows of a recording through a View and answers with a frame.

A search with ``commands`` moves the lens of a running camera and answers with a lens position. Each search is
one file of this folder, or belongs to a package that offers it under the entry point ``saf_gen.searches``.
Files whose names begin with an underscore hold what searches share.
"""

from typing import Any

from saf_gen.core.config.registry import build_plugin, names
from saf_gen.parts import Search

__all__ = ["get_search", "search_names"]

KIND = "searches"


def search_names() -> list[str]:
    """Return every name that get_search takes, sorted; nothing is imported."""
    return names(KIND)


def get_search(name: str, **options: Any) -> Search:
    """Return a search by its name.

    Parameters
    ----------
    name : a name of :func:`search_names`, ``file.py:Class`` or ``package.module:Class``.
    **options : the fields of the search's dataclass.

    Returns
    -------
    Search
        A callable that takes a :class:`saf_gen.parts.View` and returns a :class:`saf_gen.parts.Answer`.

    Raises
    ------
    BadInput : for an unknown name or option, and for a value that the search refuses.
    """
    return build_plugin(KIND, name, **options)
