"""Stacks that were photographed: pictures of another camera at equal steps of the focus, as a sensor sees them.

The sensor sees the largest centred part of the pictures that has its shape, and each of its pixels the mean of what is
below it. The light is that of the pictures, decoded, in a unit that only the exposure of a recording makes good.

Where such a stack is in focus is decided by a rule and not by optics, which nobody knows: it is the mean of the peaks
of three focus measures of different kinds in the box of the target, each the vertex of the parabola through the largest
value and its neighbours. Variance (``sd``) weighs all scales alike, gradients (``tenengrad``) the finest, and the
autocorrelation (``vollath_f4``) leaves out what differs from pixel to pixel, the noise of the pictures. Where the
target has relief, or its blur differs before and behind the focus, they differ: their range is the uncertainty.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from saf_gen.camera import Sensor
from saf_gen.core.region import Region, bounding_box
from saf_gen.errors import BadInput
from saf_gen.optics import PictureSteps
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.stack.focal_stack import PICTURES, StackSpec, StackStore
from saf_gen.stack.noise_free import COUNTS, score_picture
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stream.metadata import Truth
from saf_gen.stream.optima import curve_peak

if TYPE_CHECKING:
    from saf_gen.stream.interop.linear_light import PictureFrames

MEASURES = ("sd", "tenengrad", "vollath_f4")
MIN_PICTURES, MIN_BOX = 3, 16
"""Smallest numbers of pictures that have a peak, and of the target's rows and columns on the sensor."""
MAX_UNEVEN = 0.1
"""Largest part of a step by which stated positions may be off equal steps."""
SMOOTH_PX, SEEN_PX = 2.0, 1.0
"""Smoothing before pictures are compared for their magnification, and the shift at the corner that is told."""


@dataclass(frozen=True)
class StackCard:
    """What is told of a photographed stack, under the names that scene cards use."""

    id: str
    title: str
    licence: str
    lights: tuple[str, ...] = ("light",)
    light_roles: Mapping[str, str] = field(default_factory=lambda: {"light": "key"})
    illuminance_lux: Mapping[str, float] = field(default_factory=dict)
    slices_per_s: None = None
    params: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class PictureStack:
    """A photographed stack that has been read and checked once.

    Attributes
    ----------
    card : StackCard
        What is told of it.
    path : Path
        Folder or file of the pictures.
    linear : bool
        Whether their values are linear light; otherwise they are decoded as sRGB.
    box : tuple of int
        Left, top, columns and rows of the target, in pixels of the pictures.
    shape : tuple of int
        Rows and columns of the sensor.
    count : int
        Number of pictures.
    step_um : float or None
        Distance of the focus between two pictures, µm; None if it is not known.
    digest : str
        SHA-256 of the light that the sensor sees, and of the box.
    remarks : tuple of str
        What a user should know, a line each.
    """

    card: StackCard
    path: Path
    linear: bool
    box: tuple[int, int, int, int]
    shape: tuple[int, int]
    count: int
    step_um: float | None
    digest: str
    remarks: tuple[str, ...]
    params: Mapping[str, Any] = field(default_factory=dict)

    @property
    def id(self) -> str:
        return self.card.id

    def with_params(self, chosen: Mapping[str, Any]) -> "PictureStack":
        """Return this stack, which has no parameters."""
        return self

    def spec(self, sensor: Sensor) -> StackSpec:
        """Return what determines the stack in front of a sensor of its shape."""
        rows, columns = self.shape
        return StackSpec(
            scene=self.id, scene_digest=self.digest, groups=self.card.lights, drive=PictureSteps(self.step_um),
            rows=rows, columns=columns, pitch_m=sensor.pitch_m, positions=self.count, samples=1, max_depth=1,
            estimator=PICTURES,
        )  # fmt: skip

    @property
    def steps(self) -> str:
        """Number of pictures and what is known of the steps between them, in words."""
        if self.step_um is None:
            return f"{self.count} pictures, whose steps are not known"
        return f"{self.count} pictures, {self.step_um:g} µm apart"

    def take_in(self, spec: StackSpec, root: Path) -> list[str]:
        """Store the pictures as a focal stack under ``root``, if they are not there, and return the names of pieces.

        Raises BadInput if the pictures are no longer those that were checked.
        """
        store = StackStore(root, spec)
        if not (missing := store.missing_pieces()):
            return []
        pictures = _open(self.path, linear=self.linear)
        light, target = _seen(pictures, self.shape, box=self.box)
        if _digest(light, target) != self.digest:
            raise BadInput("the pictures have changed", where=str(self.path), hint="run saf-gen generate again")
        store.write_geometry(np.full(self.shape, np.nan, np.float32), target, backend=PICTURES)
        store.write_group(self.card.lights[0], light, backend=PICTURES)
        return missing


def read_picture_stack(
    card: StackCard,
    path: Path,
    *,
    values: str | None,
    step_um: float | None,
    box: tuple[int, int, int, int] | None,
    shape: tuple[int, int],
) -> PictureStack:
    """Read and check all pictures of a stack.

    Parameters
    ----------
    card : StackCard
        What is told of it.
    path : Path
        Folder of pictures, in the order of the numbers in their names, or file with several.
    values : {'linear', 'srgb'} or None
        How their values stand for light; None only for OpenEXR files, whose values are linear.
    step_um : float or None
        Distance of the focus between two pictures, µm; by default what the file states, if it does.
    box : tuple of int or None
        Left, top, columns and rows of the target in pixels of the pictures; by default all that the sensor sees.
    shape : tuple of int
        Rows and columns of the sensor.

    Raises
    ------
    BadInput
        If the pictures cannot be read, are fewer than three or smaller than the sensor, do not say how their values
        stand for light, or contradict what is stated; if the box is not on the sensor, or too small; if a measure has
        no peak between the first picture and the last.
    """
    pictures = _open(path, linear=values == "linear")
    _check_values(pictures, values)
    stated = _stated_step(pictures)
    if step_um is not None and stated is not None and abs(stated - step_um) > 0.01 * step_um:
        raise BadInput(
            f"step_um of stack {card.id!r} is {step_um:g}, and the file states {stated:g} µm", where=str(path),
            hint="leave step_um out, or correct it",
        )  # fmt: skip
    step_um = stated if step_um is None else step_um
    if box is None:
        box = (0, 0, pictures.shape[1], pictures.shape[0])
    light, target = _seen(pictures, shape, box=box)
    truth = _truth(light, bounding_box(target), where=f"stack {card.id!r}")
    stack = PictureStack(card, path, values == "linear", box, shape, len(light), step_um, _digest(light, target), ())
    named = ", ".join(f"{name} {at * (stack.count - 1):.2f}" for name, at in truth.items())
    remarks = [
        f"{card.id}: {stack.steps}; no depth of focus; in picture {named} (from 0) it is sharpest",
        *_breathing(card.id, light),
    ]
    return replace(stack, remarks=tuple(remarks))


def _open(path: Path, *, linear: bool) -> "PictureFrames":
    from saf_gen.stream.interop.picture_frames import open_pictures  # readers that other recipes do not need

    return open_pictures(path, linear=linear)


def _check_values(pictures: "PictureFrames", values: str | None) -> None:
    """Raise BadInput unless it is known, and stated without contradiction, how values stand for light."""
    from saf_gen.stream.interop.linear_light import LINEAR, SRGB

    where, own = str(pictures.path), pictures.transfer
    of_files = values != "linear" and own is LINEAR  # OpenEXR
    if values is None and not of_files:
        raise BadInput(
            "does not say how its values stand for light", where=where, allowed="values: linear, values: srgb",
            hint="cameras for measuring are linear; JPEG and pictures to be looked at are sRGB",
        )  # fmt: skip
    if values == "srgb" and own is not SRGB:
        raise BadInput(
            f"values is srgb, and its tags say: {own.name}", where=where, allowed="what the pictures are",
            hint="leave values out" if of_files else "convert the pictures",
        )  # fmt: skip


def _stated_step(pictures: "PictureFrames") -> float | None:
    """Return the equal steps that a file states, in µm; None if it states none in a unit of length."""
    positions = pictures.positions
    if positions is None or positions.unit != "µm":
        return None
    steps = np.diff(positions.z) * np.sign(positions.z[-1] - positions.z[0])
    if not np.abs(steps - steps.mean()).max() <= MAX_UNEVEN * steps.mean():
        raise BadInput(
            f"its pictures are {steps.min():g} to {steps.max():g} µm apart", where=str(pictures.path),
            allowed="equal steps", hint="keep only pictures at equal steps",
        )  # fmt: skip
    return float(steps.mean())


def _seen(
    pictures: "PictureFrames", shape: tuple[int, int], *, box: tuple[int, int, int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the light that a sensor of ``shape`` sees, float32 (focus, row, col), and the target, bool (row, col)."""
    where, scale = str(pictures.path), min(have / need for have, need in zip(pictures.shape, shape, strict=True))
    if scale < 1:
        raise BadInput(
            f"its pictures have {pictures.shape[1]} × {pictures.shape[0]} pixels", where=where,
            allowed=f"at least the {shape[1]} × {shape[0]} of the sensor",
            hint="name a sensor file with a smaller array",
        )  # fmt: skip
    edges = [
        (have - scale * need) / 2 + scale * np.arange(need + 1)
        for have, need in zip(pictures.shape, shape, strict=True)
    ]
    light = np.stack([_average(_average(picture, edges[0]).T, edges[1]).T for picture in pictures]).astype(np.float32)
    if len(light) < MIN_PICTURES:
        raise BadInput(f"has {len(light)} pictures", where=where, allowed=f"at least {MIN_PICTURES}")
    if not all(plane.any() for plane in light):
        raise BadInput("a picture is black", where=where, allowed="pictures with light")
    left, top, columns, rows = box
    inside = [(first < (e[:-1] + e[1:]) / 2) & ((e[:-1] + e[1:]) / 2 < first + size) for e, first, size in
              ((edges[0], top, rows), (edges[1], left, columns))]  # fmt: skip
    seen = [int(axis.sum()) for axis in inside]
    if (
        min(left, top) < 0
        or left + columns > pictures.shape[1]
        or top + rows > pictures.shape[0]
        or min(seen) < MIN_BOX
    ):
        first, last = ([round(float(e[n])) for e in edges] for n in (0, -1))
        raise BadInput(
            f"box is {list(box)}, of which the sensor sees {seen[1]} × {seen[0]} pixels", where=where,
            allowed=f"left, top, columns, rows in columns {first[1]} to {last[1]} and rows {first[0]} to {last[0]}, "
            f"at least {MIN_BOX} × {MIN_BOX} of its pixels, which are {scale:.3g} wide",
        )  # fmt: skip
    return light, np.outer(*inside)


def _average(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the means along the first axis between edges, which may lie within a row, float64."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0, dtype=np.float64)])
    low = np.clip(edges.astype(int), 0, len(values) - 1)
    part = (edges - low)[:, None]
    return np.diff(total[low] + part * (total[low + 1] - total[low]), axis=0) / np.diff(edges)[:, None]


def _digest(light: np.ndarray, target: np.ndarray) -> str:
    found = hashlib.sha256(json.dumps(light.shape).encode())
    found.update(np.ascontiguousarray(light, "<f4").tobytes() + np.packbits(target).tobytes())
    return found.hexdigest()


def _truth(light: np.ndarray, box: Region, *, where: str) -> dict[str, float]:
    """Return where three measures peak, as fractions of the travel, by name; each picture is scored at the same mean.

    Raises BadInput if one has no peak between the first picture and the last.
    """
    found = {}
    for name in MEASURES:
        curve = np.array(
            [score_picture(name, picture * (COUNTS / picture.mean())) for picture in light[(slice(None), *box)]]
        )
        peak = curve_peak(curve, dof=np.inf) if np.ptp(curve) > 0 else None
        if peak is None:
            end = "first" if curve.argmax() == 0 else "last"
            raise BadInput(
                f"{where}: {name} is largest in the {end} picture, so that its focus may be beyond it"
                if np.ptp(curve) > 0 else f"{where}: {name} is {curve[0]:g} in all pictures",
                allowed="a peak between the first picture and the last", hint="another box, or more pictures",
            )  # fmt: skip
        found[name] = peak
    return found


def find_picture_truth(plane_source: PlaneSource, position: np.ndarray) -> tuple[Truth, dict[str, float]]:
    """Return the truth of a photographed stack by the rule of this module, and how far each measure peaks from it.

    The peaks of the measures lie within ``in_focus``; depth and depth of focus are not known.

    Parameters
    ----------
    plane_source : PlaneSource
        The stack.
    position : ndarray, shape (T,)
        Position of the lens in each readout, 0 to 1.
    """
    _, target = plane_source.load_geometry(0)
    light = plane_source.load_planes(0, 0, plane_source.time_stack.specs[0].positions)[0]
    peaks = _truth(light, bounding_box(target), where="the stack")
    best = float(np.mean(list(peaks.values())))
    crossings = focus_crossings(position, best)
    frame = float(crossings[0]) if crossings.size else float("nan")
    truth = Truth(position=best, frame=frame, target=target, in_focus=(min(peaks.values()), max(peaks.values())))
    return truth, {name: peak - best for name, peak in peaks.items()}


def describe_picture_truth(spec: StackSpec, optima: Mapping[str, float]) -> str:
    """Return as JSON how the truth of a photographed stack was found, in pictures and, if known, in µm."""
    steps, apart = spec.positions - 1, max(optima.values()) - min(optima.values())
    assert isinstance(spec.drive, PictureSteps)
    step_um = spec.drive.step_um
    facts = {
        "pictures": spec.positions,
        "step_um": step_um,
        "rule": f"mean of the peaks of {', '.join(MEASURES)} on the pictures, each of a parabola through three values",
        "peaks_apart_pictures": round(apart * steps, 4),
        "peaks_apart_um": None if step_um is None else round(apart * steps * step_um, 6),
    }
    return json.dumps(facts, ensure_ascii=False)


def _breathing(name: str, light: np.ndarray) -> Iterator[str]:
    """Yield a line if the magnification changes from the first picture to the last by what can be seen."""
    corner = hypot(*light.shape[1:]) / 2
    percent = 100 * (magnification(light) - 1)
    if (moved := abs(percent) / 100 * corner) > SEEN_PX:
        yield (
            f"{name}: its pictures {'grow' if percent > 0 else 'shrink'} by {abs(percent):.2g} % from the first to the "
            f"last, which moves their corners by {moved:.1f} pixels; they are taken as they are"
        )


def magnification(light: np.ndarray) -> float:
    """Return by what factor pictures (focus, row, col) are larger in the last one than in the first.

    From each to the next, a shift, a magnification, a change of brightness and one of sharpness are fitted.
    """
    from scipy.ndimage import gaussian_filter, laplace

    rows, columns = (np.arange(size) - (size - 1) / 2 for size in light.shape[1:])
    smooth = [gaussian_filter(picture / picture.mean(), SMOOTH_PX) for picture in light]
    factor = 1.0
    for before, after in pairwise(smooth):
        middle = (before + after) / 2
        down, right = np.gradient(middle)
        larger = -(rows[:, None] * down + columns * right)
        causes = np.stack([larger, down, right, middle, laplace(middle), np.ones_like(middle)], axis=-1)
        fitted, *_ = np.linalg.lstsq(causes.reshape(-1, causes.shape[-1]), (after - before).ravel(), rcond=None)
        factor *= 1 + float(fitted[0])
    return factor
