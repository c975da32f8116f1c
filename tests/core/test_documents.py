"""YAML and JSON are read strictly, and errors name the line."""

import itertools
import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Discriminator, Field, Tag
from refusals import assert_says, refusal

from saf_gen.core.config.document import STRICT, FrozenModel, validate_document
from saf_gen.core.config.json_document import parse_json, read_json
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.errors import BadInput


class Inner(FrozenModel):
    size: int = Field(ge=1, le=9)
    kind: Literal["round", "square"] = "round"


class Outer(FrozenModel):
    name: str
    inner: Inner
    many: dict[str, Inner] = Field(default_factory=dict)


def read(tmp_path, text):
    path = tmp_path / "doc.yaml"
    path.write_text(text)
    document = read_yaml(path)
    return validate_document(Outer, document), document


def complaint(tmp_path, text):
    with pytest.raises(BadInput) as caught:
        read(tmp_path, text)
    return str(caught.value).replace(str(tmp_path) + "/", "")


def test_a_good_document_becomes_a_frozen_value_that_knows_its_lines(tmp_path):
    value, document = read(tmp_path, "name: x\ninner:\n  size: 3\n")
    assert value == Outer(name="x", inner=Inner(size=3))
    assert document.locate("inner", "size").endswith("doc.yaml:3")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "name: x\ninner: {size: 3}\ninnr: 1\n",
            "doc.yaml:3: unknown key 'innr'; allowed: name, inner, many; did you mean 'inner'?",
        ),
        (
            "name: x\ninner: {size: 3}\nmany:\n  a:\n    sise: 1\n",
            "doc.yaml:5: unknown key 'sise' in many.a; allowed: size, kind; did you mean 'size'?; (1 more "
            "after this one)",
        ),
        ("name: x\ninner: {size: big}\n", "doc.yaml:2: inner.size is 'big'; allowed: a valid integer"),
        (
            "name: x\ninner:\n  size: 2\n  kind: sqare\n",
            "doc.yaml:4: inner.kind is 'sqare'; allowed: round, square; did you mean 'square'?",
        ),
        ("name: x\n", "doc.yaml:1: the key 'inner' is missing"),
        ("name: x\nname: y\n", "doc.yaml:2: the key 'name' is given twice; keep one of the two"),
        ("name: [x\n", "doc.yaml:2: this is not YAML: expected ',' or ']', but got '<stream end>'"),
        ("", "doc.yaml: the file holds no keys; allowed: name, inner, many"),
    ],
)
def test_a_document_that_does_not_fit_is_one_line(tmp_path, text, message):
    assert complaint(tmp_path, text) == message


class Disc(FrozenModel):
    shape: Literal["disc"]
    radius: float


class Box(FrozenModel):
    shape: Literal["box"] = "box"
    edges: tuple[float, float]


def shape(value):
    return value.get("shape", "box") if isinstance(value, dict) else "none"


class Drawing(FrozenModel):
    part: Annotated[Annotated[Disc, Tag("disc")] | Annotated[Box, Tag("box")], Discriminator(shape)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "part:\n  shape: disk\n  radius: 1\n",
            "doc.yaml:2: part.shape is 'disk'; allowed: disc, box; did you mean 'disc'?",
        ),
        (
            "part:\n  shape: disc\n  radius: 1\n  edges: 3\n",
            "doc.yaml:4: unknown key 'edges' in part; allowed: shape, radius",
        ),
        ("part:\n  shape: disc\n", "doc.yaml:1: the key 'part.radius' is missing"),
        ("part: 3\n", "doc.yaml:1: part.shape is 'none'; allowed: disc, box"),
    ],
)
def test_a_value_that_does_not_fit_one_of_several_kinds_is_reported_by_that_kind(tmp_path, text, message):
    path = tmp_path / "doc.yaml"
    path.write_text(text)
    with pytest.raises(BadInput) as caught:
        validate_document(Drawing, read_yaml(path))
    assert str(caught.value).replace(str(tmp_path) + "/", "") == message


def test_a_file_that_is_missing_not_text_or_too_large_is_refused(tmp_path):
    (tmp_path / "quickstart.yaml").write_text("name: x")
    (tmp_path / "tuned.json").write_bytes(b"\xff\xfe\x00\x01")
    with (tmp_path / "long.yaml").open("wb") as file:
        file.truncate(1 << 23)
    for read, name, message in (
        (read_yaml, "quickstrt.yaml", "quickstrt.yaml does not exist; did you mean ' | quickstart.yaml'?"),
        (read_yaml, "tuned.json", "tuned.json cannot be read"),
        (read_yaml, "long.yaml", "8,388,608 bytes | at most 4,194,304"),
        (partial(read_json, hint="make it again"), "tuned.json", "tuned.json cannot be read: | ; make it again"),
        (read_json, "tune.json", "tune.json does not exist; did you mean ' | tuned.json'?"),
    ):
        assert_says(refusal(read, tmp_path / name), message)


TOO_MANY = "1" * 5000  # more digits than Python converts


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x: 1\nat: !!timestamp 2001-13-45\n", "doc.yaml:2: '2001-13-45' is not a valid timestamp: month must"),
        ("x: 1\nat: [1, !!int 0b_]\n", "doc.yaml:2: '0b_' is not a valid int: invalid literal"),
        (f"x:\n  {TOO_MANY}\n", "doc.yaml:2: '111"),
        ("x: !!float " + ":".join(["9"] + ["59"] * 400) + ".5", "doc.yaml:1: x is 9:59"),
        ("x: !!int abc\n", "doc.yaml:1: 'abc' is not a valid int: invalid literal"),
        ("x: !!float ''\n", "doc.yaml:1: '' is not a valid float; put it"),  # IndexError
        ("x: !!bool maybe\n", "doc.yaml:1: 'maybe' is not a valid bool; put it"),  # KeyError
        ("x: !!timestamp foo\n", "doc.yaml:1: 'foo' is not a valid timestamp; put it"),  # AttributeError
        ('x: 1\ny: "\\UFFFFFFFF"\n', "doc.yaml:2: this is not YAML: "),
        ('x: 1\ny: "\\U00110000"\n', "doc.yaml:2: this is not YAML: chr() arg not in range(0x110000)"),
        (f"%YAML {TOO_MANY}.1\n---\nx: 1\n", "doc.yaml:1: this is not YAML: Exceeds the limit"),
        ("x: 1\n" + "y: " + "[" * 700 + "]" * 700, "doc.yaml:2: this is nested too deep, or contains itself"),
        ("y: 1\nx: &a [1, *a]\nz: 2\n", "doc.yaml:2: this is nested too deep, or contains itself"),
        ("x: 1\n? [a, b]\n: 2\n", "doc.yaml:2: a key must be a name"),  # not hashable in Python
        ("x: 1\ny: !!value =\n", "doc.yaml:2: this is not YAML: could not determine a constructor"),
        ("x: 1\ny: !!binary é\n", "doc.yaml:2: this is not YAML: failed to convert base64"),
    ],
    ids=lambda held: held[:24],
)
def test_malformed_values_are_refused_with_their_line(tmp_path, text, message):
    line = complaint(tmp_path, text)
    assert line.startswith(message)
    assert "\n" not in line


@dataclass(frozen=True)
class Row:
    __pydantic_config__ = STRICT
    name: str
    score: float | None = None


JSON = """{
 "name": "a \\" {[,:]} b",
 "inner": {"size": 3,
   "kind": "round"},
 "many": {
   "first": {"size": 1}, "second":
     {"size": 2}
 }
}"""


def test_a_json_document_knows_its_lines(tmp_path):
    path = tmp_path / "doc.json"
    path.write_text(JSON)
    document = read_json(path)
    assert validate_document(Outer, document).many["second"].size == 2
    for keys, line in [((), 1), (("inner", "kind"), 4), (("many", "second", "size"), 7), (("inner", "x"), 3)]:
        assert document.locate(*keys) == f"{path}:{line}"
    listed = parse_json('[1,\n[2, {"a": [3,\n4]}]]', path, first_line=10)
    assert listed.locate(1, 1, "a", 1) == f"{path}:12"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"name": "x",\n"scor": 1}', "r.jsonl:8: unknown key 'scor'; allowed: name, score; did you mean"),
        ('{"name": "x",\n "score": "high"}', "r.jsonl:8: score is 'high'; allowed: a valid number; make it"),
        ('{"name": "x",\n "score": 1e999}', "r.jsonl:8: score is inf; allowed: a finite number"),
        ('{"name": "x",\n "score": NaN}', "r.jsonl:8: NaN is not a JSON number; make it again"),
        ('{"name": "NaN",\n "name": {"b": 1, "b": 2}', "r.jsonl:8: the key 'name' is given twice; make it"),
        ('{"name": "x",\n "score": -' + TOO_MANY, "r.jsonl:8: -11111111111… has too many digits"),
        ('{"name": "x",\n "score"}', "r.jsonl:8: this is not JSON: Expecting ':' delimiter; make it again"),
        ("", "r.jsonl:7: this is not JSON: Expecting value"),
        ("[" * 100_000, "r.jsonl:7: this is nested too deep; make it again"),
        ("[1]", "r.jsonl:7: the file holds no keys; allowed: name, score; make it again"),
    ],
    ids=lambda held: held[:24],
)
def test_json_that_does_not_fit_is_refused_with_its_line(text, message):
    with pytest.raises(BadInput) as caught:
        validate_document(Row, parse_json(text, "r.jsonl", first_line=7, hint="make it again"), hint="make it again")
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_few_lines_that_hold_millions_of_values_are_refused(tmp_path):
    """Each list names the one before ten times: 250 bytes that would fill the memory."""
    names = "abcdefghi"
    lines = ["a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]" for a, b in itertools.pairwise(names)]
    (tmp_path / "a.yaml").write_text("\n".join(lines))
    error = refusal(read_yaml, tmp_path / "a.yaml")
    assert_says(error, "too many values | at most 100,000")
    assert error.where.startswith(str(tmp_path / "a.yaml:"))


@pytest.mark.parametrize("read", [read_yaml, read_json])
def test_what_is_no_file_on_a_disk_is_refused_before_it_is_read(tmp_path, read):
    """Reading a pipe without a writer or an endless device would never end."""
    os.mkfifo(tmp_path / "pipe.yaml")
    for path in (tmp_path / "pipe.yaml", Path("/dev/zero")):
        assert_says(refusal(read, path), f"{path} is not a file on a disk")
    assert_says(refusal(read, tmp_path), f"{tmp_path} is a folder")
