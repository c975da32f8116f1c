"""Searches by name: each scores windows of a recording through a View and answers with a frame.

A search with ``commands`` moves the lens of a running camera and answers with a lens position. Each search is a file of
this folder, or comes from a package with the entry point ``saf_gen.searches``. Files whose names begin with an
underscore contain code that several searches use.
"""

from typing import Any

from saf_gen.core.config.registry import build_plugin, names
from saf_gen.parts import Search

__all__ = ["get_search", "search_names"]

KIND = "searches"


def search_names() -> list[str]:
    """Return the sorted names of all searches, without importing them.

    Returns
    -------
    list of str
        Names that :func:`get_search` takes.
    """
    return names(KIND)


def get_search(name: str, **options: Any) -> Search:
    """Return a search by its name.

    Parameters
    ----------
    name : str
        One of :func:`search_names`, ``file.py:Class`` or ``package.module:Class``.
    **options
        Fields of the search's dataclass.

    Returns
    -------
    Search
        A callable that takes a :class:`saf_gen.parts.View` and returns a :class:`saf_gen.parts.Answer`.

    Raises
    ------
    BadInput
        If the name or an option is unknown, or if the search refuses a value.
    """
    return build_plugin(KIND, name, **options)
