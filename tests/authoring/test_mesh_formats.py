"""OBJ with MTL, PLY and STL: what a scene shows of them, and that plain ones look as Mitsuba itself reads them."""

import mitsuba as mi
import numpy as np
import pytest
import trimesh
from mesh_cards import FACES, LUMINANCE, POINTS, UV, blocks, encode, linear, quarters, render, show
from PIL import Image

from saf_gen.authoring.meshes import LeftOut, read_mesh
from saf_gen.render import backend

FOUR = blocks((255, 0, 0), (0, 255, 0), (0, 0, 255), (188, 188, 188))
COLOURS = linear([[255, 0, 0], [0, 255, 0], [0, 0, 255], [188, 188, 188]])
VERTICES = "".join(f"v {x} {y} {z}\n" for x, y, z in POINTS) + "".join(f"vt {u} {1 - v}\n" for u, v in UV)
CARD = VERTICES + "usemtl card\nf 1/1 2/2 3/3 4/4\n"


@pytest.fixture
def obj(tmp_path):
    """A function that writes an OBJ, its MTL and the picture print.png, and returns the picture and what was said."""

    def write(mtl, text="mtllib a.mtl\n" + CARD, *, picture=FOUR, name="print.png", **more):
        (tmp_path / "a.mtl").write_text(mtl)
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(encode(picture, more.pop("kind", "png")))
        (tmp_path / "a.obj").write_text(text)
        return show(tmp_path / "a.obj", **more)

    return write


@pytest.mark.parametrize(
    ("mtl", "expected"),
    [
        ("Kd 0.2 0.4 0.8\n", [[0.2, 0.4, 0.8]] * 4),
        ("Kd 0.5\n", [[0.5] * 3] * 4),
        ("map_Kd print.png\n", COLOURS),
        ("Kd 0.5 0.25 1\nmap_Kd print.png\n", COLOURS * [0.5, 0.25, 1]),
        ("map_Kd .\\print.png\n", COLOURS),
        ("MAP_KD print.png # the print\n", COLOURS),
        ("kd 1 0 0\nKd 0 1 0\n", [[0, 1, 0]] * 4),
        ("Kd 0 0 0\nKe 0.5 2 0.25\n", [[0.5, 2, 0.25]] * 4),
    ],
)
def test_a_material_of_an_mtl_file_is_shown(obj, mtl, expected):
    picture, said = obj("newmtl other\nKd 1 1 1\nnewmtl card\n" + mtl)
    assert quarters(picture) == pytest.approx(np.array(expected), rel=1e-2, abs=4e-3)
    assert said == []


@pytest.mark.parametrize(
    ("mtl", "clear"),
    [
        ("d 0.25\n", [0.75] * 4),
        ("Tr 0.25\n", [0.25] * 4),
        ("d 0.5\nTr 0.9\n", [0.5] * 4),
        ("d 1\n", [0] * 4),
        ("map_Kd print.png\n", [0] * 4),
    ],
)
def test_the_opacity_of_an_mtl_file_shows_the_background(obj, mtl, clear):
    masks = blocks(*((0, 0, 0, a) for a in (255, 200, 100, 0)))
    picture, _ = obj(f"newmtl card\nKd 0 0 0\n{mtl}", picture=masks, samples=1024)
    assert quarters(picture)[:, 0] == pytest.approx(np.array(clear), abs=0.03)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("png", "a b.png"),
        ("tiff", "print.tif"),
        ("bmp", "print.bmp"),
        ("tga", "print.tga"),
        ("webp", "print.webp"),
        ("jpeg", "print.jpg"),
        ("png", "textures/print.png"),
        ("gif", "print.gif"),
    ],
)
def test_pictures_of_any_usual_kind_are_read(obj, kind, name):
    picture, _ = obj(f"newmtl card\nmap_Kd {name}\n", name=name, kind=kind)
    assert quarters(picture) == pytest.approx(COLOURS, abs=0.02 if kind == "jpeg" else 4e-3)


@pytest.mark.parametrize("mode", ["L", "P", "LA", "1"])
def test_pictures_of_any_usual_mode_are_read(obj, tmp_path, mode):
    grey = blocks((0,), (255,), (255,), (0,))[..., 0]
    (tmp_path / "grey.tif").touch()
    Image.fromarray(grey).convert(mode).save(tmp_path / "grey.tif")
    shown, _ = obj("newmtl card\nmap_Kd grey.tif\n")
    assert quarters(shown)[:, 1] == pytest.approx([0, 1, 1, 0], abs=0.01)


def test_pictures_are_named_from_the_folder_of_the_mtl_file(obj, tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps/b.mtl").write_text("newmtl card\nmap_Kd ../maps/print.png\n")
    (tmp_path / "maps/print.png").write_bytes(encode(FOUR, "png"))
    picture, _ = obj("", "mtllib maps\\b.mtl\n" + CARD, picture=FOUR * 0)
    assert quarters(picture) == pytest.approx(COLOURS, abs=4e-3)


def test_names_may_hold_signs_and_the_file_a_byte_order_mark(obj):
    left = "v -1 -1 0\nv 0 -1 0\nv 0 1 0\nv -1 1 0\nv 1 -1 0\nv 1 1 0\n"
    mtl = "\ufeffnewmtl a#1\nKd 1 0 0\nnewmtl a#2 # the other\nKd 0 1 0\n"
    picture, said = obj(mtl, f"\ufeffmtllib a.mtl\n{left}usemtl a#1\nf 1 2 3 4\nusemtl a#2\nf 2 5 6 3\n")
    assert quarters(picture) == pytest.approx(np.array([[1, 0, 0], [0, 1, 0]] * 2), abs=1e-3)
    assert said == []


def test_each_material_of_a_file_has_its_own_shape(obj, tmp_path):
    left = "v -1 -1 0\nv 0 -1 0\nv 0 1 0\nv -1 1 0\nv 1 -1 0\nv 1 1 0\n"
    faces = "usemtl red\nf 1 2 3 4\nusemtl green paint\nf 2 5 6 3\n"
    mtl = "newmtl red\nKd 1 0 0\nnewmtl green paint\nKd 0 1 0\nnewmtl unused\nmap_Kd missing.png\n"
    picture, said = obj(mtl, "mtllib a.mtl\n" + left + faces)
    assert quarters(picture) == pytest.approx(np.array([[1, 0, 0], [0, 1, 0]] * 2), abs=1e-3)
    assert "target: [mesh_red, mesh_green_paint]" in (tmp_path / "shown/scene.yaml").read_text()
    assert said == []


def test_colours_of_obj_vertices_are_coded(obj):
    rows = "".join(
        "v {} {} {} {} {} {}\n".format(*point, *colour) for point, colour in zip(POINTS, CODED / 255, strict=True)
    )
    picture, _ = obj("", rows + "f 1 2 3 4\n", samples=512)
    assert quarters(picture) == pytest.approx(np.tile(linear(CODED[0]), (4, 1)), abs=4e-3)


CODED = np.tile(np.array([[200.0, 120, 50]]), (4, 1))


@pytest.mark.parametrize(
    "faces",
    [
        "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n",
        "f -4/-4 -3/-3 -2/-2 -1/-1\n",
        "f 1/1/1 2/2/1 3/3/1 4/4/1\nvn 0 0 1\n",
        "f 1/1 2/2 \\\n  3/3 4/4\n",
        "o a\ng b c\ns off\nf 1/1 2/2 3/3 4/4 # a face\n",
        "f 4/4 3/3 2/2 1/1\n",
        "f 1/1 2/2 3/3\nvn 0 0 1\nf 1/1/1 3/3/1 4/4/1\n",
    ],
)
def test_faces_of_an_obj_file_may_be_written_in_many_ways(obj, faces):
    picture, said = obj("newmtl card\nmap_Kd print.png\n", f"mtllib a.mtl\n{VERTICES}usemtl card\n{faces}")
    assert quarters(picture) == pytest.approx(COLOURS, abs=4e-3)
    assert said == []


def test_convex_faces_of_any_number_of_corners_keep_their_area(tmp_path):
    turns = np.arange(7) * 2 * np.pi / 7
    rows = "".join(f"v {np.cos(t)} 5 {np.sin(t)}\n" for t in turns)
    (tmp_path / "a.obj").write_text(rows + "f 7 6 5 4 3 2 1\nf 1 2 3 4 5 6\nf 1 2 3\n")
    (shape,) = read_mesh(tmp_path / "a.obj", LeftOut())
    a, b, c = (shape.points[shape.triangles[:, k]] for k in range(3))
    areas = np.cross(b - a, c - a)[:, 1] / 2
    corner = np.sin(turns[1]) / 2  # of a triangle to the centre
    ear = np.sin(turns[1]) - np.sin(turns[2]) / 2
    assert np.abs(areas).sum() == pytest.approx(7 * corner + (7 * corner - ear) + ear)


def write_ply(path, *, order, faces, colours=None, extra=()):
    """Write a PLY file by hand, as Blender or MeshLab lay it out."""
    columns = [("x", "float"), ("y", "float"), ("z", "float")]
    columns += [] if colours is None else [(n, "uchar") for n in ("red", "green", "blue", "alpha")]
    header = ["ply", f"format {order} 1.0", "comment end_header of another", *extra, f"element vertex {len(POINTS)}"]
    header += [f"property {kind} {name}" for name, kind in columns]
    header += [f"element face {len(faces)}", "property list uchar uint vertex_indices", "end_header"]
    text = ("\n".join(header) + "\n").encode()
    sign = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}[order]
    for k, point in enumerate(POINTS):
        row = [*point, *(() if colours is None else colours[k])]
        if order == "ascii":
            text += (" ".join(f"{v:g}" for v in row) + "\n").encode()
        else:
            text += np.array(point, f"{sign}f4").tobytes() + bytes([] if colours is None else list(colours[k]))
    for face in faces:
        if order == "ascii":
            text += (" ".join(map(str, [len(face), *face])) + "\n").encode()
        else:
            text += bytes([len(face)]) + np.array(face, f"{sign}u4").tobytes()
    path.write_bytes(text)
    return path


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_triangles_and_coded_colours_of_a_ply_file_are_kept(tmp_path, order):
    faces = FACES.tolist()
    colours = [(255, 0, 0, 255), (255, 128, 0, 255), (255, 128, 188, 255), (255, 0, 188, 255)]
    picture, said = show(write_ply(tmp_path / "a.ply", order=order, faces=faces, colours=colours), samples=256)
    middle = linear(np.array(colours))[:, :3].mean(axis=0)
    assert picture.mean(axis=(0, 1)) == pytest.approx(middle, abs=5e-3)
    assert said == []


@pytest.mark.parametrize("of_faces", [False, True])
def test_the_texture_of_a_ply_file_of_meshlab_is_kept(tmp_path, of_faces):
    (tmp_path / "print.png").write_bytes(encode(FOUR, "png"))
    up = np.column_stack([UV[:, 0], 1 - UV[:, 1]])
    names, rows = ("xyz", POINTS) if of_faces else ("xyzst", np.column_stack([POINTS, up]))
    head = ["ply", "format ascii 1.0", "comment TextureFile print.png", "element vertex 4"]
    head += [*(f"property float {name}" for name in names), "element face 2", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord"] if of_faces else []
    body = [" ".join(map(str, row)) for row in rows]
    for face in FACES.tolist():
        body.append(" ".join(map(str, [3, *face, *([6, *up[face].ravel()] if of_faces else [])])))
    (tmp_path / "a.ply").write_text("\n".join([*head, "end_header", *body, ""]))
    picture, said = show(tmp_path / "a.ply")
    assert quarters(picture) == pytest.approx(COLOURS, abs=4e-3)
    assert said == []


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_an_stl_file_is_grey_and_has_plane_facets(tmp_path, kind):
    box = trimesh.creation.box((2, 2, 2))
    data = box.export(file_type=kind)
    (tmp_path / "a.stl").write_bytes(data if isinstance(data, bytes) else data.encode())
    picture, said = show(tmp_path / "a.stl")
    assert picture == pytest.approx(np.full((8, 8, 3), 0.6), abs=4e-3)
    assert said == []


@pytest.mark.parametrize("kind", ["obj", "glb"])
@pytest.mark.parametrize("factor", [255, 128])
def test_a_textured_mesh_that_trimesh_writes_is_shown(tmp_path, kind, factor):
    picture = Image.fromarray(FOUR)
    tint = [factor, 255, 255, 255]
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=picture, baseColorFactor=tint, metallicFactor=0, roughnessFactor=1
    )
    visual = trimesh.visual.TextureVisuals(np.column_stack([UV[:, 0], 1 - UV[:, 1]]), material=material)
    trimesh.Trimesh(POINTS, FACES, process=False, visual=visual).export(tmp_path / f"a.{kind}")
    shown, said = show(tmp_path / f"a.{kind}")
    assert quarters(shown) == pytest.approx(COLOURS * [factor / 255, 1, 1], abs=5e-3)
    assert said == (["ks ignored: material_0"] if kind == "obj" else [])


def plain_meshes():
    """Meshes that Mitsuba itself can read, by name."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    tall = ball.copy().apply_scale([1, 2, 1]).apply_translation([3, -40, 7])
    yield "a.ply", ball.export(file_type="ply")
    yield "b.ply", trimesh.creation.box((1, 2, 3)).export(file_type="ply", encoding="ascii")
    yield "c.obj", tall.export(file_type="obj", include_normals=True).encode()
    yield "d.obj", tall.export(file_type="obj", include_normals=False).encode()
    yield "e.obj", CARD.replace("usemtl card\n", "").encode()


@pytest.mark.parametrize(("name", "data"), list(plain_meshes()), ids=lambda x: x if isinstance(x, str) else "")
def test_a_plain_mesh_looks_as_mitsuba_reads_it(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    shown, _ = show(path, size=32, samples=16, path=True, lamp=True)
    backend.activate_backend("scalar")
    own = mi.load_dict({"type": name[-3:], "filename": str(path)}).bbox()
    scale = 0.1 / max(own.max - own.min)
    to_world = mi.ScalarTransform4f().scale(scale).translate(-(own.min + own.max) / 2)
    grey = {"type": "twosided", "in": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.6}}}
    mesh = {"type": name[-3:], "filename": str(path), "to_world": to_world, "bsdf": grey}
    expected = render({"mesh": mesh}, size=32, samples=16, path=True, lamp=True)
    assert shown @ LUMINANCE == pytest.approx(expected @ LUMINANCE, abs=1e-4)
