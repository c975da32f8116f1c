"""Searches, by name: each looks at windows of a recording through a View and answers with a frame.

Each search is one file of this folder, or a package's, offered under the entry point ``saf_gen.searches``.
Helpers that searches share are in files whose names begin with an underscore.
"""

from typing import Any

from saf_gen.core.config.registry import build, names
from saf_gen.parts import Search

__all__ = ["get_search", "search_names"]

ROOM = "searches"


def search_names() -> list[str]:
    """Every name that get_search takes, sorted; nothing is imported."""
    return names(ROOM)


def get_search(name: str, **options: Any) -> Search:
    """The search ``name`` with these options, the keys of its dataclass.

    Raises BadInput for an unknown name or key, and for a value that the search refuses.
    """
    return build(ROOM, name, **options)
