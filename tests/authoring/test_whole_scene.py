"""A glTF file with a camera is a whole scene: its cameras, lamps and gloss are taken, named or refused in a line."""

import numpy as np
import pytest
from mesh_cards import Gltf, blocks
from refusals import assert_says, refusal

from saf_gen.authoring.template import scene_from_export
from saf_gen.render.render_setup import SensorGrid
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import find_scene

GRID = SensorGrid(rows=5, columns=8, pitch_m=1e-3)
FAR = 3.0


@pytest.fixture
def take(own_folder):
    """Import a file as Blender writes it, and return the scene and the lines that were printed."""

    def import_scene(file, **how):
        lines = []
        scene_from_export(
            file.save(own_folder / "room.glb"), "room", root=own_folder / "scenes", notify=lines.append, **how
        )
        return find_scene("room"), lines

    return import_scene


def whole(*lamps, camera=None, material=None, cards=("card",), **eye):
    """Return a file of matt cards at z = 0, a camera 3 m away that sees 0.12 × 0.075 m, and lamps as nodes."""
    file = Gltf()
    number = file.add_material(name="paint", **(material or {"pbr": {"baseColorFactor": [0.6, 0.6, 0.6, 1]}}))
    for name in cards:
        file.add_card(name=name, material=number)
    file.add_node(**{"camera": 0, "name": "Eye", "translation": [0, 0, FAR], **eye})
    file.json["cameras"] = [
        {"type": "perspective", "perspective": {"yfov": 0.025, "aspectRatio": 1.6} | (camera or {})}
    ]
    lights = []
    for node, light in lamps:
        use = {"extensions": {"KHR_lights_punctual": {"light": len(lights)}}}
        file.add_node(**{"name": f"Lamp {len(lights)}", **use, **node})
        lights.append(light)
    if lights:
        file.json["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    return file


def turned(degrees):
    """Return the rotation of a node about x."""
    return [np.sin(np.radians(degrees) / 2), 0, 0, np.cos(np.radians(degrees) / 2)]


POINT = ({"translation": [0, 0, 2]}, {"type": "point", "intensity": 54_351.413})
SUN = ({"rotation": turned(60)}, {"type": "directional", "intensity": 683 * 3})
SPOT = (
    {"translation": [0, 0, 2], "scale": [2, 2, 2]},
    {"type": "spot", "intensity": 683 * 4, "spot": {"innerConeAngle": 0.78}},
)


@pytest.mark.parametrize(
    ("lamp", "irradiance"),
    [
        (POINT, 1000 / (4 * np.pi) / 2**2),  # Blender's 1,000 W
        (SUN, 3 * 0.5),
        (SPOT, 4 / 2**2),
        ((POINT[0], {**POINT[1], "color": [1, 0, 0]}), 0.2126 * 1000 / (4 * np.pi) / 2**2),
    ],
    ids=["point", "sun", "spot", "red"],
)
def test_a_lamp_lights_a_matt_plane_as_its_closed_form_says(take, lamp, irradiance):
    scene, _ = take(whole(lamp))
    renderer = SceneRenderer(scene, GRID, backend_name="scalar")
    picture = renderer.render_pinhole(0.5, samples=16)
    assert picture.mean() == pytest.approx(irradiance * 0.6 / np.pi, rel=2e-3)


def test_pose_field_lamps_and_target_are_those_of_the_file(take):
    scene, lines = take(whole(POINT, SUN, cards=("card", "wall"), rotation=turned(0), name="Eye"), target="card")
    card = scene.card
    assert card.camera.origin_m == pytest.approx((0, 0, FAR))
    assert card.camera.look_at_m == pytest.approx((0, 0, 0), abs=1e-6)
    image = 1 / (1e3 / card.lens.focal_length_mm - 1 / FAR)
    assert 4e-3 / image == pytest.approx(1.6 * np.tan(0.0125), rel=1e-3)
    assert dict(card.lights) == {"lamp_0": ("light_Lamp_0",), "lamp_1": ("light_Lamp_1",)}
    assert (card.target, card.unit_m) == (("mesh_card",), 1)
    assert lines == ["aperture: the camera is a pinhole, so the card says f/2"]
    assert "perspective Eye" in (scene.folder / "scene.yaml").read_text()


def test_a_camera_below_a_turned_and_scaled_node_looks_along_its_own_axis(take):
    file = whole(POINT)
    eye = file.json["scenes"][0]["nodes"].pop(1)
    file.json["nodes"][eye] |= {"translation": [0, 0, 1.5]}
    file.add_node(children=[eye], rotation=turned(-10), scale=[2, 2, 2])
    camera = take(file)[0].card.camera
    towards = np.array([0, np.sin(np.radians(10)), np.cos(np.radians(10))])
    assert camera.origin_m == pytest.approx(FAR * towards, abs=1e-5)
    assert camera.look_at_m == pytest.approx((0, 0, 0), abs=1e-5)
    assert camera.up == pytest.approx((0, np.cos(np.radians(10)), -np.sin(np.radians(10))), abs=1e-5)


def second(kind):
    file = whole(POINT)
    file.json["cameras"].append({"type": kind, kind: {"yfov": 1} if kind == "perspective" else {"xmag": 1}})
    file.add_node(camera=1, name="Top", translation=[0, 5, 0])
    return file


def several(*, towards):
    """Return a file whose first camera looks away from the cards, with a second one, and one from above."""
    file = whole(POINT, name="Away", rotation=turned(90))
    file.json["cameras"].append({"type": "orthographic", "orthographic": {"xmag": 1}})
    file.add_node(camera=0, name="Eye", translation=[0, 0, FAR], rotation=turned(towards))
    file.add_node(camera=1, name="Top", translation=[0, 5, 0])
    return file


def with_area_lamp():
    file = whole(POINT)
    file.add_node(name="Area")
    return file


def with_bare_card():
    file = whole(POINT)
    file.add_card(name="bare", node={"translation": [3, 0, 0]})
    return file


def lamp(**changes):
    return whole((POINT[0], {**POINT[1], **changes}))


LINES = {
    "two cameras": (
        lambda: second("perspective"),
        "cameras ignored: perspective 'Top' (the camera 'Eye' is taken; --camera takes another)",
    ),
    "one from above": (lambda: second("orthographic"), "cameras ignored: orthographic 'Top' (the camera 'Eye' is"),
    "16:9": (
        lambda: whole(POINT, camera={"aspectRatio": 16 / 9}),
        "film size ignored: 1778 × 1000 (the width is kept; more is seen at the top and bottom",
    ),
    "upright": (lambda: whole(POINT, camera={"aspectRatio": 0.5}), "film size ignored: 500 × 1000"),
    "no lamp": (whole, "no lamp in the file: a lamp beside the camera and light from all around are added"),
    "an area lamp": (with_area_lamp, "nodes without content, such as area lamps, left out: Area"),
    "a dark lamp": (
        lambda: whole(POINT, (SUN[0], {"type": "directional", "intensity": 0})),
        "lamps without light left out: Lamp 1",
    ),
    "a short lamp": (lambda: lamp(range=3.0), "range of lamps ignored: Lamp 0"),
    "a soft spot": (
        lambda: whole((SPOT[0], {**SPOT[1], "spot": {"innerConeAngle": 0.2}})),
        "edges of spots fall off linearly in the angle: Lamp 0",
    ),
    "varnish": (
        lambda: whole(POINT, material={"extensions": {"KHR_materials_clearcoat": {}}}),
        "clearcoat ignored: paint",
    ),
    "no material": (with_bare_card, "no material, so it reflects 0.6: bare"),
    "far": (
        lambda: whole(POINT, camera={"yfov": 0.3}),
        "scale: 3 m away, f/2 blurs the target by 0.76 pixels at the ends of the travel; so the card has unit_m: 0.1",
    ),
}


@pytest.mark.parametrize(("make", "line"), LINES.values(), ids=LINES.keys())
def test_what_is_not_as_in_the_file_is_one_line(take, make, line):
    scene, lines = take(make())
    others = [text for text in lines if not text.startswith("aperture: ")]
    assert len(others) == 1
    assert others[0].startswith(line)
    assert f"- {others[0]}\n" in (scene.folder / "SOURCE.md").read_text()
    seen = SceneRenderer(scene, GRID, backend_name="scalar").trace_geometry()
    assert seen.target.all()


def test_one_of_several_cameras_is_chosen_by_its_name(take):
    scene, lines = take(several(towards=0), camera="Eye")
    assert scene.card.camera.look_at_m == pytest.approx((0, 0, 0), abs=1e-6)
    assert "perspective Eye" in (scene.folder / "scene.yaml").read_text()
    ignored = "perspective 'Away', orthographic 'Top' (the camera 'Eye' is taken; --camera takes another)"
    assert f"cameras ignored: {ignored}" in lines


CHOICES = {
    "looks away": ({}, "nothing is in the middle of the image of the camera 'Away'; aim | with --camera: Eye"),
    "sees no target": ({"target": "card"}, "the camera 'Away' does not see 'mesh_card'; aim | with --camera: Eye"),
    "both look away": ({"camera": "Eye"}, "the image of the camera 'Eye'; aim | with --camera: Away"),
    "unknown": ({"camera": "eye"}, "unknown perspective camera 'eye'; allowed: Away, Eye; did you mean 'Eye'?"),
    "from above": ({"camera": "Top"}, "unknown perspective camera 'Top'; allowed: Away, Eye"),
}


@pytest.mark.parametrize(("how", "message"), CHOICES.values(), ids=CHOICES.keys())
def test_a_refusal_names_the_camera_and_those_that_could_be_taken(take, how, message):
    assert_says(refusal(take, several(towards=90), **how), message)


def test_a_mesh_alone_has_no_camera_to_choose(take):
    file = whole()
    file.json["cameras"] = [{"type": "orthographic", "orthographic": {"xmag": 1}}]
    assert_says(refusal(take, file, camera="Eye"), "no camera with a perspective, and --camera names 'Eye'")


def test_without_a_lamp_the_scene_is_lit_by_that_of_the_template(take):
    scene, _ = take(whole())
    assert dict(scene.card.lights) == {"lamp": ("lamp",), "room": ("room",)}
    renderer = SceneRenderer(scene, GRID, backend_name="scalar")
    everywhere = np.ones((5, 8), bool)
    lamp, room = (renderer.estimate_irradiance(name, position=0.5, target=everywhere)[0] for name in ("lamp", "room"))
    assert room == pytest.approx(0.5 * np.pi, rel=0.1)  # the lamp hides a part of it
    assert 0.5 < lamp / room < 20


def test_gloss_and_metal_count_in_a_whole_scene(take):
    pixels = blocks((0, 128, 255), (0, 64, 0), (0, 64, 0), (0, 64, 0))
    file = whole(POINT)
    use = {"index": file.add_texture(pixels)}
    file.add_card(
        name="foil",
        node={"translation": [3, 0, 0]},
        material=file.add_material(pbr={"metallicRoughnessTexture": use, "metallicFactor": 1, "roughnessFactor": 0.5}),
    )
    file.add_card(
        name="pearl",
        node={"translation": [6, 0, 0]},
        material=file.add_material(pbr={"roughnessFactor": 0.25}, extensions={"KHR_materials_ior": {"ior": 1.7}}),
    )
    scene, lines = take(file)
    assert [line for line in lines if "ignored" in line] == []
    text = (scene.folder / "scene.xml").read_text()
    assert (
        '<float name="roughness" value="0.25"/><float name="metallic" value="0"/><float name="eta" value="1.7"/>'
        in text
    )
    for name, values in (("roughness", {128 / 510, 64 / 510}), ("metallic", {1.0, 0.0})):
        data = (scene.folder / f"textures/mesh_foil_{name}.pfm").read_bytes()
        stored = np.frombuffer(data.split(b"-1.0\n", 1)[1], "<f4")
        assert sorted(set(stored.tolist())) == pytest.approx(sorted(values), abs=1e-6)


def test_a_wholly_rough_surface_reflects_as_matt_paper_at_grazing_angles(take):
    """A sun and a camera 80° from the normal on the same side: Lambert's 0.6/π·E·cos 80°, as in Blender's Cycles."""
    towards = [0, FAR * np.sin(np.radians(-80)), FAR * np.cos(np.radians(-80))]
    sun = {"rotation": turned(80)}, SUN[1]
    scene, _ = take(whole(sun, translation=towards, rotation=turned(80), camera={"yfov": 0.02}))
    picture = SceneRenderer(scene, GRID, backend_name="scalar").render_pinhole(0.5, samples=16)
    assert picture[2, 4] == pytest.approx(0.6 / np.pi * 3 * np.cos(np.radians(80)), rel=0.01)


def test_all_parts_of_a_node_are_the_target(take):
    file = whole(POINT)
    parts = file.json["meshes"][0]["primitives"]
    parts.append(dict(parts[0]))
    scene, _ = take(file)
    assert scene.card.target == ("mesh_card_1", "mesh_card_2")


REFUSED = {
    "nothing in the middle": (lambda: whole(POINT, rotation=turned(90)), "nothing is in the middle of the camera's"),
    "a wide angle": (lambda: whole(POINT, camera={"yfov": 4.0}), "cameras.0.perspective.yfov is 4.0"),
    "no such lamp": (
        lambda: whole(({"extensions": {"KHR_lights_punctual": {"light": 7}}}, POINT[1])),
        "does not exist",
    ),
    "an area lamp": (lambda: lamp(type="area"), "KHR_lights_punctual.lights.0.type is 'area'"),
    "negative light": (lambda: lamp(intensity=-5), "KHR_lights_punctual.lights.0.intensity is -5"),
    "no number": (lambda: lamp(color=[1, "red", 0]), "KHR_lights_punctual.lights.0.color.1 is 'red'"),
    "an index of 0": (
        lambda: whole(POINT, material={"extensions": {"KHR_materials_ior": {"ior": 0.0}}}),
        "Refraction of 'paint' is 0.0",
    ),
}


@pytest.mark.parametrize(("make", "problem"), REFUSED.values(), ids=REFUSED.keys())
def test_a_whole_scene_that_cannot_be_taken_is_refused_and_leaves_nothing(own_folder, take, make, problem):
    assert_says(refusal(take, make()), problem)
    assert not (own_folder / "scenes").exists()


def test_a_target_is_named_by_its_node_and_must_be_seen(take):
    file = whole(POINT, cards=("card", "hidden"))
    file.json["nodes"][1]["translation"] = [0, 0, -1]
    assert_says(refusal(take, file, target="car"), "unknown target 'car'; allowed: card, hidden; did you mean 'card'?")
    assert_says(refusal(take, file, target="hidden"), "the camera does not see 'mesh_hidden'")
    assert take(file, target="card")[0].card.target == ("mesh_card",)


def test_a_file_that_was_exported_without_its_camera_says_so_and_names_what_came_empty(take):
    file = whole()
    del file.json["cameras"]
    eye = next(node for node in file.json["nodes"] if node.get("name") == "Eye")
    del eye["camera"]
    _, lines = take(file)
    assert lines[:2] == [
        "no camera in the file: export it with Cameras and Punctual Lights to have the whole scene",
        "nodes without content, such as area lamps, left out: Eye",
    ]
    assert lines[2].startswith("placed as a mesh with a largest side of 0.1 m")
