"""Documents that users write or programs hand over, checked against a model, with a line for every error.

:mod:`saf_gen.core.config.yaml_document` and :mod:`saf_gen.core.config.json_document` read a file into a
:class:`Document`; :func:`validate_document` turns it into a value of a frozen pydantic model.
"""

import stat
from collections.abc import Callable, Generator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache, cached_property
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Tag, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from saf_gen.core.object_store import AnyPath
from saf_gen.errors import BadInput, closest

Key = str | int
Lines = Mapping[tuple[Key, ...], int]
"""The line, from 1, of the value at each path of keys; () is the whole document."""

Model = TypeVar("Model")

STRICT = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
"""Immutable, no unknown keys, finite numbers; a dataclass takes it as ``__pydantic_config__``."""


class FrozenModel(BaseModel):
    """An immutable value of a document; an unknown key is an error."""

    model_config = STRICT


class Document:
    """Plain data of a file, and the line of every value in it.

    ``find_lines`` is called when the first line is asked for, so that reading a file without errors stays fast.
    """

    def __init__(self, data: Any, path: AnyPath, *, find_lines: Callable[[], Lines]) -> None:
        self.data, self.path = data, path
        self._find_lines = find_lines

    @cached_property
    def _lines(self) -> Lines:
        return self._find_lines()

    def locate(self, *keys: Key) -> str:
        """Return ``file:line`` of the value at these keys, or of the nearest enclosing one."""
        for end in range(len(keys), -1, -1):
            if keys[:end] in self._lines:
                return f"{self.path}:{self._lines[keys[:end]]}"
        return str(self.path)

    def only(self, key: str) -> "Document":
        """Return what a mapping holds under this key alone."""
        return Document({key: self.data[key]}, self.path, find_lines=lambda: self._lines)


MAX_BYTES = 1 << 30
"""Of a file that programs write, such as the manifest of a dataset."""
MAX_LINE = 1 << 24
"""Characters of a line of a file that programs write, such as the records of an evaluation."""


def read_text(path: AnyPath, *, most: int = MAX_BYTES, encoding: str = "utf-8", hint: str = "") -> str:
    """Return the text of a file; ends of lines become a newline.

    Raises BadInput, with the nearest name, where it cannot be read, is no file on a disk, or has over ``most`` bytes.
    """
    try:
        check_plain_file(path, most=most, hint=hint)
        return path.read_text(encoding=encoding)
    except FileNotFoundError:
        others = Path(str(path)).parent.glob(f"*{path.suffix[:2]}*" if path.suffix else "*")
        near = closest(path.name, [p.name for p in others])
        nearest = str(path.with_name(near)) if near else ""
        raise BadInput(f"{path} does not exist", nearest=nearest, hint=hint) from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path} cannot be read: {error}", hint=hint) from error


def check_plain_file(path: AnyPath, *, most: int = MAX_BYTES, hint: str = "") -> None:
    """Raise BadInput for a folder, a pipe, a device, or a file of over ``most`` bytes.

    Raises OSError where there is nothing.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        what = "a folder" if stat.S_ISDIR(found.st_mode) else "not a file on a disk"
        raise BadInput(f"{path} is {what}", hint=hint)
    if found.st_size > most:
        raise BadInput(f"{path} has {found.st_size:,} bytes", allowed=f"at most {most:,}", hint=hint)


def read_lines(path: Path, *, hint: str = "") -> Generator[str, None, None]:
    """Yield the lines of a text file without their ends, one in memory at a time; the file may have any size.

    Raises BadInput where it cannot be read, is no file on a disk, or a line is longer than MAX_LINE.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise BadInput(f"{path} is not a file on a disk", hint=hint)
        with path.open(encoding="utf-8") as file:
            number = 0
            while line := file.readline(MAX_LINE + 1):
                number += 1
                if len(line) > MAX_LINE:
                    raise BadInput("the line is too long", where=f"{path}:{number}", allowed=f"{MAX_LINE:,}", hint=hint)
                yield line.removesuffix("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path} cannot be read: {error}", hint=hint) from error


def check_letters_whole(text: str, *, where: str) -> None:
    """Raise BadInput for a text with half a letter, as an escape may write it: no file could hold it."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        half = text[error.start : error.end]
        raise BadInput(f"this holds {half!r}, which is half a letter", where=where, allowed="text of Unicode") from None


_adapter = cache(TypeAdapter)


def validate_document(model: type[Model], document: Document, *, hint: str = "") -> Model:
    """Return the document as a value of ``model``, a pydantic model or a dataclass.

    Raises BadInput for the first thing that does not fit, with file, line, value, and what is allowed.
    ``hint`` is the next step where the file itself cannot be edited (a file that a program wrote).
    """
    checked: Any = model  # to mypy a type[Model] is not hashable
    if not isinstance(document.data, dict):
        allowed = ", ".join(_fields(model))
        raise BadInput("the file holds no keys", where=document.locate(), allowed=allowed, hint=hint)
    try:
        found: Model = _adapter(checked).validate_python(document.data)
        return found
    except ValidationError as error:
        raise _first_complaint(error, model, document=document, hint=hint) from error


def _first_complaint(error: ValidationError, model: Any, *, document: Document, hint: str) -> BadInput:
    """Return the first of pydantic's complaints as one line of ours."""
    # A misspelt key comes before the key that it leaves missing: it is what the user can see in the file.
    complaints = sorted(error.errors(), key=lambda one: one["type"] not in UNKNOWN_KEY)
    first = complaints[0]
    if len(complaints) > 1:
        hint = f"({len(complaints) - 1} more after this one)" + (f"; {hint}" if hint else "")
    keys = _keys_in_file(first, document.data)
    name, where = _dotted(keys), document.locate(*keys)
    if first["type"] in UNKNOWN_KEY:
        known = list(_fields(_annotation_at(model, first["loc"][:-1])))
        inside = f" in {_dotted(keys[:-1])}" if keys[:-1] else ""
        problem, allowed, choices = f"unknown key {str(keys[-1])!r}{inside}", ", ".join(known), known
        return BadInput(problem, where=where, allowed=allowed, nearest=closest(keys[-1], choices), hint=hint)
    if first["type"] == "missing":
        return BadInput(f"the key {name!r} is missing", where=where, allowed=_meaning(model, first["loc"]), hint=hint)
    if first["type"] == "union_tag_invalid":
        key, value = first["ctx"]["discriminator"].strip("'()"), first["ctx"]["tag"]
        choices = [kind.strip(" '") for kind in first["ctx"]["expected_tags"].split(",")]
        name, where, allowed = f"{name}.{key}", document.locate(*keys, key), ", ".join(choices)
    elif first["type"] == "literal_error":
        expected = _expectation(first).replace(" or ", ", ")
        value, choices = first["input"], [choice.strip(" '") for choice in expected.split(",")]
        allowed = ", ".join(choices)
    elif first["type"] in MAPPING_EXPECTED:
        expected_keys = ", ".join(_fields(_annotation_at(model, first["loc"])))
        value, choices, allowed = first["input"], [], f"a mapping with the keys {expected_keys}"
    else:
        value, choices, allowed = first["input"], [], _expectation(first)
    text = repr(value)
    return BadInput(
        f"{name or 'the file'} is {text if len(text) <= 200 else f'{text[:200]}…'}",
        where=where,
        allowed=allowed,
        nearest=closest(value, choices),
        hint=hint,
    )


UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")
MAPPING_EXPECTED = ("dataclass_type", "model_type")


def _dotted(keys: tuple[Key, ...]) -> str:
    return ".".join(str(key) for key in keys)


def _keys_in_file(complaint: ErrorDetails, data: Any) -> tuple[Key, ...]:
    """Return where a complaint lies in the file: pydantic's path without the kinds of unions in it."""
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


def _fields(model: Any) -> dict[str, Any]:
    """Return the keys of a model in a file, each with its annotation; none for what is not a model."""
    for candidate in _alternatives(model):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return {f.alias or name: f.annotation for name, f in candidate.model_fields.items()}
        if isinstance(candidate, type) and is_dataclass(candidate):
            hints = get_type_hints(candidate, include_extras=True)
            return {f.name: hints[f.name] for f in fields(candidate) if f.init}
    return {}


def _annotation_at(model: Any, loc: tuple[Key, ...]) -> Any:
    """Return the annotation at a path of pydantic's within a model."""
    for key in loc:
        model = _annotation_inside(model, key)
    return model


def _meaning(model: Any, loc: tuple[Key, ...]) -> str:
    """Return the text that stands in the annotation of a key, Annotated[…, "what it means"], if any."""
    return next((note for note in get_args(_annotation_at(model, loc))[1:] if isinstance(note, str)), "")


def _annotation_inside(model: Any, key: Key) -> Any:
    if key in (known := _fields(model)):
        return known[str(key)]
    for candidate in _alternatives(model):
        if get_origin(candidate) is Annotated:
            kind, *notes = get_args(candidate)
            if any(isinstance(note, Tag) and note.tag == key for note in notes):
                return kind
        elif get_origin(candidate) in (dict, list, tuple):
            return get_args(candidate)[1 if get_origin(candidate) is dict else 0]
    return None


def _alternatives(model: Any) -> tuple[Any, ...]:
    return get_args(model) if get_origin(model) in (Union, UnionType) else (model,)
