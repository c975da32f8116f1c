"""Rows of a leaderboard that are verified by running the method again."""

import json
import shutil
import socket
from contextlib import suppress
from dataclasses import fields
from pathlib import Path

import pytest
from handmade_records import change
from planted_sweeps import list_streams, write_sweep
from refusals import refusal

from saf_gen.benchmark.method_spec import TunedMethod, format_tuned
from saf_gen.benchmark.records import PARTS, RECORDS_FILE, read_records, record_to_json, write_records
from saf_gen.cli import main
from saf_gen.core.config.json_document import format_checked_json
from saf_gen.errors import BadInput
from saf_gen.leaderboard import read_leaderboard
from saf_gen.leaderboard.rerun import verify
from saf_gen.leaderboard.verification import TIME_AND_MACHINE

MEASURE = """
from dataclasses import dataclass
import numpy as np

@dataclass(frozen=True)
class Spread:
    power: float = 2.0

    def __call__(self, counts):
        return float(np.mean(np.abs(counts - counts.mean()) ** self.power))
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Two sweeps of 800 frames, in focus at frames 300 and 500."""
    folder = tmp_path_factory.mktemp("data")
    write_sweep(folder / "test/board.h5", 300.0)
    write_sweep(folder / "test/leaf.h5", 500.0)
    return list_streams(folder, *({"id": scene, "scene": scene} for scene in ("board", "leaf")))


@pytest.fixture(scope="module")
def evaluated(dataset, tmp_path_factory):
    """An evaluation of two registered methods, one of a file that has since moved, and answers made elsewhere."""
    home = tmp_path_factory.mktemp("evaluated")
    (home / "theirs").mkdir()
    (home / "theirs/mine.py").write_text(MEASURE)
    answers = [json.dumps({"method": "a_net", "sequence": name, "frame": 310.0}) for name in ("board", "leaf")]
    (home / "answers.jsonl").write_text("\n".join(answers))
    mine, folder = f"{home / 'theirs/mine.py'}:Spread+argmax", home / "evaluation"
    methods = [word for method in ("sd+argmax", "er_count+argmax@frame", mine) for word in ("--method", method)]
    with pytest.raises(SystemExit) as ended:
        main(["evaluate", *map(str, (dataset, *methods, "--predictions", home / "answers.jsonl", "--out", folder))])
    assert ended.value.code == 0
    (home / "theirs/mine.py").rename(home / "mine.py")
    return folder


@pytest.fixture
def evaluation(evaluated, tmp_path):
    """A copy that a test may forge, next to the method's file."""
    shutil.copy(evaluated.parent / "mine.py", tmp_path)
    return shutil.copytree(evaluated, tmp_path / "evaluation")


def forge(folder, row="", **changes):
    """Change the records of a row, or of all rows, on ``leaf``, with what follows from them and their checksums."""
    records = read_records(folder)
    chosen = [row in ("", r.who.method) and r.what.sequence == "leaf" for r in records]
    forged = [change(r, **changes) if is_chosen else r for r, is_chosen in zip(records, chosen, strict=True)]
    write_records(folder / RECORDS_FILE, forged)


def lines_of(folder):
    return [record_to_json(record) for record in read_records(folder)]


def write_lines(folder, lines):
    (folder / RECORDS_FILE).write_text("".join(format_checked_json(line) + "\n" for line in lines))


def states(folder):
    return {Path(row.method).name: row.verified for row in read_leaderboard(folder)}


@pytest.mark.slow
def test_rows_of_registered_methods_are_found_again_and_others_are_claimed(call, evaluation, dataset):
    assert set(states(evaluation).values()) == {None}
    code, out, err = call("leaderboard", "verify", evaluation, "--on", dataset, "--json")
    assert (code, err) == (0, "")
    rows = {Path(row["method"]).name: row for row in json.loads(out)}
    assert {name: row["row"] for name, row in rows.items()} == {
        "sd+argmax": "re-run here",
        "er_count+argmax@frame": "re-run here",
        "mine.py:Spread+argmax": "claimed",
        "a_net": "claimed",
    }
    assert "no method on this machine can reproduce this row: " in rows["a_net"]["why"]
    assert states(evaluation) == {name: row["row"] for name, row in rows.items()}
    assert "re-run here" in call("leaderboard", "merge", evaluation)[1]


@pytest.mark.slow
def test_a_method_of_a_file_runs_only_where_the_command_names_it(call, evaluation, dataset, tmp_path):
    mine = tmp_path / "mine.py"
    command = ("leaderboard", "verify", evaluation, "--on", dataset)
    code, out, _ = call(*command)
    assert code == 0
    assert "re-run here: this code, with the digest in the records, gave these answers again" in out
    assert "not proved: that it had never seen the answers" in out
    assert states(evaluation)["mine.py:Spread+argmax"] == "claimed"
    assert call(*command, "--method", f"{mine}:Spread+argmax")[0] == 0
    assert states(evaluation)["mine.py:Spread+argmax"] == "re-run here"
    (other := tmp_path / "other.py").write_text(MEASURE.replace("2.0", "4.0"))
    code, _, err = call(*command, "--method", f"{other}:Spread+argmax")
    assert (code, err.count("\n")) == (2, 1)
    assert "was made by the code of" in err


@pytest.mark.slow
def test_a_row_that_a_limit_ended_cannot_be_compared(call, evaluation, dataset):
    ended = dict.fromkeys(("frame", "position", "time_to_focus_s"))
    note = "over a limit: it did not answer within 60 s"
    forge(evaluation, "sd+argmax", status="failed", note=note, limits="60 s", **ended)
    code, out, _ = call("leaderboard", "verify", evaluation, "--on", dataset, "--json")
    (row,) = (row for row in json.loads(out) if row["method"] == "sd+argmax")
    assert (code, row["row"]) == (0, "claimed")
    assert row["why"] == "not comparable: 1 of 2 runs ended at a limit (60 s)"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frame": 444.0, "position": 0.5555}, "leaf: position is 0.5555, but"),
        ({"frames_seen": 17}, "leaf: frames_seen is 17, but"),
    ],
)
def test_a_forged_answer_is_found(call, evaluation, dataset, changes, message):
    forge(evaluation, "sd+argmax", **changes)
    code, out, _ = call("leaderboard", "verify", evaluation, "--on", dataset, "--json")
    assert code == 1
    (row,) = (row for row in json.loads(out) if row["method"] == "sd+argmax")
    assert row["row"] == "differs"
    assert message in row["why"]
    assert row["why"].endswith("(1 of 2 sequences)")
    assert states(evaluation)["sd+argmax"] == "differs"


@pytest.mark.slow
def test_another_recording_of_the_same_name_differs(call, evaluation, dataset):
    forge(evaluation, data="0" * 64)
    out = call("leaderboard", "verify", evaluation, "--on", dataset, "--json")[1]
    (row,) = (row for row in json.loads(out) if row["method"] == "sd+argmax")
    assert "leaf: data is '000" in row["why"]


def state_of(row, folder, source, **options):
    """Return the state of a row when its method is run again, and why; ``refused`` if the evaluation is refused."""
    try:
        verdicts = {verdict.method: verdict for verdict in verify(folder, source, **options).verdicts}
    except BadInput as error:
        return "refused", str(error)
    return verdicts[row].state, verdicts[row].reason


@pytest.mark.slow
@pytest.mark.daily(8)
@pytest.mark.parametrize("key", [field.name for part in PARTS for field in fields(part)])
def test_every_change_of_a_record_is_found_but_for_time_and_machine(evaluation, dataset, key):
    lines = lines_of(evaluation)
    (line,) = (line for line in lines if (line["method"], line["sequence"]) == ("sd+argmax", "leaf"))
    old = line.get(key)
    more = [not old] if isinstance(old, bool) else [old + 1] if isinstance(old, int) else []
    more += [old + 0.01] if isinstance(old, float) else [[*old, 1.0]] if isinstance(old, list) else []
    more += ["failed", "closed_loop", "lens at rest", 1, 1.0, True]
    for line[key] in (value for value in more if value != old):  # the first that can be read
        write_lines(evaluation, lines)
        with suppress(BadInput):
            assert read_records(evaluation)
            break
    state, why = state_of("sd+argmax", evaluation, dataset)
    assert (state == "re-run here") == (key in TIME_AND_MACHINE)
    if state == "differs":
        assert f"leaf: {key} is {line[key]!r}"[:40] in why


SELECTIONS = {
    "a sequence left out": (
        lambda lines: [line for line in lines if line["sequence"] != "leaf"],
        "no record of leaf (1 of 2 sequences)",
    ),
    "a method left out": (
        lambda lines: [line for line in lines if line["method"] != "er_count+argmax@frame"],
        "leaderboard.json and records.jsonl differ in code of er_count+argmax@frame",
    ),
    "a sequence that the dataset lacks": (
        lambda lines: [*lines, *({**line, "sequence": "ghost"} for line in lines if line["sequence"] == "leaf")],
        "ghost is not in split test (1 of 3 sequences)",
    ),
    "a record left out": (lambda lines: lines[1:], "has no record of board"),
    "a record twice": (lambda lines: [*lines, lines[0]], "two records of sd+argmax on board"),
    "a record of a sequence that the dataset lacks": (
        lambda lines: [*lines, {**lines[0], "sequence": "ghost"}],
        "has no record of ghost",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("select", "message"), SELECTIONS.values(), ids=SELECTIONS)
def test_no_row_of_a_choice_of_records_is_certified(call, evaluation, dataset, select, message):
    write_lines(evaluation, select(lines_of(evaluation)))
    code, out, err = call("leaderboard", "verify", evaluation, "--on", dataset, "--json")
    assert message in (out if code == 1 else err)
    assert (code, "re-run here" in out) == (1 if out else 2, False)
    assert "re-run here" not in {row["row"] for row in json.loads(out or "[]")}


@pytest.mark.slow
def test_a_choice_of_motions_is_certified_only_where_the_command_names_it(call, tmp_path):
    entries = {"id": "still", "scene_motion": "static"}, {"id": "moving", "scene_motion": "dynamic"}
    for entry in entries:
        write_sweep(tmp_path / f"data/test/{entry['id']}.h5", 300.0)
    data = list_streams(tmp_path / "data", *entries)
    static, out = ("--scene-motion", "static"), tmp_path / "evaluation"
    assert call("evaluate", data, "--method", "sd+argmax", *static, "--out", out)[0] == 0
    code, text, _ = call("leaderboard", "verify", out, "--on", data)
    assert (code, "no record of moving (1 of 2 sequences)" in text) == (1, True)
    code, text, _ = call("leaderboard", "verify", out, "--on", data, *static)
    assert (code, "1 sequence, split test, static" in text, "re-run here" in text) == (0, True, True)


@pytest.mark.slow
def test_a_tuned_row_is_a_claim_until_its_file_is_named(call, dataset, tmp_path):
    for name, trials in (("mine", 1), ("other", 2)):
        tuned = TunedMethod("sd+argmax", "d", "train", "recorded", "", "target", trials, "0", "0", ())
        (tmp_path / f"{name}.json").write_text(format_tuned(tuned))
    mine, other = f"@{tmp_path / 'mine.json'}", f"@{tmp_path / 'other.json'}"
    evaluation = tmp_path / "evaluation"
    assert call("evaluate", dataset, "--method", mine, "--out", evaluation)[0] == 0
    state, why = state_of("sd+argmax", evaluation, dataset)
    assert (state, "name it with --method @FILE" in why) == ("claimed", True)
    assert state_of("sd+argmax", evaluation, dataset, methods=[mine]) == ("re-run here", "")
    state, why = state_of("sd+argmax", evaluation, dataset, methods=[other])
    assert (state, "board: tuning is '" in why) == ("differs", True)


@pytest.mark.slow
def test_a_method_of_others_is_run_again_within_its_limits_and_with_its_failed_check(call, dataset, tmp_path):
    (tmp_path / "mine.py").write_text(MEASURE.replace("return ", "return 12 + "))
    method, evaluation = f"{tmp_path / 'mine.py'}:Spread+argmax", tmp_path / "evaluation"
    limits = ("--limit-s", "33.5", "--limit-gib", "1")
    assert call("evaluate", dataset, "--method", method, *limits, "--out", evaluation)[0] == 0
    first = read_records(evaluation)[0]
    assert first.who.limits.startswith("33.5 s, 1,024 MiB, Landlock ")
    assert first.who.failed_check != ""
    again = method, evaluation, dataset
    assert state_of(*again, methods=[method]) == ("re-run here", "")
    forge(evaluation, limits="33.5 s, 1,024 MiB, Landlock 0")
    assert state_of(*again, methods=[method]) == ("re-run here", "")  # on a machine with another Linux
    forge(evaluation, limits="34 s, 1,024 MiB, Landlock 0")
    assert "leaf: limits is '34 s, 1,024 MiB', but '33.5 s" in state_of(*again, methods=[method])[1]
    write_lines(evaluation, [{**line, "limits": "as much as you like"} for line in lines_of(evaluation)])
    assert "the limits are 'as much" in state_of(*again, methods=[method])[1]


@pytest.mark.slow
def test_answers_that_change_after_a_verdict_are_claimed_again(call, evaluation, dataset):
    call("leaderboard", "verify", evaluation, "--on", dataset)
    forge(evaluation, "sd+argmax", machine="another", seconds=9.0)
    assert states(evaluation)["sd+argmax"] == "re-run here"  # the answer is unchanged
    forge(evaluation, "sd+argmax", note="looked at twice")
    assert states(evaluation)["sd+argmax"] == "claimed"
    assert states(evaluation)["er_count+argmax@frame"] == "re-run here"


@pytest.mark.slow
def test_the_verdict_of_another_machine_is_named_so(call, evaluation, dataset, monkeypatch):
    call("leaderboard", "verify", evaluation, "--on", dataset)
    monkeypatch.setattr(socket, "gethostname", lambda: "another")
    assert states(evaluation)["sd+argmax"] == "re-run elsewhere"
    assert states(evaluation)["a_net"] == "claimed"


@pytest.mark.slow
def test_a_row_of_two_evaluations_is_a_claim_until_both_are_run_again(call, evaluation, dataset, tmp_path):
    write_sweep(tmp_path / "data/test/hill.h5", 400.0)
    more = list_streams(tmp_path / "data", {"id": "hill", "scene": "hill"})
    method, other = ("--method", "sd+argmax", "--method", "er_count+argmax@frame"), tmp_path / "other"
    assert call("evaluate", dataset, *method, "--out", evaluation)[0] == 0
    assert call("evaluate", more, *method, "--out", other)[0] == 0
    for folder, source, state in ((evaluation, dataset, "claimed"), (other, more, "re-run here")):
        assert call("leaderboard", "verify", folder, "--on", source)[0] == 0
        assert {row.verified for row in read_leaderboard(evaluation, other)} == {state}
    (other / "verification.json").unlink()
    shutil.copytree(evaluation, tmp_path / "copy", ignore=lambda *names: ["verification.json"])
    assert {row.verified for row in read_leaderboard(evaluation, tmp_path / "copy")} == {"re-run here"}


@pytest.mark.slow
@pytest.mark.parametrize("signature", ["", "no hex"])
def test_a_verdict_without_our_signature_counts_as_from_elsewhere(call, evaluation, dataset, signature):
    call("leaderboard", "verify", evaluation, "--on", dataset)
    assert states(evaluation)["sd+argmax"] == "re-run here"
    written = json.loads((evaluation / "verification.json").read_text())
    del written["checksum"]
    forged = (
        {**written, "signature": signature} if signature else {k: v for k, v in written.items() if k != "signature"}
    )
    (evaluation / "verification.json").write_text(format_checked_json(forged))
    assert states(evaluation)["sd+argmax"] == "re-run elsewhere"
    forged = {**written, "verdicts": [{**verdict, "state": "re-run here"} for verdict in written["verdicts"]]}
    (evaluation / "verification.json").write_text(format_checked_json(forged))
    assert states(evaluation)["a_net"] == "re-run elsewhere"


@pytest.mark.slow
def test_a_sequence_that_is_not_there_differs(evaluation, dataset, tmp_path):
    part = tmp_path / "part"
    manifest = json.loads((dataset / "manifest.json").read_text())
    manifest.pop("checksum", None)
    manifest["sequences"] = manifest["sequences"][:1]
    (part / "test").mkdir(parents=True)
    (part / "test/board.h5").write_bytes((dataset / "test/board.h5").read_bytes())
    (part / "manifest.json").write_text(json.dumps(manifest))
    verdicts = {v.method: v for v in verify(evaluation, part).verdicts}
    assert verdicts["sd+argmax"].reason == "leaf is not in split test (1 of 2 sequences)"


@pytest.mark.slow
def test_a_damaged_verification_is_one_line(call, evaluation, dataset):
    call("leaderboard", "verify", evaluation, "--on", dataset)
    file = evaluation / "verification.json"
    file.write_text(file.read_text().replace("claimed", "re-run here", 1))
    error = refusal(read_leaderboard, evaluation)
    assert "this was changed after it was written" in error.problem
    assert error.hint.startswith("run saf-gen leaderboard verify again")
