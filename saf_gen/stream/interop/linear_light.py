"""Pictures as linear light: the curves by which files store it, and what all readers of pictures have in common."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import prod
from pathlib import Path

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.stream.interop.stack_positions import StackPositions
from saf_gen.stream.metadata import MAX_PIXELS

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""Weights of linear red, green and blue (ITU-R BT.709), since a spike camera sees no colour."""
WIDE_LUMINANCE = {
    9: np.array([0.2627, 0.6780, 0.0593], np.float32),  # ITU-R BT.2020
    12: np.array([0.2290, 0.6917, 0.0793], np.float32),  # SMPTE EG 432-1, Display P3
}
"""Weights for other primaries, by their number in ITU-T H.273."""


@dataclass(frozen=True)
class Transfer:
    """How the values of a file stand for light.

    Attributes
    ----------
    name : str
        What is done with the values, as printed.
    decode : callable
        Returns linear light, float32, 0 and above, for values float32 of the same shape.
    bounded : bool
        Whether values must not be above 1.
    """

    name: str
    decode: Callable[[np.ndarray], np.ndarray]
    bounded: bool = True


def decode_srgb(values: np.ndarray) -> np.ndarray:
    """Return the linear light, float32, of sRGB values from 0 to 1 (IEC 61966-2-1)."""
    v = np.asarray(values, np.float32)
    linear: np.ndarray = np.where(v <= 0.04045, v / 12.92, ((np.maximum(v, 0) + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def decode_pq(values: np.ndarray) -> np.ndarray:
    """Return the luminance in cd/m², float32, of PQ values from 0 to 1 (ITU-R BT.2100-2, table 4; SMPTE ST 2084)."""
    root = np.asarray(values, np.float64) ** (32 / 2523)
    ratio = np.maximum(root - 107 / 128, 0) / (2413 / 128 - 299 / 16 * root)
    return np.asarray(10_000 * ratio ** (8192 / 1305), np.float32)


def decode_hlg(values: np.ndarray) -> np.ndarray:
    """Return the light of the scene from 0 to 1, float32, of HLG values from 0 to 1 (ITU-R BT.2100-2, table 5)."""
    v = np.asarray(values, np.float64)
    a = 0.17883277
    b, c = 1 - 4 * a, 0.5 - a * np.log(4 * a)
    return np.where(v <= 0.5, v**2 / 3, (np.exp((v - c) / a) + b) / 12).astype(np.float32)


@cache
def power_law(gamma: float) -> Transfer:
    """Return the decoding of values that are light to the power 1/``gamma``."""
    return Transfer(f"gamma {gamma:.3g} decoded", lambda values: np.asarray(values, np.float32) ** np.float32(gamma))


LINEAR = Transfer("linear light", lambda values: values, bounded=False)
SRGB = Transfer("sRGB decoded", decode_srgb)
_H273 = {
    1: SRGB, 2: SRGB, 4: power_law(2.2), 5: power_law(2.8), 6: SRGB, 8: LINEAR, 11: SRGB, 13: SRGB, 14: SRGB,
    15: SRGB, 16: Transfer("PQ decoded, in cd/m²", decode_pq), 18: Transfer("HLG decoded", decode_hlg),
}  # fmt: skip
"""Decoding by the number of a transfer characteristic in ITU-T H.273. Video that follows BT.709, BT.601 or BT.2020 is
made to be looked at on a screen, whose light sRGB describes better than the inverse of the camera's curve does."""
_UNREAD = {7: "SMPTE 240M", 9: "logarithmic, 100:1", 10: "logarithmic, 316:1", 12: "BT.1361", 17: "SMPTE 428"}


def find_transfer(number: int, *, where: Path) -> Transfer:
    """Return the decoding for the number of a transfer characteristic in ITU-T H.273; 2 means unspecified.

    Raises BadInput if it is one that cannot be decoded here.
    """
    if number not in _H273:
        raise BadInput(
            f"its tag says that light is stored as {_UNREAD.get(number, f'transfer characteristic {number}')}",
            where=str(where), allowed="sRGB, BT.709, BT.601, BT.2020, PQ, HLG, gamma 2.2, gamma 2.8 or linear",
            hint="convert it, or add --linear if the values are linear light",
        )  # fmt: skip
    return _H273[number]


class PictureFrames:
    """Pictures as linear light, float32 (H, W), 0 and above; each iteration begins with the first.

    Attributes
    ----------
    path : Path
        Folder or file from which the pictures are read.
    shape : tuple of int
        (H, W).
    transfer : Transfer
        How the values are decoded: not at all if they are linear light, else as sRGB, unless the source says otherwise.
    weights : array
        Float32 (3,), the share of linear red, green and blue in the light.
    rate_hz : Fraction or None
        Pictures per second, if they follow each other at equal times; None if they do not, or the source states none.
    times : tuple or None
        Time of each picture in seconds, exact (Fraction), from the first one, which is at 0; None for a picture of
        which the source states no time. None altogether if it states no times.
    order : str
        The names of the first and last pictures of a folder, in the order in which they are read; otherwise ''.
    notes : tuple of str
        What was assumed or left out, a line each.
    positions : StackPositions or None
        Where the focus was in each picture, if the source states it.
    highest : int
        The largest integer of 16 bits that has been read.
    """

    rate_hz: Fraction | None = None
    times: tuple[Fraction | None, ...] | None = None
    order: str = ""
    notes: tuple[str, ...] = ()
    positions: StackPositions | None = None
    weights: np.ndarray = LUMINANCE
    highest: int = 0

    def __init__(self, path: Path, *, linear: bool, shape: tuple[int, ...]) -> None:
        if len(shape) != 2 or min(shape) < 1 or prod(shape) > MAX_PIXELS:
            raise BadInput(
                f"the pictures have the shape {shape}",
                where=str(path),
                allowed=f"rows and columns, at most {MAX_PIXELS} pixels",
            )
        self.path, self.shape = path, (int(shape[0]), int(shape[1]))
        self.transfer = LINEAR if linear else SRGB

    def __iter__(self) -> Iterator[np.ndarray]:
        for name, values in self._read():
            if values.shape[:2] != self.shape:
                size = f"{name} has {values.shape[:2]} pixels"
                raise BadInput(size, where=str(self.path), allowed=f"{self.shape}, like the first")
            yield self._to_light(values, name=name)

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        raise NotImplementedError

    def _to_light(self, values: np.ndarray, *, name: str) -> np.ndarray:
        """Return grey, RGB or RGBA values (H, W) or (H, W, c) as linear light; alpha is ignored."""
        kind = values.dtype.kind
        if kind not in "uf" or values.dtype.itemsize > 8:
            raise BadInput(f"{name} is {values.dtype}", where=str(self.path), allowed="uint8, uint16 or floats",
                           hint="use saf-gen import for spikes")  # fmt: skip
        if values.dtype.itemsize == 2 and kind == "u":
            self.highest = max(self.highest, int(values.max(initial=0)))
        scaled = values.astype(np.float32) / (1 if kind == "f" else np.iinfo(values.dtype).max)
        low, high = float(scaled.min()), float(scaled.max())
        if not (low >= 0 and high < np.inf and (high <= 1 or not self.transfer.bounded)):
            allowed, hint = (
                ("0 to 1", "add --linear if the values are linear light")
                if self.transfer.bounded
                else ("0 and above", "")
            )
            raise BadInput(f"{name} has values {low:g} to {high:g}", where=str(self.path), allowed=allowed, hint=hint)
        light = self.transfer.decode(scaled)
        if light.ndim == 2:
            return light
        if light.ndim != 3 or light.shape[2] not in (1, 2, 3, 4):
            raise BadInput(f"{name} has shape {values.shape}", where=str(self.path), allowed="1 to 4 channels")
        return light[:, :, 0] if light.shape[2] < 3 else np.asarray(light[:, :, :3] @ self.weights)
