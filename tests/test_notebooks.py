"""The notebooks run from beginning to end, each in an empty folder."""

import contextlib
import io
import json
import re
import shlex
from pathlib import Path

import matplotlib as mpl
import pytest

from saf_gen.cli import main

NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs/notebooks").glob("*.ipynb"))
RENDERS = {"3-your-own-light"}


def cells_of(path):
    document = json.loads(path.read_text(encoding="utf-8"))
    return [(cell["cell_type"], "".join(cell["source"]), cell) for cell in document["cells"]]


def run_command(line, names):
    """Run a line that begins with ``!``, with the values of {names} filled in, as IPython does."""
    filled = re.sub(r"\{[^}]+\}", lambda found: eval("f" + repr(found[0]), names), line[1:])
    program, *words = shlex.split(filled)
    assert program == "saf-gen"
    out, err = io.StringIO(), io.StringIO()
    with pytest.raises(SystemExit) as ended, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        main(words)
    assert ended.value.code == 0, f"{filled}\n{err.getvalue()}"


def run_cell(text, names):
    """Run a cell: a file to write, commands, or Python."""
    if text.startswith("%%writefile "):
        head, _, body = text.partition("\n")
        Path(head.split()[1]).write_text(body + "\n", encoding="utf-8")
    elif text.startswith("!"):
        for line in text.splitlines():
            run_command(line, names)
    else:
        exec(compile(text, "cell", "exec"), names)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_in_an_empty_folder(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with mpl.rc_context({"backend": "agg"}):
        import matplotlib.pyplot as plt

        names = {"__name__": "notebook"}
        for kind, text, _ in cells_of(path):
            if kind == "code":
                run_cell(text, names)
        plt.close("all")


def test_five_notebooks_hold_no_output_and_say_if_they_render():
    assert len(NOTEBOOKS) == 5
    for path in NOTEBOOKS:
        cells = cells_of(path)
        assert cells[0][0] == "markdown"
        assert cells[0][1].startswith("# ")
        assert all(cell["outputs"] == [] for kind, _, cell in cells if kind == "code")
        renders = any("saf-gen generate" in text for kind, text, _ in cells if kind == "code")
        assert renders == (path.stem in RENDERS)
        for _, text, _ in cells:
            for link in re.findall(r"\]\(([^)#]+)\)", text):
                assert (path.parent / link).exists(), link
