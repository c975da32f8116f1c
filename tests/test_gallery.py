"""The gallery of scenes that tools/write_gallery.py writes, docs/scenes.md."""

import re

import pytest
from small_dataset import HERE
from written_scenes import VARIANT

from saf_gen.authoring.template import scene_from_template
from saf_gen.scene.scene_folder import find_scene

MOVES = "motion: {card: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: [0.01, 0, 0]}]}}\n"


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


@pytest.mark.slow
def test_a_gallery_has_a_section_and_a_picture_a_scene(write, mine, tmp_path, test_scenes, capsys):
    assert write("mein") == 2
    assert capsys.readouterr().err.startswith("unknown scene 'mein'")
    scene = mine("target:", f"{MOVES}slices_per_s: 100\ninterpolation_error: 0.025\ntarget:")
    assert write("mine", "workbench") == 0
    page = (tmp_path / "docs/scenes.md").read_text()
    assert re.findall(r"^## (\w+)$", page, re.MULTILINE) == ["mine", "workbench"]
    assert "| motion | 100 time slices per second, interpolated with an error of at most 2.5 % |" in page
    for name in re.findall(r"\]\((pictures/\S+)\)", page):
        assert 1000 < (tmp_path / "docs" / name).stat().st_size < 150_000
    links = re.findall(r"\[SOURCE.md\]\((\S+)\)", page)
    assert [(tmp_path / "docs" / link).resolve() for link in links] == [
        scene.folder / "SOURCE.md",
        test_scenes / "workbench/SOURCE.md",
    ]
    assert "| family | `tilt_deg` -20 to 20; `square_mm` 1, 2, 3 |" in page
    mine("target: [card]", "target: [cart]")
    assert write("mine") == 1
    assert "mine could not be drawn: " in capsys.readouterr().err
