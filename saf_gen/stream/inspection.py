"""Checks of complete datasets."""

from pathlib import Path

from saf_gen.core.object_store import StorePath
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import read_manifest, verify_manifest_entry


def verify_streams_of_dataset(folder: str | Path | StorePath) -> tuple[int, dict[str, str]]:
    """Read every sequence of a dataset and compare it with the manifest.

    Returns the number of sequences, and the problems of faulty sequences by id. Raises BadInput if the manifest is
    missing or cannot be used.
    """
    manifest = read_manifest(folder)
    problems = {}
    for entry in manifest.sequences:
        try:
            verify_manifest_entry(folder, entry)
        except BadInput as error:
            problems[entry.id] = str(error)
    return len(manifest.sequences), problems
