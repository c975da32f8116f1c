"""The lines of records.jsonl: written, read back, and refused if they contradict themselves."""

import json
import math
import re
from dataclasses import fields, replace
from types import NoneType
from typing import get_args

import numpy as np
import pytest
from handmade_records import BLANK, change
from planted_sweeps import write_sweep
from refusals import assert_says, refusal

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.judgement import Run, judge
from saf_gen.benchmark.records import (
    FOLLOWING,
    PARTS,
    RECORD_FORMAT,
    SUCCESS_LIMITS_DOF,
    Record,
    format_records,
    read_records,
    record_to_json,
    write_records,
)
from saf_gen.core.seeds import make_generator
from saf_gen.parts import Answer
from saf_gen.stream.metadata import Truth

FULL = change(
    BLANK, trace=(400.5, 3.0), track="closed_loop", terms="voice_coil, 400 ms", scene_motion="dynamic",
    lens_motion="sweep", focus_place=0.35, focus_off_dof=0.2, mean_rate=0.21, light_ratio=5.0, least_blur=-0.02,
    time_to_focus_s=0.31, reversals=2, parameters="SpikeDispersion() + Argmax(window=100, refine=False)",
    machine="x86_64, 2 cores", grain_rms=0.02, grain_of_curve=0.3, operations=1e6, reference_rate=1e9,
)  # fmt: skip
OPTIONAL = [f.name for part in PARTS for f in fields(part) if NoneType in get_args(f.type)]
EMPTY = change(BLANK, **dict.fromkeys(OPTIONAL), status="abstained", trace=())


@pytest.fixture
def read(tmp_path):
    """A function that writes text, or lines given as values, to records.jsonl and reads that file."""

    def read_lines(*lines):
        text = "\n".join(line if isinstance(line, str) else json.dumps(line) for line in lines)
        (tmp_path / "records.jsonl").write_bytes(text.encode())
        return read_records(tmp_path)

    return read_lines


def test_a_file_is_read_back_from_itself_or_from_its_folder(tmp_path):
    records = [BLANK, FULL, EMPTY]
    (tmp_path / "records.jsonl").write_text(format_records(records))
    assert read_records(tmp_path) == read_records(tmp_path / "records.jsonl") == records
    assert format_records(records).startswith(f'{{"format": "{RECORD_FORMAT}", "method": "sd+argmax"')


def test_numbers_of_numpy_and_whole_numbers_for_floats_are_read_back(read):
    odd = change(FULL, frame=np.float64(3.5), reversals=np.int64(2))
    assert read(record_to_json(odd) | {"seconds": 1}) == [change(FULL, frame=3.5, seconds=1.0)]


def test_texts_that_many_records_share_are_in_memory_once(tmp_path):
    machine = {"machine": "a processor, 2 cores"}
    write_records(tmp_path / "records.jsonl", [change(BLANK, sequence=name, **machine) for name in "ab"])
    one, two = read_records(tmp_path)
    assert one.who.machine is two.who.machine
    assert not any(hasattr(part, "__dict__") for part in (one, one.who, one.what, one.judgement))


def test_a_very_long_line_is_refused_before_it_fills_the_memory(tmp_path):
    (tmp_path / "records.jsonl").write_text(format_records([BLANK]) + " " * ((1 << 24) + 1))
    error = refusal(read_records, tmp_path)
    assert_says(error, "the line is too long | at most 16,777,216 characters")
    assert error.where.endswith("records.jsonl:2")


def test_what_is_not_finite_becomes_null_and_a_null_in_a_trace_is_nan(read):
    line = record_to_json(change(FULL, time_to_focus_s=math.nan, trace=(1.0, math.inf)))
    assert (line["time_to_focus_s"], line["trace"]) == (None, [1.0, None])
    (back,) = read(line)
    assert back.judgement.time_to_focus_s is None
    assert back.judgement.trace[0] == 1
    assert math.isnan(back.judgement.trace[1])


LINE = record_to_json(FULL)
ANOTHER = 'not a record of this version | allowed: "format": "saf-gen record 10" | '


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (LINE | {"status": "lost"}, "status is 'lost' | answered, abstained, failed"),
        (LINE | {"track": "live"}, "track is 'live' | recorded, closed_loop"),
        (LINE | {"frames": True}, "frames is True | integer"),
        (LINE | {"position": "0.1"}, "position is '0.1' | number"),
        (LINE | {"trace": [1, "x"]}, "trace.1 is 'x' | number"),
        (LINE | {"method": None}, "method is None | string"),
        (LINE | {"frames": 0}, "frames is 0 | 1"),
        (LINE | {"frames": 10**400}, "frames is 1000 | 9007199254740992"),
        (LINE | {"seconds": 1e300}, "seconds is 1e+300 | 1000000000"),
        (LINE | {"light_ratio": 0.5}, "light_ratio is 0.5 | 1"),
        (LINE | {"focus_place": 1.2}, "focus_place is 1.2 | 1"),
        (LINE | {"secnds": 1.0}, "'secnds' | did you mean 'seconds'"),
        ({key: value for key, value in LINE.items() if key != "data"}, "'data' is missing"),
        (LINE | {"format": "saf-gen record 6"}, ANOTHER + "'saf-gen record 6'"),
        ({"a": 1}, ANOTHER + "no format"),
        ([1], ANOTHER + "[1]"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_line_that_is_no_record_is_refused_with_what_to_do(read, line, words):
    error = refusal(read, line)
    assert_says(error, words)
    assert error.where.endswith("records.jsonl:1")
    assert "saf-gen evaluate" in error.hint


@pytest.mark.parametrize(
    ("status", "note", "broke"),
    [
        ("failed", "CodeStopped: its code called exit(2)", True),
        ("failed", "it answers with NoneType None; return saf_gen.parts.Answer(frame)", True),
        ("failed", "BadInput: the recording has 5 frames", False),
        ("failed", "the budget of 800 frames was spent", False),
        ("failed", "answered frame 900.0, which is not in the sweep", False),
        ("abstained", "no peak", False),
    ],
)
def test_whether_the_code_of_a_method_broke(status, note, broke):
    assert change(BLANK, status=status, note=note).broke == broke


def test_no_two_parts_have_a_key_in_common():
    names = [f.name for part in PARTS for f in fields(part)]
    assert len(names) == len(set(names))
    assert list(LINE) == ["format", *names, *FOLLOWING]


ABSTAINED = {"status": "abstained", "frame": None, "position": None}


@pytest.mark.parametrize(
    ("values", "problem", "allowed"),
    [
        ({"frames_seen": 801}, "frames_seen is 801 of 800 frames", "0 to 800"),
        ({"status": "failed"}, "failed, but position is 0", "null if there is no answer"),
        ({**ABSTAINED, "time_to_focus_s": 0.1}, "abstained, but time_to_focus_s is 0.1", "null if there is no answer"),
        ({**ABSTAINED, "frame": 3.0}, "abstained, but frame is 3.0", "a frame if there is an answer"),
        ({"frame": None}, "answered, but frame is None", "a frame if there is an answer"),
        ({"frame": 900.0}, "frame is 900 of 800 frames", "-0.5 to 800"),
        ({"focus_place": 0.5, "focus_off_dof": 1.5}, "but the lens stays 1.5 DoF away", "null beyond 1 DoF"),
        ({"obstacle": "no spikes"}, "answered in a recording of no spikes", "no answer"),
    ],
)
def test_a_record_that_contradicts_itself_is_refused_with_its_line(read, values, problem, allowed):
    error = refusal(read, record_to_json(BLANK), record_to_json(change(BLANK, **values)))
    assert error.where.endswith("records.jsonl:2")
    assert "contradicts itself" in error.problem
    assert problem in error.problem
    assert allowed in error.allowed


@pytest.mark.parametrize(("key", "value"), [("error", 0.25), ("error_dof", 1.0), ("error_dof", None), ("error", "0")])
def test_an_error_that_does_not_follow_from_the_answer_is_refused(read, key, value):
    error = refusal(read, record_to_json(BLANK) | {key: value})
    assert_says(error, f"the record contradicts itself: {key} is {value} | 0.0, which follows")


@pytest.mark.parametrize(
    ("peak", "known"), [(300.0, True), (-400.0, True), (-40.0, True), (300.0, False)],
    ids=["inside", "far outside", "a little outside", "unknown"],
)  # fmt: skip
def test_whatever_the_recorded_track_writes_is_read_back(tmp_path, peak, known):
    """Half a depth of focus is 39.95 frames; for a focus 40 frames outside an abstention is right."""
    write_sweep(tmp_path / "a.h5", peak, known=known)
    (tmp_path / "p.jsonl").write_text(
        "".join(
            json.dumps({"method": f"m{i}", "sequence": "a", "frame": frame}) + "\n"
            for i, frame in enumerate([None, 900, -0.5, 0, 299.5, 340, 400, 799.5])
        )
    )
    records = evaluate(tmp_path / "a.h5", methods=["sd+argmax"], predictions=tmp_path / "p.jsonl").records
    assert {r.judgement.status for r in records} == {"answered", "abstained", "failed"}
    (tmp_path / "records.jsonl").write_text(format_records(records))
    assert read_records(tmp_path) == list(records)
    right = {r.who.method: tuple(map(r.success, SUCCESS_LIMITS_DOF)) for r in records}["m0"]
    expected = {300.0: (False, False, False), -400.0: (True, True, True), -40.0: (True, False, False)}
    assert right == (expected[peak] if known else (None, None, None))


def test_whatever_the_closed_loop_judges_is_read_back(read):
    """500 random runs with all three statuses, and truths inside and outside the travel and unknown; seed below."""
    random, seen, records = make_generator("test_records", "closed loop"), set(), []
    for _ in range(500):
        best = float(random.choice([random.uniform(-0.5, 1.5), math.nan], p=[0.9, 0.1]))
        half = float(random.choice([random.uniform(0.01, 0.2), math.nan], p=[0.9, 0.1]))
        path = random.uniform(0, 1, 80)
        answer = Answer(position=float(path[-1])) if random.random() < 0.6 else Answer()
        problem = "the budget was spent" if random.random() < 0.2 else ""
        done, sent = int(random.integers(0, 81)), tuple(path[:5])
        run = Run(answer, problem, path, frames_seen=done, windows=3, seconds=0.1, commands=sent)
        truth = Truth(position=best, depth_of_focus=(best - half, best + half))
        what = replace(BLANK.what, track="closed_loop", frames=80)
        record = Record(BLANK.who, what, judge(run, truth, end_s=lambda frames: frames / 20_000))
        records.append(record)
        seen.add((record.judgement.status, record.success(0.5), record.success(2)))
    assert len(seen) >= 10
    assert read(*map(record_to_json, records)) == records


INTACT = format_records([BLANK, FULL])
BEFORE = re.sub(r', "checksum": "\w+"', "", INTACT)


def test_a_flipped_bit_is_found_and_records_of_before_are_read(read, tmp_path):
    intact, path = format_records([BLANK]).encode(), tmp_path / "records.jsonl"
    for at in range(0, len(intact), 5):
        path.write_bytes(intact[:at] + bytes([intact[at] ^ 1 << at % 8]) + intact[at + 1 :])
        assert str(path) in str(refusal(read_records, path))
    assert read(BEFORE) == [BLANK, FULL]


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        (INTACT[:-30], 2, "not JSON"),
        ('{"a": 1}\n' + INTACT, 1, "not a record of this version"),
        (INTACT + "\n" + INTACT, 3, "not JSON"),
        ("[" * 100_000, 1, "nested too deep"),
        (BEFORE.replace('"note": ""', '"note": ' + "[" * 400 + "]" * 400), 1, "note is [[[["),
        (INTACT.replace('"frames": 800', '"frames": 801'), 1, "this was changed after it was written"),
        (INTACT.replace('"frames": 800', '"frames": ' + "8" * 5000), 1, "too many digits"),
        (INTACT.replace('"seconds": 0.25', '"seconds": NaN'), 1, "NaN"),
        (INTACT.replace('"note": ""', '"note": "", "note": "twice"'), 1, "'note' is given twice"),
    ],
)
def test_a_damaged_file_is_one_line_that_names_the_place(read, text, line, problem):
    error = refusal(read, text)
    assert error.where.endswith(f"records.jsonl:{line}")
    assert problem in error.problem


@pytest.mark.parametrize("note", ["a\u2028b", "a\r\nb", "a\nb"])
def test_a_note_may_contain_line_separators(tmp_path, note):
    records = [change(BLANK, note=note), FULL]
    (tmp_path / "records.jsonl").write_bytes(format_records(records).encode())
    assert read_records(tmp_path) == records


@pytest.mark.parametrize("text", [INTACT.rstrip("\n"), INTACT.replace("\n", "\r\n")])
def test_a_file_without_its_last_line_end_or_with_those_of_windows_is_read(read, text):
    assert read(text) == [BLANK, FULL]


def test_a_file_that_is_missing_or_holds_no_record_is_refused(read, tmp_path):
    error = refusal(read_records, tmp_path)
    assert "no records.jsonl" in error.problem
    assert "saf-gen evaluate" in error.hint
    assert "no record" in refusal(read, "").problem
    (tmp_path / "records.jsonl").write_bytes(b"\xff\xfe")
    assert "cannot be read" in refusal(read_records, tmp_path).problem
