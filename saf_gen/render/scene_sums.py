"""Weighted sums of what a scene's script returned, by which two calls of the script are compared.

The numbers are those that the script gave: vertices, textures, emitters, transforms, motions. What Mitsuba computes
from them does not count. Another processor rounds other last digits, which changes a sum by about 1e-7. Another texture
changes it by far more than the 1e-5 that :mod:`saf_gen.stack.same_scene` allows.
"""

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike

from saf_gen.render.meshes import NORMALS, POSITIONS

SUMS = 8
SMALLEST = 1e-9
"""Values far below it are the error of rounding a zero."""
BLOCK = 1 << 18
"""Values of an array that are added up together: in more of them, a small difference would get lost."""
ROW = 1 << 12
"""Values of a block whose weights have a factor in common, which saves the time to read one weight for each value."""
LOADED_FILES = (".ply", ".obj")


def sum_up(described: Mapping[str, Any], *, folder: Path) -> tuple[float, ...]:
    """Return the number of texts and blocks of numbers in what a script returned, and weighted sums of them.

    Every value has a weight of its own, which follows from its keys and its place. Numbers are divided by the mean size
    of those around them, and the size counts by its logarithm, so that small objects count as much as large ones.

    Parameters
    ----------
    described : mapping of str
        Dictionary of numbers, texts, arrays, and objects of Mitsuba; the order of its keys counts.
    folder : Path
        Folder of the scene. Files in it count by their name, all others by their content.

    Returns
    -------
    tuple of float
        The number, and SUMS sums.
    """
    adder = _Adder(folder)
    adder.add(described, "")
    return (float(adder.count), *adder.sums.tolist())


class _Adder:
    def __init__(self, folder: Path) -> None:
        self.folder, self.count, self.sums = folder.resolve(), 0, np.zeros(SUMS)

    def add(self, value: Any, at: str) -> None:
        """Add a value, which may contain others, under its keys."""
        if isinstance(value, Mapping):
            for n, (key, inner) in enumerate(value.items()):
                is_file = key == "filename" and isinstance(inner, str)
                self.add(Path(inner) if is_file else inner, f"{at}/{n} {key}")
        elif isinstance(value, str | bytes | None):
            self._add_text(repr(value), at)
        elif isinstance(value, Path):
            self._add_file(value, at)
        elif isinstance(value, mi.Bitmap):
            self._add_numbers(np.array(value), at)
        elif isinstance(value, mi.Object):
            self._add_object(value, at)
        elif hasattr(value, "matrix"):
            self._add_numbers(_numbers(value.matrix), at)
        elif dr.is_array_v(value):
            self._add_numbers(_numbers(value), at)
        else:
            self._add_any(value, at)

    def _add_any(self, value: Any, at: str) -> None:
        try:
            numbers = np.asarray(value)
        except (ValueError, TypeError):  # rows of different lengths
            numbers = np.asarray(None)
        if numbers.dtype.kind in "biuf":
            self._add_numbers(numbers, at)
        elif isinstance(value, list | tuple):
            for n, inner in enumerate(value):
                self.add(inner, f"{at}/{n}")
        else:
            self._add_text(type(value).__name__, at)

    def _add_object(self, value: mi.Object, at: str) -> None:
        held = mi.traverse(value)
        self._add_text(type(value).__name__, at)
        for key in sorted(held.keys()):
            if not key.endswith(NORMALS):
                self.add(held[key], f"{at}/{key}")

    def _add_file(self, path: Path, at: str) -> None:
        try:
            path = Path(str(mi.file_resolver().resolve(str(path)))).resolve()  # type: ignore[operator]
            if path.is_relative_to(self.folder):
                self._add_text(path.relative_to(self.folder).as_posix(), at)
            elif path.suffix.lower() in LOADED_FILES:
                self._add_object(
                    mi.load_dict({"type": path.suffix.lower()[1:], "filename": str(path), "id": "file"}), at
                )
            else:
                self._add_numbers(np.frombuffer(path.read_bytes(), np.uint8), at)
        except (OSError, RuntimeError):  # Mitsuba will say what is wrong with it
            self._add_text(path.name, at)

    def _add_text(self, text: str, at: str) -> None:
        self.count += 1
        self.sums += _weights_of(f"{at}={text}")

    def _add_numbers(self, numbers: ArrayLike, at: str) -> None:
        array = np.asarray(numbers)
        self._add_text(str(array.shape), at)
        flat, spread = np.ravel(array), at.endswith(POSITIONS)
        for first in range(0, flat.size, BLOCK):
            block = np.nan_to_num(flat[first : first + BLOCK].astype(np.float64))
            mean = float(np.abs(block).mean())
            rows = np.pad(block, (0, -block.size % ROW)).reshape(-1, ROW)
            total = (rows @ _weights(ROW) * _weights(BLOCK // ROW)[: len(rows)]).sum(axis=0)
            # A vertex may move by much less than the size of the mesh, and no rounding makes it jump.
            size = np.linalg.norm(block) if spread else block.size * mean
            self.count += 1
            self.sums += _weights_of(f"{at}[{first}]") * (
                np.log1p(mean / SMALLEST) + total / (size + block.size * SMALLEST)
            )


def _numbers(value: Any) -> np.ndarray:
    """Return the values of an array of Dr.Jit without evaluating a constant, which would change kernels."""
    if dr.is_tensor_v(value):
        return _numbers(value.array).reshape(value.shape)
    if dr.depth_v(value) > 1:
        return np.concatenate([np.ravel(_numbers(inner)) for inner in value])
    if getattr(value, "state", None) == dr.VarState.Literal:
        return np.full(len(value), value[0])
    return np.array(value)


def _weights_of(text: str) -> np.ndarray:
    """Return the weights of a text, float64 (SUMS,), -1 to -0.5 or 0.5 to 1."""
    values = np.frombuffer(hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest()[: 2 * SUMS], "<i2") / 2.0**16
    return values + np.copysign(0.5, values)


@cache
def _weights(count: int) -> np.ndarray:
    """Return weights by an index, float64 (count, SUMS), -1 to 1: a hash of it."""
    mixed = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed ^= mixed >> np.uint64(31)
    return mixed.astype("<u8").view(np.uint8).reshape(count, SUMS) / 127.5 - 1
