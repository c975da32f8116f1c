"""Records as they are kept beside the pages of results: without traces, in columns, in one file ``.xz``.

    python -m studies.ranking.packed_records EVALUATION/records.jsonl NAME-records.xz
    python -m studies.ranking.packed_records NAME-records.xz records.jsonl

The second command writes the records again as ``saf-gen`` reads them, each value as it was, but with empty traces.
A file begins with one line of JSON: the format of a record, the columns without fractions, and the names of the
others. These follow as 64 bits a value, one column after the other, with NaN for None.
"""

import argparse
import json
import lzma
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.benchmark.records import PARTS, RECORD_FORMAT, Record, read_records, write_records
from saf_gen.core.files import atomic_file
from saf_gen.errors import BadInput

FILTER = {"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 0, "lp": 3, "pb": 3}
"""The filter for repeated values of eight bytes."""
KEYS = [(number, f.name) for number, part in enumerate(PARTS) for f in fields(part) if f.name != "trace"]
"""The number of a part of a record, and the name of a value in it."""


def write_packed_records(path: Path, records: Sequence[Record]) -> None:
    """Write a packed file, completely or not at all."""
    parts = [(record.who, record.what, record.judgement) for record in records]
    values = {name: [getattr(of[number], name) for of in parts] for number, name in KEYS}
    numbers = {
        name: np.array([np.nan if value is None else value for value in column], "<f8")
        for name, column in values.items()
        if all(value is None or isinstance(value, float) for value in column)
    }
    head = {
        "format": RECORD_FORMAT,
        "numbers": list(numbers),
        "others": {name: column for name, column in values.items() if name not in numbers},
    }
    line = json.dumps(head, separators=(",", ":")).encode() + b"\n"
    bits = b"".join(column.tobytes() for column in numbers.values())
    with atomic_file(path) as part:
        part.write_bytes(lzma.compress(line + bits, filters=[FILTER]))


def read_packed_records(path: Path) -> list[Record]:
    """Return the records of a packed file; raise BadInput if it cannot be read or holds something else."""
    try:
        line, _, bits = lzma.decompress(path.read_bytes()).partition(b"\n")
        head = json.loads(line)
    except (OSError, EOFError, ValueError, lzma.LZMAError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadInput(f"it cannot be read: {reason}", where=str(path), allowed="packed records") from error
    if not isinstance(head, dict) or head.get("format") != RECORD_FORMAT:
        raise BadInput("these are no records of this version", where=str(path), allowed=RECORD_FORMAT)
    stored = np.frombuffer(bits, "<f8").reshape(len(head["numbers"]), -1)
    values = {
        name: [None if value != value else value for value in column.tolist()]
        for name, column in zip(head["numbers"], stored, strict=True)
    } | head["others"]
    records = []
    for row in zip(*(values[name] for _, name in KEYS), strict=True):
        of: list[dict[str, Any]] = [{} for _ in PARTS]
        for (number, name), value in zip(KEYS, row, strict=True):
            of[number][name] = value
        records.append(Record(*(part(**given) for part, given in zip(PARTS, of, strict=True))))
    return records


def main(argv: Sequence[str] | None = None) -> int:
    """Pack or unpack records, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path, help="records.jsonl, or packed records, .xz")
    parser.add_argument("out", type=Path, help="file to write: the other of the two")
    given = parser.parse_args(argv)
    try:
        if given.source.suffix == ".xz":
            write_records(given.out, read_packed_records(given.source))
        else:
            write_packed_records(given.out, read_records(given.source))
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
