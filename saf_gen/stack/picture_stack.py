"""Stacks of photographed scenes: pictures of another camera at equal steps of the focus, as a sensor sees them.

The sensor sees the largest centred part of the pictures that has its shape, and each of its pixels the mean of what is
below it. The light is that of the pictures, decoded, in a unit that only the exposure of a recording makes good.

Where such a stack is in focus is decided by a rule and not by optics, which nobody knows: it is the mean of the peaks
of three focus measures of different kinds in the box of the target, each the vertex of the parabola through the largest
value and its neighbours. Variance (``sd``) weighs all scales alike, gradients (``tenengrad``) the finest, and the
autocorrelation (``vollath_f4``) leaves out what differs from pixel to pixel, the noise of the pictures. Where the
target has relief, or its blur differs before and behind the focus, they differ: their range is the uncertainty.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.camera import Sensor
from saf_gen.core.region import Region, bounding_box
from saf_gen.errors import BadInput
from saf_gen.optics import PictureSteps
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.scene.picture_card import MIN_PICTURES, PictureCard, PictureScene
from saf_gen.scene.scene_folder import load_any_scene
from saf_gen.stack.focal_stack import PICTURES, StackSpec, StackStore
from saf_gen.stack.noise_free import COUNTS, score_picture
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stream.metadata import Truth
from saf_gen.stream.optima import curve_peak

MEASURES = ("sd", "tenengrad", "vollath_f4")
MIN_BOX = 16
"""Smallest number of the target's rows and columns on the sensor."""


@dataclass(frozen=True)
class PictureStack:
    """The pictures of a photographed scene in front of a sensor, read and checked once.

    Attributes
    ----------
    scene : PictureScene
        The scene.
    shape : tuple of int
        Rows and columns of the sensor.
    count : int
        Number of pictures.
    remark : str
        What a user should know, in a line.
    """

    scene: PictureScene
    shape: tuple[int, int]
    count: int
    remark: str

    @property
    def id(self) -> str:
        return self.scene.id

    @property
    def card(self) -> PictureCard:
        return self.scene.card

    def with_params(self, chosen: Mapping[str, Any]) -> "PictureStack":
        """Return this stack, which has no parameters."""
        return self

    def spec(self, sensor: Sensor) -> StackSpec:
        """Return what determines the stack in front of a sensor of its shape."""
        rows, columns = self.shape
        return StackSpec(
            scene=self.id, scene_digest=self.scene.digest, groups=self.card.lights,
            drive=PictureSteps(self.card.pictures.step_um), rows=rows, columns=columns, pitch_m=sensor.pitch_m,
            positions=self.count, samples=1, max_depth=1, estimator=PICTURES,
        )  # fmt: skip

    def take_in(self, spec: StackSpec, root: Path) -> list[str]:
        """Store the pictures as a focal stack under ``root``, if they are not there, and return the names of pieces.

        Raises BadInput if the pictures are no longer those that were checked.
        """
        store, folder = StackStore(root, spec), self.scene.folder
        if not (missing := store.missing_pieces()):
            return []
        if load_any_scene(folder).digest != self.scene.digest:
            raise BadInput("the pictures have changed", where=str(folder), hint="run saf-gen generate again")
        light, target = _seen(self.scene, self.shape)
        store.write_geometry(np.full(self.shape, np.nan, np.float32), target, backend=PICTURES)
        store.write_group(self.card.lights[0], light, backend=PICTURES)
        return missing


def read_picture_stack(scene: PictureScene, shape: tuple[int, int]) -> PictureStack:
    """Read and check all pictures of a scene in front of a sensor with these rows and columns.

    Raises BadInput if the pictures are fewer than three or smaller than the sensor, if one is black, if the box is not
    on the sensor, or too small, or if a measure has no peak between the first picture and the last.
    """
    light, target = _seen(scene, shape)
    truth = _truth(light, bounding_box(target), where=f"scene {scene.id!r}")
    step_um, last = scene.card.pictures.step_um, len(light) - 1
    steps = "whose steps are not known" if step_um is None else f"{step_um:g} µm apart"
    named = ", ".join(f"{name} {at * last:.2f}" for name, at in truth.items())
    remark = (
        f"{scene.id}: {len(light)} pictures, {steps}; no depth of focus; in picture {named} (from 0) it is sharpest"
    )
    return PictureStack(scene, shape, len(light), remark)


def _seen(scene: PictureScene, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the light that a sensor of ``shape`` sees, float32 (focus, row, col), and the target, bool (row, col)."""
    where, planes, size = str(scene.folder), list[np.ndarray](), (0, 0)
    for picture in scene.read_pictures():
        size = picture.shape
        scale = min(have / need for have, need in zip(size, shape, strict=True))
        if scale < 1:
            raise BadInput(
                f"its pictures have {size[1]} × {size[0]} pixels", where=where,
                allowed=f"at least the {shape[1]} × {shape[0]} of the sensor",
                hint="name a sensor file with a smaller array",
            )  # fmt: skip
        edges = [
            (have - scale * need) / 2 + scale * np.arange(need + 1) for have, need in zip(size, shape, strict=True)
        ]
        planes.append(_average(_average(picture, edges[0]).T, edges[1]).T.astype(np.float32))
        if not planes[-1].any():
            raise BadInput("a picture is black", where=where, allowed="pictures with light")
    if len(planes) < MIN_PICTURES:
        raise BadInput(f"has {len(planes)} pictures", where=where, allowed=f"at least {MIN_PICTURES}")
    left, top, columns, rows = box = scene.card.pictures.box or (0, 0, size[1], size[0])
    inside = [(first < (e[:-1] + e[1:]) / 2) & ((e[:-1] + e[1:]) / 2 < first + length) for e, first, length in
              ((edges[0], top, rows), (edges[1], left, columns))]  # fmt: skip
    seen = [int(axis.sum()) for axis in inside]
    if min(left, top) < 0 or left + columns > size[1] or top + rows > size[0] or min(seen) < MIN_BOX:
        first, last = ([round(float(e[n])) for e in edges] for n in (0, -1))
        raise BadInput(
            f"box is {list(box)}, of which the sensor sees {seen[1]} × {seen[0]} pixels", where=where,
            allowed=f"left, top, columns, rows in columns {first[1]} to {last[1]} and rows {first[0]} to {last[0]}, "
            f"at least {MIN_BOX} × {MIN_BOX} of its pixels, which are {scale:.3g} wide",
        )  # fmt: skip
    return np.stack(planes), np.outer(*inside)


def _average(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the means along the first axis between edges, which may lie within a row, float64."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0, dtype=np.float64)])
    low = np.clip(edges.astype(int), 0, len(values) - 1)
    part = (edges - low)[:, None]
    return np.diff(total[low] + part * (total[low + 1] - total[low]), axis=0) / np.diff(edges)[:, None]


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
