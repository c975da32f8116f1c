"""Methods that look inside the target: what they see, and recordings that have no such place."""

import json
import shutil
from dataclasses import fields, replace

import numpy as np
import pytest
from handmade_records import record
from planted_sweeps import list_streams, make_spikes
from refusals import assert_says, refusal

import saf_gen
from saf_gen import write_stream
from saf_gen.benchmark.evaluate import evaluate, score_blocks
from saf_gen.benchmark.records import read_records, write_records
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.leaderboard.ranking import rank_methods
from saf_gen.leaderboard.results import warnings_on
from saf_gen.optics.actuators import get_actuator
from saf_gen.stream.measure_input import choose_region, inside_of
from saf_gen.stream.optima import curve_peak
from saf_gen.stream.stream_file import open_stream

FRAMES, SIZE = 800, (40, 48)
LENS = np.linspace(0, 1, FRAMES, dtype=np.float32)
TARGET = np.zeros(SIZE, bool)
TARGET[2:38, 5:41] = TARGET[20] = True
INSIDE = (5, 35, 8, 38)
SMALL = np.zeros(SIZE, bool)
SMALL[2:30, 5:41] = True
ALONE, BESIDE = "sd+argmax:window=50", "sd+argmax:window=50@inside"


def write(path, target=TARGET, **more):
    """Write a recording that is sharp in frame 300 inside its target, and in frame 600 elsewhere in the box."""
    spikes = make_spikes(600, shape=(FRAMES, *SIZE))
    spikes[:, 5:35, 8:38] = make_spikes(300, shape=(FRAMES, 30, 30))
    truth = {"position": 300 / 799, "depth_of_focus": (0.35, 0.40), "frame": 300.0, "target": target, **more}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_stream(path, spikes, focus_position=LENS, truth=truth)
    return path


def dataset(folder, **targets):
    for name, target in targets.items():
        write(folder / "test" / f"{name}.h5", target)
    return list_streams(folder, *({"id": name, "scene": name} for name in targets))


def test_methods_that_look_inside_see_its_pixels_and_no_others(tmp_path):
    source = write(tmp_path / "a.h5")
    for records in (
        evaluate(source, methods=[ALONE, BESIDE]).records[1:],
        evaluate(source, methods=[ALONE], region="inside").records,
    ):
        (one,) = records
        assert (one.who.region, one.success()) == ("inside", True)
        assert abs(one.judgement.frame - 300) < 50
    with open_stream(source) as stream:
        _, scores = score_blocks(stream, "sd", window=50, region="inside")
        box = slice(5, 35), slice(8, 38)
        assert choose_region(stream, "inside") == (box, "inside")
        counts = stream.counts(0, 50, region=box).astype(float)
    assert scores[0] == pytest.approx(counts.var() / counts.mean() ** 2)


@pytest.mark.parametrize(
    ("truth", "there"),
    {
        "a mask at rest": ({}, INSIDE),
        "what it states": ({"inside": (0, 9, 1, 8)}, (0, 9, 1, 8)),
        "too small a mask": ({"target": SMALL}, None),
        "no mask": ({"target": None}, None),
        "a mask of one moment": ({"track": np.full(FRAMES, 0.4)}, None),
        "what it states of one that moves": ({"track": np.full(FRAMES, 0.4), "inside": (0, 9, 1, 8)}, (0, 9, 1, 8)),
    }.values(),
)
def test_where_a_recording_has_it(tmp_path, truth, there):
    with open_stream(write(tmp_path / "a.h5", **truth)) as stream:
        box = inside_of(stream.truth)
        assert there == (box and (box[0].start, box[0].stop, box[1].start, box[1].stop))
        if there is None:
            assert_says(refusal(choose_region, stream, "inside"), "no region 'inside' | 24 × 24 | such as target")


def test_a_recording_without_it_counts_for_no_method_that_looks_there_and_is_named(tmp_path):
    result = evaluate(dataset(tmp_path, good=TARGET, small=SMALL), methods=[ALONE, BESIDE])
    found = {(r.who.region, r.what.sequence): r for r in result.records}
    without = found["inside", "small"]
    assert (without.what.obstacle, without.success(), without.judgement.windows) == ("no inside region", None, 0)
    assert without.judgement.note == "the recording has no inside region"
    assert without.judgement.optimum is None
    assert (found["target", "small"].what.obstacle, found["target", "small"].success()) == (None, True)
    rows = {row.method: row for row in rank_methods(result.records)}
    assert (rows[BESIDE].answerable_1dof, rows[BESIDE].abstained, rows[BESIDE].sequences) == (1.0, 0, 1)
    assert rows[BESIDE].frames_seen == 1.0
    assert rows[ALONE].sequences == 2
    notes = warnings_on(tuple(rows.values()), result.records)
    (note,) = (note for note in notes if "inside the target" in note)
    assert note.startswith("1 of 2 sequences have no rectangle inside")
    assert note.endswith("there: small.")
    assert not any("cannot be focused" in note for note in notes)


def test_answers_made_elsewhere_do_not_count_there_either(tmp_path):
    source = dataset(tmp_path / "d", good=TARGET, small=SMALL)
    lines = [json.dumps({"method": "guess", "sequence": name, "frame": 300.0}) for name in ("good", "small")]
    (tmp_path / "p.jsonl").write_text("\n".join(lines))
    found = {r.what.sequence: r for r in evaluate(source, predictions=tmp_path / "p.jsonl", region="inside").records}
    assert found["good"].success() is True
    assert (found["small"].success(), found["small"].judgement.status) == (None, "abstained")


def test_in_the_closed_loop_a_lens_moves_only_where_the_recording_has_it(tmp_path):
    """The sample, and the same recording with a target that is too small."""
    shutil.copytree(saf_gen.sample() / "stacks", tmp_path / "stacks")
    (tmp_path / "test").mkdir()
    with open_stream(next(saf_gen.sample().glob("test/*constant*.h5"))) as stream:
        spikes, small = stream.frames(0, 640), np.pad(SMALL, ((0, 88), (0, 80)))
        without = replace(stream.truth, target=small, inside=None, sharpness_inside=None)
        for name, truth in (("good", stream.truth), ("small", without)):
            held = {f.name: getattr(stream.metadata, f.name) for f in fields(stream.metadata)} | {"truth": truth}
            write_stream(tmp_path / "test" / f"{name}.h5", spikes, readout_hz=stream.readout_hz, **held)
        peak = curve_peak(stream.truth.sharpness_inside, dof=np.inf)
    source = list_streams(tmp_path, {"id": "good", "scene": "good"}, {"id": "small", "scene": "small"})
    protocol = ClosedLoopProtocol(get_actuator("voice_coil"))
    result = evaluate(source, methods=["sd+golden_section"], region="inside", protocol=protocol)
    found, none = result.records
    assert (found.who.region, found.what.obstacle, found.judgement.status) == ("inside", None, "answered")
    assert found.judgement.optimum == pytest.approx(peak)
    assert (none.who.region, none.what.obstacle, none.success()) == ("inside", "no inside region", None)
    assert (none.judgement.windows, none.judgement.truth_frame, none.judgement.optimum) == (0, None, None)
    assert [path.sequence for path in result.lens_paths] == ["good"]
    write_records(tmp_path / "records.jsonl", result.records)
    assert read_records(tmp_path) == list(result.records)


@pytest.mark.parametrize(
    "inside", [(5, 5, 0, 9), (0, 41, 0, 9), (-1, 9, 0, 9), (0, 9.5, 0, 9), (0, 9, 0, np.nan), (0, 9)]
)
def test_a_rectangle_that_is_none_or_leaves_the_frame_is_refused(tmp_path, inside):
    assert "inside " in refusal(write, tmp_path / "a.h5", inside=inside).problem


@pytest.mark.parametrize("name", ["one recording", "a dataset"])
def test_if_no_recording_has_it_a_line_says_so(tmp_path, name):
    source = write(tmp_path / "a.h5", SMALL) if name == "one recording" else dataset(tmp_path, a=SMALL, b=SMALL)
    error = refusal(evaluate, source, methods=[ALONE], region="inside")
    assert_says(error, "has a region 'inside' | 24 × 24 | use another region")


def test_what_cannot_be_focused_at_all_is_counted_apart():
    blank = {"frame": None, "position": None, "status": "abstained"}
    records = [
        record("a+b@inside", "good", 0.1),
        record("a+b@inside", "small", None, obstacle="no inside region", **blank),
        record("a+b@inside", "dark", None, obstacle="no spikes", **blank),
    ]
    text = " ".join(warnings_on(rank_methods(records), records))
    assert "1 of 3 sequences cannot be focused: 1 with no spikes" in text
    assert "1 of 3 sequences have no rectangle inside the target" in text
