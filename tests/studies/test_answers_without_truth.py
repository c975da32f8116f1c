"""Answers of all measures are counted by the share that agrees, and judged by the truth that they did not see."""

from handmade_records import record

from studies.ranking.answers_without_truth import count_right_answers

MEASURES = ("sd", "sd_code", "cen", "gradient_code_n")


def answers(sequence, *errors_dof, **more):
    return [record(f"{name}+argmax", sequence, e, **more) for name, e in zip(MEASURES, errors_dof, strict=True)]


def test_answers_are_right_within_a_depth_of_focus():
    made = [*answers("a", 0.0, 0.1, 0.2, 0.3), *answers("b", 3.0, 3.1, 3.2, -3.0), *answers("c", 0.0, 0.1, 3.0, -3.0)]
    without = answers("d", 3.0, 3.0, 3.0, 3.0, focus_off_dof=2.0, focus_place=None)
    assert count_right_answers([*made, *without]) == {
        "90 % and more": [True],
        "70 to 90 %": [False],
        "50 to 70 %": [True],
        "below": [],
    }
