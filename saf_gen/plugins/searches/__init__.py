"""Searches by name: each scores windows of a recording through a View and answers with a frame.

A search with ``commands`` moves the lens of a running camera and answers with a lens position. Each search is a file of
this folder, or comes from a package with the entry point ``saf_gen.searches``. Files whose names begin with an
underscore contain code that several searches use.

Every search takes ``reject`` besides its own options: with ``reject=true`` it abstains where ``peak_fit`` would. Its
file does not change for that, so that the digests of its code, and the rows of older evaluations, stay as they are.
"""

from typing import Any

from saf_gen.core.config.registry import PLUGIN_KINDS, build_plugin, names, option_fields
from saf_gen.errors import BadInput, unknown
from saf_gen.parts import Search
from saf_gen.plugins.searches._reject import Rejecting

__all__ = ["Rejecting", "get_search", "search_names"]

KIND = "searches"
REJECT = "reject"
"""The option of every search, unless its class has one of this name, to abstain where ``peak_fit`` would."""


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
        Fields of the search's dataclass, and ``reject``, false by default: whether the search abstains where
        ``peak_fit`` would.

    Returns
    -------
    Search
        A callable that takes a :class:`saf_gen.parts.View` and returns a :class:`saf_gen.parts.Answer`.

    Raises
    ------
    BadInput
        If the name or an option is unknown, or if the search refuses a value.
    """
    known = option_fields(KIND, name)
    if REJECT in known:
        return build_plugin(KIND, name, **options)
    for key in options:
        if key not in (*known, REJECT):
            raise unknown(f"key of {PLUGIN_KINDS[KIND]} {name!r}:", key, allowed=(*known, REJECT))
    rejects = options.pop(REJECT, False)
    if not isinstance(rejects, bool):
        raise BadInput(f"{PLUGIN_KINDS[KIND]} {name!r}: {REJECT} is {rejects!r}", allowed="true or false")
    search = build_plugin(KIND, name, **options)
    return Rejecting(search) if rejects else search
