"""Components of recipes: plug-ins with their options, written as ``{kind: ..., key: value, ...}``.

A number may be left open as a range, a file is named by its path, and the component itself may be a choice among
several. :func:`read_component` checks a component at every corner of its ranges, so that no draw can fail hours
later; :func:`draw_component` draws the component of one recording.
"""

from collections.abc import Callable, Iterable
from itertools import product
from typing import Any

from saf_gen.core import seeds
from saf_gen.core.config import registry
from saf_gen.core.config.document import Document, Key
from saf_gen.core.config.ranges import draw_range, is_range, range_extremes
from saf_gen.core.csv_table import read_text_in
from saf_gen.errors import BadInput, located, some_of, unknown

Component = dict[str, Any]


def read_component(
    plugin_kind: str,
    component: Any,
    *,
    document: Document,
    keys: tuple[Key, ...],
    common: Iterable[str] = (),
    build: Callable[..., object] | None = None,
) -> Component:
    """Return the component at these keys of a recipe, after checking it and reading the file that it names.

    ``common`` lists keys that every kind takes in addition to its options. ``build(kind, **options)`` builds the
    plug-in at one corner of the ranges; by default the registry builds it.

    Raises BadInput, with file and line, for the first entry that is wrong.
    """
    what, where = registry.PLUGIN_KINDS[plugin_kind], document.locate(*keys)
    if is_range(component):
        among = range_extremes(component, where=where)
        read = [
            read_component(plugin_kind, one, document=document, keys=keys, common=common, build=build) for one in among
        ]
        return {"choice": read}
    names = registry.names(plugin_kind)
    if not isinstance(component, dict) or "kind" not in component:
        raise BadInput(
            f"{keys[-1]} has no kind" if isinstance(component, dict) else f"{keys[-1]} is {component!r}",
            where=where,
            allowed=f"{{kind: ..., ...}} with a kind among {some_of(names)}",
        )
    kind, options = component["kind"], {key: value for key, value in component.items() if key != "kind"}
    if kind not in names:
        where = document.locate(*keys, "kind")
        raise unknown(what, kind, allowed=names, where=where, hint=registry.WHERE_LISTED[plugin_kind])
    known = [*registry.option_fields(plugin_kind, kind), *common]
    for key in options:
        if key not in known:
            raise unknown(f"key of {what} {kind!r}:", key, allowed=known, where=document.locate(*keys, key))
    if "file" in options:
        options["file"] = _with_text(options["file"], document, where=document.locate(*keys, "file"))
    corners = [range_extremes(value, where=document.locate(*keys, key)) for key, value in options.items()]
    for values in product(*corners):
        corner = dict(zip(options, values, strict=True))
        with located(where):
            registry.build_plugin(plugin_kind, kind, **corner) if build is None else build(kind, **corner)
    return {"kind": kind, **options}


def _with_text(value: Any, document: Document, *, where: str) -> Any:
    """Return the path of a file, or each path of a choice, with the text of the file, which a recording stores."""
    if is_range(value) and isinstance(value.get("choice"), list):
        return {"choice": [_with_text(one, document, where=where) for one in value["choice"]]}
    if not isinstance(value, str):
        return value  # its text is already read, or the plug-in will refuse it
    return {"path": value, "text": read_text_in(str(document.path.parent), value, where=where)}


def draw_component(
    plugin_kind: str, component: Component, *, name: tuple[str | int, ...], purpose: tuple[str, ...]
) -> Component:
    """Return the component of one recording: open numbers drawn, and a ``seed`` added if the plug-in takes one.

    ``name`` names the random streams of the recording, and ``purpose`` identifies this component among them.
    """
    chosen = draw_range(component, seeds.make_generator(*name, "recipe", *purpose))
    drawn = {
        key: draw_range(value, seeds.make_generator(*name, "recipe", *purpose, key)) for key, value in chosen.items()
    }
    if "seed" in registry.option_fields(plugin_kind, drawn["kind"]):
        drawn.setdefault("seed", seeds.derive_seed(*name, *purpose))
    return drawn
