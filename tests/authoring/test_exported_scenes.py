"""Exported scenes of others: what is read, rewritten, guessed, said and refused."""

import shutil
import struct

import numpy as np
import pytest
from PIL import Image
from refusals import refusal

from saf_gen.authoring.checks import check_scene
from saf_gen.authoring.template import scene_from_export
from saf_gen.camera import get_sensor
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import find_scene

PRINT = (
    '<shape type="rectangle" id="print"><transform name="to_world"><scale value="{size}"/></transform>'
    '<bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>'
)
SKY = '<emitter type="constant" id="sky"/>'
MATT = '<bsdf type="twosided"><bsdf type="diffuse">{}</bsdf></bsdf>'


def write_export(folder, content, *, k=1.0, kind="perspective", camera="", more=""):
    """Write a scene.xml whose camera is 0.55 units times ``k`` before the origin, and return its path."""
    path = folder / "export/scene.xml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(
        f'<scene version="3.0.0">\n<sensor type="{kind}" id="Camera"><float name="fov" value="18"/>{camera}'
        f'<transform name="to_world"><lookat origin="0, 0, {0.55 * k}" target="0, 0, 0" up="0, 1, 0"/></transform>'
        f"</sensor>\n{content}\n{more}\n{SKY}</scene>"
    )
    return path


@pytest.fixture
def taken(own_folder):
    """Import an export, and return the scene and the lines that were said."""

    def take(path, **how):
        said = []
        scene_from_export(path, "taken", root=own_folder / "scenes", notify=said.append, **how)
        return find_scene("taken"), said

    return take


def depth_and_target(scene):
    return SceneRenderer(
        scene, get_sensor("vidar_400x250", rows=10, columns=16), backend_name="scalar"
    ).trace_geometry()


@pytest.mark.parametrize(
    ("k", "unit_m"),
    [(1.0, 1), (0.2, 1), (10.0, 0.1), (100.0, 0.01), (300.0, 1e-3), (1e3, 1e-3), (3e3, 1e-4), (1e6, 1e-6)],
)
def test_a_scene_in_focus_everywhere_is_made_smaller_by_a_power_of_ten(own_folder, taken, k, unit_m):
    scene, said = taken(write_export(own_folder, PRINT.format(size=0.1 * k), k=k))
    assert scene.card.unit_m == unit_m
    distance = 0.55 * k * unit_m
    assert scene.card.camera.origin_m == pytest.approx((0, 0, distance))
    drive = scene.build_drive()
    assert max(float(drive.blur_diameter(p, distance)) for p in (0.0, 1.0)) >= 4 * 20e-6
    scales = [line for line in said if line.startswith("scale: ")]
    assert len(scales) == (unit_m != 1)
    assert f"unit_m: {unit_m:g}, and it is {distance:.3g} m away" in "".join(scales) or unit_m == 1


@pytest.mark.parametrize(("radius", "fov"), [(0.001, 18), (0, 110)])
def test_a_scene_in_focus_everywhere_at_any_scale_is_refused(own_folder, taken, radius, fov):
    path = write_export(
        own_folder, PRINT.format(size=9), k=3, kind="thinlens", camera=number("aperture_radius", radius)
    )
    path.write_text(path.read_text().replace('"fov" value="18"', f'"fov" value="{fov}"'))
    assert "and no smaller scale helps" in refusal(taken, path).problem


@pytest.mark.slow
@pytest.mark.parametrize("unit_m", [1.0, 0.001])
def test_the_checks_say_first_that_a_smaller_unit_would_do(own_folder, taken, unit_m):
    scene, _ = taken(write_export(own_folder, PRINT.format(size=100), k=1000.0))
    if unit_m == 1:
        card = scene.folder / "scene.yaml"
        text = card.read_text().replace("unit_m: 0.001", "unit_m: 1").replace("0.55]", "550]")
        card.write_text(text.replace("[0.825, 0.4125]", "[825, 412.5]"))
        scene = find_scene("taken")
    found = list(check_scene(scene, get_sensor("vidar_400x250", rows=10, columns=16), backend="scalar"))
    errors = [f.text for f in found if f.level == "error" and f.check != "licence"]
    if unit_m == 1:
        assert len(errors) == 1
        assert "no position of the lens blurs it: write unit_m: 0.001 on the card" in errors[0]
    else:
        assert not [text for text in errors if "unit_m" in text]


def number(name, value):
    return f'<float name="{name}" value="{value}"/>'


FILM = '<film type="hdrfilm"><integer name="width" value="{}"/><integer name="height" value="{}"/>{}</film>'
CAMERAS = {
    "a pinhole": ("perspective", "", "", "aperture: the camera is a pinhole, so the card says f/2"),
    "a lens": ("thinlens", number("aperture_radius", 0.006) + number("focus_distance", 0.55), "", None),
    "too wide": (
        "thinlens",
        number("aperture_radius", 0.1) + number("focus_distance", 0.55),
        "",
        "so the card says f/1",
    ),
    "focus": (
        "thinlens",
        number("aperture_radius", 0.006) + number("focus_distance", 3),
        "",
        "focus_distance ignored: 3",
    ),
    "shift": (
        "perspective",
        number("principal_point_offset_x", 0.1),
        "",
        "lens shift ignored: principal_point_offset_x",
    ),
    "rise": (
        "perspective",
        number("principal_point_offset_y", -0.2),
        "",
        "lens shift ignored: principal_point_offset_y",
    ),
    "clip": (
        "perspective",
        number("near_clip", 1) + number("far_clip", 9),
        "",
        "near_clip and far_clip ignored: 1 to 9",
    ),
    "shutter": ("perspective", number("shutter_open", 0) + number("shutter_close", 1), "", "shutter ignored"),
    "crop": ("perspective", FILM.format(640, 400, '<integer name="crop_width" value="9"/>'), "", "crop of the film"),
    "film": ("perspective", FILM.format(1920, 1080, ""), "", "film size ignored: 1920 × 1080"),
    "our film": ("perspective", FILM.format(640, 400, ""), "", "aperture"),
    "depth": ("perspective", "", '<integrator type="depth"/>', "integrator ignored: depth"),
    "path": (
        "perspective",
        "",
        '<integrator type="path"><integer name="max_depth" value="9"/></integrator>',
        "aperture",
    ),
    "hidden": (
        *("perspective", "", '<integrator type="path"><boolean name="hide_emitters" value="true"/></integrator>'),
        "hide_emitters ignored",
    ),
    "fog": (
        *("perspective", ""),
        '<shape type="sphere"><float name="radius" value="0.2"/><bsdf type="null"/><medium name="interior" id="haze"'
        ' type="homogeneous"/></shape>',
        "medium ignored: haze",
    ),
    "two": ("perspective", "", '<sensor type="orthographic" id="Top"/>', "cameras ignored: orthographic 'Top'"),
}


@pytest.mark.parametrize(("kind", "camera", "more", "line"), CAMERAS.values(), ids=CAMERAS.keys())
def test_what_a_camera_says_is_taken_or_named_in_one_line(own_folder, taken, kind, camera, more, line):
    scene, said = taken(write_export(own_folder, PRINT.format(size=0.1), kind=kind, camera=camera, more=more))
    assert scene.card.target == ("print",)
    others = [text for text in said if not text.startswith("aperture")]
    if line is None:
        assert said == []
    elif line.startswith("aperture") or "f/1" in line:
        assert [text for text in said if line in text]
        assert others == []
    else:
        assert len(others) == 1
        assert others[0].startswith(line)
    source = (scene.folder / "SOURCE.md").read_text()
    assert [text for text in source.splitlines() if text.startswith("- ")] == [f"- {text}" for text in said]
    assert ("Not everything in the file is used" in source) == bool(said)
    assert not [text for text in said if "\n" in text]


def with_two_cameras(folder, *, ids=("Camera", "Side")):
    """Write an export whose second camera looks away."""
    away = '<lookat origin="0, 0, 0.55" target="0, 9, 0.55" up="0, 0, 1"/>'
    more = f'<sensor type="thinlens" id="Side"><transform name="to_world">{away}</transform></sensor>'
    path = write_export(folder, PRINT.format(size=0.1), more=more)
    text = path.read_text()
    for old, new in zip(("Camera", "Side"), ids, strict=True):
        text = text.replace(f' id="{old}"', f' id="{new}"' if new else "")
    path.write_text(text)
    return path


def test_one_of_several_cameras_is_chosen_by_its_id(own_folder, taken):
    path = with_two_cameras(own_folder)
    assert "the image of the camera 'Side'; aim" in str(refusal(taken, path, camera="Side"))
    assert "allowed: Camera, Side; did you mean 'Side'?" in str(refusal(taken, path, camera="Slide"))
    _, said = taken(path, camera="Camera")
    assert "cameras ignored: thinlens 'Side' (the camera 'Camera' is taken; --camera takes another)" in said


def test_cameras_without_an_id_cannot_be_chosen(own_folder, taken):
    path = with_two_cameras(own_folder, ids=("", ""))
    error = refusal(taken, path, camera="Side")
    assert "perspective camera 'Side'; a camera without an id cannot be chosen: give it one" in str(error)
    scene, said = taken(path)
    assert "cameras ignored: thinlens (the first perspective camera is taken)" in said
    assert "# from the file: perspective\n" in (scene.folder / "scene.yaml").read_text()


@pytest.mark.parametrize("kind", ["orthographic", "distant", "radiancemeter", "irradiancemeter"])
def test_a_camera_without_perspective_is_refused(own_folder, taken, kind):
    path = write_export(own_folder, PRINT.format(size=0.1), kind=kind)
    error = refusal(taken, path)
    assert f"no perspective camera, but {kind} 'Camera'" in error.problem
    assert error.allowed == "perspective, thinlens"


BEFORE = {
    "nothing": ("", "print"),
    "thin glass": ('<bsdf type="thindielectric"/>', "print"),
    "null": ('<bsdf type="null"/>', "print"),
    "opacity 0": ('<bsdf type="mask"><float name="opacity" value="0"/><bsdf type="diffuse"/></bsdf>', "print"),
    "opacity 1": ('<bsdf type="mask"><float name="opacity" value="1"/><bsdf type="diffuse"/></bsdf>', "screen"),
    "paper": ('<bsdf type="diffuse"/>', "screen"),
}


@pytest.mark.parametrize(("bsdf", "target"), BEFORE.values(), ids=BEFORE.keys())
def test_the_target_is_what_the_middle_of_the_picture_shows(own_folder, taken, bsdf, target):
    place = '<transform name="to_world"><scale value="0.1"/><translate z="0.1"/></transform>'
    screen = f'<shape type="rectangle" id="screen">{place}{bsdf}</shape>' if bsdf else ""
    scene, _ = taken(write_export(own_folder, PRINT.format(size=0.1), more=screen))
    assert scene.card.target == (target,)
    seen = depth_and_target(scene)
    assert seen.target.all()
    assert seen.depth == pytest.approx(0.55 if target == "print" else 0.45, rel=1e-5)


@pytest.mark.slow
def test_an_instance_is_a_target_that_the_checks_find(own_folder, taken):
    group = f'<shape type="shapegroup" id="group"><shape type="rectangle" id="leaf">{MATT.format("")}</shape></shape>'
    place = '<transform name="to_world"><scale value="0.1"/></transform>'
    scene, _ = taken(
        write_export(own_folder, f'{group}<shape type="instance" id="tree"><ref id="group"/>{place}</shape>')
    )
    assert scene.card.target == ("tree",)
    assert depth_and_target(scene).target.all()
    found = list(check_scene(scene, get_sensor("vidar_400x250", rows=10, columns=16), backend="scalar"))
    assert [f for f in found if f.check in ("geometry", "units", "reach") and f.level == "error"] == []
    card, text = scene.folder / "scene.yaml", (scene.folder / "scene.yaml").read_text()
    card.write_text(text.replace("target: [tree]", "target: [leaf]"))
    assert depth_and_target(find_scene("taken")).target.all()
    card.write_text(text.replace("target: [tree]", "target: [leav]"))
    assert refusal(depth_and_target, find_scene("taken")).nearest == "leaf"


CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32) * 0.1


def write_quad_ply(path, form):
    """A square as one face of four corners, as Blender writes it, with a colour at each corner."""
    lines = ["ply", f"format {form} 1.0", "element vertex 4", *(f"property float {axis}" for axis in "xyz")]
    lines += ["property uchar red", "element face 1", "property list uchar uint vertex_indices", "end_header", ""]
    head = "\n".join(lines).encode()
    if form == "ascii":
        body = "".join(f"{x} {y} {z} 7\n" for x, y, z in CORNERS).encode() + b"4 0 1 2 3\n"
    else:
        order = "<" if "little" in form else ">"
        body = b"".join(struct.pack(f"{order}3fB", *xyz, 7) for xyz in CORNERS)
        body += struct.pack(f"{order}B4I", 4, 0, 1, 2, 3)
    path.write_bytes(head + body)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_quads_in_a_ply_mesh_are_split_on_import_and_refused_in_one_line_elsewhere(own_folder, taken, form):
    mesh = f'<shape type="ply" id="print"><string name="filename" value="square.ply"/>{MATT.format("")}</shape>'
    path = write_export(own_folder, mesh)
    write_quad_ply(path.parent / "square.ply", form)
    scene, said = taken(path)
    assert "mesh rewritten: square.ply (faces of more than three corners are split into triangles)" in said
    seen = depth_and_target(scene)
    assert seen.target.all()
    assert seen.depth == pytest.approx(0.55, rel=1e-5)
    (scene.folder / "square.ply").write_bytes((path.parent / "square.ply").read_bytes())
    error = refusal(depth_and_target, find_scene("taken"))
    assert "a face of 4 corners" in error.problem
    assert error.allowed == "triangles"


def test_negative_indices_of_an_obj_mesh_are_counted_from_the_beginning_on_import(own_folder, taken):
    mesh = f'<shape type="obj" id="print"><string name="filename" value="square.obj"/>{MATT.format("")}</shape>'
    path = write_export(own_folder, mesh)
    rows = [f"v {x} {y} {z}" for x, y, z in CORNERS]
    (path.parent / "square.obj").write_text("\n".join([*rows, "vt 0 0", "f -4/-1 -3/-1 -2/-1 -1/-1", "v 9 9 9", ""]))
    scene, said = taken(path)
    assert "mesh rewritten: square.obj (negative indices are counted from the beginning)" in said
    assert "f 1/1 2/1 3/1 4/1" in (scene.folder / "square.obj").read_text()
    assert depth_and_target(scene).target.all()
    shutil.rmtree(scene.folder)
    (path.parent / "square.obj").write_text("\n".join([*rows, "f -5 -3 -2"]))
    assert "has the index -5, but there are 4 before it" in refusal(taken, path).problem


def picture(extension, **options):
    def write(folder):
        Image.new("RGB", (8, 8), (200, 100, 50)).save(folder / f"map.{extension}", **options)
        return f"map.{extension}"

    return write


def content(name, data):
    def write(folder):
        (folder / name).write_bytes(data)
        return name

    return write


PICTURES = {
    "png": (picture("png"), None),
    "jpeg": (picture("jpg"), None),
    "bmp": (picture("bmp"), None),
    "tga": (picture("tga"), None),
    "ppm": (picture("ppm"), None),
    "tiff": (picture("tif"), "is a TIFF file"),
    "webp": (picture("webp"), "is a WebP file"),
    "gif": (picture("gif"), "is a GIF file"),
    "dds": (picture("dds"), "is a DDS file"),
    "jpeg 2000": (picture("jp2"), "is a JPEG 2000 file"),
    "ktx2": (content("map.ktx2", b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(80)), "is a KTX file"),
    "tiff called png": (content("map.png", b"II*\0" + bytes(80)), "is a TIFF file"),
    "nonsense": (content("map.png", b"nonsense"), "is of an unknown format"),
    "empty": (content("map.png", b""), "is empty"),
    "lfs": (content("map.png", b"version https://git-lfs.github.com/spec/v1\n"), "is a pointer of Git LFS"),
    "missing": (lambda folder: "map.png", "the file 'map.png' does not exist"),
}


@pytest.mark.parametrize(("write", "problem"), PICTURES.values(), ids=PICTURES.keys())
def test_a_picture_is_read_or_refused_in_one_line(own_folder, taken, write, problem):
    export = own_folder / "export"
    export.mkdir()
    name = write(export)
    texture = f'<texture type="bitmap" name="reflectance"><string name="filename" value="{name}"/></texture>'
    shape = PRINT.format(size=0.1).replace('<bsdf type="diffuse"/>', f'<bsdf type="diffuse">{texture}</bsdf>')
    path = write_export(own_folder, shape)
    if problem is None:
        assert taken(path)[0].card.target == ("print",)
    else:
        error = refusal(taken, path)
        assert problem in error.problem
        assert "scene.xml:3" in str(error)


def rgb(value):
    return MATT.format(f'<rgb name="reflectance" value="{value}"/>')


WORDS = {
    "two numbers": (rgb("1, 0"), "the colour is '1, 0'", "three numbers"),
    "words for a colour": (rgb("a, b, c"), "the colour is 'a, b, c'", "three numbers"),
    "too bright": (rgb("2, 2, 2"), "reflectance of 'ball' is 2", "0 to 1"),
    "text for a colour": (MATT.format('<string name="reflectance" value="red"/>'), "reflectance is a string", "float"),
    "unknown property": (MATT.format('<float name="albedo" value="1"/>'), "diffuse has no albedo", ""),
    "a comma": ('<float name="radius" value="1,5"/>', "the number is '1,5'", "decimal point"),
    "yes": ('<boolean name="flip_normals" value="yes"/>', "the value is 'yes'", "true, false"),
    "no such material": ('<ref id="nope"/>', "nothing has the id 'nope'", "the id of a material"),
    "a metal": ('<bsdf type="conductor"><string name="material" value="unobtainium"/></bsdf>', "'unobtainium'", ""),
    "a matrix": ('<transform name="to_world"><matrix value="1 0"/></transform>', "matrix must have 9 or 16", ""),
    "a plug-in": ('<bsdf type="diffus"/>', "'diffus'", "diffuse"),
    "text for a number": ('<string name="radius" value="1"/>', "radius is a string", "float"),
    "a group inside": ('<shape type="shapegroup"><shape type="sphere"/></shape>', "an instance holds its", "<ref"),
}


@pytest.mark.parametrize(("inside", "problem", "allowed"), WORDS.values(), ids=WORDS.keys())
def test_mitsubas_errors_are_one_line_in_our_words(own_folder, taken, inside, problem, allowed):
    kind = "instance" if "shapegroup" in inside else "sphere"
    error = refusal(taken, write_export(own_folder, f'<shape type="{kind}" id="ball">{inside}</shape>'))
    assert problem in error.problem
    assert allowed in error.allowed
    assert "scene.xml" in str(error)
    for inner in ("parser.cpp", "properties.cpp", "plugin of", "dictionary", "part_", "\n", "Mitsuba does not"):
        assert inner not in str(error)


def lamp_of(inside, kind="constant"):
    return f'<emitter type="{kind}" id="bulb">{inside}</emitter>'


def spectrum(kind, inside=""):
    return lamp_of(f'<spectrum name="radiance" type="{kind}">{inside}</spectrum>')


SAMPLES = '<string name="wavelengths" value="400, 700"/><string name="values" value="1, 2"/>'
TURNED = '<transform name="to_world"><rotate y="1" angle="180"/><scale value="0.1"/></transform>'
MIRRORED = '<transform name="to_world"><scale x="0.1" y="0.1" z="-0.1"/></transform>'
SQUARE = '<shape type="ply" id="print"><string name="filename" value="square.ply"/>{}{}</shape>'
BUMPS = (
    '<bsdf type="normalmap"><texture type="bitmap" name="normalmap"><string name="filename" value="map.png"/></texture>'
    '<bsdf type="diffuse"/></bsdf>'
)
PICTURE = (
    '<shape type="rectangle" id="print"><transform name="to_world"><scale value="0.1"/></transform>'
    '<bsdf type="diffuse"><texture type="bitmap" name="reflectance"><string name="filename" value="map.pfm"/>'
    "</texture></bsdf></shape>"
)
COLOURED = SQUARE.format(
    '<bsdf type="diffuse"><texture type="mesh_attribute" name="reflectance"><string name="name" value="vertex_color"/>'
    "</texture></bsdf>",
    "",
)
WRONG = {
    "blackbody": (spectrum("blackbody"), "blackbody is not rendered", "spectrum: {blackbody: 3000}"),
    "irregular": (spectrum("irregular", SAMPLES), "irregular is not rendered", "<rgb>"),
    "regular": (spectrum("regular"), "regular is not rendered", "<rgb>"),
    "sunsky": (lamp_of("", "sunsky"), "sunsky is not rendered", "envmap"),
    "projector": (lamp_of("", "projector"), "projector is not rendered", "spot"),
    "laser": (
        '<shape type="rectangle"><emitter type="directionalarea"/></shape>',
        "directionalarea is not rendered",
        "area, directional",
    ),
    "nan": (lamp_of('<rgb name="radiance" value="nan, 1, 1"/>'), "radiance of 'bulb' is nan", "0 or more"),
    "inf": (lamp_of('<rgb name="intensity" value="inf, 1, 1"/>', "point"), "intensity of 'bulb' is inf", "0 or more"),
    "negative": (lamp_of('<rgb name="radiance" value="-5, 9, 9"/>'), "radiance of 'bulb' is -5", "0 or more"),
    "negative spectrum": (lamp_of('<spectrum name="radiance" value="400:1, 700:-2"/>'), "'bulb' is -2", "0 or more"),
    "texels of nan": (PICTURE, "reflectance of 'print', the picture 'map.pfm', is nan in 3 of 96", "0 to 1"),
    "sky of inf": (lamp_of('<string name="filename" value="sky.pfm"/>', "envmap"), "'sky.pfm', is inf in 3 of", ""),
    "dark sky": (
        lamp_of('<float name="scale" value="-1"/><string name="filename" value="map.png"/>', "envmap"),
        "scale of 'bulb' is -1",
        "",
    ),
    "bright paint": (COLOURED, "vertex_color of mesh 'print' is 200", "0 to 1"),
    "no normals": (SQUARE.format(MATT.format(""), ""), "normals of 2 triangles have no length", ""),
    "coded normals": (SQUARE.format(BUMPS, ""), "the normal map is decoded as sRGB", ""),
}


@pytest.fixture
def export(own_folder):
    """The folder of an export with a mesh of zero normals and colours of 200, and with pictures of nan and inf."""
    folder = own_folder / "export"
    folder.mkdir()
    names = ["x", "y", "z", "nx", "ny", "nz", "r", "g", "b"]
    lines = ["ply", "format ascii 1.0", "element vertex 4", *(f"property float {name}" for name in names)]
    lines += ["element face 2", "property list uchar int vertex_indices", "end_header"]
    rows = [f"{x} {y} {z} 0 0 {{}} 200 0.5 0.5" for x, y, z in CORNERS]
    text = "\n".join([*lines, *rows, "3 0 1 2", "3 0 2 3", ""])
    (folder / "square.ply").write_text(text.format(0, 0, 0, 0))
    Image.new("RGB", (8, 4), (128, 128, 255)).save(folder / "map.png")
    for name, value in (("map", np.nan), ("sky", np.inf)):
        texels = np.full((4, 8, 3), 0.5, "<f4")
        texels[1, 2] = value
        (folder / f"{name}.pfm").write_bytes(b"PF\n8 4\n-1.0\n" + texels.tobytes())
    return folder


@pytest.mark.parametrize(("content", "problem", "allowed"), WRONG.values(), ids=WRONG.keys())
def test_what_no_scene_can_have_is_refused_in_one_line(own_folder, export, taken, content, problem, allowed):
    shape = "" if 'id="print"' in content else PRINT.format(size=0.1)
    if "square.ply" in content and "vertex_color" in content:
        mesh = export / "square.ply"
        mesh.write_text(mesh.read_text().replace(" 0 0 0 200", " 0 0 1 200"))
    error = refusal(taken, write_export(own_folder, shape, more=content))
    assert problem in error.problem
    assert allowed in error.allowed
    assert "scene.xml" in error.where
    assert not (own_folder / "scenes").exists()


@pytest.mark.parametrize(
    ("shape", "black"),
    [
        (f'<shape type="rectangle" id="print">{TURNED}<bsdf type="diffuse"/></shape>', True),
        (f'<shape type="cube" id="print">{MIRRORED}<bsdf type="diffuse"/></shape>', False),
        (f'<shape type="rectangle" id="print">{TURNED}{MATT.format("")}</shape>', False),
        (PRINT.format(size=0.1), False),
    ],
)
def test_surfaces_that_turn_their_back_to_the_lens_are_named(own_folder, taken, shape, black):
    _, lines = taken(write_export(own_folder, shape))
    assert [
        line for line in lines if line.startswith("surfaces that turn their back to the lens are black: print")
    ] == ([lines[-1]] if black else [])


def test_the_field_of_an_upright_film_is_that_of_mitsuba(own_folder, taken):
    """50 mm on a film of 250 × 400 are 29.1 degrees across."""
    film = '<film type="hdrfilm"><integer name="width" value="250"/><integer name="height" value="400"/></film>'
    camera = '<string name="focal_length" value="50mm"/>' + film
    path = write_export(own_folder, PRINT.format(size=0.1), camera=camera, k=0.5)
    path.write_text(path.read_text().replace('<float name="fov" value="18"/>', ""))
    scene, lines = taken(path)
    card = scene.card
    distance = card.camera.origin_m[2] - card.camera.look_at_m[2]
    image = 1 / (1e3 / card.lens.focal_length_mm - 1 / distance)
    assert 2 * np.degrees(np.arctan(4e-3 / image)) == pytest.approx(25.9, abs=0.1)
    assert any(line.startswith("film size ignored: 250 × 400 (the width is kept; less is seen") for line in lines)
