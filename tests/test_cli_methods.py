"""``saf-gen methods``: the list, and the check of somebody's method."""

import json
import sys

import pytest

from saf_gen import registry
from saf_gen.cli import main

OWN = '''\
"""Parts of somebody."""

from dataclasses import dataclass

from saf_gen.parts import Answer


@dataclass(frozen=True)
class Total:
    """All spikes: [bold]no[/bold] measure of focus, as it is brighter where it is blurred alike."""

    degree = 1
    score_range = "from 0"
    source = "a test"

    def __call__(self, counts):
        print("here I am")
        return float(counts.sum())


@dataclass(frozen=True)
class Wrong(Total):
    """The same, and its degree is wrong."""

    degree = 2


@dataclass(frozen=True)
class Middle:
    """The middle of the recording, whatever is in it."""

    causal = True
    source = "a test"

    def __call__(self, view):
        view.score(0, view.frames // 2 + 1)
        return Answer(view.frames // 2)
'''


@pytest.fixture
def call(capsys):
    """Run a command in this process: (exit code, stdout, stderr)."""

    def run(*arguments):
        capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            main([str(a) for a in arguments])
        return stop.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "somebody.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)


def row(text, name):
    """The cells of the first row of a table that begins with this name."""
    line = next(line for line in text.splitlines() if line.startswith(f"│ {name} "))
    return [cell.strip() for cell in line.strip("│").split("│")]


def test_the_list_says_degree_and_kind(call):
    code, out, err = call("methods")
    assert (code, err) == (0, "")
    for name, said in {"sd": "0", "gradient_code": "1", "er_sumsq": "2"}.items():
        assert row(out, name)[1] == said
    assert row(out, "argmax")[1] == "estimates"
    assert row(out, "sgfs_causal")[1] == "estimates, causal"
    assert row(out, "hill_climb")[1] == "commands"
    for room in ("measures", "searches"):
        for name in registry.names(room):
            assert row(out, name)[2]
    last = out.splitlines()[-1]
    assert "NAME_tfi looks at intervals between spikes in place of counts." in last
    assert "NAME_n divides a measure by brightness." in last


def test_docstrings_are_listed_as_they_are_and_a_part_that_cannot_be_loaded_hides_no_other(
    call, own, tmp_path, monkeypatch
):
    info = tmp_path / "theirs-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: theirs\nVersion: 0.1\n")
    offered = "[saf_gen.measures]\nmarked = somebody:Total\ngone = nowhere_at_all:Gone\n"
    (info / "entry_points.txt").write_text(offered)
    monkeypatch.syspath_prepend(tmp_path)
    registry._offered.cache_clear()
    try:
        code, out, _ = call("methods")
    finally:
        registry._offered.cache_clear()
        registry.part_class.cache_clear()
        sys.modules.pop("somebody", None)
    assert code == 0
    assert "[bold]no[/bold]" in row(out, "marked")[2]
    assert row(out, "gone")[1] == "?"
    assert "cannot be loaded" in row(out, "gone")[2]
    assert row(out, "sd")[1] == "0"


def test_a_sound_method_passes(call):
    code, out, err = call("methods", "check", "sd+argmax")
    assert (code, err) == (0, "")
    for part, check in [("measure", "degree"), ("search", "short"), ("method", "recordings")]:
        assert any(line.startswith(f"│ {part} ") and f" {check} " in line for line in out.splitlines())
    count, levels = out.splitlines()[-1].split(": ")
    assert levels == f"{count.split()[0]} pass, 0 warn, 0 fail"


def test_a_warning_is_no_failure(call, own):
    code, out, _ = call("methods", "check", "somebody.py:Middle")
    assert code == 0
    assert " 1 warn, 0 fail" in out.splitlines()[-1]
    assert "within 0.05 is what one" in out


def test_a_failure_is_exit_code_1_with_what_to_do(call, own):
    code, out, _ = call("methods", "check", "somebody.py:Wrong+argmax")
    assert code == 1
    cells = next(line for line in out.splitlines() if " degree " in line and " fail " in line)
    assert "state the" in cells
    assert "not run: a half of it fails" in out


def test_findings_come_as_json_and_nothing_else_does(call, own):
    code, out, err = call("methods", "check", "somebody.py:Wrong", "--json")
    assert code == 1
    found = json.loads(out)
    assert "here I am" in err
    (wrong,) = [f for f in found if f["level"] == "fail"]
    assert {k: wrong[k] for k in ("name", "part", "check")} == {
        "name": "somebody.py:Wrong",
        "part": "measure",
        "check": "degree",
    }
    assert "degree 1, and it states 2" in wrong["seen"]
    assert wrong["to_do"]
    assert all(set(f) == {"name", "part", "check", "level", "seen", "to_do"} for f in found)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("sdd", "did you mean 'sd'"),
        ("sd+argmx", "did you mean 'argmax'"),
        ("somebody.py:Totl", "cannot be loaded"),
        ("@gone.json", "cannot be read"),
    ],
)
def test_a_name_that_is_none_is_exit_code_2_and_one_line(call, own, name, told):
    code, out, err = call("methods", "check", name)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert told in err


def test_a_word_that_is_no_command_is_exit_code_2(call):
    code, _, err = call("methods", "chekc", "sd")
    assert code == 2
    assert "No such command 'chekc'" in err
