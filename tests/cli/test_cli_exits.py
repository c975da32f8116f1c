"""Users' code that calls exit fails like code that raises: it is named, and the rest goes on.

Only Ctrl-C stops everything, and only a pipe that its reader has closed is a quiet end.
"""

import errno
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

import pytest
from planted_sweeps import write_three_sweeps
from small_dataset import SCENES, SMALL_RECIPE

from saf_gen.authoring.template import scene_from_template
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import read_records, write_records
from saf_gen.render import backend

VARIANT = "llvm" if backend.probe_backends().llvm_usable else "scalar"
EXITS = {
    "sys.exit()": "exit()",
    "sys.exit('no licence')": "exit('no licence')",
    "raise SystemExit(7)": "exit(7)",
    "argparse.ArgumentParser().parse_args(['--help'])": "exit(0)",
}
"""Statements of users' code, and the call of exit that errors state."""
PARTS = """\
import argparse, sys; from saf_gen.parts import Answer

AT_LOAD

def score(counts):
    IN_USE

def look(view):
    IN_USE

class Built:
    def __init__(self):
        IN_USE

    def __call__(self, counts):
        return 1.0

class Asked:
    @property
    def commands(self):
        IN_USE

    def __call__(self, view):
        return None
"""


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory):
    return write_three_sweeps(tmp_path_factory.mktemp("data"))


@pytest.fixture
def write_parts(tmp_path):
    """A function that writes plug-ins that run these statements when they are loaded, or used; returns the file."""

    def write(*, at_load="", in_use="return 1.0"):
        path = tmp_path / "mine.py"
        path.write_text(PARTS.replace("AT_LOAD", at_load).replace("IN_USE", in_use))
        return path

    return write


def only_error(err):
    """Return the only line that saf_gen printed on stderr; argparse may have printed others."""
    assert "Traceback" not in err
    (line,) = [line for line in err.splitlines() if line.startswith("saf-gen: ")]
    return line


def assert_good_rows_stand(records, calls):
    """Assert that three records of ``sd+argmax`` have answers, and that all others have failed, with this note."""
    assert [record.judgement.status for record in records if record.who.method == "sd+argmax"] == ["answered"] * 3
    bad = {(record.judgement.status, record.judgement.note) for record in records if record.who.method != "sd+argmax"}
    assert bad == {("failed", f"CodeStopped: its code called {calls}")}


# Methods


@pytest.mark.slow
@pytest.mark.daily(1)
@pytest.mark.parametrize(("statement", "calls"), EXITS.items())
def test_a_measure_or_search_that_exits_fails_and_the_others_answer(sweeps, write_parts, statement, calls):
    mine = write_parts(in_use=statement)
    result = evaluate(sweeps, methods=[f"{mine}:score+argmax", "sd+argmax", f"sd+{mine}:look"], draw=False, check=False)
    assert (len(result.records), result.failures) == (9, ())
    assert_good_rows_stand(result.records, calls)


LOADING = {
    "evaluate": "evaluate {data} --method {mine}:score+argmax --out {out}",
    "score": "score {stream} --window 100 --measure {mine}:score",
    "view": "view {stream} --out {out}/a.png --measure {mine}:score",
    "check": "methods check {mine}:score",
    "check a form": "methods check {mine}:score_n",
    "check a method": "methods check sd+{mine}:look",
    "show": "methods show {mine}:score",
    "tune": "tune {data} --method {mine}:score+argmax --try search.window=20,50 --out {out}/t.json",
    "verify": "leaderboard verify {out} --on {data} --method {mine}:score+argmax",
}


@pytest.fixture(scope="module")
def records(sweeps):
    return evaluate(sweeps, methods=["sd+argmax"], draw=False).records


@pytest.mark.slow
@pytest.mark.parametrize("command", LOADING.values(), ids=LOADING)
def test_every_command_refuses_a_file_that_exits_when_it_is_loaded(
    call, sweeps, records, tmp_path, write_parts, command
):
    mine = write_parts(at_load="argparse.ArgumentParser().parse_args(['--nothing'])")
    write_records(tmp_path / "records.jsonl", records)
    places = {"stream": sweeps / "train/one.h5", "data": sweeps, "out": tmp_path, "mine": mine}
    code, _, err = call(*command.format(**places).split())
    assert code == 2
    assert "mine.py:" in only_error(err)
    assert "cannot be loaded: CodeStopped: its code called exit(2)" in only_error(err)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "statement", "message"),
    [
        ("score", "sys.exit(3)", "CodeStopped: its code called exit(3)"),
        ("view", "1 / 0", "ZeroDivisionError: division by zero"),
    ],
)
def test_a_measure_that_fails_on_a_stream_is_named(call, sweeps, tmp_path, write_parts, command, statement, message):
    mine = write_parts(in_use=statement)
    code, out, err = call(*LOADING[command].format(stream=sweeps / "train/one.h5", out=tmp_path, mine=mine).split())
    assert (code, out) == (2, "")
    assert f"mine.py:score' fails: {message}; repair it" in only_error(err)


@pytest.mark.slow
def test_a_check_of_a_measure_that_exits_reports_it(call, monkeypatch, write_parts):
    monkeypatch.setenv("COLUMNS", "400")
    code, out, err = call("methods", "check", f"{write_parts(in_use='sys.exit(0)')}:score+argmax")
    assert (code, err) == (1, "")
    assert "CodeStopped: its code called exit(0) (mine.py, line 6), for random counts" in out


IN_THE_LOOP = ("--track", "closed_loop", "--budget", "30", "--actuator", "ideal", "--op-rate", "0")


@pytest.mark.slow
@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("track", "statement", "reason"),
    [
        ("recorded", "sys.exit(2)", "CodeStopped: its code called exit(2)"),
        ("closed_loop", "1 / 0", "ZeroDivisionError: division by zero"),
    ],
)
def test_a_method_whose_code_breaks_is_one_line_and_exit_code_1(
    call, request, tmp_path, write_parts, track, statement, reason
):
    data = request.getfixturevalue("sweeps" if track == "recorded" else "captured_dataset")
    mine, out = write_parts(in_use=statement), tmp_path / "out"
    broken = f"{mine}:score+argmax", f"sd+{mine}:look"
    methods = [f"--method={name}" for name in (*broken, "sd+argmax")]
    code, printed, err = call("evaluate", data, *methods, "--out", out, *(IN_THE_LOOP if track != "recorded" else ()))
    records = read_records(out / "records.jsonl")
    count = len(records) // 3
    assert (code, printed.count(" sd+argmax ")) == (1, 1)
    assert err.splitlines() == [f"saf-gen: {name} failed on {count} of {count} sequences: {reason}" for name in broken]
    assert {record.judgement.status for record in records if record.who.method == "sd+argmax"} == {"answered"}


@pytest.mark.slow
def test_a_method_that_breaks_on_some_sequences_is_counted(call, sweeps, tmp_path, write_parts):
    mine = write_parts(in_use="return 1 / 0 if view.score(300, 500) > view.score(100, 300) else Answer()")
    code, _, err = call("evaluate", sweeps, "--method", f"sd+{mine}:look", "--out", tmp_path / "out")
    assert code == 1
    assert " failed on 2 of 3 sequences: ZeroDivisionError: division by zero" in only_error(err)


@pytest.mark.slow
def test_a_refusal_and_an_impossible_answer_on_every_sequence_are_exit_code_1_and_an_abstention_is_a_result(
    call, sweeps, tmp_path
):
    mine = tmp_path / "mine.py"
    searches = {
        "refuses": "raise BadInput('too short')",
        "looks_too_far": "view.score(0, 10**6)",
        "answers_too_far": "return Answer(10.0**6)",
        "abstains": "return Answer()",
    }
    code = [f"def {name}(view):\n    {statement}\n" for name, statement in searches.items()]
    mine.write_text("\n".join(["from saf_gen.errors import BadInput\nfrom saf_gen.parts import Answer", *code]))
    methods = [f"--method=sd+{mine}:{name}" for name in searches]
    code, _, err = call("evaluate", sweeps, *methods, "--out", tmp_path / "out")
    assert code == 1
    assert [line.partition(f"{mine}:")[2].split(":")[0] for line in err.splitlines()] == [
        f"{name} failed on 3 of 3 sequences" for name in searches if name != "abstains"
    ]
    found = {
        record.who.method.split(":")[-1]: record.judgement.status
        for record in read_records(tmp_path / "out/records.jsonl")
    }
    assert found == {name: "abstained" if name == "abstains" else "failed" for name in searches}


def wait_for_guest(folder):
    """Wait until a method has made the file ``runs`` in the folder of its process, the only one that it may write."""
    while not list(folder.glob("saf-gen-guest-*/work/runs")):
        time.sleep(0.05)


@pytest.mark.slow
def test_ctrl_c_in_a_method_still_stops_the_evaluation(call, sweeps, tmp_path, write_parts, monkeypatch):
    signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs that a shell starts in the background ignore it
    mine = write_parts(in_use="import pathlib, time; pathlib.Path('runs').touch(); time.sleep(9)")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def press():
        wait_for_guest(tmp_path)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=press).start()
    code, _, err = call("evaluate", sweeps, "--method", f"sd+{mine}:look", "--out", tmp_path / "out")
    assert code == 130
    assert only_error(err).startswith("saf-gen: stopped; finished work is kept")


# What reaches main()


@pytest.mark.slow
def test_an_exit_while_a_method_is_asked_what_it_is_costs_its_rows(call, sweeps, tmp_path, write_parts):
    mine = write_parts(in_use="sys.exit(0)")
    code, _, err = call("evaluate", sweeps, "--method", f"sd+{mine}:Asked", "--out", tmp_path / "out")
    assert code == 1
    assert only_error(err).endswith(
        "failed on 3 of 3 sequences: while it was loaded, CodeStopped: its code called exit(0)"
    )


def test_an_exit_at_any_other_place_is_one_line_with_the_place(call, monkeypatch):
    monkeypatch.setattr("saf_gen.scene.scene_folder.scene_names", sys.exit)
    code, _, err = call("scenes", "list")
    assert code == 1
    assert only_error(err).endswith("called exit()")


def test_a_broken_pipe_that_is_not_the_output_is_no_success(call, monkeypatch):
    """Such as the pipe to a worker that dies while it starts."""

    def break_pipe():
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr("saf_gen.scene.scene_folder.scene_names", break_pipe)
    code, _, err = call("scenes", "list")
    assert code == 1
    assert "test_cli_exits.py, line " in only_error(err)
    assert "failed: [Errno 32] Broken pipe" in only_error(err)


@pytest.mark.parametrize(("shell", "code", "printed"), [("complete_bash", 0, "score\n"), ("complete_nonsense", 1, "")])
def test_completion_for_a_shell_ends_as_typer_ends_it(call, monkeypatch, shell, code, printed):
    for name, value in {"_SAF_GEN_COMPLETE": shell, "COMP_WORDS": "saf-gen sco", "COMP_CWORD": "1"}.items():
        monkeypatch.setenv(name, value)
    found, out, err = call()
    assert (found, "saf-gen: " in err) == (code, False)
    assert printed in out


# Scenes


@pytest.fixture
def write_scene(own_folder):
    """A function that writes the scene ``mine``, whose script runs a statement when it is loaded, built, or moved."""

    def write(statement, at):
        scene_from_template("mine", own_folder / "scenes")
        script = own_folder / "scenes/mine/scene.py"
        text = script.read_text()
        added = {
            "load": f"import argparse, sys\n{statement}\n{text}",
            "build": f"{text}\n\ndef build(params):\n    import argparse, sys\n    {statement}\n",
            "motion": f"{text}\n\ndef motion(params):\n    import argparse, sys\n    {statement}\n",
        }
        script.write_text(added[at])

    return write


@pytest.mark.parametrize(
    ("at", "statement", "calls"),
    [
        ("load", "argparse.ArgumentParser().parse_args(['--nothing'])", "exit(2)"),
        ("build", "sys.exit(0)", "exit(0)"),
        ("motion", "sys.exit()", "exit()"),
    ],
)
def test_a_scene_that_exits_fails_its_check_and_is_not_drawn(call, write_scene, at, statement, calls):
    write_scene(statement, at)
    code, out, err = call("scenes", "check", "mine", "--variant", "scalar")
    assert (code, "saf-gen: " in err) == (1, False)
    assert "mine error geometry: " in out
    assert f"scenes/mine/scene.py failed: CodeStopped: its code called {calls}\n" in out
    code, _, err = call("scenes", "preview", "mine", "--variant", "scalar")
    assert code == 2
    assert f"scenes/mine/scene.py failed: CodeStopped: its code called {calls}" in only_error(err)


@pytest.mark.slow
def test_a_scene_that_exits_in_a_worker_process_fails_its_render(tmp_path):
    shutil.copytree(SCENES / "plane", tmp_path / "scenes/plane")
    script = tmp_path / "scenes/plane/scene.py"
    script.write_text(script.read_text().replace("return {", "raise SystemExit\n    return {"))
    (tmp_path / "small.yaml").write_text(SMALL_RECIPE)
    environment = os.environ | {"SAF_GEN_SCENES": str(tmp_path / "scenes")}
    command = [sys.executable, "-m", "saf_gen", "generate", "small.yaml", "--out", "made", "--variant", VARIANT]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment)
    assert run.returncode == 2
    assert "render plane failed: " in only_error(run.stderr)
    assert "scene.py failed: CodeStopped: its code called exit()" in only_error(run.stderr)


@pytest.mark.slow
@pytest.mark.daily(1)
@pytest.mark.parametrize("columns", ["0", "-3", "3", "many", ""])
def test_help_is_not_empty_for_a_width_that_no_terminal_has(columns):
    environment = {**os.environ, "COLUMNS": columns}
    run = subprocess.run([sys.executable, "-m", "saf_gen", "--help"], capture_output=True, env=environment, check=True)
    assert b"generate" in run.stdout


@pytest.mark.slow
@pytest.mark.parametrize(("ignored", "code"), [(False, 129), (True, 1)])
def test_a_closed_terminal_stops_a_command_in_one_line_unless_it_is_ignored(
    sweeps, tmp_path, write_parts, ignored, code
):
    mine = write_parts(in_use="import pathlib, time; pathlib.Path('runs').touch(); time.sleep(1); return None")
    command = [sys.executable, "-m", "saf_gen", "evaluate", sweeps, "--method", f"sd+{mine}:look"]
    handler = signal.SIG_IGN if ignored else signal.SIG_DFL
    run = subprocess.Popen(
        [*command, "--out", tmp_path / "out"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"TMPDIR": str(tmp_path)}, preexec_fn=lambda: signal.signal(signal.SIGHUP, handler),
    )  # fmt: skip
    wait_for_guest(tmp_path)
    run.send_signal(signal.SIGHUP)
    _, err = run.communicate()
    assert run.returncode == code  # if it goes on, its answer, None, is malformed
    assert ("saf-gen: stopped; finished work is kept" in err) != ignored
