"""Positions of the focus that a z-stack states in its TIFF file, as OME-TIFF and ImageJ write them.

OME-TIFF holds XML in the description of its first page (`OME-TIFF specification
<https://ome-model.readthedocs.io/en/stable/ome-tiff/specification.html>`_); ImageJ holds lines such as ``slices=21``.
ImageJ calls the pictures of any stack slices, so that these are positions only with a spacing in a unit of length.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from warnings import catch_warnings
from xml.etree import ElementTree

import numpy as np
from PIL import Image, UnidentifiedImageError

from saf_gen.errors import BadInput
from saf_gen.stream.interop.array_files import DAMAGE

DESCRIPTION, SAMPLES_PER_PIXEL = 270, 277
MAX_DESCRIPTION = 1 << 26
MICROMETRES = {
    "m": 1e6, "cm": 1e4, "mm": 1e3, "µm": 1.0, "μm": 1.0, "um": 1.0, "micron": 1.0, "microns": 1.0, "micrometer": 1.0,
    "nm": 1e-3, "pm": 1e-6, "Å": 1e-4,
}  # fmt: skip
"""Units of length by the names that OME and ImageJ give them; the two µ are different characters."""


@dataclass(frozen=True, eq=False)
class StackPositions:
    """Where the focus was in each picture of a stack.

    Attributes
    ----------
    path : Path
        The file.
    z : ndarray
        Positions float64 (pictures,), in the order of the pictures, in ``unit``.
    unit : str
        ``µm``, or what the file calls a unit that is no length.
    source : str
        What in the file states them.
    """

    path: Path
    z: np.ndarray
    unit: str
    source: str

    def __str__(self) -> str:
        return f"{self.z[0]:g} to {self.z[-1]:g} {self.unit} in {self.z.size} pictures ({self.source})"

    @property
    def travel(self) -> np.ndarray:
        """Positions as a fraction of the travel, float64 (pictures,): 0 in the first picture and 1 in the last.

        Raises BadInput if they do not all rise, or all fall; the lens may rest between two pictures.
        """
        steps = np.diff(self.z)
        back = np.flatnonzero(steps * steps[np.flatnonzero(steps)[0]] < 0)
        if back.size:
            turn = self.z[back[0] : back[0] + 2]
            raise BadInput(
                f"the focus turns back from {turn[0]:g} to {turn[1]:g} {self.unit} ({self.source})",
                where=str(self.path), allowed="positions that rise, or fall, from the first picture to the last",
                hint="state the positions with --focus LOG.csv",
            )  # fmt: skip
        return np.asarray((self.z - self.z[0]) / (self.z[-1] - self.z[0]))


def read_stack_positions(path: Path) -> StackPositions | None:
    """Return the positions of the pictures of a TIFF file; None if it states none, or all are the same.

    Raises BadInput if its description contradicts its pages, or if its pages are channels, or have two axes.
    """
    if path.suffix.lower() not in (".tif", ".tiff"):
        return None
    try:
        with catch_warnings(action="ignore"), Image.open(path) as image:
            pages, samples = getattr(image, "n_frames", 1), image.tag_v2.get(SAMPLES_PER_PIXEL, 1)  # type: ignore[attr-defined]
            text = image.tag_v2.get(DESCRIPTION, "")  # type: ignore[attr-defined]
    except (*DAMAGE, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise BadInput(f"cannot be read: {error}", where=str(path), allowed="a picture") from error
    if isinstance(text, str):
        raw = text.encode("latin-1", "replace")  # Pillow reads UTF-8 as Latin-1
        text = raw.decode("utf-8", "replace")
    if not isinstance(text, str) or len(text) > MAX_DESCRIPTION:
        return None
    if text.startswith("ImageJ="):
        return _read_imagej(path, text, pages=pages)
    return _read_ome(path, text, pages=pages, samples=samples) if re.search(r"<(\w+:)?OME\b", text[:4096]) else None


def _read_imagej(path: Path, text: str, *, pages: int) -> StackPositions | None:
    stated = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
    count = {
        name: _whole(stated.get(name, "1"), name, path=path) for name in ("images", "channels", "slices", "frames")
    }
    _check_axes(
        path, "ImageJ's description", pages=pages, stated=count["images"],
        channels=count["channels"], z=count["slices"], times=count["frames"],
    )  # fmt: skip
    unit = stated.get("unit", "").replace("\\u00B5", "µ")
    spacing = _number(stated.get("spacing", "0"))
    if count["slices"] == 1 or unit not in MICROMETRES or not spacing:
        return None
    z = spacing * MICROMETRES[unit] * np.arange(pages)
    return StackPositions(path, z, "µm", "spacing in ImageJ's description")


def _read_ome(path: Path, text: str, *, pages: int, samples: int) -> StackPositions | None:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise BadInput("its OME-XML declares a document type", where=str(path), allowed="plain XML")
    try:
        elements = list(ElementTree.fromstring(text.rstrip("\0 \n")).iter())
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise BadInput(
            f"its OME-XML cannot be read: {error}", where=str(path), allowed="a complete OME-TIFF"
        ) from error
    images = [element for element in elements if _tag(element) == "Pixels"]
    if len(images) != 1:
        raise BadInput(
            f"its OME-XML describes {len(images)} images" if images else "its OME-XML is in another file",
            where=str(path), allowed="one image in one file", hint="save one image as a TIFF of its own",
        )  # fmt: skip
    (pixels,) = images
    sizes = {axis: _whole(pixels.get(f"Size{axis}", "1"), f"Size{axis}", path=path) for axis in "ZCT"}
    listed = sum(_tag(child) == "Channel" for child in pixels)
    channels = listed or (1 if samples == sizes["C"] else sizes["C"])
    planes = sizes["Z"] * sizes["T"] * channels
    _check_axes(path, "OME-XML", pages=pages, stated=planes, channels=channels, z=sizes["Z"], times=sizes["T"])
    if sizes["Z"] == 1:
        return None
    of_page = _plane_of_page(pixels, pages, path=path)
    for z, unit, source in _stated_z(pixels, sizes["Z"], path=path):
        if np.isfinite(z).all() and np.ptp(z):
            return StackPositions(path, z[of_page], unit, f"{source} in OME-XML")
    return None


def _stated_z(pixels: ElementTree.Element, count: int, *, path: Path) -> Iterator[tuple[np.ndarray, str, str]]:
    """Yield the position of each plane, NaN where there is none, and its unit, as each kind of statement has them."""
    z, units = np.full(count, np.nan), set()
    for plane in (child for child in pixels if _tag(child) == "Plane" and "PositionZ" in child.attrib):
        number = _whole(plane.get("TheZ", ""), "TheZ", path=path, least=0)
        unit = plane.get("PositionZUnit", "reference frame")
        if number >= count or not np.isnan(z[number]):
            raise BadInput(f"its OME-XML has two positions of plane {number}, or no such plane", where=str(path))
        z[number] = _number(plane.get("PositionZ", "")) * MICROMETRES.get(unit, 1)
        units.add("µm" if unit in MICROMETRES else unit)
    if len(units) == 1:
        yield z, units.pop(), "PositionZ"
    unit = pixels.get("PhysicalSizeZUnit", "µm")
    spacing = _number(pixels.get("PhysicalSizeZ", "nan")) * MICROMETRES.get(unit, 1)
    yield spacing * np.arange(count), "µm" if unit in MICROMETRES else unit, "PhysicalSizeZ"


def _plane_of_page(pixels: ElementTree.Element, pages: int, *, path: Path) -> np.ndarray:
    """Return the plane that each page holds, int64 (pages,), of an image with the axis z alone."""
    found = np.full(pages, -1)
    blocks = [child for child in pixels if _tag(child) == "TiffData"] or [ElementTree.Element("TiffData")]
    for block in blocks:
        page, plane = (_whole(block.get(name, "0"), name, path=path, least=0) for name in ("IFD", "FirstZ"))
        rest = min(pages - page, pages - plane)
        usual = "1" if "IFD" in block.attrib else str(max(rest, 1))
        count = _whole(block.get("PlaneCount", usual), "PlaneCount", path=path)
        if count <= rest:
            found[page : page + count] = np.arange(plane, plane + count)
    if not np.array_equal(np.sort(found), np.arange(pages)):
        problem = "its OME-XML does not say which plane each page holds"
        raise BadInput(problem, where=str(path), allowed="a page for each plane")
    return found


def _check_axes(path: Path, source: str, *, pages: int, stated: int, channels: int, z: int, times: int) -> None:
    """Raise BadInput unless a file has the pages that its description states, along one axis."""
    said = f"{source} states {channels} channels, {z} slices and {times} times"
    if stated != pages or channels * z * times not in (1, pages):
        raise BadInput(
            f"has {pages} pages, and its {said}", where=str(path), allowed="a page for each of them",
            hint="if it is complete, save it again",
        )  # fmt: skip
    if channels > 1 or (z > 1 and times > 1):
        raise BadInput(
            f"its {said}, which are not one after the other", where=str(path), allowed="one axis, slices or times",
            hint="save one channel, or the slices of one time, as a TIFF of its own",
        )  # fmt: skip


def _tag(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _whole(text: str, name: str, *, path: Path, least: int = 1) -> int:
    if not re.fullmatch(r"\s*\d{1,9}\s*", text) or int(text) < least:
        raise BadInput(
            f"its description has {name} {text!r}", where=str(path), allowed=f"a whole number, {least} and above"
        )
    return int(text)
