import json
import math
from dataclasses import fields, replace

import numpy as np
import pytest
from test_leaderboard import BLANK

from saf_gen.errors import BadInput
from saf_gen.records import (
    FORMAT,
    Record,
    read_records,
    record_from_json,
    record_to_json,
    records_to_text,
)

FULL = replace(
    BLANK,
    trace=(400.5, 3.0),
    track="closed_loop",
    terms="voice_coil, 400 ms",
    variant=2,
    scene_motion="dynamic",
    lens_motion="sweep",
    truth_first=0.4,
    mean_rate=0.21,
    light_ratio=5.0,
    time_to_focus_s=0.31,
    reversals=2,
    parameters="SpikeDispersion() + Argmax(window=100, refine=False)",
    machine="x86_64, 2 cores",
)
EMPTY = replace(
    BLANK, **{f.name: None for f in fields(Record) if "None" in str(f.type)}, status="abstained", trace=()
)


@pytest.mark.parametrize("record", [BLANK, FULL, EMPTY], ids=["usual", "full", "empty"])
def test_what_is_written_is_read_back(record):
    assert record_from_json(json.loads(json.dumps(record_to_json(record)))) == record


def test_a_file_is_read_back_from_itself_or_from_its_folder(tmp_path):
    (tmp_path / "records.jsonl").write_text(records_to_text([BLANK, FULL]))
    assert read_records(tmp_path) == read_records(tmp_path / "records.jsonl") == [BLANK, FULL]


def test_every_line_says_its_format_first():
    assert records_to_text([BLANK]).startswith(f'{{"format": "{FORMAT}", "method": "sd+argmax"')


def test_what_is_not_finite_becomes_null_and_a_null_in_a_trace_is_nan():
    line = record_to_json(replace(FULL, error=math.nan, trace=(1.0, math.inf)))
    assert (line["error"], line["trace"]) == (None, [1.0, None])
    back = record_from_json(line)
    assert back.error is None
    assert back.trace[0] == 1
    assert math.isnan(back.trace[1])


def test_numpy_numbers_are_written_as_plain_ones():
    odd = replace(FULL, frame=np.float64(3.5), variant=np.int64(2), success_1dof=np.bool_(True))
    assert record_from_json(json.loads(json.dumps(record_to_json(odd)))) == replace(FULL, frame=3.5)


def test_a_whole_number_will_do_for_a_float_and_true_will_not():
    line = record_to_json(FULL)
    assert record_from_json({**line, "seconds": 1}).seconds == 1
    with pytest.raises(BadInput, match="seconds is True; allowed: a finite number"):
        record_from_json({**line, "seconds": True})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"format": "saf-gen record 1"},
            f"no record of this version: 'saf-gen record 1'.*{FORMAT}.*evaluate",
        ),
        ({"status": "lost"}, "status is 'lost'; allowed: answered or abstained or failed"),
        ({"track": "live"}, "track is 'live'; allowed: recorded or closed_loop"),
        ({"frames": 10.5}, "frames is 10.5; allowed: a whole number"),
        ({"frames": None}, "frames is None; allowed: a whole number"),
        ({"error": "0.1"}, "error is '0.1'; allowed: a finite number or null"),
        ({"success_1dof": 1}, "success_1dof is 1; allowed: true or false or null"),
        ({"trace": [1, "x"]}, r"trace is \(1.0, 'x'\); allowed: a list of numbers"),
        ({"trace": 3}, "trace is 3; allowed: a list of numbers"),
        ({"secnds": 1.0}, "unknown key 'secnds'; did you mean 'seconds'?"),
        ({"method": None}, "method is None; allowed: text"),
    ],
)
def test_a_line_that_is_not_right_is_refused_by_its_key(change, message):
    with pytest.raises(BadInput, match=message):
        record_from_json({**record_to_json(FULL), **change})


def test_a_missing_key_and_a_line_of_no_format_are_refused():
    line = record_to_json(FULL)
    del line["data"]
    with pytest.raises(BadInput, match="data is missing"):
        record_from_json(line)
    del line["format"]
    with pytest.raises(BadInput, match="no record of this version: 'no format'"):
        record_from_json(line)
    with pytest.raises(BadInput, match=r"no record of this version: \[1\]"):
        record_from_json([1])


def damaged(tmp_path, text):
    path = tmp_path / "records.jsonl"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(BadInput) as caught:
        read_records(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_damaged_file_is_one_line_that_names_the_place(tmp_path):
    whole = records_to_text([BLANK, FULL])
    assert "records.jsonl:2: is no JSON" in damaged(tmp_path, whole[:-30])
    assert "records.jsonl:1: is no record of this version" in damaged(tmp_path, '{"a": 1}\n' + whole)
    assert "records.jsonl:3: is no JSON: ''" in damaged(tmp_path, whole + "\n" + whole)
    assert "cannot be read" in damaged(tmp_path, b"\xff\xfe")
    assert "holds no record" in damaged(tmp_path, "")


@pytest.mark.parametrize("what", ["nothing", ""])
def test_where_there_are_no_records_the_way_to_make_them_is_said(tmp_path, what):
    with pytest.raises(BadInput, match="there is no records.jsonl at .*saf-gen evaluate"):
        read_records(tmp_path / what)
