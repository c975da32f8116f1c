"""Whole files from a disk to an object store and back, each checked; uploads that were broken off are removed.

An object appears when all of it has arrived, never in part. That it is what was sent, its ETag tells where the store
gives the MD5 of what it holds, of the parts of large objects too. Other stores, and those that encrypt with keys of
their own, give another ETag: then the object is read back and compared.
"""

import hashlib
from collections.abc import Container
from datetime import UTC, datetime, timedelta
from pathlib import Path

from saf_gen.core.files import ABANDONED_S, temporary_file_name, write_atomically
from saf_gen.core.object_store import LARGEST_RANGE, StorePath
from saf_gen.errors import BadInput

PART_BYTES = 50 << 20
"""An object of twice as many goes up in parts of so many."""


def check_store_writable(folder: StorePath) -> None:
    """Raise BadInput where no object can be written to a folder, read and deleted; a small one is."""
    if folder.is_file():
        raise BadInput("this is an object", where=str(folder), allowed="a folder")
    probe = folder / temporary_file_name(Path("probe")).name
    with probe.report_problems():
        files = probe.file_system()
        files.pipe_file(probe.key, b"probe")
        there = files.cat_file(probe.key)
        files.rm_file(probe.key)
    if there != b"probe":
        raise BadInput("the store does not give back what is written to it", where=str(folder))


def list_objects(folder: StorePath) -> set[str]:
    """Return the names of all objects below a folder, relative to it."""
    with folder.report_problems():
        found = folder.file_system().find(folder.key) if folder.is_dir() else []
    return {key.strip("/").removeprefix(f"{folder.key}/") for key in found}


def upload_file(file: Path, target: StorePath) -> None:
    """Write a file to an object and check that the object is the same.

    Raises BadInput where it cannot be written, or is not the same; then there is none.
    """
    with target.report_problems():
        files = target.file_system()
        files.put_file(str(file), target.key, **({"chunksize": PART_BYTES} if target.scheme == "s3" else {}))
        facts = files.info(target.key)
        size = file.stat().st_size
        if facts["size"] == size and (
            facts.get("ETag", "").strip('"') in _etags(file) or _reads_the_same(file, target)
        ):
            return
        files.rm_file(target.key)
    raise BadInput("the object is not what was uploaded, and was deleted", where=str(target), hint="run again")


def download_file(source: StorePath, file: Path) -> None:
    """Write an object to a file, whole or not at all; raises BadInput where it cannot be read."""
    with write_atomically(file) as part, source.report_problems():
        source.file_system().get_file(source.key, str(part))


def _etags(file: Path) -> set[str]:
    """Return the ETags that a store may give an object of this content: of one upload, or of one in parts."""
    whole, parts = hashlib.md5(usedforsecurity=False), []
    with file.open("rb") as opened:
        while part := opened.read(PART_BYTES):
            whole.update(part)
            parts.append(hashlib.md5(part, usedforsecurity=False).digest())
    return {whole.hexdigest(), f"{hashlib.md5(b''.join(parts), usedforsecurity=False).hexdigest()}-{len(parts)}"}


def _reads_the_same(file: Path, target: StorePath) -> bool:
    with file.open("rb") as here, target.open() as there:
        while block := here.read(LARGEST_RANGE):
            if there.read(len(block)) != block:
                return False
        return not there.read(1)


def abort_unfinished_uploads(folder: StorePath, *, ours: Container[str]) -> tuple[int, int]:
    """Abort uploads in parts that a killed run has left below a folder, since a store keeps and charges their parts.

    ``ours`` are the objects that this run alone writes; those of others are aborted after a day. Returns how many were
    aborted, and how many are left.
    """
    if folder.scheme != "s3":
        return 0, 0
    name = folder.key.removeprefix(folder.bucket).strip("/")
    before, aborted, left = datetime.now(UTC) - timedelta(seconds=ABANDONED_S), 0, 0
    with folder.report_problems():
        files = folder.file_system()
        listed = files.call_s3("list_multipart_uploads", Bucket=folder.bucket, Prefix=f"{name}/" if name else "")
        for upload in listed.get("Uploads", ()):
            key = upload["Key"]
            if key.removeprefix(f"{name}/") in ours or upload["Initiated"] < before:
                files.call_s3("abort_multipart_upload", Bucket=folder.bucket, Key=key, UploadId=upload["UploadId"])
                aborted += 1
            else:
                left += 1
    return aborted, left
