"""Scene folders: cards, families, light groups, the kit, and the digest of everything that changes a pixel."""

import errno
import shutil
from dataclasses import replace

import pytest
from refusals import refusal

from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.plugins.lights import RESERVED_GROUP_NAMES, split_schedule
from saf_gen.render import backend, mitsuba_scene
from saf_gen.scene import scene_folder
from saf_gen.scene.scene_folder import find_scene
from saf_gen.scene.trusted_folders import forget_folder, register_folder
from saf_gen.stack.focal_stack import StackSpec, StackStore


@pytest.fixture
def plane(tmp_path, monkeypatch, test_scenes):
    """A copy of the folder of the test scene, found as ``plane``."""
    folder = tmp_path / "plane"
    shutil.copytree(test_scenes / "plane", folder, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path))
    return folder


@pytest.fixture
def edited(plane):
    """Return a function that replaces text in a file of the copy."""

    def edit(old, new, name="scene.yaml"):
        path = plane / name
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))

    return edit


MACRO = "{focal_length_mm: 25, f_number: 2.0, drive: image_distance, focus_range_m: [0.60, 0.42]}"
LIQUID = "{drive: focal_length, image_distance_mm: 26, f_number: 2.0, focus_range_m: [0.60, 0.42]}"
STAGE = "{drive: stage, focal_length_mm: 4, f_number: 1.1, magnification: 20, travel_m: [-3.0e-5, 3e-5]}"


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("id: plane", f"id: plane\nlenses: {{near: {MACRO}}}", 2, "params: {lens: {choice: [near]}}"),
        ("id: plane", f"id: plane\nlenses: {{near: {MACRO}}}\nparams: {{lens: near_}}", 3, "'near_'; allowed: near"),
        ("id: plane", f"id: plane\nlenses: {{near: {MACRO}}}\nparams: {{lens: {{uniform: [1, 2]}}}}", 3, "lens '1'"),
        ("id: plane", f"id: plane\nlenses: {{near: {MACRO}}}\nparams: {{lens: {{choice: [near, far]}}}}", 3, "'far'"),
        ("id: plane", f"id: plane\nlenses: {{near: {MACRO}}}\nparams: {{lens: {{choose: [near]}}}}", 3, "choose"),
        ("id: plane", "id: plane\nlenses: {near: {file: nowhere}}\nparams: {lens: near}", 2, "near"),
        ("id: plane", f"id: plane\nlenses: [{MACRO}]", 2, "lenses"),
        ("id: plane", f"id: plane\nlenses: {{a: {MACRO.replace('25', '650')}}}\nparams: {{lens: a}}", 2, "650 mm"),
        ("id: plane", "id: plain", 1, "'plain'; allowed: plane"),
        ("focus_range_m: [0.60, 0.42]", "focus_range_m: [0.60, 0.02]", 6, "25 mm"),
        ("focal_length_mm", "focal_lenght_mm", 6, "focal_length_mm"),
        ("focal_length_mm: 25", "focal_length_mm: 0.025", 6, "allowed: greater than or equal to 0.5"),  # metres
        ("look_at_m: [0, 0, 1]", "look_at_m: [0, 0, 0]", 5, "look_at_m away from origin_m"),
        ("room: [room]", "room: [lamp]", 7, "'lamp' is in two light groups"),
        ("id: plane", "id: plane\nunit_m: 0", 2, "unit_m is 0; allowed: greater than 0"),
        ("target: [plane]", "target: []", 10, "target is []"),
        ("  room: [room]", "  room: []", 9, "light group 'room' is empty"),
        ("id: plane", "id: plane\nkit: [broadpen]", 2, "did you mean 'broad_pen'?"),
        ("id: plane", "id: plane\nparams: {made: !!timestamp 2024-05-01}", 2, "params.made is the date 2024-05-01"),
        ("id: plane", "id: plane\nparams: {ink: {uniform: [0, .inf]}}", 2, "uniform is [0, inf]"),
        (MACRO, LIQUID.replace("image_distance_mm", "focal_length_mm"), 6, "'focal_length_mm'"),
        (
            MACRO,
            LIQUID.replace("focal_length,", "focal_lenght,"),
            6,
            "lens.drive is 'focal_lenght'; allowed: image_distance, focal_length, stage; did you mean 'focal_length'?",
        ),
        (MACRO, STAGE.replace("travel_m: [-3.0e-5, 3e-5]", "focus_range_m: [0.6, 0.4]"), 6, "'focus_range_m'"),
        (MACRO, STAGE.replace("magnification: 20, ", ""), 6, "'lens.magnification' is missing"),
        (MACRO, STAGE.replace("3e-5]", "-3.0e-5]"), 6, "the stage does not move"),
        (MACRO, STAGE.replace("3e-5]", "4.5e-3]"), 6, "0.00453 m"),
        (MACRO, LIQUID.replace("0.42", "0"), 6, "cannot focus at 0 m"),
        (MACRO, LIQUID.replace("0.42", "0.60"), 6, "the lens does not change"),
    ],
)
def test_a_wrong_card_is_refused_with_its_line(edited, old, new, line, message):
    edited(old, new)
    error = refusal(find_scene, "plane")
    assert f"scene.yaml:{line}" in str(error)
    assert message in str(error)


@pytest.mark.parametrize(
    ("lens", "drive", "words"),
    [
        (MACRO, ImageDistanceDrive(0.025, 2.0, (0.6, 0.42)), "25 mm f/2"),
        (MACRO.replace("drive: image_distance, ", ""), ImageDistanceDrive(0.025, 2.0, (0.6, 0.42)), "25 mm f/2"),
        (LIQUID, FocalLengthDrive(0.026, 2.0, (0.6, 0.42)), "26 mm f/2, varifocal"),
        (STAGE, Stage(0.004, 1.1, 20.0, (-30e-6, 30e-6)), "4 mm f/1.1, 20×, stage"),
    ],
)
def test_a_card_has_the_words_of_its_drive(edited, lens, drive, words):
    edited(MACRO, lens)
    scene = find_scene("plane")
    assert scene.build_drive() == drive
    assert scene.build_drive(4.0) == replace(drive, f_number=4.0)
    assert scene.card.lens.summary == words


def test_a_scene_without_geometry_is_refused(plane):
    (plane / "scene.py").unlink()
    assert "neither scene.py nor scene.xml" in refusal(find_scene, "plane").problem


def test_the_digest_sees_geometry_and_not_prose(edited, plane):
    before = find_scene("plane").digest
    edited("title: ", "title: Another name, not ")
    assert find_scene("plane").card.title.startswith("Another name")
    (plane / "SOURCE.md").write_text("made here")
    (plane / "preview.png").write_text("a sheet")
    (plane / "parts" / "__pycache__").mkdir(parents=True)
    (plane / "parts" / "__pycache__" / "x.pyc").write_text("compiled")
    assert find_scene("plane").digest == before
    edited("scale(60)", "scale(50)", "scene.py")
    changed = find_scene("plane").digest
    edited("title: ", "unit_m: 0.5\ntitle: ")
    assert len({before, changed, find_scene("plane").digest}) == 3


# --- the kit ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("modules", [["broad_pen"], ["surfaces", "knit"]])
def test_a_module_of_the_kit_is_the_file_that_the_script_imports(plane, modules):
    """The script and the digest are the same if the modules are files of the folder."""
    backend.activate_backend("scalar")
    name, script, card = modules[-1], plane / "scene.py", plane / "scene.yaml"
    script.write_text(f"import {name}\nassert {name}.__name__ == {name!r}\n{script.read_text()}")
    for module in modules:
        (plane / f"{module}.py").write_bytes(scene_folder.kit_modules()[module].read_bytes())
    local = find_scene("plane")
    described = set(mitsuba_scene.scene_dict(local))
    card.write_text(f"{card.read_text()}\nkit: [{', '.join(modules)}]\n")
    assert repr(modules[0]) in refusal(find_scene, "plane").problem  # there are two of this name
    for module in modules:
        (plane / f"{module}.py").unlink()
    shared = find_scene("plane")
    assert shared.digest == local.digest
    assert set(mitsuba_scene.scene_dict(shared)) == described


def test_a_module_of_the_kit_that_the_card_does_not_list_is_not_imported(plane):
    """Otherwise the digest would not cover it."""
    script = plane / "scene.py"
    script.write_text(f"import broad_pen\n{script.read_text()}")
    backend.activate_backend("scalar")
    assert "No module named 'broad_pen'" in refusal(mitsuba_scene.scene_dict, find_scene("plane")).problem


def test_an_edit_of_the_kit_gives_the_scenes_that_list_it_another_digest(plane, tmp_path, monkeypatch):
    card = plane / "scene.yaml"
    before = {"": find_scene("plane").digest}
    card.write_text(f"{card.read_text()}\nkit: [clay]\n")
    before["kit"] = find_scene("plane").digest
    edited = tmp_path / "clay.py"
    edited.write_bytes(scene_folder.kit_modules()["clay"].read_bytes() + b"\n")
    monkeypatch.setattr(scene_folder, "kit_modules", lambda: {"clay": edited})
    assert len({*before.values(), find_scene("plane").digest}) == 3


# --- a scene is a family ----------------------------------------------------------------------------


@pytest.fixture
def family(plane):
    """The card of a copy of the test scene with two open parameters."""
    card = plane / "scene.yaml"
    lines = [line for line in card.read_text().splitlines() if not line.startswith("params")]
    lines.append("params: {distance_m: {uniform: [0.4, 0.5]}, seed: {choice: [1, 2, 3]}, texels: 64}")
    card.write_text("\n".join(lines))
    return card


def test_open_parameters_are_drawn_by_name(family):
    scene = find_scene("plane")
    one, same, other = (scene.draw_member(7, "train", n) for n in (0, 0, 1))
    assert one.params == same.params
    assert one.params["distance_m"] != other.params["distance_m"]
    assert 0.4 <= one.params["distance_m"] <= 0.5
    assert one.params["seed"] in (1, 2, 3)
    assert one.params["texels"] == 64
    assert one.digest == other.digest
    assert find_scene("plane").params == scene.params


def test_parameters_can_be_chosen_by_name_only(family):
    scene = find_scene("plane")
    assert scene.with_params({"seed": 3}).params == {**scene.params, "seed": 3}
    error = refusal(scene.with_params, {"sead": 3})
    assert "'sead'" in error.problem
    assert error.nearest == "seed"


# --- light groups -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [*sorted(RESERVED_GROUP_NAMES), *("../../../x", "''", "Lamp", "a b", "lamp.1", "-lamp", "lämp", '"lamp\\n"')],
)
def test_a_light_group_has_a_name_that_can_be_a_file_and_means_nothing_else(edited, name):
    edited("  room: [room]", f"  {name}: [room]")
    error = str(refusal(find_scene, "plane"))
    assert "scene.yaml:9: a light group is called" in error
    assert "choice, geom" in error if name in RESERVED_GROUP_NAMES else "lower-case" in error


def test_the_reserved_names_are_a_stack_s_other_piece_and_what_begins_a_schedule(tmp_path):
    drive = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))
    spec = StackSpec("plane", "0" * 64, ("lamp",), drive, 2, 2, 60e-6, 2, 1, 2)
    assert set(StackStore(tmp_path, spec).pieces) - {"lamp"} <= RESERVED_GROUP_NAMES
    for name in RESERVED_GROUP_NAMES - {"geometry"}:
        assert set(split_schedule({name: {"kind": "constant"}})) == {""}


@pytest.mark.parametrize("name", ["0", "a-b_c"])
def test_letters_digits_and_dashes_make_a_light_group(edited, name):
    edited("  room: [room]", f"  '{name}': [room]")
    assert set(find_scene("plane").card.lights) == {"lamp", name}


# --- what the digest sees ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["preview_card.png", "textures/preview.png", "preview.jpg"])
def test_a_picture_that_is_called_like_a_preview_is_part_of_the_scene(plane, name):
    path = plane / name
    path.parent.mkdir(exist_ok=True)
    digests = set()
    for content in ("one", "two"):
        path.write_text(content)
        digests.add(find_scene("plane").digest)
    assert len(digests) == 2


def test_a_linked_folder_counts_with_what_is_in_it(plane, tmp_path):
    before = find_scene("plane").digest
    shared = tmp_path.parent / f"{tmp_path.name}_shared"
    (shared / "wood").mkdir(parents=True)
    (plane / "textures").symlink_to(shared)
    digests = {before}
    for content in ("oak", "ash"):
        (shared / "wood" / "grain.png").write_text(content)
        digests.add(find_scene("plane").digest)
    assert len(digests) == 3
    (plane / "textures").unlink()
    shutil.copytree(shared, plane / "textures")
    assert find_scene("plane").digest in digests  # a copy is the same scene


@pytest.mark.parametrize("to", [".", "..", "textures"])
def test_a_circular_link_is_refused(plane, to):
    (plane / "textures").mkdir()
    (plane / "textures" / "again").symlink_to(plane / to)
    error = refusal(find_scene, "plane")
    assert "is a link back to" in error.problem
    assert "again" in error.problem


def test_links_of_an_xml_scene_stay_in_its_folder(plane, tmp_path):
    (plane / "scene.py").rename(plane / "scene.xml")
    (plane / "wood").mkdir()
    (plane / "textures").symlink_to(plane / "wood")
    assert find_scene("plane")
    (plane / "shared").symlink_to(tmp_path.parent)
    error = refusal(find_scene, "plane")
    assert "plane/shared is a link to" in error.problem
    assert "scene.xml" in error.allowed


def test_a_folder_of_more_files_than_a_scene_has_is_refused(plane, monkeypatch):
    monkeypatch.setattr("saf_gen.scene.scene_folder.MAX_FILES", 1)
    assert "plane holds more than 1 files" in refusal(find_scene, "plane").problem


def test_a_file_of_a_scene_that_cannot_be_read_is_refused(plane, monkeypatch):
    def closed(self):
        raise PermissionError(errno.EACCES, "Permission denied", str(self))

    monkeypatch.setattr("pathlib.Path.read_bytes", closed)
    assert f"{plane}/scene.py cannot be read: Permission denied" in refusal(find_scene, "plane").problem


def test_a_folders_own_scene_shadows_one_that_comes_with_it_only_where_it_is_registered(tmp_path, monkeypatch):
    shipped = find_scene("camel").folder
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SAF_GEN_SCENES", raising=False)
    local = tmp_path / "scenes/camel"
    shutil.copytree(shipped, local)
    assert find_scene("camel").folder == shipped
    register_folder(local.parent)
    assert find_scene("camel").folder == local
    forget_folder(local.parent)
    monkeypatch.setenv("SAF_GEN_SCENES", str(local.parent))
    assert find_scene("camel").folder == local


def test_a_member_has_the_lens_that_its_parameter_names(plane, edited):
    before = find_scene("plane").digest
    edited(
        "id: plane",
        f"id: plane\nlenses: {{near: {MACRO}, liquid: {LIQUID}}}\nparams: {{lens: {{choice: [near, liquid]}}}}",
    )
    family = find_scene("plane")
    assert family.digest != before
    drives = {type(family.draw_member("lens", n).build_drive()) for n in range(9)}
    assert drives == {ImageDistanceDrive, FocalLengthDrive}
    liquid = family.with_params({"lens": "liquid"})
    assert liquid.card.lens.drive == "focal_length"
    assert liquid.script_params["lens"]["image_distance_mm"] == 26
    assert liquid.params == {"lens": "liquid"}
    assert "liquid" in str(refusal(family.with_params, {"lens": "liquids"}))
