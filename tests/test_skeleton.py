"""Scenes begun: the skeletons are whole scenes, an exported one gets its card, nothing is overwritten."""

import shutil

import numpy as np
import pytest
from small import SCENES

from saf_gen.camera import get_sensor
from saf_gen.checks import check_scene
from saf_gen.errors import BadInput
from saf_gen.render import variant
from saf_gen.scene import find_scene, scene_at
from saf_gen.skeleton import new_scene, take_over

VARIANT = "llvm" if variant.probe().llvm_usable else "scalar"
EXPORTED = SCENES / "workbench/scene.xml"


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with nothing in it."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", ["script", "xml"])
def test_a_skeleton_passes_all_checks_as_it_is(here, kind):
    """Before the middle of the vidar_400x250: pixels of its size, but few of them."""
    sensor = get_sensor("vidar_400x250", rows=64, columns=100)
    written = new_scene("mine", here / "scenes", kind=kind)
    assert {p.name for p in written} >= {"scene.yaml", "SOURCE.md"}
    for path in (p for p in written if p.suffix in (".yaml", ".md", ".py", ".xml")):
        assert "NAME" not in path.read_text()
    found = list(check_scene(find_scene("mine"), sensor, variant=VARIANT))
    assert [f for f in found if f.level != "ok"] == []
    assert {f.check for f in found} == set(
        ("licence", "source", "geometry", "units", "reach", "exposure", "detail", "curve", "family")
    )


def test_every_key_of_the_skeletons_is_explained(here):
    for kind in ("script", "xml"):
        new_scene(f"a_{kind}", here / "scenes", kind=kind)
        lines = (here / f"scenes/a_{kind}/scene.yaml").read_text().splitlines()
        assert sum("#" in line for line in lines) > 12


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("My Scene", "a scene cannot be called 'My Scene'; allowed: lower-case .*; did you mean 'my_scene'"),
        ("../up", "cannot be called '../up'; .*did you mean 'up'"),
        ("", "cannot be called ''"),
        ("camel", "there is a scene 'camel' already; choose another name"),
    ],
)
def test_a_name_that_cannot_be_is_refused(here, name, told):
    with pytest.raises(BadInput, match=told):
        new_scene(name, here / "scenes")
    assert not (here / "scenes").exists()


@pytest.mark.parametrize("begin", [new_scene, lambda *where: take_over(EXPORTED, *where)])
def test_nothing_is_overwritten(here, begin):
    folder = here / "scenes/mine"
    folder.mkdir(parents=True)
    (folder / "notes").write_text("mine")
    with pytest.raises(BadInput, match="mine is there already; choose another name, or remove it"):
        begin("mine", here / "scenes")
    assert [p.name for p in folder.iterdir()] == ["notes"]


def test_an_exported_scene_gets_a_card_with_its_own_camera(here):
    """The file's camera is at (0, 0.2, 0.55), sees 18.18 degrees, and looks at the crate's front, z = 0."""
    take_over(EXPORTED, "bench", here / "scenes")
    scene = find_scene("bench")
    card, hand = scene.card, scene_at(SCENES / "workbench").card
    assert card.camera.origin_m == pytest.approx(hand.camera.origin_m, abs=1e-6)
    axes = [np.subtract(c.camera.look_at_m, c.camera.origin_m) for c in (card, hand)]
    assert np.cross(*axes) == pytest.approx(0, abs=1e-6)
    assert card.camera.look_at_m[2] == pytest.approx(0, abs=1e-6)
    assert card.target == ("mesh-Crate.001",)
    assert {g: tuple(e) for g, e in card.lights.items()} == {"world": ("World",), "lamp": ("emit-Lamp",)}
    image = float(
        scene.drive().image_distance(scene.drive().best_position(0.55 / np.cos(np.arctan(0.26875))))
    )
    assert 2 * np.degrees(np.arctan(4e-3 / image)) == pytest.approx(18.180556, rel=2e-3)
    assert scene.drive().reach_m[0] < 0.57 < scene.drive().reach_m[1]
    folder = here / "scenes/bench"
    assert (folder / "scene.xml").read_bytes() == EXPORTED.read_bytes()
    assert (folder / "meshes/Crate.001.ply").is_file()
    assert (folder / "textures/print.png").is_file()


@pytest.fixture
def edited(tmp_path):
    """A copy of the exported folder with text in its scene.xml replaced; gives the path of that."""

    def edit(*pairs):
        shutil.copytree(SCENES / "workbench", tmp_path / "export")
        path = tmp_path / "export/scene.xml"
        for old, new in pairs:
            assert old in path.read_text()
            path.write_text(path.read_text().replace(old, new))
        return path

    return edit


@pytest.mark.parametrize(
    ("pairs", "told"),
    [
        (
            [('<sensor type="perspective"', '<sensor type="orthographic"')],
            "the scene has no perspective camera",
        ),
        ([('target="0.000000, 0.157000', 'target="0.000000, 9.157000')], "nothing lies in the middle of the"),
        ([("meshes/Ball.ply", "../Ball.ply")], "lies outside of the scene's folder"),
    ],
)
def test_an_export_that_cannot_be_taken_over_is_told(here, edited, pairs, told):
    path = edited(*pairs)
    with pytest.raises(BadInput, match=told):
        take_over(path, "bench", here / "scenes")
    assert not (here / "scenes/bench").exists()


def test_an_export_without_lamps_is_told(here, edited):
    text = EXPORTED.read_text()
    world = text[text.index("\t<emitter type=") : text.index('\t<shape type="rectangle"')]
    lamp = text[text.index('\t\t<emitter type="area"') : text.index('\t\t<bsdf type="null"')]
    with pytest.raises(BadInput, match="the scene has no lamp; export its lamps, or add one"):
        take_over(edited((world, ""), (lamp, "")), "bench", here / "scenes")


@pytest.mark.parametrize(("axis", "across"), [("x", 1.0), ("y", 1.6), ("smaller", 1.6), ("larger", 1.0)])
def test_the_field_is_that_of_the_files_axis(here, edited, axis, across):
    path = edited(('name="fov_axis" value="x"', f'name="fov_axis" value="{axis}"'))
    take_over(path, "bench", here / "scenes")
    scene = find_scene("bench")
    image = float(scene.drive().image_distance(scene.drive().best_position(0.5695)))
    assert 4e-3 / image == pytest.approx(across * np.tan(np.radians(18.180556) / 2), rel=2e-3)


def test_lamps_of_odd_names_make_groups_that_a_card_can_have(here, edited):
    path = edited(('id="World" name="World"', 'id="Key: [1]" name="World"'), ('"emit-Lamp"', '"light_Key 1"'))
    take_over(path, "bench", here / "scenes")
    assert dict(find_scene("bench").card.lights) == {"key_1": ("Key: [1]",), "key_1_2": ("light_Key 1",)}
