"""The command line as a user sees it: output, files, exit codes, and one line for every error."""

import csv
import io
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace

import h5py
import numpy as np
import pytest
from small_dataset import HERE, SCENES, SMALL_RECIPE

import saf_gen
from saf_gen.benchmark.admission import read_methods
from saf_gen.benchmark.method_spec import DEFAULT_RECORDED_METHODS, parse_method
from saf_gen.cli import _terminal, main, root_command
from saf_gen.cli.dataset_commands import _name_some
from saf_gen.core.files import atomic_file
from saf_gen.render import backend
from saf_gen.stream.manifest import read_manifest, write_manifest

VARIANT = "llvm" if backend.probe_backends().llvm_usable else "scalar"
STREAM = "test/plane-constant-00.h5"
# A test run started in the background ignores Ctrl-C, and its child processes would, too.
ENTRY = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from saf_gen.cli import main
if __name__ == "__main__":
    main()
"""


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """The small dataset, made once by the command: (folder, stdout, stderr)."""
    folder, out, err = tmp_path_factory.mktemp("cli"), io.StringIO(), io.StringIO()
    (folder / "small.yaml").write_text(SMALL_RECIPE)
    command = ["generate", "small.yaml", "--out", "made", "--variant", VARIANT]
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(folder)
        patch.setenv("SAF_GEN_SCENES", str(SCENES))
        with pytest.raises(SystemExit) as ended:
            main(command)
    assert ended.value.code == 0, err.getvalue()
    return folder / "made", out.getvalue(), err.getvalue()


@pytest.fixture
def dataset(first):
    """The small dataset, read-only."""
    return first[0]


@pytest.fixture
def copy(dataset, tmp_path):
    """A copy of the small dataset that a test may change."""
    shutil.copytree(dataset, tmp_path / "copy")
    return tmp_path / "copy"


@pytest.fixture
def refused(call):
    """A function that runs a command, asserts exit code 2 and one line on stderr, and returns that line."""

    def run(*args):
        code, _, err = call(*args)
        return one_line(code, err)

    return run


def one_line(code, err, *, expected=2):
    assert code == expected, err
    assert "Traceback" not in err
    lines = [line for line in err.splitlines() if line.strip() and not line.startswith("done: ")]
    assert len(lines) == 1, err
    assert lines[0].startswith("saf-gen: ")
    return lines[0]


def records(folder):
    return [json.loads(line) for line in (folder / "records.jsonl").read_text().splitlines()]


# Commands


@pytest.mark.slow
def test_generate_reports_what_it_made_and_the_next_command(first):
    """A log gets one line for each piece of work."""
    folder, out, err = first
    assert "3 sequences recorded, 0 kept from before, 3 pieces of focal stacks rendered" in out
    assert "dataset: made   (next: saf-gen evaluate made)" in out
    assert {"manifest.json", "README.md", "stacks", "test"} <= {p.name for p in folder.iterdir()}
    assert [p for p in folder.rglob(".*")] == []
    lines = err.splitlines()
    assert "done: render plane · light" in lines
    assert "done: record plane-constant-00" in lines
    assert len(lines) == len(set(lines))


def test_a_dry_run_reports_what_would_be_made_and_writes_nothing(call, small_recipe, test_scenes, tmp_path):
    code, out, _ = call("generate", small_recipe, "--out", tmp_path / "ds", "--dry-run")
    assert code == 0
    assert "small: 3 sequences" in out
    assert out.count("400") == 3
    assert "focal stacks to render: plane" in out
    assert "disk still needed" in out
    (seconds,) = re.findall(r"time: about (\d+) s on two cores", out)
    assert 10 < int(seconds) < 40, "the start takes most of it; the scene costs a median"
    _, out, _ = call("generate", small_recipe, "--out", tmp_path / "ds", "--dry-run", "--shard", "1/3")
    assert re.search(r"shard 1/3: 1 of 1 stacks and time slices, about (\d+) s of \1 s \(100.0%\)", out)
    assert "focal stacks to render: plane" in out
    _, out, _ = call("generate", small_recipe, "--out", tmp_path / "ds", "--dry-run", "--shard", "2/3")
    assert "small: 0 sequences" in out
    assert "shard 2/3 has nothing to make" in out
    assert "focal stacks to render: none" in out
    assert not (tmp_path / "ds").exists()


@pytest.mark.parametrize(("count", "end"), [(1, "s0"), (25, "s24"), (26, "s23; and 2 more"), (400, "and 376 more")])
def test_a_dry_run_names_the_first_of_many_stacks_and_counts_the_rest(count, end):
    assert _name_some([f"s{n}" for n in range(count)]).endswith(end)


def test_a_dry_run_of_a_split_lists_its_sequences_only(call, tmp_path):
    code, out, _ = call("generate", "recipes/paper.yaml", "--out", tmp_path / "ds", "--dry-run", "--split", "train")
    assert code == 0
    assert "12 sequences" in out


@pytest.mark.slow
def test_evaluate_prints_the_leaderboard_and_writes_all_files(call, copy):
    code, out, err = call("evaluate", copy)
    assert (code, err) == (0, "")
    for method in DEFAULT_RECORDED_METHODS:
        assert method in out
    written = copy / "evaluation"
    names = ["leaderboard.json", "leaderboard.csv", "leaderboard.md", "index.html", "records.jsonl"]
    for name in names:
        assert (written / name).stat().st_size > 0
    assert out.splitlines()[-1] == f"All columns, conditions and names: open {written / 'index.html'}"
    assert len(records(written)) == 3 * len(DEFAULT_RECORDED_METHODS)
    keys = {"method", "sequence", "position", "frame", "truth", "error"}
    keys |= {"trace", "frames_seen", "lens_travel", "seconds"}
    assert keys <= set(records(written)[0])


@pytest.mark.slow
def test_evaluate_follows_its_options(call, dataset, tmp_path):
    out = tmp_path / "there"
    code, shown, _ = call(
        *("evaluate", dataset, "--out", out, "--split", "test", "--region", "frame"),
        *("--method", "sd+argmax", "--method", "sd_code+sgfs_code:dt=50"),
    )
    assert code == 0
    assert not (dataset / "evaluation").exists()
    assert {r["method"] for r in records(out)} == {"sd+argmax", "sd_code+sgfs_code:dt=50"}
    assert {r["region"] for r in records(out)} == {"frame"}
    assert "sd_code+sgfs_code:dt=50" in shown


@pytest.mark.slow
def test_a_log_gets_progress_of_long_sequences(call, dataset, tmp_path, monkeypatch):
    """A line every half minute names the method at work; otherwise there is a line for each sequence."""
    windows = (f"sd+argmax:window={frames}" for frames in (20, 25, 30, 40))
    command = ("evaluate", dataset, *(word for method in windows for word in ("--method", method)))
    clock = iter(range(0, 1000, 20))  # seconds; each reading is a step later
    monkeypatch.setattr(_terminal, "monotonic", lambda: next(clock))
    code, _, err = call(*command, "--out", tmp_path / "long", progress=True)
    assert code == 0
    assert any(re.fullmatch(r"evaluate \d+%: \S+ sd\+argmax:window=\d+", line) for line in err.splitlines())
    monkeypatch.setattr(_terminal, "monotonic", lambda: 0.0)
    lines = call(*command, "--out", tmp_path / "short", progress=True)[2].splitlines()
    assert len(lines) > 1
    assert all(re.fullmatch(r"evaluate \d+%: \S+", line) for line in lines)


@pytest.mark.slow
def test_methods_are_named_in_a_file_too(call, dataset, tmp_path):
    listed = tmp_path / "methods.txt"
    listed.write_text("# mine\n\nsd+argmax\n cen+argmax:refine=centroid  # published\n", encoding="utf-8")
    named = ["--methods", listed, "--method", "er_sumsq+argmax", "--method", "sd+argmax"]
    code, _, err = call("evaluate", dataset, *named, "--split", "test", "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    methods = ["er_sumsq+argmax", "sd+argmax", "cen+argmax:refine=centroid"]
    assert list(dict.fromkeys(r["method"] for r in records(tmp_path / "out"))) == methods


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"sd+argmax\n\nsd+argmx\n", "methods.txt:3: method 'sd+argmx': unknown search 'argmx'"),
        (b"# none\n\n", "methods.txt names no method; allowed: one method per line, such as sd+argmax"),
        (b"\xff\xfe", "methods.txt cannot be read: 'utf-8' codec"),
        (None, "methods.txt does not exist; allowed: a text file, one method per line"),
    ],
)
def test_a_list_of_methods_that_cannot_be_used_is_one_line(refused, dataset, tmp_path, text, message):
    listed = tmp_path / "methods.txt"
    if text is not None:
        listed.write_bytes(text)
    assert message in refused("evaluate", dataset, "--methods", listed, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_methods_of_the_benchmark_are_there():
    for path in (HERE.parent / "studies/results/method_lists").iterdir():
        methods = read_methods(path)
        assert [parse_method(name).name for name in methods] == methods, path.name
        assert len(methods) > 10


def test_a_single_stream_is_evaluated_into_a_folder_next_to_it(call, dataset, tmp_path):
    stream = tmp_path / "lone.h5"
    shutil.copy(dataset / STREAM, stream)
    code, out, _ = call("evaluate", stream, "--method", "sd+argmax")
    assert code == 0
    assert "sd+argmax" in out
    (record,) = records(tmp_path / "lone-evaluation")
    assert record["sequence"] == "lone"
    assert record["truth"] == pytest.approx(0.46199, abs=1e-4)


def test_a_stream_without_truth_is_evaluated_with_null_errors(call, tmp_path):
    path = tmp_path / "bare.h5"
    frames = np.random.default_rng(5).random((400, 8, 16)) < 0.2
    saf_gen.write_stream(path, frames)
    code, _, err = call("evaluate", path, "--method", "sd+argmax", "--method", "sd+sgfs_causal")
    assert (code, err) == (0, "")
    found = records(tmp_path / "bare-evaluation")
    assert {r["status"] for r in found} <= {"answered", "abstained"}
    assert {r["error"] for r in found} == {None}
    assert any(r["frame"] is not None for r in found)


def test_score_is_the_measure_of_the_counts_of_each_block(call, dataset, tmp_path):
    arguments = ("score", dataset / STREAM, "--measure", "er_sumsq", "--window", 70)
    code, out, _ = call(*arguments)
    assert code == 0
    rows = list(csv.DictReader(io.StringIO(out)))
    assert [int(row["frame"]) for row in rows] == [0, 70, 140, 210, 280]
    direct = saf_gen.get_measure("er_sumsq")
    with saf_gen.open_stream(dataset / STREAM) as stream:
        expected = [direct(stream.counts(a, a + 70)) for a in (0, 70, 140, 210, 280)]
    assert [float(row["score"]) for row in rows] == expected
    assert "5 blocks" in call(*arguments, "--out", tmp_path / "curve.csv")[1]
    assert (tmp_path / "curve.csv").read_text() == out


def test_an_imported_file_is_exported_as_it_was(call, tmp_path):
    """Rows have 416 bits; the last 16 are not pixels, and are exported as 0."""
    raw = np.random.default_rng(1).integers(0, 256, (3, 250, 52), dtype=np.uint8)
    raw[:, :, 50:] = 0
    foreign, stream, back = tmp_path / "a.dat", tmp_path / "a.h5", tmp_path / "b.dat"
    foreign.write_bytes(raw.tobytes())
    code, out, _ = call("import", foreign, "--layout", "416", "--out", stream)
    assert code == 0
    assert "3 frames of 400×250" in out
    assert call("export", stream, "--out", back, "--for", "saf")[0] == 0
    assert back.read_bytes() == foreign.read_bytes()
    with saf_gen.open_stream(stream) as opened:
        assert opened.frames(0, 1)[0, 0, :8].tolist() == [raw[0, 0, 0] >> bit & 1 for bit in range(8)]


def test_import_follows_its_options_frames_and_rate(call, tmp_path):
    (tmp_path / "a.dat").write_bytes(bytes(3 * 13_000))
    options = ("--layout", "416", "--frames", 2, "--rate", 1000)
    code, _, _ = call("import", tmp_path / "a.dat", "--out", tmp_path / "a.h5", *options)
    assert code == 0
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        assert (stream.shape[0], stream.readout_hz) == (2, 1000)


def test_inspect_tells_size_light_and_truth(call, dataset):
    code, out, _ = call("inspect", dataset / STREAM)
    assert code == 0
    for fact in ("64×40", "400 at 20000 Hz", "0.46199 of the travel", "light lamp", "content sha256"):
        assert fact in out


def test_verify_passes_an_intact_dataset(call, dataset):
    code, out, err = call("verify", dataset)
    assert (code, err) == (0, "")
    assert "3 of 3 sequences are intact" in out


def test_verify_names_what_is_damaged_and_what_is_missing(call, copy):
    with h5py.File(copy / STREAM, "r") as file:
        chunk = file["spikes"].id.get_chunk_info(0)
    content = bytearray((copy / STREAM).read_bytes())
    content[chunk.byte_offset + chunk.size // 2] ^= 0x10
    (copy / STREAM).write_bytes(content)
    (copy / "test" / "plane-continuous-00.h5").unlink()
    code, out, err = call("verify", copy)
    assert code == 1
    assert "1 of 3 sequences are intact" in out
    named = sorted(line.split(":")[1].strip() for line in err.splitlines())
    assert named == ["plane-constant-00", "plane-continuous-00"]


@pytest.mark.parametrize(("llvm", "variant", "rows"), [(None, "auto", 1), ((15, 0, 0), "auto", 1), (None, "scalar", 0)])
def test_a_slow_renderer_is_reported_unless_it_was_requested(
    call, small_recipe, test_scenes, tmp_path, monkeypatch, llvm, variant, rows
):
    monkeypatch.setattr(backend, "probe_backends", lambda: backend.BackendProbe(llvm, cuda=False))
    code, _, err = call("generate", small_recipe, "--out", tmp_path / "ds", "--dry-run", "--variant", variant)
    assert code == 0
    assert err.count("scenes are rendered by variant scalar here, slowly and without diffraction; install LLVM") == rows
    assert err.count("\n") == rows


def test_a_card_that_traces_nothing_is_left_out_and_said(call, small_recipe, test_scenes, tmp_path, monkeypatch):
    machine = backend.BackendProbe((19, 1, 7), cuda=False, card_problem="Could not initialize OptiX!")
    monkeypatch.setattr(backend, "probe_backends", lambda: machine)
    made = ("generate", small_recipe, "--out", tmp_path / "ds")
    code, _, err = call(*made, "--dry-run")
    assert (code, err) == (0, "the NVIDIA card is left out, because it traces nothing: Could not initialize OptiX!\n")
    code, _, err = call(*made, "--variant", "cuda")
    assert code == 2
    assert err.startswith("saf-gen: variant cuda cannot run here: the card traces nothing: Could not initialize OptiX!")
    assert err.count("\n") == 1
    assert not (tmp_path / "ds").exists()


def test_recipes_check_counts_sequences_and_makes_nothing(call, small_recipe, test_scenes, tmp_path):
    before = sorted(tmp_path.iterdir())
    code, out, _ = call("recipes", "check", small_recipe)
    assert code == 0
    assert "is fine: 3 sequences of plane" in out
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("scenes chek", "No such command 'chek'. Did you mean 'check'?; see: saf-gen scenes --help"),
        ("generate", "Missing argument 'recipe'; see: saf-gen generate --help"),
        (
            "evaluate x --splt y",
            "No such option: --splt (Possible options: --split, --sweep); see: saf-gen evaluate --help",
        ),
        ("genrate", "No such command 'genrate'. Did you mean 'generate'?; see: saf-gen --help"),
    ],
)
def test_an_error_points_to_the_help_of_the_command(call, words, message):
    code, out, err = call(*words.split())
    assert (code, out) == (2, "")
    assert err == f"saf-gen: {message}\n"


def test_a_mistyped_dataset_and_a_name_in_capitals_have_a_nearest(call, tmp_path):
    (tmp_path / "quickstart").mkdir()
    assert f"did you mean '{tmp_path / 'quickstart'}'?" in call("evaluate", tmp_path / "quikstart")[2]
    assert "did you mean 'sample'?" in call("evaluate", "smaple")[2]
    assert call("methods", "show", "SD")[2].endswith("did you mean 'sd'?\n")


@pytest.mark.parametrize("words", [[], ["scenes"]])
def test_no_command_at_all_shows_the_help_and_is_no_error(call, words):
    code, out, err = call(*words)
    assert (code, err) == (0, "")
    assert f"Usage: {' '.join(['saf-gen', *words])} " in out
    assert call(*words, "-h")[1].strip() == out.strip()


def every_command(command=None, words=()):
    """Yield each command and group of the command line, with the words that call it."""
    command = command or root_command()
    yield list(words), command
    for name, below in getattr(command, "commands", {}).items():
        yield from every_command(below, (*words, name))


EVERY_COMMAND = [pytest.param(*found, id=" ".join(found[0]) or "saf-gen") for found in every_command()]


@pytest.mark.parametrize(("words", "command"), EVERY_COMMAND)
def test_every_help_ends_with_examples_that_its_command_takes(call, monkeypatch, words, command):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = call(*words, "--help")
    lines = [line.strip() for line in out.rsplit("Examples:", 1)[1].splitlines() if line.strip()]
    assert (code, "<bool>" in out, "…" in out) == (0, False, False)
    assert max(map(len, out.splitlines())) <= 80
    assert out.count("\n") <= 60
    assert lines
    for line in lines:
        program, *rest = shlex.split(line)
        assert (program, rest[: len(words)]) == ("saf-gen", words)
        below, shown = command, rest[len(words) :]
        while hasattr(below, "commands") and shown and shown[0] in below.commands:
            below = below.commands[shown.pop(0)]
        below.make_context(line, shown)  # raises for an option, argument or value that the command does not take


def test_a_name_with_brackets_is_a_name_and_no_markup(call, dataset, tmp_path):
    odd = tmp_path / "[bold]a[/x]"
    code, out, _ = call("evaluate", dataset / STREAM, "--method", "sd+argmax", "--out", odd)
    assert code == 0
    assert str(odd / "index.html") in out
    stream = odd / "ü b.h5"
    shutil.copy(dataset / STREAM, stream)
    code, out, _ = call("inspect", stream)
    assert code == 0
    assert "[bold]a[/x]" in out


# Bad input: exit code 2 and one line

WRONG = {
    "unknown option": ("generate RECIPE --wrokers 2", "--wrokers | --workers"),
    "missing option": ("score STREAM --window 9", "--measure | --help"),
    "shard above its count": ("generate RECIPE --shard 3/2", "'3/2' | I/N | 2/8"),
    "no such split": ("generate RECIPE --split tset", "unknown split 'tset' | did you mean 'test'"),
    "shard of words": ("generate RECIPE --shard one", "'one' | I/N"),
    "no workers": ("generate RECIPE --workers 0", "--workers | 1"),
    "variant": ("generate RECIPE --variant lvm --out OUT", "'lvm' | auto, cuda | 'llvm'"),
    "recipe that is nowhere": ("generate NEAR", "smal.yaml does not exist | small.yaml"),
    "recipe that is a folder": ("generate FOLDER", "is a folder"),
    "stream that is nowhere": ("inspect FOLDER/a.h5", "a.h5 | no such file"),
    "stream in no folder": ("inspect FOLDER/b/a.h5", "no folder"),
    "stream that is a folder": ("inspect FOLDER", "is a folder | stream file"),
    "dataset that is a file": ("verify STREAM", "not a folder | dataset folder"),
    "dataset that is nowhere": ("evaluate FOLDER/ds", "ds | dataset folder or a stream | generate"),
    "folder without a manifest": ("evaluate FOLDER", "manifest.json | saf-gen generate"),
    "verify without a manifest": ("verify FOLDER", "manifest.json | saf-gen generate"),
    "measure": ("score STREAM --measure sdd --window 9", "focus measure 'sdd' | squared_gradient | did you mean 'sd'?"),
    "window of nothing": ("score STREAM --measure sd --window 0", "--window | 1"),
    "window too long": ("score STREAM --measure sd --window 401", "401 | 400"),
    "score's region": (
        "score STREAM --measure sd --window 9 --region fram",
        "'fram' | frame, half, inside, shifted, target | did you mean 'frame'?",
    ),
    "measure of a method": ("evaluate DATASET --method sdc+argmax", "'sdc' | sd_code | saf-gen methods list"),
    "value of a method's option": ("evaluate DATASET --method sd+sgfs_code:dt=x", "dt is 'x' | whole number"),
    "split": ("evaluate DATASET --split tset", "'tset' | test | did you mean 'test'?"),
    "split of a stream": ("evaluate STREAM --split test", "'test' | single stream"),
    "track": ("evaluate DATASET --track recorde", "'recorde' | recorded"),
    "results below a file": ("evaluate STREAM --method sd+argmax --out TEXT/x", "cannot be written | another folder"),
    "dataset below a file": ("generate RECIPE --out TEXT/x", "cannot be written | another folder"),
    "scores below a file": (
        "score STREAM --measure sd --window 9 --out TEXT/x.csv",
        "cannot be written | another folder",
    ),
    "raw file without a layout": ("import TEXT --out OUT", "--layout 416 | --size | --bits | do not say how they are"),
    "file of another layout": ("import TEXT --out OUT --layout 416", "13000 | 416 | lost end"),
    "unknown layout": ("import TEXT --out OUT --layout 4l6", "'4l6' | dense | did you mean '416'?"),
    "foreign file that is nowhere": ("import FOLDER/a.dat --out OUT", "a.dat | cannot be read"),
    "foreign folder": ("import FOLDER --out OUT", "is a folder | file of raw frames"),
    "import below a file": ("import FRAME --out TEXT/a.h5 --layout 416", "cannot be written | another folder"),
    "import of too many frames": ("import FRAME --out OUT --layout 416 --frames 2", "2 frames | 1 to 1"),
    "import at no rate": ("import FRAME --out OUT --layout 416 --rate 0", "readout_hz is 0 | above 0"),
    "export of another size": ("export STREAM --out OUT --layout 416", "40 x 64 | 250 x 400 | dense takes any size"),
}


@pytest.mark.parametrize("what", WRONG)
def test_bad_input_is_one_line_with_what_is_allowed(refused, dataset, small_recipe, test_scenes, tmp_path, what):
    (tmp_path / "folder").mkdir()
    (tmp_path / "text").write_text("hello")
    (tmp_path / "frame").write_bytes(bytes(13_000))
    places = {
        "RECIPE": small_recipe,
        "NEAR": tmp_path / "smal.yaml",
        "DATASET": dataset,
        "STREAM": dataset / STREAM,
        "FOLDER": tmp_path / "folder",
        "TEXT": tmp_path / "text",
        "FRAME": tmp_path / "frame",
        "OUT": tmp_path / "out",
    }
    command, parts = WRONG[what]
    words = [str(places[head]) + w[len(head) :] if (head := w.split("/")[0]) in places else w for w in command.split()]
    line = refused(*words)
    assert all(part in line for part in parts.split(" | ")), line
    assert list((tmp_path / "folder").iterdir()) == []
    assert not (tmp_path / "out").exists()


SLIPS = {
    "key": ("over_s", "ovr_s", "'ovr_s' | over_s | recipe.yaml:"),
    "required key": ("frames: 400", "fames: 400", "'fames' | did you mean 'frames'? | recipe.yaml:"),
    "light kind": ("kind: ramp", "kind: rmap", "'rmap' | constant, flash | did you mean 'ramp'? | recipe.yaml:"),
    "light's key": ("from: 0.5", "frm: 0.5", "'frm' | from | recipe.yaml:"),
    "light's name": ("[constant,", "[constnt,", "'constnt' | did you mean 'constant'? | recipe.yaml:"),
    "light group": ("lamp: {kind", "lmap: {kind", "'lmap' | lamp, room"),
    "scene": ("[plane]", "[plain]", "'plain' | did you mean 'plane'? | scenes list"),
    "sensor": ("small_sensor.yaml", "smal_sensor.yaml", "smal_sensor.yaml | small_sensor.yaml'?"),
    "number": ("frames: 400", "frames: many", "camera.frames is 'many' | recipe.yaml:"),
    "number too small": ("positions: 9", "positions: 1", "focus.positions is 1 | 2 | recipe.yaml:"),
    "rate": ("mean_rate: 0.2", "mean_rate: 20", "20 | above 0 and below 1 | recipe.yaml:"),
}


@pytest.mark.parametrize("what", SLIPS)
def test_a_slip_in_a_recipe_is_one_line(refused, test_scenes, tmp_path, what):
    old, new, parts = SLIPS[what]
    text = SMALL_RECIPE.replace("to: 2.0}", "to: 2.0, over_s: 0.01}")
    assert old in text
    (tmp_path / "recipe.yaml").write_text(text.replace(old, new, 1))
    line = refused("recipes", "check", tmp_path / "recipe.yaml")
    assert all(part in line for part in parts.split(" | ")), line


BROKEN = {
    "empty": b"",
    "no text at all": bytes(range(256)),
    "half a bracket": b"name: [1,\n",
    "a list": b"- name\n",
    "a loop": b"name: &a [*a]\n",
    "an object": b"name: !!python/object:os.system x\n",
    "a bomb of brackets": b"[" * 700,
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_file_that_is_no_recipe_is_one_line(refused, tmp_path, what):
    (tmp_path / "recipe.yaml").write_bytes(BROKEN[what])
    assert "recipe.yaml" in refused("recipes", "check", tmp_path / "recipe.yaml")


def foreign(path):
    with h5py.File(path, "w") as file:
        file["spikes"] = np.zeros(3)


NO_STREAM = {
    "empty": lambda path, intact: path.write_bytes(b""),
    "text": lambda path, intact: path.write_text("spikes"),
    "cut short": lambda path, intact: path.write_bytes(intact[: len(intact) // 2]),
    "cut very short": lambda path, intact: path.write_bytes(intact[:100]),
    "foreign": lambda path, intact: foreign(path),
}


@pytest.mark.parametrize(
    "command",
    [("inspect",), ("evaluate",), ("score", "--measure", "sd", "--window", "9"), ("export", "--out", "x.dat")],
    ids=lambda c: c[0],
)
@pytest.mark.parametrize("what", NO_STREAM)
def test_a_file_that_is_no_stream_is_one_line(refused, dataset, tmp_path, monkeypatch, what, command):
    monkeypatch.chdir(tmp_path)
    NO_STREAM[what](tmp_path / "a.h5", (dataset / STREAM).read_bytes())
    assert "a.h5: is " in refused(command[0], "a.h5", *command[1:])
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


def test_a_truncated_manifest_is_one_line_with_how_to_go_on(refused, call, copy, small_recipe, test_scenes):
    intact = (copy / "manifest.json").read_text()
    (copy / "manifest.json").write_text(intact[: len(intact) // 2])
    for command in ("evaluate", "verify"):
        assert "manifest.json" in refused(command, copy)
    line = refused("generate", small_recipe, "--out", copy)
    assert "manifest.json" in line
    assert "remove it" in line
    (copy / "manifest.json").unlink()
    assert call("generate", small_recipe, "--out", copy)[0] == 0
    assert (copy / "manifest.json").read_text() == intact


def test_a_file_is_not_imported_or_exported_onto_itself(refused, call, tmp_path):
    path = tmp_path / "a.dat"
    path.write_bytes(bytes(13_000))
    refused("import", path, "--layout", "416", "--out", path)
    assert path.read_bytes() == bytes(13_000)
    stream = tmp_path / "a.h5"
    assert call("import", path, "--layout", "416", "--out", stream)[0] == 0
    before = stream.read_bytes()
    refused("export", stream, "--out", stream)
    assert stream.read_bytes() == before


@pytest.mark.slow
def test_llvm_that_is_not_there_is_one_line_with_what_to_install(small_recipe, tmp_path):
    command = [sys.executable, "-m", "saf_gen", "generate", str(small_recipe), "--out", "ds", "--variant", "llvm"]
    places = {"SAF_GEN_SCENES": str(SCENES), "DRJIT_LIBLLVM_PATH": str(tmp_path / "none.so")}
    run = subprocess.run(command, env=os.environ | places, capture_output=True, text=True, cwd=tmp_path, check=False)
    line = one_line(run.returncode, run.stderr)
    assert "variant llvm cannot run here: no LLVM library was found" in line
    assert "libllvm19" in line


# Failed sequences: exit code 1; they are named, and the others are processed


@pytest.mark.slow
def test_a_damaged_sequence_is_named_and_the_others_are_evaluated(call, copy, tmp_path):
    content = (copy / STREAM).read_bytes()
    (copy / STREAM).write_bytes(content[: len(content) // 2])
    code, out, err = call("evaluate", copy, "--method", "sd+argmax", "--out", tmp_path / "out")
    assert "plane-constant-00 could not be evaluated" in one_line(code, err, expected=1)
    assert "sd+argmax" in out
    assert {r["sequence"] for r in records(tmp_path / "out")} == {"plane-continuous-00", "plane-lamp_only-00"}
    board = json.loads((tmp_path / "out" / "leaderboard.json").read_text())
    assert [f["sequence"] for f in board["failures"]] == ["plane-constant-00"]


def test_a_sequence_that_cannot_be_written_is_named_and_the_others_are_made(call, copy, small_recipe, test_scenes):
    (copy / STREAM).unlink()
    (copy / STREAM).mkdir()
    code, out, err = call("generate", small_recipe, "--out", copy)
    assert "record plane-constant-00 failed: " in one_line(code, err, expected=1)
    assert "0 sequences recorded, 2 kept from before" in out
    assert [s.id for s in read_manifest(copy).sequences] == ["plane-continuous-00", "plane-lamp_only-00"]


def test_finished_sequences_stay_listed_where_their_stacks_are_gone(call, copy, small_recipe, test_scenes):
    """Users delete stacks because they are large; a render that fails later must not destroy the dataset."""
    before = read_manifest(copy)
    shutil.rmtree(copy / "stacks")
    (copy / "stacks").write_text("in the way")
    code, _, err = call("generate", small_recipe, "--out", copy)
    assert "render plane failed: " in one_line(code, err, expected=2)
    assert read_manifest(copy).sequences == before.sequences


def test_a_dataset_without_sequences_is_one_line(refused, copy):
    write_manifest(copy, replace(read_manifest(copy), sequences=()))
    assert "saf-gen generate" in refused("evaluate", copy)


# Pipes, and Ctrl-C


@pytest.mark.slow
def test_a_pipe_that_closes_early_is_no_error(dataset):
    command = [sys.executable, "-m", "saf_gen", "score", str(dataset / STREAM), "--measure", "sd", "--window", "1"]
    read, write = os.pipe()
    os.close(read)
    run = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert (run.returncode, run.stderr) == (0, "")


def test_a_terminal_without_unicode_gets_the_table_all_the_same(call, monkeypatch):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii"))
    assert call("methods", "list")[0] == 0
    sys.stdout.flush()
    assert b"er_sumsq" in written.getvalue()
    assert b"?" in written.getvalue()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("awaited", "sent", "to_group"),
    [
        ("stacks/*/geometry.exr", signal.SIGINT, True),
        ("test/*.h5", signal.SIGTERM, False),
        pytest.param("stacks/*/geometry.exr", signal.SIGTERM, True, marks=pytest.mark.long),
        pytest.param("test/*.h5", signal.SIGINT, False, marks=pytest.mark.long),
    ],
)
def test_a_stopped_run_is_one_line_and_the_same_command_completes(
    call, dataset, small_recipe, test_scenes, tmp_path, awaited, sent, to_group
):
    """A terminal sends Ctrl-C to the parent and its workers; a batch system sends SIGTERM to all or to the parent."""
    folder = tmp_path / "ds"
    arguments = ["generate", str(small_recipe), "--out", str(folder), "--variant", VARIANT]
    run = subprocess.Popen(
        [sys.executable, "-c", ENTRY, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while not list(folder.glob(awaited)) and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    (os.killpg if to_group else os.kill)(run.pid, sent)
    _, err = run.communicate(timeout=60)
    assert "run the same command again" in one_line(run.returncode, err, expected=128 + sent)
    assert "leaked" not in err
    assert call(*arguments)[0] == 0
    assert list(folder.rglob(".*")) == []
    assert [s.content_sha256 for s in read_manifest(folder).sequences] == [
        s.content_sha256 for s in read_manifest(dataset).sequences
    ]


@pytest.mark.slow
def test_the_next_run_clears_what_a_killed_one_left_half_written(copy, small_recipe, test_scenes, call):
    """A file that another process is writing at that moment is kept."""
    begin = """
import os, sys
from saf_gen.core.files import atomic_file
left = [atomic_file(path) for path in sys.argv[1:]]
for one in left:
    one.__enter__().write_bytes(b"half")
os._exit(9)
"""
    stack = next(copy.glob("stacks/*"))
    subprocess.run([sys.executable, "-c", begin, stack / "lamp.exr", copy / STREAM], check=False)
    assert len(list(copy.rglob(".*"))) == 2
    with atomic_file(copy / STREAM) as part:
        shutil.copy(copy / STREAM, part)
        assert call("generate", small_recipe, "--out", copy)[0] == 0
        assert list(copy.rglob(".*")) == [part]
