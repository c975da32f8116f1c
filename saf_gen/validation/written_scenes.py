"""The scenes of the checks: a glowing panel, edges, planes at known depths; each as the two files of its folder."""

from collections.abc import Mapping, Sequence
from typing import Any

from saf_gen.validation.workload import WrittenScene

FLAT_LENS = {"focal_length_mm": 2000, "f_number": 2.8, "drive": "image_distance", "focus_range_m": [12.0, 9.0]}
"""A lens so long that over a sensor of 8 mm cos⁴ and 1/v² are even to 10⁻⁵."""


def write_scene(
    name: str,
    build: str,
    *,
    lens: Mapping[str, Any],
    lights: Mapping[str, Sequence[str]],
    target: Sequence[str],
    **card: Any,
) -> WrittenScene:
    """Return a scene; the lens is at the origin and looks along +z.

    ``build`` is what ``build(params)`` does, indented by four; ``t`` in it is Mitsuba's transform, ``np`` numpy.
    """
    keys = {
        "id": name,
        "title": f"{name.replace('_', ' ').capitalize()}, for validation",
        "licence": "Apache-2.0",
        "source": "made here",
        "camera": {"origin_m": [0.0, 0.0, 0.0], "look_at_m": [0.0, 0.0, 1.0]},
        "lens": dict(lens),
        "lights": {group: list(lamps) for group, lamps in lights.items()},
        "target": list(target),
    }
    return WrittenScene(keys | card, f"    t = mi.ScalarTransform4f()\n{build}")


def glowing_panel(
    name: str, *, radiance: float | Mapping[str, float], depth_m: float, half_m: float, lens: Mapping[str, Any]
) -> WrittenScene:
    """Return a panel across the axis that fills the view and sends the same radiance (W m⁻² sr⁻¹) everywhere.

    For a mapping there is one light group for each name: a panel of its own, the nearest first, and all but the last
    are masks of opacity 0 that send light.
    """
    groups = {"panel": radiance} if not isinstance(radiance, Mapping) else radiance
    shapes = "".join(
        f"        {group!r}: {{'type': 'rectangle',"
        f" 'to_world': t.translate([0, 0, {depth_m}]).rotate([0, 1, 0], 180).scale({half_m}),"
        f" 'emitter': {{'type': 'area', 'radiance': {{'type': 'rgb', 'value': {value!r}}}}}}},\n"
        for group, value in groups.items()
    )
    return write_scene(
        name,
        f"    return {{\n{shapes}    }}\n",
        lens=lens,
        lights={group: [group] for group in groups},
        target=[next(iter(groups))],
    )
