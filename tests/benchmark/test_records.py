import json
import math
import re
from dataclasses import fields, replace

import numpy as np
import pytest
from handmade_records import BLANK
from planted_sweeps import write_sweep

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import (
    RECORD_FORMAT,
    Record,
    format_records,
    parse_record,
    read_records,
    record_to_json,
)
from saf_gen.benchmark.tracks.closed_loop_judgement import judge_closed_loop_run
from saf_gen.benchmark.tracks.closed_loop_run import ClosedLoopRun
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.parts import Answer
from saf_gen.stream.stream_file import Truth

FULL = replace(
    BLANK,
    trace=(400.5, 3.0),
    track="closed_loop",
    terms="voice_coil, 400 ms",
    variant=2,
    scene_motion="dynamic",
    lens_motion="sweep",
    truth_first=0.4,
    focus_place=0.35,
    focus_off_dof=0.2,
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
    assert parse_record(json.loads(json.dumps(record_to_json(record)))) == record


def test_a_file_is_read_back_from_itself_or_from_its_folder(tmp_path):
    (tmp_path / "records.jsonl").write_text(format_records([BLANK, FULL]))
    assert read_records(tmp_path) == read_records(tmp_path / "records.jsonl") == [BLANK, FULL]


def test_every_line_says_its_format_first():
    assert format_records([BLANK]).startswith(f'{{"format": "{RECORD_FORMAT}", "method": "sd+argmax"')


def test_what_is_not_finite_becomes_null_and_a_null_in_a_trace_is_nan():
    line = record_to_json(replace(FULL, time_to_focus_s=math.nan, trace=(1.0, math.inf)))
    assert (line["time_to_focus_s"], line["trace"]) == (None, [1.0, None])
    back = parse_record(line)
    assert back.time_to_focus_s is None
    assert back.trace[0] == 1
    assert math.isnan(back.trace[1])


def test_numpy_numbers_are_written_as_plain_ones():
    odd = replace(FULL, frame=np.float64(3.5), variant=np.int64(2), success_1dof=np.bool_(True))
    assert parse_record(json.loads(json.dumps(record_to_json(odd)))) == replace(FULL, frame=3.5)


def test_a_whole_number_will_do_for_a_float_and_true_will_not():
    line = record_to_json(FULL)
    assert parse_record({**line, "seconds": 1}).seconds == 1
    with pytest.raises(BadInput, match="seconds is True; allowed: a finite number"):
        parse_record({**line, "seconds": True})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"format": "saf-gen record 2"},
            f"no record of this version: 'saf-gen record 2'.*{RECORD_FORMAT}.*evaluate",
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
        ({"frames": 0}, "frames is 0; allowed: 1 or more"),
        ({"frames": 10**400}, r"frames is 1000\d*\.\.\.0*; allowed: 9\.0072e\+15 or less"),
        ({"frames_seen": -1}, "frames_seen is -1; allowed: 0 or more"),
        ({"windows": -1}, "windows is -1; allowed: 0 or more"),
        ({"seconds": -0.5}, r"seconds is -0\.5; allowed: 0 or more"),
        ({"seconds": 10**400}, r"seconds is 1000\d*\.\.\.0*; allowed: a finite number"),
        ({"seconds": 1e300}, r"seconds is 1e\+300; allowed: 1e\+09 or less"),
        ({"lens_travel": -1.0}, r"lens_travel is -1\.0; allowed: 0 or more"),
        ({"light_ratio": 0.5}, r"light_ratio is 0\.5; allowed: 1 or more"),
        ({"focus_place": 1.2}, r"focus_place is 1\.2; allowed: 1 or less"),
        ({"focus_off_dof": -0.1}, r"focus_off_dof is -0\.1; allowed: 0 or more"),
        ({"rig": None}, "rig is None; allowed: text"),
        ({"trace": [10**400]}, "trace is .*; allowed: a list of numbers"),
    ],
)
def test_a_line_that_is_not_right_is_refused_by_its_key(change, message):
    with pytest.raises(BadInput, match=message):
        parse_record({**record_to_json(FULL), **change})


def test_a_missing_key_and_a_line_of_no_format_are_refused():
    line = record_to_json(FULL)
    del line["data"]
    with pytest.raises(BadInput, match="data is missing"):
        parse_record(line)
    del line["format"]
    with pytest.raises(BadInput, match="no record of this version: 'no format'"):
        parse_record(line)
    with pytest.raises(BadInput, match=r"no record of this version: \[1\]"):
        parse_record([1])


ABSTAINED = {"status": "abstained", "frame": None, "time_to_focus_s": None} | dict.fromkeys(
    ("position", "error", "error_frames", "error_dof", "blur_px")
)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frames_seen": 801}, "frames_seen is 801 of 800 frames; allowed: 0 to 800"),
        ({"error_dof": 50.0}, "error_dof is 50, and success True, True, True; allowed: False, False, False"),
        ({"error_dof": -0.7}, "error_dof is -0.7, and success True, True, True; allowed: False, True, True"),
        (
            {"success_1dof": None},
            "success is known within some limits .*; allowed: all three, or null in all",
        ),
        ({"status": "failed"}, "failed, with position 0.5; allowed: null where there is no answer"),
        (
            {**ABSTAINED, "status": "failed"},
            "failed, with success; allowed: false, or null where the truth is",
        ),
        ({**ABSTAINED, "error_dof": 0.0}, "abstained, with error_dof 0; allowed: null"),
        ({**ABSTAINED, "success_half_dof": False}, "abstained, right within a larger limit and not within a"),
        ({**ABSTAINED, "frame": 3.0}, "abstained, with frame 3.0; allowed: a frame where there is an answer"),
        ({"frame": None}, "answered, with frame None; allowed: a frame where there is an answer"),
        ({"frame": 900.0}, "frame is 900 of 800 frames; allowed: -0.5 to 800"),
        ({"truth": None}, "error is 0, and there is no truth; allowed: null where the truth is unknown"),
        (
            {"error": None},
            "an error in depths of focus or a blur, and error is null; allowed: null in all three",
        ),
        ({"error_dof": None}, "a success, and error_dof is null; allowed: success false or null"),
        (
            {"focus_place": 0.5, "focus_off_dof": 1.5},
            r"focus_place is 0\.5, and the lens stays 1\.5 DoF away; allowed: null beyond 1 DoF",
        ),
        (
            {**ABSTAINED, "focus_off_dof": 1.5},
            r"abstained 1\.5 DoF from the focus, and success True, True, True; allowed: True, True, False",
        ),
    ],
)
def test_a_record_that_contradicts_itself_is_refused_with_its_line(tmp_path, change, message):
    said = damaged(tmp_path, format_records([BLANK, replace(BLANK, **change)]))
    assert "records.jsonl:2: contradicts itself: " in said
    assert re.search(message, said)


@pytest.mark.parametrize(
    ("peak", "known"), [(300.0, True), (-400.0, True), (-40.0, True), (300.0, False)],
    ids=["inside", "far outside", "a little outside", "unknown"],
)  # fmt: skip
def test_whatever_the_recorded_track_writes_is_read_back(tmp_path, peak, known):
    """Answers, abstentions, failures. Half a depth of focus is 39.95 frames: at 40 to abstain is right."""
    write_sweep(tmp_path / "a.h5", peak, known=known)
    (tmp_path / "p.jsonl").write_text(
        "".join(
            json.dumps({"method": f"m{i}", "sequence": "a", "frame": frame}) + "\n"
            for i, frame in enumerate([None, 900, -0.5, 0, 299.5, 340, 400, 799.5])
        )
    )
    records = evaluate(tmp_path / "a.h5", methods=["sd+argmax"], predictions=tmp_path / "p.jsonl").records
    assert {r.status for r in records} == {"answered", "abstained", "failed"}
    (tmp_path / "records.jsonl").write_text(format_records(records))
    assert read_records(tmp_path) == list(records)
    right = {r.method: (r.success_half_dof, r.success_1dof, r.success_2dof) for r in records}["m0"]
    expected = {300.0: (False, False, False), -400.0: (True, True, True), -40.0: (True, False, False)}
    assert right == (expected[peak] if known else (None, None, None))


def test_whatever_the_closed_loop_judges_is_read_back():
    """500 runs, seed named here: truths in and out of the travel and unknown, all three statuses."""
    random, seen = make_generator("test_records", "closed loop"), set()
    for _ in range(500):
        best = float(random.choice([random.uniform(-0.5, 1.5), math.nan], p=[0.9, 0.1]))
        half = float(random.choice([random.uniform(0.01, 0.2), math.nan], p=[0.9, 0.1]))
        path = random.uniform(0, 1, 80)
        answer = Answer(position=float(path[-1])) if random.random() < 0.6 else Answer()
        problem = "the budget was spent" if random.random() < 0.2 else ""
        run = ClosedLoopRun(answer, problem, int(random.integers(0, 81)), path, 80, 3, 0.1, tuple(path[:5]))
        verdict = judge_closed_loop_run(
            run, Truth(position=best, depth_of_focus=(best - half, best + half)), readout_hz=20_000
        )
        none = dict.fromkeys(
            ("position", "error", "error_frames", "error_dof", "blur_px", "time_to_focus_s", "truth_frame")
        )
        said = {
            "frame": None if problem else float(run.answer_frame),
            "frames": 80,
            "frames_seen": run.answer_frame,
        }
        record = replace(BLANK, track="closed_loop", **{**none, **said, **verdict})
        assert parse_record(json.loads(format_records([record]))) == record
        seen.add((record.status, record.success_half_dof, record.success_2dof))
    assert len(seen) >= 10


def damaged(tmp_path, text):
    path = tmp_path / "records.jsonl"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(BadInput) as caught:
        read_records(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_damaged_file_is_one_line_that_names_the_place(tmp_path):
    whole = format_records([BLANK, FULL])
    assert "records.jsonl:2: is no JSON" in damaged(tmp_path, whole[:-30])
    assert "records.jsonl:1: is no record of this version" in damaged(tmp_path, '{"a": 1}\n' + whole)
    assert "records.jsonl:3: is no JSON: ''" in damaged(tmp_path, whole + "\n" + whole)
    assert "cannot be read" in damaged(tmp_path, b"\xff\xfe")
    assert "records.jsonl:1: is no JSON: '[[[[" in damaged(tmp_path, "[" * 100_000)
    deep = whole.replace('"note": ""', '"note": ' + "[" * 400 + "]" * 400)
    assert "records.jsonl:1: note is [[[[" in damaged(tmp_path, deep)
    assert "records.jsonl:1: is no JSON" in damaged(
        tmp_path, whole.replace('"frames": 800', '"frames": ' + "8" * 5000)
    )


@pytest.mark.parametrize("note", ["a\u2028b", "a\u0085b", "a\x1cb", "a\r\nb", "a\nb"])
def test_a_note_may_hold_what_ends_a_line_elsewhere(tmp_path, note):
    records = [replace(BLANK, note=note), FULL]
    (tmp_path / "records.jsonl").write_bytes(format_records(records).encode())
    assert read_records(tmp_path) == records


def test_a_file_without_its_last_line_end_or_with_those_of_windows_is_read(tmp_path):
    text = format_records([BLANK, FULL])
    for other in (text.rstrip("\n"), text.replace("\n", "\r\n")):
        (tmp_path / "records.jsonl").write_bytes(other.encode())
        assert read_records(tmp_path) == [BLANK, FULL]


def test_an_empty_file_says_so(tmp_path):
    assert "holds no record" in damaged(tmp_path, "")


@pytest.mark.parametrize("what", ["nothing", ""])
def test_where_there_are_no_records_the_way_to_make_them_is_said(tmp_path, what):
    with pytest.raises(BadInput, match="there is no records.jsonl at .*saf-gen evaluate"):
        read_records(tmp_path / what)
