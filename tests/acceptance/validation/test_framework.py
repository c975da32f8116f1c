"""The framework of `saf-gen validate`: failures are reported, stopped runs resume, errors are one line.

The checks here are made up; tests/acceptance/validation/test_validation.py runs the real ones.
"""

import json
import math
import re
import sys

import numpy as np
import pytest
from scipy import stats

from saf_gen.acceptance import validation
from saf_gen.acceptance.validation import all_validation_checks, choose_validation_checks, inference, runner
from saf_gen.acceptance.validation.check import Check, CheckSkipped, Comparison, Curve, Finding, Plot, Verdict
from saf_gen.acceptance.validation.validation_page import (
    format_validation_number,
    tolerance_used_in_validation,
    write_validation_page,
)
from saf_gen.errors import BadInput, SafGenError

PLOT = Plot(
    "x", "y", (Curve("law", (1.0, 2.0), (1.0, 2.0)), Curve("seen", (1.0, 2.0), (1.1, math.nan), "points", (0.1, 0.1)))
)


def make_check(name, measured, *, calls=None, error=None):
    """Return a check that a measured figure is 1 within 0.1."""

    def run(maker, quick):
        if calls is not None:
            calls.append((name, quick))
        if error is not None:
            raise error
        return Finding(
            (Comparison("the figure", measured, 1.0, 0.9, 1.1, measured - 0.05, measured + 0.05, "m"),), PLOT
        )

    return Check(name, f"The figure of {name} is one.", "x = 1", "nowhere", "Nothing.", "A tenth.", run)


@pytest.fixture
def planted(monkeypatch):
    """A function that replaces the real checks."""

    def plant(*checks):
        monkeypatch.setattr(validation, "all_validation_checks", lambda: {check.name: check for check in checks})
        monkeypatch.setattr(validation, "SUBJECTS", tuple({check.subject for check in checks}))

    return plant


def test_a_check_that_must_fail_fails_and_the_page_says_so(call, planted, tmp_path):
    planted(make_check("noise_right", 1.04), make_check("noise_wrong", 1.2))
    code, shown, messages = call("validate", "--out", tmp_path)
    assert code == 1
    assert re.search(r"noise_right\s+passed\s+1 of 1\s+0\.40", shown)
    assert re.search(r"noise_wrong\s+failed\s+0 of 1\s+2\.00", shown)
    assert max(map(len, shown.splitlines()[:-1])) <= 80
    assert messages.splitlines()[-1] == "saf-gen: noise_wrong failed: the figure: 1.2"
    page = (tmp_path / "validation.md").read_text()
    assert "1 of 2 checks passed; 1 of 2 checks failed" in page
    assert "| the figure | 1.20 m (1.15 to 1.25) | 1.00 | 0.90 to 1.10 | **fails** |" in page
    assert "| [noise_wrong](#noise_wrong) | **failed** |" in page
    assert (tmp_path / "pictures/validation-noise-wrong.png").stat().st_size < 30_000


def test_all_that_pass_exit_with_0(call, planted, tmp_path):
    planted(make_check("noise_right", 1.0))
    assert call("validate", "--quick", "--out", tmp_path)[0] == 0
    assert "the small sizes" in (tmp_path / "validation.md").read_text()


def test_json_holds_every_figure(call, planted, tmp_path):
    planted(make_check("noise_wrong", 1.2))
    code, shown, _ = call("validate", "--json", "--out", tmp_path)
    (found,) = json.loads(shown)
    assert code == 1
    assert found["outcome"] == "failed"
    assert found["comparisons"][0]["measured"] == 1.2


def test_a_run_that_was_stopped_goes_on(tmp_path):
    """Checks that ended before the stop are not run again, except at another size."""
    calls = []
    stop = [True]

    def stopping(maker, quick):
        if stop[0]:
            raise KeyboardInterrupt
        return Finding((Comparison("x", 1.0, 1.0, 0.9, 1.1),))

    first = make_check("noise_first", 1.0, calls=calls)
    second = Check("noise_second", "", "", "", "", "", stopping)
    with pytest.raises(KeyboardInterrupt):
        runner.run_validation_checks([first, second], tmp_path)
    stop[0] = False
    verdicts = runner.run_validation_checks([first, second], tmp_path)
    assert [v.outcome for v in verdicts] == ["passed", "passed"]
    assert calls == [("noise_first", False)]
    runner.run_validation_checks([first], tmp_path, quick=True)
    assert calls == [("noise_first", False), ("noise_first", True)]


def test_what_other_code_found_is_not_used(tmp_path, monkeypatch):
    calls = []
    check = make_check("noise_first", 1.0, calls=calls)
    runner.run_validation_checks([check], tmp_path)
    monkeypatch.setattr(runner, "fingerprint_validated_source", lambda: "0" * 64)
    runner.run_validation_checks([check], tmp_path)
    assert len(calls) == 2
    assert [p.name for p in (tmp_path / runner.RESULTS).iterdir()] == ["000000000000-whole"]


def test_a_check_that_cannot_run_is_neither_passed_nor_kept(call, planted, tmp_path):
    skipped = make_check("outside_referee", 1.0, error=CheckSkipped("the package emva1288 is not installed"))
    broken = make_check("noise_broken", 1.0, error=SafGenError("no light"))
    planted(skipped, broken, make_check("noise_right", 1.0))
    code, _, messages = call("validate", "--out", tmp_path)
    assert code == 1
    assert "noise_broken broken: no light" in messages
    assert "outside_referee was skipped: the package emva1288 is not installed" in messages
    page = (tmp_path / "validation.md").read_text()
    assert "**skipped**" in page
    assert "the package emva1288 is not installed" in page
    assert [p.name for p in tmp_path.glob(".validation/*/*.json")] == ["noise_right.json"]
    planted(skipped)
    assert call("validate", "--out", tmp_path)[0] == 0


def test_without_its_package_the_referee_is_skipped_before_anything_is_made(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "emva1288.process.results", None)
    (verdict,) = runner.run_validation_checks(choose_validation_checks(["referee"]), tmp_path, quick=True)
    assert verdict.outcome == "skipped"
    assert "saf-gen[validation]" in verdict.reason
    assert not list(tmp_path.rglob("*.h5"))


def test_a_check_without_figures_does_not_pass(tmp_path):
    empty = Check("noise_empty", "", "", "", "", "", lambda maker, quick: Finding(()))
    assert runner.run_validation_checks([empty], tmp_path)[0].outcome == "failed"


def test_an_unknown_check_is_one_line(call, tmp_path):
    code, shown, messages = call("validate", "--only", "noise_interval", "--out", tmp_path)
    assert code == 2
    assert shown == ""
    assert len(messages.splitlines()) == 1
    assert "unknown check 'noise_interval'" in messages
    assert "did you mean 'noise_intervals'?" in messages
    assert not list(tmp_path.iterdir())
    assert call("validate", "--only", "nonsense", "--out", tmp_path)[0] == 2


def test_a_folder_that_cannot_be_written_is_one_line(call, planted, tmp_path):
    planted(make_check("noise_right", 1.0))
    (tmp_path / "file").write_text("")
    code, _, messages = call("validate", "--out", tmp_path / "file/below")
    assert code == 2
    assert len(messages.splitlines()) == 1


def test_a_subject_stands_for_its_checks():
    everything = all_validation_checks()
    assert [c.name for c in choose_validation_checks([])] == list(everything)
    assert [c.name for c in choose_validation_checks(["noise"])] == [n for n in everything if n.startswith("noise_")]
    assert [c.name for c in choose_validation_checks(["noise_spectrum"])] == ["noise_spectrum"]
    with pytest.raises(BadInput):
        choose_validation_checks(["noise", "no"])


def test_every_check_has_law_formula_source_workload_and_tolerance():
    for check in all_validation_checks().values():
        words = (check.law, check.formula, check.source, check.workload, check.tolerance)
        assert all(len(text) > 10 and "  " not in text for text in words), check.name
        assert check.subject in validation.SUBJECTS


def test_a_verdict_comes_back_as_it_was_written():
    comparison = Comparison("x", 1.0, at_most=2.0)
    verdict = Verdict("a", "passed", 0.5, (comparison,), PLOT, ("said",))
    back = Verdict.from_dict(json.loads(json.dumps(verdict.as_dict(), allow_nan=False)))
    assert repr(back) == repr(verdict)


@pytest.mark.parametrize("value", [0.0, 1.0, 0.95, 1.05, 1.1])
def test_a_figure_passes_inside_its_range_alone(value):
    one = Comparison("x", value, 1.0, 0.95, 1.05)
    assert one.passed == (0.95 <= value <= 1.05)
    assert one.tolerance_used == pytest.approx(abs(value - 1) / 0.05)
    assert not Comparison("x", math.nan, 1.0, 0.9, 1.1).passed
    assert Comparison("x", 3.0, at_most=4.0).tolerance_used == 0.75


@pytest.mark.slow
def test_right_samples_fail_as_rarely_as_promised_and_wrong_ones_are_found():
    """Of 4,000 checks of ten means of 50, 0.4 fail on average (P(≥ 5) = 10⁻⁴); all off by 1.5 sd fail. Seed 1."""
    samples = np.random.default_rng(1).normal(size=(4000, 10, 50))
    failed = sum(
        not all(inference.compare_mean_with_law("m", one, expected=0.0, figures=10).passed for one in check)
        for check in samples
    )
    assert failed < 5
    assert not any(
        inference.compare_mean_with_law("m", one, expected=1.5, figures=10).passed for one in samples[:100, 0]
    )


def test_the_interval_of_a_mean_holds_it_95_times_in_100():
    """2,000 means of 8 numbers; seed 2; bounds are ±4 standard deviations of a binomial."""
    samples = np.random.default_rng(2).normal(3.0, 2.0, size=(2000, 8))
    found = [inference.compare_mean_with_law("m", one, expected=0.0, figures=1) for one in samples]
    held = np.mean([one.low <= 3.0 <= one.high for one in found])
    assert held == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / 2000))


def test_chi_squared_is_refused_at_both_ends():
    middle, low, high = 20.0, *stats.chi2.ppf([1e-6, 1 - 1e-6], 20)
    passed = [inference.compare_chi_squared_with_law("c", x, freedom=20, figures=1).passed for x in (low, middle, high)]
    assert passed == [False, True, False]


def test_numbers_of_the_page_have_as_many_digits_as_needed():
    texts = [format_validation_number(x) for x in (0.0, 12345.6, 1.23456, 0.000123, -0.5)]
    assert texts == ["0", "12,346", "1.235", "1.23e-04", "-0.5"]
    assert [format_validation_number(x, 1e-6) for x in (0.9999848, 12.0, 0.0)] == ["0.999985", "12.000000", "0"]
    assert format_validation_number(1.23e-9, 1e-11) == "1.23e-09"
    assert math.isnan(tolerance_used_in_validation(Verdict("a", "broken", 0.0)))


def test_pages_are_written_again_the_same(tmp_path):
    check = make_check("noise_right", 1.0)
    verdicts = [Verdict("noise_right", "passed", 1.0, (Comparison("x", 1.0, 1.0, 0.9, 1.1),), PLOT)]
    pages = [write_validation_page([check], verdicts, folder=tmp_path / name, quick=False) for name in "ab"]
    assert pages[0].read_bytes() == pages[1].read_bytes()
    pictures = [(tmp_path / name / "pictures/validation-noise-right.png").read_bytes() for name in "ab"]
    assert pictures[0] == pictures[1]
