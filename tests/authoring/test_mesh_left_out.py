"""What of a mesh is left out is said in a line, and what cannot be read is refused in one."""

import base64
import io
import json
import struct

import numpy as np
import pytest
from mesh_cards import FACES, POINTS, UV, Gltf, blocks, encode, quarters, show
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
        file.add_card()
        file.json |= top

    return change


def with_other_primitive(**primitive):
    def change(file):
        node = file.add_card()
        mesh = file.json["nodes"][node]["mesh"]
        file.json["meshes"][mesh]["primitives"].append({"attributes": {"POSITION": 0}, **primitive})

    return change


def with_nodes(*nodes):
    def change(file):
        file.add_card()
        for node in nodes:
            file.add_node(**node)

    return change


def with_attribute(key):
    def change(file):
        file.add_card(attributes={key: file.add_array(np.ones((4, 3), np.float32))})

    return change


def with_other_emission(file):
    number = file.add_texture(FOUR)
    emission = {"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": number, "texCoord": 1}}
    file.add_card(
        material=file.add_material(name="paint", pbr={"baseColorTexture": {"index": number}}, **emission), uv=(UV, UV)
    )


def with_other_sampler(file):
    use = {"index": file.add_texture(FOUR)}
    other = {"index": file.add_texture(FOUR, sampler={"wrapS": 33071, "wrapT": 33071})}
    glow = {"emissiveFactor": [1, 1, 1], "emissiveTexture": other}
    file.add_card(material=file.add_material(name="paint", pbr={"baseColorTexture": use}, **glow))


def with_morph(file):
    file.add_card(targets=[{"POSITION": file.add_array(POINTS * 3)}])


def with_two_wraps(file):
    sampler = {"wrapS": 33071, "wrapT": 10497}
    pbr = {"baseColorTexture": {"index": file.add_texture(FOUR, sampler=sampler)}}
    file.add_card(material=file.add_material(name="paint", pbr=pbr))


def with_normals_of_no_length(file):
    file.add_card(attributes={"NORMAL": file.add_array(np.zeros((4, 3), np.float32))})


def with_hidden_part(file):
    file.add_card(name="shown")
    file.add_card(name="hidden", material=file.add_material(pbr={"baseColorFactor": [1, 1, 1, 0]}, alphaMode="BLEND"))


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
    (extension("XYZ_materials_toon"), "extensions ignored: XYZ_materials_toon"),
    (extension("KHR_materials_pbrSpecularGlossiness", diffuseFactor=[1, 1, 1, 1]), "gloss ignored: paint"),
    (material(doubleSided=True, emissiveFactor=[1, 1, 1]), "emission of back sides ignored: paint"),
    (on_file(extensionsUsed=["XYZ_metadata"]), "extensions ignored: XYZ_metadata"),
    (on_file(extensions={"KHR_materials_variants": {}}), "material variants ignored, the default is used"),
    (on_file(animations=[{}]), "animation ignored, the pose of the nodes is used"),
    (on_file(scenes=[{"nodes": [0]}, {"name": "other"}]), "scenes ignored: other"),
    (with_other_primitive(mode=6, extensions={"XYZ_fur": {}}), "extensions ignored: XYZ_fur"),
    (with_nodes({"camera": 0, "name": "eye"}), "cameras ignored: eye"),
    (with_nodes({"extensions": {"KHR_lights_punctual": {"light": 0}}, "name": "sun"}), "lamps ignored: sun"),
    (with_other_primitive(mode=0), "points and lines ignored: card_2"),
    (with_other_primitive(mode=3), "points and lines ignored: card_2"),
    (with_attribute("COLOR_1"), "second vertex colours ignored: card"),
    (with_other_emission, "emission ignored, its texture has other coordinates than the colour's: paint"),
    (with_other_sampler, "sampler of the emission ignored, that of the colour is used: paint"),
    (with_morph, "morph targets ignored, their weights are 0: card"),
    (with_two_wraps, "wrapT ignored, wrapS is used for both axes: paint"),
    (with_normals_of_no_length, "normals ignored, some have no length: card"),
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


def compressed(file):
    node = file.add_card()
    mesh = file.json["nodes"][node]["mesh"]
    for accessor in file.json["accessors"]:
        del accessor["bufferView"]
    file.json["meshes"][mesh]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0}}


def packed(file):
    file.add_card()
    file.json["buffers"] = [{"byteLength": 4096}, {"byteLength": 99}]
    file.json["bufferViews"][0] |= {"buffer": 1, "extensions": {"EXT_meshopt_compression": {}}}
    file.data += bytes(4096)


def pages():
    """Return a TIFF file of two pages."""
    buffer = io.BytesIO()
    one = Image.fromarray(FOUR)
    one.save(buffer, "tiff", save_all=True, append_images=[one])
    return buffer.getvalue()


PAGES = base64.b64encode(pages()).decode()
REQUIRED = "the file requires {}, which saf_gen cannot read"
REFUSED = [
    (
        on_json(extensionsRequired=["KHR_draco_mesh_compression"]),
        REQUIRED.format("KHR_draco_mesh_compression") + " | without compr",
    ),
    (
        on_json(extensionsRequired=["EXT_meshopt_compression"]),
        REQUIRED.format("EXT_meshopt_compression") + " | without compr",
    ),
    (on_json(extensionsRequired=["KHR_texture_basisu"]), REQUIRED.format("KHR_texture_basisu") + " | ktxdecompress"),
    (on_json(extensionsRequired=["XYZ_voxels"]), REQUIRED.format("XYZ_voxels") + " | export it without XYZ_voxels"),
    (compressed, "the mesh 'card' is compressed with Draco | without compression"),
    (packed, "compressed with meshopt | without compression"),
    (
        on_json(textures__0={"extensions": {"KHR_texture_basisu": {"source": 0}}}),
        "is stored by KHR_texture_basisu | ktxdecompress",
    ),
    (on_json(images__0={"uri": "missing.png"}), "the texture 'missing.png' does not exist"),
    (on_json(images__0={"uri": "../secret.png"}), "the texture '../secret.png' is outside the mesh's folder"),
    (on_json(images__0={"uri": "%2e%2e/secret.png"}), "is outside the mesh's folder"),
    (on_json(images__0={"uri": "/etc/hostname"}), "is named by an absolute path"),
    (on_json(images__0={"uri": "C:\\a.png"}), "is named by an absolute path"),
    (on_json(images__0={"uri": "https://example.org/a.png"}), "is on another machine"),
    (on_json(images__0={"uri": "file:///etc/hostname"}), "is on another machine"),
    (on_json(images__0={"uri": "data:image/png;base64,!!"}), "data that are not base64"),
    (
        on_json(images__0={"uri": "data:image/png;base64,AAAA"}),
        "the texture 'image 0' cannot be read: it is no picture",
    ),
    (on_json(images__0={"uri": "data:;base64," + PAGES}), "cannot be read: it has several pages"),
    (on_json(images__0={"uri": "data:;base64,q0tUWCAyMLsNChoK"}), "it is a KTX2 file; | ktxdecompress"),
    (on_json(images__0={}), "image 0 has no data"),
    (on_json(buffers=[{"byteLength": 1 << 40, "uri": "data:;base64,AAAA"}]), "has 3 bytes, not the 1,099,511,627,776"),
    (on_json(buffers=[{"byteLength": 8, "uri": "gone.bin"}]), "the buffer 'gone.bin' does not exist"),
    (on_json(buffers=[]), "buffer 0 does not exist"),
    (on_json(bufferViews__1__byteLength=1 << 30), "ends after the"),
    (on_json(bufferViews__1__byteOffset=-4), "bufferViews.1.byteOffset is -4"),
    (on_json(accessors__0__count=1 << 40), "numbers; allowed: up to"),
    (
        on_json(accessors__0={"componentType": 5126, "count": 2_000_001, "type": "VEC3"}),
        "accessor 0 has 6,000,003 numbers; allowed: up to 6,000,000",
    ),
    (on_json(accessors__0__count=9), "the file is shorter than it says"),
    (on_json(accessors__0__componentType=5130), "accessors.0.componentType is 5130"),
    (on_json(accessors__0__type="VEC2"), "has the type VEC2; allowed: VEC3"),
    (on_json(accessors__2__count=5), "5 corners, which is not a multiple of 3"),
    (on_json(meshes__0__primitives__0__indices=77), "accessor 77 does not exist"),
    (on_json(meshes__0__primitives__0__material=7), "material 7 does not exist"),
    (on_json(materials__0__pbrMetallicRoughness__baseColorTexture={"index": 0, "texCoord": 3}), "TEXCOORD_3"),
    (on_json(materials__0__alphaMode="DITHER"), "materials.0.alphaMode is 'DITHER'"),
    (on_json(nodes__0__children=[0]), "its nodes form a circle"),
    (on_json(nodes__0__children=[9]), "node 9 does not exist"),
    (on_json(nodes__0__matrix=[1, 2]), "nodes.0.matrix"),
    (on_json(scenes__0__nodes=[5]), "node 5 does not exist"),
    (on_json(scene=3), "scene 3 does not exist"),
    (on_json(meshes__0__primitives=[]), "the file has no mesh with a face"),
    (on_json(asset={"version": "1.0"}), "the file is glTF 1.0; allowed: glTF 2.0"),
    (on_json(asset={"version": "2.1", "minVersion": "2.1"}), "the file needs glTF 2.1; allowed: glTF 2.0"),
    (on_json(asset={}), "the file is not glTF; allowed: glTF 2.0"),
    (on_json(nodes__0__mesh="0x"), "nodes.0.mesh is '0x'"),
    (on_json(nodes__0__scale=[0, 0, 0]), "the mesh has no size"),
    (bad_points(np.nan), "a coordinate of 'card' is not a finite number"),
    (bad_points(np.inf), "a coordinate of 'card' is not a finite number"),
    (lambda file: file.add_card(faces=FACES + 3), "a face of 'card' names the vertex 6"),
    (lambda file: file.add_card(faces=FACES * 0 + 65535), "names the vertex 65535"),
    (lambda file: file.add_card(faces=None, points=POINTS), "4 corners, which is not a multiple of 3"),
    (lambda file: file.add_card(mode=0), "no mesh with a face; points and lines ignored: card"),
    (lambda file: None, "the file has no mesh with a face"),
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
        (lambda data: data[:4] + struct.pack("<I", 1) + data[8:], "the file is glTF 1"),
        (lambda data: data[:8] + struct.pack("<I", 1 << 31) + data[12:], "bytes, and says"),
        (lambda data: data[:12] + struct.pack("<I", 1 << 31) + data[16:], "not a complete GLB"),
        (lambda data: data[:16] + b"WXYZ" + data[20:], "not a complete GLB"),
        (lambda data: data[:20] + b"\xff\xff" + data[22:], "this is not JSON"),
        (lambda data: b"PK\3\4" + data, "it does not begin with glTF"),
        (lambda data: b"", "it does not begin with glTF"),
    ],
)
def test_a_damaged_glb_is_refused(tmp_path, damage, message):
    (tmp_path / "a.glb").write_bytes(damage(whole_glb(tmp_path)))
    assert_says(refusal(scene_of_mesh, tmp_path / "a.glb", "mine"), message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "this is not JSON"),
        ("[1, 2]", "the file is not glTF; allowed: glTF 2.0"),
        ("[" * 100_000, "this is not JSON"),
        ('{"asset": {"version": "2.0"}, "nodes": [{"scale": [1, 1, NaN]}]}', "NaN is not a number of JSON"),
        ('{"asset": {"version": "2.0"}, "nodes": 7}', "nodes is 7"),
        ('{"asset": {"version": "2.0"}, "scene": 1e400}', "scene is"),
        ('{"asset": {"version": "2.0"}}', "the file has no mesh with a face"),
        ("\ufeff" + '{"asset": {"version": "3.0"}}', "the file is glTF 3.0"),
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
        (V + "f a b c\n", "", "a.obj:7: the mesh is damaged"),
        (V + "f 1/2/3/4 2 3\n", "", "a face has the corner '1/2/3/4'"),
        ("v 0 0\n" + V + "f 1 2 3\n", "", "fewer than 3 numbers"),
        ("vt\n" + V + "f 1 2 3\n", "", "a.obj:1: the mesh is damaged"),
        ("v 0 x 0\n" + V + "f 1 2 3\n", "", "a.obj:1: the mesh is damaged"),
        (V.replace("1 0 0", "inf 0 0", 1) + "f 1 2 3\n", "", "is not a finite number"),
        (V, "", "the file has no mesh with a face"),
        (V + "l 1 2 3\n", "", "no mesh with a face; points and lines ignored"),
        ("mtllib gone.mtl\n" + V + F, "", "the material library 'gone.mtl' does not exist"),
        ("mtllib ../a.mtl\n" + V + F, "", "is outside the mesh's folder"),
        ("mtllib /etc/hostname\n" + V + F, "", "named by an absolute path"),
        ("mtllib a.mtl\n" + V + F, "map_Kd gone.png", "the texture 'gone.png' does not exist"),
        ("mtllib a.mtl\n" + V + F, "map_Kd ../secret.png", "the texture '../secret.png' is outside"),
        ("mtllib a.mtl\n" + V + F, "map_Kd C:\\Users\\me\\a.png", "named by an absolute path"),
        ("mtllib a.mtl\n" + V + F, "map_Kd a.obj", "the texture 'a.obj' cannot be read"),
        ("mtllib a.mtl\n" + V + F, "Kd 1 0", "Kd is '1 0'"),
        ("mtllib a.mtl\n" + V + F, "Kd red green blue", "Kd is 'red green blue'"),
        ("mtllib a.mtl\n" + V + F, "d 1.5", "its opacity is 1.5"),
        ("mtllib a.mtl\n" + V + F, "Ke -1 0 0", "the emission of 'm' is -1 0 0; allowed: 0 or more"),
        ("mtllib a.mtl\n" + V + F, "Ke 1e200 0 0", "the emission of 'm' is 1e+200 0 0"),
        ("mtllib a.mtl\n" + V + F, "d 0", "the mesh cannot be seen: its opacity is 0"),
        ("mtllib a.mtl\n" + V + "usemtl m\nf 1 2 3\n", "map_Kd print.png", "a texture and no texture coordinates"),
        ("mtllib a.mtl\n" + V + F, "map_Kd -s 2 2 2 print.png\nmap_d print.png", "different options -o, -s or -clamp"),
        ("call other.obj\n" + V + F, "", "call is refused"),
    ],
)
def test_an_obj_file_that_cannot_be_read_is_refused(tmp_path, text, mtl, message):
    (tmp_path / "in").mkdir()
    for place in ("secret.png", "in/print.png"):
        (tmp_path / place).write_bytes(encode(FOUR, "png"))
    (tmp_path / "in/a.mtl").write_text(f"newmtl m\n{mtl}\n")
    (tmp_path / "in/a.obj").write_text(text)
    error = refusal(scene_of_mesh, tmp_path / "in/a.obj", "mine")
    assert_says(error, message.replace("Kd is", "kd is"))


@pytest.mark.parametrize(
    ("text", "mtl", "line"),
    [
        (V + F, None, "materials are grey, because the file names no mtllib: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl other\nKd 1 0 0\n", "materials are grey, because no mtllib has them: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nKd 1 0 0\nKs 1 1 1\n", "specular reflection ignored: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nbump print.png\n", "bump map ignored: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nmap_Ks gone.png\n", "specular map ignored: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nPm 1\n", "metallic ignored: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nTf 0.5 0.5 0.5\n", "transmission ignored: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nmap_Kd -mm 0 2 print.png\n", "-mm of map_kd ignored: m"),
        (
            "mtllib a.mtl\n" + V + F,
            "newmtl m\nKd 0 0 0\nmap_Kd print.png\n",
            "textures are black, because Kd is 0 0 0: m",
        ),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nKd 2 1 1\n", "Kd above 1 is taken as 1: m"),
        ("mtllib a.mtl\n" + V + F, "newmtl m\nKd spectral a.rfl\n", "kd in spectral ignored: m"),
        (V + "f 1 2 3\nl 1 2\n", None, "points and lines ignored"),
        (V + "f 1 2 3\nf 1 2\n", None, "faces with fewer than 3 corners ignored"),
        (V + "f 1 2 3\ncstype bezier\n", None, "free-form curves and surfaces ignored"),
        (V + "f 1 2 3\nwidget 1 2\n", None, "lines ignored: widget"),
        (V + "vn 0 0 1\nf 1//1 2//1 3\n", None, "normals ignored, some corners have none"),
        ("v 0 0 0 255 0 0\n" + V + "f 1 2 3\n", None, "vertex colours ignored, they are not from 0 to 1"),
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
        (HEAD + FACE + "end_header\n" + ROWS + "3 0 1\n", "a face has"),
        (HEAD + FACE + "end_header\n" + ROWS, "the mesh is damaged"),
        (HEAD + FACE + "end_header\n" + ROWS.replace("1 0 0", "1 nan 0") + "3 0 1 2\n", "is not a finite number"),
        (HEAD + FACE + "end_header\n" + ROWS.replace("1 0 0", "1 a 0") + "3 0 1 2\n", "the mesh is damaged"),
        (HEAD + "end_header\n" + ROWS, "the file has no mesh with a face"),
        (
            HEAD.replace("float z", "float w") + FACE + "end_header\n" + ROWS + "3 0 1 2\n",
            "its vertices lack x, y or z",
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
    ],
)
def test_a_ply_file_that_cannot_be_read_is_refused(tmp_path, text, message):
    (tmp_path / "a.ply").write_text(text)
    assert_says(refusal(scene_of_mesh, tmp_path / "a.ply", "mine"), message)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n", "0 complete facets"),
        (b"solid a\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 x 0\nendfacet\nendsolid\n", "the mesh is damaged"),
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
    assert_says(refusal(scene_of_mesh, file.save(tmp_path / "a.gltf"), "mine"), "'print.png' cannot be read")


def test_the_pose_of_the_joints_places_a_skinned_mesh(tmp_path):
    """Two joints hold the halves of a card; the second one moves its corners by (0, 2, 0). The node is ignored."""
    file = Gltf()
    base = file.add_node(name="base")
    tip = file.add_node(name="tip", translation=[0, 2, 0])
    joints = file.add_array(np.array([[0, 1, 0, 0]] * 4, np.uint8))
    weights = file.add_array(np.array([[1, 0, 0, 0]] * 2 + [[0, 1, 0, 0]] * 2, np.float32))
    file.json["skins"] = [{"joints": [base, tip]}]
    attributes = {"JOINTS_0": joints, "WEIGHTS_0": weights}
    file.add_card(attributes=attributes, node={"skin": 0, "translation": [9, 9, 9]})
    picture, _ = show(file.save(tmp_path / "a.glb"))
    dark = picture[:, :, 0] < 0.99
    assert (dark.any(axis=1).sum(), dark.any(axis=0).sum()) == (8, 4)  # 2 wide and 4 high


def test_morph_weights_move_vertices(tmp_path):
    file = Gltf()
    moved = np.zeros((4, 3), np.float32)
    moved[2:, 1] = 4
    mesh = file.add_mesh(targets=[{"POSITION": file.add_array(moved)}])
    file.add_node(mesh=mesh, name="card", weights=[0.5])
    picture, said = show(file.save(tmp_path / "a.glb"))
    dark = picture[:, :, 0] < 0.99
    assert (dark.any(axis=1).sum(), dark.any(axis=0).sum()) == (8, 4)
    assert said == []


@pytest.mark.parametrize("mode", [4, 5, 6])
def test_lists_strips_and_fans_show_the_same(tmp_path, mode):
    faces = {4: FACES, 5: np.uint16([0, 1, 3, 2]), 6: np.uint16([0, 1, 2, 3])}[mode]
    file = Gltf()
    material = file.add_material(emissiveFactor=[1, 1, 1], pbr={"baseColorFactor": [0, 0, 0, 1]})
    file.add_card(faces=faces, mode=mode, material=material)
    picture, _ = show(file.save(tmp_path / "a.glb"))
    assert quarters(picture) == pytest.approx(np.ones((4, 3)))  # a lamp, which shines from its front


def test_sparse_values_replace_those_of_the_array(tmp_path):
    file = Gltf()
    points = POINTS.copy()
    points[2] = [1, 3, 0]
    card = file.add_card(points=POINTS)
    sparse = {
        "count": 1,
        "indices": {"bufferView": file.add_view(np.uint16([2]).tobytes()), "componentType": 5123},
        "values": {"bufferView": file.add_view(points[2].tobytes())},
    }
    mesh = file.json["meshes"][file.json["nodes"][card]["mesh"]]
    file.json["accessors"][mesh["primitives"][0]["attributes"]["POSITION"]]["sparse"] = sparse
    files = scene_of_mesh(file.save(tmp_path / "a.glb"), "mine")
    data = files["meshes/mesh_card.ply"].split(b"end_header\n")[1]
    found = np.frombuffer(data, "<f4", 12).reshape(4, 3)
    assert found == pytest.approx((points - [0, 1, 0]) / 40, abs=1e-6)


def test_a_gltf_file_may_have_its_buffer_beside_it(tmp_path):
    file = Gltf()
    file.add_card()
    file.save(tmp_path / "a.gltf", beside=True)
    assert json.loads((tmp_path / "a.gltf").read_text())["buffers"][0]["uri"] == "a.bin"
    assert show(tmp_path / "a.gltf")[0] == pytest.approx(np.full((8, 8, 3), 0.6), abs=4e-3)
