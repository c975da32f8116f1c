"""Finished recordings on disk: whether a file has a given fingerprint and is undamaged."""

from pathlib import Path

from saf_gen.errors import BadInput
from saf_gen.stream.stream_file import open_stream


def has_recording(path: Path, fingerprint: str) -> bool:
    """Return whether ``path`` is a stream with this fingerprint; its spikes are not read."""
    return _stored_digest(path, fingerprint, verify=False) is not None


def recording_digest(path: Path, fingerprint: str) -> str | None:
    """Return the content_sha256 of a stream, or None if it has another fingerprint or is missing or damaged.

    All spikes are read.
    """
    return _stored_digest(path, fingerprint, verify=True)


def _stored_digest(path: Path, fingerprint: str, *, verify: bool) -> str | None:
    if not path.is_file():
        return None
    try:
        with open_stream(path) as stream:
            if stream.metadata.provenance.get("fingerprint") != fingerprint:
                return None
            if verify:
                stream.verify()
            return stream.content_sha256
    except BadInput:
        return None
