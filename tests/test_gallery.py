"""The gallery of scenes that tools/write_gallery.py writes, docs/scenes.md."""

import re

import numpy as np
import pytest
from PIL import Image
from small_dataset import HERE
from written_scenes import VARIANT

from saf_gen.authoring.template import scene_from_template
from saf_gen.scene.scene_folder import find_scene

MOVES = "motion: {card: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: [0.01, 0, 0]}]}}\n"


@pytest.fixture
def gallery(monkeypatch):
    """The module that writes the gallery."""
    monkeypatch.syspath_prepend(HERE.parent / "tools")
    import write_gallery

    return write_gallery


@pytest.fixture
def write(gallery, small_sensor, tmp_path):
    """A function that writes the gallery of some scenes to ``docs`` and returns the exit code."""
    options = ["--out", str(tmp_path / "docs"), "--sensor", str(small_sensor), "--variant", VARIANT, "--samples", "16"]
    return lambda *scenes: gallery.main([*scenes, *options])


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
    assert "Scenes that move: `mine`." in page
    assert ", 100 slices per second, " in page
    pictures = re.findall(r"\]\((pictures/[^)]+)\)", page)
    assert len(pictures) == 4  # a thumbnail and a picture of each
    for name in pictures:
        assert 500 < (tmp_path / "docs" / name).stat().st_size < 150_000
    links = re.findall(r"\[SOURCE.md\]\((\S+)\)", page)
    assert [(tmp_path / "docs" / link).resolve() for link in links] == [
        scene.folder / "SOURCE.md",
        test_scenes / "workbench/SOURCE.md",
    ]
    mine("target: [card]", "target: [cart]")
    assert write("mine") == 1
    assert "mine could not be drawn: " in capsys.readouterr().err
    drawn = (tmp_path / "docs" / pictures[0]).stat().st_mtime_ns
    assert write("workbench", "--keep") == 0
    assert (tmp_path / "docs" / pictures[0]).stat().st_mtime_ns == drawn


def test_thumbnails_lead_to_their_sections(gallery):
    table = gallery.thumbnail_table(["coin", "fan", "two_planes"])
    assert "[![fan](pictures/scenes/thumbnails/fan.jpg)](#fan)" in table
    assert len({line.count("|") for line in table.splitlines()}) == 1


@pytest.mark.parametrize("count", [4, 5, 13, 38, 57])
def test_the_last_row_of_thumbnails_is_nearly_full(gallery, count):
    last = gallery.thumbnail_table([f"scene{n}" for n in range(count)]).splitlines()[-1]
    cells = [cell.strip() for cell in last.strip("|").split("|")]
    assert cells.count("") <= 3


@pytest.mark.parametrize("small", [(3, 1), (6, 2)], ids=["one kind", "two kinds"])
def test_every_row_fills_the_width_and_has_legible_labels(gallery, tmp_path, small):
    count, shrink = small
    black = np.zeros((250, 400))
    upper = [(label, black) for label in ("near end", "in focus", "far end")]
    lower = [(f"t = {n}.00 s", black[::shrink, ::shrink]) for n in range(count)]
    gallery.save_grid([upper, lower], tmp_path / "it.jpg", max_bytes=10**6)
    with Image.open(tmp_path / "it.jpg") as picture:
        grey = np.asarray(picture)
    assert grey.shape == (2 * 26 + 250 + 250 // shrink, 1220)
    for row, height in ((26, 250), (302, 250 // shrink)):
        images = grey[row + 8 : row + height - 8]
        assert (images[:, [8, -8]] < 40).all()  # from edge to edge
        assert (images > 200).any(axis=0).sum() < 40  # narrow gaps
        strip = grey[row - 26 : row]
        assert strip.min() < 90
        assert (strip[[0, -1]] > 150).mean() > 0.95  # letters end within their strip
