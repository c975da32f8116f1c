"""The machine-readable card of a dataset, ``croissant.json``, and the front matter of README.md for Hugging Face.

The format is Croissant 1.0 with the responsible-AI vocabulary 1.0
(https://docs.mlcommons.org/croissant/docs/croissant-spec.html; Akhtar et al., NeurIPS 2024,
doi:10.48550/arXiv.2403.19546). The streams are described as HDF5 files, and the sequences of ``manifest.json`` as
records.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from saf_gen.core.config.json_document import read_json
from saf_gen.core.files import file_sha256, write_text
from saf_gen.core.plain_text import escape_markdown
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import MANIFEST_NAME, TABLE_NAME, Manifest, SequenceEntry

CARD_NAME = "croissant.json"
SPECIFICATIONS = ("http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0")
KEYWORDS = ("spike camera", "autofocus", "neuromorphic", "focus measure")
PUBLISHED = ("datePublished", "license", "url", "creator")
"""Keys of the card that only its publisher knows."""
LICENCE = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]*")
CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
SYNTHETIC = {
    "rai:dataCollection": "Rendered and simulated from the recipe that each stream holds; nothing was photographed.",
    "rai:dataCollectionType": "Software Collection",
    "rai:dataCollectionRawData": "Focal stacks in OpenEXR, in the folder stacks of the dataset, if they were kept.",
    "rai:dataPreprocessingProtocol": "None: streams hold every readout of the modelled sensor.",
    "rai:dataAnnotationProtocol": "The true focus is computed from the lens and the target's depth, not chosen by eye.",
    "rai:machineAnnotationTools": "saf_gen",
    "rai:dataUseCases": "Developing, training and comparing autofocus methods for spike cameras.",
    "rai:dataLimitations": "Light, lens and sensor are models. There are few scenes; variants are drawn from families.",
    "rai:dataBiases": "The authors of the scenes chose the subjects; see the list of scenes in the description.",
    "rai:personalSensitiveInformation": "None: no person was recorded.",
    "rai:dataSocialImpact": "None is known, except that cameras may focus better.",
    "rai:dataReleaseMaintenancePlan": "The recipe reproduces the dataset; a changed dataset has another fingerprint.",
}
"""Statements in the responsible-AI vocabulary that hold for every generated dataset."""

PHOTOGRAPHS = SYNTHETIC | {
    "rai:dataCollection": "Pictures of other cameras at steps of the focus, seen by a simulated spike camera.",
    "rai:dataCollectionType": "Secondary Data Analysis",
    "rai:dataPreprocessingProtocol": "Pictures are decoded to light and averaged over the pixels of the sensor.",
    "rai:dataAnnotationProtocol": "The true focus is the mean of the peaks of three focus measures on the pictures.",
    "rai:dataLimitations": "Lens, depth and depth of focus are not known; light and sensor are models.",
    "rai:dataBiases": "Whoever took the pictures chose the subjects; see the list of stacks in the description.",
    "rai:personalSensitiveInformation": "Not known: look at the pictures.",
}
"""Statements for datasets of stacks that were photographed."""

RECORDED = {
    "rai:dataCollection": "Recordings that were brought together in a folder; who made them has not been stated.",
    "rai:dataCollectionType": "Others",
    "rai:dataUseCases": SYNTHETIC["rai:dataUseCases"],
    "rai:personalSensitiveInformation": "Not known: look at the recordings.",
}
"""Statements for recordings that were indexed."""


@dataclass(frozen=True)
class DatasetFacts:
    """Facts in a card that are not in the manifest.

    Parameters
    ----------
    description : str
        Sentences that describe the dataset.
    licences : sequence of str
        SPDX names; empty if they have not been stated.
    url, creator : str, optional
        Where the dataset is published, and who made it; '' if that is not known yet.
    published : str, optional
        Date, YYYY-MM-DD; by default today.
    responsible : mapping of str to str, optional
        Statements in the responsible-AI vocabulary, by key such as "rai:dataBiases".
    """

    description: str
    licences: Sequence[str]
    url: str = ""
    creator: str = ""
    published: str = ""
    responsible: Mapping[str, str] = field(default_factory=dict)


def croissant_of(manifest: Manifest, facts: DatasetFacts, *, digests: Mapping[str, str]) -> dict[str, Any]:
    """Return the Croissant description of a dataset folder, as JSON-LD; ``digests`` are those of manifest and table.

    Raises BadInput if a licence is not an SPDX name.
    """
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", manifest.name).strip("-") or "dataset"
    splits = manifest.splits
    made = f"Recipe {manifest.recipe_fingerprint}" if manifest.recipe_fingerprint else "Recorded"
    title = f"title = {{{name}: spike-camera autofocus data}}"
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": list(SPECIFICATIONS),
        "name": name,
        "description": facts.description,
        **({"license": licence_urls(facts.licences)} if facts.licences else {}),
        **({"url": facts.url} if facts.url else {}),
        **({"creator": {"@type": "sc:Organization", "name": facts.creator}} if facts.creator else {}),
        "datePublished": facts.published or datetime.now(UTC).date().isoformat(),
        "version": "1.0.0",
        "isLiveDataset": False,
        "keywords": list(KEYWORDS),
        "citeAs": f"@misc{{{name}, {title}, note = {{{made}; made with saf\\_gen}}}}",
        **facts.responsible,
        "distribution": [
            _file(MANIFEST_NAME, "application/json", digest=digests[MANIFEST_NAME]),
            _file(TABLE_NAME, "text/csv", digest=digests[TABLE_NAME]),
            _file_set("streams", "application/x-hdf5", includes=[f"{folder}/*.h5" for folder in _folders(manifest)]),
        ],
        "recordSet": [_split_records(splits), _sequence_records()],
    }


def write_croissant(folder: Path, manifest: Manifest, *, facts: DatasetFacts) -> None:
    """Write ``croissant.json`` into a dataset folder next to its manifest, and a ``README.md`` if there is none.

    What an earlier card states of the publication stays: its date, and the licence, address and creator if ``facts``
    have none, because its publisher added them.
    """
    path = folder / CARD_NAME
    digests = {name: file_sha256(folder / name) for name in (MANIFEST_NAME, TABLE_NAME)}
    card = croissant_of(manifest, facts, digests=digests)
    if path.is_file():
        with suppress(BadInput):  # a card that is broken is written anew
            earlier = read_json(path).data
            added = {key: earlier[key] for key in PUBLISHED if key in earlier} if isinstance(earlier, dict) else {}
            card = added | card | {key: added[key] for key in PUBLISHED[:1] if key in added}
    write_text(path, json.dumps(card, indent=1, ensure_ascii=False) + "\n")
    readme = folder / "README.md"
    if not (readme.exists() or readme.is_symlink()):
        title = f"# {escape_markdown(manifest.name)}\n\n{escape_markdown(facts.description)}\n"
        write_text(readme, front_matter(manifest, facts.licences) + title)


def stated_licences(folder: Path) -> list[str]:
    """Return the licences in the card of a dataset folder, as SPDX names; an empty list if it has no card or none."""
    try:
        card = read_json(folder / CARD_NAME).data
    except BadInput:
        return []
    addresses = card.get("license", []) if isinstance(card, dict) else []
    names = [str(address).rpartition("/")[2] for address in (addresses if isinstance(addresses, list) else [addresses])]
    return names if all(LICENCE.fullmatch(name) for name in names) else []


def front_matter(manifest: Manifest, licences: Sequence[str]) -> str:
    """Return the first lines of README.md, which the Hugging Face Hub reads.

    Its library cannot read streams, so the only configuration is the table of all sequences.
    """
    count = len(manifest.sequences)
    sizes = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"))
    matter: dict[str, Any] = {
        "license": [name.lower() for name in licences] or "unknown",
        "pretty_name": manifest.name,
        "tags": [word.replace(" ", "-") for word in KEYWORDS],
        "task_categories": ["other"],
        "annotations_creators": ["machine-generated"],
        "size_categories": [next((name for limit, name in sizes if count < limit), "100K<n<1M")],
    }
    if manifest.sequences:
        matter["configs"] = [{"config_name": "default", "data_files": [{"split": "sequences", "path": TABLE_NAME}]}]
    lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}\n" for key, value in matter.items()]  # JSON is YAML
    return f"---\n{''.join(lines)}---\n"


def read_licences(expressions: Iterable[str]) -> list[str]:
    """Return the names in SPDX expressions such as "MIT AND CC-BY-4.0"; an empty list if one is empty or prose."""
    found: set[str] = set()
    for expression in expressions:
        words = [word.strip("()") for word in expression.split()]
        if not words or not all(LICENCE.fullmatch(word) for word in words):
            return []
        names, joints = words[::2], words[1::2]
        if not set(joints) <= {"AND", "OR", "WITH"}:
            return []
        found |= set(names)
    return sorted(found)


def licence_urls(licences: Iterable[str]) -> list[str]:
    """Return the addresses of SPDX licences; raise BadInput if a name cannot be an SPDX name."""
    for name in licences:
        if not LICENCE.fullmatch(name):
            raise BadInput(f"licence {name!r} is not an SPDX name", allowed="a name such as CC-BY-4.0 or Apache-2.0")
    return [f"https://spdx.org/licenses/{name}" for name in licences]


def _folders(manifest: Manifest) -> list[str]:
    return list(dict.fromkeys(entry.file.rpartition("/")[0] or "." for entry in manifest.sequences)) or ["*"]


def _file(name: str, kind: str, *, digest: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": name,
        "encodingFormat": kind,
        "sha256": digest,
    }


def _file_set(name: str, kind: str, *, includes: list[str]) -> dict[str, Any]:
    return {"@type": "cr:FileSet", "@id": name, "name": name, "encodingFormat": kind, "includes": includes}


def _split_records(splits: Sequence[str]) -> dict[str, Any]:
    return {
        "@type": "cr:RecordSet",
        "@id": "splits",
        "name": "splits",
        "dataType": "cr:Split",
        "key": {"@id": "splits/name"},
        "field": [{"@type": "cr:Field", "@id": "splits/name", "name": "name", "dataType": "sc:Text"}],
        "data": [{"splits/name": split} for split in splits],
    }


def _sequence_records() -> dict[str, Any]:
    found = []
    for one in fields(SequenceEntry):
        entry: dict[str, Any] = {
            "@type": "cr:Field",
            "@id": f"sequences/{one.name}",
            "name": one.name,
            "dataType": "sc:Text" if one.type is str else "sc:Integer",
            "source": {"fileObject": {"@id": MANIFEST_NAME}, "extract": {"jsonPath": f"$.sequences[*].{one.name}"}},
        }
        if one.name == "split":
            entry["references"] = {"field": {"@id": "splits/name"}}
        found.append(entry)
    return {
        "@type": "cr:RecordSet",
        "@id": "sequences",
        "name": "sequences",
        "description": "One row per recording, as listed in manifest.json.",
        "key": {"@id": "sequences/id"},
        "field": found,
    }
