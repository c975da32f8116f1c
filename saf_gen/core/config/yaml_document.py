"""YAML documents read strictly: recipes, scene cards, sensor files.

A document becomes a frozen pydantic model or one line that names the file, the line, the value, what is
allowed and the nearest. YAML is parsed to nodes first, so that every value knows its line.
"""

from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, Tag, ValidationError
from pydantic_core import ErrorDetails

from saf_gen.errors import BadInput, closest

__all__ = ["FrozenModel", "YamlDocument", "parse_yaml", "read_model", "read_yaml"]

Key = str | int
Model = TypeVar("Model", bound=BaseModel)


TOO_DEEP = "this is nested too deep, or in a circle"
_YAML_SLIPS = (ValueError, ArithmeticError, LookupError, TypeError, AttributeError)
"""What PyYAML lets through from Python where a value, a directive or an escape has the form but no sense."""


class FrozenModel(BaseModel):
    """A document's value: immutable, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class YamlDocument:
    """Plain data of a YAML file, with the line of every value."""

    def __init__(self, path: Path, data: Any, lines: dict[tuple[Key, ...], int], text: str) -> None:
        self.path, self.data, self.text = path, data, text
        self._lines = lines

    def locate(self, *keys: Key) -> str:
        """``file:line`` of the value at these keys, or of the nearest enclosing one."""
        for end in range(len(keys), -1, -1):
            if keys[:end] in self._lines:
                return f"{self.path}:{self._lines[keys[:end]]}"
        return str(self.path)


def read_yaml(path: str | Path) -> YamlDocument:
    """Read a YAML file.

    Raises BadInput for a missing or unreadable file, broken YAML, or a key given twice.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        near = closest(path.name, [p.name for p in path.parent.glob("*.y*ml")])
        raise BadInput(f"{path} does not exist", nearest=str(path.with_name(near)) if near else "") from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path} cannot be read: {error}") from error
    return parse_yaml(text, path)


def parse_yaml(text: str, path: str | Path) -> YamlDocument:
    """Read YAML text that stands in the file ``path``.

    Raises BadInput for broken YAML, a value that is not what it looks like (the 13th month), or a key given
    twice.
    """
    path = Path(path)
    lines: dict[tuple[Key, ...], int] = {}
    try:
        node = _composed(text, path)
        data = None if node is None else _plain(node, (), lines, path)
    except RecursionError:
        deepest = lines[max(lines, key=len)]
        raise BadInput(TOO_DEEP, where=f"{path}:{deepest}") from None
    except yaml.MarkedYAMLError as error:
        line = f"{path}:{error.problem_mark.line + 1}" if error.problem_mark else str(path)
        raise BadInput(f"this is not YAML: {error.problem}", where=line) from error
    except yaml.YAMLError as error:
        raise BadInput(f"this is not YAML: {error}", where=str(path)) from error
    return YamlDocument(path, data, lines, text)


def read_model(model: type[Model], path: str | Path) -> tuple[Model, YamlDocument]:
    """Read a YAML file as ``model``; raises BadInput with file and line where it does not fit."""
    document = read_yaml(path)
    if not isinstance(document.data, dict):
        raise BadInput("the file holds no keys", where=str(path), allowed=", ".join(model.model_fields))
    try:
        return model.model_validate(document.data), document
    except ValidationError as error:
        raise _told(error, model, document) from error


def _composed(text: str, path: Path) -> yaml.Node | None:
    loader = yaml.SafeLoader(text)
    try:
        return loader.get_single_node()
    except RecursionError:
        raise BadInput(TOO_DEEP, where=f"{path}:{loader.get_mark().line + 1}") from None
    except _YAML_SLIPS as error:
        where = f"{path}:{loader.get_mark().line + 1}"
        raise BadInput(f"this is not YAML: {error}", where=where) from error
    finally:
        loader.dispose()


def _plain(node: yaml.Node, at: tuple[Key, ...], lines: dict[tuple[Key, ...], int], path: Path) -> Any:
    """Node to plain data, noting lines; YAML itself would let a second key silently win."""
    lines[at] = node.start_mark.line + 1
    if isinstance(node, yaml.MappingNode):
        out: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = str(key_node.value)
            here = f"{path}:{key_node.start_mark.line + 1}"
            if not isinstance(key_node, yaml.ScalarNode):
                raise BadInput("a key must be a name", where=here)
            if key in out:
                raise BadInput(f"the key {key!r} stands twice", where=here, hint="keep one of the two")
            out[key] = _plain(value_node, (*at, key), lines, path)
            lines[(*at, key)] = key_node.start_mark.line + 1
        return out
    if isinstance(node, yaml.SequenceNode):
        return [_plain(item, (*at, i), lines, path) for i, item in enumerate(node.value)]
    try:
        return yaml.SafeLoader("").construct_object(node)
    except _YAML_SLIPS as error:
        kind = node.tag.removeprefix("tag:yaml.org,2002:")
        # The others speak of PyYAML's inside, not of the value.
        why = f": {error}" if isinstance(error, ValueError | OverflowError) else ""
        raise BadInput(
            f"{node.value!r:.60} is no {kind}{why}",
            where=f"{path}:{lines[at]}",
            hint="put it in quotes if it is text",
        ) from error


def _told(error: ValidationError, model: type[BaseModel], document: YamlDocument) -> BadInput:
    """The first of pydantic's complaints, in our words."""
    # A misspelt key is told before the key that it leaves missing: it is what the user can see.
    complaints = sorted(error.errors(), key=lambda complaint: complaint["type"] != "extra_forbidden")
    first = complaints[0]
    more = f"({len(complaints) - 1} more after this one)" if len(complaints) > 1 else ""
    keys = _in_the_file(first, document.data)
    name = ".".join(str(k) for k in keys)
    where = document.locate(*keys)
    if first["type"] == "extra_forbidden":
        known = _keys_at(model, first["loc"][:-1])
        inside = f" in {'.'.join(str(k) for k in keys[:-1])}" if keys[:-1] else ""
        return BadInput(
            f"unknown key {str(keys[-1])!r}{inside}",
            where=where,
            allowed=", ".join(known),
            nearest=closest(keys[-1], known),
            hint=more,
        )
    if first["type"] == "missing":
        return BadInput(f"the key {name!r} is missing", where=where, hint=more)
    if first["type"] == "union_tag_invalid":
        kinds = [kind.strip(" '") for kind in first["ctx"]["expected_tags"].split(",")]
        key = first["ctx"]["discriminator"].strip("'()")
        return BadInput(
            f"{name}.{key} is {first['ctx']['tag']!r}",
            where=document.locate(*keys, key),
            allowed=", ".join(kinds),
            nearest=closest(first["ctx"]["tag"], kinds),
            hint=more,
        )
    expected = _expectation(first)
    value = first["input"]
    choices = [c.strip().strip("'") for c in expected.replace(" or ", ", ").split(",")]
    literal = first["type"] == "literal_error"
    return BadInput(
        f"{name} is {value!r}",
        where=where,
        allowed=", ".join(choices) if literal else expected,
        nearest=closest(value, choices) if literal else "",
        hint=more,
    )


def _in_the_file(complaint: ErrorDetails, data: Any) -> tuple[Key, ...]:
    """Where a complaint lies in the file: pydantic's path without the kinds of unions in it."""
    keys: list[Key] = []
    for i, key in enumerate(complaint["loc"]):
        known = key in data if isinstance(data, dict) else isinstance(data, list) and key in range(len(data))
        if known:
            data = data[key]
        if known or (complaint["type"] == "missing" and i == len(complaint["loc"]) - 1):
            keys.append(key)
    return tuple(keys)


def _expectation(complaint: ErrorDetails) -> str:
    if complaint["type"] == "string_pattern_mismatch":
        return "lower-case letters, digits, - and _, a letter or digit first"
    text = complaint["msg"].split(", unable to")[0]
    for prefix in ("Input should be ", "Value error, "):
        text = text.removeprefix(prefix)
    return text


def _keys_at(model: Any, keys: tuple[Key, ...]) -> list[str]:
    """The keys allowed at a place in a model, for the message about an unknown one."""
    for key in keys:
        model = _inner(model, key)
    for candidate in _alternatives(model):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return [f.alias or name for name, f in candidate.model_fields.items()]
    return []


def _inner(model: Any, key: Key) -> Any:
    for candidate in _alternatives(model):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            if key in candidate.model_fields:
                return candidate.model_fields[str(key)].annotation
        elif get_origin(candidate) is Annotated:
            kind, *notes = get_args(candidate)
            if any(isinstance(note, Tag) and note.tag == key for note in notes):
                return kind
        elif get_origin(candidate) in (dict, list, tuple):
            return get_args(candidate)[1 if get_origin(candidate) is dict else 0]
    return None


def _alternatives(model: Any) -> tuple[Any, ...]:
    return get_args(model) if get_origin(model) in (Union, UnionType) else (model,)
