"""Parts as recipes write them: ``{kind: ..., key: value, ...}``, numbers left open, files named by path.

Reading checks a part at every corner of its ranges, so that no draw can fail hours later. What a
recording is made from is the part resolved: open numbers drawn, random streams named, files read.
"""

from collections.abc import Callable, Iterable
from itertools import product
from typing import Any

from saf_gen.core import seeds
from saf_gen.core.config import registry
from saf_gen.core.config.document import Document, Key
from saf_gen.core.config.ranges import draw_value, extreme_values, is_range
from saf_gen.core.csv_table import read_text_beside
from saf_gen.errors import BadInput, SafGenError, unknown

__all__ = ["Component", "draw_component", "read_component"]

Component = dict[str, Any]


def read_component(
    plugin_kind: str,
    part: Any,
    document: Document,
    keys: tuple[Key, ...],
    *,
    common: Iterable[str] = (),
    build: Callable[..., object] | None = None,
) -> Component:
    """The part at these keys of a recipe, checked, as it was written but with its file read.

    It may be a choice among parts, ``{choice: [{kind: ...}, ...]}``; then each of them is read.
    ``common``: keys that every kind of the room takes beside its own. ``build(kind, **options)`` tries one
    corner; without it the registry does.

    Raises BadInput with file and line where something does not fit.
    """
    what, where = registry.PLUGIN_KINDS[plugin_kind], document.locate(*keys)
    if is_range(part):
        among = extreme_values(part, where=where)
        read_so = [
            read_component(plugin_kind, one, document, keys, common=common, build=build) for one in among
        ]
        return {"choice": read_so}
    if not isinstance(part, dict) or "kind" not in part:
        raise BadInput(
            f"{keys[-1]} is {part!r}" if not isinstance(part, dict) else f"{keys[-1]} has no kind",
            where=where,
            allowed=f"{{kind: ..., ...}} with a kind among {', '.join(registry.names(plugin_kind))}",
        )
    kind, options = part["kind"], {key: value for key, value in part.items() if key != "kind"}
    if kind not in registry.names(plugin_kind):
        raise unknown(what, kind, registry.names(plugin_kind), where=document.locate(*keys, "kind"))
    known = [*registry.option_fields(plugin_kind, kind), *common]
    for key in options:
        if key not in known:
            raise unknown(f"key of {what} {kind!r}:", key, known, where=document.locate(*keys, key))
    if "file" in options:
        options["file"] = _with_text(options["file"], document, document.locate(*keys, "file"))
    corners = [extreme_values(value, where=document.locate(*keys, key)) for key, value in options.items()]
    for values in product(*corners):
        corner = dict(zip(options, values, strict=True))
        try:
            registry.build(plugin_kind, kind, **corner) if build is None else build(kind, **corner)
        except SafGenError as error:
            raise BadInput(str(error), where=where) from error
    return {"kind": kind, **options}


def _with_text(value: Any, document: Document, where: str) -> Any:
    """The path of a file, or each of a choice, with its text: what a sequence is made from goes with it."""
    if is_range(value) and isinstance(value.get("choice"), list):
        return {"choice": [_with_text(one, document, where) for one in value["choice"]]}
    if not isinstance(value, str):
        return value  # read before, or refused by the part
    return {"path": value, "text": read_text_beside(document.path.parent, value, where=where)}


def draw_component(
    plugin_kind: str, part: Component, name: tuple[str | int, ...], purpose: tuple[str, ...]
) -> Component:
    """The part of one recording: open numbers drawn, and a ``seed`` of its own where the recipe gives none.

    ``name`` names the recording's random streams, ``purpose`` this part among them.
    """
    chosen = draw_value(part, seeds.make_generator(*name, "recipe", *purpose))
    drawn = {
        key: draw_value(v, seeds.make_generator(*name, "recipe", *purpose, key)) for key, v in chosen.items()
    }
    if "seed" in registry.option_fields(plugin_kind, drawn["kind"]):
        drawn.setdefault("seed", seeds.derive_seed(*name, *purpose))
    return drawn
