"""What of a mesh is left out is said in a line, and what cannot be read is refused in one."""

import base64
import io
import json
import struct

import numpy as np
import pytest
from mesh_cards import FACES, POINTS, Gltf, blocks, encode, show
from PIL import Image
from refusals import assert_says, refusal

from saf_gen.authoring.mesh_scene import scene_of_mesh

FOUR = blocks((255, 0, 0), (0, 255, 0), (0, 0, 255), (188, 188, 188))


def material(**more):
    def change(file):
        file.add_card(material=file.add_material(name="paint", **more))

    return change


def with_texture(key):
    def change(file):
        use = {"index": file.add_texture(FOUR)}
        pbr = {"metallicRoughnessTexture": use} if key == "metallicRoughnessTexture" else {}
        file.add_card(material=file.add_material(name="paint", pbr=pbr, **({} if pbr else {key: use})))

    return change


def on_file(**top):
    def change(file):
        material()(file)
        file.json |= top

    return change


def with_nodes(*nodes):
    def change(file):
        material()(file)
        for node in nodes:
            file.add_node(**node)

    return change


def with_orthographic_camera(file):
    with_nodes({"camera": 0, "name": "eye"})(file)
    file.json["cameras"] = [{"type": "orthographic"}]


def with_attribute(key):
    def change(file):
        paper = file.add_material(name="paper")
        file.add_card(attributes={key: file.add_array(np.ones((4, 3), np.float32))}, material=paper)

    return change


def with_normals_of_no_length(file):
    normals = {"NORMAL": file.add_array(np.zeros((4, 3), np.float32))}
    file.add_card(attributes=normals, material=file.add_material(name="paper"))


def with_hidden_part(file):
    file.add_card(name="shown", material=file.add_material(name="paper"))
    file.add_card(name="hidden", material=file.add_material(pbr={"baseColorFactor": [1, 1, 1, 0]}, alphaMode="BLEND"))


def without_material(file):
    """Two cards without one, of which the second has colours of its vertices."""
    file.add_card(name="plain")
    file.add_card(name="coloured", attributes={"COLOR_0": file.add_array(np.ones((4, 3), np.float32))})


def extension(name, **values):
    return material(extensions={name: values})


SAID = [
    (material(pbr={"metallicFactor": 1}), "metallic ignored: paint"),
    (material(pbr={"roughnessFactor": 0.2}), "gloss ignored: paint"),
    (with_texture("metallicRoughnessTexture"), "gloss ignored: paint"),
    (with_texture("normalTexture"), "normal map ignored: paint"),
    (with_texture("occlusionTexture"), "occlusion map ignored: paint"),
    (extension("KHR_materials_clearcoat", clearcoatFactor=1), "clearcoat ignored: paint"),
    (extension("KHR_materials_transmission", transmissionFactor=1), "transmission ignored: paint"),
    (extension("KHR_materials_volume"), "volume ignored: paint"),
    (extension("KHR_materials_sheen"), "sheen ignored: paint"),
    (extension("KHR_materials_specular"), "specular reflection ignored: paint"),
    (extension("KHR_materials_iridescence"), "iridescence ignored: paint"),
    (extension("KHR_materials_anisotropy"), "anisotropy ignored: paint"),
    (extension("KHR_materials_unlit"), "unlit shading ignored: paint"),
    (material(doubleSided=True, emissiveFactor=[1, 1, 1]), "emission of back sides ignored: paint"),
    (on_file(animations=[{}]), "animation ignored, the pose of the nodes is used"),
    (on_file(scenes=[{"nodes": [0]}, {"name": "other"}]), "scenes ignored: other"),
    (with_orthographic_camera, "cameras ignored: eye"),
    (with_nodes({"extensions": {"KHR_lights_punctual": {"light": 0}}, "name": "sun"}), "lamps ignored: sun"),
    (with_attribute("COLOR_1"), "second vertex colours ignored: card"),
    (with_normals_of_no_length, "normals ignored, some have no length: card"),
    (without_material, "no material, so it reflects 0.6: plain"),
    (with_hidden_part, "shapes left out, they cannot be seen: hidden"),
]


@pytest.mark.parametrize(("change", "line"), SAID, ids=[line for _, line in SAID])
def test_what_is_left_out_of_a_gltf_file_is_said_once(tmp_path, change, line):
    file = Gltf()
    change(file)
    said = []
    files = scene_of_mesh(file.save(tmp_path / "a.glb"), "mine", notify=said.append)
    assert said == [line]
    assert f"- {line}\n" in files["SOURCE.md"].decode()


def test_a_line_names_each_shape_and_no_more_than_fit(tmp_path):
    file = Gltf()
    for k in range(9):
        file.add_card(material=file.add_material(name=f"part {k}", pbr={"metallicFactor": 1}))
    said = []
    scene_of_mesh(file.save(tmp_path / "a.glb"), "mine", notify=said.append)
    assert said == ["metallic ignored: part 0, part 1, part 2, part 3, part 4, part 5 and 3 more"]


def on_json(**changes):
    """A change of values of the document, by dotted path, after a card with a texture was added."""

    def change(file):
        number = file.add_texture(FOUR)
        file.add_card(material=file.add_material(name="paint", pbr={"baseColorTexture": {"index": number}}))
        for path, value in changes.items():
            *way, last = (int(key) if key.isdigit() else key for key in path.split("__"))
            place = file.json
            for key in way:
                place = place[key]
            place[last] = value

    return change


def bad_points(value):
    def change(file):
        points = POINTS.copy()
        points[2, 1] = value
        file.add_card(points=points)

    return change


def quantised(file):
    file.add_card(points=(POINTS * 127).astype("i1"))
    file.json["accessors"][-3]["normalized"] = True


def emitting(**more):
    def change(file):
        use = {"index": file.add_texture(FOUR)}
        other = {"index": file.add_texture(FOUR, sampler={"wrapS": 33071, "wrapT": 33071})}
        glow = {"emissiveFactor": [1, 1, 1], "emissiveTexture": other}
        file.add_card(
            material=file.add_material(name="paint", pbr={"baseColorTexture": use}, **glow)
            if not more
            else file.add_material(name="paint", emissiveFactor=[1, 1, 1], **more)
        )

    return change


def coloured(kind, *, textured=False, normalized=False):
    def change(file):
        number = file.add_texture(FOUR)
        pbr = {"baseColorTexture": {"index": number}} if textured else {}
        colours = file.add_array(np.array([[0, 0, 1]] * 3 + [[1, 0, 1]], kind), normalized=normalized)
        file.add_card(material=file.add_material(name="paint", pbr=pbr), attributes={"COLOR_0": colours})

    return change


def pages():
    """Return a TIFF file of two pages."""
    buffer = io.BytesIO()
    one = Image.fromarray(FOUR)
    one.save(buffer, "tiff", save_all=True, append_images=[one])
    return buffer.getvalue()


PAGES = base64.b64encode(pages()).decode()
NOT_READ = (
    "the extension {!r} is not read; allowed: KHR_materials_emissive_strength, EXT_texture_webp, KHR_materials_ior,"
    " KHR_xmp_json_ld, lamps and materials"
)
BASE = "materials__0__pbrMetallicRoughness__baseColorTexture"
REFUSED = [
    *(
        (on_json(extensionsRequired=[name]), f"{NOT_READ.format(name)} | {hint}")
        for name, hint in (
            ("KHR_draco_mesh_compression", "export it without compression"),
            ("EXT_meshopt_compression", "export it without compression"),
            ("KHR_mesh_quantization", "gltf-transform dequantize"),
            ("KHR_texture_basisu", "ktxdecompress"),
            ("XYZ_voxels", "export it again without it"),
        )
    ),
    *(
        (on_json(**{f"{place}__extensions": {name: {}}}), NOT_READ.format(name))
        for place, name in (
            ("meshes__0__primitives__0", "KHR_draco_mesh_compression"),
            ("bufferViews__0", "EXT_meshopt_compression"),
            ("materials__0", "XYZ_materials_toon"),
            ("materials__0", "KHR_materials_pbrSpecularGlossiness"),
            (BASE, "KHR_texture_transform"),
            ("nodes__0", "EXT_mesh_gpu_instancing"),
        )
    ),
    (on_json(textures__0__extensions={"KHR_texture_basisu": {"source": 0}}), "KHR_texture_basisu is not read; convert"),
    (on_json(**{f"{BASE}__texCoord": 1}), "baseColorTexture.texCoord is 1; allowed: 0; move its texture coordinates"),
    (on_json(accessors__0__sparse={"count": 1}), "accessors.0.sparse is not read; "),
    (on_json(nodes__0__skin=0), "nodes.0.skin is not read; apply its pose"),
    (on_json(meshes__0__primitives__0__targets=[{}]), "targets is not read; apply its shape keys"),
    (on_json(meshes__0__weights=[1]), "meshes.0.weights is not read; apply its shape keys"),
    (on_json(meshes__0__primitives__0__mode=5), "primitives.0.mode is 5; allowed: 4"),
    (on_json(nodes__0__fur=1), "nodes.0.fur is not read; export it again without it"),
    (on_json(samplers=[{"wrapS": 33071}], textures__0__sampler=0), "repeats otherwise along u than along v"),
    (quantised, "POSITION is stored as VEC3 5120 normalized; allowed: VEC3 5126; gltf-transform dequantize"),
    (coloured("u1"), "COLOR_0 is stored as VEC3 5121; allowed: VEC3 5126, VEC3 5121 normalized"),
    (coloured("f4", textured=True), "'card' has a texture and colours of vertices that differ; allowed: one of them"),
    (emitting(), "the textures of 'paint' have different samplers"),
    (emitting(alphaMode="BLEND"), "the surface of 'card' emits light and is not opaque"),
    (
        on_json(materials__0__extensions={"KHR_materials_emissive_strength": {"emissiveStrength": "4"}}),
        "of 'paint' is '4'",
    ),
    (on_json(images__0={"uri": "missing.png"}), "the texture 'missing.png' does not exist"),
    (on_json(images__0={"uri": "../secret.png"}), "the texture '../secret.png' is outside the mesh's folder"),
    (on_json(images__0={"uri": "%2e%2e/secret.png"}), "is outside the mesh's folder"),
    (on_json(images__0={"uri": "/etc/hostname"}), "is outside the mesh's folder"),
    (on_json(images__0={"uri": "C:\\a.png"}), "does not exist"),
    (
        on_json(images__0={"uri": "https://example.org/a.png"}),
        "'https://example.org/a.png' does not exist | copy it beside",
    ),
    (on_json(images__0={"uri": "file:///etc/hostname"}), "does not exist"),
    (on_json(images__0={"uri": "data:image/png;base64,!!"}), "data that are not base64"),
    (
        on_json(images__0={"uri": "data:image/png;base64,AAAA"}),
        "the texture 'of paint' cannot be read: it is no picture; allowed: PNG, JPEG",
    ),
    (on_json(images__0={"uri": "data:;base64," + PAGES}), "cannot be read: it has several pages"),
    (on_json(images__0={}), "the texture 'of paint' cannot be read"),
    (on_json(buffers=[{"byteLength": 1 << 40, "uri": "data:;base64,AAAA"}]), "the mesh is damaged"),
    (on_json(buffers=[{"byteLength": 8, "uri": "gone.bin"}]), "the buffer 'gone.bin' does not exist"),
    (on_json(buffers=[]), "the mesh is damaged"),
    (on_json(bufferViews__1__byteLength=1 << 30), "the mesh is damaged"),
    (on_json(bufferViews__1__byteOffset=-4), "bufferViews.1.byteOffset is -4"),
    (on_json(accessors__0__count=1 << 40), "more than 30,000,000 corners"),
    (on_json(accessors__0={"componentType": 5126, "count": 3, "type": "VEC3"}), "accessors.0.bufferView is missing"),
    (on_json(accessors__0__count=9), "the mesh is damaged"),
    (on_json(accessors__0__bufferView=-1), "accessors.0.bufferView is -1"),
    (on_json(meshes__0__primitives__0__material=True), "material is True"),
    (on_json(accessors__0__componentType=5130), "accessors.0.componentType is 5130"),
    (on_json(accessors__0__type="VEC2"), "POSITION is stored as VEC2 5126; allowed: VEC3 5126"),
    (on_json(accessors__2__count=5), "the mesh is damaged"),
    (on_json(meshes__0__primitives__0__indices=77), "accessor that does not exist"),
    (on_json(meshes__0__primitives__0__material=7), "the mesh is damaged"),
    (on_json(**{f"{BASE}__index": 7}), "the texture of 'paint' does not exist"),
    (on_json(materials__0__alphaMode="DITHER"), "materials.0.alphaMode is 'DITHER'"),
    (on_json(nodes__0__children=[0]), "the nodes form a circle"),
    (on_json(nodes__0__children=[9]), "node, mesh, camera or accessor that does not exist"),
    (on_json(nodes__0__camera=0), "camera or accessor that does not exist"),
    (on_json(nodes__0__matrix=[1, 2]), "nodes.0.matrix"),
    (on_json(scenes__0__nodes=[5]), "node, mesh, camera or accessor that does not exist"),
    (on_json(scene=3), "names a scene"),
    (on_json(meshes__0__primitives=[]), "meshes.0.primitives is []"),
    (on_json(asset={"version": "1.0"}), "asset.version is '1.0'; allowed: '2.0'"),
    (on_json(asset={"version": "2.1", "minVersion": "2.1"}), "asset.version is '2.1'; allowed: '2.0'"),
    (on_json(asset={}), "asset.version is missing"),
    (on_json(nodes__0__mesh="0x"), "nodes.0.mesh is '0x'"),
    (on_json(nodes__0__scale=[0, 0, 0]), "the mesh has no size"),
    (bad_points(np.nan), "a coordinate of 'card' is not a finite number"),
    (bad_points(np.inf), "a coordinate of 'card' is not a finite number"),
    (lambda file: file.add_card(faces=FACES + 3), "a face of 'card' names the vertex 6"),
    (lambda file: file.add_card(faces=FACES * 0 + 65535), "names the vertex 65535"),
    (lambda file: file.add_card(faces=None, points=POINTS), "the mesh is damaged"),
    (lambda file: file.add_card(mode=0), "primitives.0.mode is 0; allowed: 4"),
    (lambda file: (file.add_mesh(), file.add_node(name="empty")), "the file has no mesh with a face"),
]


@pytest.mark.parametrize(("change", "message"), REFUSED, ids=[f"{n} {line}" for n, (_, line) in enumerate(REFUSED)])
@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_a_gltf_file_that_cannot_be_read_is_refused(tmp_path, change, message, suffix):
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.png").write_bytes(encode(FOUR, "png"))
    file = Gltf()
    change(file)
    assert_says(refusal(scene_of_mesh, file.save(tmp_path / f"in/a{suffix}"), "mine"), message)


def test_a_link_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.png").write_bytes(encode(FOUR, "png"))
    (tmp_path / "in/print.png").symlink_to(tmp_path / "secret.png")
    file = Gltf()
    on_json(images__0={"uri": "print.png"})(file)
    assert "outside the mesh's folder" in str(refusal(scene_of_mesh, file.save(tmp_path / "in/a.gltf"), "mine"))


def whole_glb(tmp_path):
    file = Gltf()
    file.add_card()
    return file.save(tmp_path / "whole.glb").read_bytes()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda data: data[:-1], "bytes, and says"),
        (lambda data: data[:40], "bytes, and says"),
        (lambda data: data[:9], "not a complete GLB"),
        (lambda data: data + b"\0" * 8, "bytes, and says"),
        (
            lambda data: data[:4] + struct.pack("<I", 1) + data[8:],
            "a.glb: the file is glTF 1.0; allowed: 2.0; export it again",
        ),
        (lambda data: data[:8] + struct.pack("<I", 1 << 31) + data[12:], "bytes, and says"),
        (lambda data: data[:12] + struct.pack("<I", 1 << 31) + data[16:], "not a complete GLB"),
        (lambda data: data[:16] + b"WXYZ" + data[20:], "not a complete GLB"),
        (lambda data: data[:20] + b"\xff\xff" + data[22:], "this is not JSON"),
        (lambda data: b"PK\3\4" + data, "it does not begin with glTF"),
        (lambda data: b"", "not a complete GLB"),
    ],
)
def test_a_damaged_glb_is_refused(tmp_path, damage, message):
    (tmp_path / "a.glb").write_bytes(damage(whole_glb(tmp_path)))
    assert_says(refusal(scene_of_mesh, tmp_path / "a.glb", "mine"), message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "this is not JSON"),
        ("[1, 2]", "the file is [1, 2]; allowed: an object"),
        ("[" * 100_000, "this is not JSON"),
        (
            '{"asset": {"version": "2.0"}, "nodes": [{"scale": [1, 1, NaN]}]}',
            "nodes.0.scale.2 is nan; allowed: a finite number",
        ),
        ('{"asset": {"version": "2.0"}, "nodes": 7}', "nodes is 7"),
        ('{"asset": {"version": "2.0"}, "scene": 1e400}', "scene is"),
        ('{"asset": {"version": "2.0"}}', "names a scene"),
        ("\ufeff" + '{"asset": {"version": "3.0"}}', "asset.version is '3.0'"),
    ],
)
def test_a_damaged_gltf_document_is_refused(tmp_path, text, message):
    (tmp_path / "a.gltf").write_text(text)
    assert_says(refusal(scene_of_mesh, tmp_path / "a.gltf", "mine"), message)


V = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
F = "usemtl m\nf 1/1 2/2 3/3\n"


@pytest.mark.parametrize(
    ("text", "mtl", "message"),
    [
        (V + "f 1 2 4\n", "", "a face names the vertex 4, and the file has 3"),
        (V + "f 1 2 -4\n", "", "a.obj:7: | names the vertex -4"),
        (V + "f 0 1 2\n", "", "names the vertex 0"),
        (V + "f 1/9 2/2 3/3\n", "", "texture coordinate 9"),
        (V + "f 1//1 2//1 3//1\n", "", "normal 1"),
        (V + "f a b c\n", "", "a.obj:7: a face has the corner 'a'"),
        (V + "f 1/2/3/4 2 3\n", "", "a face has the corner '1/2/3/4'"),
        (V + "f 1 2\n", "", "a.obj:7: a face has 2 corners; allowed: 3 or more"),
        (V + "f 1/1 2/2 3\n", "", "a.obj:7: a corner of a face lacks the texture coordinates or the normal of another"),
        ("mtllib a.mtl\n" + V + F + "f 1 2 3\n", "map_Kd print.png", "'m' have a texture and no texture coordinates"),
        (V + "v 0.1 0.1 0\nf 1 4 2 3\n", "", "a face of 4 corners is not convex; allowed: triangles"),
        (V + "v 1 1 0\nf 1 4 2 3\n", "", "a face of 4 corners is not convex"),  # it crosses itself: its area is 0
        (V + "v 9 9 9\nf 1 2 3\nf 1 2 4 3\nf 1 2 3 2 4\n", "", "a face of 5 corners is not convex"),
        ("v 0 0\n" + V + "f 1 2 3\n", "", "a.obj:1: v has 2 numbers; allowed: 3 or 6"),
        (V + "v 0 0\nf 1 2 3\n", "", "a.obj:7: v has 2 numbers; allowed: 3 or 6"),
        (V + "v 0 0 0 1 0 0\nf 1 2 3\n", "", "a.obj:7: v has 6 numbers; allowed: 3 or 6, as many in each line"),
        (
            "v 0 0 0 255 0 0\nv 1 0 0 0 0 0\nv 0 1 0 0 0 0\nf 1 2 3\n",
            "",
            "a.obj:1: v has a colour that is not from 0 to 1",
        ),
        ("vt\n" + V + "f 1 2 3\n", "", "a.obj:1: vt has 0 numbers; allowed: 2 or 3"),
        ("v 0 x 0\n" + V + "f 1 2 3\n", "", "a.obj:1: could not convert string to float: 'x'"),
        (V.replace("1 0 0", "inf 0 0", 1) + "f 1 2 3\n", "", "a.obj:2: v has a value that is not a finite number"),
        (V.replace("1 0 0", "nan 0 0", 1) + "f 1 2 3\n", "", "a.obj:2: v has a value that is not a finite number"),
        (V, "", "the file has no mesh with a face"),
        (V + "l 1 2 3\n", "", "no mesh with a face; points and lines ignored"),
        (V + "f 1 2 3\ncstype bezier\n", "", "a.obj:8: 'cstype' is not read; allowed: v, vt, vn, f"),
        ("call other.obj\n" + V + F, "", "'call' is not read"),
        ("mtllib gone.mtl\n" + V + F, "", "the material library 'gone.mtl' does not exist"),
        ("mtllib ../b.mtl\n" + V + F, "", "is outside the mesh's folder"),
        ("mtllib /etc/passwd\n" + V + F, "", "is outside the mesh's folder"),
        ("mtllib a.mtl\nmtllib b.mtl\n" + V + F, "", "a second mtllib; allowed: one"),
        ("mtllib a.mtl\n" + V + F, "map_Kd gone.png", "the texture 'gone.png' does not exist"),
        ("mtllib a.mtl\n" + V + F, "map_Kd ../secret.png", "the texture '../secret.png' is outside"),
        ("mtllib a.mtl\n" + V + F, "map_Kd C:\\Users\\me\\a.png", "does not exist"),
        ("mtllib a.mtl\n" + V + F, "map_Kd a.obj", "the texture 'a.obj' cannot be read: it is no picture"),
        (
            "mtllib a.mtl\n" + V + F,
            "map_Kd deep.png",
            "its values are of Pillow's mode I;16, not grey or RGB of 8 bits",
        ),
        (
            "mtllib a.mtl\n" + V + F,
            "map_Kd -s 2 2 2 print.png",
            "'map_Kd -s 2 2 2 print.png'; allowed: a file name without",
        ),
        ("mtllib a.mtl\n" + V + F, "map_d print.png", "the material 'm' has 'map_d print.png'; allowed: kd, map_kd"),
        ("mtllib a.mtl\n" + V + F, "map_Ke print.png", "the material 'm' has 'map_ke print.png'; allowed"),
        ("mtllib a.mtl\n" + V + F, "Kd 1 0", "'kd 1 0'; allowed: 3 from 0 to 1"),
        ("mtllib a.mtl\n" + V + F, "Kd 2 1 1", "'kd 2 1 1'; allowed: 3 from 0 to 1"),
        ("mtllib a.mtl\n" + V + F, "Kd nan 1 1", "'kd nan 1 1'"),
        ("mtllib a.mtl\n" + V + F, "Kd spectral a.rfl", "'kd spectral a.rfl'"),
        ("mtllib a.mtl\n" + V + F, "d 1.5", "'d 1.5'; allowed: 1 from 0 to 1"),
        ("mtllib a.mtl\n" + V + F, "Ke -1 0 0", "'ke -1 0 0'"),
        ("mtllib a.mtl\n" + V + F, "Ke 1e200 0 0", "'ke 1e200 0 0'"),
        ("mtllib a.mtl\n" + V + F, "Ke 1 0 0\nd 0.5", "the surface of 'm' emits light and is not opaque"),
        ("mtllib a.mtl\n" + V + F, "d 0", "the mesh cannot be seen: its opacity is 0"),
        ("mtllib a.mtl\n" + V + "usemtl m\nf 1 2 3\n", "map_Kd print.png", "a texture and no texture coordinates"),
    ],
)
def test_an_obj_file_that_cannot_be_read_is_refused(tmp_path, text, mtl, message):
    (tmp_path / "in").mkdir()
    for place in ("secret.png", "in/print.png"):
        (tmp_path / place).write_bytes(encode(FOUR, "png"))
    (tmp_path / "in/a.mtl").write_text(f"newmtl m\n{mtl}\n")
    (tmp_path / "b.mtl").write_text("newmtl m\n")
    Image.new("I;16", (4, 4)).save(tmp_path / "in/deep.png")
    (tmp_path / "in/a.obj").write_text(text)
    assert_says(refusal(scene_of_mesh, tmp_path / "in/a.obj", "mine"), message)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
@pytest.mark.parametrize("file", ["a.obj", "a.mtl"])
def test_obj_files_that_are_not_utf_8_are_refused_without_their_bytes(tmp_path, encoding, file):
    texts = {"a.obj": "mtllib a.mtl\n" + V + F, "a.mtl": "newmtl m\nKd 1 0 0\n"}
    for name, text in texts.items():
        (tmp_path / name).write_bytes(text.encode(encoding if name == file else "utf-8"))
    error = refusal(scene_of_mesh, tmp_path / "a.obj", "mine")
    assert str(error) == f"{tmp_path / file}: this is not text in UTF-8 or ASCII; save it as UTF-8"


@pytest.mark.parametrize(
    ("text", "mtl", "line"),
    [
        (V + F, None, "materials are grey, because the file names no mtllib: m"),
        (
            "mtllib a.mtl\n" + V + F,
            "newmtl other\nKd 1 0 0\n",
            "materials are grey, because its mtllib does not have them: m",
        ),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nKd 1 0 0\nKs 1 1 1\n", "ks ignored: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nbump print.png\n", "bump ignored: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nmap_Ks gone.png\n", "map_ks ignored: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nPm 1\n", "pm ignored: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nTf 0.5 0.5 0.5\n", "tf ignored: m"),
        (V + "f 1 2 3\nl 1 2\n", None, "points and lines ignored"),
    ],
)
def test_what_is_left_out_of_an_obj_file_is_said(tmp_path, text, mtl, line):
    (tmp_path / "print.png").write_bytes(encode(FOUR, "png"))
    (tmp_path / "a.mtl").write_text(mtl or "")
    (tmp_path / "a.obj").write_text(text)
    said = []
    scene_of_mesh(tmp_path / "a.obj", "mine", notify=said.append)
    assert said == [line]


HEAD = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 1\nproperty list uchar int vertex_indices\n"
ROWS = "0 0 0\n1 0 0\n0 1 0\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + FACE + "end_header\n" + ROWS + "3 0 1 3\n", "a face names the vertex 3"),
        (HEAD + FACE + "end_header\n" + ROWS + "3 0 1 -1\n", "a face names the vertex -1"),
        (HEAD + FACE + "end_header\n" + ROWS + "3 0 1\n", "a face of 2 corners; allowed: triangles"),
        (HEAD + FACE + "end_header\n" + ROWS, "the mesh is damaged"),
        (HEAD + FACE + "end_header\n" + ROWS.replace("1 0 0", "1 nan 0") + "3 0 1 2\n", "is not a finite number"),
        (HEAD + FACE + "end_header\n" + ROWS.replace("1 0 0", "1 a 0") + "3 0 1 2\n", "the mesh is damaged"),
        (HEAD + "end_header\n" + ROWS, "the file has no mesh with a face"),
        (
            HEAD.replace("float z", "float w") + FACE + "end_header\n" + ROWS + "3 0 1 2\n",
            "the vertices have x, y, w; allowed: x, y, z",
        ),
        (
            "ply\nformat ascii 1.0\ncomment TextureFile gone.png"
            + HEAD[20:]
            + FACE
            + "end_header\n"
            + ROWS
            + "3 0 1 2\n",
            "'gone.png' does not exist",
        ),
        (HEAD.replace("ascii", "binary_little_endian") + FACE + "end_header\n" + ROWS, "the mesh is damaged"),
        ("solid a\n", "the mesh is damaged: its header"),
        (HEAD + FACE + "end_header\n" + ROWS + "4 0 1 2 1\n", "a face of 4 corners; allowed: triangles"),
        (
            HEAD + FACE.replace("vertex_indices", "ring") + "end_header\n" + ROWS + "3 0 1 2\n",
            "the faces have ring; allowed: vertex_index or vertex_indices",
        ),
        (HEAD + FACE + FACE + "end_header\n" + ROWS + "3 0 1 2\n3 2 1 0\n", "two elements or properties of one name"),
        (HEAD + "property float x\n" + FACE + "end_header\n" + ROWS.replace("\n", " 9\n") + "3 0 1 2\n", "of one name"),
        (
            HEAD + FACE + "element edge 1\nproperty int vertex1\nend_header\n" + ROWS + "3 0 1 2\n0\n",
            "the mesh has 1 rows of 'edge'; allowed: vertex, face",
        ),
        (
            HEAD + FACE + "property uchar red\nend_header\n" + ROWS + "3 0 1 2 9\n",
            "the faces have colours; allowed: colours of vertices",
        ),
        (
            HEAD + "property float red\n" + FACE + "end_header\n" + ROWS.replace("\n", " 1\n") + "3 0 1 2\n",
            "allowed: uchar red, green, blue",
        ),
    ],
)
def test_a_ply_file_that_cannot_be_read_is_refused(tmp_path, text, message):
    (tmp_path / "a.ply").write_text(text)
    assert_says(refusal(scene_of_mesh, tmp_path / "a.ply", "mine"), message)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n", "0 complete facets"),
        (
            b"solid a\nfacet normal 0 0 1\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 x 0\nendfacet\nendsolid\n",
            "the mesh is damaged",
        ),
        (
            b"solid a\nfacet normal 0 0 1\nvertex 0 0\nvertex 1 0 0 0\nvertex 1 1 0\nendfacet\nendsolid\n",
            "'vertex 0 0'",
        ),
        (
            b"solid a\nfacet normal 0 0 1 outer loop vertex 0 0 0\nendsolid\n",
            "it has the line 'facet normal 0 0 1 outer",
        ),
        (bytes(80) + struct.pack("<I", 2) + bytes(50), "the mesh is damaged: 134 bytes"),
        (bytes(80) + struct.pack("<I", 0), "the file has no mesh with a face"),
        (bytes(80) + struct.pack("<I", 1) + bytes(50), "the mesh has no size"),
        (bytes(80) + struct.pack("<I12fH", 1, *[0.0] * 9, np.nan, 0, 0, 0), "is not a finite number"),
        (b"", "the mesh is damaged"),
        (b"<html>", "the mesh is damaged"),
    ],
)
def test_an_stl_file_that_cannot_be_read_is_refused(tmp_path, data, message):
    (tmp_path / "a.stl").write_bytes(data)
    assert_says(refusal(scene_of_mesh, tmp_path / "a.stl", "mine"), message)


@pytest.mark.parametrize(
    ("properties", "line"),
    [
        ("uchar red:uchar green:uchar blue:uchar alpha", "opacity of vertices ignored"),
        ("float w", "properties ignored: w"),
    ],
)
def test_what_is_left_out_of_a_ply_file_is_said(tmp_path, properties, line):
    kinds = "".join(f"property {words}\n" for words in properties.split(":"))
    rows = ROWS.replace("\n", " 9" * kinds.count("\n") + "\n")
    (tmp_path / "a.ply").write_text(HEAD + kinds + FACE + "end_header\n" + rows + "3 0 1 2\n")
    said = []
    scene_of_mesh(tmp_path / "a.ply", "mine", notify=said.append)
    assert said == [line]


def test_a_comment_does_not_change_the_order_of_the_bytes(tmp_path):
    """trimesh takes the second line for that of the format, and would read the rows as little-endian."""
    head = HEAD.replace("format ascii", "comment a\nformat binary_big_endian") + FACE + "end_header\n"
    rows = np.array(ROWS.split(), ">f4").tobytes()
    (tmp_path / "a.ply").write_bytes(head.encode() + rows + b"\x03" + np.array([0, 1, 2], ">i4").tobytes())
    files = scene_of_mesh(tmp_path / "a.ply", "mine")
    assert "scaled by 0.1," in files["SOURCE.md"].decode()


def test_colours_of_stl_facets_are_said(tmp_path):
    corners = [0, 0, 1, *POINTS[:3].ravel().tolist()]
    (tmp_path / "a.stl").write_bytes(bytes(80) + struct.pack("<I12fH", 1, *corners, 0x801F))
    said = []
    scene_of_mesh(tmp_path / "a.stl", "mine", notify=said.append)
    assert said == ["colours of facets ignored"]


def test_a_huge_picture_is_refused_before_it_is_decoded(tmp_path):
    data = bytearray(encode(FOUR, "png"))
    data[16:24] = struct.pack(">II", 60_000, 60_000)
    (tmp_path / "print.png").write_bytes(data)
    file = Gltf()
    on_json(images__0={"uri": "print.png"})(file)
    assert_says(refusal(scene_of_mesh, file.save(tmp_path / "a.gltf"), "mine"), "the texture 'of paint' cannot be read")


def test_a_gltf_file_may_have_its_buffer_beside_it(tmp_path):
    file = Gltf()
    file.add_card()
    file.save(tmp_path / "a.gltf", beside=True)
    assert json.loads((tmp_path / "a.gltf").read_text())["buffers"][0]["uri"] == "a.bin"
    assert show(tmp_path / "a.gltf")[0] == pytest.approx(np.full((8, 8, 3), 0.6), abs=4e-3)
