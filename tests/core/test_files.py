"""Files are complete or missing."""

import errno
import os
import time
from pathlib import Path

import pytest
from refusals import assert_says, refusal

from saf_gen.core.files import (
    ABANDONED_S,
    atomic_file,
    check_file_system,
    check_on_disk,
    check_writable,
    remove_leftovers,
    temporary_folder,
)
from saf_gen.errors import BadInput


def test_an_error_leaves_the_old_file_and_no_temporary(tmp_path):
    (tmp_path / "a.txt").write_text("old")

    def half_written():
        with atomic_file(tmp_path / "a.txt") as part:
            part.write_text("half")
            raise ValueError

    with pytest.raises(ValueError):
        half_written()
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_if_two_write_the_same_file_the_last_one_wins(tmp_path):
    """Two containers may use the same process id."""
    with atomic_file(tmp_path / "a.txt") as one, atomic_file(tmp_path / "a.txt") as other:
        one.write_text("one")
        other.write_text("other")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "one"


def abandoned(part: Path, **changes: str) -> Path:
    """Return the path of a temporary file or folder, with another machine or process in its name."""
    *before, machine, pid, _ = part.name.split(".")
    return part.with_name(".".join([*before, changes.get("machine", machine), changes.get("pid", pid), "part"]))


def test_what_the_dead_left_goes_when_somebody_writes_there_and_nothing_else(tmp_path):
    """Processes of other machines are unknown, so their files are deleted if they have not changed for a day."""
    dead = str(2**22 + 1)  # above the largest process id
    with temporary_folder(tmp_path / "other" / "x") as mine:
        gone = abandoned(tmp_path / mine.name, pid=dead)
        old, new = (abandoned(tmp_path / mine.name, machine=name) for name in ("far", "farther"))
        kept = [new, tmp_path / mine.name, tmp_path / f".notes.{dead}.part", tmp_path / ".a.txt.part"]
        for folder in (gone, new):
            (folder / "below").mkdir(parents=True)
        for file in (old, *kept[1:]):
            file.write_text("")
        os.utime(old, (time.time() - 2 * ABANDONED_S,) * 2)
        with atomic_file(tmp_path / "b.txt") as part:
            part.write_text("complete")
        assert {p.name for p in tmp_path.iterdir()} == {"b.txt", "other", *(p.name for p in kept)}
        deep = abandoned(mine, pid=dead)
        deep.write_text("")
        remove_leftovers(tmp_path, recursive=True)
        assert not deep.exists()
        assert mine.is_dir()


def test_a_full_disk_is_reported_with_the_final_name_of_the_file(tmp_path):
    with pytest.raises(BadInput) as raised, temporary_folder(tmp_path / "out") as part, atomic_file(part / "a.txt"):
        raise OSError(errno.ENOSPC, "")
    assert raised.value.problem == f"{tmp_path}/out/a.txt cannot be written: No space left on device"
    assert "run the same command again" in raised.value.hint
    assert not list(tmp_path.iterdir())


def test_the_folder_is_synced_after_a_rename(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fsync", lambda file: synced.append(Path(f"/proc/self/fd/{file}").resolve()))
    with atomic_file(tmp_path / "new" / "a.txt") as part:
        part.write_text("complete")
        assert not (tmp_path / "new" / "a.txt").exists()
    assert synced == [part, tmp_path / "new"]
    assert (tmp_path / "new" / "a.txt").read_text() == "complete"


def test_a_folder_that_cannot_be_is_told_before_work_begins(tmp_path):
    (tmp_path / "file").write_text("")
    assert_says(refusal(check_writable, tmp_path / "file" / "out"), "file/out cannot be written")
    check_writable(tmp_path / "new" / "out")
    assert not (tmp_path / "new").exists()
    with (
        pytest.raises(BadInput, match=r"file/a.txt cannot be written: .*; choose another folder"),
        atomic_file(tmp_path / "file" / "a.txt"),
    ):
        pass


def raises(number):
    def refuse(*_):
        raise OSError(number, os.strerror(number))

    return refuse


@pytest.mark.parametrize(
    ("name", "number", "fragments"),
    [
        ("pathlib.Path.replace", errno.ENOSYS, "cannot replace a file by another | Function not impl | ext4"),
        ("os.fsync", errno.EINVAL, "cannot sync files to the disk | NFS"),
        ("fcntl.flock", errno.ENOLCK, "cannot lock files | HDF5_USE_FILE_LOCKING=FALSE"),
    ],
)
def test_a_file_system_that_cannot_hold_a_dataset_is_refused(tmp_path, monkeypatch, name, number, fragments):
    check_file_system(tmp_path)
    monkeypatch.setattr("fcntl.flock", raises(errno.ENOSYS))  # HDF5 does without locks there
    check_file_system(tmp_path)
    monkeypatch.setattr(name, raises(number))
    assert_says(refusal(check_file_system, tmp_path), f"{tmp_path} | {fragments}")
    assert not list(tmp_path.iterdir())
    if "flock" in name:
        monkeypatch.setenv("HDF5_USE_FILE_LOCKING", "FALSE")
        check_file_system(tmp_path)


@pytest.mark.parametrize("address", ["s3://lab/a", "https://example.org/data/a.h5", "s3:/lab/a"])
def test_an_address_is_no_path_for_results_and_none_of_data(address, tmp_path, monkeypatch, call):
    """Without the check, a folder called ``s3:`` would be made."""
    monkeypatch.chdir(tmp_path)
    scheme = address.partition(":")[0]
    for words in (
        ("evaluate", address),
        ("evaluate", "sample", "--out", address),
        ("generate", "quickstart", "--dry-run", "--out", address),
        ("verify", address),
        ("inspect", address),
        ("cut", address, "--to", "10", "--out", "x.h5"),
    ):
        code, _, err = call(*words)
        assert (code, err.count("\n")) == (2, 1), err
        assert_says(err, f"{scheme}:// | is an address | a path on a disk | saf-gen fetch")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_whose_name_ends_in_a_colon_is_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data:").mkdir()
    check_on_disk(Path("data:/a"))
    check_on_disk(Path("C:/data"))
