"""Scene cards: what is right is read, what is wrong is told with its line."""

import errno
import shutil
from dataclasses import replace

import pytest

from saf_gen.errors import BadInput
from saf_gen.lights import _schedule
from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.scene.scene_folder import RESERVED_GROUP_NAMES, find_scene, scene_names
from saf_gen.stack.focal_stack import StackSpec, StackStore


@pytest.fixture
def edited(tmp_path, monkeypatch, test_scenes):
    """Copies the test scene, replaces text in one of its files, and makes it known."""

    def edit(old, new, name="scene.yaml"):
        folder = tmp_path / "plane"
        shutil.copytree(test_scenes / "plane", folder, ignore=shutil.ignore_patterns("__pycache__"))
        path = folder / name
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
        monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path))
        return folder

    return edit


def test_the_projects_scenes_are_found_with_cards_that_fit():
    assert {"camel", "usaf_target"} <= set(scene_names())
    for name in ("camel", "usaf_target"):
        card = find_scene(name).card
        assert len(card.lights) >= 2
        assert card.licence


def test_an_unknown_scene_is_told_with_the_nearest(test_scenes):
    with pytest.raises(
        BadInput, match=r"unknown scene 'plain'; allowed: .*; did you mean 'plane'\?; see: saf-gen"
    ):
        find_scene("plain")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("id: plane", "id: plain", r"scene.yaml:1: id is 'plain'; allowed: plane"),
        (
            "focus_range_m: [0.60, 0.42]",
            "focus_range_m: [0.60, 0.02]",
            r"scene.yaml:6: the lens of 25 mm cannot",
        ),
        ("focal_length_mm", "focal_lenght_mm", r"scene.yaml:6: .*focal_length_mm"),
        ("look_at_m: [0, 0, 1]", "look_at_m: [0, 0, 0]", r"look_at_m away from origin_m"),
        ("room: [room]", "room: [lamp]", r"emitter 'lamp' is in two light groups"),
        ("id: plane", "id: plane\nunit_m: 0", r"scene.yaml:2: unit_m is 0; allowed: greater than 0"),
        ("target: [plane]", "target: []", r"scene.yaml:10: target is \[\]"),
    ],
)
def test_a_wrong_card_is_told_in_one_line(edited, old, new, told):
    edited(old, new)
    with pytest.raises(BadInput, match=told):
        find_scene("plane")


MACRO = "{focal_length_mm: 25, f_number: 2.0, drive: image_distance, focus_range_m: [0.60, 0.42]}"
LIQUID = "{drive: focal_length, image_distance_mm: 26, f_number: 2.0, focus_range_m: [0.60, 0.42]}"
STAGE = "{drive: stage, focal_length_mm: 4, f_number: 1.1, magnification: 20, travel_m: [-3.0e-5, 3e-5]}"


@pytest.mark.parametrize(
    ("lens", "drive", "words"),
    [
        (MACRO, ImageDistanceDrive(0.025, 2.0, (0.6, 0.42)), "25 mm f/2"),
        (
            MACRO.replace("drive: image_distance, ", ""),
            ImageDistanceDrive(0.025, 2.0, (0.6, 0.42)),
            "25 mm f/2",
        ),
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


@pytest.mark.parametrize(
    ("lens", "told"),
    [
        (
            LIQUID.replace("focal_length,", "focal_lenght,"),
            r"scene.yaml:6: lens.drive is 'focal_lenght'; allowed: image_distance, focal_length, stage; "
            r"did you mean 'focal_length'\?",
        ),
        (
            LIQUID.replace("image_distance_mm", "focal_length_mm"),
            r"scene.yaml:6: unknown key 'focal_length_mm' in lens; allowed: .*image_distance_mm",
        ),
        (
            STAGE.replace("travel_m: [-3.0e-5, 3e-5]", "focus_range_m: [0.6, 0.4]"),
            r"scene.yaml:6: unknown key 'focus_range_m' in lens; allowed: .*travel_m",
        ),
        (STAGE.replace("magnification: 20, ", ""), r"the key 'lens.magnification' is missing"),
        (STAGE.replace("20", "-20"), r"scene.yaml:6: lens.magnification is -20; allowed: greater than 0"),
        (STAGE.replace("3e-5]", "-3.0e-5]"), r"scene.yaml:6: the stage does not move"),
        (STAGE.replace("3e-5]", "4.5e-3]"), r"scene.yaml:6: a travel of 0.00453 m runs into the lens"),
        (LIQUID.replace("0.42", "0"), r"scene.yaml:6: the lens cannot focus at 0 m"),
        (LIQUID.replace("0.42", "0.60"), r"scene.yaml:6: the lens does not change"),
    ],
)
def test_a_wrong_drive_is_told_in_one_line(edited, lens, told):
    edited(MACRO, lens)
    with pytest.raises(BadInput, match=told) as caught:
        find_scene("plane")
    assert "\n" not in str(caught.value)


def test_a_scene_without_geometry_is_told(edited):
    (edited("id: plane", "id: plane") / "scene.py").unlink()
    with pytest.raises(
        BadInput, match=r"has neither scene.py nor scene.xml; add scene.py with build\(params\)"
    ):
        find_scene("plane")


def test_the_digest_sees_geometry_and_not_prose(edited, test_scenes):
    before = find_scene("plane").digest
    folder = edited("scale(60)", "scale(50)", "scene.py")
    changed = find_scene("plane").digest
    assert changed != before
    (folder / "SOURCE.md").write_text("made here")
    assert find_scene("plane").digest == changed


def test_words_of_the_card_render_nothing_again_and_its_lens_does(edited, test_scenes):
    before = find_scene("plane").digest
    card = (test_scenes / "plane" / "scene.yaml").read_text()
    title = next(line for line in card.splitlines() if line.startswith("title:"))
    folder = edited(title, "title: Another name  # and a remark")
    assert find_scene("plane").card.title == "Another name"
    assert find_scene("plane").digest == before
    (folder / "scene.yaml").write_text((folder / "scene.yaml").read_text() + "\nunit_m: 0.5\n")
    assert find_scene("plane").digest != before


# --- a scene is a family ----------------------------------------------------------------------------


@pytest.fixture
def family(test_scenes, tmp_path, monkeypatch):
    """The test scene with two open parameters."""
    folder = tmp_path / "scenes" / "plane"
    shutil.copytree(test_scenes / "plane", folder)
    card = (folder / "scene.yaml").read_text().rstrip().splitlines()
    card = [line for line in card if not line.startswith("params")]
    card.append("params: {distance_m: {uniform: [0.4, 0.5]}, seed: {choice: [1, 2, 3]}, texels: 64}")
    (folder / "scene.yaml").write_text("\n".join(card))
    monkeypatch.setenv("SAF_GEN_SCENES", str(folder.parent))
    return folder


def test_open_parameters_are_drawn_by_name(family):
    scene = find_scene("plane")
    one, same, other = (scene.draw_member(7, "train", n) for n in (0, 0, 1))
    assert one.params == same.params
    assert one.params["distance_m"] != other.params["distance_m"]
    assert 0.4 <= one.params["distance_m"] <= 0.5
    assert one.params["seed"] in (1, 2, 3)
    assert one.params["texels"] == 64
    assert one.digest == other.digest


def test_a_scene_looked_at_twice_is_the_same(family):
    assert find_scene("plane").params == find_scene("plane").params


def test_parameters_can_be_chosen_by_name_only(family):
    scene = find_scene("plane")
    assert scene.with_params({"seed": 3}).params == {**scene.params, "seed": 3}
    with pytest.raises(BadInput, match=r"unknown parameter of scene 'plane': 'sead'.*did you mean 'seed'"):
        scene.with_params({"sead": 3})


def test_a_range_of_a_card_that_has_no_width_is_refused_with_its_line(family):
    card = family / "scene.yaml"
    card.write_text(card.read_text().replace("[0.4, 0.5]", "[0.5, 0.5]"))
    with pytest.raises(BadInput, match=r"scene.yaml:\d+: uniform is \[0.5, 0.5\]; allowed: \[low, high\]"):
        find_scene("plane")


@pytest.mark.parametrize(
    ("params", "told"),
    [
        (
            "{made: 2024-05-01}",
            r"scene.yaml:\d+: params.made is the date 2024-05-01; allowed: a finite number",
        ),
        ("{ink: .nan}", r"scene.yaml:\d+: params.ink is nan; allowed"),
        ("{ink: {uniform: [0, .inf]}}", r"scene.yaml:\d+: uniform is \[0, inf\]; allowed: .*finite numbers"),
        ("{ink: {choice: [{uniform: [0, 1]}]}}", r"scene.yaml:\d+: a choice holds the range"),
        ("{ink: {chioce: [1, 2]}}", r"scene.yaml:\d+: params.ink is {'chioce': .*did you mean 'choice'\?"),
    ],
)
def test_a_parameter_of_a_card_that_no_file_could_record_is_told(edited, params, told):
    edited("id: plane", f"id: plane\nparams: {params}")
    with pytest.raises(BadInput, match=told) as caught:
        find_scene("plane")
    assert "\n" not in str(caught.value)


# --- light groups -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(RESERVED_GROUP_NAMES))
def test_a_light_group_has_no_name_that_means_something_else(edited, name):
    edited("  room: [room]", f"  {name}: [room]")
    told = (
        rf"scene.yaml:9: a light group is called '{name}', which means .*; allowed: any name but choice, geom"
    )
    with pytest.raises(BadInput, match=told):
        find_scene("plane")


def test_the_reserved_names_are_a_stack_s_other_piece_and_what_begins_a_schedule(tmp_path):
    drive = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))
    spec = StackSpec("plane", "0" * 64, ("lamp",), drive, 2, 2, 60e-6, 2, 1, 2)
    assert set(StackStore(tmp_path, spec).pieces) - {"lamp"} <= RESERVED_GROUP_NAMES
    for name in RESERVED_GROUP_NAMES - {"geometry"}:
        assert set(_schedule.split_by_group({name: {"kind": "constant"}})) == {""}


@pytest.mark.parametrize("name", ["../../../x", "''", "Lamp", "a b", "lamp.1", "-lamp", "lämp", '"lamp\\n"'])
def test_a_light_group_has_a_name_that_can_be_a_file(edited, name):
    edited("  room: [room]", f"  {name}: [room]")
    with pytest.raises(
        BadInput, match=r"scene.yaml:9: a light group is called .*; allowed: lower-case"
    ) as caught:
        find_scene("plane")
    assert "\n" not in str(caught.value)


def test_a_light_group_without_emitters_is_refused(edited):
    edited("  room: [room]", "  room: []")
    with pytest.raises(
        BadInput,
        match=r"scene.yaml:9: light group 'room' is empty; allowed: the names of at least one emitter",
    ):
        find_scene("plane")


@pytest.mark.parametrize("name", ["lamp-2", "0", "ring_0", "a-b_c"])
def test_letters_digits_and_dashes_make_a_light_group(edited, name):
    edited("  room: [room]", f"  '{name}': [room]")
    assert set(find_scene("plane").card.lights) == {"lamp", name}


# --- what the digest sees ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["preview_card.png", "previews/a.png", "textures/preview.png", "preview.jpg"]
)
def test_a_picture_that_is_called_like_a_preview_is_part_of_the_scene(edited, name):
    path = edited("id: plane", "id: plane") / name
    path.parent.mkdir(exist_ok=True)
    digests = set()
    for content in ("one", "two"):
        path.write_text(content)
        digests.add(find_scene("plane").digest)
    assert len(digests) == 2


def test_the_scene_s_own_preview_and_caches_are_no_part_of_it(edited):
    folder = edited("id: plane", "id: plane")
    before = find_scene("plane").digest
    (folder / "preview.png").write_text("a sheet")
    (folder / "parts" / "__pycache__").mkdir(parents=True)
    (folder / "parts" / "__pycache__" / "x.pyc").write_text("compiled")
    assert find_scene("plane").digest == before


def test_a_linked_folder_counts_with_what_is_in_it(edited, tmp_path):
    folder = edited("id: plane", "id: plane")
    before = find_scene("plane").digest
    shared = tmp_path.parent / f"{tmp_path.name}_shared"
    (shared / "wood").mkdir(parents=True)
    (folder / "textures").symlink_to(shared)
    digests = {before}
    for content in ("oak", "ash"):
        (shared / "wood" / "grain.png").write_text(content)
        digests.add(find_scene("plane").digest)
    assert len(digests) == 3
    (folder / "textures").unlink()
    shutil.copytree(shared, folder / "textures")
    assert find_scene("plane").digest in digests  # a copy is the same scene


@pytest.mark.parametrize("to", [".", "..", "textures"])
def test_a_link_in_a_circle_is_told(edited, to):
    folder = edited("id: plane", "id: plane")
    (folder / "textures").mkdir()
    (folder / "textures" / "again").symlink_to(folder / to)
    with pytest.raises(BadInput, match=r"again(/plane)? leads in a circle, back to .*; remove the link"):
        find_scene("plane")


def test_links_of_an_xml_scene_stay_in_its_folder(edited, tmp_path):
    folder = edited("id: plane", "id: plane")
    (folder / "scene.py").rename(folder / "scene.xml")
    (folder / "wood").mkdir()
    (folder / "textures").symlink_to(folder / "wood")
    assert find_scene("plane")
    (folder / "shared").symlink_to(tmp_path.parent)
    told = r"plane/shared is a link to .*; allowed: for a scene.xml, what lies in the scene's folder; copy it"
    with pytest.raises(BadInput, match=told):
        find_scene("plane")


def test_a_folder_of_more_files_than_a_scene_has_is_refused(edited, monkeypatch):
    edited("id: plane", "id: plane")
    monkeypatch.setattr("saf_gen.scene.scene_digest.MOST", 1)
    with pytest.raises(BadInput, match="plane holds more than 1 files"):
        find_scene("plane")


def test_a_file_of_a_scene_that_cannot_be_read_is_told(edited, monkeypatch):
    def closed(self):
        raise PermissionError(errno.EACCES, "Permission denied", str(self))

    folder = edited("id: plane", "id: plane")
    monkeypatch.setattr("pathlib.Path.read_bytes", closed)
    with pytest.raises(BadInput, match=rf"{folder}/scene.py cannot be read: Permission denied"):
        find_scene("plane")
