import csv
import json
from dataclasses import replace

import pytest

from saf_gen.errors import BadInput
from saf_gen.evaluate import Failure
from saf_gen.leaderboard import columns, markdown, table, write_files
from saf_gen.scores import Record

BLANK = Record(
    method="sd+argmax",
    sequence="s0",
    split="test",
    scene="camel",
    light="constant",
    status="answered",
    position=0.5,
    frame=400.0,
    truth=0.5,
    truth_frame=400.0,
    error=0.0,
    error_frames=0.0,
    error_dof=0.0,
    blur_px=0.0,
    success_half_dof=True,
    success_1dof=True,
    success_2dof=True,
    trace=(),
    frames=800,
    frames_seen=800,
    lens_travel=1.5,
    windows=8,
    seconds=0.25,
    note="",
    region="target",
    data="d0",
    code="c0",
)


def record(method, sequence, error_dof, *, scene="camel", light="constant", **more):
    """An answer ``error_dof`` from the truth; a depth of focus is a tenth of the travel and 80 frames."""
    within = [None if error_dof is None else abs(error_dof) <= limit for limit in (0.5, 1, 2)]
    plain = {
        "error_dof": error_dof,
        "error": None if error_dof is None else error_dof / 10,
        "error_frames": None if error_dof is None else error_dof * 80,
        "success_half_dof": within[0],
        "success_1dof": within[1],
        "success_2dof": within[2],
        "data": f"sha-{sequence}",
        "code": f"code-{method}",
    }
    return replace(BLANK, method=method, sequence=sequence, scene=scene, light=light, **{**plain, **more})


def failed(method, sequence, status, **more):
    return replace(
        record(method, sequence, None, **more),
        status=status,
        frame=None,
        position=None,
        success_half_dof=False,
        success_1dof=False,
        success_2dof=False,
    )


@pytest.fixture
def records():
    return [
        record("sd+argmax", "a", 0.2),
        record("sd+argmax", "b", -0.8, light="ramp"),
        record("er+argmax", "a", 0.3),
        record("er+argmax", "b", 6.0, light="ramp"),
        failed("odd+argmax", "a", "abstained"),
        failed("odd+argmax", "b", "failed", light="ramp"),
    ]


def test_success_within_one_depth_of_focus_ranks(records):
    rows = table(records)
    assert [(r.rank, r.method, r.success_1dof) for r in rows] == [
        (1, "sd+argmax", 1.0),
        (2, "er+argmax", 0.5),
        (3, "odd+argmax", 0.0),
    ]


def test_errors_are_medians_of_what_was_answered_in_every_unit(records):
    sd, er, odd = table(records)
    assert sd.median_error_dof == pytest.approx(0.5)
    assert sd.median_error_travel == pytest.approx(0.05)
    assert sd.median_error_frames == pytest.approx(40)
    assert er.median_error_dof == pytest.approx(3.15)
    assert odd.median_error_dof is None


def test_abstentions_and_failures_are_counted_apart(records):
    odd = table(records)[-1]
    assert (odd.abstained, odd.failed, odd.sequences) == (1, 1, 2)


def test_each_light_has_its_success(records):
    assert dict(table(records)[1].success_by_light) == {"constant": 1.0, "ramp": 0.0}


def test_scenes_weigh_the_same_however_many_sequences_they_have():
    rows = table(
        [
            *(record("m+s", f"a{i}", 0.0, scene="a") for i in range(9)),
            record("m+s", "b0", 9.0, scene="b"),
        ]
    )
    assert rows[0].success_1dof == pytest.approx(0.5)


def test_costs_weigh_scenes_and_lights_as_success_does():
    rows = table(
        [
            *(record("m+s", f"a{i}", 0.0, scene="a", seconds=1.0, frames_seen=200) for i in range(3)),
            record("m+s", "a9", 0.0, scene="a", light="ramp", seconds=3.0, frames_seen=400, lens_travel=0.5),
            record("m+s", "b0", 0.0, scene="b", seconds=6.0, frames_seen=800),
        ]
    )
    assert rows[0].seconds == pytest.approx(((1 + 3) / 2 + 6) / 2)
    assert rows[0].frames_seen == pytest.approx(((0.25 + 0.5) / 2 + 1) / 2)
    assert rows[0].lens_travel == pytest.approx(((1.5 + 0.5) / 2 + 1.5) / 2)


def test_lights_of_a_scene_weigh_the_same_however_many_repeats_they_have():
    rows = table(
        [
            *(record("m+s", f"a{i}", 0.0, light="constant") for i in range(3)),
            record("m+s", "a9", 9.0, light="ramp"),
            record("m+s", "b0", 0.0, scene="b"),
        ]
    )
    assert rows[0].success_1dof == pytest.approx((0.5 + 1) / 2)


def test_ties_share_a_rank_are_named_and_the_next_rank_counts_them():
    rows = table(
        [
            record("a+s", "x", 0.9),
            record("b+s", "x", 0.1),
            record("c+s", "x", 0.4),
            record("d+s", "x", 5.0),
        ]
    )
    assert [(r.rank, r.method) for r in rows] == [(1, "b+s"), (1, "c+s"), (1, "a+s"), (4, "d+s")]
    assert rows[0].tied == ("a+s", "c+s")
    assert rows[3].tied == ()
    rank = columns(rows)[0]
    assert [rank.text(r) for r in rows] == ["1=", "1=", "1=", "4"]


def test_equal_fractions_tie_whatever_their_last_bit():
    def spread(method, errors):
        return [record(method, f"{i}", e, scene=f"s{i}") for i, e in enumerate(errors)]

    rows = table([*spread("a+s", [0, 0, 9, 9, 9, 0, 9]), *spread("b+s", [9, 9, 0, 9, 0, 9, 0])])
    assert [r.rank for r in rows] == [1, 1]


def test_without_truth_nothing_ranks_and_costs_stand():
    (row,) = table([record("a+s", "x", None)])
    assert (row.rank, row.success_1dof, row.median_error_dof) == (None, None, None)
    assert (row.frames_seen, row.lens_travel, row.seconds) == (1.0, 1.5, 0.25)
    assert columns([row])[0].text(row) == "–"


def test_methods_without_truth_come_after_those_that_rank():
    rows = table([record("a+s", "x", None), record("b+s", "x", 9.0)])
    assert [r.method for r in rows] == ["b+s", "a+s"]


@pytest.mark.parametrize(
    ("records", "message"),
    [
        ([record("a+s", "x", 0), record("a+s", "x", 0)], r"two records of a\+s on x"),
        ([record("a+s", "x", 0), record("a+s", "y", 0), record("b+s", "x", 0)], r"b\+s has no record of y"),
        ([record("a+s", "x", 0), record("b+s", "x", 0, data="other")], "different data"),
        ([record("a+s", "x", 0), record("b+s", "x", 0, region="frame")], "different data or regions"),
        (
            [record("a+s", "x", 0), record("a+s", "y", 0, code="other")],
            r"records of a\+s come from different code",
        ),
    ],
)
def test_records_that_cannot_be_compared_are_refused(records, message):
    with pytest.raises(BadInput, match=message):
        table(records)


def test_no_record_gives_an_empty_table(tmp_path):
    assert table([]) == ()
    write_files(tmp_path, rows=(), records=(), failures=[Failure("x", "cut short")])
    assert json.loads((tmp_path / "leaderboard.json").read_text())["failures"][0]["sequence"] == "x"


def test_the_files_agree(tmp_path, records):
    rows = table(records)
    paths = write_files(tmp_path, rows=rows, records=records, failures=[Failure("bad", "truncated")])
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(p.name for p in paths)
    document = json.loads((tmp_path / "leaderboard.json").read_text())
    with (tmp_path / "leaderboard.csv").open(newline="") as file:
        sheet = list(csv.DictReader(file))
    lines = [json.loads(line) for line in (tmp_path / "records.jsonl").read_text().splitlines()]
    text = (tmp_path / "leaderboard.md").read_text()
    assert [r["method"] for r in document["rows"]] == [r["method"] for r in sheet] == [r.method for r in rows]
    for one, other in zip(document["rows"], sheet, strict=True):
        assert set(other) == set(one) - {"tied"}
        for name, cell in other.items():
            assert cell == ("" if one[name] is None else str(one[name]))
    assert markdown(rows) in text
    assert "`bad`: truncated" in text
    assert [(r["method"], r["sequence"]) for r in lines] == [(r.method, r.sequence) for r in records]
    assert document["data"] == {"a": "sha-a", "b": "sha-b"}


def test_a_record_line_has_the_keys_that_outsiders_read(tmp_path, records):
    write_files(tmp_path, rows=table(records), records=records)
    line = json.loads((tmp_path / "records.jsonl").read_text().splitlines()[0])
    promised = [
        "method",
        "sequence",
        "position",
        "frame",
        "truth",
        "error",
        "trace",
        "frames_seen",
        "lens_travel",
        "seconds",
    ]
    assert set(promised) <= set(line)


def test_nan_never_appears_in_a_file(tmp_path):
    strange = [record("a+s", "x", None, seconds=0.0, truth=float("nan"), trace=(float("nan"),))]
    write_files(tmp_path, rows=table(strange), records=strange)
    for path in tmp_path.iterdir():
        assert "nan" not in path.read_text().lower()


def test_a_file_replaces_the_one_before_at_once(tmp_path, records):
    (tmp_path / "leaderboard.md").write_text("old")
    write_files(tmp_path / ".", rows=table(records), records=records)
    assert (tmp_path / "leaderboard.md").read_text().startswith("# Leaderboard")
    assert not list(tmp_path.glob(".*"))


def test_a_folder_that_cannot_be_is_bad_input(tmp_path, records):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot be written"):
        write_files(tmp_path / "file" / "out", rows=table(records), records=records)


def test_every_column_has_a_name_of_its_own_a_meaning_and_a_text(records):
    rows = table(records)
    shown = columns(rows)
    assert len({c.name for c in shown}) == len({c.header for c in shown}) == len(shown)
    for column in shown:
        assert column.meaning.endswith(".")
        assert all(column.text(row) for row in rows)
    assert {"rank", "method", "success_1dof", "failed"} <= {c.name for c in shown if not c.minor}


def test_a_pipe_in_a_name_does_not_break_the_markdown():
    rows = table([record("a|b+s", "x", 0.0)])
    assert r"a\|b+s" in markdown(rows)
