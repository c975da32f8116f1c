"""Where compiled kernels are kept if the installation, or a home, cannot be written."""

import os
import stat
import tempfile
from pathlib import Path

import pytest

from saf_gen.core import kernel_cache
from saf_gen.core.kernel_cache import VARIABLE, choose_kernel_cache


@pytest.fixture
def read_only(monkeypatch, tmp_path):
    """Make the package read-only; a home is a path below a file, where no folder can be made."""
    (tmp_path / "file").touch()
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "file" / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != kernel_cache.PACKAGE and access(path, mode))
    return tmp_path


def test_kernels_are_kept_beside_the_source_if_that_can_be_written(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    assert choose_kernel_cache() == "beside the source"
    assert VARIABLE not in os.environ


def test_kernels_are_kept_in_the_home_of_a_user_who_cannot_write_the_installation(read_only, monkeypatch):
    monkeypatch.setenv("HOME", str(read_only / "home"))
    assert choose_kernel_cache() == f"the user's cache folder, {read_only}/home/.cache"
    assert VARIABLE not in os.environ


def test_without_a_home_kernels_are_kept_in_a_private_folder(read_only, monkeypatch):
    monkeypatch.setenv(VARIABLE, "")  # so that it is restored
    said = choose_kernel_cache()
    folder = os.environ[VARIABLE]
    assert said.startswith(f"{folder}, because neither")
    assert stat.S_IMODE(Path(folder).stat().st_mode) == 0o700
    monkeypatch.setenv(VARIABLE, "")
    choose_kernel_cache()
    assert os.environ[VARIABLE] == folder


@pytest.mark.parametrize("trap", ["a folder that others can write", "a link", "a file"])
def test_a_folder_that_another_user_prepared_is_not_used(read_only, monkeypatch, trap):
    monkeypatch.setenv(VARIABLE, "")
    prepared = read_only / f"saf-gen-kernels-{os.getuid()}"
    if trap == "a link":
        (read_only / "theirs").mkdir()
        prepared.symlink_to(read_only / "theirs")
    elif trap == "a file":
        prepared.touch()
    else:
        prepared.mkdir()
        prepared.chmod(0o777)
    choose_kernel_cache()
    assert os.environ[VARIABLE] != str(prepared)
    assert stat.S_IMODE(Path(os.environ[VARIABLE]).stat().st_mode) == 0o700
