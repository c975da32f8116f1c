"""A scene round a mesh file: the mesh is placed in front of the lens, or refused with how to convert it."""

import base64
import json
import struct

import numpy as np
import pytest
import trimesh
from mesh_cards import Gltf
from refusals import assert_says, refusal

from saf_gen.authoring.template import scene_from_export
from saf_gen.scene.scene_folder import find_scene
from saf_gen.scene.xml import read_scene_xml

# A wedge 2 wide, 4 high and 1 deep, away from the origin.
CORNERS = np.array([[1, 1, 1], [3, 1, 1], [1, 5, 1], [1, 1, 2]], dtype=np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.uint16)
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "".join("f {} {} {}\n".format(*(f + 1)) for f in FACES)


def make_gltf(names, material):
    """Return a glTF file of wedges, which their nodes place 10 apart."""
    data = CORNERS.tobytes() + FACES.tobytes()
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": CORNERS.nbytes},
        {"buffer": 0, "byteOffset": CORNERS.nbytes, "byteLength": FACES.nbytes},
    ]
    ends = {"min": CORNERS.min(axis=0).tolist(), "max": CORNERS.max(axis=0).tolist()}
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "material": 0}
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(names)))}],
        "nodes": [{"mesh": 0, "name": name, "translation": [10 * k, 0, 0]} for k, name in enumerate(names)],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", **ends},
            {"bufferView": 1, "componentType": 5123, "count": FACES.size, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}],
        "materials": [material],
    }


@pytest.fixture
def here(own_folder):
    return own_folder


def shapes_of(name):
    """Return the extent of each target shape, in metres, float64 (2, 3), as trimesh reads it."""
    scene = find_scene(name)
    return {target: trimesh.load_mesh(scene.folder / f"meshes/{target}.ply").bounds for target in scene.card.target}


@pytest.mark.parametrize("suffix", [".obj", ".OBJ"])
def test_a_mesh_stands_round_the_origin_with_a_largest_side_of_a_decimetre(here, suffix):
    (here / f"wedge{suffix}").write_text(OBJ)
    written = scene_from_export(here / f"wedge{suffix}", "wedge", root=here / "scenes")
    names = {path.relative_to(here / "scenes/wedge").as_posix() for path in written}
    assert names == {"scene.xml", "scene.yaml", "SOURCE.md", "meshes/mesh.ply"}
    ((target, extent),) = shapes_of("wedge").items()
    assert target == "mesh"
    assert extent == pytest.approx(np.array([[-0.025, -0.05, -0.0125], [0.025, 0.05, 0.0125]]), abs=1e-7)
    card = find_scene("wedge").card
    assert (card.licence, set(card.lights)) == ("", {"lamp", "room"})
    read_scene_xml(here / "scenes/wedge/scene.xml", {})  # the tests of untrusted scenes
    assert "scaled by 0.025" in (here / "scenes/wedge/SOURCE.md").read_text()


def test_the_meshes_of_a_gltf_file_stay_where_its_scene_places_them_with_their_colour(here):
    material = {"pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.8, 1.0]}}
    (here / "two.gltf").write_text(json.dumps(make_gltf(("lamp", "Cup 1"), material)))
    scene_from_export(here / "two.gltf", "two", root=here / "scenes")
    extents = shapes_of("two")
    assert set(extents) == {"mesh_lamp", "mesh_Cup_1"}  # no name is that of the lamp
    assert extents["mesh_Cup_1"][0, 0] - extents["mesh_lamp"][0, 0] == pytest.approx(10 * 0.1 / 12, abs=1e-7)
    assert extents["mesh_lamp"][0, 0] == pytest.approx(-0.05, abs=1e-7)
    assert extents["mesh_Cup_1"][1, 0] == pytest.approx(0.05, abs=1e-7)
    line = next(x for x in (here / "scenes/two/scene.xml").read_text().splitlines() if "twosided" in x)
    colour = [float(x) for x in line.split('value="')[1].split('"')[0].split()]
    assert colour == pytest.approx([0.2, 0.4, 0.8], abs=1 / 255)


def test_a_base_texture_is_copied_with_its_coordinates(here):
    from PIL import Image

    picture = Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture)
    corners = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.25]])
    mesh = trimesh.Trimesh(CORNERS, FACES, process=False, visual=trimesh.visual.TextureVisuals(corners, material))
    trimesh.Scene({"printed": mesh}).export(here / "printed.glb")
    scene_from_export(here / "printed.glb", "printed", root=here / "scenes")
    folder = here / "scenes/printed"
    assert np.array_equal(np.asarray(Image.open(folder / "textures/mesh_printed.png")), np.asarray(picture))
    vertices = trimesh.load_mesh(folder / "meshes/mesh_printed.ply").metadata["_ply_raw"]["vertex"]["data"]
    shown = {(float(s), float(t)) for s, t in vertices[["s", "t"]]}
    assert shown == {(0, 1), (1, 1), (0, 0), (0.5, 0.75)}  # trimesh's v points up, and that of glTF down
    assert "textures/mesh_printed.png" in (folder / "scene.xml").read_text()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.blend", b"BLENDER", "is a Blender file | mitsuba-blender | .glb"),
        ("a.fbx", b"", "is an FBX file | allowed: a scene.xml, or a mesh: .obj, .ply, .glb, .gltf, .stl"),
        ("a.obj", None, "a.obj cannot be read: there is no such file"),
        ("a.obj", b"v 0 0 0\n", "a.obj: "),
        ("a.ply", b"ply\n", "a.ply: the mesh is damaged: its header has no end"),
        ("a.obj", b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", "the mesh has no size"),
        ("a.obj", b"v 1 1 1\nv nan 1 1\nv 1 2 1\nf 1 2 3\n", "a.obj:2: "),
        ("a.glb", struct.pack("<4sII", b"glTF", 7, 12), "not a complete GLB"),
        ("a.stl", b"solid\nendsolid\n", "a.stl: the file has no mesh with a face"),
    ],
)
def test_a_mesh_that_cannot_be_placed_is_refused_and_leaves_nothing(here, name, content, message):
    if content is not None:
        (here / name).write_bytes(content)
    assert_says(refusal(scene_from_export, here / name, "mine", root=here / "scenes"), message)
    assert not (here / "scenes").exists()


@pytest.mark.parametrize("count", [8, 9])
def test_the_files_of_a_folder_are_named_or_if_they_are_many_counted(here, call, count):
    file = Gltf()
    paper = file.add_material()
    for k in range(count):
        file.add_card(name=str(k), material=paper)
    file.save(here / "cards.glb")
    code, out, _ = call("scenes", "new", "cards", "--from", "cards.glb")
    meshes = [line for line in out.splitlines() if line.startswith("scenes/cards/meshes")]
    named = [f"scenes/cards/meshes/mesh_{k}.ply" for k in range(count)]
    assert (code, meshes) == (0, named if count == 8 else ["scenes/cards/meshes: 9 files"])
    assert {"scenes/cards/scene.xml", "scenes/cards/scene.yaml", "scenes/cards/SOURCE.md"} < {*out.splitlines()}


def test_the_command_says_what_it_leaves_out_and_a_refusal_is_one_line(here, call):
    file = Gltf()
    file.add_card(
        material=file.add_material(name="car", extensions={"KHR_materials_clearcoat": {"clearcoatFactor": 1}})
    )
    file.save(here / "car.glb")
    code, out, err = call("scenes", "new", "car", "--from", "car.glb")
    assert (code, err) == (0, "")
    assert "\nclearcoat ignored: car\n" in out
    file.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    file.save(here / "van.glb")
    code, out, err = call("scenes", "new", "van", "--from", "van.glb")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "van.glb: the extension 'KHR_draco_mesh_compression' is not read" in err
    assert not (here / "scenes/van").exists()
