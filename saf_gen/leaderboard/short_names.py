"""What the short names in a leaderboard stand for: ``sd`` is spike dispersion.

The words are the beginning of the first line of the module of a measure or search, up to its colon or comma.
"""

import sys
from collections.abc import Iterable, Mapping

from saf_gen.benchmark.method_spec import measure_and_search, split_options, split_region
from saf_gen.core.config.registry import is_builtin_name, plugin_class
from saf_gen.errors import BadInput

KINDS = ("measures", "searches")
FORMS = {"_tfi": "on intervals between spikes", "_n": "divided by brightness"}
"""What the endings of measures mean, the last ending first."""
PEOPLE = ("Brenner", "Fibonacci", "Vollath")
"""Names that keep their capital letter within a sentence."""


def spell_out_names(methods: Iterable[str]) -> dict[str, str]:
    """Return the words for each short name in these names of methods: first the measures, then the searches.

    Options and regions of methods are ignored. Measures and searches that are not part of saf_gen are left out, and so
    are those whose name already consists of the same words, such as ``squared_gradient``.
    """
    halves = [measure_and_search(_without_region(method)) for method in methods]
    words: dict[str, str] = {}
    for number, kind in enumerate(KINDS):
        for name in dict.fromkeys(split_options(pair[number])[0] for pair in halves):
            spelled = _spell_out(name, kind)
            if spelled and spelled.casefold() != name.replace("_", " "):
                words.setdefault(name, spelled)
    return words


def list_names(words: Mapping[str, str]) -> str:
    """Return what the short names of spell_out_names stand for as one line of text."""
    return f"Names: {'; '.join(f'{name}: {spelled}' for name, spelled in words.items())}."


def _without_region(method: str) -> str:
    try:
        return split_region(method)[0]
    except BadInput:  # the name of somebody's predictions
        return method


def _spell_out(name: str, kind: str) -> str:
    """Return the words for one name; '' if it is not part of saf_gen."""
    forms: list[str] = []
    bare = name
    while not is_builtin_name(kind, bare):
        form = next((ending for ending in FORMS if kind == "measures" and bare.endswith(ending)), None)
        if form is None:
            return ""
        forms.insert(0, FORMS[form])
        bare = bare.removesuffix(form)
    module = sys.modules[plugin_class(kind, bare).__module__]
    first = (module.__doc__ or "").split("\n")[0]
    title, colon, _ = first.partition(": ")
    title = title if colon else first.partition(",")[0].rstrip(".")
    if not title.startswith(PEOPLE):
        title = title[:1].lower() + title[1:]
    return ", ".join([title, *forms])
