"""Pictures as linear light: the curves by which files store it, and what all readers of pictures have in common."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import prod
from pathlib import Path

import numpy as np

from saf_gen.errors import BadInput
from saf_gen.stream.interop.stack_positions import StackPositions
from saf_gen.stream.metadata import MAX_PIXELS

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""Weights of linear red, green and blue (ITU-R BT.709), since a spike camera sees no colour."""


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


def decode_bt709(values: np.ndarray) -> np.ndarray:
    """Return the light of the scene, float32, of values from 0 to 1 by the curve of a camera (ITU-R BT.709, 1.2)."""
    v = np.asarray(values, np.float32)
    linear: np.ndarray = np.where(v < 0.081, v / 4.5, ((np.maximum(v, 0) + 0.099) / 1.099) ** (1 / 0.45))
    return linear.astype(np.float32)


LINEAR = Transfer("linear light", lambda values: values, bounded=False)
SRGB = Transfer("sRGB decoded", decode_srgb)
BT709 = Transfer("BT.709 decoded", decode_bt709)
TRANSFERS = {"srgb": SRGB, "bt709": BT709}
"""What a user can state besides linear light."""
ASK_TRANSFER = "add --transfer srgb, --transfer bt709, or --linear for linear light"


class PictureFrames:
    """Pictures as linear light, float32 (H, W), 0 and above; each iteration begins with the first.

    Attributes
    ----------
    path : Path
        Folder or file from which the pictures are read.
    shape : tuple of int
        (H, W).
    transfer : Transfer
        How the values are decoded.
    is_stated : bool
        Whether the source, or the user, states this. Otherwise values are decoded as sRGB, for callers that ask their
        users in their own words.
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
    """

    rate_hz: Fraction | None = None
    times: tuple[Fraction | None, ...] | None = None
    order: str = ""
    notes: tuple[str, ...] = ()
    positions: StackPositions | None = None
    weights: np.ndarray = LUMINANCE

    def __init__(self, path: Path, *, transfer: Transfer | None, shape: tuple[int, ...]) -> None:
        if len(shape) != 2 or min(shape) < 1 or prod(shape) > MAX_PIXELS:
            raise BadInput(
                f"the pictures have the shape {shape}",
                where=str(path),
                allowed=f"rows and columns, at most {MAX_PIXELS} pixels",
            )
        self.path, self.shape = path, (int(shape[0]), int(shape[1]))
        self.transfer, self.is_stated = transfer or SRGB, transfer is not None

    def check_stated(self) -> None:
        """Raise BadInput unless the source or the user states how values stand for light."""
        if not self.is_stated:
            raise BadInput(
                "does not say how its values stand for light", where=str(self.path), allowed="sRGB, BT.709 or linear",
                hint=ASK_TRANSFER,
            )  # fmt: skip

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


def equal_rate(times: tuple[Fraction | None, ...]) -> Fraction | None:
    """Return the pictures per second if times (s) follow each other at exactly equal steps, or None."""
    known = [time for time in times if time is not None]
    steps = {after - before for before, after in pairwise(known)}
    if len(known) < len(times) or len(steps) != 1 or min(steps) <= 0:
        return None
    return 1 / steps.pop()
