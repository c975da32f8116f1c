"""New scenes: templates are complete, an exported scene gets a card, and nothing is overwritten."""

import shutil

import numpy as np
import pytest
from refusals import refusal
from small_dataset import SCENES
from written_scenes import VARIANT

from saf_gen.authoring.checks import check_scene
from saf_gen.authoring.template import scene_from_export, scene_from_template
from saf_gen.camera import get_sensor
from saf_gen.scene.scene_folder import find_scene, load_scene
from saf_gen.scene.xml import read_scene_xml

EXPORTED = SCENES / "workbench/scene.xml"


@pytest.fixture
def here(own_folder):
    return own_folder


@pytest.mark.slow
def test_a_skeleton_passes_all_checks_but_for_a_licence_that_nobody_has_set(here):
    """tests/authoring/test_checks.py has the one with a script. The sensor is the middle of the vidar_400x250."""
    sensor = get_sensor("vidar_400x250", rows=40, columns=64)
    written = scene_from_template("mine", here / "scenes", kind="xml")
    assert {p.name for p in written} >= {"scene.yaml", "SOURCE.md"}
    for path in (p for p in written if p.suffix in (".yaml", ".md", ".xml")):
        assert "NAME" not in path.read_text()
    found = list(check_scene(find_scene("mine"), sensor, backend=VARIANT))
    assert [(f.check, f.level) for f in found if f.level != "ok"] == [("licence", "warning")]
    assert {f.check for f in found} == set(
        ("licence", "source", "geometry", "repeat", "units", "reach", "exposure", "detail", "curve", "grain", "family")
    )


@pytest.mark.parametrize(("name", "nearest"), [("My Scene", "my_scene"), ("../up", "up"), ("", ""), ("camel", "")])
def test_a_name_that_cannot_be_is_refused(here, name, nearest):
    error = refusal(scene_from_template, name, here / "scenes")
    assert repr(name) in error.problem
    assert error.nearest == nearest
    assert not (here / "scenes").exists()


@pytest.mark.parametrize(
    "begin", [scene_from_template, lambda name, root: scene_from_export(EXPORTED, name, root=root)]
)
def test_nothing_is_overwritten(here, begin):
    folder = here / "scenes/mine"
    folder.mkdir(parents=True)
    (folder / "notes").write_text("mine")
    assert "mine already exists" in refusal(begin, "mine", here / "scenes").problem
    assert [p.name for p in folder.iterdir()] == ["notes"]


def test_an_exported_scene_gets_a_card_with_its_own_camera(here):
    """The camera in the file is at (0, 0.2, 0.55), sees 18.18 degrees, and looks at the front of the crate, z = 0."""
    scene_from_export(EXPORTED, "bench", root=here / "scenes")
    scene = find_scene("bench")
    card, hand = scene.card, load_scene(SCENES / "workbench").card
    assert card.camera.origin_m == pytest.approx(hand.camera.origin_m, abs=1e-6)
    axes = [np.subtract(c.camera.look_at_m, c.camera.origin_m) for c in (card, hand)]
    assert np.cross(*axes) == pytest.approx(0, abs=1e-6)
    assert card.camera.look_at_m[2] == pytest.approx(0, abs=1e-6)
    assert card.target == ("mesh-Crate.001",)
    assert {g: tuple(e) for g, e in card.lights.items()} == {"world": ("World",), "lamp": ("emit-Lamp",)}
    image = float(
        scene.build_drive().image_distance(scene.build_drive().best_position(0.55 / np.cos(np.arctan(0.26875))))
    )
    assert 2 * np.degrees(np.arctan(4e-3 / image)) == pytest.approx(18.180556, rel=2e-3)
    assert scene.build_drive().focusing_range_m[0] < 0.57 < scene.build_drive().focusing_range_m[1]
    folder = here / "scenes/bench"
    assert (folder / "scene.xml").read_bytes() == EXPORTED.read_bytes()
    assert (folder / "meshes/Crate.001.ply").is_file()
    assert (folder / "textures/print.png").is_file()


@pytest.fixture
def edited(tmp_path):
    """A function that replaces text in the scene.xml of a copied export, and returns its path."""

    def edit(*pairs):
        shutil.copytree(SCENES / "workbench", tmp_path / "export")
        path = tmp_path / "export/scene.xml"
        for old, new in pairs:
            assert old in path.read_text()
            path.write_text(path.read_text().replace(old, new))
        return path

    return edit


def element(begin, end):
    """Return the edit that removes a part of the exported file."""
    text = EXPORTED.read_text()
    return text[text.index(begin) : text.index(end)], ""


FOV = "18.180556"
WORLD = element("\t<emitter type=", '\t<shape type="rectangle"')
LAMP = element('\t\t<emitter type="area"', '\t\t<bsdf type="null"')
LOOK = '<lookat origin="0.000000, 0.200000, 0.550000" target="0.000000, 0.157000, 0.390000" up="0, 1, 0"/>'


def thin(radius):
    """Return the edit that gives the camera in the file an aperture."""
    at = '<sensor type="perspective" id="Camera" name="Camera">'
    return at, f'{at.replace("perspective", "thinlens")}<float name="aperture_radius" value="{radius}"/>'


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ([('<sensor type="perspective"', '<sensor type="orthographic"')], "no perspective camera"),
        ([('target="0.000000, 0.157000', 'target="0.000000, 9.157000')], "nothing is in the middle"),
        ([("meshes/Ball.ply", "../Ball.ply")], "is outside the scene's folder"),
        ([(FOV, "wide")], "scene.xml:16: the number is 'wide'; allowed: a number with a decimal point"),
        ([(FOV, "0.1")], "no card can describe this camera: the lens of 506.6 mm cannot focus at 0.4271 m; allowed"),
        ([(FOV, "nan")], "the camera's field of view is nan degrees; allowed: above 0, below 180"),
        ([('name="fov_axis" value="x"', 'name="fov_axis" value="longest"')], "The 'fov_axis' parameter"),
        (
            [('name="fov_axis" value="x"', 'name="focal_length" value="85mm"')],
            "the camera's field of view: Please specify either a focal length",
        ),
        ([WORLD, LAMP], "no lamp"),
        ([(LOOK, '<scale value="0"/>')], "to_world of the camera gives it no direction"),
        ([thin("nan")], "aperture_radius of the camera is nan; allowed"),
        ([thin(1e-5)], "0.5695 m away, f/1.2e+03 blurs the target by 0.015 pixels"),
    ],
)
def test_an_export_that_cannot_be_used_is_refused(here, edited, pairs, message):
    error = refusal(scene_from_export, edited(*pairs), "bench", root=here / "scenes")
    assert message in str(error)
    assert not (here / "scenes").exists()


def test_after_a_refusal_the_same_name_can_be_used(here, edited):
    """The refused export leaves nothing behind and changes no file."""
    path = edited((FOV, "0.1"))
    scene_from_template("other", here / "scenes")
    kept = sorted(here.rglob("*"))
    error = refusal(scene_from_export, path, "bench", root=here / "scenes")
    assert "no card can describe this camera" in error.problem
    assert sorted(here.rglob("*")) == kept
    path.write_text(path.read_text().replace('value="0.1"', 'value="18"'))
    written = scene_from_export(path, "bench", root=here / "scenes")
    assert all(p.is_file() for p in written)
    assert {p.relative_to(here).as_posix() for p in written} == {
        p.relative_to(here).as_posix() for p in (here / "scenes/bench").rglob("*") if p.is_file()
    }
    assert [p.name for p in (here / "scenes").iterdir() if p.name.startswith(".")] == []
    assert find_scene("bench").id == "bench"


def test_a_folder_that_cannot_be_written_is_refused(here):
    (here / "scenes").write_text("a file")
    error = refusal(scene_from_template, "mine", here / "scenes")
    assert "scenes/mine cannot be written" in error.problem


def test_linked_files_are_copied_under_the_names_in_the_file(here, edited):
    path = edited()
    (path.parent / "data").mkdir()
    (path.parent / "meshes/Ball.ply").rename(path.parent / "data/a.ply")
    (path.parent / "meshes/Ball.ply").symlink_to(path.parent / "data/a.ply")
    scene_from_export(path, "bench", root=here / "scenes")
    folder = here / "scenes/bench"
    assert (folder / "meshes/Ball.ply").read_bytes() == (path.parent / "data/a.ply").read_bytes()
    assert not (folder / "meshes/Ball.ply").is_symlink()
    assert not (folder / "data").exists()
    copied = read_scene_xml(folder / "scene.xml", {})
    assert {name for name, _ in copied.files} >= {"meshes/Ball.ply", "textures/print.png"}


@pytest.mark.parametrize("name", ["scene.xml", "SOURCE.md"])
def test_a_file_with_the_name_of_one_of_the_scenes_files_is_refused(here, edited, name):
    path = edited(("textures/print.png", name)).rename(here / "export.xml")
    shutil.copytree(SCENES / "workbench/meshes", here / "meshes")
    shutil.copyfile(SCENES / "workbench/textures/print.png", here / name)
    error = refusal(scene_from_export, path, "bench", root=here / "scenes")
    assert repr(name) in error.problem
    assert "rename" in error.hint
    assert not (here / "scenes").exists()


@pytest.mark.parametrize(
    ("radius", "f_number"), [(0, 2.0), (0.005, None), (1.0, 1.0)], ids=["pinhole", "a lens", "very wide"]
)
def test_the_f_number_is_that_of_the_files_aperture(here, edited, radius, f_number):
    """It is f/(2R), at least f/1; a pinhole has no aperture, and gets f/2."""
    scene_from_export(edited(thin(radius)), "bench", root=here / "scenes")
    lens = find_scene("bench").card.lens
    expected = f_number or lens.focal_length_mm / 1000 / (2 * radius)
    assert lens.f_number == pytest.approx(expected, rel=5e-3)  # the card has three digits


FOV_X = ('<string name="fov_axis" value="x"/>', '<float name="fov" value="18.180556"/>')
FIELD = np.tan(np.radians(18.180556) / 2)
DIAGONAL = np.hypot(36, 24) / 2 * 1.6 / np.hypot(1.6, 1)
"""Half the diagonal of 36 × 24 mm, across our sensor of 8:5."""


@pytest.mark.parametrize(
    ("words", "tangent"),
    [
        (FOV_X[0].replace('"x"', '"y"') + FOV_X[1], 1.6 * FIELD),
        (FOV_X[0].replace('"x"', '"smaller"') + FOV_X[1], 1.6 * FIELD),
        (FOV_X[0].replace('"x"', '"larger"') + FOV_X[1], FIELD),
        ('<string name="focal_length" value="85mm"/>', DIAGONAL / 85),
        ("", DIAGONAL / 50),
    ],
    ids=["y", "smaller", "larger", "85 mm", "nothing"],
)
def test_the_field_is_that_of_the_files_axis_or_of_36_by_24_mm_with_its_focal_length(here, edited, words, tangent):
    path = edited((FOV_X[0], ""), (FOV_X[1], words))
    scene_from_export(path, "bench", root=here / "scenes")
    card = find_scene("bench").card
    distance = np.linalg.norm(np.subtract(card.camera.look_at_m, card.camera.origin_m))
    image = 1 / (1e3 / card.lens.focal_length_mm - 1 / distance)
    assert 4e-3 / image == pytest.approx(tangent, rel=2e-3)
    assert distance == pytest.approx(0.5695 * card.unit_m, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "group"),
    [("Key: [1]", "key_1"), ("Light-GEOMETRY", "geometry_lamp"), ("Light-CHOICE", "choice_lamp"), ("On", "on")],
)
def test_lamps_of_odd_names_make_groups_that_a_card_can_have(here, edited, name, group):
    """YAML would take ``on`` for a truth."""
    path = edited(('id="World" name="World"', f'id="{name}" name="World"'), ('"emit-Lamp"', '"light_Key 1"'))
    scene_from_export(path, "bench", root=here / "scenes")
    other = "key_1_2" if group == "key_1" else "key_1"
    assert dict(find_scene("bench").card.lights) == {group: (name,), other: ("light_Key 1",)}
