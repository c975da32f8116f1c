"""Two commits that write the same give no difference, and a change of one digit in any kind of file is found."""

import csv
import json
import sys
from importlib import import_module
from pathlib import Path

import h5py
import numpy as np
import OpenEXR
import pytest

TABLE = ["method", "err DoF", "s"]
PAGE = """\
<table><thead><tr><th colspan="2">error</th><th>cost</th></tr>
<tr>{headings}</tr></thead>
<tbody><tr class="first">{cells}</tr></tbody></table>
<section id="methods"><pre>{code}</pre></section>
<footer>Made by saf_gen {version}.</footer>
"""
CHANGES = {
    "seconds": [],
    "machine": [],
    "code": [],
    "score": ["leaderboard.csv", "leaderboard.json", "leaderboard.md", "index.html", "records.jsonl"],
    "radiance": ["stacks/lamp.exr"],
    "exponent": ["stacks/lamp.exr"],
    "spikes": ["test/sweep.h5"],
    "recipe": ["test/sweep.h5"],
    "picture": ["preview/sheet.png"],
    "path": ["figures/curves.svg"],
}


@pytest.fixture
def compare_commits(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "tools")
    return import_module("compare_commits")


def write_outputs(folder, **changes):
    """Write files of every kind; each change adds a little to a number, or a letter to a text."""
    number = {"score": 0.25, "seconds": 0.1, "radiance": 1.0}
    for key in number.keys() & changes.keys():
        number[key] *= 1 + 1e-7
    keys = ("code", "machine", "recipe", "picture", "path", "exponent")
    text = {key: f"{key}{'!' * (key in changes)}" for key in keys}
    version = "0.1.0" if "version" not in changes else "0.2.0"
    for name in ("stacks", "test", "preview", "figures"):
        (folder / name).mkdir(parents=True)
    row = ["sd+argmax", number["score"], number["seconds"]]
    write = {
        "leaderboard.json": json.dumps(
            {"version": version, "rows": [{"score": row[1], "seconds": row[2]}], "code": {"sd+argmax": text["code"]}}
        ),
        "leaderboard.md": "\n".join(["# Leaderboard", *(f"| {' | '.join(map(str, r))} |" for r in (TABLE, row))]),
        "index.html": PAGE.format(
            headings="".join(f"<th title='It is.'>{name}</th>" for name in TABLE),
            cells="".join(f"<td>{value}</td>" for value in row),
            code=text["code"],
            version=version,
        ),
        "figures/curves.svg": f"<svg>\n{text['path']}\n</svg>",
    }
    for name, content in write.items():
        (folder / name).write_text(content)
    with (folder / "leaderboard.csv").open("w") as file:
        csv.writer(file).writerows([["method", "score", "seconds"], row])
    names = ["sd+argmax", "cen+argmax"] if "seconds" not in changes else ["cen+argmax", "sd+argmax"]  # any order
    common = {"sequence": "sweep", "region": "target", "score": row[1], "seconds": row[2], "machine": text["machine"]}
    (folder / "records.jsonl").write_text("".join(json.dumps({"method": n, **common}) + "\n" for n in names))
    (folder / "preview/sheet.png").write_bytes(b"\x89PNG\xff" + text["picture"].encode())
    plane = np.full((2, 3), number["radiance"], np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "exponent": text["exponent"]}
    OpenEXR.File(header, {"focus.0000": plane}).write(str(folder / "stacks/lamp.exr"))
    with h5py.File(folder / "test/sweep.h5", "w") as file:
        file["spikes"] = np.arange(24) + ("spikes" in changes)
        file["provenance/recipe"], file["provenance/versions"] = text["recipe"], version


@pytest.fixture
def before(tmp_path):
    write_outputs(tmp_path / "before")
    return tmp_path / "before"


@pytest.mark.parametrize(("change", "expected"), CHANGES.items())
def test_a_small_change_is_found_where_it_counts(compare_commits, before, tmp_path, change, expected):
    write_outputs(tmp_path / "after", **{change: True})
    found = compare_commits.compare_folders(before, tmp_path / "after")
    assert sorted(found) == sorted(expected)
    assert all({line[0] for line in lines} == {"-", "+"} for lines in found.values())


def test_a_file_that_only_one_commit_writes_is_found(compare_commits, before, tmp_path):
    write_outputs(tmp_path / "after")
    (before / "axes.csv").write_text("axis\n")
    (tmp_path / "after/new.csv").write_text("axis\n")
    found = compare_commits.compare_folders(before, tmp_path / "after")
    assert found == {"axes.csv": ["+ there is no such file"], "new.csv": ["- there is no such file"]}
    assert compare_commits.compare_folders(before, tmp_path / "after", allowed=["axes.csv", "n*.csv"]) == {}


@pytest.mark.parametrize(("result", "code"), [("0.25", 0), ("0.2500001", 1), ("fails", 1)])
def test_jobs_run_with_both_checkouts(compare_commits, tmp_path, monkeypatch, capsys, result, code):
    """Two packages that write their arguments and a number; the second may fail instead."""
    for name, number in (("one", "0.25"), ("two", result)):
        package = tmp_path / name / "saf_gen"
        (package / "camera").mkdir(parents=True)
        (package / "camera/vidar_400x250.yaml").write_text("name: vidar_400x250\nrows: 250\n")
        (package / "__init__.py").write_text("")
        (package / "__main__.py").write_text(
            f"import sys\nif {number!r} == 'fails': sys.exit('no result')\nopen(sys.argv[1], 'w').write({number!r})\n"
        )
    monkeypatch.setattr(compare_commits, "JOBS", {"job": ("result.txt",)})
    sides = [str(tmp_path / "one"), str(tmp_path / "two"), "--work", str(tmp_path / "work")]
    assert compare_commits.main(sides) == code
    shown = capsys.readouterr().out
    expected = {"0.25": "none differ", "0.2500001": "DIFFERS job/result.txt", "fails": "no result"}[result]
    assert expected in shown
    assert "before job [1/1] result.txt" in shown
    assert compare_commits.main(sides) == code
    assert "before job [1/1]" not in capsys.readouterr().out  # it is not run again
    assert sys.executable in shown or result != "fails"
