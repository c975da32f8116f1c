"""Contact sheets of a stack and of a scene, and images side by side."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from refusals import refusal
from written_scenes import VARIANT

from saf_gen.authoring.preview import ContactSheet, draw_preview_sheet, save_preview_image_grid, write_scene_preview
from saf_gen.authoring.preview.contact_sheet import _list_cells, choose_preview_columns
from saf_gen.authoring.preview.scene_sheet import make_preview_sheet, preview_scene
from saf_gen.authoring.template import create_scene_from_template
from saf_gen.camera import get_sensor
from saf_gen.core.display_tone import apply_display_gamma, find_display_white_level
from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.focal_stack import FocalStack, StackSpec

SENSOR = get_sensor("vidar_400x250", rows=20, columns=32, pitch_m=60e-6)
DRIVES = {
    "image_distance": (ImageDistanceDrive(0.025, 2.0, (0.6, 0.42)), 0.5),
    "focal_length": (FocalLengthDrive(0.026, 2.0, (0.6, 0.42)), 0.5),
    "stage": (Stage(0.004, 1.1, 20.0, (-30e-6, 30e-6)), 0.0042),
}


def stack_of(drive, depth_m, target=None):
    spec = StackSpec("plane", "0" * 64, ("lamp", "room"), drive, 20, 32, 60e-6, 5, 16, 4)
    radiance = np.random.default_rng(0).random((2, 5, 20, 32), dtype=np.float32)
    if target is None:
        target = np.ones((20, 32), dtype=bool)
        target[:, :10] = False
    return FocalStack(spec, radiance, np.full((20, 32), depth_m, dtype=np.float32), target, "llvm")


def grey(path):
    with Image.open(path) as picture:
        return np.asarray(picture.convert("L")), picture.size


@pytest.mark.parametrize("kind", [pytest.param("image_distance", marks=pytest.mark.long), "focal_length", "stage"])
@pytest.mark.slow
def test_a_sheet_of_a_stack_is_a_picture_of_the_stated_size(tmp_path, kind):
    """The labels fit with each drive; other tests below draw the sheet of the first."""
    write_scene_preview(stack_of(*DRIVES[kind]), SENSOR, path=tmp_path / "preview" / "plane.png")
    picture, size = grey(tmp_path / "preview" / "plane.png")
    assert size[0] == 1600
    assert picture.std() > 20
    assert [p.name for p in (tmp_path / "preview").iterdir()] == ["plane.png"]


@pytest.mark.slow
@pytest.mark.parametrize("everywhere", [False, True])
def test_a_target_that_is_nowhere_or_everywhere_is_drawn_all_the_same(tmp_path, everywhere):
    stack = stack_of(*DRIVES["image_distance"], target=np.full((20, 32), everywhere))
    assert np.isnan(ContactSheet("it", stack, SENSOR).true_focus) != everywhere
    write_scene_preview(stack, SENSOR, path=tmp_path / "it.png")
    assert grey(tmp_path / "it.png")[1][0] == 1600


def test_a_dark_stack_is_drawn_all_the_same(tmp_path):
    stack = stack_of(*DRIVES["image_distance"])
    stack.radiance[:] = 0
    write_scene_preview(stack, SENSOR, path=tmp_path / "it.png")
    assert grey(tmp_path / "it.png")[1][0] == 1600


def sheet_with(small):
    """Return a stack, and its sheet with this number of small images."""
    stack = stack_of(*DRIVES["image_distance"])
    pictures = [(f"member {n}", stack.radiance[0, 0]) for n in range(small)]
    return stack, ContactSheet("it", stack, SENSOR, stack.radiance[0, 2], pictures)


@pytest.mark.parametrize("small", range(7))
def test_so_many_images_are_listed_that_they_fill_their_rows(small):
    cells = _list_cells(sheet_with(small)[1])
    assert len(cells) % choose_preview_columns(len(cells)) == 0
    assert len(cells) - 7 - small == (small in (4, 6))  # the target fills the gap that 11 or 13 images would leave


MORE = (1, 2, 3, 5, 6)
DRAWN = [4, pytest.param(0, marks=pytest.mark.slow), *(pytest.param(n, marks=pytest.mark.long) for n in MORE)]
"""First twelve images, one of them added to fill a row; then seven in one row; then the others."""


@pytest.mark.parametrize("small", DRAWN)
def test_images_leave_no_gap_in_their_grid(tmp_path, small):
    """No cell is white, the colour of empty cells, in its middle."""
    stack, sheet = sheet_with(small)
    draw_preview_sheet(sheet, tmp_path / "it.png")
    picture, _ = grey(tmp_path / "it.png")
    images = 5 + len(stack.spec.groups) + small
    count = next(n for n in (images, images + 1) if n % choose_preview_columns(n) == 0)
    across = choose_preview_columns(count)
    cell = (7.16 - 0.06 * (across + 1)) / across
    for n in range(count):
        x = 0.06 + n % across * (cell + 0.06) + cell / 2
        y = 0.22 + n // across * (0.26 + cell * 20 / 32 + 0.06) + 0.26 + cell * 20 / 64
        here = picture[int(y * 1600 / 7.16) - 4 :, int(x * 1600 / 7.16) - 4 :][:8, :8]
        assert here.min() < 250, n


@pytest.mark.slow
def test_a_sheet_is_a_figure_of_the_kind_that_its_name_says(tmp_path):
    sheet = ContactSheet("it", stack_of(*DRIVES["image_distance"]), SENSOR)
    draw_preview_sheet(sheet, tmp_path / "it.pdf")
    assert (tmp_path / "it.pdf").read_bytes().startswith(b"%PDF")
    assert refusal(draw_preview_sheet, sheet, tmp_path / "it.jpg").allowed == ".pdf, .png, .svg"


def test_display_white_is_the_brightest_percentile_and_grey_has_a_gamma():
    image = np.linspace(0, 2, 1001).reshape(7, 143)
    white = find_display_white_level(image)
    assert white == pytest.approx(1.99, abs=0.005)
    assert apply_display_gamma(np.array([0, white / 2, white, 9]), white) == pytest.approx([0, 0.5 ** (1 / 2.2), 1, 1])
    assert find_display_white_level(np.zeros((3, 3))) == 1


def test_a_grid_is_as_small_as_asked_for(tmp_path):
    noise = 0.3 + 0.4 * np.random.default_rng(0).random((250, 400))
    save_preview_image_grid([[noise, noise, noise], [noise]], tmp_path / "it.jpg", max_bytes=150_000)
    assert (tmp_path / "it.jpg").stat().st_size < 150_000
    picture, size = grey(tmp_path / "it.jpg")
    assert size == (3 * 400 + 8, 2 * 250 + 4)
    assert picture[260:, 500:].min() > 240


@pytest.fixture
def mine(tmp_path, own_folder):
    """A function that edits the card of the scene ``mine``, made from a template, and returns the scene."""
    create_scene_from_template("mine", tmp_path / "scenes")

    def edit(old="", new=""):
        card = tmp_path / "scenes/mine/scene.yaml"
        assert old in card.read_text()
        card.write_text(card.read_text().replace(old, new, 1))
        return find_scene("mine")

    return edit


def test_a_sheet_of_a_scene_shows_its_lights_and_its_family(mine):
    sheet = make_preview_sheet(mine(), SENSOR, backend=VARIANT)
    assert sheet.stack.spec.groups == ("lamp", "room")
    assert [word for word, _ in sheet.small_images] == ["member 1", "member 2"]
    members = [picture for _, picture in sheet.small_images]
    assert members[0].shape == (10, 16)
    assert np.abs(members[0] - members[1]).mean() > 0.05 * members[0].mean()
    assert sheet.sharp.shape == (20, 32)
    assert 0.1 < sheet.true_focus < 0.9


@pytest.mark.slow
def test_a_sheet_of_a_scene_that_moves_shows_moments(mine):
    words = "motion: {card: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: [0.04, 0, 0]}]}}\nparams:"
    scene = mine("params:", words)
    sheet = make_preview_sheet(scene.with_params({"square_mm": 3}), SENSOR, backend=VARIANT)
    moments = {word: picture for word, picture in sheet.small_images if word.endswith(" s")}
    assert list(moments) == ["0.00 s", "1.00 s"]
    assert np.abs(moments["0.00 s"] - moments["1.00 s"]).mean() > 0.05 * moments["0.00 s"].mean()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new"),
    [("[0.65, 0.40]", "[2.0, 1.0]"), ("origin_m: [0, 0, 0.5]", "origin_m: [0, 5, 0.5]")],
    ids=["out of reach", "out of sight"],
)
def test_a_scene_whose_target_is_not_where_it_should_be_is_drawn(mine, tmp_path, old, new):
    """Its author needs the picture to see what is wrong."""
    scene = mine(old, new) if "origin" not in old else mine(old, new + "\n  # aside")
    if "origin" in old:
        scene = mine("look_at_m: [0, 0, 0]", "look_at_m: [0, 5, 0]")
    preview_scene(scene, SENSOR, path=tmp_path / "it.png", backend=VARIANT)
    assert grey(tmp_path / "it.png")[1][0] == 1600


def test_a_scene_that_cannot_be_built_is_refused(mine, tmp_path):
    scene, path = mine("target: [card]", "target: [cart]"), tmp_path / "it.png"
    assert refusal(preview_scene, scene, SENSOR, path=path, backend=VARIANT).nearest == "card"
    assert not path.exists()


# --- the commands -------------------------------------------------------------------------------------


@pytest.fixture
def call_scenes(call, small_sensor):
    """A function that runs a command of ``saf-gen scenes`` with a small sensor."""
    return lambda *arguments: call("scenes", *arguments, "--sensor", small_sensor, "--variant", VARIANT)


@pytest.mark.slow
def test_new_then_preview(call, call_scenes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = call("scenes", "new", "mine")
    assert (code, err) == (0, "")
    assert re.findall(r"scenes/mine/(\S+)", out) == ["SOURCE.md", "scene.py", "scene.yaml"]
    assert "next: saf-gen scenes check mine; saf-gen scenes preview mine; then write its licence into scene.yaml" in out
    before = find_scene("mine").digest
    code, out, err = call_scenes("preview", "mine")
    assert (code, err) == (0, "")
    assert (tmp_path / "scenes/mine/preview.png").is_file()
    assert find_scene("mine").digest == before
    drawn = []
    monkeypatch.setattr(
        "saf_gen.authoring.preview.scene_sheet.preview_scene",
        lambda scene, sensor, **how: drawn.append((scene.id, how)),
    )
    assert call_scenes("preview", "scenes/mine", "--out", "it.png")[0] == 0
    assert drawn == [("mine", {"path": Path("it.png"), "backend": VARIANT})]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("new", "Mine"), "did you mean 'mine'?"),
        (("new", "mine", "--xml", "--from", "x.xml"), "--xml and --from are both given; leave --xml out"),
        (("new", "mine", "--from", "x.xml"), "x.xml cannot be read: No such file or directory"),
        (("preview", "mein"), "unknown scene 'mein'"),
    ],
)
def test_bad_input_is_one_line(call, tmp_path, monkeypatch, args, message):
    monkeypatch.chdir(tmp_path)
    code, _, err = call("scenes", *args)
    assert code == 2
    assert len(err.strip().splitlines()) == 1
    assert message in err
    assert list(tmp_path.iterdir()) == []
