"""Strict reading of YAML files: recipes, scene cards, sensor and actuator files.

Numbers, true, false and null follow YAML 1.2 (its core schema, https://yaml.org/spec/1.2.2/#103-core-schema), in which
1e2 is a number. What YAML 1.1 reads otherwise, and readers therefore understand in two ways, is refused: yes, no, on
and off, 010 and 12:30.
"""

import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from saf_gen.core.config.document import Document, Key, check_valid_unicode, read_text
from saf_gen.errors import BadInput

TOO_DEEP, TOO_MANY = "this is nested too deep, or contains itself", "this holds too many values"
MAX_YAML_BYTES, MAX_VALUES = 1 << 22, 100_000
"""Limits of a file that users write. Each repetition of a value by an alias counts, because a few lines can hold
millions."""
AMBIGUOUS = (
    (r"(?i:yes|no|on|off)", "is true or false in YAML 1.1 and text in YAML 1.2", "write true or false"),
    (r"[-+]?0[0-9_]*[0-9]", "is octal in YAML 1.1 and decimal in YAML 1.2", "write it without the leading 0"),
    (r"[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?", "counts in sixties in YAML 1.1 and is text in YAML 1.2",
     "write seconds"),
)  # fmt: skip
"""Plain values that two versions of YAML read otherwise: pattern, fault and what to write instead."""


class _Loader(yaml.SafeLoader):
    """PyYAML's loader with the rules of YAML 1.2 for plain values; digits may be grouped by underscores, as before."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 PyYAML's own attribute, which add_implicit_resolver fills
    composed = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next node; PyYAML takes half a minute for the million values that 4 MiB can hold."""
        self.composed += 1
        if self.composed > 2 * MAX_VALUES:  # a key is a node, too
            raise yaml.composer.ComposerError(None, None, TOO_MANY, self.get_mark())
        node: yaml.Node | None = super().compose_node(parent, index)
        return node


for _kind, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("int", r"[-+]?[0-9][0-9_]*|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    ("float", r"[-+]?(\.[0-9]+|[0-9][0-9_]*(\.[0-9_]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
     "-+0123456789."),
):  # fmt: skip
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_kind}", re.compile(f"^(?:{_pattern})$"), list(_first))

_YAML_ERRORS = (ValueError, ArithmeticError, LookupError, TypeError, AttributeError)
"""Exceptions that Python raises through PyYAML for values and escapes that are well formed but have no meaning."""


def read_yaml(path: str | Path) -> Document:
    """Read a YAML file.

    Raises BadInput for a missing or unreadable file, broken YAML, an impossible value (such as a date in the 13th
    month), or a key given twice.
    """
    return parse_yaml(read_text(Path(path), max_bytes=MAX_YAML_BYTES), path)


def parse_yaml(text: str, path: str | Path) -> Document:
    """Read YAML text; errors name the file ``path``. Raises BadInput as :func:`read_yaml` does."""
    path = Path(path)
    lines: dict[tuple[Key, ...], int] = {}
    try:
        node = _compose(text, path)
        data = None if node is None else _to_plain(node, (), lines=lines, path=path, loader=_Loader(""))
    except RecursionError:
        deepest = lines[max(lines, key=len)]
        raise BadInput(TOO_DEEP, where=f"{path}:{deepest}") from None
    except yaml.MarkedYAMLError as error:
        line = f"{path}:{error.problem_mark.line + 1}" if error.problem_mark else str(path)
        raise BadInput(f"this is not YAML: {error.problem}", where=line) from error
    except yaml.YAMLError as error:
        raise BadInput(f"this is not YAML: {error}", where=str(path)) from error
    return Document(data, path, find_lines=lambda: lines)


@lru_cache(maxsize=256)
def _compose(text: str, path: Path) -> yaml.Node | None:
    """Return the nodes of the text, cached because a command reads some files, such as scene cards, many times."""
    loader = _Loader(text)
    try:
        return loader.get_single_node()
    except RecursionError:
        raise BadInput(TOO_DEEP, where=f"{path}:{loader.get_mark().line + 1}") from None
    except _YAML_ERRORS as error:
        where = f"{path}:{loader.get_mark().line + 1}"
        raise BadInput(f"this is not YAML: {error}", where=where) from error
    finally:
        loader.dispose()


def _to_plain(
    node: yaml.Node, at: tuple[Key, ...], *, lines: dict[tuple[Key, ...], int], path: Path, loader: yaml.SafeLoader
) -> Any:
    """Return the plain data of a node and note its lines; refuse a repeated key, which PyYAML would silently accept."""
    lines[at] = node.start_mark.line + 1
    if len(lines) > MAX_VALUES:
        raise BadInput(TOO_MANY, where=f"{path}:{lines[at]}", allowed=f"at most {MAX_VALUES:,}")
    if isinstance(node, yaml.MappingNode):
        out: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = str(key_node.value)
            here = f"{path}:{key_node.start_mark.line + 1}"
            if not isinstance(key_node, yaml.ScalarNode):
                raise BadInput("a key must be a name", where=here)
            check_valid_unicode(key, where=here)
            if key_node.value == "<<" and key_node.style is None:
                raise BadInput("the merge key << is not read", where=here, hint="write the keys out")
            if key in out:
                raise BadInput(f"the key {key!r} is given twice", where=here, hint="keep one of the two")
            out[key] = _to_plain(value_node, (*at, key), lines=lines, path=path, loader=loader)
            lines[(*at, key)] = key_node.start_mark.line + 1
        return out
    if isinstance(node, yaml.SequenceNode):
        return [_to_plain(item, (*at, i), lines=lines, path=path, loader=loader) for i, item in enumerate(node.value)]
    check_valid_unicode(str(node.value), where=f"{path}:{lines[at]}")
    if getattr(node, "style", None) is None:  # not in quotes
        for pattern, fault, advice in AMBIGUOUS:
            if re.fullmatch(pattern, node.value):
                raise BadInput(
                    f"{at[-1] if at else 'the file'} is {node.value:.60}, which {fault}",
                    where=f"{path}:{lines[at]}",
                    hint=f"{advice}, or put it in quotes if it is text",
                )
    try:
        return loader.construct_object(node)
    except _YAML_ERRORS as error:
        kind = node.tag.removeprefix("tag:yaml.org,2002:")
        # Other exceptions describe the internals of PyYAML and not the value.
        why = f": {error}" if isinstance(error, ValueError | OverflowError) else ""
        raise BadInput(
            f"{node.value!r:.60} is not a valid {kind}{why}",
            where=f"{path}:{lines[at]}",
            hint="put it in quotes if it is text",
        ) from error
