"""The warning about grain, and the grain of each scene in tables, JSON and page."""

import json
from dataclasses import replace

import pytest
from handmade_evaluations import make_evaluation
from handmade_records import record

from saf_gen.leaderboard import compose_leaderboard_notes, rank_methods, write_leaderboard
from saf_gen.leaderboard.grain_tables import compose_leaderboard_grain_notes, tabulate_leaderboard_grain
from saf_gen.leaderboard.report import build_report_page


def grainy(method, sequence, of_curve, *, rms=0.02, **more):
    return replace(record(method, sequence, 0.1, **more), grain_rms=rms, grain_of_curve=of_curve)


RECORDS = [
    grainy("sd+argmax", "a", 0.02, scene_motion="static"),
    grainy("brenner+argmax", "a", 0.05, scene_motion="static"),
    grainy("brenner+egs_code", "a", 0.05, scene_motion="static"),
    grainy("sd+argmax", "b", 0.1, rms=0.12, scene_motion="dynamic"),
    grainy("brenner+argmax", "b", 3.1, rms=0.12, scene_motion="dynamic"),
    grainy("brenner+egs_code", "b", 3.1, rms=0.12, scene_motion="dynamic"),
    replace(record("sd+argmax", "c", 0.1, scene="fan"), scene_motion="static"),
    replace(record("brenner+argmax", "c", 0.1, scene="fan"), scene_motion="static"),
    replace(record("brenner+egs_code", "c", 0.1, scene="fan"), scene_motion="static"),
]


def test_the_warning_counts_sequences_and_names_the_worst():
    (warning,) = compose_leaderboard_grain_notes(RECORDS)
    assert "exceeds 10% of the range of a focus curve on 1 of 2 sequences" in warning
    assert "(brenner; at worst 3.1 times the range, brenner on b)" in warning
    assert warning in compose_leaderboard_notes(rank_methods(RECORDS), RECORDS)


def test_many_measures_are_counted():
    many = [grainy(f"m{n}+argmax", "a", 0.2 + n) for n in range(7)]
    assert "(m6, m5, m4, m3 and 3 more; at worst 6.2 times" in compose_leaderboard_grain_notes(many)[0]


@pytest.mark.parametrize("records", [RECORDS[:3], RECORDS[6:]], ids=["little grain", "unknown"])
def test_without_a_cause_there_is_no_warning(records):
    assert compose_leaderboard_grain_notes(records) == []


def test_a_scene_at_rest_and_moving_have_a_line_each():
    still, moving, unknown = tabulate_leaderboard_grain(RECORDS)
    assert (still.scene, still.scene_motion, still.sequences, still.rms) == ("camel", "static", (1, 1), (0.02, 0.02))
    assert moving.of_curve == {"sd": 0.1, "brenner": 3.1}
    assert (unknown.scene, unknown.sequences, unknown.rms, unknown.of_curve) == ("fan", (1, 0), None, {})
    assert tabulate_leaderboard_grain(RECORDS[6:]) == []


def test_the_json_holds_the_grain_of_each_scene(tmp_path):
    write_leaderboard(tmp_path, rows=rank_methods(RECORDS), records=RECORDS)
    document = json.loads((tmp_path / "leaderboard.json").read_text())
    assert [table["scene"] for table in document["grain"]] == ["camel", "camel", "fan"]
    assert document["grain"][1]["of_curve"]["brenner"] == 3.1
    assert any("noise of the renderer" in note for note in document["notes"])


def test_the_page_shows_grain_where_it_is_known():
    page = build_report_page(rank_methods(RECORDS), title="t", records=RECORDS)
    assert 'id="grain"' in page
    assert "12.00%" in page
    assert "3.1" in page.split('id="grain"')[1]
    assert "Warning: noise of the renderer" in page
    made = make_evaluation()
    assert 'id="grain"' not in build_report_page(rank_methods(made.records), title="t", records=made.records)
