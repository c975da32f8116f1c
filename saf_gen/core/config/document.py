"""Documents that users or programs write, checked against a model, with a line number for every error.

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

from pydantic import BaseModel, ConfigDict, Tag, TypeAdapter, ValidationError, ValidationInfo, field_validator
from pydantic_core import ErrorDetails

from saf_gen.errors import BadInput, closest, some_of

Key = str | int
Lines = Mapping[tuple[Key, ...], int]
"""The line number, from 1, of the value at each path of keys; () is the whole document."""

Model = TypeVar("Model")

STRICT = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
"""Settings of immutable models that refuse unknown keys and numbers that are not finite; a dataclass sets them as its
``__pydantic_config__``."""


class FrozenModel(BaseModel):
    """An immutable value of a document; an unknown key is an error, and true and false are no numbers."""

    model_config = STRICT

    @field_validator("*", mode="before")
    @classmethod
    def _refuse_flags(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse true and false, alone or in a list, where a field takes no flag; pydantic would read 1 and 0."""
        flags = [one for one in (value if isinstance(value, list | tuple) else [value]) if isinstance(one, bool)]
        if flags and not _takes_flags(cls.model_fields[str(info.field_name)].annotation):
            raise ValueError("a number or text, not true or false")
        return value


def _takes_flags(annotation: Any) -> bool:
    """Return whether a value of this type may be true or false, or hold such a value."""
    if annotation in (bool, Any, object) or isinstance(annotation, bool):
        return True
    return any(map(_takes_flags, get_args(annotation)))


class Document:
    """The plain data of a file, and the line of every value in it.

    ``find_lines`` is called only when a line is first requested, so that reading a file without errors is fast.
    """

    def __init__(self, data: Any, path: Path, *, find_lines: Callable[[], Lines]) -> None:
        self.data, self.path = data, path
        self._find_lines = find_lines

    @cached_property
    def _lines(self) -> Lines:
        return self._find_lines()

    def locate(self, *keys: Key) -> str:
        """Return ``file:line`` of the value at these keys, or of the nearest enclosing value."""
        for end in range(len(keys), -1, -1):
            if keys[:end] in self._lines:
                return f"{self.path}:{self._lines[keys[:end]]}"
        return str(self.path)

    def only(self, key: str) -> "Document":
        """Return a document that holds only this key of the mapping."""
        return Document({key: self.data[key]}, self.path, find_lines=lambda: self._lines)

    def without(self, key: str) -> "Document":
        """Return a document that lacks this key of the mapping."""
        data = {name: value for name, value in self.data.items() if name != key}
        return Document(data, self.path, find_lines=lambda: self._lines)


MAX_DATA_FILE_BYTES = 1 << 28
"""Largest size, in bytes, of a file that programs write, such as the manifest of half a million sequences."""
MAX_LINE = 1 << 24
"""Largest number of characters per line of a file that programs write, such as the records of an evaluation."""


def read_text(path: Path, *, max_bytes: int = MAX_DATA_FILE_BYTES, encoding: str = "utf-8", hint: str = "") -> str:
    """Return the text of a file, with every line end converted to a newline.

    Raises BadInput if the file is missing (the error then suggests the nearest name), cannot be read, is not a regular
    file, or has more than ``max_bytes`` bytes.
    """
    try:
        check_plain_file(path, max_bytes=max_bytes, hint=hint)
        return path.read_text(encoding=encoding)
    except FileNotFoundError:
        others = Path(str(path)).parent.glob(f"*{path.suffix[:2]}*" if path.suffix else "*")
        near = closest(path.name, [p.name for p in others])
        nearest = str(path.with_name(near)) if near else ""
        raise BadInput(f"{path} does not exist", nearest=nearest, hint=hint) from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path} cannot be read: {error}", hint=hint) from error


def check_plain_file(path: Path, *, max_bytes: int = MAX_DATA_FILE_BYTES, hint: str = "") -> None:
    """Raise BadInput for a folder, a pipe, a device, or a file of more than ``max_bytes`` bytes.

    Raises OSError if the path does not exist.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        what = "a folder" if stat.S_ISDIR(found.st_mode) else "not a file on a disk"
        raise BadInput(f"{path} is {what}", hint=hint)
    if found.st_size > max_bytes:
        raise BadInput(f"{path} has {found.st_size:,} bytes", allowed=f"at most {max_bytes:,}", hint=hint)


def read_lines(path: Path, *, hint: str = "") -> Generator[str, None, None]:
    """Yield the lines of a text file of any size, without line ends, keeping only one line in memory.

    Raises BadInput if the file cannot be read, is not a regular file, or has a line of more than MAX_LINE characters.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise BadInput(f"{path} is not a file on a disk", hint=hint)
        with path.open(encoding="utf-8") as file:
            number = 0
            while line := file.readline(MAX_LINE + 1):
                number += 1
                if len(line) > MAX_LINE:
                    allowed = f"at most {MAX_LINE:,} characters"
                    raise BadInput("the line is too long", where=f"{path}:{number}", allowed=allowed, hint=hint)
                yield line.removesuffix("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path} cannot be read: {error}", hint=hint) from error


def check_valid_unicode(text: str, *, where: str) -> None:
    """Raise BadInput for a text with an unpaired surrogate, which an escape may produce and no file can hold."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        half = text[error.start : error.end]
        raise BadInput(
            f"the text contains {half!r}, an unpaired surrogate", where=where, allowed="valid Unicode text"
        ) from None


_adapter = cache(TypeAdapter)


def validate_document(model: type[Model], document: Document, *, hint: str = "") -> Model:
    """Return the document as a value of ``model``, a pydantic model or a dataclass.

    Raises BadInput for the first error, with its file, line and value, and what is allowed. ``hint`` is the next step
    for a file that users should not edit because a program wrote it.
    """
    checked: Any = model  # mypy does not regard a type[Model] as hashable
    if not isinstance(document.data, dict):
        allowed = some_of(_fields(model))
        raise BadInput("the file holds no keys", where=document.locate(), allowed=allowed, hint=hint)
    try:
        found: Model = _adapter(checked).validate_python(document.data)
        return found
    except ValidationError as error:
        raise _describe_first_error(error, model, document=document, hint=hint) from error


def _describe_first_error(error: ValidationError, model: Any, *, document: Document, hint: str) -> BadInput:
    """Return the first of pydantic's errors as a BadInput of one line."""
    # A misspelt key is reported before the key that is missing because of it: the user can see it in the file.
    details = sorted(error.errors(), key=lambda one: one["type"] not in UNKNOWN_KEY)
    first = details[0]
    if len(details) > 1:
        hint = f"({len(details) - 1} more after this one)" + (f"; {hint}" if hint else "")
    keys = _keys_in_file(first, document.data)
    name, where = _dotted(keys), document.locate(*keys)
    if first["type"] in UNKNOWN_KEY:
        known = list(_fields(_annotation_at(model, first["loc"][:-1])))
        inside = f" in {_dotted(keys[:-1])}" if keys[:-1] else ""
        problem, allowed, choices = f"unknown key {str(keys[-1])!r}{inside}", some_of(known, keys[-1]), known
        return BadInput(problem, where=where, allowed=allowed, nearest=closest(keys[-1], choices), hint=hint)
    if first["type"] == "missing":
        return BadInput(f"the key {name!r} is missing", where=where, allowed=_meaning(model, first["loc"]), hint=hint)
    if first["type"] == "union_tag_invalid":
        key, value = first["ctx"]["discriminator"].strip("'()"), first["ctx"]["tag"]
        tags = [kind.strip(" '") for kind in first["ctx"]["expected_tags"].split(",")]
        choices = [tag for tag in tags if " " not in tag]  # one with a blank is chosen by another key
        name, where, allowed = f"{name}.{key}", document.locate(*keys, key), some_of(choices, value)
    elif first["type"] == "literal_error":
        expected = _expectation(first).replace(" or ", ", ")
        value, choices = first["input"], [choice.strip(" '") for choice in expected.split(",")]
        allowed = some_of(choices, value)
    elif first["type"] in MAPPING_EXPECTED:
        expected_keys = some_of(_fields(_annotation_at(model, first["loc"])))
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


def _keys_in_file(error: ErrorDetails, data: Any) -> tuple[Key, ...]:
    """Return the path of an error in the file: pydantic's path without the names of union members."""
    keys: list[Key] = []
    for i, key in enumerate(error["loc"]):
        known = key in data if isinstance(data, dict) else isinstance(data, list) and key in range(len(data))
        if known:
            data = data[key]
        if known or (error["type"] == "missing" and i == len(error["loc"]) - 1):
            keys.append(key)
    return tuple(keys)


def _expectation(error: ErrorDetails) -> str:
    if error["type"] == "string_pattern_mismatch":
        return "lower-case letters, digits, - and _, a letter or digit first"
    text = error["msg"].split(", unable to")[0]
    for prefix in ("Input should be ", "Value error, "):
        text = text.removeprefix(prefix)
    return text


def _fields(model: Any) -> dict[str, Any]:
    """Return the annotation of each key that a model has in a file; empty if ``model`` is not a model."""
    for candidate in _alternatives(model):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return {f.alias or name: f.annotation for name, f in candidate.model_fields.items()}
        if isinstance(candidate, type) and is_dataclass(candidate):
            hints = get_type_hints(candidate, include_extras=True)
            return {f.name: hints[f.name] for f in fields(candidate) if f.init}
    return {}


def _annotation_at(model: Any, loc: tuple[Key, ...]) -> Any:
    """Return the annotation to which one of pydantic's paths leads within a model."""
    for key in loc:
        model = _annotation_inside(model, key)
    return model


def _meaning(model: Any, loc: tuple[Key, ...]) -> str:
    """Return the text in the annotation of a key, Annotated[…, "its meaning"]; '' if it has no text."""
    return next((note for note in get_args(_annotation_at(model, loc))[1:] if isinstance(note, str)), "")


def _annotation_inside(model: Any, key: Key) -> Any:
    if key in (known := _fields(model)):
        return known[str(key)]
    for candidate in _alternatives(model):
        kind, *notes = get_args(candidate) if get_origin(candidate) is Annotated else (candidate,)
        if any(isinstance(note, Tag) and note.tag == key for note in notes):
            return kind
        if get_origin(kind) in (dict, list, tuple):
            return get_args(kind)[1 if get_origin(kind) is dict else 0]
    return None


def _alternatives(model: Any) -> tuple[Any, ...]:
    return get_args(model) if get_origin(model) in (Union, UnionType) else (model,)
