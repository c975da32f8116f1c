"""The folder of SAF's own recordings: ``config.xlsx`` lists them, and each is a file of raw frames."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.stream.interop.raw_frames import count_raw_frames, import_raw_frames
from saf_gen.stream.interop.spreadsheet import read_imported_sheet
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_file import open_stream

CONFIG = "config.xlsx"
COLUMNS = ("id", "scene name", "frames", "focal frame", "dt", "path")
LAYOUT = "416"


@dataclass(frozen=True)
class SafRecording:
    """A line of the list: a recording of ``frames`` frames, in focus at ``focal_frame``, counted from 0.

    ``block`` is its ``dt``, the frames per block in which SAF's programs score it; None where the list does not say.
    """

    name: str
    file: Path
    frames: int
    focal_frame: int
    block: int | None


def read_imported_saf_config(folder: str | Path) -> list[SafRecording]:
    """Return the recordings that ``config.xlsx`` of a folder lists; its columns are COLUMNS, in this order.

    Paths are relative to the folder or to the one above it, in which SAF's programs run; where the folder has another
    name than they expect, as ``./datasets/a.dat``, the first part of a path is left out. The focal frame counts from
    1, as the frames that these programs print.

    Raises BadInput for a table without rows, a row that does not fit, and a file that is missing, too short or outside
    both folders; each with its row.
    """
    root = Path(folder)
    if not (root / CONFIG).is_file():
        raise BadInput(
            f"this is a folder without {CONFIG}",
            where=str(folder),
            allowed="a file of raw frames, an array, SAF's folder",
        )
    table = read_imported_sheet(root / CONFIG)
    rows = [(number, row) for number, row in enumerate(table, start=1) if any(cell.strip() for cell in row)]
    if rows and not _is_whole(rows[0][1][2] if len(rows[0][1]) > 2 else ""):
        rows = rows[1:]  # the heading
    if not rows:
        raise BadInput("lists no recording", where=str(root / CONFIG), allowed=", ".join(COLUMNS))
    found = [_read_recording(row, root=root, where=f"{root / CONFIG}:{number}") for number, row in rows]
    names = [recording.name for recording in found]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"lists {name!r} twice", where=str(root / CONFIG), allowed="an id of its own for each")
    return found


def _is_whole(text: str) -> bool:
    try:
        return float(text).is_integer() and float(text) >= 0
    except ValueError:
        return False


def _read_recording(row: list[str], *, root: Path, where: str) -> SafRecording:
    cells = dict(zip(COLUMNS, (cell.strip() for cell in [*row, *[""] * len(COLUMNS)]), strict=False))
    for column in ("frames", "focal frame"):
        if not _is_whole(cells[column]) or float(cells[column]) < 1:
            raise BadInput(f"{column} is {cells[column]!r}", where=where, allowed="a whole number, at least 1")
    frames, focal = int(float(cells["frames"])), int(float(cells["focal frame"]))
    if focal > frames:
        raise BadInput(f"focal frame is {focal}", where=where, allowed=f"1 to {frames}")
    inside = Path(*PureWindowsPath(cells["path"]).parts)  # either kind of slash
    tried = [root / inside, root.parent / inside, root / Path(*inside.parts[1:])]
    bases = [root.resolve(), root.resolve().parent, root.resolve()]
    there = [f for f, base in zip(tried, bases, strict=True) if f.is_file() and f.resolve().is_relative_to(base)]
    if not there:
        raise BadInput(f"path is {cells['path']!r}", where=where, allowed=f"a file in {root}, or beside it")
    file = there[0]
    number = f"{int(float(cells['id'])):02}" if _is_whole(cells["id"]) else cells["id"]
    name = re.sub(r"[^\w.-]+", "_", f"{cells['scene name'] or file.stem}-recorded-{number}")
    count_raw_frames(file, LAYOUT, frames=frames)
    dt = cells["dt"]
    block = int(float(dt)) if _is_whole(dt) and 1 <= float(dt) <= frames else None
    return SafRecording(name, file, frames, focal - 1, block)


def import_saf_folder(
    folder: str | Path, out: str | Path, *, readout_hz: float = 20_000, by_block: bool = False
) -> Iterator[Path]:
    """Write each recording of a folder as a stream below ``out``, and yield its path.

    ``by_block`` writes it into a folder below, ``blocks-DT``: in a dataset, the split of the recordings of this DT.

    The list gives the frame in focus and no lens positions. The lens is taken to move evenly from 0 to 1, so that
    answers can be judged; the true position follows, and the depth of focus is not known. A stream that is there
    already, newer than the list and its raw file, stays as it is.
    """
    for recording in read_imported_saf_config(folder):
        lens = ((np.arange(recording.frames) + 0.5) / recording.frames).astype(np.float32)
        target = Path(out) / (f"blocks-{recording.block}" if by_block else "") / f"{recording.name}.h5"
        if not _is_imported(target, recording, newer_than=Path(folder) / CONFIG, readout_hz=readout_hz):
            import_raw_frames(
                recording.file,
                target,
                layout=LAYOUT,
                frames=recording.frames,
                readout_hz=readout_hz,
                focus_position=lens,
                truth=Truth(float(lens[recording.focal_frame]), frame=float(recording.focal_frame)),
                provenance={"assumed": "the lens moves evenly from 0 to 1; the focal frame was chosen by the authors"},
            )
        yield target


def _is_imported(target: Path, recording: SafRecording, *, newer_than: Path, readout_hz: float) -> bool:
    """Return whether a stream is that of a recording, made since the list and the raw file were."""
    sources = (recording.file, newer_than)
    if not target.is_file() or target.stat().st_mtime <= max(source.stat().st_mtime for source in sources):
        return False
    try:
        with open_stream(target) as stream:
            made = (stream.shape[0], stream.readout_hz, stream.truth.frame)
            origin = json.loads(stream.metadata.provenance.get("import", "{}"))
    except (BadInput, ValueError):
        return False
    is_same = made == (recording.frames, readout_hz, recording.focal_frame)
    return is_same and origin.get("file") == recording.file.name
