"""The machine-readable card of a dataset (Croissant), and the front matter of its page."""

import json
from dataclasses import fields, replace
from hashlib import sha256

import numpy as np
import pytest
import windowed_dataset
import yaml

from saf_gen import write_stream
from saf_gen.stream.dataset import index_folder
from saf_gen.stream.manifest import Manifest, SequenceEntry, write_manifest
from saf_gen.stream.sharing.croissant import (
    SYNTHETIC,
    DatasetFacts,
    croissant_of,
    front_matter,
    read_licences,
    stated_licences,
    write_croissant,
)

ENTRY = replace(windowed_dataset.ENTRY, id="a-constant-00", file="train/a-constant-00.h5", seed=2**63)
MANIFEST = Manifest("my data", "0123", "llvm", (ENTRY, replace(ENTRY, id="b", split="test", file="test/b.h5")))
DIGESTS = {"manifest.json": "0" * 64, "sequences.csv": "1" * 64}
FACTS = DatasetFacts("Recordings.", ["Apache-2.0", "CC-BY-4.0"], responsible=SYNTHETIC)


@pytest.fixture
def card(tmp_path):
    write_manifest(tmp_path, MANIFEST)
    write_croissant(tmp_path, MANIFEST, facts=FACTS)
    return json.loads((tmp_path / "croissant.json").read_text())


def test_the_card_has_the_fields_of_croissant_and_of_its_responsible_part(card):
    assert card["@type"] == "sc:Dataset"
    assert card["conformsTo"] == ["http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0"]
    assert card["name"] == "my-data"
    assert card["license"] == ["https://spdx.org/licenses/Apache-2.0", "https://spdx.org/licenses/CC-BY-4.0"]


def test_files_are_manifest_and_table_with_their_digests_and_the_streams_of_every_split(card, tmp_path):
    *listed, streams = card["distribution"]
    assert [file["contentUrl"] for file in listed] == ["manifest.json", "sequences.csv"]
    for file in listed:
        assert file["sha256"] == sha256((tmp_path / file["contentUrl"]).read_bytes()).hexdigest()
    assert streams["includes"] == ["train/*.h5", "test/*.h5"]
    assert all(any((tmp_path / entry.file).match(one) for one in streams["includes"]) for entry in MANIFEST.sequences)


def test_records_are_the_sequences_of_the_manifest_key_by_key(card, tmp_path):
    splits, sequences = card["recordSet"]
    assert [row["splits/name"] for row in splits["data"]] == ["train", "test"]
    assert [field["name"] for field in sequences["field"]] == [one.name for one in fields(SequenceEntry)]
    (row, _) = json.loads((tmp_path / "manifest.json").read_text())["sequences"]
    for field in sequences["field"]:
        assert field["source"]["extract"]["jsonPath"] == f"$.sequences[*].{field['name']}"
        assert isinstance(row[field["name"]], {"sc:Text": str, "sc:Integer": int}[field["dataType"]])


def test_a_card_that_is_written_again_keeps_its_date(card, tmp_path):
    path = tmp_path / "croissant.json"
    path.write_text(path.read_text().replace(card["datePublished"], "2001-02-03"))
    write_croissant(tmp_path, MANIFEST, facts=FACTS)
    assert json.loads(path.read_text()) == card | {"datePublished": "2001-02-03"}


def test_a_card_that_is_written_again_keeps_what_its_publisher_added(card, tmp_path):
    """A stated licence is that of the scenes; the publisher's stands only where there is none."""
    path, added = tmp_path / "croissant.json", {"url": "https://example.org", "creator": {"name": "Somebody"}}
    path.write_text(json.dumps(card | added | {"license": ["mine"], "description": "mine"}))
    write_croissant(tmp_path, MANIFEST, facts=FACTS)
    assert json.loads(path.read_text()) == card | added
    path.write_text(json.dumps(card | {"license": ["mine"]}))
    write_croissant(tmp_path, MANIFEST, facts=replace(FACTS, licences=[]))
    assert json.loads(path.read_text())["license"] == ["mine"]
    for broken in ("x", "[]", "3"):
        path.write_text(broken)
        write_croissant(tmp_path, MANIFEST, facts=FACTS)
        assert json.loads(path.read_text())["license"] == card["license"]


def test_a_folder_that_is_indexed_has_a_card_that_states_no_licence(tmp_path):
    write_stream(tmp_path / "a.h5", np.zeros((8, 4, 8), np.uint8), readout_hz=20_000)
    manifest = index_folder(tmp_path)
    card = json.loads((tmp_path / "croissant.json").read_text())
    assert [(file["name"], file.get("includes")) for file in card["distribution"]] == [
        ("manifest.json", None), ("sequences.csv", None), ("streams", ["./*.h5"])
    ]  # fmt: skip
    assert "1 sequence" in card["description"]
    assert len(manifest.sequences) == 1
    assert "license" not in card
    assert stated_licences(tmp_path) == []


@pytest.mark.parametrize(
    ("stated", "names"),
    [
        (["https://spdx.org/licenses/MIT", "https://spdx.org/licenses/CC0-1.0"], ["MIT", "CC0-1.0"]),
        ("MIT", ["MIT"]),
        (["a licence of mine"], []),
        (None, []),
    ],
)
def test_the_licences_of_a_card_are_read(tmp_path, stated, names):
    (tmp_path / "croissant.json").write_text(json.dumps({} if stated is None else {"license": stated}))
    assert stated_licences(tmp_path) == names


def test_the_front_matter_leads_to_the_table_of_sequences():
    _, matter, rest = front_matter(MANIFEST, ["CC-BY-4.0"]).split("---\n")
    found = yaml.safe_load(matter)
    assert found["license"] == ["cc-by-4.0"]
    (config,) = found["configs"]
    assert config["data_files"] == [{"split": "sequences", "path": "sequences.csv"}]
    assert rest == ""


@pytest.mark.parametrize(
    ("expressions", "names"),
    [
        (["MIT", "CC-BY-4.0"], ["CC-BY-4.0", "MIT"]),
        (["(MIT OR Apache-2.0) AND CC0-1.0", "MIT"], ["Apache-2.0", "CC0-1.0", "MIT"]),
        (["MIT", ""], []),
        (["free for all"], []),
        ([], []),
    ],
)
def test_the_licence_is_that_of_every_scene_or_unknown(expressions, names):
    assert read_licences(expressions) == names


def test_a_card_without_a_licence_says_that_it_is_unknown():
    assert "license" not in croissant_of(MANIFEST, replace(FACTS, licences=[]), digests=DIGESTS)
    assert 'license: "unknown"\n' in front_matter(MANIFEST, [])


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # from the dependencies of mlcroissant
def test_mlcroissant_accepts_the_card_without_a_word(card, tmp_path, caplog):
    mlcroissant = pytest.importorskip("mlcroissant", reason="pip install mlcroissant (90 MB)")
    facts = replace(FACTS, url="https://example.org", creator="Somebody", published="2026-01-01")
    digests = {file["name"]: file["sha256"] for file in card["distribution"][:2]}
    described = croissant_of(MANIFEST, facts, digests=digests)
    path = tmp_path / "croissant.json"
    path.write_text(json.dumps(described))
    dataset = mlcroissant.Dataset(jsonld=path)
    issues = dataset.metadata.ctx.issues
    assert (issues.errors, issues.warnings) == (set(), set())
    assert not [record for record in caplog.records if record.levelname == "WARNING"]
    rows = list(dataset.records("sequences"))
    assert [row["sequences/id"] for row in rows] == [b"a-constant-00", b"b"]
    assert rows[0]["sequences/seed"] == 2**63
