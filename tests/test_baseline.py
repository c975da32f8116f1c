"""The script that holds one commit against another, tools/baseline.py: what it finds, and what it takes for equal."""

import json
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
RECORD = {
    "method": "sd+argmax", "sequence": "camel-constant-00", "status": "answered", "position": 0.25,
    "frame": 1000.0, "trace": [1.0, None], "error": -0.01, "truth_frame": 1040.0, "error_dof": -0.3,
    "frames_seen": 4000, "lens_travel": 1.0, "operations": 1e6, "seconds": 0.5, "code": "a1b2", "machine": "one",
}  # fmt: skip


PACKAGE = """
import json, sys
from pathlib import Path
command, source, *options = sys.argv[1:]
values = dict(zip(options[::2], options[1::2]))
out = Path(values.get("--out", "."))
if command == "methods":
    print(json.dumps({"measures": [{"name": "sd", "forms": ""}], "searches": []}))
elif command in ("generate", "recapture"):
    import h5py
    out.mkdir()
    (out / "manifest.json").write_text(json.dumps({"sequences": [{"id": "camel", "file": "camel.h5"}]}))
    h5py.File(out / "camel.h5", "w").attrs["content_sha256"] = command
elif command == "evaluate":
    out.mkdir()
    methods = Path(values["--methods"]).read_text().splitlines()
    records = ({"method": m, "sequence": "camel", "error": len(values)} for m in methods)
    (out / "records.jsonl").write_text("".join(json.dumps(r) + "\\n" for r in records))
elif source == "moving_photons":
    sys.exit("1 sequence is damaged")
"""
"""A package of which the commands do what gate 2 needs, with one that fails."""


@pytest.fixture
def baseline(monkeypatch):
    """The script, which finds a commit of any name."""
    monkeypatch.syspath_prepend(ROOT / "tools")
    module = import_module("baseline")
    monkeypatch.setattr(module, "find_commit", lambda name: name * 12)
    return module


@pytest.fixture
def hold(baseline, tmp_path, capsys):
    """A function that keeps a result for two commits, compares them, and returns the exit code and what is printed."""

    def run(before, after, *options, machines=None):
        machines = machines or [baseline.describe_machine()] * 2
        for name, values, machine in zip("ab", (before, after), machines, strict=True):
            result = baseline.Result(name * 12, machine, 1, values=values)
            (tmp_path / result.commit).mkdir()
            (tmp_path / result.commit / "result.json").write_text(json.dumps(vars(result)))
        try:
            code = baseline.main(["a", "b", "--out", str(tmp_path), "--keep", *options])
        except SystemExit as error:
            code = error.code
        return code, "".join(capsys.readouterr())

    return run


@pytest.fixture
def read(baseline, tmp_path):
    """A function that writes a record with changes and returns the values that are compared, as in a result."""

    def run(**changes):
        path = tmp_path / "records.jsonl"
        path.write_text(json.dumps({key: v for key, v in {**RECORD, **changes}.items() if v is not ...}) + "\n")
        values = {}
        for kind, name, value in baseline.read_records(path):
            values.setdefault(f"recorded: {kind}", {})[name] = value
        return {"quickstart": {"content": {"camel-constant-00": "1f2e"}, **values}}

    return run


def test_equal_results_pass_whatever_machine_time_and_code_of_the_records(hold, read):
    code, shown = hold(read(), read(seconds=0.1, code="c3", machine="two"))
    assert code == 0
    assert "11 equal, 0 different, 0 in one commit only" in shown


@pytest.mark.parametrize(
    ("key", "value", "row"),
    [
        ("position", 0.25000001, "answer"),
        ("status", "abstained", "answer"),
        ("trace", [1.0, 2.0], "trace"),
        ("error_dof", None, "error"),
        ("operations", 1e6 + 1, "cost"),
    ],
)
def test_one_value_that_changed_is_found_and_named(hold, read, key, value, row):
    code, shown = hold(read(), read(**{key: value}))
    assert code == 1
    (line,) = (line for line in shown.splitlines() if f"recorded: {row} " in line)
    assert line.endswith(f"| sd+argmax camel-constant-00 {key} |")
    assert "10 equal, 1 different" in shown


def test_a_recording_with_another_content_is_found(hold, read):
    after = read()
    after["quickstart"]["content"]["camel-constant-00"] = "1f2f"
    code, shown = hold(read(), after)
    assert code == 1
    assert "| camel-constant-00 |" in shown


def test_a_key_that_the_table_of_names_knows_under_both_names_is_equal(baseline, hold, read, monkeypatch):
    monkeypatch.setitem(baseline.NAMES["error"], "error", ("judgement.travels", "error"))
    before = read()
    after = read(error=..., judgement={"travels": RECORD["error"]})
    assert hold(before, after)[0] == 0


def test_what_only_one_commit_has_is_listed_and_fails_only_if_asked(hold, read, tmp_path):
    before, after = read(), read(truth_frame=...)
    before["recipe claims"] = {"stack keys": {"camel": "a", "fan": "b"}}
    code, shown = hold(before, after)
    assert code == 0
    assert "| −camel, −fan |" in shown
    assert "| −sd+argmax camel-constant-00 truth_frame |" in shown
    assert "3 in one commit only" in shown


def test_strict_fails_for_what_only_one_commit_has(hold, read):
    assert hold(read(), read(truth_frame=...), "--strict")[0] == 1


def test_values_of_the_same_kind_with_no_name_in_common_fail(hold, read):
    code, shown = hold(read(), read(sequence="camel-00"))
    assert code == 1
    assert "0 different" in shown


def test_results_of_another_machine_are_refused(baseline, hold, read):
    here = baseline.describe_machine()
    code, shown = hold(read(), read(), machines=(here, f"{here}, another"))
    assert code == 2
    assert "the results are of two machines" in shown


def test_a_command_that_fails_only_after_fails(baseline, read, capsys):
    before, after = (baseline.Result(name, "here", 2, values=read()) for name in "ab")
    before.failed["recipe old"] = "it is frozen"
    assert baseline.report(before, after) == 0
    after.failed["verify quickstart"] = "exit code 1: a digest differs"
    assert baseline.report(before, after) == 1
    assert "failed after: verify quickstart: exit code 1: a digest differs" in capsys.readouterr().out


@pytest.mark.parametrize(("camera", "refused"), [("spikes", "_events"), ("events", "calibrated"), ("photons", "_tfi")])
def test_methods_are_all_that_a_commit_lists_and_that_suit_the_camera(baseline, camera, refused):
    listed = {
        "measures": [{"name": "sd_code", "forms": "_tfi"}, {"name": "sd_calibrated", "forms": ""}],
        "searches": [{"name": "elp_events", "kind": "estimates"}, {"name": "fibonacci", "kind": "commands"}],
    }
    found = {
        track: baseline.choose_methods(listed, camera=camera, track=track, all_forms=camera == "spikes")
        for track in ("recorded", "closed_loop")
    }
    assert "sd_code+argmax" in found["recorded"]
    assert "sd_code+fibonacci" in found["closed_loop"]
    assert not any(refused in method for methods in found.values() for method in methods)


@pytest.mark.slow
def test_gate_2_runs_the_commands_of_the_checkout_and_notes_what_fails(baseline, tmp_path):
    (tmp_path / "checkout/saf_gen").mkdir(parents=True)
    (tmp_path / "checkout/saf_gen/__init__.py").write_text("")
    (tmp_path / "checkout/saf_gen/__main__.py").write_text(PACKAGE)
    commit = baseline.Commit("a" * 12, tmp_path, 2)
    commit.generate_and_evaluate()
    assert commit.result.failed == {"verify moving_photons": "exit code 1: 1 sequence is damaged"}
    values = commit.result.values
    assert {name: kinds["content"]["camel"] for name, kinds in values.items()} == {
        "moving": "generate", "moving_events": "recapture", "moving_photons": "recapture",
    }  # fmt: skip
    assert values["moving"]["recorded: error"] == {"sd+argmax camel error": 4}
    assert values["moving"]["closed_loop: error"] == {"sd+golden_section camel error": 4}


@pytest.mark.slow
@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a checkout")
def test_the_same_commit_twice_is_equal_by_gate_1(monkeypatch, capsys):
    monkeypatch.syspath_prepend(ROOT / "tools")
    assert import_module("baseline").main(["HEAD", "HEAD"]) == 0
    shown = capsys.readouterr().out
    assert "| recipe quickstart " in shown
    assert ", 0 different, 0 in one commit only" in shown


def test_a_commit_that_does_not_exist_is_bad_input(monkeypatch, capsys):
    monkeypatch.syspath_prepend(ROOT / "tools")
    with pytest.raises(SystemExit, match="2"):
        import_module("baseline").main(["no_such_commit", "HEAD"])
    assert "'no_such_commit' is no commit" in capsys.readouterr().err
