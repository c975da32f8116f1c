"""OpenEXR files as pictures: linear light by definition, in the colours and in the window that each file states."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saf_gen.core.exr import FLAT_KINDS, ForeignPart, read_foreign_channels, read_foreign_headers
from saf_gen.errors import BadInput, closest
from saf_gen.stream.interop.linear_light import LINEAR, LUMINANCE, PictureFrames
from saf_gen.stream.metadata import MAX_PIXELS

RGB = ("R", "G", "B")
OF_A_PICTURE = {*RGB, "A", "Y", "RY", "BY"}
"""Channels that say the same light in other words: RY and BY are the colour beside the luminance Y."""
FEW_NAMES = 12
"""Names of layers that are listed in a message."""


@dataclass(frozen=True)
class _Layer:
    """A picture in a file: ``channels``, either R, G, B or luminance alone, and the name by which it can be chosen."""

    name: str
    prefix: str
    part: ForeignPart
    channels: tuple[str, ...]


class ExrFrames(PictureFrames):
    """Pictures of OpenEXR files, in the given order, as luminance by the primaries that each file states.

    A picture is the display window; it is black where its file holds no pixels. ``key`` names a layer, part or channel.

    Raises BadInput if a header is damaged, or if it does not show which layer is the picture.
    """

    def __init__(self, path: Path, files: Sequence[Path], *, key: str | None) -> None:
        chosen = [_choose(file, key) for file in files]
        self._files, self._layers = files, [layer for layer, _ in chosen]
        parts = [layer.part for layer in self._layers]
        left, top, right, bottom = parts[0].display_window
        super().__init__(path, transfer=LINEAR, shape=(bottom - top + 1, right - left + 1))
        if len(files) > 1 and len({part.rate_hz for part in parts}) == 1:
            self.rate_hz = parts[0].rate_hz
        others = sorted({name for _, names in chosen for name in names})
        moved = sum(part.data_window != part.display_window for part in parts)
        self.notes = (
            *([f"layers left out: {_list(others)}"] if others else []),
            *([f"{moved} of {len(parts)} pictures: black where the file holds no pixels"] if moved else []),
        )

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        for file, layer in zip(self._files, self._layers, strict=True):
            channels = read_foreign_channels(file, layer.channels, part=layer.part)
            values = np.stack([channels[name].astype(np.float32) for name in layer.channels], axis=-1)
            bad = values[~np.isfinite(values)]
            if bad.size:
                where = f"{bad.size} values that are no numbers, such as {bad[0]:g}"
                raise BadInput(f"{file.name} has {where}", where=str(self.path), allowed="finite light, 0 and above")
            light = values @ _weights(layer.part, file) if len(layer.channels) == len(RGB) else values[:, :, 0]
            yield file.name, _place(light, layer.part)


def _choose(file: Path, key: str | None) -> tuple[_Layer, list[str]]:
    """Return the layer that is the picture of a file, and the names of everything in it that is left out."""
    parts = read_foreign_headers(file, max_pixels=MAX_PIXELS)
    layers = [layer for part in parts for layer in _find_layers(part)]
    if key is None:
        fits = [layer for layer in layers if not layer.prefix] or layers
    else:
        fits = [layer for layer in layers if key in (layer.name, layer.prefix)]
        fits = fits or [_Layer(key, "", part, (key,)) for part in parts if key in part.channels]
    if len(fits) != 1:
        found = f"has {len(fits) or 'no'} layers {key or 'of colour or luminance'}"
        names = [layer.name or "R, G, B" for layer in layers] or [name for part in parts for name in part.channels]
        raise BadInput(
            found, where=str(file), allowed=f"one of {_list(names)}", nearest=closest(key, names) if key else "",
            hint="choose one with --key NAME",
        )  # fmt: skip
    (layer,) = fits
    if layer.part.kind not in FLAT_KINDS or any(layer.part.channels[name] != 1 for name in layer.channels):
        kind = "deep pixels" if layer.part.kind not in FLAT_KINDS else "fewer values than pixels"
        raise BadInput(f"has {kind}", where=str(file), allowed="an image with a value of each channel in each pixel")
    return layer, [] if key else [name for name in _name_all(parts, layers) if name != layer.name]


def _find_layers(part: ForeignPart) -> Iterator[_Layer]:
    """Yield the layers of a part that have colour or luminance; X, Y and Z are a position, a normal or CIE values."""
    for prefix in dict.fromkeys(name.rpartition(".")[0] for name in part.channels):
        ends = {name.rpartition(".")[2] for name in part.channels if name.rpartition(".")[0] == prefix}
        found = RGB if ends.issuperset(RGB) else ("Y",) if "Y" in ends and "X" not in ends else ()
        if found:
            name = ".".join(text for text in (part.name if part.count > 1 else "", prefix) if text)
            yield _Layer(name, prefix, part, tuple(f"{prefix}.{end}" if prefix else end for end in found))


def _name_all(parts: Sequence[ForeignPart], layers: Sequence[_Layer]) -> list[str]:
    """Return the names of all layers, and of the channels that belong to none with a picture."""
    pictured = {(layer.part.number, layer.prefix) for layer in layers}
    rest = []
    for part in parts:
        for name in part.channels:
            prefix, _, end = name.rpartition(".")
            if (part.number, prefix) not in pictured or end not in OF_A_PICTURE:
                rest.append(prefix or name)
    return [*(layer.name for layer in layers), *dict.fromkeys(rest)]


def _list(names: Sequence[str]) -> str:
    more = len(names) - FEW_NAMES
    return ", ".join(names[:FEW_NAMES]) + (f" and {more} more" if more > 0 else "")


def _weights(part: ForeignPart, file: Path) -> np.ndarray:
    """Return the share of linear red, green and blue in the luminance, float32 (3,), by the primaries of a file.

    White is 1, as in OpenEXR's own conversion to luminance (``ImfRgbaYca.cpp``).
    """
    if part.chromaticities is None:
        return LUMINANCE
    primaries = np.array(part.chromaticities, np.float64).reshape(4, 2)
    xyz = np.column_stack([primaries, 1 - primaries.sum(axis=1)])
    with np.errstate(all="ignore"):
        try:
            weights = np.linalg.solve(xyz[:3].T, xyz[3] / xyz[3, 1]) * xyz[:3, 1]
        except np.linalg.LinAlgError:
            weights = np.full(3, np.nan)
    if not np.isfinite(weights).all():
        raise BadInput(
            f"states chromaticities {', '.join(f'{value:g}' for value in part.chromaticities)}", where=str(file),
            allowed="x and y of three different primaries and of white",
        )  # fmt: skip
    return weights.astype(np.float32)


def _place(light: np.ndarray, part: ForeignPart) -> np.ndarray:
    """Return the display window (H, W) of light in the data window; what is outside the data window is black."""
    if part.data_window == part.display_window:
        return light
    left, top, right, bottom = part.display_window
    first_column, first_row, last_column, last_row = part.data_window
    picture = np.zeros((bottom - top + 1, right - left + 1), np.float32)
    rows = slice(max(top, first_row), min(bottom, last_row) + 1)
    columns = slice(max(left, first_column), min(right, last_column) + 1)
    if rows.start < rows.stop and columns.start < columns.stop:
        picture[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = light[
            rows.start - first_row : rows.stop - first_row, columns.start - first_column : columns.stop - first_column
        ]
    return picture
