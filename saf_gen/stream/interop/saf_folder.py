"""Import and export of recordings in the folders of SAF (Su et al., CVPR 2024), which their programs read.

``config.xlsx`` lists the recordings; each is a file of raw frames.
"""

import json
import re
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from warnings import catch_warnings

import numpy as np

from saf_gen.core.files import name_as_text, rename_durably, temporary_folder
from saf_gen.errors import BadInput
from saf_gen.stream.interop.array_files import DAMAGE, check_packing
from saf_gen.stream.interop.raw_frames import RAW_LAYOUTS, count_raw_frames, export_raw_frames, import_raw_frames
from saf_gen.stream.manifest import read_manifest, stem_of
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_file import SpikeStream, check_replaceable, open_stream

CONFIG = "config.xlsx"
COLUMNS = ("id", "scene name", "frames", "focal frame", "dt", "path")
LAYOUT = "416"
UNEVEN = "the lens does not move evenly from 0 to 1"
MAX_SHEET_BYTES, MAX_SHEET_ROWS = 8 << 20, 10_000
"""Largest parts of the spreadsheet after decompression, all together, and most rows of its first sheet."""


@dataclass(frozen=True)
class SafRecording:
    """A recording of SAF as listed in ``config.xlsx``.

    Attributes
    ----------
    name : str
        Name of the stream to write.
    file : Path
        File of raw frames.
    frames : int
        Number of frames.
    focal_frame : int
        The frame that is in focus, counted from 0.
    block : int or None
        Frames per block in which SAF's programs score the recording, its ``dt``; None if the list does not state it.
    """

    name: str
    file: Path
    frames: int
    focal_frame: int
    block: int | None


def read_saf_config(folder: str | Path) -> list[SafRecording]:
    """Return the recordings that ``config.xlsx`` in a folder lists; its columns are COLUMNS, in this order.

    Paths are relative to the folder or to its parent, in which SAF's programs run. If the folder has another name than
    these programs expect, the first part of a path such as ``./datasets/a.dat`` is ignored. The focal frame counts
    from 1, like the frames that these programs print.

    Raises BadInput, naming the row, if a number in a row is invalid, or if its file is missing, too short or outside
    both folders; and if the table has no rows, names a recording twice, or lists a file twice with the same numbers.
    """
    root = Path(folder)
    if not (root / CONFIG).is_file():
        raise BadInput(
            f"this is a folder without {CONFIG}",
            where=str(folder),
            allowed="a file of raw frames, an array file, or SAF's folder of recordings",
        )
    table = _read_sheet(root / CONFIG)
    rows = [(number, row) for number, row in enumerate(table, start=1) if any(cell.strip() for cell in row)]
    if rows and not _is_whole_number(rows[0][1][2] if len(rows[0][1]) > 2 else ""):
        rows = rows[1:]  # the heading
    if not rows:
        raise BadInput("lists no recording", where=str(root / CONFIG), allowed=", ".join(COLUMNS))
    found: dict[tuple[Path, int, int, int | None], SafRecording] = {}
    names = set()
    for number, row in rows:
        recording, where = _read_recording(row, root=root, where=f"{root / CONFIG}:{number}"), str(root / CONFIG)
        what = (recording.file.resolve(), recording.frames, recording.focal_frame, recording.block)
        if recording.name in names:
            raise BadInput(f"lists {recording.name!r} twice", where=where, allowed="a different id for each recording")
        if (before := found.setdefault(what, recording)) is not recording:
            raise BadInput(
                f"lists {name_as_text(recording.file.name)} twice, as {before.name!r} and {recording.name!r}",
                where=where,
                allowed="rows that differ in more than their id and name",
            )
        names.add(recording.name)
    return list(found.values())


def _read_sheet(path: Path) -> list[list[str]]:
    """Return the first columns of the first sheet as text; an empty cell is ''."""
    from openpyxl import load_workbook

    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(check_packing(member).file_size for member in archive.infolist())
        if size > MAX_SHEET_BYTES:
            raise ValueError(f"it unpacks to {size:,} bytes; allowed: {MAX_SHEET_BYTES:,}")
        with catch_warnings(action="ignore"):  # of styles and other things that are not read
            book = load_workbook(path, read_only=True, data_only=True, keep_links=False)
            cells = book.worksheets[0].iter_rows(
                min_col=1, max_col=len(COLUMNS), max_row=MAX_SHEET_ROWS + 1, values_only=True
            )
            rows = [["" if cell is None else str(cell) for cell in row] for row in cells]
            book.close()
        if len(rows) > MAX_SHEET_ROWS:
            raise ValueError(f"it has more than {MAX_SHEET_ROWS:,} rows")
    except DAMAGE as error:
        raise BadInput(f"cannot be read: {error}", where=str(path), allowed="a spreadsheet (.xlsx)") from error
    return rows


def _is_whole_number(text: str) -> bool:
    try:
        return float(text).is_integer() and float(text) >= 0
    except ValueError:
        return False


def _read_recording(row: list[str], *, root: Path, where: str) -> SafRecording:
    cells = dict(zip(COLUMNS, (cell.strip() for cell in [*row, *[""] * len(COLUMNS)]), strict=False))
    for column in ("frames", "focal frame"):
        if not _is_whole_number(cells[column]) or float(cells[column]) < 1:
            raise BadInput(f"{column} is {cells[column]!r}", where=where, allowed="a whole number, at least 1")
    frames, focal = int(float(cells["frames"])), int(float(cells["focal frame"]))
    if focal > frames:
        raise BadInput(f"focal frame is {focal}", where=where, allowed=f"1 to {frames}")
    inside = Path(*PureWindowsPath(cells["path"]).parts)  # either kind of slash
    tried = [root / inside, root.parent / inside, root / Path(*inside.parts[1:])]
    bases = [root.resolve(), root.resolve().parent, root.resolve()]
    existing = [f for f, base in zip(tried, bases, strict=True) if f.is_file() and f.resolve().is_relative_to(base)]
    if not existing:
        raise BadInput(f"path is {cells['path']!r}", where=where, allowed=f"a file in {root}, or in its parent folder")
    file = existing[0]
    number = f"{int(float(cells['id'])):02}" if _is_whole_number(cells["id"]) else cells["id"]
    name = re.sub(r"[^\w.-]+", "_", f"{cells['scene name'] or file.stem}-recorded-{number}")
    count_raw_frames(file, RAW_LAYOUTS[LAYOUT], frames=frames)
    dt = cells["dt"]
    block = int(float(dt)) if _is_whole_number(dt) and 1 <= float(dt) <= frames else None
    return SafRecording(name, file, frames, focal - 1, block)


def import_saf_folder(folder: str | Path, out: str | Path, *, readout_hz: float = 20_000) -> Iterator[Path]:
    """Write each recording of a folder as a stream below ``out``, and yield its path.

    The list states the frame in focus but no positions of the lens. The lens is assumed to move evenly from 0 to 1, so
    that answers can be judged; the true position follows from this, and the depth of focus is unknown. A stream that
    exists already and is newer than the list and its raw file is kept.
    """
    for recording in read_saf_config(folder):
        lens = ((np.arange(recording.frames) + 0.5) / recording.frames).astype(np.float32)
        target = Path(out) / f"{recording.name}.h5"
        if not _is_imported(target, recording, newer_than=Path(folder) / CONFIG, readout_hz=readout_hz):
            check_replaceable(target)
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
    """Return whether a file is the stream of a recording and newer than the list and the raw file."""
    sources = (recording.file, newer_than)
    if not target.is_file() or target.stat().st_mtime <= max(source.stat().st_mtime for source in sources):
        return False
    try:
        with open_stream(target) as stream:
            made = (stream.shape[0], stream.readout_hz, stream.truth.frame)
            origin = json.loads(stream.metadata.provenance.get("import", "{}"))
    except (BadInput, ValueError):
        return False
    if not isinstance(origin, dict):  # anybody may have written the stream
        return False
    is_same = made == (recording.frames, readout_hz, recording.focal_frame)
    return is_same and origin.get("file") == name_as_text(recording.file.name)


def export_saf_folder(dataset: str | Path, out: str | Path, *, dt: int = 100) -> tuple[int, list[str]]:
    """Write the sequences of a dataset as a new folder that SAF's programs read: ``config.xlsx`` and raw frames.

    The list states the true focus as a whole frame, counted from 1. It has no lens positions, so a last column notes
    the sequences whose lens does not move evenly from 0 to 1. Light, target and depth of focus are not in it either.

    Parameters
    ----------
    dataset : str or Path
        Dataset folder.
    out : str or Path
        Folder to write, which does not exist. SAF's programs run in its parent folder.
    dt : int, default 100
        Frames per block in which SAF's programs score the recordings.

    Returns
    -------
    tuple of (int, list of str)
        Number of sequences, and the ids of those whose lens does not move evenly from 0 to 1.

    Raises
    ------
    BadInput
        Before anything is written: if ``out`` exists, if a sequence has not 250 × 400 pixels, holds no spikes, has
        fewer frames than ``dt``, or has no frame at which the lens passes the focus.
    """
    from openpyxl import Workbook

    root, folder = Path(dataset), Path(out)
    if folder.exists():
        raise BadInput(f"{folder} exists", allowed="a new folder", hint="choose another name, or remove it")
    files, uneven, book = {}, [], Workbook()
    book.active.append((*COLUMNS, "note"))
    for number, entry in enumerate(read_manifest(root).sequences, start=1):
        name = f"{stem_of(entry, where=str(root))}.dat"
        files[name] = root / entry.file
        with open_stream(files[name]) as stream:
            focal = _check_exportable(stream, dt)
            note = "" if _moves_evenly(stream) else UNEVEN
            book.active.append(
                (number, entry.id, stream.shape[0], focal, dt, f"./{folder.resolve().name}/{name}", note)
            )
        uneven += [entry.id] if note else []
    with temporary_folder(folder) as part:
        for name, source in files.items():
            export_raw_frames(source, part / name, layout=LAYOUT)
        book.save(part / CONFIG)
        rename_durably(part, folder)
    return len(files), uneven


def _check_exportable(stream: SpikeStream, dt: int) -> int:
    """Return the frame of the true focus, counted from 1; raise BadInput if SAF's programs cannot read the stream."""
    where, (frames, rows, columns), kind = str(stream.path), stream.shape, RAW_LAYOUTS[LAYOUT]
    if (rows, columns) != (kind.rows, kind.columns):
        raise BadInput(
            f"has {columns}x{rows} pixels",
            where=where,
            allowed=f"{kind.columns}x{kind.rows}, which SAF's programs read",
        )
    if stream.metadata.kind != "spikes":
        raise BadInput(f"holds {stream.metadata.kind}", where=where, allowed="spikes")
    if not 1 <= dt <= frames:
        raise BadInput(f"dt is {dt}", where=where, allowed=f"1 to {frames}, the frames of the recording")
    if not np.isfinite(stream.truth.frame):
        raise BadInput("the lens passes no known focus", where=where, allowed="recordings with a frame of true focus")
    return min(max(int(np.floor(stream.truth.frame + 1.5)), 1), frames)


def _moves_evenly(stream: SpikeStream) -> bool:
    frames, lens = stream.shape[0], stream.focus_position
    even = (np.arange(frames) + 0.5) / frames
    return lens is not None and bool(np.abs(np.asarray(lens) - even).max() <= 1e-3 + 0.5 / frames)
