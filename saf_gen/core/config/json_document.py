"""Strict reading of JSON files (manifests, records, predictions, tuned methods), and writing with a checksum."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn

from saf_gen.core.config.document import Document, Key, Lines, check_plain_file, check_valid_unicode, read_text
from saf_gen.errors import BadInput

TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\],:]|[^\s{}\[\],:"]+')
CONSTANTS = ("NaN", "Infinity", "-Infinity")
CHECKSUM = "checksum"
"""Last key of an object that programs write; its value is the first 16 digits of the SHA-256 of the text before it."""
MAX_VALUES, MAX_WALKED = 10_000_000, 1 << 23
"""Values of a document, of which each takes Python 100 bytes, and characters of one in which lines are looked for."""
_CHECKSUM_AT_END = re.compile(rf'"{CHECKSUM}": "([0-9a-f]{{16}})"\n?\}}\n?\Z')


def read_json(path: str | Path, *, hint: str = "") -> Document:
    """Read a JSON file.

    Raises BadInput, with ``hint`` as the next step, if the file is missing or unreadable, or holds broken JSON, NaN or
    an infinity, a key given twice, or nesting too deep for Python.
    """
    return parse_json(read_text(Path(path), hint=hint), path, hint=hint)


def parse_json(text: str, path: str | Path, *, first_line: int = 1, hint: str = "") -> Document:
    """Read JSON text that begins in line ``first_line`` of the file ``path``; raise BadInput as :func:`read_json`."""
    path = Path(path)
    try:
        if (values := sum(map(text.count, ",[{"))) > MAX_VALUES:
            raise BadInput(
                f"this holds {values:,} values",
                where=f"{path}:{first_line}",
                allowed=f"at most {MAX_VALUES:,}",
                hint=hint,
            )
        data = json.loads(text, object_pairs_hook=_dict_of_unique_keys, parse_constant=_refuse_constant)
        if "\\u" in text:
            check_valid_unicode(json.dumps(data, ensure_ascii=False), where=f"{path}:{first_line}")
    except json.JSONDecodeError as error:
        where = f"{path}:{error.lineno + first_line - 1}"
        raise BadInput(f"this is not JSON: {error.msg}", where=where, hint=hint) from error
    except RecursionError:
        raise BadInput("this is nested too deep", where=f"{path}:{first_line}", hint=hint) from None
    except ValueError as error:
        problem, line = _find_problem(text, first_line)
        raise BadInput(problem, where=f"{path}:{line}", hint=hint) from error
    return Document(data, path, find_lines=lambda: _find_lines(text, first_line))


def format_checked_json(document: Mapping[str, Any], *, indent: int | None = None) -> str:
    """Return an object as JSON text without a final line end; its last key, a checksum, reveals any later change."""
    text = json.dumps({**document, CHECKSUM: ""}, indent=indent, ensure_ascii=False, allow_nan=False)
    at = text.rindex('""') + 1
    return f"{text[:at]}{_digits(text[:at])}{text[at:]}"


def parse_checked_json(text: str, path: str | Path, *, first_line: int = 1, hint: str = "") -> Document:
    """Read JSON text as :func:`parse_json` does, verify its checksum, and leave the checksum out of the document.

    An object without a checksum, as earlier versions wrote, is accepted. Raises BadInput as :func:`read_json` does, and
    if the text was changed after it was written.
    """
    document = parse_json(text, path, first_line=first_line, hint=hint)
    if isinstance(document.data, dict) and CHECKSUM in document.data:
        del document.data[CHECKSUM]
        found = _CHECKSUM_AT_END.search(text)
        if found is None or found[1] != _digits(text[: found.start(1)]):
            raise BadInput(
                f"this was changed after it was written: its {CHECKSUM} does not match",
                where=document.locate(),
                hint=f"{hint}, or remove the key {CHECKSUM} if you changed it yourself",
            )
    return document


def _digits(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def load_plain_json(source: str | Path) -> Any:
    """Return the plain data of a JSON text or file that the caller ignores if it cannot be read.

    Raises ValueError for every problem: a missing file, text that is not JSON, or nesting too deep for Python. Unlike
    :func:`read_json` it does not look for the nearest name, because a plan tries thousands of files that do not exist.
    """
    try:
        if isinstance(source, Path):
            check_plain_file(source)
            source = source.read_text(encoding="utf-8")
        return json.loads(source)
    except (BadInput, OSError, RecursionError) as error:
        raise ValueError(f"not JSON: {error}") from error


def _dict_of_unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key is given twice")
    return found


def _refuse_constant(constant: str) -> NoReturn:
    raise ValueError(constant)


def _find_problem(text: str, line: int) -> tuple[str, int]:
    """Return the first problem that JSON's grammar or Python allows but this module refuses, and its line."""
    seen = set()
    if len(text) > MAX_WALKED:
        return "a key is given twice, or a number is NaN, infinite or too long", line
    for keys, at, token in _walk(text, line):
        if token == ":" and keys in seen:
            return f"the key {keys[-1]!r} is given twice", at
        if token in CONSTANTS:
            return f"{token} is not a JSON number", at
        if len(token) > 4000 and token.lstrip("-").isdigit():
            return f"{token[:12]}… has too many digits", at
        seen.add(keys)
    return "this is not JSON", line


def _find_lines(text: str, line: int) -> Lines:
    lines: dict[tuple[Key, ...], int] = {}
    if len(text) > MAX_WALKED:  # the names of the keys must do
        return lines
    for keys, at, _ in _walk(text, line):
        lines.setdefault(keys, at)
    return lines


def _walk(text: str, line: int) -> Iterator[tuple[tuple[Key, ...], int, str]]:
    """Yield the path and line of every key (with ':') and of every value (with its first token).

    The text must be valid JSON at least up to the point at which the caller stops.
    """
    keys: list[Any] = []  # None while the next key of an object is still to come
    end = 0
    for match in TOKEN.finditer(text):
        line += text.count("\n", end, match.start())
        token, end = match[0], match.start()
        if token in "}]":
            keys.pop()
        elif token == ",":
            keys[-1] = keys[-1] + 1 if isinstance(keys[-1], int) else None
        elif token != ":" and keys and keys[-1] is None:
            keys[-1] = json.loads(token)
            yield tuple(keys), line, ":"
        elif token != ":":
            yield tuple(keys), line, token
            if token in "{[":
                keys.append(None if token == "{" else 0)
