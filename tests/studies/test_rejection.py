"""Curves of rejection against counts by hand."""

import pytest
from handmade_records import failed, record

from saf_gen.benchmark.records import write_records
from studies.ranking.rejection import false_answers_at, main, rejection_curve, stated_confidence


def answers(confidences, *, off, method="a+s"):
    """One answer a scene; the lens stays away from the focus if ``off``."""
    return [
        record(method, f"{off}{n}", 0.0, scene=f"{off}{n}", focus_off_dof=5.0 if off else 0.0, note=note)
        for n, note in enumerate(f"clear, confidence {c}" for c in confidences)
    ]


def rates(curve):
    return [(point.false_abstentions, point.false_answers) for point in curve]


def test_a_threshold_withdraws_what_is_less_sure():
    some = [*answers([0.2, 0.9], off=False), *answers([0.1, 0.3], off=True)]
    assert rates(rejection_curve(some)) == [(0, 1), (0, 1), (0, 0.5), (0.5, 0.5), (0.5, 0), (1, 0)]


def test_the_figure_is_the_fewest_false_answers_at_the_price():
    right, wrong = [n / 100 for n in range(100)], [0.005, 0.015, 0.025, 0.5]
    curve = rejection_curve([*answers(right, off=False), *answers(wrong, off=True)])
    assert false_answers_at(curve) == 0.5  # at a threshold of 0.02, two of 100 right answers and two false ones go
    assert false_answers_at(curve, 0.0) == 1.0
    assert false_answers_at(curve, 1.0) == 0.0


def test_a_method_that_abstains_falsely_too_often_has_no_figure():
    some = [*answers([0.9], off=False), failed("a+s", "x", "abstained", scene="x"), *answers([0.5], off=True)]
    assert false_answers_at(rejection_curve(some)) is None


def test_without_a_confidence_there_is_one_point():
    some = [record("a+s", "in", 0.0, scene="in"), record("a+s", "out", 5.0, scene="out", focus_off_dof=5.0)]
    assert rates(rejection_curve(some)) == [(0, 1)]
    assert false_answers_at(rejection_curve(some)) is None
    assert rejection_curve(some[:1]) == []


@pytest.mark.parametrize(
    ("note", "value"),
    [("confidence 0.25", 0.25), ("Confidence -3e-2, late", -0.03), ("no confidence", None), ("confidence 1.2.3", None)],
)
def test_a_note_states_it_in_a_word(note, value):
    assert stated_confidence(record("a+s", "x", 0.0, note=note)) == value


def test_the_table_shows_what_is_known(tmp_path, capsys):
    some = [*answers([0.2, 0.9], off=False), *answers([0.1, 0.3], off=True)]
    silent = [*answers([""] * 2, off=False, method="b+s"), *answers([""] * 2, off=True, method="b+s")]
    write_records(tmp_path / "records.jsonl", [*some, *silent])
    assert main([str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.strip("| ").split(" | ") for line in lines[-2:]] == [
        ["a+s", "0.0 %", "100.0 %", "50.0 %"],
        ["b+s", "0.0 %", "100.0 %", "–"],
    ]
    assert main([str(tmp_path / "none")]) == 2
