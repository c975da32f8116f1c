"""The manifest: a round trip, and one clear line for everything that can be wrong with it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from saf_gen.errors import BadInput
from saf_gen.stream.manifest import (
    MANIFEST_NAME,
    Manifest,
    SequenceEntry,
    read_manifest,
    verify_entry,
    write_manifest,
    write_text_atomically,
)
from saf_gen.stream.stream_file import write_stream

ENTRY = SequenceEntry(
    "a-1",
    "test",
    "usaf_target",
    0,
    "static",
    "sweep",
    "constant",
    0,
    2**62,
    "test/a-1.h5",
    20_000,
    "f00",
    "c0ffee",
)
MANIFEST_ = Manifest(
    "tiny", "abc", "llvm", (ENTRY, replace(ENTRY, id="a-2", split="train", file="train/a-2.h5"))
)


def changed(folder, change):
    """Write the manifest, change its document, and read it again."""
    write_manifest(folder, MANIFEST_)
    document = json.loads((folder / MANIFEST_NAME).read_text())
    change(document)
    (folder / MANIFEST_NAME).write_text(json.dumps(document))
    return read_manifest(folder)


def test_a_manifest_comes_back_as_it_was_written(tmp_path):
    write_manifest(tmp_path / "new", MANIFEST_)
    assert read_manifest(tmp_path / "new") == MANIFEST_
    assert [p.name for p in (tmp_path / "new").iterdir()] == [MANIFEST_NAME]


def test_splits_are_listed_in_the_order_of_the_sequences():
    assert MANIFEST_.splits == ("test", "train")


def test_a_missing_folder_names_the_nearest(tmp_path):
    (tmp_path / "sad_synthetic").mkdir()
    with pytest.raises(BadInput, match="no such folder; did you mean 'sad_synthetic'"):
        read_manifest(tmp_path / "sad_syntetic")


def test_a_folder_without_a_manifest_is_no_dataset(tmp_path):
    with pytest.raises(BadInput, match=r"has no manifest\.json; make the dataset"):
        read_manifest(tmp_path)


def test_a_file_is_no_dataset_folder(tmp_path):
    (tmp_path / "x").write_text("")
    with pytest.raises(BadInput, match="this is no folder"):
        read_manifest(tmp_path / "x")


@pytest.mark.parametrize("text", ["", "{", "\x00"])
def test_broken_json_is_told(tmp_path, text):
    (tmp_path / MANIFEST_NAME).write_text(text)
    with pytest.raises(BadInput, match="no readable JSON"):
        read_manifest(tmp_path)


@pytest.mark.parametrize("text", ["[]", "{}", '{"format": "else"}'])
def test_json_of_another_kind_is_told(tmp_path, text):
    (tmp_path / MANIFEST_NAME).write_text(text)
    with pytest.raises(BadInput, match="no manifest of a dataset"):
        read_manifest(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(layout=2), "has layout 2; allowed: layout 1; update saf_gen"),
        (lambda d: d.update(sequences=3), "sequences is no list"),
        (lambda d: d.update(nmae="x"), "unknown key 'nmae'.*did you mean 'name'"),
        (lambda d: d.pop("variant"), "variant is missing"),
        (lambda d: d["sequences"].append(3), "sequence 2: 3 is no mapping"),
        (lambda d: d["sequences"][0].pop("seed"), "sequence 0: seed is missing"),
        (lambda d: d["sequences"][0].update(frames="7"), "frames is '7'; allowed: a whole number"),
        (lambda d: d["sequences"][0].update(frames=True), "frames is True; allowed: a whole number"),
        (lambda d: d["sequences"][0].update(id="a-2"), "the id 'a-2' stands twice"),
        (lambda d: d["sequences"][0].update(file="../x.h5"), "inside the dataset folder"),
        (lambda d: d["sequences"][0].update(file="/x.h5"), "inside the dataset folder"),
    ],
)
def test_a_wrong_manifest_is_refused_in_one_line(tmp_path, change, message):
    with pytest.raises(BadInput, match=message) as caught:
        changed(tmp_path, change)
    assert "\n" not in str(caught.value)


def test_a_manifest_that_points_outside_is_not_written(tmp_path):
    with pytest.raises(BadInput, match="inside the dataset folder"):
        write_manifest(tmp_path, replace(MANIFEST_, sequences=(replace(ENTRY, file="/etc/x"),)))
    assert not list(tmp_path.iterdir())


def test_a_failed_write_keeps_the_old_text_and_leaves_nothing(tmp_path):
    write_text_atomically(tmp_path / "a.txt", "old")
    with pytest.raises(UnicodeEncodeError):
        write_text_atomically(tmp_path / "a.txt", "new \ud800")
    assert (tmp_path / "a.txt").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match=r"cannot be written: (Not a directory|File exists)"):
        write_text_atomically(tmp_path / "file" / "a.txt", "x")


def test_an_entry_is_verified_against_its_stream(tmp_path):
    digest = write_stream(tmp_path / "a.h5", np.eye(7)[:, None])
    whole = replace(ENTRY, file="a.h5", frames=7, content_sha256=digest)
    verify_entry(tmp_path, whole)
    for wrong in (replace(whole, frames=8), replace(whole, content_sha256="0" * 64)):
        with pytest.raises(BadInput, match=r"holds 7 frames with .* as in manifest\.json; make it again"):
            verify_entry(tmp_path, wrong)
    with pytest.raises(BadInput, match="there is no such file"):
        verify_entry(tmp_path, replace(whole, file="none.h5"))
