"""The gallery of scenes that tools/write_gallery.py writes, docs/scenes.md."""

import re

import numpy as np
import pytest
from PIL import Image
from small_dataset import HERE
from written_scenes import VARIANT

from saf_gen.authoring.template import scene_from_template
from saf_gen.scene.scene_folder import find_scene


@pytest.fixture
def write(small_sensor, tmp_path, monkeypatch):
    """A function that writes the gallery of some scenes to ``docs`` and returns the exit code."""
    monkeypatch.syspath_prepend(HERE.parent / "tools")
    from write_gallery import main

    options = ["--out", str(tmp_path / "docs"), "--sensor", str(small_sensor), "--variant", VARIANT]
    return lambda *scenes: main([*scenes, *options])


@pytest.fixture
def mine(tmp_path, own_folder):
    """A function that edits the card of the scene ``mine``, made from a template, and returns the scene."""
    scene_from_template("mine", tmp_path / "scenes")

    def edit(old="", new=""):
        card = tmp_path / "scenes/mine/scene.yaml"
        assert old in card.read_text()
        card.write_text(card.read_text().replace(old, new, 1))
        return find_scene("mine")

    return edit


def test_an_unknown_scene_is_one_line_and_nothing_is_written(write, tmp_path, capsys):
    assert write("mein") == 2
    assert capsys.readouterr().err.startswith("unknown scene 'mein'")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_gallery_has_a_section_and_a_picture_a_scene(write, mine, tmp_path, test_scenes):
    scene = mine()
    assert write("mine", "workbench") == 0
    page = (tmp_path / "docs/scenes.md").read_text()
    assert re.findall(r"^## (\w+)$", page, re.MULTILINE) == ["mine", "workbench"]
    for name in re.findall(r"\]\((pictures/\S+)\)", page):
        assert 1000 < (tmp_path / "docs" / name).stat().st_size < 150_000
    links = re.findall(r"\[SOURCE.md\]\((\S+)\)", page)
    assert [(tmp_path / "docs" / link).resolve() for link in links] == [
        scene.folder / "SOURCE.md",
        test_scenes / "workbench/SOURCE.md",
    ]
    assert "| family | `tilt_deg` -20 to 20; `square_mm` 1, 2, 3 |" in page


@pytest.mark.slow
def test_a_gallery_tells_how_a_scene_moves(write, mine, tmp_path):
    moves = "motion: {card: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: [0.01, 0, 0]}]}}\n"
    mine("target:", f"{moves}slices_per_s: 100\ninterpolation_error: 0.025\ntarget:")
    assert write("mine") == 0
    page = (tmp_path / "docs/scenes.md").read_text()
    assert "| motion | 100 time slices per second, interpolated with an error of at most 2.5 % |" in page
    with Image.open(tmp_path / "docs/pictures/scenes/mine.jpg") as picture:
        assert picture.size == (6 * 32 + 5 * 4, 40 + 4 + 20)  # six small pictures below three


@pytest.mark.slow
def test_a_gallery_goes_on_where_a_scene_fails(write, mine, tmp_path, test_scenes, capsys):
    mine("target: [card]", "target: [cart]")
    assert write("mine", "workbench") == 1
    assert "mine could not be drawn: " in capsys.readouterr().err
    assert "## workbench" in (tmp_path / "docs/scenes.md").read_text()


def test_a_grid_is_as_small_as_asked_for(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(HERE.parent / "tools")
    from write_gallery import save_grid

    noise = 0.3 + 0.4 * np.random.default_rng(0).random((250, 400))
    save_grid([[noise, noise, noise], [noise]], tmp_path / "it.jpg", max_bytes=150_000)
    assert (tmp_path / "it.jpg").stat().st_size < 150_000
    with Image.open(tmp_path / "it.jpg") as image:
        picture = np.asarray(image.convert("L"))
    assert picture.shape == (2 * 250 + 4, 3 * 400 + 8)
    assert picture[260:, 500:].min() > 240
