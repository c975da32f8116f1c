"""Records as they are kept beside the pages of results: without traces, in columns, in one file ``.xz``.

    python -m studies.ranking.packed_records EVALUATION/records.jsonl NAME-records.xz
    python -m studies.ranking.packed_records NAME-records.xz records.jsonl

The second command writes the records again as ``saf-gen`` reads them, each value as it was, but with empty traces.
A file begins with one line of JSON: the format of a record, the columns without fractions, and the names of the
others. These follow as 64 bits a value, one column after the other, with NaN for None. In a column of ``FOLLOWING``
stand the bits in which it differs from what follows from other columns; nearly all of them are 0 and take no space.
"""

import argparse
import json
import lzma
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from saf_gen.benchmark.records import RECORD_FORMAT, Record, read_records, write_records
from saf_gen.core.files import atomic_file
from saf_gen.errors import BadInput

FILTER = {"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 0, "lp": 3, "pb": 3}
"""The filter for repeated values of eight bytes."""
DOF = "depth_of_focus"
"""A column that records do not have: the depth of focus of the sequence, as a fraction of the travel."""
Columns = dict[str, np.ndarray]
FOLLOWING: Mapping[str, Callable[[Columns], np.ndarray]] = {
    "error": lambda of: of["position"] - of["truth"],
    "error_frames": lambda of: of["frame"] - of["truth_frame"],
    "error_dof": lambda of: of["error"] / of[DOF],
    "blur_px": lambda of: 2 * np.abs(of["error_dof"]),
    "error_optimum_dof": lambda of: (of["position"] - of["optimum"]) / of[DOF],
}
"""What follows from other columns, among them those before it here."""


def write_packed_records(path: Path, records: Sequence[Record]) -> None:
    """Write a packed file, completely or not at all."""
    values = {f.name: [getattr(record, f.name) for record in records] for f in fields(Record) if f.name != "trace"}
    numbers = {
        name: np.array([np.nan if value is None else value for value in column], float)
        for name, column in values.items()
        if all(value is None or isinstance(value, float) for value in column)
    }
    columns = {DOF: _depths_of_focus(records, numbers), **numbers}
    order = [name for name in columns if name not in FOLLOWING] + list(FOLLOWING)
    head = {
        "format": RECORD_FORMAT,
        "numbers": order,
        "others": {name: column for name, column in values.items() if name not in numbers},
    }
    line = json.dumps(head, separators=(",", ":")).encode() + b"\n"
    bits = b"".join(_bits(name, columns).tobytes() for name in order)
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
    stored = np.frombuffer(bits, "<u8").reshape(len(head["numbers"]), -1)
    columns: Columns = {}
    for name, column in zip(head["numbers"], stored, strict=True):
        columns[name] = (column ^ _follows(name, columns)).view("<f8")
    del columns[DOF]
    values = {
        name: [None if value != value else value for value in column.tolist()] for name, column in columns.items()
    }
    named = values | head["others"]
    return [Record(trace=(), **dict(zip(named, row, strict=True))) for row in zip(*named.values(), strict=True)]


def _bits(name: str, columns: Columns) -> np.ndarray:
    return columns[name].astype("<f8").view("<u8") ^ _follows(name, columns)


def _follows(name: str, columns: Columns) -> np.ndarray | int:
    """Return the bits of what follows for a column, 0 if nothing does."""
    if name not in FOLLOWING:
        return 0
    value = FOLLOWING[name](columns)
    return np.where(np.isnan(value), np.nan, value).astype("<f8").view("<u8")  # one NaN on all processors


def _depths_of_focus(records: Sequence[Record], numbers: Columns) -> np.ndarray:
    """Return the depth of focus of each record: that of its sequence's largest error, as that is the least rounded."""
    widest: dict[tuple[str, str | None], tuple[float, float]] = {}
    keys = [(record.sequence, record.sensor) for record in records]
    for key, error, in_dof in zip(keys, numbers["error"], numbers["error_dof"], strict=True):
        if in_dof and abs(in_dof) > widest.get(key, (0.0, 0.0))[0]:
            widest[key] = abs(in_dof), error / in_dof
    return np.array([widest.get(key, (0.0, np.nan))[1] for key in keys])


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
