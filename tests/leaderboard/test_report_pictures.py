"""The pictures at the answers of methods."""

import io

import numpy as np
import pytest
from handmade_evaluations import board_of
from handmade_records import record
from PIL import Image
from planted_sweeps import SHAPE, write_three_sweeps

from saf_gen.benchmark.tracks.tasks import select_sequences_to_evaluate
from saf_gen.leaderboard.report.pictures import SHOWN, picture_answers

PEAKS = {"one": 200.0, "two": 400.0, "three": 600.0}


@pytest.fixture(scope="module")
def tasks(tmp_path_factory):
    return select_sequences_to_evaluate(write_three_sweeps(tmp_path_factory.mktemp("delivered"))).tasks


def answers(**off):
    """Records of methods that answer so many frames beside the focus, by sequence; None abstains."""
    return [
        record(
            f"{method}+s",
            name,
            None if by_name[name] is None else by_name[name] / (SHAPE[0] - 1) / 0.1,
            frame=None if by_name[name] is None else PEAKS[name] + by_name[name],
            split="train",
            scene=name,
        )
        for method, by_name in off.items()
        for name in PEAKS
    ]


def pictures(delivered):
    sheet = np.asarray(Image.open(io.BytesIO(delivered.strip.file)), dtype=float)
    across, down = delivered.strip.size
    return [sheet[:down, at * across : (at + 1) * across] for at in range(delivered.strip.count)]


@pytest.mark.slow
def test_the_first_and_the_last_method_are_shown_on_the_recording_with_the_median_difference(tasks):
    made = answers(good=dict.fromkeys(PEAKS, 0.0), bad={"one": 90.0, "two": 150.0, "three": 190.0})
    found = picture_answers(tasks, board_of(made))
    assert found.sequence == "two"
    assert [method for method, _ in found.answers] == ["good+s", "bad+s"]
    assert found.answers[1][1] == f"+{150 / 799 / 0.1:.2f} DoF"
    assert found.frames == SHAPE[0] // 100
    sharp, dull = pictures(found)
    assert sharp.shape == (48, 48)  # the whole sensor is no higher
    assert sharp.std() > 2 * dull.std()


def test_of_many_methods_some_are_shown_from_the_first_to_the_last(tasks):
    made = answers(**{f"m{n}": dict.fromkeys(PEAKS, 20.0 * n) for n in range(9)})
    found = picture_answers(tasks, board_of(made))
    assert [method for method, _ in found.answers] == ["m0+s", "m2+s", "m4+s", "m6+s", "m8+s"]
    assert found.strip.count == SHOWN


def test_there_are_no_pictures_without_two_answers_to_compare(tasks):
    one = answers(good=dict.fromkeys(PEAKS, 0.0))
    silent = answers(good={"one": 0.0, "two": None, "three": None}, bad={"one": None, "two": 9.0, "three": 9.0})
    closed = [record(m, "one", 0.1, frame=3.0, track="closed_loop", terms="t") for m in ("a+s", "b+s")]
    for records in (one, silent, closed, []):
        assert picture_answers(tasks, board_of(records)) is None


@pytest.mark.slow
def test_a_stream_that_has_gone_costs_the_pictures_alone(tmp_path):
    folder = write_three_sweeps(tmp_path)
    tasks = select_sequences_to_evaluate(folder).tasks
    made = answers(good=dict.fromkeys(PEAKS, 0.0), bad=dict.fromkeys(PEAKS, 90.0))
    for path in (folder / "train").glob("*.h5"):
        path.unlink()
    assert picture_answers(tasks, board_of(made)) is None
