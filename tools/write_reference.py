"""Write the parts of docs/ that come from the code: keys, options, records, JSON Schemas.

    python tools/write_reference.py

A part of a page is placed between ``<!-- from the code: NAME -->`` and ``<!-- end -->``; NAME is a key of ``PARTS``.
Everything else on a page is written by hand. ``tests/test_reference.py`` compares the pages with the code.
"""

import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from public_names import table, tick
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from saf_gen.benchmark import records
from saf_gen.benchmark.curve_quality import CurveQuality
from saf_gen.benchmark.plugin_description import build_or_class, format_attribute, search_kind, summarise_plugin
from saf_gen.camera import get_sensor, sensor_names
from saf_gen.core.config import registry
from saf_gen.core.config.field_docs import field_docs
from saf_gen.generate.recipe import Recipe, recipe_schema
from saf_gen.leaderboard.results import AXES
from saf_gen.optics.actuators import actuator_names, get_actuator
from saf_gen.plugins.lights import COMMON_KEYS
from saf_gen.scene.card_schema import card_schema
from saf_gen.scene.picture_card import PictureCard
from saf_gen.scene.scene_folder import SceneCard

DOCS = Path(__file__).resolve().parent.parent / "docs"
PART = re.compile(r"(<!-- from the code: ([a-z_]+) -->\n).*?(<!-- end -->)", re.DOTALL)
REQUIRED = "required"


# --- keys of recipes and cards -------------------------------------------------------------------------


def keys_of(model: type[BaseModel], prefix: str = "") -> Iterator[list[str]]:
    """Yield a row for each key that holds a value; keys of nested models are joined with dots."""
    for name, field in model.model_fields.items():
        at, inner = f"{prefix}{name}", field.annotation
        if get_origin(inner) is dict and get_args(inner)[1] is not Any:
            at, inner = f"{at}.NAME", get_args(inner)[1]
        if kinds := kinds_of(inner):  # only the keys that all kinds share; the others are in a separate table
            common = set.intersection(*(set(kind.model_fields) for kind in kinds))
            rows = keys_of(kinds[0], f"{at}.")
            yield from (row for row in rows if row[0].strip("`").removeprefix(f"{at}.").split(".")[0] in common)
            continue
        given = [one for one in get_args(inner) if one is not NoneType]  # of an optional model
        if len(given) == 1 and isinstance(given[0], type) and issubclass(given[0], BaseModel):
            inner = given[0]
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            yield from keys_of(inner, f"{at}.")
        else:
            yield [f"`{at}`", _allowed(inner, field), _default_of(field), tick(field_docs(model).get(name, ""))]


def kinds_of(hint: Any) -> list[type[BaseModel]]:
    """Return the models of a union of kinds, such as the drives of a lens; empty for any other type."""
    return [get_args(kind)[0] for kind in get_args(hint) if get_origin(kind) is Annotated]


def _default_of(field: FieldInfo) -> str:
    if field.is_required():
        return REQUIRED
    value = field.default if field.default is not PydanticUndefined else field.default_factory()  # type: ignore[misc]
    return "" if value is None or value == {} else _written(value)


def _written(value: Any) -> str:
    """Return a value as YAML writes it."""
    if isinstance(value, tuple):
        return f"`[{', '.join(f'{v:g}' if isinstance(v, float) else str(v) for v in value)}]`"
    if isinstance(value, float):
        return f"{value:g}"
    plain = json.dumps(value).replace('"', "")
    return plain if isinstance(value, int) and not isinstance(value, bool) else f"`{plain}`"


def _allowed(hint: Any, field: FieldInfo) -> str:
    """Return the allowed values of a type in words, with the bounds of a field."""
    inner = [one for one in get_args(hint) if one is not NoneType]
    if hint == dict[str, Any] | list[Any]:
        return "keys and values, or a list of them"
    if get_origin(hint) is Annotated:
        return _allowed(inner[0], FieldInfo.from_annotation(hint))
    if get_origin(hint) in (Union, UnionType):
        words = ["range" if get_origin(one) is dict else _allowed(one, field) for one in inner]
        return " or ".join(dict.fromkeys(words))
    if get_origin(hint) is Literal:
        return ", ".join(f"`{one}`" for one in inner)
    if get_origin(hint) is tuple:
        if Ellipsis in inner:
            least = f", at least {bound}" if (bound := _bound(field, "min_length")) else ""
            if get_origin(inner[0]) is tuple:
                return f"list of pairs{least}"
            return f"list of {_allowed(inner[0], FieldInfo())}{least}"
        return f"{len(inner)} numbers"
    if get_origin(hint) is dict:
        return "keys and values"
    low, high = _low(field), _high(field)
    names = {bool: "`true`, `false`", int: "whole number", float: "number", str: "text"}
    word = names.get(hint, "keyframes")
    return ", ".join(filter(None, (word, low, high)))


def _bound(field: FieldInfo, *names: str) -> Any:
    return next((v for m in field.metadata for n in names if (v := getattr(m, n, None)) is not None), None)


def _low(field: FieldInfo) -> str:
    if (bound := _bound(field, "ge")) is not None:
        return f"from {bound:,}"
    return "" if (bound := _bound(field, "gt")) is None else f"above {bound:,}"


def _high(field: FieldInfo) -> str:
    if (bound := _bound(field, "le")) is not None:
        return f"to {bound:,}" if bound < 2**53 else "to 2⁶³ − 1"
    return "" if (bound := _bound(field, "lt")) is None else f"below {bound:,}"


def recipe_keys() -> str:
    """Return the table of the keys of a recipe."""
    return table("key", "value", "default", "meaning", rows=keys_of(Recipe))


def card_keys() -> str:
    """Return the table of the keys of a scene card, except those of single kinds of lens."""
    return table("key", "value", "default", "meaning", rows=keys_of(SceneCard))


def picture_keys() -> str:
    """Return the table of the keys that only the card of a photographed scene has."""
    shared = {row[0] for row in keys_of(SceneCard)}
    return table(
        "key", "value", "default", "meaning", rows=(row for row in keys_of(PictureCard) if row[0] not in shared)
    )


def drive_keys() -> str:
    """Return the table of the keys that only one kind of lens has."""
    rows = []
    kinds = kinds_of(SceneCard.model_fields["lens"].annotation)
    counts = Counter(name for kind in kinds for name in kind.model_fields)
    for kind in kinds:
        docs = field_docs(kind)
        rows.append([f"**`{get_args(kind.model_fields['drive'].annotation)[0]}`**", "", docs["drive"]])
        own = [
            (name, field)
            for name, field in kind.model_fields.items()
            if name != "drive" and (counts[name] == 1 or (field.is_required() and counts[name] < len(kinds)))
        ]
        rows += [[f"`lens.{name}`", _allowed(field.annotation, field), docs[name]] for name, field in own]
    return table("drive, and its keys", "value", "meaning", rows=rows)


# --- plug-ins, sensors, actuators ----------------------------------------------------------------------


def _options(plugin_kind: str) -> str:
    rows = []
    for name in registry.names(plugin_kind):
        cls = registry.plugin_class(plugin_kind, name)
        rows.append([f"**`{name}`**", "", "", tick(summarise_plugin(cls))])
        said = field_docs(cls)
        for field in fields(cls):
            allowed, _, meaning = tick(said[field.name]).partition(": ")
            default = REQUIRED if field.default is MISSING else "" if field.default is None else _written(field.default)
            rows.append([f"`{field.name.rstrip('_')}`", allowed, default, meaning[0].upper() + meaning[1:]])
    return table("kind, and its keys", "value", "default", "meaning", rows=rows)


def light_keys() -> str:
    """Return the table of the kinds of light schedules with their keys."""
    return _options("lights")


def light_common_keys() -> str:
    """Return the table of the keys that all light schedules have."""
    rows = [[f"`{key}`", *tick(said).split(": ", 1)] for key, said in COMMON_KEYS.items()]
    return table("key of every kind", "value", "meaning", rows=rows)


def motion_keys() -> str:
    """Return the table of the kinds of lens motions with their keys."""
    return _options("motions")


def measure_table() -> str:
    """Return the table of the focus measures."""
    rows = []
    for name in registry.names("measures"):
        measure = build_or_class("measures", name)
        options = ", ".join(f"`{key}`" for key in registry.option_fields("measures", name))
        cost, degree = (format_attribute(measure, key) for key in ("cost", "degree"))
        rows.append([f"`{name}`", tick(summarise_plugin(measure)), cost, degree, options])
    return table("measure", "what it is", "cost", "degree", "options", rows=rows)


def search_table() -> str:
    """Return the table of the searches."""
    rows = []
    for name in registry.names("searches"):
        search = build_or_class("searches", name)
        options = ", ".join(f"`{key}`" for key in registry.option_fields("searches", name))
        rows.append([f"`{name}`", tick(summarise_plugin(search)), search_kind(search), options])
    return table("search", "what it is", "kind", "options", rows=rows)


def sensor_table() -> str:
    """Return the table of the sensors that come with saf_gen."""
    rows = []
    for name in sensor_names("spikes"):
        sensor = get_sensor(name)
        noise = "none" if not sensor.noise.threshold_noise else f"{sensor.threshold_noise_rms:.2%}".replace("%", " %")
        rows.append([f"`{name}`", f"{sensor.columns} × {sensor.rows}", f"{sensor.readout_hz:,}", noise])
    return table("sensor", "pixels", "readouts per second", "threshold noise", rows=rows)


def actuator_table() -> str:
    """Return the table of the actuators that come with saf_gen."""
    rows = []
    for name in actuator_names():
        one = get_actuator(name)
        numbers = (one.latency_s * 1000, one.resonance_hz, one.damping, one.backlash * 100, one.hysteresis * 100)
        rows.append([f"`{name}`", *(f"{number:g}" for number in numbers), one.reads])
    heads = ("latency, ms", "resonance, Hz", "damping", "backlash, %", "hysteresis, %", "sensor reads")
    return table("actuator", *heads, rows=rows)


# --- leaderboard and records ----------------------------------------------------------------------------


def leaderboard_conditions() -> str:
    """Return the table of the conditions by which sequences are sorted."""
    rows = ([axis.title, f"`{axis.name}`", axis.meaning, "; ".join(axis.order)] for axis in AXES)
    return table("condition", "axis", "meaning", "bins", rows=rows)


def curve_criteria() -> str:
    """Return the table of the criteria of a focus curve."""
    return table("number", "meaning", rows=([f"`{key}`", tick(said)] for key, said in field_docs(CurveQuality).items()))


def record_keys() -> str:
    """Return the table of the keys of a line of records.jsonl."""
    meanings = [(part.__name__.lower(), *item) for part in records.PARTS for item in field_docs(part).items()]
    meanings += [("follows", key, getattr(records.Judgement, key).__doc__) for key in records.FOLLOWING]
    return table("part", "key", "meaning", rows=([part, f"`{key}`", tick(text)] for part, key, text in meanings))


PARTS: dict[str, Callable[[], str]] = {
    part.__name__: part
    for part in (
        recipe_keys,
        card_keys,
        picture_keys,
        drive_keys,
        light_keys,
        light_common_keys,
        motion_keys,
        measure_table,
        search_table,
        sensor_table,
        actuator_table,
        leaderboard_conditions,
        curve_criteria,
        record_keys,
    )
}
"""Functions that make the parts of pages, by the name of the part."""
SCHEMAS = {"recipe.schema.json": recipe_schema, "scene.schema.json": card_schema}


def rewritten(page: Path) -> str:
    """Return the text of a page with its parts made from the present code."""
    text = page.read_text(encoding="utf-8")
    return PART.sub(lambda found: f"{found[1]}\n{PARTS[found[2]]()}\n{found[3]}", text)


def expected_files() -> dict[Path, str]:
    """Return all files of docs/ that are made from the code, completely or in part, with their expected text."""
    pages = {page: rewritten(page) for page in sorted(DOCS.rglob("*.md")) if PART.search(page.read_text("utf-8"))}
    written = {name: json.dumps(make(), indent=1, ensure_ascii=False) + "\n" for name, make in SCHEMAS.items()}
    return pages | {DOCS / name: text for name, text in written.items()}


if __name__ == "__main__":
    for path, text in expected_files().items():
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            sys.stdout.write(f"{path.relative_to(DOCS.parent)}\n")
