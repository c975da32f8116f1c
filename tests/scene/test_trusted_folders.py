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
    assert error.hint == "remove it, and run saf-gen init again"


def test_without_a_home_folder_nothing_is_registered_and_the_hint_names_the_variable(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", "relative")
    monkeypatch.setattr("os.path.expanduser", lambda path: path)
    assert registered_folders() == []
    assert "SAF_GEN_SCENES" in refusal(register_folder, tmp_path).hint


def test_init_makes_and_registers_a_folder(call, tmp_path, monkeypatch):
    scenes = tmp_path / "mine/scenes"
    code, out, err = call("init", tmp_path / "mine")
    assert (code, err) == (0, "")
    assert out == f"{scenes} is registered\nnext: saf-gen scenes new my_scene; saf-gen generate quickstart\n"
    monkeypatch.chdir(scenes.parent)
    assert call("scenes", "new", "card")[0] == 0
    out = call("init")[1]
    assert f"{scenes} was registered already\nscenes found by name in {scenes.parent}: card\n" in out
    assert call("init", "--forget")[1] == f"{scenes} is no longer registered; its files are unchanged\n"
    assert (scenes / "card/scene.yaml").is_file()
    code, _, err = call("scenes", "preview", "card")
    assert code == 2
    assert "saf-gen init" in err


def test_a_new_scene_registers_a_folder_without_scenes_and_no_other(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert f"registered: {tmp_path / 'scenes'};" in call("scenes", "new", "card")[1]
    assert registered_folders() == [tmp_path / "scenes"]
    forget_folder(tmp_path / "scenes")
    assert "next: saf-gen init, if you trust the code of all scenes in ./scenes" in call("scenes", "new", "other")[1]
    assert registered_folders() == []


def test_a_folder_that_cannot_be_made_is_one_line(call, tmp_path):
    (tmp_path / "file").write_text("")
    code, _, err = call("init", tmp_path / "file")
    assert (code, err.count("\n")) == (2, 1)
    assert "file/scenes cannot be written" in err
    assert registered_folders() == []
