"""What a scene made from a mesh shows: the colours that its file states, at their places."""

from functools import partial

import numpy as np
import pytest
from mesh_cards import LUMINANCE, UV, Gltf, blocks, linear, quarters, show
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


def old_gloss(file):
    diffuse = {"diffuseFactor": [0.5, 0.5, 1, 1], "diffuseTexture": {"index": file.add_texture(FOUR)}}
    material = file.add_material(extensions={"KHR_materials_pbrSpecularGlossiness": diffuse})
    return {"material": material}, COLOURS * [0.5, 0.5, 1]


def no_material(file):
    return {}, [[0.6] * 3] * 4


def default_colour(file):
    return {"material": file.add_material()}, [[1, 1, 1]] * 4


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
        old_gloss,
        no_material,
        default_colour,
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


@pytest.mark.parametrize("grey", [False, True])
def test_vertex_colours_times_a_texture_have_the_right_luminance(tmp_path, grey):
    file = Gltf()
    stored = np.repeat(CORNERS.mean(axis=1, keepdims=True), 3, axis=1) if grey else CORNERS
    number = file.add_texture(LIGHT, sampler={"magFilter": 9728})
    material = file.add_material(pbr={"baseColorTexture": {"index": number}, "baseColorFactor": [1, 0.5, 0.8, 1]})
    file.add_card(material=material, attributes={"COLOR_0": file.add_array(stored)})
    picture, _ = show(file.save(tmp_path / "a.glb"), samples=4096)
    texels = linear([LIGHT[0, 0], LIGHT[0, 7], LIGHT[7, 0], LIGHT[7, 7]]) * [1, 0.5, 0.8]
    assert quarters(picture) @ LUMINANCE == pytest.approx((at_quarters(stored) * texels) @ LUMINANCE, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("mixed", [False, True])
def test_the_variant_that_renders_stacks_shows_the_same_luminance(tmp_path, mixed):
    """A card with a tinted picture, colours of vertices or none, opacity and emission."""
    file = Gltf()
    number = file.add_texture(LIGHT, sampler={"magFilter": 9728})
    pbr = {"baseColorTexture": {"index": number}, "baseColorFactor": [1, 0.5, 0.8, 0.5]}
    glow = {"emissiveFactor": [0.2, 0.4, 1], "emissiveTexture": {"index": number}}
    material = file.add_material(pbr=pbr, alphaMode="BLEND", **glow)
    file.add_card(material=material, attributes={"COLOR_0": file.add_array(CORNERS)} if mixed else {})
    picture, _ = show(file.save(tmp_path / "a.glb"), samples=4096, variant=VARIANT)
    texels = linear([LIGHT[0, 0], LIGHT[0, 7], LIGHT[7, 0], LIGHT[7, 7]])
    colour = texels * [1, 0.5, 0.8] * (at_quarters(CORNERS) if mixed else 1)
    expected = (0.5 * (colour + texels * [0.2, 0.4, 1])) @ LUMINANCE + 0.5
    assert quarters(picture)[:, 0] == pytest.approx(expected, rel=0.03)


def turned(uv, *, offset=(0, 0), rotation=0.0, scale=(1, 1)):
    """Return texture coordinates after KHR_texture_transform: scaled, turned counter-clockwise as seen, and moved."""
    u, v = (np.asarray(uv, float) * scale).T
    cos, sin = np.cos(rotation), np.sin(rotation)
    return np.column_stack([u * cos + v * sin + offset[0], v * cos - u * sin + offset[1]])


@pytest.mark.parametrize(
    "transform",
    [
        {},
        {"offset": [0.5, 0]},
        {"offset": [0, 0.5]},
        {"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5]},  # the example of the extension's page
        {"rotation": -np.pi / 2},
        {"rotation": np.pi},
        {"scale": [2, 1]},
        {"scale": [1, -1], "offset": [0, 1]},
        {"offset": [0.25, 0.5], "rotation": np.pi / 2, "scale": [1.0, 0.5]},
    ],
)
def test_a_texture_transform_moves_turns_and_scales(tmp_path, transform):
    file = Gltf()
    fine = np.random.default_rng(1).integers(0, 256, (8, 8, 3), dtype=np.uint8).repeat(4, 0).repeat(4, 1)
    number = file.add_texture(fine, sampler={"magFilter": 9728})
    base = {"index": number, "extensions": {"KHR_texture_transform": transform}}
    file.add_card(material=file.add_material(pbr={"baseColorTexture": base}))
    picture, _ = show(file.save(tmp_path / "a.glb"), size=16)
    places = np.array([(3, 3), (3, 11), (12, 4), (11, 13)])
    u, v = (np.floor(turned((places[:, ::-1] + 0.5) / 16, **transform) * 32).astype(int) % 32).T
    assert picture[tuple(places.T)] == pytest.approx(linear(fine[v, u]), abs=0.01)


def test_the_example_of_the_extension_shows_the_lower_left_quarter(tmp_path):
    file = Gltf()
    transform = {"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5]}
    base = {"index": file.add_texture(FOUR), "extensions": {"KHR_texture_transform": transform}}
    file.add_card(material=file.add_material(pbr={"baseColorTexture": base}))
    picture, _ = show(file.save(tmp_path / "a.glb"))
    assert quarters(picture) == pytest.approx(np.tile(COLOURS[2], (4, 1)), abs=5e-3)


@pytest.mark.parametrize(
    ("sets", "use"),
    [
        ((UV * 0, UV), {"texCoord": 1}),
        ((UV, UV * 0), {"texCoord": 0}),
        ((UV * 0, UV * 0, UV), {"texCoord": 2}),
        ((UV * 0, UV), {"texCoord": 0, "extensions": {"KHR_texture_transform": {"texCoord": 1}}}),
    ],
)
def test_a_texture_uses_the_set_of_coordinates_that_it_names(tmp_path, sets, use):
    file = Gltf()
    file.add_card(material=file.add_material(**texture(file, **use)), uv=sets)
    picture, _ = show(file.save(tmp_path / "a.glb"))
    assert quarters(picture) == pytest.approx(COLOURS, abs=4e-3)


@pytest.mark.parametrize(("kind", "top"), [("u1", 255), ("u2", 65535)], ids=["bytes", "shorts"])
def test_normalised_coordinates_are_fractions(tmp_path, kind, top):
    file = Gltf()
    coordinates = file.add_array((UV * top).astype(kind), normalized=True)
    file.add_card(material=file.add_material(**texture(file)), uv=(), attributes={"TEXCOORD_0": coordinates})
    picture, _ = show(file.save(tmp_path / "a.glb"))
    assert quarters(picture) == pytest.approx(COLOURS, abs=4e-3)


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


@pytest.mark.parametrize("with_texture", [False, True])
def test_the_opacity_of_vertices_is_kept(tmp_path, with_texture):
    file = Gltf()
    alpha = np.float32([0.2, 0.5, 0.9, 0.6])
    pbr = {"baseColorFactor": [0, 0, 0, 1]}
    if with_texture:
        pbr["baseColorTexture"] = {"index": file.add_texture(np.full((4, 4, 4), (255, 255, 255, 128), np.uint8))}
    colours = file.add_array(np.column_stack([np.ones((4, 3), np.float32), alpha]))
    material = file.add_material(pbr=pbr, alphaMode="BLEND")
    file.add_card(material=material, attributes={"COLOR_0": colours})
    picture, _ = show(file.save(tmp_path / "a.glb"), samples=1024)
    share = 128 / 255 if with_texture else 1
    assert quarters(picture)[:, 0] == pytest.approx(1 - at_quarters(alpha) * share, abs=0.03)


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


@pytest.mark.parametrize("mode", ["MASK", "BLEND", "OPAQUE"])
@pytest.mark.parametrize("with_picture", [False, True])
def test_what_is_clear_does_not_emit(tmp_path, mode, with_picture):
    """The card is black and emits 2; the picture of the emission has another size than that of the opacity."""
    file = Gltf()
    pbr = {"baseColorTexture": {"index": file.add_texture(ALPHA)}, "baseColorFactor": [0, 0, 0, 0.9]}
    glow = {"emissiveFactor": [1, 1, 1], "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2}}}
    if with_picture:
        glow["emissiveTexture"] = {"index": file.add_texture(np.full((2, 4, 3), 255, np.uint8))}
    file.add_card(material=file.add_material(pbr=pbr, alphaMode=mode, alphaCutoff=0.6, **glow))
    picture, _ = show(file.save(tmp_path / "a.glb"), samples=1024)
    shown = {"MASK": (SHARE * 0.9 >= 0.6).astype(float), "BLEND": SHARE * 0.9, "OPAQUE": np.ones(4)}[mode]
    assert quarters(picture)[:, 0] == pytest.approx(2 * shown + 1 - shown, abs=0.04)


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
