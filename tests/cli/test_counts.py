"""Counts that are printed have their noun in the plural unless they are 1."""

import ast
import re
from itertools import pairwise

import numpy as np
import pytest
from small_dataset import HERE

import saf_gen

CLI = sorted((HERE.parent / "saf_gen/cli").glob("*.py"))
NOUNS = (
    "blocks checks evaluations files folders frames machines methods objects pictures pieces recordings runs scenes "
    "sequences shards trials workers"
).split()
MANY = "machines of two cores with LLVM", "scenes", "shards have ended"
"""Beginnings of phrases whose number is at least two."""


def plurals_after_a_number(path):
    """Yield the line and the words that follow a value in an f-string of a file, where a plural comes at once."""
    for text in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        parts = text.values if isinstance(text, ast.JoinedStr) else ()
        for value, after in pairwise(parts):
            if isinstance(value, ast.FormattedValue) and isinstance(after, ast.Constant):
                found = re.match(rf" (?:{'|'.join(NOUNS)})\b.*", after.value)
                if found and not any(found[0].startswith(f" {many}") for many in MANY):
                    yield f"{path.name}:{text.lineno}: {found[0]}"


def test_no_command_prints_a_plural_after_a_number_that_may_be_one():
    assert [line for path in CLI for line in plurals_after_a_number(path)] == []


def test_the_scan_finds_such_a_plural(tmp_path):
    (tmp_path / "a.py").write_text("print(f\"{count} sequences, {plural(count, 'file')}, {name} is fine\")\n")
    assert list(plurals_after_a_number(tmp_path / "a.py")) == ["a.py:1:  sequences, "]


@pytest.fixture
def one_stream(tmp_path):
    folder = tmp_path / "one"
    folder.mkdir()
    frames = np.random.default_rng(3).integers(0, 2, (64, 32, 48), dtype=np.uint8)
    saf_gen.write_stream(folder / "a.h5", frames, readout_hz=20_000, focus_position=np.linspace(0, 1, 64))
    return folder


def test_commands_count_one_thing_in_the_singular(call, one_stream, tmp_path):
    stream = str(one_stream / "a.h5")
    said = [
        call("dataset", "index", str(one_stream))[1],
        call("verify", str(one_stream))[1],
        call("score", stream, "--measure", "sd", "--window", "64", "--out", str(tmp_path / "a.csv"))[1],
        call("view", stream, "--as", "tfp", "--window", "64", "--out", str(tmp_path / "a.png"))[1],
    ]
    for words, text in zip(
        ("1 sequence in split", "1 of 1 sequence is intact", "1 block in", "1 picture of 64 frames in"),
        said,
        strict=True,
    ):
        assert words in text
    assert not re.search(r"\b1 \w+s\b(?! of| is)", " ".join(said).replace("1 of 1 sequence is", "")), said
