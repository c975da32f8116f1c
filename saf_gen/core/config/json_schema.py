"""JSON Schemas of the YAML files that users write, so that an editor completes keys and marks mistakes.

A schema accepts everything that the strict models accept. It refuses unknown keys, wrong types and numbers out of
range. Only ``saf-gen recipes check`` checks entries that depend on other files, such as the names of scenes.
"""

import typing
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from types import NoneType
from typing import Any

from pydantic import BaseModel

from saf_gen.core.config import registry
from saf_gen.core.config.field_docs import field_docs

Schema = dict[str, Any]
DIALECT = "https://json-schema.org/draft/2020-12/schema"

PAIR: Schema = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
CHOICE: Schema = {
    "type": "object",
    "properties": {"choice": {"type": "array", "minItems": 1}},
    "required": ["choice"],
    "additionalProperties": False,
}
RANGE: Schema = {
    "description": "A number that is drawn: {uniform: [low, high]}, {log_uniform: [low, high]} or {choice: [...]}.",
    "anyOf": [
        *(
            {"type": "object", "properties": {form: PAIR}, "required": [form], "additionalProperties": False}
            for form in ("uniform", "log_uniform")
        ),
        CHOICE,
    ],
}
PLAIN_SCHEMA: Schema = {"type": ["number", "string", "boolean"]}
OPEN: Schema = {"$ref": "#/$defs/Range"}
"""A value that is left open as a range; :func:`model_schema` adds the definition to every schema."""
PARAMETER: Schema = {"anyOf": [PLAIN_SCHEMA, {"type": "array", "items": PLAIN_SCHEMA}, OPEN]}
"""A parameter of a scene: a plain value, a list of them, or a range."""


def model_schema(model: type[BaseModel], title: str) -> Schema:
    """Return the schema of a document, with the docstrings of its models and their fields as descriptions."""
    schema = model.model_json_schema()
    for cls in {model, *_models_in(model)}:
        part = schema if cls is model else schema["$defs"][cls.__name__]
        part.pop("title", None)
        part["description"] = (cls.__doc__ or "").split("\n\n")[0].replace("``", "")
        for name, one in part["properties"].items():
            one.pop("title", None)
            if text := field_docs(cls).get(name):
                one["description"] = text.replace("``", "")
    schema["$defs"] = schema.get("$defs", {}) | {"Range": RANGE}
    return {"$schema": DIALECT, "title": title, **schema}


def _models_in(model: type[BaseModel]) -> Iterable[type[BaseModel]]:
    waiting: list[Any] = [field.annotation for field in model.model_fields.values()]
    while waiting:
        one = waiting.pop()
        if isinstance(one, type) and issubclass(one, BaseModel):
            yield one
            yield from _models_in(one)
        waiting.extend(typing.get_args(one))


def define_schema(schema: Schema, plugin_kind: str, *, common: Mapping[str, Schema] | None = None) -> Schema:
    """Add a definition of ``{kind: ..., ...}`` for each plug-in of a kind, and return a reference to their union.

    ``common`` maps further keys, which all of them take, to schemas. Each value may be left open, and the component
    itself may be a choice.
    """
    kinds = []
    for name in registry.names(plugin_kind):
        schema["$defs"][f"{plugin_kind}.{name}"] = _kind_schema(plugin_kind, name, common=dict(common or {}))
        kinds.append({"$ref": f"#/$defs/{plugin_kind}.{name}"})
    choice = {**CHOICE, "properties": {"choice": {"type": "array", "minItems": 1, "items": {"anyOf": kinds}}}}
    schema["$defs"][plugin_kind] = {"anyOf": [*kinds, choice]}
    return {"$ref": f"#/$defs/{plugin_kind}"}


def _kind_schema(plugin_kind: str, name: str, *, common: dict[str, Schema]) -> Schema:
    cls = registry.plugin_class(plugin_kind, name)
    hints, docs = typing.get_type_hints(cls), field_docs(cls)
    keys: dict[str, Schema] = {"kind": {"const": name}}
    needed = ["kind"]
    for field in fields(cls):
        key = field.name.rstrip("_")
        keys[key] = {"anyOf": [_value_schema(hints[field.name]), OPEN]}
        if field.name in docs:
            keys[key]["description"] = docs[field.name].replace("``", "")
        if field.default is MISSING and field.default_factory is MISSING:
            needed.append(key)
    about = " ".join((cls.__doc__ or "").split("\n\n")[0].split()).replace("``", "")
    return {
        "type": "object",
        "description": about,
        "properties": keys | common,
        "required": needed,
        "additionalProperties": False,
    }


def _value_schema(hint: Any) -> Schema:
    """Return the schema of a value with this type hint; a mapping is written as the path of a file."""
    inner = [one for one in typing.get_args(hint) if one is not NoneType]
    if NoneType in typing.get_args(hint):
        return {"anyOf": [*(_value_schema(one) for one in inner), {"type": "null"}]}
    if typing.get_origin(hint) is tuple:
        return {"type": "array", "items": _value_schema(inner[0])}
    names = {bool: "boolean", int: "integer", float: "number"}
    return {"type": names.get(hint, "string")}
