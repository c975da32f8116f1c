import csv
import json

import pytest
from handmade_evaluations import write_board
from handmade_records import failed, record

from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.report.page import list_selections
from saf_gen.leaderboard.results import by_axis
from saf_gen.leaderboard.tables import by_bin


def axis(records, name, methods=("a+s",)):
    (found,) = (t for t in by_axis(records, methods) if t.axis.name == name)
    return found


def names(found):
    return tuple(one.name for one in found.bins)


def sequences(found):
    return tuple(one.sequences for one in found.bins)


def one(number, error=0.0, *, method="a+s", **more):
    return record(method, f"s{number}", error, **more)


@pytest.mark.parametrize(
    ("name", "field", "bins"),
    [
        ("focus_position", "focus_place", {0.0999: "first 10 %", 0.1: "middle", 0.9: "middle", 0.9001: "last 10 %"}),
        (
            "photon_budget",
            "mean_rate",
            {0.0099: "below 1", 0.01: "1 to 3", 0.05: "3 to 10", 0.2: "10 to 30", 0.3: "30 and more"},
        ),
        ("grain", "grain_rms", {0.0099: "below 1 %", 0.01: "1 to 2 %", 0.02: "2 to 4 %", 0.3: "4 % and more"}),
        ("light_ratio", "light_ratio", {1.0: "up to 1.1", 1.1: "1.1 to 2", 4.0: "2 to 5", 1000.0: "5 and more"}),
    ],
)
def test_numbers_fall_into_their_bins(name, field, bins):
    for value, expected in bins.items():
        assert names(axis([one(0, **{field: value})], name)) == (expected,)


@pytest.mark.parametrize(
    ("name", "field", "values"),
    [
        ("light", "light", ("constant", "ramp")),
        ("scene_motion", "scene_motion", ("dynamic", "static")),
        ("lens_motion", "lens_motion", ("hold", "sweep")),
        ("sensor", "sensor", ("vidar_400x250", "vidar_400x250_noisy")),
    ],
)
def test_names_are_bins_of_their_own(name, field, values):
    found = axis([one(i, **{field: value}) for i, value in enumerate(reversed(values))], name)
    assert names(found) == values
    assert sequences(found) == (1, 1)


def test_bins_of_numbers_stand_in_their_order_and_only_where_there_is_something():
    some = [one(i, mean_rate=rate) for i, rate in enumerate((0.5, 0.001, 0.02))]
    assert names(axis(some, "photon_budget")) == ("below 1", "1 to 3", "30 and more")


def test_an_axis_of_which_nothing_is_known_has_no_table_and_an_unknown_sequence_no_bin():
    some = [one(0), one(1, scene_motion="static")]
    assert {t.axis.name for t in by_axis(some, ["a+s"])} == {"light", "scene", "scene_motion"}
    assert sequences(axis(some, "scene_motion")) == (1,)


def test_a_bin_weighs_scenes_and_lights_as_the_whole_table_does():
    static = [
        *(one(i, 0.0, scene="a", scene_motion="static") for i in range(3)),
        one(3, 9.0, scene="a", light="ramp", scene_motion="static"),
        one(4, 0.0, scene="b", scene_motion="static"),
    ]
    moving = [one(5, 2.0, scene="a", scene_motion="dynamic")]
    found = axis([*static, *moving], "scene_motion")
    assert [(one.name, one.scenes, one.sequences) for one in found.bins] == [("dynamic", 1, 1), ("static", 2, 5)]
    dynamic, still = (one.results["a+s"] for one in found.bins)
    assert (dynamic.answerable_1dof, dynamic.median_error_dof) == (0, 2)
    assert still.answerable_1dof == pytest.approx(rank_methods(static)[0].answerable_1dof) == pytest.approx(0.75)
    assert still.median_error_dof == 0


def test_every_method_meets_the_same_sequences_in_a_bin_and_no_answer_is_counted():
    some = [one(0, scene_motion="static"), failed("b+s", "s0", "abstained", scene_motion="static")]
    found = axis(some, "scene_motion", ["a+s", "b+s"])
    assert sequences(found) == (1,)
    silent = found.bins[0].results["b+s"]
    assert (silent.false_abstentions, silent.median_error_dof) == (1, None)


def test_a_stratum_of_few_scenes_is_counted_and_not_ranked():
    scenes = {"one depth": 30, "relief": 29}
    some = [one(f"{s}{n}", scene=f"{s}{n}", stratum=s) for s, count in scenes.items() for n in range(count)]
    found = axis(some, "stratum")
    assert [(one.name, one.scenes, one.results["a+s"].answerable_1dof) for one in found.bins] == [
        ("one depth", 30, 1.0),
        ("relief", 29, None),
    ]
    ranked, counted = by_bin(found).columns[1:]
    assert (ranked.text("a+s"), counted.text("a+s")) == ("100% (0.00)", "not ranked")
    assert counted.meaning == "29 scenes, 29 sequences; fewer than 30 scenes: counted, not ranked"
    assert [s.name for s in list_selections(some) if s.axis == "Stratum"] == ["one depth"]


@pytest.mark.parametrize(
    ("place", "off", "bins"), [(0.5, 0.0, ("middle",)), (1.0, 1.0, ("last 10 %",)), (None, 1.001, ("outside",))]
)
def test_the_bin_of_the_focus_does_not_depend_on_the_answer(place, off, bins):
    known = {"focus_place": place, "focus_off_dof": off}
    for answered in (one(0, **known), one(0, 9.0, **known), failed("a+s", "s0", "abstained", **known)):
        assert names(axis([answered], "focus_position")) == bins


def test_an_unknown_focus_has_no_bin():
    known = one(0, focus_place=0.5)
    some = [known, one(1, focus_off_dof=None), one(2, focus_off_dof=0.5)]
    assert sequences(axis(some, "focus_position")) == (1,)


def test_the_files_contain_every_axis(tmp_path):
    places = ({"focus_place": 0.05}, {"focus_place": 0.5}, {"focus_off_dof": 2.0})
    some = [
        record(m, f"s{i}", e, scene=f"scene{i}", mean_rate=0.2, **place)
        for m, errors in {"a+s": (0.0, 0.4, 3.0), "b|c+s": (5.0, 5.0, 5.0)}.items()
        for i, (e, place) in enumerate(zip(errors, places, strict=True))
    ]
    write_board(tmp_path, some)
    document = json.loads((tmp_path / "leaderboard.json").read_text())
    by_name = {a["axis"]: a for a in document["axes"]}
    assert [b["bin"] for b in by_name["focus_position"]["bins"]] == ["first 10 %", "middle", "outside"]
    assert [c["answerable_1dof"] for c in by_name["focus_position"]["methods"]["a+s"]] == [1, 1, None]
    with (tmp_path / "axes.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == sum(len(a["bins"]) for a in document["axes"]) * 2
    (outside,) = (line for line in lines if line["bin"] == "outside" and line["method"] == "a+s")
    assert (outside["axis"], outside["answerable_1dof"], outside["median_error_dof"]) == ("focus_position", "", "")
    assert (outside["without"], outside["false_answers"], outside["false_abstentions"]) == ("1", "1", "0")
    text = (tmp_path / "leaderboard.md").read_text()
    assert "## Focus position" in text
    assert "| a+s | 100% (0.00) | 100% (0.40) | 1 of 1 false |" in text
    assert r"| b\|c+s | 0% (5.00) |" in text
    assert "## Photon budget" not in text  # a single bin adds nothing to the table
