"""Pictures of other cameras as linear light, read one at a time from a folder of images, a video or an array."""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.errors import BadInput, unknown
from saf_gen.stream.interop.array_files import ENDINGS, SlicedArray, open_array
from saf_gen.stream.interop.exr_frames import ExrFrames
from saf_gen.stream.interop.image_pages import read_pages
from saf_gen.stream.interop.linear_light import ASK_TRANSFER, LINEAR, TRANSFERS, PictureFrames, Transfer
from saf_gen.stream.interop.stack_positions import read_stack_positions
from saf_gen.stream.interop.video_frames import VideoFrames

IMAGES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pbm", ".pgm", ".ppm"})
EXR = ".exr"
FEW_NAMES = 3
"""Names of pictures that are listed from each end of a folder."""
MIN_SIZE = 16
"""Rows and columns from which an array of 3 or 4 columns is rather one picture in colour."""


class _ImageFiles(PictureFrames):
    """The pictures of a folder in the order of the numbers in their names, or of a single file, page after page."""

    def __init__(self, path: Path, *, transfer: Transfer | None) -> None:
        is_folder = path.is_dir()
        files = (p for p in path.iterdir() if p.suffix.lower() in IMAGES) if is_folder else [path]
        self._files = sorted(files, key=_number_sort_key)
        if not self._files:
            raise BadInput("has no picture", where=str(path), allowed=f"files {', '.join(sorted(IMAGES))}")
        first, own = next(read_pages(self._files[0]))
        super().__init__(path, transfer=transfer or own, shape=first.shape[:2])
        self._must_state = transfer is None and own is not None
        self.order = _name_order(self._files) if is_folder else ""
        if not is_folder:
            self.positions = read_stack_positions(path)

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        for file in self._files:
            for number, (values, own) in enumerate(read_pages(file)):
                if self._must_state and own is not self.transfer:
                    problem = f"{file.name} does not say how its values stand for light, as the first picture does"
                    raise BadInput(problem, where=str(self.path), hint=ASK_TRANSFER)
                yield f"{file.name}{f', page {number + 1}' if number else ''}", values


def _name_order(files: list[Path]) -> str:
    names = [file.name for file in files]
    if len(names) > 2 * FEW_NAMES:
        names[FEW_NAMES:-FEW_NAMES] = ["…"]
    return ", ".join(names)


def _number_sort_key(path: Path) -> list[Any]:
    """Return a sort key that puts frame_10 after frame_9, z_0.15 before z_0.3, and z_-3 before z_2.

    A hyphen is a sign unless it follows a letter or digit, as in scene-1; 1.2.3 is three numbers.
    """
    parts = re.split(r"((?<![A-Za-z0-9])[-+]?(?<![\d.])\d+\.\d+(?![.\d])|(?<![A-Za-z0-9])[-+]\d+|\d+)", path.stem)
    return [(float(part), "") if number % 2 else (-np.inf, part) for number, part in enumerate(parts)]


class _ArrayFrames(PictureFrames):
    def __init__(self, path: Path, *, transfer: Transfer | None, key: str | None) -> None:
        self._array: SlicedArray = open_array(path, key=key)
        shape = self._array.shape
        one_picture = len(shape) == 3 and shape[2] in (3, 4) and min(shape[:2]) >= MIN_SIZE
        if len(shape) not in (3, 4) or 0 in shape or one_picture:
            axes = "(frames, rows, columns) or (frames, rows, columns, channels)"
            hint = "save one colour picture with a first axis of 1" if one_picture else ""
            raise BadInput(f"the array has shape {shape}", where=str(path), allowed=axes, hint=hint)
        super().__init__(path, transfer=transfer, shape=shape[1:3])

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        for number in range(self._array.shape[0]):
            yield f"frame {number}", self._array[slice(number, number + 1)][0]


def _list_exr(path: Path) -> list[Path]:
    """Return the OpenEXR files of a folder in the order of the numbers in their names, or ``path`` if it is one.

    Raises BadInput for a folder that holds other images as well, whose light is stored in another way.
    """
    if not path.is_dir():
        return [path] if path.suffix.lower() == EXR else []
    files = [file for file in path.iterdir() if file.suffix.lower() in (EXR, *IMAGES)]
    found = {file.suffix.lower() for file in files}
    if EXR in found and len(found) > 1:
        raise BadInput(
            f"has both {EXR} and {', '.join(sorted(found - {EXR}))} files", where=str(path),
            allowed="OpenEXR files alone, or none", hint="put them in folders of their own",
        )  # fmt: skip
    return sorted(files, key=_number_sort_key) if EXR in found else []


def open_pictures(
    path: str | os.PathLike[str], *, linear: bool = False, transfer: str | None = None, key: str | None = None
) -> PictureFrames:
    """Return the pictures in a folder of images, an image file with pages, or an array file; others are read as video.

    ``linear`` states that the values are linear light, as those of OpenEXR files always are, and ``transfer`` that they
    are ``srgb`` or ``bt709``, both whatever the file says. ``key`` names the array in a file with several, or the layer
    of OpenEXR files.

    Raises BadInput if the path is missing, cannot be read, or holds no pictures.
    """
    where = Path(path)
    if transfer is not None and transfer not in TRANSFERS:
        raise unknown("transfer", transfer, allowed=TRANSFERS)
    if linear and transfer is not None:
        raise BadInput(f"--transfer {transfer} and --linear are given", where=str(path), allowed="one of them")
    if not where.exists():
        raise BadInput("there is no such file or folder", where=str(path))
    stated = LINEAR if linear else TRANSFERS.get(transfer or "")
    if exr := _list_exr(where):
        if transfer is not None:
            raise BadInput(f"--transfer {transfer} is given for linear light", where=str(path), hint="leave it out")
        pictures = ExrFrames(where, exr, key=key)
        pictures.order = _name_order(exr) if where.is_dir() else ""
        return pictures
    if key is not None and where.suffix.lower() not in ENDINGS:
        raise BadInput(
            f"--key {key} is given for pictures that are neither in an array file nor in OpenEXR files",
            where=str(path), hint="leave it out",
        )  # fmt: skip
    if where.is_dir() or where.suffix.lower() in IMAGES:
        return _ImageFiles(where, transfer=stated)
    if where.suffix.lower() in ENDINGS:
        return _ArrayFrames(where, transfer=stated, key=key)
    return VideoFrames(where, transfer=stated)
