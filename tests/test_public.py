"""The parts of a public project besides its code: workflows, forms, versions, citation, container."""

import re
import runpy
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import saf_gen

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
PYTHONS = ["3.11", "3.12", "3.13", "3.14"]


def steps_of(workflow):
    jobs = yaml.safe_load(workflow.read_text())["jobs"].values()
    return [step for job in jobs for step in job["steps"]]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda p: p.name)
def test_a_workflow_calls_what_is_there_and_may_read_unless_a_job_says_more(workflow):
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    script = "\n".join(step.get("run", "") for step in steps_of(workflow))
    assert set(re.findall(r"\bmake ([a-z-]+)", script)) <= set(targets)
    assert all((ROOT / path).exists() for path in re.findall(r"\btools/[\w.-]+", script))
    assert yaml.safe_load(workflow.read_text())["permissions"] == {"contents": "read"}
    used = [step["uses"] for step in steps_of(workflow) if "uses" in step]
    unpinned = [name for name in used if not re.search(r"@[0-9a-f]{40}$", name)]
    assert set(unpinned) <= {"pypa/gh-action-pypi-publish@release/v1"}


def test_the_tests_run_under_every_python_that_is_promised():
    matrix = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"]["linux"]["strategy"]["matrix"]
    assert matrix["python"] == PYTHONS
    stated = [name.split(" :: ")[-1] for name in PROJECT["classifiers"] if "Python :: 3." in name]
    assert stated == PYTHONS


def test_one_version_stands_everywhere_and_a_tag_of_another_is_refused(tmp_path):
    check = runpy.run_path(str(ROOT / "tools/check_release.py"))
    versions = check["find_versions"]()
    assert versions["saf_gen/__init__.py"] == versions["CITATION.cff"] == saf_gen.__version__
    with pytest.raises(SystemExit, match=r"the tag is v99, but saf_gen/__init__.py says \d"):
        check["main"]("v99")
    check["main"].__globals__["ROOT"] = tmp_path
    (tmp_path / "saf_gen").mkdir()
    (tmp_path / "saf_gen/__init__.py").write_text('__version__ = "1.2.3"\n')
    (tmp_path / "CITATION.cff").write_text("cff-version: 1.2.0\nversion: 1.2.3\n")
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## Unreleased\n\n## 1.2.3\n\n## 1.2.2\n")
    check["main"]("v1.2.3")
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## Unreleased\n")
    with pytest.raises(SystemExit, match=r"CHANGELOG\.md says none"):
        check["main"]("v1.2.3")


def test_the_citation_names_the_people_of_each_reference_and_the_authors_of_the_package():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["authors"] == PROJECT["authors"] != []
    for reference in citation["references"]:
        assert reference["authors"]
        assert all(set(author) == {"family-names", "given-names"} for author in reference["authors"])
        assert all("et al" not in name and name for author in reference["authors"] for name in author.values())


def constraints():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    return [Requirement(line) for line in lines if not line.startswith("#")]


@pytest.mark.parametrize("python", PYTHONS)
def test_the_constraints_give_every_dependency_a_version_that_it_may_have(python):
    """One exact version of each package for each Python, and no address to get it from."""
    held = {c.name: c for c in constraints() if c.marker is None or c.marker.evaluate({"python_version": python})}
    assert all(c.url is None and re.fullmatch(r"==[^*,]+", str(c.specifier)) for c in held.values())
    extras = PROJECT["optional-dependencies"]
    wanted = [
        *PROJECT["dependencies"],
        *(line for name in ("render", "validation", "docs", "test") for line in extras[name]),
    ]
    inner = re.findall(r"\[(.+)\]", " ".join(extras["all"]))[0].split(",")
    wanted += [line for name in inner for line in extras[name]]
    for requirement in map(Requirement, wanted):
        pinned = held[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(str(pinned.specifier).removeprefix("==")), requirement


def test_the_container_is_built_of_what_its_context_holds():
    """Each file that the Dockerfile copies exists, and .dockerignore allows it."""
    allowed = [line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")]
    copied = re.findall(r"^COPY (?!--)(.+) \S+$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    names = [name for words in copied for name in words.split()]
    assert sorted(names) == sorted(allowed)
    assert all((ROOT / name).exists() for name in names)
