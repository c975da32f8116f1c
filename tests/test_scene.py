"""Scene cards: what is right is read, what is wrong is told with its line."""

import shutil

import pytest

from saf_gen.errors import BadInput
from saf_gen.scene import find_scene, scene_names


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
        ("target: [plane]", "target: []", r"scene.yaml:10: target is \[\]"),
    ],
)
def test_a_wrong_card_is_told_in_one_line(edited, old, new, told):
    edited(old, new)
    with pytest.raises(BadInput, match=told):
        find_scene("plane")


def test_a_scene_without_geometry_is_told(edited):
    (edited("id: plane", "id: plane") / "scene.py").unlink()
    with pytest.raises(BadInput, match=r"has no scene.py; add one with build\(params\)"):
        find_scene("plane")


def test_the_digest_sees_geometry_and_not_prose(edited, test_scenes):
    before = find_scene("plane").digest
    folder = edited("scale(60)", "scale(50)", "scene.py")
    changed = find_scene("plane").digest
    assert changed != before
    (folder / "SOURCE.md").write_text("made here")
    assert find_scene("plane").digest == changed
