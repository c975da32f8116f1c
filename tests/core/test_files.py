"""Files are there whole or not at all."""

import socket

import pytest
from refusals import assert_says, refusal

from saf_gen.core.files import check_writable, remove_stale_temporaries, write_atomically
from saf_gen.errors import BadInput


def test_a_file_appears_when_it_is_whole(tmp_path):
    with write_atomically(tmp_path / "new" / "a.txt") as part:
        part.write_text("whole")
        assert not (tmp_path / "new" / "a.txt").exists()
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["a.txt"]
    assert (tmp_path / "new" / "a.txt").read_text() == "whole"


def test_an_error_leaves_the_old_file_and_no_temporary(tmp_path):
    (tmp_path / "a.txt").write_text("old")

    def half_written():
        with write_atomically(tmp_path / "a.txt") as part:
            part.write_text("half")
            raise ValueError

    with pytest.raises(ValueError):
        half_written()
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_two_may_write_the_same_file_and_the_last_one_wins_whole(tmp_path):
    """As two containers with the same number of process do."""
    with write_atomically(tmp_path / "a.txt") as one, write_atomically(tmp_path / "a.txt") as other:
        one.write_text("one")
        other.write_text("other")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "one"


def test_what_the_dead_of_this_machine_left_is_cleared_and_nothing_else(tmp_path, monkeypatch):
    monkeypatch.setattr(socket, "gethostname", lambda: "node.7")
    dead = 2**22 + 1  # above the largest number of a process
    names = [f".a.h5.0f.{host}.{dead}.part" for host in ("node-7", "node-8")] + ["part"]
    with write_atomically(tmp_path / "b.txt") as part:
        for name in names:
            (tmp_path / name).write_text("")
        part.write_text("living")
        remove_stale_temporaries(tmp_path)
        assert {p.name for p in tmp_path.iterdir()} == {*names[1:], part.name}


def test_a_folder_in_the_way_is_told_in_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(BadInput, match=r"file/a.txt cannot be written: .*; choose another folder"),
        write_atomically(tmp_path / "file" / "a.txt"),
    ):
        pass


def test_a_folder_that_cannot_be_is_told_before_work_begins(tmp_path):
    (tmp_path / "file").write_text("")
    assert_says(refusal(check_writable, tmp_path / "file" / "out"), "file/out cannot be written")
    check_writable(tmp_path / "new" / "out")
    assert not (tmp_path / "new").exists()
