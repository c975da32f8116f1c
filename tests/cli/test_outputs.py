"""No command replaces what saf_gen did not write, or writes through a link; two runs into one folder do not meet."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from folder_server import serve
from planted_sweeps import write_three_sweeps
from small_dataset import SMALL_RECIPE

EVALUATE = "evaluate data --method sd+argmax:window=200"
MERGE = "leaderboard merge judged --out"
TUNE = "tune data --method sd+argmax --try search.window=100,200 --out"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a dataset, its evaluation, a raw file and a recipe."""
    root = tmp_path_factory.mktemp("made")
    write_three_sweeps(root / "data")
    (root / "recipe.yaml").write_text(SMALL_RECIPE)
    return root


@pytest.fixture
def folder(made, tmp_path, monkeypatch, test_scenes):
    shutil.copytree(made, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


STREAM = "data/train/one.h5"
FOREIGN = {
    "records.jsonl": (f"{EVALUATE} --out OUT", "no evaluation wrote it"),
    "leaderboard.json": (f"{EVALUATE} --out OUT", "no evaluation wrote it"),
    "leaderboard.csv": (f"{EVALUATE} --out OUT", "no evaluation wrote it"),
    "index.html": (f"{EVALUATE} --out OUT", "no evaluation wrote it"),
    "leaderboard.md": (f"{MERGE} OUT", "no evaluation wrote it"),
    "curves.csv": (f"{MERGE} OUT", "no evaluation wrote it"),
    "thesis.tex": ("fetch ADDRESS --out OUT", "holds other files"),
    "manifest.json": ("fetch ADDRESS --out OUT", "holds another dataset"),
    "sequences.csv": ("generate recipe.yaml --out OUT", "saf-gen did not write it"),
    "README.md": ("generate recipe.yaml --out OUT", "saf-gen did not write it"),
    "croissant.json": ("generate recipe.yaml --out OUT", "saf-gen did not write it"),
    "camera.dat": (f"export {STREAM} --out OUT/camera.dat", "raw files do not say who wrote them"),
    "part.h5": (f"cut {STREAM} --to 100 --out OUT/part.h5", "is no saf-gen stream"),
    "best.json": (f"{TUNE} OUT/best.json", "saf-gen did not write it"),
}


def run(call, command, out):
    with serve(Path("data")) as (_, address):
        return call(*(word.replace("OUT", out).replace("ADDRESS", address) for word in command.split()))


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", FOREIGN)
def test_a_file_of_the_user_is_not_replaced(folder, call, name):
    command, words = FOREIGN[name]
    if "judged" in command:
        assert run(call, f"{EVALUATE} --out OUT", "judged")[0] == 0
    file = folder / "out" / name
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    before = contents(folder)
    code, _, err = run(call, command, "out")
    assert code == 2
    assert words in err
    assert len(err.splitlines()) <= 2
    assert contents(folder) == before


LINKED = {
    "evaluate": f"{EVALUATE} --out OUT",
    "leaderboard": f"{MERGE} OUT",
    "fetch": "fetch ADDRESS --out OUT",
    "generate": "generate recipe.yaml --out OUT",
    "export": f"export {STREAM} --out OUT",
    "cut": f"cut {STREAM} --to 100 --out OUT",
    "tune": f"{TUNE} OUT",
    "score": f"score {STREAM} --measure sd --window 100 --out OUT",
    "view": f"view {STREAM} --out OUT.png",
}


@pytest.mark.parametrize("kind", ["file", "folder", "nothing"])
@pytest.mark.parametrize("command", LINKED)
def test_an_output_that_is_a_link_is_refused(folder, call, command, kind):
    if command == "leaderboard":
        assert run(call, f"{EVALUATE} --out OUT", "judged")[0] == 0
    target = folder / "target"
    if kind == "file":
        target.write_text("mine")
    elif kind == "folder":
        target.mkdir()
    link = folder / ("out.png" if command == "view" else "out")
    link.symlink_to("target")
    before = contents(folder)
    code, out, err = run(call, LINKED[command], "out")
    assert code == 2, out
    assert f"is a symbolic link; allowed: a file or folder itself; write to {target}" in err
    assert contents(folder) == before
    assert link.is_symlink()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["records.jsonl", "index.html", "leaderboard.csv"])
def test_a_link_among_the_files_of_an_evaluation_is_refused(folder, call, name):
    assert run(call, f"{EVALUATE} --out OUT", "judged")[0] == 0
    file = folder / "judged" / name
    file.rename(folder / "elsewhere")
    file.symlink_to(folder / "elsewhere")
    before = contents(folder)
    code, _, err = run(call, f"{EVALUATE} --out OUT", "judged")
    assert (code, "is a symbolic link" in err) == (2, True)
    assert contents(folder) == before


@pytest.mark.slow
def test_what_saf_gen_wrote_is_replaced(folder, call):
    for _ in range(2):
        assert run(call, f"{EVALUATE} --out OUT", "judged")[0] == 0
        assert run(call, f"{MERGE} OUT", "merged")[0] == 0
        assert run(call, f"cut {STREAM} --to 100 --out OUT", "part.h5")[0] == 0
        assert run(call, f"{TUNE} OUT", "best.json")[0] == 0
        (folder / "judged" / "notes.txt").write_text("mine")
    assert (folder / "judged" / "notes.txt").read_text() == "mine"


@pytest.mark.slow
def test_a_second_evaluation_into_one_folder_is_refused_while_the_first_runs(folder, call):
    """The first one holds the folder until it ends, however it ends."""
    hold = (
        "import sys; from pathlib import Path; from saf_gen.core.files import lock_folder\n"
        "with lock_folder(Path('out')):\n    print('held', flush=True); sys.stdin.read()"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    first = subprocess.Popen(
        [sys.executable, "-c", hold], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
    )
    assert first.stdout.readline() == b"held\n"
    code, _, err = run(call, f"{EVALUATE} --out OUT", "out")
    assert code == 2
    assert "another saf-gen is writing to out; wait until it has ended, or give another folder with --out" in err
    assert contents(folder / "out") == {}
    first.kill()
    first.communicate()
    assert run(call, f"{EVALUATE} --out OUT", "out")[0] == 0


def test_an_evaluation_that_is_refused_leaves_no_folder(folder, call):
    assert run(call, f"{EVALUATE} --region nowhere --out OUT", "new")[0] == 2
    assert not (folder / "new").exists()
