"""Answers made elsewhere: read strictly, judged like those of our own methods."""

import json
from dataclasses import replace

import numpy as np
import pytest
from planted_sweeps import write_sweep

from saf_gen.benchmark import evaluate as evaluate_module
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import format_records, read_records
from saf_gen.benchmark.tracks.predictions import read_predictions
from saf_gen.benchmark.tracks.sequence_tasks import list_sequence_tasks
from saf_gen.cli import main
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import Manifest, SequenceEntry, write_manifest


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    (folder / "test").mkdir()
    usual = {
        "split": "test",
        "scene": "board",
        "variant": 0,
        "scene_motion": "static",
        "lens_motion": "sweep",
    }
    usual |= {"repeat": 0, "seed": 1, "frames": 800, "fingerprint": "f"}
    entries = tuple(
        SequenceEntry(
            id=name, light=name, file=f"test/{name}.h5",
            content_sha256=write_sweep(folder / "test" / f"{name}.h5", peak), **usual,
        )
        for name, peak in (("one", 300.0), ("two", 500.0))
    )  # fmt: skip
    write_manifest(folder, Manifest("small", "r", "scalar_rgb", entries))
    return folder


def written(path, *lines):
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def line(sequence, frame, **more):
    return {"method": "my_net", "sequence": sequence, "frame": frame, **more}


def test_predictions_are_judged_like_the_answers_of_methods(dataset, tmp_path):
    ours = evaluate(dataset, methods=["sd+argmax"]).records
    path = written(
        tmp_path / "p.jsonl",
        *(line(r.sequence, r.frame, trace=list(r.trace), seconds=0.25, note="by hand") for r in ours),
    )
    records = evaluate(dataset, methods=["sd+argmax"], predictions=path).records
    theirs = [r for r in records if r.method == "my_net"]
    assert [r.sequence for r in theirs] == ["one", "two"]
    for mine, other in zip(ours, theirs, strict=True):
        for key in (
            "frame",
            "position",
            "error",
            "error_dof",
            "success_1dof",
            "truth",
            "trace",
            "lens_travel",
        ):
            assert getattr(mine, key) == getattr(other, key)
        assert (other.seconds, other.note, other.frames_seen) == (0.25, "by hand", 800)
    assert len({r.code for r in theirs}) == 1


def test_frames_seen_count_for_the_way_of_the_lens(dataset, tmp_path):
    path = written(
        tmp_path / "p.jsonl", line("one", 300, frames_seen=400), line("two", None, frames_seen=800)
    )
    one, two = evaluate(dataset, methods=[], predictions=path).records
    assert one.lens_travel == pytest.approx((399 + 99) / 799, abs=1e-3)
    assert (two.status, two.error) == ("abstained", None)


def test_an_answer_beyond_the_recording_is_a_failure(dataset, tmp_path):
    path = written(tmp_path / "p.jsonl", line("one", 900), line("two", 500))
    one, two = evaluate(dataset, methods=[], predictions=path).records
    assert (one.status, one.success_2dof) == ("failed", False)
    assert "answered frame 900.0" in one.note
    assert two.success_1dof


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([{"method": "a", "sequence": "one"}], r"p\.jsonl:1: frame is missing; allowed: .*8213\.5"),
        ([line("one", 3, frame_seen=5)], r"unknown key 'frame_seen'.*did you mean 'frames_seen'"),
        ([line("one", "early")], r"frame is 'early'; allowed: a valid number"),
        ([line("one", "12")], r"frame is '12'; allowed: a valid number"),
        ([line("one", False)], r"frame is False; allowed: a valid number"),
        ([line("one", [1])], r"frame is \[1\]; allowed: a valid number"),
        ([line("one", 10**400)], r"p\.jsonl:1: frame is 1000\d*\.\.\.0*; allowed"),
        (
            [line("one", 3, frames_seen=10**400)],
            r"p\.jsonl:1: frames_seen is 1000\d*\.\.\.0*, with|frames_seen",
        ),
        ([line("one", 3, frames_seen=True)], r"frames_seen is True; allowed: a valid integer"),
        ([line("one", 3, frames_seen="9")], r"frames_seen is '9'; allowed: a valid integer"),
        ([line("one", 3, frames_seen=9.0)], r"frames_seen is 9\.0; allowed: a valid integer"),
        ([line("one", 3, seconds=True)], r"seconds is True; allowed: a valid number"),
        ([line("one", 3, seconds=1e300)], r"seconds is 1e\+300; allowed: less than or equal to 1000000000"),
        ([line("one", 3, trace=[1, "2"])], r"trace is '2'; allowed: a valid number"),
        ([line("one", 3, note=5)], r"note is 5; allowed: a valid string"),
        (
            [line("one", 8213.5, frames_seen=1)],
            r"p\.jsonl:1: frame is 8213\.5, with frames_seen 1; allowed: up to 0\.5, the end of the last",
        ),
        ([line("one", 3, frames_seen=0)], r"frames_seen is 0; allowed: greater than or equal to 1"),
        ([line("one", 3) | {"method": "a b"}], r"method is 'a b'; allowed: match pattern"),
        ([line("one", 3), line("one", 4)], r"p\.jsonl:2: my_net answers one twice; allowed: once"),
        ([[1, 2]], r"is no JSON object"),
        ([], r"holds no prediction"),
    ],
)
def test_a_line_that_is_no_prediction_is_named(tmp_path, lines, message):
    with pytest.raises(BadInput, match=message):
        read_predictions(written(tmp_path / "p.jsonl", *lines))


@pytest.mark.parametrize("text", ["nan", "NaN", "Infinity"])
def test_a_frame_is_a_finite_number_or_null(tmp_path, text):
    path = tmp_path / "p.jsonl"
    path.write_text(f'{{"method": "a", "sequence": "one", "frame": {text}}}\n')
    with pytest.raises(BadInput, match=r"p\.jsonl:1"):
        read_predictions(path)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"method": ' + "[" * 100_000, '{"frame": ' + "9" * 5000 + "}"]
)
def test_what_json_cannot_be_read_from_is_told_in_one_line(tmp_path, text):
    path = tmp_path / "p.jsonl"
    path.write_text(text + "\n")
    with pytest.raises(BadInput, match=r"p\.jsonl:1: is no JSON object"):
        read_predictions(path)


def test_a_file_that_is_not_there_is_named_with_the_nearest(tmp_path):
    written(tmp_path / "mine.jsonl", line("one", 3))
    with pytest.raises(BadInput, match=r"cannot be read.*did you mean 'mine\.jsonl'"):
        read_predictions(tmp_path / "mime.jsonl")


@pytest.mark.parametrize(
    ("lines", "methods", "message"),
    [
        ([line("one", 3)], [], r"my_net does not answer two; allowed: a line for each of 2 sequences"),
        ([line("one", 3), line("too", 3)], [], r"unknown sequence 'too'.*did you mean 'two'"),
        ([line("one", 3) | {"method": "sd+argmax"}, line("two", 3) | {"method": "sd+argmax"}], ["sd+argmax"],
         r"the method 'sd\+argmax' is also one that runs here"),
    ],
)  # fmt: skip
def test_predictions_fit_the_sequences_that_are_evaluated(dataset, tmp_path, lines, methods, message):
    with pytest.raises(BadInput, match=message):
        evaluate(dataset, methods=methods, predictions=written(tmp_path / "p.jsonl", *lines))


def test_predictions_of_other_data_are_refused_before_anything_runs(dataset, tmp_path, capsys):
    path = written(tmp_path / "p.jsonl", line("one", 3), line("two", 3, data="0" * 64))
    steps, out = [], tmp_path / "out"
    message = (
        r"p\.jsonl, method my_net: two was made from other data: 000000000000; allowed: [0-9a-f]{12}; predict"
    )
    with pytest.raises(BadInput, match=message):
        evaluate(dataset, methods=["sd+argmax"], predictions=path, progress=lambda *step: steps.append(step))
    assert steps == []
    with pytest.raises(SystemExit) as ended:
        main(
            ["evaluate", str(dataset), "--predictions", str(path), "--method", "sd+argmax", "--out", str(out)]
        )
    assert ended.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()


def test_predictions_of_one_stream_are_held_to_the_stream_itself(dataset, tmp_path):
    stream = dataset / "test" / "one.h5"
    (ours,) = evaluate(stream, methods=["sd+argmax"]).records
    good = written(tmp_path / "good.jsonl", line("one", 300, data=ours.data, frames_seen=800))
    (record,) = evaluate(stream, methods=[], predictions=good).records
    assert (record.status, record.data) == ("answered", ours.data)
    steps = []
    for wrong, message in (
        ({"data": "f" * 64}, "other data: ffffffffffff"),
        ({"frames_seen": 801}, "is 801, and 800"),
    ):
        path = written(tmp_path / "wrong.jsonl", line("one", 300, **wrong))
        with pytest.raises(BadInput, match=message):
            evaluate(stream, methods=["sd+argmax"], predictions=path, progress=lambda *s: steps.append(s))
    assert steps == []


def test_no_more_can_be_seen_than_was_recorded(dataset, tmp_path):
    path = written(tmp_path / "p.jsonl", line("one", 300), line("two", None, frames_seen=801))
    with pytest.raises(
        BadInput, match="two: frames_seen is 801, and 800 frames were recorded; allowed: 1 to 800"
    ):
        evaluate(dataset, methods=[], predictions=path)


def test_where_the_manifest_says_another_length_that_prediction_alone_fails(dataset, tmp_path, monkeypatch):
    def longer(*args, **options):
        return [replace(task, frames=900) for task in list_sequence_tasks(*args, **options)]

    monkeypatch.setattr(evaluate_module, "list_sequence_tasks", longer)
    path = written(tmp_path / "p.jsonl", line("one", 300, frames_seen=850), line("two", 500, frames_seen=800))
    ran, one, other, two = evaluate(dataset, methods=["sd+argmax"], predictions=path).records
    assert (ran.status, other.status, two.status) == ("answered", "answered", "answered")
    assert (one.status, one.frames_seen, one.success_2dof) == ("failed", 800, False)
    assert one.note == "frames_seen is 850, and 800 frames were recorded"


@pytest.mark.parametrize("note", ["a\u2028b", "a\u0085b", "a\x1cb", "a\r\nb"])
def test_a_note_may_hold_what_ends_a_line_elsewhere(dataset, tmp_path, note):
    path = tmp_path / "p.jsonl"
    lines = [json.dumps(line(name, 300, note=note), ensure_ascii=False) for name in ("one", "two")]
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode())
    records = evaluate(dataset, methods=[], predictions=path).records
    assert [r.note for r in records] == [note, note]
    (tmp_path / "records.jsonl").write_bytes(format_records(records).encode())
    assert read_records(tmp_path) == list(records)


def test_the_command_line_takes_them(dataset, tmp_path, capsys):
    path = written(tmp_path / "p.jsonl", line("one", 300), line("two", np.float64(500.0)))
    out = str(tmp_path / "out")
    with pytest.raises(SystemExit) as ended:
        main(["evaluate", str(dataset), "--predictions", str(path), "--method", "sd+argmax", "--out", out])
    assert ended.value.code == 0
    assert "my_net" in capsys.readouterr().out
    with pytest.raises(SystemExit) as ended:
        main(["evaluate", str(dataset), "--predictions", str(path), "--track", "closed_loop"])
    assert ended.value.code == 2
    assert "in the closed loop; allowed: --track recorded" in capsys.readouterr().err


def test_predictions_are_judged_where_the_evaluation_looks(dataset, tmp_path):
    """Whatever the methods beside them name; the photon budget of a sequence is the same for all."""
    path = written(tmp_path / "p.jsonl", line("one", 300.0), line("two", 500.0))
    for methods in ([], ["sd+argmax@target"], ["sd+argmax", "sd+argmax@target"]):
        found = evaluate(dataset, methods=methods, predictions=path, region="frame")
        assert {r.region for r in found.records if r.method == "my_net"} == {"frame"}
        assert len(found.records) == 2 * (1 + len(methods))
        assert [sweep.sequence for sweep in found.sweeps] == ["one", "two"]
        assert len({(r.sequence, r.mean_rate) for r in found.records}) == 2
