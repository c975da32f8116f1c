"""Answers made elsewhere: read strictly, judged like those of our own methods."""

import json

import numpy as np
import pytest
from sweeps import write_sweep

from saf_gen.cli import main
from saf_gen.contest.predictions import read_predictions
from saf_gen.dataset import Manifest, SequenceEntry, write_manifest
from saf_gen.errors import BadInput
from saf_gen.evaluate import evaluate


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


def test_predictions_of_other_data_fail_by_name(dataset, tmp_path):
    path = written(tmp_path / "p.jsonl", line("one", 3, data="0" * 64), line("two", 3))
    result = evaluate(dataset, methods=[], predictions=path)
    assert [f.sequence for f in result.failures] == ["one"]
    assert "was made from other data: 000000000000" in result.failures[0].problem


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
