"""The commands ``lens fit`` and ``lens show``."""

import pytest
from lens_texts import table_text, zemax_text
from PIL import Image

from saf_gen.cli import main
from saf_gen.optics.fitted_file import read_lens

pytestmark = pytest.mark.usefixtures("readable_figures")


def exit_code(*words):
    with pytest.raises(SystemExit) as stop:
        main([str(word) for word in words])
    return stop.value.code


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.zmx").write_text(zemax_text())
    return tmp_path


@pytest.mark.slow
def test_a_lens_is_fitted_shown_and_drawn(folder, capsys):
    assert exit_code("lens", "fit", "a.zmx", "--degree", 5, "--waves-nm", "500,600") == 0
    assert "lens: {file: a.yaml, f_number:" in capsys.readouterr().out
    lens = read_lens("a.yaml")
    assert lens.made_with == "saf-gen lens fit a.zmx --waves-nm 500,600 --degree 5"
    assert exit_code("lens", "show", "a.yaml", "--out", "a.png") == 0
    said = capsys.readouterr().out
    for words in ("focal length", "spherical aberration", "field curvature", "axial colour", "distortion", "µm rms"):
        assert words in said
    with Image.open(folder / "a.png") as picture:
        assert min(picture.size) > 500
    assert exit_code("lens", "fit", "a.zmx", "--degree", 3, "--waves-nm", "500,600") == 0  # our file is replaced
    assert read_lens("a.yaml").degree == 3


WRONG = {
    "no file": (("fit", "none.zmx"), "none.zmx cannot be read"),
    "another format": (("fit", "."), "is no lens file"),
    "not YAML": (("fit", "a.zmx", "--out", "a.txt"), "ends in .yaml"),
    "over itself": (("fit", "t.yaml"), "over itself"),
    "even degree": (("fit", "a.zmx", "--degree", 4), "one of 3, 5"),
    "degree 99": (("fit", "a.zmx", "--degree", 99), "one of 3, 5"),
    "aperture 0": (("fit", "a.zmx", "--f-number", 0), "f-number"),
    "aperture wider than the lens": (("fit", "a.zmx", "--f-number", 0.4), "do not pass"),
    "waves turned round": (("fit", "a.zmx", "--waves-nm", "600,500"), "SHORTEST,LONGEST"),
    "waves of words": (("fit", "a.zmx", "--waves-nm", "blue,red"), "SHORTEST,LONGEST"),
    "glass without numbers": (("fit", "a.zmx", "--glass", "BAF7"), "NAME=INDEX/ABBE"),
    "catalogue of something else": (("fit", "a.zmx", "--catalogue", "a.zmx"), "has no glasses"),
    "somebody's file": (("fit", "a.zmx", "--out", "mine.yaml"), "did not write it"),
    "unknown lens": (("show", "summicron"), "double_gauss"),
    "no fitted lens": (("show", "mine.yaml"), "mine.yaml"),
    "a lens file itself": (("show", "a.zmx"), "a.zmx"),
    "figure of another kind": (("show", "double_gauss", "--out", "a.jpg"), "ends in .png"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_input_is_one_line_exit_code_2_and_nothing_written(what, folder, capsys):
    words, fragment = WRONG[what]
    (folder / "mine.yaml").write_text("a: 1\n")
    (folder / "t.yaml").write_text(table_text())
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert exit_code("lens", *words) == 2
    said = capsys.readouterr().err.strip()
    assert fragment in said
    assert "\n" not in said
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
