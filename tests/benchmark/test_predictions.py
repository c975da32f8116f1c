"""Predictions of external programs: read strictly, judged like the answers of methods."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from planted_sweeps import list_streams, write_sweep
from refusals import refusal

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.tracks.predictions import read_predictions
from saf_gen.stream.manifest import read_manifest, write_manifest


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    for name, peak in (("one", 300.0), ("two", 500.0)):
        write_sweep(folder / "test" / f"{name}.h5", peak)
    return list_streams(folder, *({"id": name, "light": name} for name in ("one", "two")))


def written(path, *lines):
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def line(sequence, frame, **more):
    return {"method": "my_net", "sequence": sequence, "frame": frame, **more}


@pytest.mark.slow
def test_predictions_are_judged_like_the_answers_of_methods(dataset, tmp_path):
    ours = evaluate(dataset, methods=["sd+argmax"]).records
    path = written(
        tmp_path / "p.jsonl",
        *(
            line(r.what.sequence, r.judgement.frame, trace=list(r.judgement.trace), seconds=0.25, note="by hand")
            for r in ours
        ),
    )
    records = evaluate(dataset, methods=["sd+argmax"], predictions=path).records
    theirs = [r for r in records if r.who.method == "my_net"]
    assert [r.what.sequence for r in theirs] == ["one", "two"]
    for mine, other in zip(ours, theirs, strict=True):
        for key in ("frame", "position", "error", "error_dof", "truth", "trace", "lens_travel"):
            assert getattr(mine.judgement, key) == getattr(other.judgement, key)
        assert (other.judgement.seconds, other.judgement.note, other.judgement.frames_seen) == (0.25, "by hand", 800)
    assert len({r.who.code for r in theirs}) == 1


def test_frames_seen_count_for_the_way_of_the_lens(dataset, tmp_path):
    path = written(tmp_path / "p.jsonl", line("one", 300, frames_seen=400), line("two", None, frames_seen=800))
    one, two = evaluate(dataset, methods=[], predictions=path).records
    assert one.judgement.lens_travel == pytest.approx((399 + 99) / 799, abs=1e-3)
    assert (two.judgement.status, two.judgement.error) == ("abstained", None)


def test_an_answer_beyond_the_recording_is_a_failure(dataset, tmp_path):
    path = written(tmp_path / "p.jsonl", line("one", 900), line("two", 500))
    one, two = evaluate(dataset, methods=[], predictions=path).records
    assert (one.judgement.status, one.success(2)) == ("failed", False)
    assert "answered frame 900.0" in one.judgement.note
    assert two.success()


@pytest.mark.parametrize(
    ("lines", "problem", "allowed"),
    [
        ([{"method": "a", "sequence": "one"}], "'frame' is missing", ""),
        ([line("one", 3, frame_seen=5)], "unknown key 'frame_seen'", "frames_seen"),
        ([line("one", "early")], "frame is 'early'", "number"),
        ([line("one", 10**400)], "frame is 1000", "number"),
        ([line("one", 3, frames_seen=9.0)], "frames_seen is 9.0", "integer"),
        ([line("one", 3, seconds=1e300)], "seconds is 1e+300", "1000000000"),
        ([line("one", 8213.5, frames_seen=1)], "frame is 8213.5, with frames_seen 1", "up to 0.5"),
        ([line("one", 3) | {"method": "a b"}], "method is 'a b'", "A-Z"),
        ([[1, 2]], "no keys", "method"),
        ([], "no prediction", "8213.5"),
    ],
)
def test_a_line_that_is_not_a_prediction_is_named(tmp_path, lines, problem, allowed):
    error = refusal(read_predictions, written(tmp_path / "p.jsonl", *lines))
    assert problem in error.problem
    assert allowed in error.allowed
    assert error.where.endswith("p.jsonl:1" if lines else "p.jsonl")


@pytest.mark.parametrize("frame", ["nan", "NaN", "1e999", "[" * 100_000, "9" * 5000])
def test_what_is_not_a_number_or_not_json_is_refused_by_its_line(tmp_path, frame):
    path = tmp_path / "p.jsonl"
    path.write_text(f'{{"method": "a", "sequence": "one", "frame": {frame}}}\n')
    assert refusal(read_predictions, path).where.endswith("p.jsonl:1")


@pytest.mark.parametrize(
    ("lines", "methods", "problem"),
    [
        ([line("one", 3)], [], "my_net does not answer two"),
        ([line("one", 3), line("two", 3, frames_seen=801)], [], "two: frames_seen is 801, but 800 frames were recor"),
        ([line("one", 3), line("too", 3)], [], "unknown sequence 'too'"),
        ([line(name, 3) | {"method": "sd+argmax"} for name in ("one", "two")], ["sd+argmax"],
         "the name 'sd+argmax' belongs to a method that is evaluated too"),
    ],
)  # fmt: skip
def test_predictions_fit_the_sequences_that_are_evaluated(dataset, tmp_path, lines, methods, problem):
    path = written(tmp_path / "p.jsonl", *lines)
    assert problem in refusal(evaluate, dataset, methods=methods, predictions=path).problem


def test_predictions_of_other_data_are_refused_before_anything_runs(dataset, tmp_path, call):
    path = written(tmp_path / "p.jsonl", line("one", 3), line("two", 3, data="0" * 64))
    steps, out = [], tmp_path / "out"
    error = refusal(
        evaluate, dataset, methods=["sd+argmax"], predictions=path, progress=lambda *step: steps.append(step)
    )
    assert error.problem == "the prediction for two was made from other data: 000000000000"
    assert error.where.endswith("p.jsonl, method my_net")
    assert steps == []
    code, _, err = call("evaluate", dataset, "--predictions", path, "--method", "sd+argmax", "--out", out)
    assert (code, err.count("\n")) == (2, 1)
    assert not out.exists()


def test_predictions_of_one_stream_are_held_to_the_stream_itself(dataset, tmp_path):
    stream = dataset / "test" / "one.h5"
    (ours,) = evaluate(stream, methods=["sd+argmax"]).records
    good = written(tmp_path / "good.jsonl", line("one", 300, data=ours.what.data, frames_seen=800))
    (record,) = evaluate(stream, methods=[], predictions=good).records
    assert (record.judgement.status, record.what.data) == ("answered", ours.what.data)
    steps = []
    for wrong, problem in ({"data": "f" * 64}, "ffffffffffff"), ({"frames_seen": 801}, "frames_seen is 801"):
        path = written(tmp_path / "wrong.jsonl", line("one", 300, **wrong))
        error = refusal(evaluate, stream, methods=["sd+argmax"], predictions=path, progress=lambda *s: steps.append(s))
        assert problem in error.problem
    assert steps == []


def test_a_method_answers_a_sequence_once(tmp_path):
    error = refusal(read_predictions, written(tmp_path / "p.jsonl", line("one", 3), line("one", 4)))
    assert error.where.endswith("p.jsonl:2")
    assert "my_net answers one twice" in error.problem
    assert refusal(read_predictions, tmp_path / "pp.jsonl").nearest.endswith("p.jsonl")


def test_where_the_manifest_says_another_length_that_prediction_alone_fails(dataset, tmp_path):
    copy = shutil.copytree(dataset, tmp_path / "copy")
    manifest = read_manifest(copy)
    write_manifest(copy, replace(manifest, sequences=tuple(replace(s, frames=900) for s in manifest.sequences)))
    path = written(tmp_path / "p.jsonl", line("one", 300, frames_seen=850), line("two", 500, frames_seen=800))
    ran, one, other, two = evaluate(copy, methods=["sd+argmax"], predictions=path).records
    assert (ran.judgement.status, other.judgement.status, two.judgement.status) == ("answered", "answered", "answered")
    assert (one.judgement.status, one.judgement.frames_seen, one.success(2)) == ("failed", 800, False)
    assert one.judgement.note == "frames_seen is 850, but 800 frames were recorded"


@pytest.mark.slow
def test_the_command_evaluates_predictions_on_the_recorded_track_only(dataset, tmp_path, call):
    path = written(tmp_path / "p.jsonl", line("one", 300), line("two", np.float64(500.0)))
    command = ("evaluate", dataset, "--predictions", path)
    code, out, _ = call(*command, "--method", "sd+argmax", "--out", tmp_path / "out")
    assert code == 0
    assert "my_net" in out
    code, _, err = call(*command, "--track", "closed_loop")
    assert code == 2
    assert "in the closed loop; allowed: --track recorded" in err


@pytest.mark.slow
def test_predictions_are_judged_where_the_evaluation_looks(dataset, tmp_path):
    """Regions that methods name do not matter, and the photon budget of a sequence is the same for all."""
    path = written(tmp_path / "p.jsonl", line("one", 300.0), line("two", 500.0))
    for methods in ([], ["sd+argmax", "sd+argmax@target"]):
        found = evaluate(dataset, methods=methods, predictions=path, region="frame")
        assert {r.who.region for r in found.records if r.who.method == "my_net"} == {"frame"}
        assert len(found.records) == 2 * (1 + len(methods))
        assert [sweep.sequence for sweep in found.sweeps] == ["one", "two"]
        assert len({(r.what.sequence, r.what.mean_rate) for r in found.records}) == 2
