"""The list of folders whose scenes the user trusts, and the command that keeps it."""

import pytest
from refusals import refusal

from saf_gen.scene.trusted_folders import forget_folder, register_folder, registered_folders, registration_file


@pytest.fixture(autouse=True)
def _nothing_registered(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


def test_a_folder_is_registered_once_and_forgotten(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    assert registered_folders() == []
    assert [register_folder(folder) for folder in (one, other, one)] == [True, True, False]
    assert registered_folders() == [one, other]
    assert [forget_folder(one), forget_folder(one)] == [True, False]
    assert registered_folders() == [other]


def test_a_path_that_is_relative_or_has_two_lines_is_never_taken(tmp_path):
    registration_file().parent.mkdir(parents=True)
    registration_file().write_text(f"scenes\n\n../up\n{tmp_path}\n")
    assert registered_folders() == [tmp_path]
    assert "line break" in refusal(register_folder, tmp_path / "a\nb").problem


def test_a_list_that_cannot_be_read_is_named():
    registration_file().parent.mkdir(parents=True)
    registration_file().write_bytes(b"\xff\xfe")
    error = refusal(registered_folders)
    assert str(registration_file()) in error.problem
    assert error.hint == "remove it, and trust the folders again: saf-gen scenes list --trust FOLDER"


def test_without_a_home_folder_nothing_is_registered_and_the_hint_names_the_variable(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", "relative")
    monkeypatch.setattr("os.path.expanduser", lambda path: path)
    assert registered_folders() == []
    assert "SAF_GEN_SCENES" in refusal(register_folder, tmp_path).hint


@pytest.mark.slow
def test_a_listed_folder_is_trusted_and_then_forgotten(call, tmp_path, monkeypatch):
    scenes = tmp_path / "mine/scenes"
    scenes.mkdir(parents=True)
    monkeypatch.chdir(scenes.parent)
    assert call("scenes", "new", "card")[0] == 0
    forget_folder(scenes)
    code, out, err = call("scenes", "preview", "card")
    assert (code, f"saf-gen scenes list --trust {scenes}" in err) == (2, True)
    code, out, err = call("scenes", "list", "--trust", "scenes")
    assert (code, err, "card" in out.split()) == (0, f"{scenes}: trusted from now on\n", True)
    code, out, err = call("scenes", "list", "--forget", "scenes")
    assert (code, err, "card" in out.split()) == (0, f"{scenes}: not trusted\n", False)
    assert (scenes / "card/scene.yaml").is_file()


def test_a_new_scene_registers_a_folder_without_scenes_and_no_other(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert f"trusted: {tmp_path / 'scenes'};" in call("scenes", "new", "card")[1]
    assert registered_folders() == [tmp_path / "scenes"]
    forget_folder(tmp_path / "scenes")
    assert (
        "next: saf-gen scenes list --trust scenes, if you trust the code of all scenes there"
        in call("scenes", "new", "other")[1]
    )
    assert registered_folders() == []


def test_what_is_no_folder_is_not_trusted(call, tmp_path):
    (tmp_path / "file").write_text("")
    for name in ("file", "gone"):
        code, _, err = call("scenes", "list", "--trust", tmp_path / name)
        assert (code, err.count("\n"), f"{name}: is no folder" in err) == (2, 1, True)
    assert registered_folders() == []
