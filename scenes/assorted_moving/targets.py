"""Targets that are two largest blurs wide however far the lens travels, and how large the largest blur is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import layouts
import numpy as np
from sight import FRAME_PX, PIXEL_MM, Sight

MOST_PX = FRAME_PX - 2 * layouts.RIM_PX  # of a target within the frame
SPARE_PX = 3.0  # that a target of layouts has over two blurs


def largest_blur_px(lens: Mapping[str, Any], sight: Sight) -> float:
    """Largest diameter (pixels) over the travel of the blur of the target's middle, c = 2R·v·\\|1/u_o - 1/u\\|.

    By the keys of a scene card. The blur is largest at an end of the travel: it is linear in the position, or for a
    stage larger the nearer the target.
    """
    drive, share = lens["drive"], max(sight.place, 1 - sight.place)
    f = lens["image_distance_mm" if drive == "focal_length" else "focal_length_mm"]
    wide = f / lens["f_number"]
    if drive == "stage":
        image, ends = f * (1 + lens["magnification"]), (1e3 * np.asarray(lens["travel_m"]))
        near = sight.away - max(ends)
        far = sight.away - min(ends)
        return float(wide * image * max(abs(1 / u - 1 / sight.focused) for u in (near, far)) / PIXEL_MM)
    first, last = (1e3 * m for m in lens["focus_range_m"])
    if drive == "focal_length":
        return float(wide * f * share * abs(1 / first - 1 / last) / PIXEL_MM)
    ends = [1 / (1 / f - 1 / u) for u in (first, last)]
    return float(wide * share * abs(ends[1] - ends[0]) * (1 / f - 1 / sight.focused) / PIXEL_MM)


def target(params: dict[str, Any], sight: Sight, random: np.random.Generator) -> layouts.Target:
    """A target of :mod:`layouts` whose box is at least two largest blurs wide and high.

    While the lens is anywhere in its travel, the disc of a pixel in the middle of the box therefore reaches half way to
    its rim: what surrounds the target does not reach its middle. A target that needs more than the frame goes beyond
    it on all sides, so that the travel and the place of the focus stay independent.
    """
    share = max(sight.place, 1 - sight.place)
    fits = sight._replace(travel=min(sight.travel, (0.92 * MOST_PX - SPARE_PX) / (2 * share)))
    made = layouts.target(params, fits, random)
    scale = max(2 * largest_blur_px(params["lens"], sight) / min(made.size), 1.0)
    wide, high = (scale * n for n in made.size)
    spare = [(MOST_PX - n) / 2 if n < MOST_PX else max((n - FRAME_PX) / 2, 0.0) for n in (wide, high)]
    x, y = (float(random.uniform(-1, 1) * n) for n in spare)
    if scale == 1.0:
        return made
    wider = {name: scale * getattr(made, name) for name in ("x", "y", "s", "t")}
    return made._replace(**wider, centre=(x, y), size=(wide, high))


def notched(made: layouts.Target) -> float:
    """Share of the target's part in the frame that its missing corner takes, 0 to 1."""
    x, y = ((n[1:, 1:] + n[:-1, :-1]) / 2 + c for n, c in zip((made.x, made.y), made.centre, strict=True))
    inside = (np.abs(x) < FRAME_PX / 2) & (np.abs(y) < FRAME_PX / 2)
    return float(made.notch[inside].mean())
