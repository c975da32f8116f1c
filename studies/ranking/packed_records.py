"""Records as they are kept beside the pages of results: one file, packed by xz."""

import lzma
from pathlib import Path
from tempfile import TemporaryDirectory

from saf_gen.benchmark.records import Record, read_records
from saf_gen.errors import BadInput


def read_packed_records(path: Path) -> list[Record]:
    """Return the records of a file ``.jsonl.xz``; raise BadInput if it cannot be read or holds something else."""
    with TemporaryDirectory() as folder:
        plain = Path(folder, path.stem)
        try:
            plain.write_bytes(lzma.decompress(path.read_bytes()))
        except (OSError, EOFError, lzma.LZMAError) as error:
            reason = getattr(error, "strerror", None) or error
            raise BadInput(f"it cannot be read: {reason}", where=str(path), allowed="records.jsonl.xz") from error
        return read_records(plain)
