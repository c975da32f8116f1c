"""A stopped evaluation resumes where it was, and reuses only results of the same evaluation."""

import dataclasses
import os
import shutil
import time

import numpy as np
import pytest
from handmade_records import BLANK, change
from planted_sweeps import write_three_sweeps

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


class Evaluated(list[str]):
    """The names of the evaluated sequences, in order; progress that interrupts the evaluation after some of them."""

    def __init__(self, stop_after: int = 99) -> None:
        super().__init__()
        self.stop_after = stop_after

    def __call__(self, done: int, total: int, what: str) -> None:
        self.extend(name for name in ("one", "two", "three") if what == name)
        if len(self) == self.stop_after:
            raise KeyboardInterrupt


def without_times(value):
    """Return a result as plain values, with arrays as bytes and without computing times."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if dataclasses.is_dataclass(value):
        names = {f.name for f in dataclasses.fields(value)} - {"seconds", "reference_rate"}
        return {name: without_times(getattr(value, name)) for name in names}
    return [without_times(one) for one in value] if isinstance(value, tuple) else repr(value)


def stop_after(count, dataset, **options):
    with pytest.raises(KeyboardInterrupt):
        evaluate(dataset, methods=METHODS, progress=Evaluated(count), **options)


@pytest.mark.slow
def test_a_stopped_evaluation_goes_on_and_gives_what_an_unbroken_one_gives(dataset, tmp_path):
    """An interrupt also saves results that were not due to be written yet."""
    unbroken = evaluate(dataset, methods=METHODS)
    stop_after(2, dataset, keep=KeptSequences(tmp_path / "kept"))
    steps, kept, evaluated = [], KeptSequences(tmp_path / "kept"), Evaluated()

    def note(*step):
        steps.append(step)
        evaluated(*step)

    again = evaluate(dataset, methods=METHODS, keep=kept, progress=note)
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


@pytest.mark.slow
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
    dataset, tmp_path, change, options, evaluated_again
):
    """If one of two files is damaged, the other is still used; each stopped run leaves one."""
    copy, kept, evaluated = tmp_path / "data", tmp_path / "kept", Evaluated()
    shutil.copytree(dataset, copy)
    for _ in range(2):
        stop_after(1, copy, keep=KeptSequences(kept))
    assert len(list(kept.iterdir())) == 2
    if change is not None:
        change(copy, kept)
    evaluate(copy, **{"methods": METHODS, "keep": KeptSequences(kept), "progress": evaluated} | options)
    if change is damage:
        assert len(evaluated) == 2
        assert set(evaluated) < {*evaluated_again, "three"}
    else:
        assert set(evaluated) == {*evaluated_again, "three"}


@pytest.mark.slow
def test_results_are_kept_in_the_users_cache_folder_and_nothing_is_kept_without_one(dataset, tmp_path, monkeypatch):
    """Results beside the evaluation might have come with other people's data."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = kept_folder(tmp_path / "out")
    assert folder != kept_folder(tmp_path / "other")
    assert folder.is_relative_to(tmp_path / "cache" / "saf_gen")
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert kept_folder(tmp_path / "out") is None
    stop_after(2, dataset, keep=KeptSequences(None))
    evaluated = Evaluated()
    evaluate(dataset, methods=METHODS, keep=KeptSequences(None), progress=evaluated)
    assert evaluated == ["one", "two", "three"]


def test_the_secret_is_the_users_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert sign_as_user(b"data") == sign_as_user(b"data") != sign_as_user(b"other")
    assert (tmp_path / "saf_gen" / "secret").stat().st_mode & 0o777 == 0o600


class Presses:
    """How often a measure was called, and the call in which somebody presses Ctrl-C."""

    calls, at = 0, 0


def stops(counts: np.ndarray) -> float:
    Presses.calls += 1
    if Presses.calls == Presses.at:
        raise KeyboardInterrupt
    return float(counts.max())


@pytest.mark.slow
def test_the_command_reports_kept_results_and_leaves_no_files(dataset, tmp_path, register, call):
    register("measures", "stops", stops)
    options = ("--method", "stops+argmax", "--try", "search.window=100,200", "--out", tmp_path / "out" / "found.json")
    assert call("tune", dataset, *options)[0] == 0
    (tmp_path / "out" / "found.json").unlink()
    Presses.at, Presses.calls = Presses.calls * 3 // 4, 0  # in the last of the three sequences
    code, _, err = call("tune", dataset, *options)
    assert (code, err) == (130, "saf-gen: stopped; finished work is kept: run the same command again to continue\n")
    Presses.at = 0
    code, _, err = call("tune", dataset, *options)
    assert (code, err) == (0, "2 sequences had been evaluated by a run that was stopped\n")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["found.json"]
    assert call("tune", dataset, *options)[2] == ""


def test_a_closed_loop_is_kept_until_its_stacks_change(tmp_path):
    path = LensPath("m", "s", None, "board", None, np.arange(3.0), np.array([0.1, 0.5, np.nan]), np.zeros(3), None, "")
    result = Evaluation((change(BLANK, trace=(1.0, float("nan"))),), (), (), (path,))
    task = SequenceTask("s", None, "board", None, tmp_path / "s.h5", "c0ffee")
    (tmp_path / "stacks" / "board-1").mkdir(parents=True)
    terms = {"predictions": None, "stacks": tmp_path / "stacks"}

    def begun(budget_s=None):
        protocol = ClosedLoopProtocol(get_actuator("voice_coil"), budget_s)
        return KeptSequences(tmp_path / "kept").begin({}, protocol=protocol, **terms)

    kept = begun()
    kept.keep(task, result, draw="sweep")
    kept.write()
    assert without_times(begun().reuse(task, draw="sweep")) == without_times(result)
    assert begun().reuse(task, draw="pictures") is None
    assert begun(0.1).reuse(task, draw="sweep") is None
    os.utime(tmp_path / "stacks" / "board-1", (1, 1))
    assert begun().reuse(task, draw="sweep") is None


def test_results_are_written_every_few_seconds_in_case_the_process_is_killed(tmp_path, monkeypatch):
    now, folder = time.monotonic(), tmp_path / "kept"
    kept = KeptSequences(folder).begin({}, protocol=None, predictions=None, stacks=tmp_path)
    for seconds, files in ((1, 0), (4, 0), (6, 1), (9, 1), (12, 2)):
        monkeypatch.setattr("time.monotonic", lambda seconds=seconds: now + seconds)
        task = SequenceTask(f"s{seconds}", None, "board", None, tmp_path / "s.h5", "c0ffee")
        kept.keep(task, Evaluation((BLANK,), (), ()), draw="")
        assert len(list(folder.glob("*.npz"))) == files
