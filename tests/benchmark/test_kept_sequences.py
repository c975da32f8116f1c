"""A stopped evaluation resumes where it was, and reuses only results of the same evaluation."""

import dataclasses
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest
from handmade_records import BLANK
from planted_sweeps import write_three_sweeps

from saf_gen.benchmark import evaluate as module
from saf_gen.benchmark import kept_sequences
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.kept_sequences import KeptSequences, kept_folder
from saf_gen.benchmark.results import Evaluation, LensPath
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.core.user_folder import sign_as_user
from saf_gen.optics.actuators import get_actuator

METHODS = ["sd+argmax", "er_count+argmax@frame"]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return write_three_sweeps(tmp_path_factory.mktemp("data"))


@pytest.fixture(autouse=True)
def _kept_at_once(monkeypatch):
    monkeypatch.setattr(kept_sequences, "WRITE_INTERVAL_S", 0.0)


@pytest.fixture
def evaluated(monkeypatch):
    """The names of the evaluated sequences, in order; the evaluation is interrupted after ``stop_after`` of them."""

    class Evaluated(list[str]):
        stop_after = 99

    names, run = Evaluated(), module.evaluate_sequence

    def counting(task, *arguments, **options):
        if len(names) == names.stop_after:
            raise KeyboardInterrupt
        names.append(task.id)
        return run(task, *arguments, **options)

    monkeypatch.setattr(module, "evaluate_sequence", counting)
    return names


def without_times(value):
    """Return a result as plain values, with arrays as bytes and without computing times."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if dataclasses.is_dataclass(value):
        names = {f.name for f in dataclasses.fields(value)} - {"seconds", "reference_rate"}
        return {name: without_times(getattr(value, name)) for name in names}
    return [without_times(one) for one in value] if isinstance(value, tuple) else repr(value)


def stop_after(count, evaluated, run, *arguments, **options):
    evaluated.stop_after = count
    with pytest.raises(KeyboardInterrupt):
        run(*arguments, **options)
    evaluated.stop_after = 99
    evaluated.clear()


def test_a_stopped_evaluation_goes_on_and_gives_what_an_unbroken_one_gives(dataset, tmp_path, evaluated, monkeypatch):
    """An interrupt also saves results that were not due to be written yet."""
    monkeypatch.setattr(kept_sequences, "WRITE_INTERVAL_S", 60.0)
    unbroken = evaluate(dataset, methods=METHODS)
    evaluated.clear()
    stop_after(2, evaluated, evaluate, dataset, methods=METHODS, keep=KeptSequences(tmp_path / "kept"))
    steps, kept = [], KeptSequences(tmp_path / "kept")
    again = evaluate(dataset, methods=METHODS, keep=kept, progress=lambda *step: steps.append(step))
    assert (evaluated, kept.reused) == (["three"], 2)
    assert without_times(again) == without_times(unbroken)
    assert again.sweeps[0].thumbnails is not None
    assert steps[:2] == [(2, 6, "one was already evaluated"), (4, 6, "two was already evaluated")]


def change_stream(dataset, _):
    os.utime(dataset / "train" / "one.h5", (1, 1))


def damage(_, kept):
    path = min(kept.iterdir())
    held = bytearray(path.read_bytes())
    held[40] ^= 1
    path.write_bytes(held)


@pytest.mark.parametrize(
    ("change", "options", "evaluated_again"),
    [
        (change_stream, {}, {"one"}),
        (damage, {}, {"one", "two"}),
        (None, {"methods": ["sd+argmax:window=50", METHODS[1]]}, {"one", "two"}),
        (None, {"region": "frame"}, {"one", "two"}),
    ],
)
def test_what_is_damaged_or_not_of_the_same_methods_and_files_is_evaluated_again(
    dataset, tmp_path, evaluated, change, options, evaluated_again
):
    """If one of two files is damaged, the other is still used."""
    copy, kept = tmp_path / "data", tmp_path / "kept"
    shutil.copytree(dataset, copy)
    stop_after(2, evaluated, evaluate, copy, methods=METHODS, keep=KeptSequences(kept))
    if change is not None:
        change(copy, kept)
    evaluate(copy, **{"methods": METHODS, "keep": KeptSequences(kept)} | options)
    if change is damage:
        assert len(evaluated) == 2
        assert set(evaluated) < {*evaluated_again, "three"}
    else:
        assert set(evaluated) == {*evaluated_again, "three"}


def test_results_are_kept_in_the_users_cache_folder_and_nothing_is_kept_without_one(
    dataset, tmp_path, evaluated, monkeypatch
):
    """Results beside the evaluation might have come with other people's data."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = kept_folder(tmp_path / "out")
    assert folder != kept_folder(tmp_path / "other")
    assert folder.is_relative_to(tmp_path / "cache" / "saf_gen")
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert kept_folder(tmp_path / "out") is None
    stop_after(2, evaluated, evaluate, dataset, methods=METHODS, keep=KeptSequences(None))
    evaluate(dataset, methods=METHODS, keep=KeptSequences(None))
    assert evaluated == ["one", "two", "three"]


def test_the_secret_is_the_users_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert sign_as_user(b"data") == sign_as_user(b"data") != sign_as_user(b"other")
    assert (tmp_path / "saf_gen" / "secret").stat().st_mode & 0o777 == 0o600


def test_the_command_reports_kept_results_and_leaves_no_files(dataset, tmp_path, evaluated, call):
    options = ("--method", "sd+argmax", "--try", "search.window=100,200", "--out", tmp_path / "out" / "found.json")
    evaluated.stop_after = 2
    code, _, err = call("tune", dataset, *options)
    assert (code, err) == (130, "saf-gen: stopped; finished work is kept: run the same command again to continue\n")
    evaluated.stop_after = 99
    code, _, err = call("tune", dataset, *options)
    assert (code, err) == (0, "2 sequences had been evaluated by a run that was stopped\n")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["found.json"]
    assert call("tune", dataset, *options)[2] == ""


def test_a_closed_loop_is_kept_until_its_stacks_change(tmp_path):
    path = LensPath("m", "s", None, "board", None, np.arange(3.0), np.array([0.1, 0.5, np.nan]), np.zeros(3), None, "")
    result = Evaluation((replace(BLANK, trace=(1.0, float("nan"))),), (), (), (path,))
    task = SequenceTask("s", None, "board", None, tmp_path / "s.h5", "c0ffee")
    (tmp_path / "stacks" / "board-1").mkdir(parents=True)
    terms = {"predictions": None, "stacks": tmp_path / "stacks"}

    def begun(budget_s=None):
        protocol = ClosedLoopProtocol(get_actuator("voice_coil"), budget_s)
        return KeptSequences(tmp_path / "kept").begin({}, protocol=protocol, **terms)

    begun().keep(task, result, draw="sweep")
    assert without_times(begun().reuse(task, draw="sweep")) == without_times(result)
    assert begun().reuse(task, draw="pictures") is None
    assert begun(0.1).reuse(task, draw="sweep") is None
    os.utime(tmp_path / "stacks" / "board-1", (1, 1))
    assert begun().reuse(task, draw="sweep") is None
