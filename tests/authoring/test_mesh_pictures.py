"""What a scene made from a mesh shows: the colours that its file states, at their places."""

from functools import partial

import numpy as np
import pytest
from mesh_cards import LUMINANCE, POINTS, UV, Gltf, blocks, linear, quarters, show
from written_scenes import VARIANT

FOUR = blocks((255, 0, 0), (0, 255, 0), (0, 0, 255), (188, 188, 188))
"""Red, green, blue and a grey of linear 0.5."""
COLOURS = linear([[255, 0, 0], [0, 255, 0], [0, 0, 255], [188, 188, 188]])
LIGHT = blocks((230, 200, 120), (90, 250, 180), (60, 70, 220), (188, 188, 188))


def texture(file, **more):
    return {"pbr": {"baseColorTexture": {"index": file.add_texture(FOUR), **more}}}


def factor_alone(file):
    return {"material": file.add_material(pbr={"baseColorFactor": [0.2, 0.4, 0.8, 1]})}, [[0.2, 0.4, 0.8]] * 4


def texture_alone(file):
    return {"material": file.add_material(**texture(file))}, COLOURS


def factor_times_texture(file):
    material = texture(file)
    material["pbr"]["baseColorFactor"] = [0.2, 0.5, 1, 1]
    return {"material": file.add_material(**material)}, COLOURS * [0.2, 0.5, 1]


def dark_factor_times_texture(file):
    material = texture(file)
    material["pbr"]["baseColorFactor"] = [0.2, 0.2, 0.2, 1]
    return {"material": file.add_material(**material)}, COLOURS * 0.2


CORNERS = np.array([[0.9, 0.1, 0.2], [0.3, 0.5, 0.2], [0.1, 0.9, 0.6], [0.7, 0.5, 0.6]], np.float32)
"""Colours of the corners that change linearly over the card."""


def at_quarters(corners):
    """Return the values in the middle of the quarters of a card, from values that change linearly over it."""
    corners = np.asarray(corners, float)
    assert corners[0] + corners[2] == pytest.approx(corners[1] + corners[3], abs=0.01)
    right, up = corners[1] - corners[0], corners[3] - corners[0]
    return np.array(
        [corners[0] + a * right + b * up for a, b in ((0.25, 0.75), (0.75, 0.75), (0.25, 0.25), (0.75, 0.25))]
    )


def vertex_colours(file, *, kind="f4"):
    top = {"f4": 1, "u1": 255, "u2": 65535}[kind]
    stored = CORNERS if kind == "f4" else (CORNERS * top).round().astype(kind)
    colours = file.add_array(
        np.column_stack([stored, np.full(4, top, kind)]) if kind == "u1" else stored, normalized=kind != "f4"
    )
    return {"attributes": {"COLOR_0": colours}}, at_quarters(stored / top)


def vertex_colours_times_factor(file):
    mesh, expected = vertex_colours(file)
    return {**mesh, "material": file.add_material(pbr={"baseColorFactor": [0.5, 0.25, 1, 1]})}, expected * [
        0.5,
        0.25,
        1,
    ]


def one_vertex_colour_times_texture(file):
    colours = file.add_array(np.tile(np.float32([0.5, 0.25, 1]), (4, 1)))
    return {"attributes": {"COLOR_0": colours}, "material": file.add_material(**texture(file))}, COLOURS * [
        0.5,
        0.25,
        1,
    ]


def no_material(file):
    return {}, [[0.6] * 3] * 4


def default_colour(file):
    return {"material": file.add_material()}, [[1, 1, 1]] * 4


def unstated_material(file):
    file.json["materials"] = [{}]
    return {"material": 0}, [[1, 1, 1]] * 4


def webp(file):
    file.json["extensionsRequired"] = ["EXT_texture_webp"]
    number = file.add_texture(FOUR, mime="image/webp")
    file.json["textures"][number] = {"extensions": {"EXT_texture_webp": {"source": 0}}}
    return {"material": file.add_material(pbr={"baseColorTexture": {"index": number}})}, COLOURS


@pytest.mark.parametrize(
    "make",
    [
        factor_alone,
        texture_alone,
        factor_times_texture,
        dark_factor_times_texture,
        vertex_colours,
        partial(vertex_colours, kind="u1"),
        partial(vertex_colours, kind="u2"),
        vertex_colours_times_factor,
        one_vertex_colour_times_texture,
        no_material,
        default_colour,
        unstated_material,
        webp,
    ],
)
@pytest.mark.parametrize("suffix", [".glb"])
def test_colours_of_gltf_are_multiplied_in_linear_light(tmp_path, make, suffix):
    file = Gltf()
    mesh, expected = make(file)
    file.add_card(**mesh)
    picture, _ = show(file.save(tmp_path / f"a{suffix}"), samples=256)
    assert quarters(picture) == pytest.approx(np.array(expected), abs=8e-3)


@pytest.mark.slow
@pytest.mark.parametrize("emits", [False, True])
def test_the_variant_that_renders_stacks_shows_the_same_luminance(tmp_path, emits):
    """A card with a tinted picture, and opacity or emission."""
    file = Gltf()
    number = file.add_texture(LIGHT, sampler={"magFilter": 9728})
    pbr = {"baseColorTexture": {"index": number}, "baseColorFactor": [1, 0.5, 0.8, 0.5]}
    glow = {"emissiveFactor": [0.2, 0.4, 1], "emissiveTexture": {"index": number}} if emits else {"alphaMode": "BLEND"}
    file.add_card(material=file.add_material(pbr=pbr, **glow))
    picture, _ = show(file.save(tmp_path / "a.glb"), samples=4096, variant=VARIANT)
    texels = linear([LIGHT[0, 0], LIGHT[0, 7], LIGHT[7, 0], LIGHT[7, 7]])
    colour = (texels * [1, 0.5, 0.8]) @ LUMINANCE
    expected = colour + (texels * [0.2, 0.4, 1]) @ LUMINANCE if emits else 0.5 * colour + 0.5
    assert quarters(picture)[:, 0] == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(("code", "expected"), [(10497, [0, 1, 2, 3]), (33071, [3, 3, 3, 3]), (33648, [2, 3, 0, 1])])
def test_a_sampler_says_what_is_outside_the_picture(tmp_path, code, expected):
    """The card shows the picture from (1, 1) to (2, 2) on; mirrored in one direction from 1 to 2."""
    file = Gltf()
    sampler = {"wrapS": code, "wrapT": code}
    number = file.add_texture(FOUR, sampler=sampler)
    uv = np.add(UV, [2, 1] if code == 33648 else [1, 1])
    file.add_card(material=file.add_material(pbr={"baseColorTexture": {"index": number}}), uv=(uv,))
    picture, _ = show(file.save(tmp_path / "a.glb"))
    assert quarters(picture) == pytest.approx(COLOURS[expected], abs=4e-3)


ALPHA = blocks((255, 255, 255, 255), (255, 255, 255, 200), (255, 255, 255, 100), (255, 255, 255, 0))
SHARE = np.array([255, 200, 100, 0]) / 255


@pytest.mark.parametrize(
    ("more", "factor", "shown"),
    [
        ({}, 1, [1, 1, 1, 1]),
        ({"alphaMode": "OPAQUE"}, 0.5, [1, 1, 1, 1]),
        ({"alphaMode": "MASK"}, 1, [1, 1, 0, 0]),
        ({"alphaMode": "MASK", "alphaCutoff": 0.9}, 1, [1, 0, 0, 0]),
        ({"alphaMode": "MASK", "alphaCutoff": 0.3}, 1, [1, 1, 1, 0]),
        ({"alphaMode": "MASK"}, 0.6, [1, 0, 0, 0]),
        ({"alphaMode": "MASK", "alphaCutoff": 0}, 1, [1, 1, 1, 1]),
        ({"alphaMode": "BLEND"}, 1, SHARE),
        ({"alphaMode": "BLEND"}, 0.5, SHARE * 0.5),
    ],
)
def test_what_is_clear_shows_the_background(tmp_path, more, factor, shown):
    """The card is black, and the background is 1."""
    file = Gltf()
    pbr = {"baseColorTexture": {"index": file.add_texture(ALPHA)}, "baseColorFactor": [0, 0, 0, factor]}
    file.add_card(material=file.add_material(pbr=pbr, **more))
    picture, _ = show(file.save(tmp_path / "a.glb"), samples=1024)
    assert quarters(picture)[:, 0] == pytest.approx(1 - np.array(shown), abs=0.03)


@pytest.mark.parametrize(
    ("factor", "strength", "with_picture"),
    [((0.5, 0.25, 1), None, False), ((1, 1, 1), 7.5, False), ((1, 0.5, 0.25), 4, True), ((1, 1, 1), None, True)],
)
def test_emission_is_the_product_of_factor_picture_and_strength(tmp_path, factor, strength, with_picture):
    file = Gltf()
    material = {"emissiveFactor": factor, "pbr": {"baseColorFactor": [0, 0, 0, 1]}}
    if strength:
        material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    if with_picture:
        material["emissiveTexture"] = {"index": file.add_texture(FOUR)}
    file.add_card(material=file.add_material(**material))
    picture, said = show(file.save(tmp_path / "a.glb"))
    expected = np.array(factor) * (strength or 1) * (COLOURS if with_picture else np.ones((4, 3)))
    assert quarters(picture) == pytest.approx(expected, rel=1e-2, abs=1e-3)
    assert said == []
    assert "room: [room, mesh_card]" in (tmp_path / "shown/scene.yaml").read_text()


@pytest.mark.parametrize(
    ("node", "flipped"),
    [
        ({"scale": [-1, 1, 1]}, True),
        ({"rotation": [0, 1, 0, 0]}, True),
        ({"scale": [2, 2, 2], "translation": [5, 6, 7]}, False),
        ({"matrix": np.diag([-3.0, 3, 3, 1]).T.ravel().tolist()}, True),
    ],
)
def test_nodes_place_and_mirror(tmp_path, node, flipped):
    """A mirrored or turned card shows its picture the other way round, from both sides."""
    file = Gltf()
    file.add_card(material=file.add_material(**texture(file)), node=node)
    picture, _ = show(file.save(tmp_path / "a.glb"))
    assert quarters(picture) == pytest.approx(COLOURS[[1, 0, 3, 2] if flipped else [0, 1, 2, 3]], abs=4e-3)


@pytest.mark.parametrize("scale", [[1, 1, 1], [-1, 1, 1], [1, -1, 1], [-1, -1, -1]])
@pytest.mark.parametrize("with_normals", [True, False])
def test_a_mirrored_lamp_still_shines_from_its_front(tmp_path, scale, with_normals):
    """Mirrored along z as well, the front of the card faces away from the camera."""
    file = Gltf()
    material = file.add_material(pbr={"baseColorFactor": [0, 0, 0, 1]}, emissiveFactor=[1, 1, 1])
    normals = {"NORMAL": file.add_array(np.tile(np.float32([0, 0, 1]), (4, 1)))} if with_normals else {}
    file.add_card(material=material, attributes=normals, node={"scale": scale})
    picture, _ = show(file.save(tmp_path / "a.glb"))
    assert picture.mean() == pytest.approx(0 if scale[2] < 0 else 1, abs=1e-3)


def test_the_parts_of_a_mesh_keep_their_materials_below_moved_nodes(tmp_path):
    """trimesh names them 0, 0_1 and so on; a node without a name moves them, and a camera between changes nothing."""
    file = Gltf()
    red, green = (file.add_material(pbr={"baseColorFactor": colour}) for colour in ([1, 0, 0, 1], [0, 1, 0, 1]))
    half = POINTS * np.float32([0.5, 1, 1])
    left = file.add_mesh(points=half - np.float32([0.5, 0, 0]), material=red)
    right = file.add_mesh(points=half + np.float32([0.5, 0, 0]), material=green)
    file.json["meshes"][left]["primitives"] += file.json["meshes"].pop(right)["primitives"]
    child = file.add_node(mesh=left, name="pair", scale=[-1, 1, 1], in_scene=False)
    eye = file.add_node(camera=0, name="eye", children=[child], scale=[-3, 3, 3], in_scene=False)
    file.add_node(children=[eye], translation=[7, 8, 9])
    file.json["cameras"] = [{"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 1}}]
    picture, said = show(file.save(tmp_path / "a.glb"))
    assert quarters(picture) == pytest.approx(np.array([[1, 0, 0], [0, 1, 0]] * 2), abs=1e-3)
    assert said == ["cameras ignored: eye"]
    assert "target: [mesh_pair_1, mesh_pair_2]" in (tmp_path / "shown/scene.yaml").read_text()
