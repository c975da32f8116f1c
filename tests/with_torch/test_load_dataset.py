"""The table of a dataset's sequences, loaded by the library of the Hugging Face Hub, the package datasets."""

import shutil
from dataclasses import replace

import pytest

import saf_gen
from saf_gen.stream.manifest import read_manifest, write_manifest
from saf_gen.stream.sharing.croissant import front_matter


def test_the_card_leads_to_the_sequences_and_their_rows_to_recordings(tmp_path, monkeypatch):
    pytest.importorskip("huggingface_hub", reason="the package datasets is not installed")
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "cache"))
    from datasets import load_dataset

    folder = tmp_path / "sample"
    shutil.copytree(saf_gen.sample(), folder)
    manifest = read_manifest(folder)
    first, *others = manifest.sequences
    write_manifest(folder, replace(manifest, sequences=(replace(first, split="train", seed=2**63 - 1), *others)))
    (folder / "README.md").write_text(front_matter(manifest, ["MIT"]))

    rows = load_dataset(str(folder), split="sequences")
    assert [(row["id"], row["split"], row["seed"]) for row in rows] == [
        (entry.id, entry.split, entry.seed) for entry in read_manifest(folder).sequences
    ]
    for row in rows:
        with saf_gen.open_stream(folder / row["file"]) as stream:
            assert (stream.shape[0], stream.content_sha256) == (row["frames"], row["content_sha256"])
