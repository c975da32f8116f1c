"""OpenEXR files of named planes, float32 or float16, with text attributes; nothing else calls OpenEXR."""

from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from saf_gen.errors import BadInput

STORED = {"FLOAT": "<f4", "HALF": "<f2"}


def write_planes(path: Path, planes: Mapping[str, np.ndarray], *, attributes: Mapping[str, str]) -> None:
    """Write planes (row, col) of one shape as channels of a scan-line image, as float16 or else float32.

    The file is not compressed: ZIP saves 1 % of a render and takes nine times as long, and single
    planes could no longer be read alone.
    """
    header: dict[str, object] = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    channels = {
        name: np.ascontiguousarray(plane, dtype=np.float16 if plane.dtype == np.float16 else np.float32)
        for name, plane in planes.items()
    }
    OpenEXR.File(header, channels).write(str(path))


def read_planes(path: Path, names: Iterable[str] | None = None) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Return the planes and the text attributes, by name, of a file that :func:`write_planes` wrote.

    With ``names`` only these planes are read, and little else of the file.

    Raises BadInput for a file that is missing, truncated or not an EXR, and for a missing plane.
    """
    try:
        with closing(OpenEXR.InputFile(str(path))) as file:
            header = file.header()
        rows = _rows(path, header)
        planes = {name: np.array(rows[name]) for name in (header["channels"] if names is None else names)}
        attributes = {key: value.decode() for key, value in header.items() if isinstance(value, bytes)}
    except (RuntimeError, OSError, ValueError, TypeError, KeyError) as error:
        raise BadInput(f"{path} is not a whole OpenEXR file: {error}", hint="delete it, generate again") from error
    return planes, attributes


def _rows(path: Path, header: Mapping[str, Any]) -> np.ndarray:
    """Return the scan lines as a memory map: y, the number of bytes that follow, a line of each channel.

    OpenEXR itself reads all channels of a line to return one. Without compression all lines have one size and
    end the file, so they can be mapped.
    """
    window, channels = header["dataWindow"], header["channels"]
    columns, first = window.max.x - window.min.x + 1, window.min.y
    count = window.max.y - first + 1
    for name, channel in channels.items():
        if str(channel.type) not in STORED:
            raise ValueError(f"channel {name} is {channel.type}, not {' or '.join(STORED)}")
    of_channels = [(name, STORED[str(channel.type)], (columns,)) for name, channel in channels.items()]
    line = np.dtype([("y", "<i4"), ("bytes", "<i4"), *of_channels])
    begin = path.stat().st_size - count * line.itemsize
    if begin <= 0:
        raise ValueError("it is truncated")
    rows = np.memmap(path, line, "r", begin, (count,))
    whole = (rows["bytes"] == line.itemsize - 8) & (rows["y"] == np.arange(first, first + count))
    if not whole.all():
        raise ValueError("its scan lines are not those of a whole, uncompressed file")
    return rows
