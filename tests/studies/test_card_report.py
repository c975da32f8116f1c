"""The report on a card, which people paste into an issue."""

import re
import subprocess
import sys

import pytest

from saf_gen.render.backend import BackendProbe
from studies.speed import card

CARD, BLIND, NONE = (BackendProbe((19, 1, 7), *found) for found in ((True,), (False, "no OptiX"), (False,)))


@pytest.fixture
def report(monkeypatch, tmp_path):
    """Write a report of a machine with other commands in place of tests and benches; return exit code and text."""

    def write(machine, tests="print('505 passed')", bench="print('one pass: 0.5 s')"):
        monkeypatch.setattr("saf_gen.render.backend.probe_backends", lambda: machine)
        monkeypatch.setattr(card, "TESTS", ("-c", tests))
        monkeypatch.setattr(card, "BENCH", ("-c", bench))
        code = card.main(["--out", str(tmp_path / "report.md")])
        return code, (tmp_path / "report.md").read_text()

    return write


def test_a_report_names_what_passed_and_the_times_of_card_and_cores(report):
    code, text = report(CARD, bench="import os; print('card', os.environ.get('CUDA_VISIBLE_DEVICES', 'seen'))")
    assert code == 0
    titles = re.findall(r"^## (.+): done, \d+ s$", text, re.MULTILINE)
    assert titles == ["Tests of the renderer on the card", "Times on the card", "Times on the cores"]
    assert re.findall(r"^(505 passed|card.*)$", text, re.MULTILINE) == ["505 passed", "card seen", "card "]
    assert "| a ray on it | traces |" in text
    assert "mitsuba 3.9.1" in text


@pytest.mark.parametrize(("machine", "said"), [(BLIND, "no OptiX"), (NONE, "there is no card that Mitsuba can use")])
def test_without_a_card_that_traces_the_report_says_why_and_fails(report, machine, said):
    code, text = report(machine)
    assert code == 1
    assert f"| a ray on it | {said} |" in text
    assert "on the card:" not in text


@pytest.mark.parametrize("part", ["tests", "bench"])
def test_a_part_that_fails_is_named_and_the_others_are_there(report, part):
    code, text = report(CARD, **{part: "import sys; print('FAILED one', flush=True); sys.exit('oh')"})
    assert code == 1
    assert text.count("**failed** (exit code 1)") == {"tests": 1, "bench": 2}[part]
    assert "FAILED one\noh\n" in text


def test_a_report_names_no_folder(report, tmp_path):
    _, text = report(
        CARD, tests=f"print({str(card.ROOT)!r} + '/tests/a.py:3: bad'); print(__import__('os').path.expanduser('~/x'))"
    )
    assert "./tests/a.py:3: bad\n~/x" in text
    assert str(card.ROOT) not in text


def test_without_nvidias_program_the_report_says_so(monkeypatch):
    monkeypatch.setattr(card, "QUERY", ("no-such-program",))
    assert card.describe_card() == "nvidia-smi is not there"
    monkeypatch.setattr(card, "QUERY", (sys.executable, "-c", "print('A, 580.1, 80 MiB'); print('B, 580.1, 80 MiB')"))
    assert card.describe_card() == "A, 580.1, 80 MiB; B, 580.1, 80 MiB"


@pytest.mark.slow
def test_the_tests_of_the_report_are_those_of_the_renderer():
    """Only collected, because the card is elsewhere."""
    command = [sys.executable, *card.TESTS, "--collect-only", "-p", "no:cacheprovider"]
    command[command.index("cuda")] = "scalar"
    found = subprocess.run(command, cwd=card.ROOT, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout + found.stderr
    assert "tests/render/test_device_pass.py" in found.stdout
