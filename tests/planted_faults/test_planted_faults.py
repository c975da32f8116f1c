"""Every fault of fault_list.py is planted, one at a time, and caught by each of its tests."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from fault_list import FAULTS, RENDERED
from planting import Change, NotPlantedError, Planter, changed_sources
from written_scenes import needs_llvm

HERE = Path(__file__).parent
TURNS = 10
"""Days in which all faults are planted."""


def run_with_faults(folder: Path, jobs: Sequence[tuple[str, Sequence[str]]]) -> list[dict[str, Any]]:
    """Return what run_with_faults.py writes about each job, (fault, tests)."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    command = [sys.executable, str(HERE / "run_with_faults.py"), str(folder), json.dumps(jobs)]
    subprocess.run(command, env=environment, check=True)
    found = []
    for n in range(len(jobs)):
        file = folder / f"{n}.json"
        shown = (folder / f"{n}.txt").read_text(encoding="utf-8")
        found.append(json.loads(file.read_text()) if file.exists() else {"died": shown[-2000:]})
    return found


def list_problems(found: dict[str, Any], tests: Sequence[str], *, planted: bool) -> list[str]:
    """List every deviation: without a fault all tests must pass, and under a fault each test must fail."""
    wrong = [f"{key}: {found[key]}" for key in ("died", "not planted") if key in found]
    if planted and not wrong and not found["planted"]:
        wrong.append("not planted: the tests import none of the modules that it changes")
    outcomes = found.get("outcomes", {})
    for test in tests:
        cases = {k: v for k, v in outcomes.items() if k == f"tests/{test}" or k.startswith(f"tests/{test}[")}
        errors = [f"{case}: {ended}" for case, ended in cases.items() if ended not in ("passed", "failed", "skipped")]
        seen = set(cases.values())
        if not cases:
            wrong.append(f"{test} did not run")
        elif errors:
            wrong += errors
        elif planted and "failed" not in seen:
            wrong.append(f"{test} does not catch it")
        elif not planted and seen != {"passed"}:
            wrong.append(f"{test} does not pass without a fault")
    return wrong + [f"{key}: {ended}" for key, ended in outcomes.items() if ended.startswith("cannot be collected")]


def make_jobs(tests_by_fault: dict[str, Sequence[str]]) -> list[tuple[str, Sequence[str]]]:
    """Return a job of all tests without a fault, and one job per fault with its tests."""
    every_test = dict.fromkeys(test for tests in tests_by_fault.values() for test in tests)
    return [("", list(every_test)), *tests_by_fault.items()]


def check(folder: Path, jobs: Sequence[tuple[str, Sequence[str]]]) -> None:
    wrong = {}
    for (fault, tests), found in zip(jobs, run_with_faults(folder, jobs), strict=True):
        if problems := list_problems(found, tests, planted=bool(fault)):
            wrong[fault or "without a fault"] = problems
    assert not wrong, json.dumps(wrong, indent=1, ensure_ascii=False)


@pytest.mark.slow
def test_every_fault_still_finds_what_it_changes():
    """No test is run, so that a change of the package that removes the changed text is reported at once."""
    for fault in FAULTS.values():
        assert changed_sources(fault.changes)


@pytest.mark.slow
def test_cheap_tests_catch_a_tenth_of_the_faults_by_turns(tmp_path):
    """Those of the day, in one run, because libraries are then loaded once; all faults with all tests are at night."""
    tests = {name: fault.cheap_tests for name, fault in FAULTS.items() if fault.cheap_tests}
    turn = date.today().toordinal() % TURNS
    check(tmp_path, make_jobs({name: tests[name] for name in list(tests)[turn::TURNS]})[1:])


EVERY_JOB = make_jobs({name: fault.tests for name, fault in FAULTS.items()})


@pytest.mark.long
@pytest.mark.parametrize(
    "job",
    [
        pytest.param(
            job, id=job[0] or "no fault", marks=[needs_llvm] if any(t.startswith(RENDERED) for t in job[1]) else []
        )
        for job in EVERY_JOB
    ],
)
def test_every_test_of_a_fault_catches_it_and_passes_without_one(tmp_path, job):
    check(tmp_path, [job])


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_caught_by_more_than_one_test(name):
    """At least two functions; the cases of one function count once."""
    assert len({test.partition("[")[0] for test in FAULTS[name].tests}) >= 2


# --- what is planted, and which problems are listed --------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("return float.from_bytes(", "return 0 *", "no longer contains 'return float.from_bytes('"),
        ("return int.from_bytes(", "return int.from_bytes(  # planted\n        ", "changes no code"),
    ],
)
def test_a_fault_that_changes_nothing_is_not_planted(old, new, message):
    with pytest.raises(NotPlantedError, match=r"saf_gen\.core\.seeds") as caught:
        changed_sources([Change("core.seeds", old, new)])
    assert message in str(caught.value)


def test_a_fault_that_comes_too_late_is_not_planted():
    import saf_gen.core.seeds  # noqa: F401

    sources = changed_sources([Change("core.seeds", ">> 1", ">> 2")])
    with pytest.raises(NotPlantedError, match=r"saf_gen\.core\.seeds was imported before"):
        Planter(sources).install()


def outcome(**outcomes):
    return {"planted": ["saf_gen.core.bits"], "outcomes": {f"tests/{k}": v for k, v in outcomes.items()}}


@pytest.mark.parametrize(
    ("found", "problems"),
    [
        (outcome(**{"a[1]": "passed", "a[2]": "failed"}), []),
        (outcome(a="skipped"), ["a does not catch it"]),
        (outcome(**{"a[1]": "ValueError in call: no", "a[2]": "failed"}), ["tests/a[1]: ValueError in call: no"]),
        (outcome(ab="failed"), ["a did not run"]),
        ({**outcome(a="failed"), "planted": []}, ["not planted: the tests import none of the modules that it changes"]),
        ({"died": "killed"}, ["died: killed", "a did not run"]),
    ],
)
def test_a_fault_that_is_not_caught_is_reported(found, problems):
    assert list_problems(found, ["a"], planted=True) == problems
