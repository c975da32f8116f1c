"""The folder of an evaluation: a later evaluation replaces all of it, and files of others stay."""

import os
import shutil
import sys
from collections import Counter
from functools import partial
from pathlib import Path

import pytest
from handmade_evaluations import make_evaluation, make_sweep
from handmade_records import record
from refusals import refusal

from saf_gen.benchmark.records import read_records
from saf_gen.benchmark.results import Evaluation
from saf_gen.benchmark.sequence_evaluation import assess_curves
from saf_gen.leaderboard import Leaderboard, board, ranking, results, tables
from saf_gen.leaderboard.report import charts, evaluation_folder, page, write_evaluation

pytestmark = pytest.mark.slow

TABLES = {
    "axes.csv",
    "index.html",
    "leaderboard.csv",
    "leaderboard.json",
    "leaderboard.md",
    "leaderboard.tex",
    "neighbours.csv",
    "profiles.csv",
    "records.jsonl",
}
CURVES = {"curves.csv", "measures.csv"}


def with_curves():
    records = tuple(record(m, "camel-constant", 0.1) for m in ("sd+argmax", "er_count+argmax"))
    sweep = make_sweep(measures=("sd",))
    return Evaluation(records, (sweep,), (), curves=tuple(assess_curves([sweep])))


def of_one_method(scene="camel"):
    return Evaluation((record("sd+egs_code", f"{scene}-constant", 0.1, scene=scene),), (), ())


def write(folder, made, **options):
    return write_evaluation(folder, Leaderboard.of(made), title="small", **options)


def held(folder):
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}


COMPUTING = (
    *(ranking.rank, ranking.method_intervals, ranking.collect_outcomes, ranking.compare_methods),
    *(
        results.by_axis,
        results.keep_largest,
        results.notes_on,
        results.warnings_on,
        results.grain_by_scene,
        results.spell_out_names,
    ),
    *(tables.ranking, tables.by_bin, tables.bin_lines, tables.neighbours, tables.profile_lines, tables.curves),
    *(tables.measures, tables.rank_measures, results.describe_records, charts.make_charts, page.build_page),
)


def test_everything_is_computed_once_on_the_way_from_records_to_files_and_page(tmp_path):
    """Also if names have control characters, which every writer escapes itself."""
    names = {function.__code__: function.__name__ for function in COMPUTING}
    for made in (with_curves(), of_one_method("ca\x1bmel")):
        calls = Counter()
        sys.setprofile(lambda frame, event, _, calls=calls: calls.update([frame.f_code] * (event == "call")))
        try:
            write(tmp_path / "out", made)
        finally:
            sys.setprofile(None)
        several = {name: calls[code] for code, name in names.items() if calls[code] != 1}
        without = {"keep_largest", "by_bin"} | (set() if made.curves else {"curves", "measures", "rank_measures"})
        assert several == dict.fromkeys(without, 0), "conditions along which sequences differ, and curves"
        assert "\x1b" not in (tmp_path / "out/index.html").read_text()


def test_each_selection_of_sequences_is_ranked_once(tmp_path, monkeypatch):
    rank, ranked = ranking.rank, []
    for module in (ranking, board):
        monkeypatch.setattr(module, "rank", lambda by_method, found: ranked.append(found) or rank(by_method, found))
    write(tmp_path, make_evaluation())
    sequences = [tuple(record.what.sequence for record in found.sequences) for found in ranked]
    assert len(sequences) == len(set(sequences)) > 10


def test_a_later_evaluation_replaces_the_earlier_one_and_leaves_no_curve_of_it(tmp_path):
    written = write(tmp_path, with_curves())
    assert held(tmp_path) == TABLES | CURVES
    assert {path.name for path in written.page.parent.iterdir()} == TABLES | CURVES
    assert written.replaced == ""
    foreign = {"notes.txt", "figures/mine.svg"}
    (tmp_path / "figures").mkdir()
    for name in foreign:
        (tmp_path / name).write_text("not ours")
    written = write(tmp_path, of_one_method("fan"))
    assert written.replaced == "replaced the earlier evaluation of 2 methods"
    assert held(tmp_path) == TABLES | foreign
    assert {r.who.method for r in read_records(tmp_path)} == {"sd+egs_code"}


def test_an_evaluation_that_cannot_be_read_is_replaced_with_a_notice(tmp_path):
    write(tmp_path, with_curves())
    (tmp_path / "records.jsonl").write_text('{"half": ')
    assert write(tmp_path, of_one_method()).replaced == "replaced an earlier evaluation that cannot be read"
    assert held(tmp_path) == TABLES


def test_curves_that_somebody_else_made_stay(tmp_path):
    (tmp_path / "curves.csv").write_text("t,y\n0,1\n")
    assert write(tmp_path, of_one_method()).replaced == ""
    assert held(tmp_path) == TABLES | {"curves.csv"}


class Killed(BaseException):
    """Ends a run as SIGKILL does: nothing catches it."""


def killed_at(step, monkeypatch, action):
    """Run an action and kill it just before its step-th change of the disk; return whether it was killed."""
    left = [step]

    def dying(change):
        def run(*args, **options):
            if not left[0]:
                raise Killed
            left[0] -= 1
            return change(*args, **options)

        return run

    with monkeypatch.context() as patch:
        for name in ("mkdir", "rename", "replace", "unlink", "rmdir"):
            patch.setattr(Path, name, dying(getattr(Path, name)))
        for name in ("unlink", "rmdir", "fsync"):  # used to remove a folder and to write a file
            patch.setattr(os, name, dying(getattr(os, name)))
        try:
            action()
        except Killed:
            return True
    return False


def test_a_killed_run_leaves_the_earlier_evaluation_or_the_complete_new_one(tmp_path, monkeypatch):
    """It is killed at each change of the disk, and again while the next run completes the rest."""
    write(tmp_path / "old", with_curves())
    (tmp_path / "old/notes.txt").write_text("not ours")
    write(tmp_path / "new", of_one_method("fan"))
    methods = {"old": {"sd+argmax", "er_count+argmax"}, "new": {"sd+egs_code"}}
    complete = {name: held(tmp_path / name) | {"notes.txt"} for name in methods}
    seen, step, going_on = set(), 0, True
    while going_on:
        for again in (0, 2, 5):
            final = tmp_path / f"{step}-{again}"
            shutil.copytree(tmp_path / "old", final)
            part = shutil.copytree(tmp_path / "new", final / ".evaluation.0badcafe.host.1.part")
            going_on = killed_at(
                step, monkeypatch, lambda part=part, final=final: evaluation_folder._publish(part, final)
            )
            which = {frozenset(r.who.method for r in read_records(final))}
            assert which <= set(map(frozenset, methods.values()))
            killed_at(again, monkeypatch, partial(evaluation_folder._finish_publishing, final))
            evaluation_folder._finish_publishing(final)
            (found,) = (name for name in methods if {frozenset(methods[name])} == which)
            assert {r.who.method for r in read_records(final)} == methods[found]
            assert {name for name in held(final) if ".evaluation." not in name} == complete[found]
            seen.add(found)
        step += 1
    assert seen == {"old", "new"}
    assert step > len(TABLES)


def test_a_failure_before_all_is_written_leaves_the_earlier_evaluation_unchanged(tmp_path, monkeypatch):
    write(tmp_path, with_curves())
    before = {name: (tmp_path / name).read_bytes() for name in held(tmp_path)}

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluation_folder, "make_charts", stopped)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path, of_one_method("fan"))
    assert {name: (tmp_path / name).read_bytes() for name in held(tmp_path)} == before


def test_a_file_at_the_path_of_the_folder_is_refused(tmp_path):
    (tmp_path / "notes").write_text("a file")
    error = refusal(write, tmp_path / "notes", with_curves())
    assert (error.problem, error.hint) == (f"{tmp_path}/notes cannot be written: File exists", "choose another folder")
