"""XML scenes: exported files are read unchanged, and nothing in them reaches outside the folder or runs code."""

import shutil
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from exported_scene import write_exported_scene
from refusals import refusal
from small_dataset import SCENES

from saf_gen.render import backend, depth_and_target, mitsuba_scene
from saf_gen.render.render_setup import RenderSetup, SensorGrid
from saf_gen.scene.scene_folder import find_scene, load_scene, scene_names
from saf_gen.scene.trusted_folders import forget_folder, register_folder
from saf_gen.scene.xml import ALLOWED_PLUGINS, read_scene_xml

HEAD = '<scene version="3.0.0">'


@pytest.fixture
def exported(tmp_path):
    """Copy the exported test scene, and return a function that replaces text in its scene.xml."""
    shutil.copytree(SCENES / "workbench", tmp_path / "workbench")

    def edit(old="", new="", *, name="scene.xml"):
        path = tmp_path / "workbench" / name
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))
        return load_scene(path.parent)

    return edit


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a scene of elements and reads it with values for its parameters."""

    def read(elements, params=None, *, head=HEAD):
        path = tmp_path / "scene.xml"
        path.write_text(f"{head}\n{elements}\n</scene>" if head else elements)
        return read_scene_xml(path, params or {}).text

    return read


# --- what exporters write -----------------------------------------------------------------------------


def test_the_exported_meshes_are_what_their_script_makes(tmp_path):
    write_exported_scene(tmp_path)
    for path in (p for p in tmp_path.rglob("*") if p.is_file() and p.suffix != ".png"):
        assert (SCENES / "workbench" / path.relative_to(tmp_path)).read_bytes() == path.read_bytes(), path
    assert (SCENES / "workbench/textures/print.png").stat().st_size < 20_000


def seen_of(scene, group):
    backend.activate_backend("scalar")
    loaded, integrator = mitsuba_scene.load_lit_scene(
        mitsuba_scene.scene_dict(scene), scene.card.lights[group], max_depth=3
    )
    to_world, unit = mitsuba_scene.camera_to_world(scene), scene.card.unit_m
    setup = RenderSetup(loaded, integrator, to_world, scene.build_drive(), SensorGrid(40, 64, 1.25e-4), unit)
    return loaded, depth_and_target.trace_geometry(setup, scene.card.target)


def test_an_exported_scene_goes_in_as_it_is(test_scenes):
    """The crate's front is the plane z = 0, which the axis of the lens at (0, 0.2, 0.55) meets."""
    scene = find_scene("workbench")
    loaded, seen = seen_of(scene, "lamp")
    assert {s.id() for s in loaded.shapes()} == {"emit-Lamp", "mesh-Bench", "mesh-Crate.001", "mesh-Ball"}
    assert [s.id() for s in loaded.shapes() if s.is_emitter()] == ["emit-Lamp"]
    assert loaded.environment() is None
    axis = np.array([0, 0.157 - 0.2, 0.39 - 0.55])
    axis /= np.linalg.norm(axis)
    assert seen.target[20, 32]
    assert seen.depth[20, 32] == pytest.approx(0.55 / -axis[2], rel=2e-3)
    assert scene.build_drive().focusing_range_m[0] < seen.depth[20, 32] < scene.build_drive().focusing_range_m[1]


def test_one_light_group_burns_at_a_time(test_scenes):
    loaded, _ = seen_of(find_scene("workbench"), "world")
    assert loaded.environment().id() == "World"
    assert not any(s.is_emitter() for s in loaded.shapes())
    assert "emit-Lamp" in {s.id() for s in loaded.shapes()}


def test_the_card_says_how_large_a_unit_is(exported):
    """The same file in units of 2 mm instead of metres, seen by a lens that is nearer by this factor."""
    scene = exported("title:", "unit_m: 0.002\ntitle:", name="scene.yaml")
    card = scene.folder / "scene.yaml"
    text = card.read_text().replace("[0, 0.2, 0.55]", "[0, 0.0004, 0.0011]")
    text = text.replace("[0, 0.157, 0.39]", "[0, 0.000314, 0.00078]")
    card.write_text(text.replace("0.80, 0.42", "1.6, 0.04").replace("25", "0.5"))
    backend.activate_backend("scalar")
    scene = load_scene(scene.folder)
    loaded, _ = mitsuba_scene.load_lit_scene(mitsuba_scene.scene_dict(scene), scene.card.lights["lamp"], max_depth=3)
    camera = np.array(mitsuba_scene.camera_to_world(scene).matrix)
    assert camera[:3, 3] == pytest.approx([0, 0.2, 0.55])
    assert loaded.bbox().max[0] == pytest.approx(0.6)


def test_a_shape_of_a_file_moves_by_its_name(exported):
    scene = exported(
        "target:",
        "motion:\n  mesh-Crate.001:\n    keyframes: [{time_s: 0}, {time_s: 1, translate_m: [0, 0, -0.1]}]\ntarget:",
        name="scene.yaml",
    )
    backend.activate_backend("scalar")
    described = mitsuba_scene.scene_dict(scene)
    depths = []
    for time_s in (0.0, 0.5):
        moment = mitsuba_scene.pose_shapes(described, mitsuba_scene.shape_motions(scene, described), time_s=time_s)
        hit = mi.load_dict({"type": "scene", "it": moment["mesh-Crate.001"], "mat-Print": moment["mat-Print"]})
        depths.append(hit.ray_intersect(mi.Ray3f([0.01, 0.04, 0.5], [0, 0, -1])).t)
    assert depths == pytest.approx([0.5, 0.55], abs=1e-6)


def test_objects_get_a_name_and_keep_their_lines_but_for_sensors_and_integrators(written, tmp_path):
    text = written(
        '<shape type="cube"/>\n<integrator type="whatever"/><sensor type="none" id="a"><film type="x"/></sensor>\n'
        '<shape type="cube" name="elm__3"><sensor type="irradiancemeter"/></shape>\n<emitter type="constant"/>'
    )
    assert not any(gone in text for gone in ("whatever", "none", "irradiancemeter"))
    lines = text.splitlines()
    assert 'id="shape_1"' in lines[1]
    assert 'id="elm__3"' in lines[3]
    assert 'id="emitter_1"' in lines[4]
    assert 'id="a"' in read_scene_xml(tmp_path / "scene.xml", {}).cameras.splitlines()[2]


def test_a_lamp_that_is_shared_burns_in_each_shape_that_names_it(written, tmp_path):
    text = written(
        '<emitter type="area" id="glow"><rgb name="radiance" value="2"/></emitter>'
        '<bsdf type="diffuse" id="grey"/><alias id="grey" as="paint"/>'
        '<shape type="cube" id="a"><ref id="glow"/><ref id="paint"/></shape>'
        '<shape type="cube" id="b"><ref id="glow"/></shape>'
    )
    backend.activate_backend("scalar")
    entries = mitsuba_scene.parse_scene_dict(text, tmp_path / "scene.xml")
    assert set(entries) == {"grey", "a", "b"}
    loaded, _ = mitsuba_scene.load_lit_scene(entries, ("a",), max_depth=2)
    lit = {s.id(): (s.is_emitter(), s.bsdf().id()) for s in loaded.shapes()}
    assert lit["a"] == (True, "grey")
    assert lit["b"][0] is False


# --- parameters and includes --------------------------------------------------------------------------


def test_parameters_of_the_card_are_those_of_the_file(exported):
    scene = exported('<default name="spp"', '<default name="red" value="0.1"/><default name="spp"')
    exported('value="0.600000 0.100000 0.080000"', 'value="$red 0.1 0.1"')
    card = scene.folder / "scene.yaml"
    card.write_text(card.read_text() + "params: {red: {uniform: [0.3, 0.4]}}\n")
    scene = load_scene(scene.folder)
    text = read_scene_xml(scene.folder / "scene.xml", scene.params).text
    assert f'value="{scene.params["red"]} 0.1 0.1"' in text
    card.write_text(card.read_text().replace("red:", "rad:"))
    error = refusal(lambda: mitsuba_scene.scene_dict(load_scene(scene.folder)))
    assert error.where == str(card)
    assert (error.allowed, error.nearest) == ("red, resx, resy, spp", "red")


def test_the_first_default_wins_and_the_longest_name(written):
    text = written(
        '<default name="r" value="1"/><default name="r" value="2"/><default name="rx" value="$r.5"/>'
        '<shape type="sphere"><float name="radius" value="$rx$r"/></shape>'
    )
    assert 'value="1.51"' in text


@pytest.mark.parametrize(("value", "as_xml"), [(True, "true"), ([1, 2.5], "1, 2.5")])
def test_a_parameter_is_written_as_xml_has_it(written, value, as_xml):
    text = written('<default name="p" value="0"/><shape type="cube" id="$p"/>', {"p": value})
    assert f'id="{as_xml}"' in text


def test_an_include_within_the_folder_is_put_in_place(written, tmp_path):
    (tmp_path / "fragments").mkdir()
    (tmp_path / "fragments/materials.xml").write_text(
        '<scene version="3.0.0"><default name="g" value="0.5"/><bsdf type="diffuse" id="grey">'
        '<rgb name="reflectance" value="$g"/></bsdf></scene>'
    )
    text = written(
        '<include filename="fragments/materials.xml"/><shape type="cube"><ref id="grey"/></shape>', {"g": 0.25}
    )
    assert text.index('id="grey"') < text.index('id="shape_1"')
    assert 'value="0.25"' in text


def test_includes_that_multiply_are_refused(written, tmp_path, monkeypatch):
    monkeypatch.setattr("saf_gen.scene.xml.MAX_ELEMENTS", 100)
    for n in range(12):
        twice = f'<include filename="{n + 1}.xml"/>' * 2
        (tmp_path / f"{n}.xml").write_text(f"{HEAD}{twice}</scene>")
    (tmp_path / "12.xml").write_text(f"{HEAD}</scene>")
    assert refusal(written, '<include filename="0.xml"/>').allowed == "at most 100 elements"


# --- what is refused ----------------------------------------------------------------------------------


@pytest.fixture
def neighbours(tmp_path):
    """A mesh outside the scene's folder, one in it, and links out of it and in a circle."""
    folder = tmp_path / "scene"
    (folder / "meshes").mkdir(parents=True)
    shutil.copy(SCENES / "workbench/meshes/Bench.ply", tmp_path / "outside.ply")
    shutil.copy(SCENES / "workbench/meshes/Bench.ply", folder / "meshes/Bench.ply")
    (folder / "meshes/link.ply").symlink_to(tmp_path / "outside.ply")
    (folder / "up").symlink_to(tmp_path)
    (folder / "loop.ply").symlink_to("loop.ply")
    (folder / "deep").symlink_to(folder / "meshes")

    def read(elements):
        (folder / "scene.xml").write_text(f"{HEAD}\n{elements}\n</scene>")
        return read_scene_xml(folder / "scene.xml", {}).text

    return read


OUT, ABSOLUTE = "is outside the scene's folder", "absolute path"
FILES = {
    "../outside.ply": OUT,
    "meshes/../../outside.ply": OUT,
    "meshes/link.ply": OUT,
    "up/outside.ply": OUT,
    "\\etc\\passwd": ABSOLUTE,
    "..\\outside.ply": OUT,
    "/etc/passwd": ABSOLUTE,
    "C:\\meshes\\Bench.ply": ABSOLUTE,
    "meshes/Bunch.ply": "does not exist; did you mean 'meshes/Bench.ply'?",
    "meshes": "does not exist",
    "loop.ply": "",
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize(
    "element",
    [
        '<bsdf type="diffuse" id="it"><spectrum name="reflectance" filename="{}"/></bsdf>',
        '<default name="f" value="{}"/><shape type="ply"><string name="filename" value="$f"/></shape>',
        '<include filename="{}"/>',
    ],
)
def test_a_file_out_of_the_folder_or_missing_is_refused(neighbours, name, element):
    error = refusal(neighbours, element.format(name))
    assert "scene.xml:2: <" in error.where
    assert FILES[name] in str(error)


def test_files_get_their_absolute_paths_and_keep_the_names_that_the_scene_calls_them_by(neighbours, tmp_path):
    names = ["deep\\Bench.ply", "./meshes/Bench.ply", "deep/Bench.ply"]
    text = neighbours("".join(f'<shape type="ply"><string name="filename" value="{n}"/></shape>' for n in names))
    path = (tmp_path / "scene/meshes/Bench.ply").resolve()
    assert text.count(f'value="{path}"') == 3
    read = read_scene_xml(tmp_path / "scene/scene.xml", {})
    assert read.files == (("deep/Bench.ply", path), ("meshes/Bench.ply", path))


BOMB = """<?xml version="1.0"?>
<!DOCTYPE scene [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>
<scene version="3.0.0"><shape type="cube" id="&b;"/></scene>"""
READS = """<?xml version="1.0"?>
<!DOCTYPE scene [<!ENTITY a SYSTEM "file:///etc/passwd">]><scene version="3.0.0">&a;</scene>"""


@pytest.mark.parametrize("text", [BOMB, READS])
def test_a_doctype_is_refused(written, text):
    error = refusal(written, text, head="")
    assert error.where.endswith("scene.xml:2")
    assert "DOCTYPE" in error.problem


@pytest.mark.parametrize(
    ("elements", "message"),
    [
        ('<shape type="blender"><integer name="loop_tris" value="1"/></shape>', "it reads Blender's memory"),
        (
            '<shape type="serialized"/>',
            "<shape>: serialized is not read; allowed: ply; export it as PLY, or convert it",
        ),
        ('<shape type="../../../tmp/evil"/>', "<shape>: unknown type '../../../tmp/evil'; allowed: bspl"),
        ('<bsdf type="twosided"><bsdf type="mine"/></bsdf>', "scene.xml:2: <bsdf>: unknown type 'mine'"),
        ("<shape/>", "<shape>: type is missing"),
        ('<path value="/tmp"/>', "<path>: a search path is not allowed"),
        ('<script src="x"/>', "scene.xml:2: unknown element 'script'"),
        ('<shap type="cube"/>', "did you mean 'shape'?"),
        ('<bsdf type="conductor"><string name="material" value="../../x"/></bsdf>', "<string material>: "),
        ('<shape type="ply"><include filename="a.xml"/></shape>', "unknown element 'include'"),
        ('<shape type="cube" id="a"/>\n<shape type="cube" id="a"/>', ":3: <shape a>: the id occurs twice"),
        ('<shape type="sphere"><float name="radius" value="$r"/></shape>', "unknown parameter 'r'"),
        ("<bsdf>" * 80 + "</bsdf>" * 80, "at most 64 levels"),
        ('<include filename="scene.xml"/>', "includes itself"),
    ],
)
def test_what_is_not_known_to_be_harmless_is_refused(written, elements, message):
    assert message in str(refusal(written, elements))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<scene version='3.0.0'>\n<shape>\n</scene>", "scene.xml:3: this is not XML: mismatched tag"),
        ("<scene></scene>", "scene.xml:1: <scene>: the version is missing"),
        ('<shape type="cube"/>', "the outermost element is not a scene; allowed: <scene>"),
    ],
)
def test_a_file_that_is_no_scene_is_refused(written, text, message):
    assert message in str(refusal(written, text, head=""))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("shift_jis", "multi-byte encodings are not supported"),
        ("foo", "unknown encoding: foo"),
        ("undefined", "undefined encoding"),
    ],
)
def test_an_encoding_that_cannot_be_read_is_refused(written, tmp_path, name, message):
    text = f'<?xml version="1.0" encoding="{name}"?>\n{HEAD}</scene>'
    error = refusal(written, text, head="")
    assert (error.where, error.allowed) == (f"{tmp_path}/scene.xml:1", "UTF-8")
    assert message in error.problem
    (tmp_path / "part.xml").write_text(text)
    assert refusal(written, '<include filename="part.xml"/>').where.endswith("part.xml:1")


@pytest.mark.parametrize("name", ["utf-16", "latin-1"])
def test_an_encoding_that_python_knows_is_read(tmp_path, name):
    text = f'<?xml version="1.0" encoding="{name}"?>\n{HEAD}<shape type="cube" id="Würfel"/></scene>'
    (tmp_path / "scene.xml").write_text(text, encoding=name)
    assert 'id="Würfel"' in read_scene_xml(tmp_path / "scene.xml", {}).text


@pytest.mark.parametrize(
    ("elements", "message"),
    [
        ('\n<shape type="sphere"><float name="radius" value="abc"/></shape>', "scene.xml:3: "),
        ('\n\n<shape type="cube"><ref id="paint"/></shape>', "nothing has the id 'paint'"),
    ],
)
def test_an_error_of_mitsuba_is_reported_with_its_line(written, tmp_path, elements, message):
    backend.activate_backend("scalar")
    error = refusal(mitsuba_scene.parse_scene_dict, written(elements), tmp_path / "scene.xml")
    assert error.where.endswith(f"scene.xml:{2 + elements.count(chr(10))}")
    assert message in str(error)


@pytest.mark.parametrize("name", ["meshes/Crate.001.ply", "textures/print.png"])
def test_a_mesh_or_picture_that_is_cut_short_is_one_line(exported, name):
    scene = exported()
    file = scene.folder / name
    file.write_bytes(file.read_bytes()[:100])
    backend.activate_backend("scalar")

    def load():
        mitsuba_scene.load_lit_scene(mitsuba_scene.scene_dict(scene), ("World",), max_depth=3)

    assert file.name in str(refusal(load))


def test_a_device_in_the_place_of_a_scene_is_not_read(tmp_path):
    (tmp_path / "scene.xml").symlink_to("/dev/zero")
    assert "is not a file on a disk" in str(refusal(read_scene_xml, tmp_path / "scene.xml", {}))


def test_every_plug_in_that_is_allowed_is_one_of_mitsubas():
    existing = {path.name.removesuffix(".so") for path in Path(mi.__path__[0], "plugins").iterdir()}
    assert set().union(*ALLOWED_PLUGINS.values()) <= existing


# --- whose code is run --------------------------------------------------------------------------------


@pytest.fixture
def scripted(tmp_path):
    """A scene in an unregistered folder, with a script that leaves a mark when it is run."""
    folder = tmp_path / "downloads" / "plane"
    shutil.copytree(SCENES / "plane", folder, ignore=shutil.ignore_patterns("__pycache__"))
    script = folder / "scene.py"
    script.write_text(f"import os\nos.mkdir({str(tmp_path / 'ran')!r})\n{script.read_text()}")
    return folder


def test_a_script_elsewhere_is_not_run(scripted, tmp_path, monkeypatch):
    error = refusal(load_scene, scripted)
    assert "scene.py is code" in error.problem
    assert f"saf-gen scenes list --trust {scripted.parent}" in error.hint
    monkeypatch.chdir(scripted.parent)
    assert "is code" in refusal(load_scene, scripted).problem
    assert not (tmp_path / "ran").exists()


def test_scenes_of_the_working_directory_are_found_once_it_is_registered(scripted, tmp_path, monkeypatch):
    here = scripted.parent.parent
    (scripted.parent).rename(here / "scenes")
    monkeypatch.chdir(here)
    error = refusal(find_scene, "plane")
    assert error.problem == "the scene 'plane' is only in ./scenes, which is not registered"
    assert error.hint == f"read its code, and if you trust it: saf-gen scenes list --trust {here}/scenes"
    assert "plane" not in scene_names()
    assert refusal(load_scene, here / "scenes/plane").hint == error.hint
    register_folder(Path("scenes"))
    assert find_scene("plane").folder == here / "scenes/plane"
    monkeypatch.chdir("/")  # elsewhere it has no name, and is still trusted
    assert "unknown scene 'plane'" in refusal(find_scene, "plane").problem
    assert load_scene(here / "scenes/plane").id == "plane"
    forget_folder(here / "scenes")
    assert "is code" in refusal(load_scene, here / "scenes/plane").problem
    assert not (tmp_path / "ran").exists()
    monkeypatch.setenv("SAF_GEN_SCENES", str(here / "scenes"))
    backend.activate_backend("scalar")
    mitsuba_scene.scene_dict(load_scene(here / "scenes/plane"))
    assert (tmp_path / "ran").exists(), "the user named the folder"


@pytest.mark.parametrize("name", ["../downloads/plane", "downloads/../downloads/plane", "absolute"])
def test_a_name_in_a_recipe_leads_to_no_other_place(scripted, monkeypatch, name):
    (scripted.parent.parent / "scenes").mkdir()
    monkeypatch.chdir(scripted.parent.parent)
    name = str(scripted) if name == "absolute" else name
    assert "unknown scene" in refusal(find_scene, name).problem


def test_a_folder_with_both_kinds_of_geometry_is_refused(exported, monkeypatch):
    folder = exported().folder
    (folder / "scene.py").write_text("raise SystemExit")
    assert "is code" in refusal(load_scene, folder).problem
    monkeypatch.setenv("SAF_GEN_SCENES", str(folder.parent))
    assert "has scene.py and scene.xml" in refusal(find_scene, "workbench").problem
