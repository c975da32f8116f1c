"""``saf-gen methods``: the list, the description and the check of a method."""

import json
import re
import sys
from itertools import pairwise

import pytest

from saf_gen.core.config import registry
from saf_gen.parts import cite_source
from saf_gen.plugins.measures import measure_names

OWN = '''\
"""Plug-ins of a user."""

from dataclasses import dataclass

from saf_gen.parts import Answer


@dataclass(frozen=True)
class Total:
    """All spikes, which are [bold]no[/bold] measure of focus."""

    degree = 1
    score_range = "from 0"
    source = "a test"

    def __call__(self, counts):
        print("here I am")
        return float(counts.sum())


@dataclass(frozen=True)
class Wrong(Total):
    """All spikes, with a wrong degree."""

    degree = 2


@dataclass(frozen=True)
class Odd:
    """A power of all spikes; its option is its degree."""

    power: int
    source = "a test"

    @property
    def degree(self):
        return self.power

    @property
    def cost(self):
        return 1 / 0

    def __call__(self, counts):
        return float(counts.sum()) ** self.power


@dataclass(frozen=True)
class Middle:
    """Always the middle of the recording."""

    causal = True
    source = "a test"

    def __call__(self, view):
        view.score(0, view.frames // 2 + 1)
        return Answer(view.frames // 2)
'''


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "somebody.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)


def row(text, name):
    """Return the cells of the first row of a table that begins with this name."""
    lines = text.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith(f"  {name} "))
    heads = lines[max(i for i in range(at) if lines[i].startswith(" ──")) - 1]
    begins = [found.start() for found in re.finditer(r"\S+(?: \S+)*", heads)]
    return [lines[at][a:b].strip() for a, b in pairwise([*begins, None])]


def read_page(text):
    """Return the texts of a page by their labels."""
    found = {}
    for line in text.splitlines():
        if line[0] != " ":
            key, _, first = line.partition("  ")
            found[key] = [first.strip()]
        else:
            found[key].append(line.strip())
    return {key: "\n".join(lines).strip() for key, lines in found.items()}


def test_the_list_has_degree_cost_forms_and_kind(call):
    code, out, err = call("methods", "list")
    assert (code, err) == (0, "")
    for name, cells in {"er_sumsq": ["2", "2", "_n _tfi"], "sd_debiased": ["0", "4", ""]}.items():
        assert row(out, name)[1:4] == cells
    assert row(out, "argmax")[1] == "estimates"
    assert row(out, "sgfs_causal")[1] == "estimates, causal"
    assert row(out, "hill_climb")[1] == "commands"
    for name in registry.names("measures"):
        degree, cost, forms, _ = row(out, name)[1:]
        assert int(degree) >= 0 < float(cost)
        assert ("_n" in forms.split()) == (f"{name}_n" in measure_names())
    for name in registry.names("searches"):
        assert row(out, name)[2]


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in ("measures", "searches") for name in registry.names(kind)]
)
def test_every_plug_in_of_ours_is_shown_with_its_options_and_its_source(call, kind, name):
    code, out, err = call("methods", "show", name)
    assert (code, err) == (0, "")
    page, plug_in = read_page(out), registry.build_plugin(kind, name)
    assert [line.partition("=")[0] for line in page["options"].splitlines()] == (
        [*registry.option_fields(kind, name), *(["reject"] if kind == "searches" else [])] or ["none"]
    )
    assert "default:" not in page["options"]
    assert " ".join(page["source"].split()) == cite_source(plug_in)
    assert plug_in.__doc__.split("References")[0].split()[-1] in page["what"]
    assert "References" not in page["what"]
    assert ("degree" in page) == ("range" in page) == ("cost" in page) == (kind == "measures")


def test_a_form_of_a_measure_is_shown_with_the_measure(call):
    _, out, _ = call("methods", "show", "gaussian_derivative_n_tfi:sigma_px=2")
    page = read_page(out)
    assert page["what"].index("G a Gaussian") < page["what"].index("divided by mean count**degree")
    assert page["what"].index("divided by mean count**degree") < page["what"].index("texture from intervals")
    assert page["options"] == "sigma_px=2 (default: 1.0)"
    assert page["input"] == "the interval texture of a window"
    assert page["degree"] == "0"
    assert page["cost"].startswith("109 operations")  # 8·13 + 4, and the mean
    assert "forms" not in page
    assert read_page(call("methods", "show", "gaussian_derivative")[1])["forms"] == (
        "gaussian_derivative_n, gaussian_derivative_tfi, gaussian_derivative_n_tfi"
    )


def test_a_search_is_shown_and_both_halves_of_a_method(call):
    page = read_page(call("methods", "show", "coarse_to_fine")[1])
    assert (page["kind"], page["also scores"]) == ("search, commands", "sd")
    assert "lag_s=None" in page["options"].splitlines()
    code, out, _ = call("methods", "show", "cen+argmax:refine=centroid")
    assert code == 0
    assert [line.strip() for line in out.splitlines() if line.startswith(("cen", "argmax"))] == [
        "cen",
        "argmax:refine=centroid",
    ]
    assert "refine=centroid (default: no)" in out


@pytest.mark.slow
def test_a_users_plug_in_is_shown_with_what_it_states(call, own):
    page = read_page(call("methods", "show", "somebody.py:Wrong")[1])
    assert (page["degree"], page["cost"], page["range"]) == ("2", "-", "from 0")
    assert page["forms"].split(", ")[0] == "somebody.py:Wrong_n"
    assert "class" not in page
    divided = read_page(call("methods", "show", "somebody.py:Wrong_n")[1])
    assert (divided["degree"], divided["cost"]) == ("0", "-")
    odd = read_page(call("methods", "show", "somebody.py:Odd:power=3")[1])
    assert (odd["degree"], odd["options"]) == ("3", "power=3 (default: none)")
    assert odd["cost"].startswith("? ZeroDivisionError: ")


def test_docstrings_are_listed_as_they_are_and_a_part_that_cannot_be_loaded_hides_no_other(
    call, own, tmp_path, monkeypatch, forget_packages
):
    info = tmp_path / "theirs-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: theirs\nVersion: 0.1\n")
    offered = "[saf_gen.measures]\nmarked = somebody:Total\ngone = nowhere_at_all:Gone\nodd = somebody:Odd\n"
    (info / "entry_points.txt").write_text(offered)
    monkeypatch.syspath_prepend(tmp_path)
    forget_packages()
    try:
        code, out, _ = call("methods", "list")
    finally:
        sys.modules.pop("somebody", None)
    assert code == 0
    assert row(out, "marked")[1:4] == ["1", "-", "_n _tfi"]
    assert "[bold]no[/bold]" in row(out, "marked")[4]
    assert row(out, "gone")[1:4] == ["?", "", ""]
    assert "cannot be loaded" in row(out, "gone")[4]
    assert row(out, "odd")[1:4] == ["depends on options", "depends on options", "_tfi"]
    assert row(out, "sd")[1] == "0"


@pytest.mark.slow
def test_a_sound_method_passes(call):
    code, out, err = call("methods", "check", "sd+argmax")
    assert (code, err) == (0, "")
    for part, check in [("measure", "degree"), ("search", "short"), ("method", "recordings")]:
        assert any(line.startswith(f"  {part} ") and f" {check} " in line for line in out.splitlines())
    count, levels = out.splitlines()[-1].split(": ")
    assert levels == f"{count.split()[0]} pass, 0 warn, 0 fail"


@pytest.mark.slow
def test_a_warning_is_no_failure_and_a_failure_is_exit_code_1(call, own):
    code, out, _ = call("methods", "check", "somebody.py:Middle")
    assert (code, " 1 warn, 0 fail" in out.splitlines()[-1]) == (0, True)
    code, out, _ = call("methods", "check", "somebody.py:Wrong+argmax")
    assert code == 1
    assert "not run: the measure or the search fails" in out


@pytest.mark.slow
def test_findings_come_as_json_and_nothing_else_does(call, own):
    code, out, err = call("methods", "check", "somebody.py:Wrong", "--json")
    assert code == 1
    found = json.loads(out)
    assert "here I am" in err
    (wrong,) = [f for f in found if f["level"] == "fail"]
    assert [wrong[k] for k in ("name", "part", "check")] == ["somebody.py:Wrong", "measure", "degree"]
    assert "degree 1, but it states 2" in wrong["seen"]
    assert wrong["to_do"]
    assert all(set(f) == {"name", "part", "check", "level", "seen", "to_do"} for f in found)


@pytest.mark.parametrize(
    ("command", "name", "message"),
    [
        ("check", "sdd", "did you mean 'sd'"),
        ("show", "sd+argmx", "did you mean 'argmax'"),
        ("check", "somebody.py:Totl", "somebody.py has no 'Totl'; allowed: Total"),
        ("show", "@gone.json", "does not exist"),
    ],
)
def test_an_unknown_name_is_exit_code_2_and_one_line(call, own, name, message, command):
    code, out, err = call("methods", command, name)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert message in err
