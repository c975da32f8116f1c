"""``index.json`` of a packed dataset: its shards, the files in them, and the size and SHA-256 of each."""

import json
import re
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field

from saf_gen.core.config.document import STRICT, Document, validate_document
from saf_gen.core.config.json_document import parse_json
from saf_gen.core.files import write_text
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import MANIFEST_NAME

INDEX_NAME = "index.json"
FORMAT = "saf-gen shards"
LAYOUT = 1
MAX_INDEX_BYTES = 1 << 26
"""Largest size of an index, enough for about 300,000 streams; reading the index takes a dozen times as much memory."""

Bytes = Annotated[int, Field(strict=True, ge=0, le=1 << 60)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


@dataclass(frozen=True)
class PackedFile:
    """A file of a packed dataset: its path in the dataset folder (parts joined by '/'), its size and its SHA-256."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    file: str
    bytes: Bytes
    sha256: Digest


@dataclass(frozen=True)
class Shard:
    """A tar file that contains files of the dataset; it is in the folder of the index."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    file: str
    bytes: Bytes
    sha256: Digest
    members: tuple[PackedFile, ...]


@dataclass(frozen=True)
class ShardIndex:
    """A packed dataset: its name, its shards, and the unpacked files in the folder of the index."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    name: str
    shards: tuple[Shard, ...]
    files: tuple[PackedFile, ...]

    @property
    def total_bytes(self) -> int:
        """Total number of bytes of all shards and files."""
        return sum(one.bytes for one in self.shards) + sum(one.bytes for one in self.files)


def write_shard_index(folder: Path, index: ShardIndex) -> None:
    """Write the index of a packed dataset into its folder."""
    document = {"format": FORMAT, "layout": LAYOUT, **asdict(index)}
    write_text(folder / INDEX_NAME, json.dumps(document, indent=1, ensure_ascii=False) + "\n")


def parse_shard_index(text: str, where: str) -> ShardIndex:
    """Return the index in a JSON text; ``where`` is its name in errors.

    Raises BadInput if the text is not an index, has another layout version, lists a file twice or outside the folder,
    or lacks the manifest.
    """
    document = parse_json(text, where)
    if not isinstance(document.data, dict) or document.data.pop("format", None) != FORMAT:
        raise BadInput("is not the index of a packed dataset", where=where, allowed=f'"format": "{FORMAT}"')
    if (layout := document.data.pop("layout", None)) != LAYOUT:
        raise BadInput(f"has layout {layout}", where=where, allowed=f"layout {LAYOUT}", hint="update saf_gen")
    index = validate_document(ShardIndex, document)
    _check_names(index, document)
    return index


def _check_names(index: ShardIndex, document: Document) -> None:
    where = document.locate()
    if not re.fullmatch(r"\w[\w. -]{0,99}", index.name):
        raise BadInput(
            f"the dataset's name is {index.name!r}", where=where, allowed="letters, digits, _, -, . and spaces"
        )
    outer_names = [*(one.file for one in index.shards), *(one.file for one in index.files)]
    member_names = [member.file for shard in index.shards for member in shard.members]
    for name in outer_names:
        if not is_plain_path(name) or "/" in name or name == INDEX_NAME:
            raise BadInput(
                f"has the file {name!r}", where=where, allowed="the name of a file in the folder of the index"
            )
    for name in member_names:
        if not is_plain_path(name):
            raise BadInput(f"has the member {name!r}", where=where, allowed="a relative path with '/', without ..")
    unpacked = Counter(name.casefold() for name in (*member_names, *(one.file for one in index.files)))
    for name, count in (unpacked + Counter(one.file.casefold() for one in index.shards)).items():
        if count > 1:
            raise BadInput(f"names {name!r} {count} times", where=where, allowed="each file once")
    if MANIFEST_NAME not in [one.file for one in index.files]:
        raise BadInput(f"has no {MANIFEST_NAME}", where=where, hint="pack the dataset again")


def is_plain_path(name: str) -> bool:
    """Return whether a name is a relative path, without hidden parts, that means the same on every system."""
    parts = PurePosixPath(name).parts
    plain = all(re.fullmatch(r"[^\x00-\x1f\\:*?\"<>|/]{1,255}", part) and not part.startswith(".") for part in parts)
    return bool(parts) and plain and "/".join(parts) == name
