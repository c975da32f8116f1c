"""Transfers of files between a disk and an object store, each checked, and removal of interrupted uploads.

An object becomes visible only when all of it has arrived. If the store uses the MD5 of the content as the ETag (for a
large object, the MD5 of the MD5s of its parts), the ETag shows that the object is intact. Other stores, and stores that
encrypt with their own keys, use other ETags; the object is then read back and compared.
"""

import hashlib
from collections.abc import Container
from datetime import UTC, datetime, timedelta
from pathlib import Path

from saf_gen.core.files import ABANDONED_S, atomic_file, temporary_name
from saf_gen.core.object_store import LARGEST_RANGE, StorePath
from saf_gen.errors import BadInput

PART_BYTES = 50 << 20
"""Size of a part, in bytes; an object of at least twice this size is uploaded in parts."""


def check_store(folder: StorePath) -> None:
    """Raise BadInput unless a small object can be written to a folder, read back and deleted."""
    if folder.is_file():
        raise BadInput("this is an object", where=str(folder), allowed="a folder")
    probe = folder / temporary_name(Path("probe")).name
    with probe.report_problems():
        files = probe.file_system()
        files.pipe_file(probe.key, b"probe")
        returned = files.cat_file(probe.key)
        files.rm_file(probe.key)
    if returned != b"probe":
        raise BadInput("the store does not return what was written to it", where=str(folder))


def list_objects(folder: StorePath) -> set[str]:
    """Return the names of all objects in a folder and its subfolders, relative to the folder."""
    with folder.report_problems():
        found = folder.file_system().find(folder.key) if folder.is_dir() else []
    return {key.strip("/").removeprefix(f"{folder.key}/") for key in found}


def upload_file(file: Path, target: StorePath) -> None:
    """Write a file to an object and check that the content of the object is the same.

    Raises BadInput if the object cannot be written or if its content differs, in which case it is deleted.
    """
    with target.report_problems():
        files = target.file_system()
        files.put_file(str(file), target.key, **({"chunksize": PART_BYTES} if target.scheme == "s3" else {}))
        facts = files.info(target.key)
        size = file.stat().st_size
        if facts["size"] == size and (
            facts.get("ETag", "").strip('"') in _etags(file) or _has_same_content(file, target)
        ):
            return
        files.rm_file(target.key)
    raise BadInput(
        "the object differs from the uploaded file and was deleted",
        where=str(target),
        hint="run the same command again",
    )


def download_file(source: StorePath, file: Path) -> None:
    """Download an object to a file, completely or not at all; raise BadInput if the object cannot be read."""
    with atomic_file(file) as part, source.report_problems():
        source.file_system().get_file(source.key, str(part))


def _etags(file: Path) -> set[str]:
    """Return the ETags that a store may give to this content, uploaded at once or in parts."""
    full, parts = hashlib.md5(usedforsecurity=False), []
    with file.open("rb") as opened:
        while part := opened.read(PART_BYTES):
            full.update(part)
            parts.append(hashlib.md5(part, usedforsecurity=False).digest())
    return {full.hexdigest(), f"{hashlib.md5(b''.join(parts), usedforsecurity=False).hexdigest()}-{len(parts)}"}


def _has_same_content(file: Path, target: StorePath) -> bool:
    with file.open("rb") as local, target.open() as remote:
        while block := local.read(LARGEST_RANGE):
            if remote.read(len(block)) != block:
                return False
        return not remote.read(1)


def abort_uploads(folder: StorePath, *, own_names: Container[str]) -> tuple[int, int]:
    """Abort uploads in parts that a killed run left below a folder, because a store keeps and charges for the parts.

    ``own_names`` are the names of the objects that only this run writes; uploads of other objects are aborted after a
    day. Returns the number of aborted and the number of remaining uploads.
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
            if key.removeprefix(f"{name}/") in own_names or upload["Initiated"] < before:
                files.call_s3("abort_multipart_upload", Bucket=folder.bucket, Key=key, UploadId=upload["UploadId"])
                aborted += 1
            else:
                left += 1
    return aborted, left
