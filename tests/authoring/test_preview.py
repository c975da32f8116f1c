"""Contact sheets of a stack and of a scene, and images side by side."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from refusals import refusal
from written_scenes import VARIANT

from saf_gen.authoring.contact_sheet import (
    ContactSheet,
    _Cell,
    _draw_sheet,
    _list_cells,
    choose_columns,
    draw_sheet,
    write_preview,
)
from saf_gen.authoring.scene_sheet import make_sheet, preview_scene
from saf_gen.authoring.template import scene_from_template
from saf_gen.camera import get_sensor
from saf_gen.core.display_tone import display_gamma, white_level
from saf_gen.core.figure_style import COLUMN_STYLE, use_plot_style
from saf_gen.errors import BadInput
from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.scene.scene_folder import find_scene, scene_names
from saf_gen.stack.focal_stack import FocalStack, StackSpec

pytestmark = pytest.mark.usefixtures("readable_figures")

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


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "light"), [("stage", 1), ("focal_length", 0)])
def test_a_sheet_of_a_stack_is_a_picture_of_the_stated_size(tmp_path, drive, light):
    """Also of a dark one whose target is nowhere."""
    stack = stack_of(*DRIVES[drive], target=None if light else np.zeros((20, 32), bool))
    stack.radiance[:] *= light
    assert np.isfinite(ContactSheet("it", stack, SENSOR).true_focus) == bool(light)
    write_preview(stack, SENSOR, path=tmp_path / "preview" / "plane.png")
    picture, size = grey(tmp_path / "preview" / "plane.png")
    assert size[0] == 1600
    assert picture.std() > 20 * light
    assert [p.name for p in (tmp_path / "preview").iterdir()] == ["plane.png"]


def test_three_to_five_images_are_in_a_row_and_at_most_two_are_missing():
    columns = {count: choose_columns(count) for count in range(1, 60)}
    assert set(columns.values()) == {3, 4, 5}
    assert all(-count % across <= 2 for count, across in columns.items())
    assert [columns[count] for count in (4, 5, 6, 7, 8, 9, 10, 12)] == [4, 5, 3, 4, 4, 3, 5, 4]


def drawn(sheet, cells):
    with use_plot_style(COLUMN_STYLE):
        return _draw_sheet(sheet, cells)


def assert_legible(figure):
    """Assert that titles, captions and labels of axes overlap no other and no image, and are in the figure."""
    figure.draw_without_rendering()
    labels = [text for axes in figure.axes for text in (axes.title, axes.xaxis.label, axes.yaxis.label)]
    texts = [text for text in (*figure.texts, *labels) if text.get_text()]
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    images = [(f"image {n}", axes.get_window_extent()) for n, axes in enumerate(figure.axes) if axes.images]
    for n, (words, box) in enumerate(boxes):
        assert min(box.x0, box.y0, figure.bbox.x1 - box.x1, figure.bbox.y1 - box.y1) >= 0, words
        for others, other in (*boxes[:n], *images):
            apart = max(box.x0 - other.x1, other.x0 - box.x1, box.y0 - other.y1, other.y0 - box.y1)
            assert apart >= 0, f"{words} | {others}"


@pytest.fixture(scope="module")
def longest():
    """The longest title of a scene with its lens, and the longest name of a light, among the scenes of the project."""
    cards = [find_scene(name).card for name in scene_names()]
    titles = (f"{card.id}: {card.title} ({card.lens.summary})" for card in cards)
    return max(titles, key=len), max((light for card in cards for light in card.lights), key=len)


LONGER = "_at_the_far_end_of_the_long_bench.001" + " in words" * 20


@pytest.mark.slow
@pytest.mark.parametrize(("panels", "more"), [(5, ""), (3, LONGER), (9, LONGER)], ids=["5", "3 longer", "9 longer"])
def test_no_title_overlaps_another_or_leaves_the_sheet(longest, panels, more):
    title, light = longest
    captions = [
        "the target is not in the image:\n0.437, in focus 0.019762 m",
        "depth 0.07185 (dark) to 0.07903 m,\nthe target outlined",
        *(f"light of {light}{more}_{n} alone,\nat gain 1" for n in range(3)),
        *["the target alone,\nat one end of the travel"] * 4,
    ]
    cells = [_Cell(caption, np.zeros((20, 32))) for caption in captions[-panels:]]
    assert_legible(drawn(ContactSheet(title + more, stack_of(*DRIVES["stage"]), SENSOR), cells))


@pytest.mark.slow
@pytest.mark.parametrize(("lights", "contrast", "sharp"), [(2, 0.02, True), (3, 0.001, False), (8, 1, True)])
def test_the_sheet_of_any_scene_is_legible(longest, lights, sharp, contrast):
    """Sheets of datasets lack the image with everything sharp; three lights make seven images then.

    Small contrasts have long numbers beside their axis.
    """
    title, light = longest
    stack = stack_of(*DRIVES["image_distance"])
    radiance = 1 + contrast * (np.resize(stack.radiance, (lights, 5, 20, 32)) - 0.5)
    spec = replace(stack.spec, groups=tuple(f"{light}{n}" for n in range(lights)))
    sheet = ContactSheet(title, replace(stack, spec=spec, radiance=radiance), SENSOR, radiance[0, 2] if sharp else None)
    assert_legible(drawn(sheet, _list_cells(sheet)))


@pytest.mark.slow
def test_a_sheet_is_a_figure_of_the_kind_that_its_name_says(tmp_path):
    sheet = ContactSheet("it", stack_of(*DRIVES["image_distance"]), SENSOR)
    draw_sheet(sheet, tmp_path / "it.svg")
    assert "<svg" in (tmp_path / "it.svg").read_text()
    assert refusal(draw_sheet, sheet, tmp_path / "it.jpg").allowed == ".png, .svg"


def test_display_white_is_the_brightest_percentile_and_grey_has_a_gamma():
    image = np.linspace(0, 2, 1001).reshape(7, 143)
    white = white_level(image)
    assert white == pytest.approx(1.99, abs=0.005)
    assert display_gamma(np.array([0, white / 2, white, 9]), white) == pytest.approx([0, 0.5 ** (1 / 2.2), 1, 1])
    assert white_level(np.zeros((3, 3))) == 1


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
def test_a_sheet_of_a_scene_shows_its_lights_and_its_family(mine):
    sheet = make_sheet(mine(), SENSOR, backend=VARIANT)
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
    sheet = make_sheet(scene.with_params({"square_mm": 3}), SENSOR, backend=VARIANT)
    moments = {word: picture for word, picture in sheet.small_images if word.endswith(" s")}
    assert list(moments) == ["0.00 s", "1.00 s"]
    assert np.abs(moments["0.00 s"] - moments["1.00 s"]).mean() > 0.05 * moments["0.00 s"].mean()


@pytest.mark.slow
def test_a_scene_whose_target_is_out_of_reach_is_drawn(mine, tmp_path):
    """Its author needs the picture to see what is wrong."""
    preview_scene(mine("[0.65, 0.40]", "[2.0, 1.0]"), SENSOR, path=tmp_path / "it.png", backend=VARIANT)
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
    before = find_scene("mine").digest
    code, out, err = call_scenes("preview", "mine")
    assert (code, err) == (0, "")
    assert (tmp_path / "scenes/mine/preview.png").is_file()
    assert find_scene("mine").digest == before
    drawn = []
    monkeypatch.setattr(
        "saf_gen.authoring.scene_sheet.preview_scene",
        lambda scene, sensor, *, progress, **how: drawn.append((scene.id, how)),
    )
    assert call_scenes("preview", "scenes/mine", "--out", "it.png")[0] == 0
    assert drawn == [("mine", {"path": Path("it.png"), "backend": VARIANT})]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("new", "Mine"), "did you mean 'mine'?"),
        (("new", "mine", "--xml", "--from", "x.xml"), "--xml and --from are both given; leave --xml out"),
        (("new", "mine", "--camera", "Eye"), "--camera is given without --from; write the camera of a template on its"),
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


def test_a_sheet_of_another_ending_is_refused_before_anything_is_rendered(tmp_path, monkeypatch):
    monkeypatch.setattr("saf_gen.authoring.scene_sheet.make_sheet", lambda *args, **how: pytest.fail("rendered"))
    for name in ("sheet", "sheet.jpg", "sheet.PNG.gz"):
        assert ".png" in refusal(preview_scene, None, SENSOR, path=tmp_path / name).allowed


def test_show_says_what_a_scene_is_and_where_its_picture_is(call):
    code, out, _ = call("scenes", "show", "fan")
    shown = " ".join(out.split())
    assert code == 0
    for text in (
        "lens 35 mm f/1.2",
        "light groups lamp (key, 1250 lux), daylight (fill, 800 lux)",
        "target target_body, target_hub",
        "blades one of 3, 4, 5; phase_deg 0 to 360",
        "moves yes, 625 slices per second",
        "licence Apache-2.0",
        "saf-gen scenes preview fan",
    ):
        assert text in shown
    assert "0.5 to 5 (log-uniform)" in " ".join(call("scenes", "show", "assorted_moving")[1].split())
    assert call("scenes", "show", "fann")[0] == 2


def test_one_of_several_scenes_that_cannot_be_drawn_costs_itself_alone(call, call_scenes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def draw(scene, sensor, *, path, **options):
        if scene.id == "bad":
            raise BadInput("it is empty")
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"drawn")

    monkeypatch.setattr("saf_gen.authoring.scene_sheet.preview_scene", draw)
    for name in ("mine", "bad", "yours"):
        assert call("scenes", "new", name)[0] == 0
    code, out, err = call_scenes("preview", "mine", "bad", "yours", "mine", "--out", "sheets")
    assert code == 1
    assert sorted(path.name for path in (tmp_path / "sheets").iterdir()) == ["mine.png", "yours.png"]
    assert out.split() == ["sheets/mine.png", "sheets/yours.png"]
    assert "it is empty" in err
    code, _, err = call_scenes("preview", "mine", "yours", "--out", "one.png")
    assert code == 2
    assert "one.png is one file for 2 scenes" in err
    assert not (tmp_path / "one.png").exists()
