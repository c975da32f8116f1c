"""The manifest: a round trip, and a clear error of one line for everything that can be wrong with it."""

import csv
import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from refusals import assert_says, refusal

from saf_gen.stream.manifest import (
    MANIFEST_NAME,
    TABLE_NAME,
    Manifest,
    SequenceEntry,
    read_manifest,
    stem_of,
    verify_entry,
    write_manifest,
)
from saf_gen.stream.stream_writer import write_stream

ENTRY = SequenceEntry(
    "a-1", "test", "usaf_target", 0, "static", "sweep", "constant", 0, 2**62, "test/a-1.h5", 20_000,
    "f00", "c0ffee"
)  # fmt: skip
MANIFEST_ = Manifest("tiny", "abc", "llvm", (ENTRY, replace(ENTRY, id="a-2", split="train", file="train/a-2.h5")))


def changed(folder, change):
    """Write the manifest, change its document, and read it again."""
    write_manifest(folder, MANIFEST_)
    document = json.loads((folder / MANIFEST_NAME).read_text())
    del document["checksum"]  # as after an edit by hand
    change(document)
    (folder / MANIFEST_NAME).write_text(json.dumps(document))
    return read_manifest(folder)


def test_a_manifest_comes_back_as_it_was_written(tmp_path):
    write_manifest(tmp_path / "new", MANIFEST_)
    assert read_manifest(tmp_path / "new") == MANIFEST_
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == [MANIFEST_NAME, TABLE_NAME]
    rows = list(csv.DictReader((tmp_path / "new" / TABLE_NAME).read_text(encoding="utf-8").splitlines()))
    assert rows == [{key: str(value) for key, value in asdict(entry).items()} for entry in MANIFEST_.sequences]


def test_a_flipped_bit_is_found_and_an_older_manifest_is_read(tmp_path):
    write_manifest(tmp_path, Manifest("tiny", "abc", "llvm", (ENTRY,)))
    path, content = tmp_path / MANIFEST_NAME, (tmp_path / MANIFEST_NAME).read_bytes()
    for at in range(0, len(content), 11):  # each bit of a byte in turn
        path.write_bytes(content[:at] + bytes([content[at] ^ 1 << at % 8]) + content[at + 1 :])
        assert str(path) in str(refusal(read_manifest, tmp_path))
    path.write_text(content.decode().replace("llvm", "cuda"))
    error = refusal(read_manifest, tmp_path)
    assert error.problem.startswith("this was changed after it was written")
    assert "run saf-gen generate again, or remove the key checksum" in error.hint
    before = json.loads(content)
    del before["checksum"]
    path.write_text(json.dumps(before))
    assert read_manifest(tmp_path).sequences == (ENTRY,)


def test_a_folder_without_a_manifest_is_not_a_dataset(tmp_path):
    error = refusal(read_manifest, tmp_path)
    assert (error.where, error.hint) == (str(tmp_path), "make the dataset with saf-gen generate")
    (tmp_path / "x").write_text("")
    assert refusal(read_manifest, tmp_path / "x").allowed == "a dataset folder"
    (tmp_path / "paper_small").mkdir()
    assert refusal(read_manifest, tmp_path / "paper_smal").nearest == "paper_small"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "not JSON"),
        ("\x00", "not JSON"),
        ("[]", "not the manifest of a dataset"),
        ('{"format": "else"}', "not the manifest of a dataset"),
    ],
)
def test_a_file_that_is_not_a_manifest_is_refused(tmp_path, text, problem):
    (tmp_path / MANIFEST_NAME).write_text(text)
    error = refusal(read_manifest, tmp_path)
    assert problem in error.problem
    assert error.where.startswith(str(tmp_path / MANIFEST_NAME))


@pytest.mark.parametrize(
    ("change", "fragments"),
    [
        (lambda d: d.update(layout=2), ["has layout 2", "layout 1", "update saf_gen"]),
        (lambda d: d.update(sequences=3), ["sequences is 3"]),
        (lambda d: d.pop("sequences"), ["'sequences' is missing"]),
        (lambda d: d.update(nmae="x"), ["unknown key 'nmae'", "did you mean 'name'"]),
        (lambda d: d["sequences"].append(3), ["sequences.2 is 3", "a mapping with the keys"]),
        (lambda d: d["sequences"][0].pop("seed"), ["'sequences.0.seed' is missing"]),
        (lambda d: d["sequences"][0].update(frames="7"), ["sequences.0.frames is '7'", "integer"]),
        (lambda d: d["sequences"][0].update(frames=True), ["sequences.0.frames is True", "integer"]),
        (lambda d: d["sequences"][0].update(id="a-2"), ["'a-2'", "each id once"]),
        (lambda d: d["sequences"][0].update(file="../x.h5"), ["inside the dataset folder"]),
        (lambda d: d["sequences"][0].update(file="/x.h5"), ["inside the dataset folder"]),
    ],
)
def test_a_wrong_manifest_is_refused_in_one_line(tmp_path, change, fragments):
    assert_says(refusal(changed, tmp_path, change), " | ".join([MANIFEST_NAME, *fragments]))


def test_a_manifest_that_points_outside_is_not_written(tmp_path):
    outside = replace(MANIFEST_, sequences=(replace(ENTRY, file="/etc/x"),))
    assert "inside the dataset folder" in refusal(write_manifest, tmp_path, outside).allowed
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("wrong", [{"id": "../../x"}, {"id": ""}, {"id": "a/b"}, {"split": ".."}, {"split": "a\\b"}])
def test_a_sequence_whose_names_are_paths_names_no_file(wrong):
    assert stem_of(replace(ENTRY, id="b", split="test"), where="m") == "test/b"
    assert "a name without /" in refusal(stem_of, replace(ENTRY, **wrong), where="m").allowed


@pytest.mark.slow
def test_an_entry_is_verified_against_its_stream(tmp_path):
    digest = write_stream(tmp_path / "a.h5", np.eye(7)[:, None])
    entry = replace(ENTRY, file="a.h5", frames=7, content_sha256=digest)
    verify_entry(tmp_path, entry)
    for wrong in (replace(entry, frames=8), replace(entry, content_sha256="0" * 64)):
        error = refusal(verify_entry, tmp_path, wrong)
        assert error.problem.startswith("holds 7 frames")
        assert MANIFEST_NAME in error.allowed
    assert "no such file" in refusal(verify_entry, tmp_path, replace(entry, file="none.h5")).problem
