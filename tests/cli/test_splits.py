"""Which splits of a dataset are ranked: by default, by name, all together, and again in the folder of an evaluation."""

import json
import os
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from planted_sweeps import list_streams
from refusals import refusal

from saf_gen.benchmark import evaluate as evaluate_module
from saf_gen.benchmark import kept_sequences
from saf_gen.benchmark.records import read_records
from saf_gen.cli._terminal import out
from saf_gen.leaderboard import read_leaderboard
from saf_gen.stream.manifest import read_manifest, write_manifest
from saf_gen.stream.stream_writer import write_stream

METHOD = ("--method", "sd+argmax:window=20")
LEFT_OUT = "(--split all ranks all)"


def write_tiny(path):
    """Write a stream of 60 frames without truth."""
    lens = np.linspace(0, 1, 60, dtype=np.float32)
    spikes = np.random.default_rng(len(path.stem)).random((60, 8, 8)) < 0.3
    write_stream(path, spikes.astype(np.uint8), focus_position=lens)


@pytest.fixture
def make(tmp_path):
    """A function that writes a dataset with as many sequences of each split as given, each of a scene of its own."""

    def write(**splits):
        names = [(split, f"{split}-{n}") for split, count in splits.items() for n in range(count)]
        for split, name in names:
            write_tiny(tmp_path / "data" / split / f"{name}.h5")
        return list_streams(
            tmp_path / "data", *({"id": name, "split": split, "scene": name, "seed": 1} for split, name in names)
        )

    return write


TWO, THREE = {"train": 2, "test": 1}, {"train": 2, "validation": 2, "test": 1}
NONE, ALL = {"train": 2, "validation": 1}, {"all": 1, "train": 1}
NO_DEFAULT = (
    "data: the dataset has the splits train, validation, and none is called test; allowed: one of them, or all to rank "
    "them together; run saf-gen evaluate {data} --split validation"
)
AMBIGUOUS = "data: 'all' could mean all splits, or the split of this name; allowed: train; rename this split"


@pytest.mark.parametrize(
    ("splits", "options", "ranked", "line"),
    [
        ({"train": 2}, "", {"train"}, "split train: 2 sequences of 2 scenes"),
        (THREE, "", {"test"}, f"split test: 1 sequence of 1 scene; left out: 2 of train, 2 of validation {LEFT_OUT}"),
        (NONE, "", None, NO_DEFAULT),
        (TWO, "--split train", {"train"}, f"split train: 2 sequences of 2 scenes; left out: 1 of test {LEFT_OUT}"),
        (TWO, "--split all", {"train", "test"}, "splits train and test: 3 sequences of 3 scenes"),
        (
            TWO,
            "--scene-motion static",
            {"test"},
            f"split test, static: 1 sequence of 1 scene; left out: 2 of train {LEFT_OUT}",
        ),
        ({"all": 2}, "--split all", {"all"}, "split all: 2 sequences of 2 scenes"),
        (ALL, "", None, "none is called test; allowed: one of them, or all to rank them together; run saf-gen"),
        (ALL, "--split train", {"train"}, "split train: 1 sequence of 1 scene; left out: 1 of all"),
        (ALL, "--split all", None, AMBIGUOUS),
        ({"test": 1, "all": 1}, "", {"test"}, "split test: 1 sequence of 1 scene; left out: 1 of all"),
        (TWO, "--split al", None, "unknown split 'al'; allowed: all, test, train; did you mean 'all'?"),
        (TWO, "--split=test --split test", None, "--split is given 2 times; allowed: once"),
        (TWO, "--scene-motion dynamic", None, "unknown scene motion 'dynamic'; allowed: static"),
    ],
)
def test_what_is_ranked_is_the_first_line(call, make, tmp_path, splits, options, ranked, line):
    code, out, err = call("evaluate", make(**splits), *options.split(), *METHOD, "--out", tmp_path / "out")
    if ranked is None:
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert line.format(data=tmp_path / "data") in err
        assert not (tmp_path / "out").exists()
    else:
        assert (code, err) == (0, "")
        assert out.splitlines()[0] == line
        assert {r.what.split for r in read_records(tmp_path / "out")} == ranked


@pytest.mark.parametrize(
    ("files", "split", "following", "ranked"),
    [
        (["a.h5", "b.h5"], "mine", "", {"mine"}),
        (["a.h5", "monday/b.h5"], "test", "", {"test"}),
        (["monday/a.h5"], "test", "", {"monday"}),
        (["monday/a.h5", "my day/b.h5"], "test", " --split 'my day'", None),
    ],
)
def test_a_folder_of_streams_is_ranked_by_the_same_rules(call, tmp_path, files, split, following, ranked):
    for name in files:
        write_tiny(tmp_path / "own" / name)
    code, out, _ = call("dataset", "index", tmp_path / "own", "--split", split)
    assert code == 0
    assert out.splitlines()[0].endswith(f"next: saf-gen evaluate {tmp_path / 'own'}{following}")
    code, out, _ = call("evaluate", tmp_path / "own", *METHOD)
    assert code == (0 if ranked else 2)
    assert ranked is None or {r.what.split for r in read_records(tmp_path / "own/evaluation")} == ranked


def test_what_is_planned_and_not_made_is_on_the_first_line(call, make, tmp_path):
    folder = make(train=1, test=1)
    write_manifest(folder, replace(read_manifest(folder), planned={"train": 9, "test": 3}))
    code, out, _ = call("evaluate", folder, *METHOD, "--out", tmp_path / "out")
    assert code == 0
    assert out.splitlines()[0].endswith("; 2 more are planned and not made yet (the command that made these goes on)")
    document = json.loads((folder / "manifest.json").read_text())
    del document["checksum"]
    for count in (-1, 1e3, 10**40):
        document["planned"]["test"] = count
        (folder / "manifest.json").write_text(json.dumps(document))
        code, _, err = call("evaluate", folder, *METHOD, "--out", tmp_path / "other")
        assert (code, err.count("\n")) == (2, 1)
        assert "planned.test is" in err


def test_a_single_stream_belongs_to_no_split(call, tmp_path):
    write_tiny(tmp_path / "a.h5")
    for options in ((), ("--split", "all")):
        code, out, err = call("evaluate", tmp_path / "a.h5", *METHOD, *options)
        assert (code, err) == (0, "")
        assert "split" not in out
    code, _, err = call("evaluate", tmp_path / "a.h5", *METHOD, "--split", "test")
    assert (code, "split 'test' cannot be selected from the single stream" in err) == (2, True)


def test_a_next_command_names_a_split_only_if_there_is_no_default(make):
    assert read_manifest(make(**TWO)).next_command("d") == "saf-gen evaluate d"
    assert read_manifest(make(**NONE)).next_command("d") == "saf-gen evaluate d --split validation"
    assert read_manifest(make(train=1, all=1)).next_command("d") == "saf-gen evaluate d --split train"


@pytest.mark.parametrize("option", ["--out", "--region", "--track", "--methods"])
def test_no_option_with_one_value_is_taken_twice(call, tmp_path, option):
    code, out, err = call("evaluate", tmp_path, option, "a", option, "b")
    assert (code, out, err) == (2, "", f"saf-gen: {option} is given 2 times; allowed: once\n")


def test_an_evaluation_is_written_although_the_pipe_is_closed_already(call, make, tmp_path, monkeypatch):
    reading, writing = os.pipe()
    os.close(reading)
    monkeypatch.setattr(out, "quiet", False)  # rich sets it when the pipe breaks
    with os.fdopen(writing, "w") as closed:
        monkeypatch.setattr(sys, "stdout", closed)
        code, _, err = call("evaluate", make(**TWO), *METHOD, "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    assert len(read_records(tmp_path / "out")) == 1


# Evaluations of other splits


@pytest.mark.slow
def test_an_evaluation_that_replaces_one_of_other_splits_reports_them(call, make, tmp_path):
    command = ("evaluate", make(**TWO), *METHOD, "--out", tmp_path / "out")
    assert call(*command, "--split", "all")[0] == 0
    last = call(*command)[1].splitlines()[-2]
    assert last == "replaced the earlier evaluation of 1 method on test and train"
    assert {r.what.split for r in read_records(tmp_path / "out")} == {"test"}
    assert call(*command)[1].splitlines()[-2] == "replaced the earlier evaluation of 1 method"


def test_a_stopped_evaluation_of_all_splits_goes_on_with_one(call, make, tmp_path, monkeypatch):
    monkeypatch.setattr(kept_sequences, "WRITE_INTERVAL_S", 0.0)
    command = ("evaluate", make(**TWO), *METHOD, "--out", tmp_path / "out")
    run = evaluate_module.evaluate_sequence

    def stops_at_test(task, *arguments, **options):
        if task.split == "test":
            raise KeyboardInterrupt
        return run(task, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(evaluate_module, "evaluate_sequence", stops_at_test)
        assert call(*command, "--split", "all")[0] == 130
    code, _, err = call(*command)
    assert code == 0
    assert err == "2 sequences of split train had been evaluated by a run that was stopped; not ranked now\n"
    assert {r.what.split for r in read_records(tmp_path / "out")} == {"test"}


@pytest.mark.slow
def test_evaluations_of_different_splits_do_not_share_a_table(call, make, tmp_path):
    folder = make(**TWO)
    for split in ("train", "test", "all"):
        assert call("evaluate", folder, *METHOD, "--out", tmp_path / split, "--split", split)[0] == 0
    for one, other in (("test", "train"), ("test", "all")):
        code, out, err = call("leaderboard", "merge", tmp_path / one, tmp_path / other)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert "the splits differ: " in err
        assert f"test in {tmp_path}" in err
        assert "allowed: the same splits in all evaluations; run saf-gen evaluate again, with --split" in err
    assert refusal(read_leaderboard, tmp_path / "test", tmp_path / "train").problem.startswith("the splits differ")
    assert "1 evaluation, split test" in call("leaderboard", "merge", tmp_path / "test")[1]
    assert "1 evaluation, splits train and test" in " ".join(call("leaderboard", "merge", tmp_path / "all")[1].split())


@pytest.mark.slow
@pytest.mark.parametrize(("splits", "split"), [(THREE, "validation"), (NONE, "all"), ({"all": 2}, "all")])
def test_rows_are_run_again_on_the_splits_that_they_rank(call, make, tmp_path, splits, split):
    folder = make(**splits)
    assert call("evaluate", folder, *METHOD, "--split", split)[0] == 0
    code, out, err = call("leaderboard", "verify", folder / "evaluation")
    assert (code, err) == (0, "")
    assert "re-run here" in out


def test_predictions_for_a_split_that_is_not_ranked_are_refused(call, make, tmp_path):
    folder, path = make(**TWO), tmp_path / "p.jsonl"
    lines = [
        json.dumps({"method": "net", "sequence": entry.id, "frame": 3.0}) for entry in read_manifest(folder).sequences
    ]
    path.write_text("\n".join(lines))
    code, _, err = call("evaluate", folder, "--predictions", path)
    assert (code, err.count("\n")) == (2, 1)
    assert "an answer on train-0, but its split 'train' is not evaluated; allowed: answers on test" in err
    assert call("evaluate", folder, "--predictions", path, "--split", "all")[0] == 0


@pytest.mark.parametrize(
    ("splits", "split", "message"),
    [
        (TWO, "all", "unknown split 'all'; allowed: train"),
        (TWO, "test", "constants cannot be tuned on the split 'test'"),
        ({"test": 1, "all": 1}, "all", "'all' could mean all splits"),
        ({"test": 1}, "train", "has no split to tune on; allowed: a dataset with another split than test"),
        ({"validation": 1}, "train", "unknown split 'train'; allowed: validation"),
    ],
)
def test_no_split_is_tuned_on_with_the_test(call, make, tmp_path, splits, split, message):
    options = (*METHOD, "--try", "search.window=10,20", "--out", tmp_path / "t.json", "--split", split)
    code, out, err = call("tune", make(**splits), *options)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err


@pytest.mark.slow
def test_what_is_tuned_is_evaluated_next_on_a_split_that_can_be(call, make, tmp_path):
    folder, file = make(**NONE), tmp_path / "t.json"
    code, out, _ = call("tune", folder, *METHOD, "--try", "search.window=10,20", "--out", file)
    assert code == 0
    assert "best: sd+argmax:window=" in out
    assert file.is_file()
    assert out.splitlines()[-1] == f"{file}   (next: saf-gen evaluate {folder} --split validation --method @{file})"


@pytest.mark.slow
def test_a_log_has_the_split_and_a_line_for_each_sequence_that_ended(call, make):
    """stderr is no terminal here; the lines name each sequence once, with the part of the work that is done."""
    folder = make(train=1, test=3)
    code, said, log = call("evaluate", folder, *METHOD, "--method", "sd+argmax:window=30", progress=True)
    assert code == 0
    assert said.startswith("split test: 3 sequences of 3 scenes; left out: 1 of train")
    assert re.findall(r"^evaluate .*", log, re.MULTILINE) == [
        f"evaluate {percent}%: test-{number}" for number, percent in enumerate((33, 67, 100))
    ]
