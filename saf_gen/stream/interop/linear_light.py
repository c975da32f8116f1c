"""Pictures as linear light: the curves by which files store it, and what all readers of pictures have in common."""

from collections.abc import Iterator
from fractions import Fraction
from math import prod
from pathlib import Path

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.stream.interop.stack_positions import StackPositions
from saf_gen.stream.metadata import MAX_PIXELS

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""Weights of linear red, green and blue (ITU-R BT.709), since a spike camera sees no colour."""


def decode_srgb(values: np.ndarray) -> np.ndarray:
    """Return the linear light, float32, of sRGB values from 0 to 1 (IEC 61966-2-1)."""
    v = np.asarray(values, np.float32)
    linear: np.ndarray = np.where(v <= 0.04045, v / 12.92, ((np.maximum(v, 0) + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


class PictureFrames:
    """Pictures as linear light, float32 (H, W), 0 and above; each iteration begins with the first.

    Attributes
    ----------
    path : Path
        Folder or file from which the pictures are read.
    linear : bool
        True if the values in the source are linear light already, False if they are sRGB, which is decoded.
    shape : tuple of int
        (H, W).
    rate_hz : Fraction, float or None
        Pictures per second; None if the source does not state it.
    order : str
        The names of the first and last pictures of a folder, in the order in which they are read; otherwise ''.
    notes : tuple of str
        What was assumed or left out, a line each.
    positions : StackPositions or None
        Where the focus was in each picture, if the source states it.
    """

    rate_hz: Fraction | float | None = None
    order: str = ""
    notes: tuple[str, ...] = ()
    positions: StackPositions | None = None

    def __init__(self, path: Path, *, linear: bool, shape: tuple[int, ...]) -> None:
        if len(shape) != 2 or min(shape) < 1 or prod(shape) > MAX_PIXELS:
            raise BadInput(
                f"the pictures have the shape {shape}",
                where=str(path),
                allowed=f"rows and columns, at most {MAX_PIXELS} pixels",
            )
        self.path, self.linear, self.shape = path, linear, (int(shape[0]), int(shape[1]))

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
        scaled = values.astype(np.float32) / (1 if kind == "f" else np.iinfo(values.dtype).max)
        low, high = float(scaled.min()), float(scaled.max())
        if not (low >= 0 and high < np.inf and (self.linear or high <= 1)):
            allowed, hint = (
                ("0 and above", "") if self.linear else ("0 to 1", "add --linear if the values are linear light")
            )
            raise BadInput(f"{name} has values {low:g} to {high:g}", where=str(self.path), allowed=allowed, hint=hint)
        light = scaled if self.linear else decode_srgb(scaled)
        if light.ndim == 2:
            return light
        if light.ndim != 3 or light.shape[2] not in (1, 2, 3, 4):
            raise BadInput(f"{name} has shape {values.shape}", where=str(self.path), allowed="1 to 4 channels")
        return light[:, :, 0] if light.shape[2] < 3 else np.asarray(light[:, :, :3] @ LUMINANCE)
