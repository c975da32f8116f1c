"""The warning about grain, and the grain of each scene in tables, JSON and page."""

import json

import pytest
from handmade_evaluations import board_of, make_evaluation, write_board
from handmade_records import change, record

from saf_gen.leaderboard import Leaderboard, rank_methods
from saf_gen.leaderboard.report.page import build_page
from saf_gen.leaderboard.results import grain_by_scene, grain_warning, warnings_on


def grainy(method, sequence, of_curve, *, rms=0.02, **more):
    return change(record(method, sequence, 0.1, **more), grain_rms=rms, grain_of_curve=of_curve)


RECORDS = [
    grainy("sd+argmax", "a", 0.02, scene_motion="static"),
    grainy("brenner+argmax", "a", 0.05, scene_motion="static"),
    grainy("brenner+egs_code", "a", 0.05, scene_motion="static"),
    grainy("sd+argmax", "b", 0.1, rms=0.12, scene_motion="dynamic"),
    grainy("brenner+argmax", "b", 3.1, rms=0.12, scene_motion="dynamic"),
    grainy("brenner+egs_code", "b", 3.1, rms=0.12, scene_motion="dynamic"),
    change(record("sd+argmax", "c", 0.1, scene="fan"), scene_motion="static"),
    change(record("brenner+argmax", "c", 0.1, scene="fan"), scene_motion="static"),
    change(record("brenner+egs_code", "c", 0.1, scene="fan"), scene_motion="static"),
]


def test_the_warning_counts_sequences_and_names_the_worst():
    (warning,) = grain_warning(RECORDS)
    assert "exceeds 10% of the range of a focus curve on 1 of 2 sequences" in warning
    assert "(brenner; at worst 3.1 times the range, brenner on b)" in warning
    assert warning in warnings_on(rank_methods(RECORDS), RECORDS)


@pytest.mark.parametrize("records", [RECORDS[:3], RECORDS[6:]], ids=["little grain", "unknown"])
def test_without_a_cause_there_is_no_warning(records):
    assert grain_warning(records) == []


def test_a_scene_at_rest_and_moving_have_a_line_each():
    still, moving, unknown = grain_by_scene(RECORDS)
    assert (still.scene, still.scene_motion, still.sequences, still.rms) == ("camel", "static", (1, 1), (0.02, 0.02))
    assert moving.of_curve == {"sd": 0.1, "brenner": 3.1}
    assert (unknown.scene, unknown.sequences, unknown.rms, unknown.of_curve) == ("fan", (1, 0), None, {})
    assert grain_by_scene(RECORDS[6:]) == []


def test_the_json_holds_the_grain_of_each_scene(tmp_path):
    write_board(tmp_path, RECORDS)
    document = json.loads((tmp_path / "leaderboard.json").read_text())
    assert [table["scene"] for table in document["grain"]] == ["camel", "camel", "fan"]
    assert document["grain"][1]["of_curve"]["brenner"] == 3.1
    assert any("noise of the renderer" in note for note in document["notes"])


def test_the_page_shows_grain_where_it_is_known():
    page = build_page(board_of(RECORDS), title="t")
    assert 'id="grain"' in page
    assert "12.00%" in page
    assert "3.1" in page.split('id="grain"')[1]
    assert "Warning: noise of the renderer" in page
    assert 'id="grain"' not in build_page(Leaderboard.of(make_evaluation()), title="t")
