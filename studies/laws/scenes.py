"""Scenes of the checks, as the content of scene folders: a glowing panel, edges, planes at known depths."""

import math
from collections.abc import Mapping, Sequence
from inspect import getsource
from textwrap import indent
from typing import Any

from saf_gen.camera.sensor import Sensor
from studies.laws.pupils import texture
from studies.laws.theory import charge_of_rate, charge_per_radiance
from studies.laws.workload import WrittenScene

FAR_M = 10.001
FLAT_LENS = {"focal_length_mm": 2000, "f_number": 2.8, "drive": "image_distance", "focus_range_m": [FAR_M, 9.999]}
"""A lens so long that cos⁴ and 1/v² are even to 10⁻⁵ over a sensor of 8 mm."""


def _write_scene(
    name: str,
    build: str,
    *,
    lens: Mapping[str, Any],
    lights: Mapping[str, Sequence[str]],
    target: Sequence[str],
    **card: Any,
) -> WrittenScene:
    """Return a scene whose lens is at the origin and looks along +z.

    ``build`` is the body of ``build(params)``, indented by four spaces; in it, ``t`` is Mitsuba's transform and ``np``
    is numpy.
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
    name: str, *, radiance: float, depth_m: float, half_m: float, lens: Mapping[str, Any]
) -> WrittenScene:
    """Return a scene with a panel across the axis that fills the view with an even radiance (W m⁻² sr⁻¹)."""
    build = f"""    return {{
        "panel": {{
            "type": "rectangle",
            "to_world": t.translate([0, 0, {depth_m}]).rotate([0, 1, 0], 180).scale({half_m}),
            "emitter": {{"type": "area", "radiance": {{"type": "rgb", "value": {float(radiance)!r}}}}},
        }}
    }}
"""
    return _write_scene(name, build, lens=lens, lights={"panel": ["panel"]}, target=["panel"])


def even_panel() -> WrittenScene:
    """Return a scene with a panel of 1 W m⁻² sr⁻¹ in front of FLAT_LENS."""
    return glowing_panel("even_panel", radiance=1.0, depth_m=10.0, half_m=2.0, lens=FLAT_LENS)


def gain_of_rate(rate: float, sensor: Sensor) -> float:
    """Return the gain at which the scene :func:`even_panel` makes a sensor fire at ``rate``.

    The lens is at position 0, and there is no dark signal. Position 0 is rendered, so no interpolation between
    positions is involved.
    """
    v = 2.0 * FAR_M / (FAR_M - 2.0)
    axis = charge_per_radiance(sensor, f_number=2.8, focal_length_m=2.0, image_distance_m=v, off_axis_m=0.0)
    return float(charge_of_rate(rate, sensor) / axis)


STILL_LENS: dict[str, Any] = {
    "focal_length_mm": 25,
    "f_number": 2.0,
    "drive": "image_distance",
    "focus_range_m": [0.505, 0.495],
}


def lit_chequers(
    name: str, *, lights: Mapping[str, Sequence[str]], lens: Mapping[str, Any] = STILL_LENS, chequers: int = 60
) -> WrittenScene:
    """Return a scene with a chequered plane 0.5 m from the lens, lit by a ``lamp`` next to the lens and a ``room``.

    ``chequers`` is the number of chequers along each side of the plane, which is 1 m.
    """
    build = """    def grey(value):
        return {"type": "rgb", "value": value}

    chequers = {
        "type": "checkerboard",
        "color0": grey(0.2),
        "color1": grey(0.7),
        "to_uv": mi.ScalarTransform4f().scale(CHEQUERS / 2),
    }
    return {
        "plane": {
            "type": "rectangle",
            "to_world": t.translate([0, 0, 0.5]).rotate([0, 1, 0], 180).scale(0.5),
            "bsdf": {"type": "diffuse", "reflectance": chequers},
        },
        "lamp": {
            "type": "rectangle",
            "to_world": t.translate([0.3, 0.2, -0.1]).scale(0.1),
            "emitter": {"type": "area", "radiance": grey(30.0)},
        },
        "room": {"type": "constant", "radiance": grey(1.0)},
    }
"""
    build = build.replace("CHEQUERS", str(chequers))
    return _write_scene(name, build, lens=lens, lights=lights, target=["plane"])


def glowing_edge(
    name: str, *, depth_m: float, edge_m: float, lens: Mapping[str, Any], turn_deg: float = 0.0
) -> WrittenScene:
    """Return a scene with a bright half plane on black; its edge is ``edge_m`` off the axis, turned by ``turn_deg``."""
    half = 0.5 * depth_m
    build = f"""    turned = t.rotate([0, 0, 1], {turn_deg}).translate([{edge_m + half}, 0, {depth_m}])
    return {{
        "glow": {{
            "type": "rectangle",
            "to_world": turned.rotate([0, 1, 0], 180).scale({half}),
            "emitter": {{"type": "area", "radiance": {{"type": "rgb", "value": 1.0}}}},
        }}
    }}
"""
    return _write_scene(name, build, lens=lens, lights={"glow": ["glow"]}, target=["glow"])


def glowing_stripes(
    name: str, *, places_m: Sequence[float], half_m: float, depth_m: float, lens: Mapping[str, Any]
) -> WrittenScene:
    """Return a scene of vertical glowing stripes on black, ``half_m`` to either side of each place (m) off the axis."""
    build = f"""    def stripe(x):
        return {{
            "type": "rectangle",
            "to_world": t.translate([x, 0, {depth_m}]).rotate([0, 1, 0], 180).scale([{half_m}, 0.2, 1]),
            "emitter": {{"type": "area", "radiance": {{"type": "rgb", "value": 1.0}}}},
        }}

    return {{f"stripe_{{n}}": stripe(x) for n, x in enumerate({list(places_m)})}}
"""
    names = [f"stripe_{n}" for n in range(len(places_m))]
    return _write_scene(name, build, lens=lens, lights={"glow": names}, target=names)


def glowing_texture(
    name: str, *, rows: int, columns: int, field_m: tuple[float, float], depth_m: float, lens: Mapping[str, Any]
) -> WrittenScene:
    """Return a scene with a glowing texture (:func:`studies.laws.pupils.texture`).

    Its one period is as wide and high (m) as ``field_m``, what the sensor sees at that depth.
    """
    make = indent(getsource(texture), "    ")
    build = f"""{make}
    return {{
        "glow": {{
            "type": "rectangle",
            "to_world": t.translate([0, 0, {depth_m}]).rotate([0, 1, 0], 180).scale(
                [{1.5 * field_m[0]}, {1.5 * field_m[1]}, 1]
            ),
            "emitter": {{
                "type": "area",
                "radiance": {{
                    "type": "bitmap",
                    "raw": True,
                    "filter_type": "bilinear",
                    "wrap_mode": "repeat",
                    "bitmap": mi.Bitmap(texture({rows}, {columns})[..., None]),
                    "to_uv": mi.ScalarTransform4f().scale([3, 3, 1]),
                }},
            }},
        }}
    }}
"""
    return _write_scene(name, build, lens=lens, lights={"glow": ["glow"]}, target=["glow"])


def strips_behind_bar(name: str, *, lens: Mapping[str, Any]) -> WrittenScene:
    """Return a scene with vertical strips at 0.55 m behind a vertical bar at 0.45 m, evenly lit; rows are alike."""
    build = """    def strip(left, right, depth, reflectance):
        place = t.translate([(left + right) / 2, 0, depth]).rotate([0, 1, 0], 180)
        return {
            "type": "rectangle",
            "to_world": place.scale([(right - left) / 2, 1, 1]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": reflectance}},
        }

    wide, greys = 0.004, [0.1, 0.7, 0.3, 0.9, 0.2, 0.6]
    wall = {f"strip_{n}": strip((n - 60) * wide, (n - 59) * wide, 0.55, greys[n % 6]) for n in range(120)}
    bar = {"bar": strip(-0.001, 0.002, 0.45, 0.5)}
    return wall | bar | {"room": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}}
"""
    return _write_scene(name, build, lens=lens, lights={"room": ["room"]}, target=["bar"])


def grey_planes(
    name: str, *, shapes: Mapping[str, str], target: Sequence[str], lens: Mapping[str, Any], **card: Any
) -> WrittenScene:
    """Return a scene with grey planes in even light.

    ``shapes`` maps the name of each plane to the transform, as source code, of a rectangle from −1 to 1 facing −z.
    """
    planes = "".join(f"        {name!r}: plane({where}),\n" for name, where in shapes.items())
    build = f"""    def plane(where):
        return {{
            "type": "rectangle",
            "to_world": where.rotate([0, 1, 0], 180),
            "bsdf": {{"type": "diffuse", "reflectance": {{"type": "rgb", "value": 0.5}}}},
        }}

    return {{
{planes}        "room": {{"type": "constant", "radiance": {{"type": "rgb", "value": 1.0}}}},
    }}
"""
    return _write_scene(name, build, lens=lens, lights={"room": ["room"]}, target=target, **card)


def striped_card(name: str, *, period_m: float, speed_m_per_s: float) -> WrittenScene:
    """Return a scene with a vertically striped card, 0.5 m from the lens in even light, that moves sideways for 1 s."""
    build = """    def grey(value):
        return {"type": "rgb", "value": value}

    # Along v the chequers are wider than the card: stripes are left.
    stripes = {
        "type": "checkerboard",
        "color0": grey(0.2),
        "color1": grey(0.8),
        "to_uv": mi.ScalarTransform4f().scale([1 / PERIOD, 0.4, 1]),
    }
    return {
        "card": {
            "type": "rectangle",
            "to_world": t.translate([0, 0, 0.5]).rotate([0, 1, 0], 180).scale(0.5),
            "bsdf": {"type": "diffuse", "reflectance": stripes},
        },
        "room": {"type": "constant", "radiance": grey(1.0)},
    }
"""
    keyframes = [{"time_s": 0.0}, {"time_s": 1.0, "translate_m": [speed_m_per_s, 0.0, 0.0]}]
    return _write_scene(
        name,
        build.replace("PERIOD", repr(float(period_m))),
        lens=STILL_LENS,
        lights={"room": ["room"]},
        target=["card"],
        motion={"card": {"keyframes": keyframes}},
        slices_per_s=100.0,
    )


def gratings(
    name: str,
    *,
    phase: bool,
    per_m: Sequence[float],
    amplitude: float,
    wave_m: float,
    condensers: Mapping[str, float],
    depth_m: float,
    lens: Mapping[str, Any],
) -> WrittenScene:
    """Return a thin section of vertical gratings, which delay light or absorb it, 0 at the height of the focus.

    Parameters
    ----------
    phase : bool
        Whether they delay light; otherwise they absorb it.
    per_m : sequence of float
        Frequencies, cycles per metre.
    amplitude : float
        Amplitude of each grating: radians, or the exponent of the wave.
    wave_m, depth_m : float
        Wavelength, and distance from the lens to the section, metres.
    condensers : mapping of str to float
        Coherence of each condenser, which is a light group of its own; all give the same light.
    """
    drawn = (
        f'"transmission": 1.0, "path_nm": {1e9 * wave_m / (2 * math.pi)} * {amplitude} * waves'
        if phase
        else f'"transmission": np.exp(2 * {amplitude} * (waves - {len(per_m)})), "path_nm": 0.0'
    )
    build = f"""    x = (np.arange(460) - 229.5) * 0.22e-6
    waves = sum(np.cos(2 * np.pi * f * x) for f in {list(per_m)}) * np.ones((260, 1))
    return {{{drawn}, "texel_um": 0.22}}
"""
    scene = _write_scene(
        name,
        "",
        lens=lens,
        lights={one: [one] for one in condensers},
        target=["section"],
        camera={"origin_m": [0.0, 0.0, depth_m], "look_at_m": [0.0, 0.0, 0.0]},
        section={
            "wavelength_nm": 1e9 * wave_m,
            "condensers": {
                one: {"coherence": coherence, "radiance": 50.0 / coherence**2} for one, coherence in condensers.items()
            },
        },
    )
    return WrittenScene(scene.card, build)  # without Mitsuba, which draws no sections
