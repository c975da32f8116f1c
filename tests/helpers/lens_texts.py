"""Lens files of known content, in the formats of Zemax, optiland and DeepLens."""

import json

BICONVEX = ((50.0, 6.0, (1.5168, 64.17)), ("stop", 2.0, None), (-80.0, 60.0, None))
"""Radius ("stop" for a stop in air behind it), thickness to the next surface and glass of a made-up lens, mm."""
SINGLET = ((50.0, 6.0, (1.5168, 64.17)), (-80.0, 2.0, None), ("stop", 60.0, None))


def zemax_text(rows=SINGLET, *, system=(), drop=(), extra=None):
    """A .zmx file; ``extra`` gives further lines of surfaces by their number, ``drop`` words that are left out."""
    lines = [
        "MODE SEQ", "NAME Singlet", "UNIT MM X W X CM MR CPMM", "ENPD 12", "FTYP 0 0 1 3 0 0 0",
        "XFLN 0 0", "YFLN 0 5", "PWAV 2", "WAVM 1 0.4861327 1", "WAVM 2 0.5875618 1", "WAVM 3 0.6562725 1",
    ]  # fmt: skip
    lines = [line for line in lines if line.split()[0] not in drop] + list(system)
    lines += ["SURF 0", "  TYPE STANDARD", "  CURV 0", "  DISZ INFINITY"]
    for n, (radius, thickness, glass) in enumerate(rows, start=1):
        curvature = 0 if radius == "stop" else 1 / radius
        lines += [f"SURF {n}", "  TYPE STANDARD", f"  CURV {curvature!r}", f"  DISZ {thickness}"]
        lines += ["  STOP"] if radius == "stop" else []
        lines += [f"  GLAS ___BLANK 1 0 {glass[0]} {glass[1]}"] if glass else []
        lines += (extra or {}).get(n, [])
    lines += [f"SURF {len(rows) + 1}", "  TYPE STANDARD", "  CURV 0", "  DISZ 0"]
    return "\n".join(lines) + "\n"


def deeplens_data(rows=SINGLET):
    """What a DeepLens file of the same lens holds."""
    surfaces = []
    for radius, thickness, glass in rows:
        stop = radius == "stop"
        surface = {"type": "Stop" if stop else "Spheric", "r": 5.0 if stop else 10.0, "c": 0.0 if stop else 1 / radius}
        surface |= {"mat1": "air", "mat2": f"{glass[0]}/{glass[1]}" if glass else "air", "d_next": thickness}
        surfaces.append(surface if stop else surface | {"roc": radius})
    return {"info": "Singlet", "foclen": 60.0, "fnum": 5.0, "r_sensor": 5.0, "d_sensor": 68.0, "surfaces": surfaces}


def optiland_data(rows=SINGLET):
    """What an optiland file of the same lens holds."""

    def plain(z, kind, **more):
        place = {"x": 0.0, "y": 0.0, "z": z, "rx": 0.0, "ry": 0.0, "rz": 0.0, "reference_cs": None}
        return {"type": kind, "cs": place, **more}

    air = {"type": "IdealMaterial", "index": 1.0, "absorp": 0.0}
    surfaces = [{"type": "ObjectSurface", "geometry": plain(float("-inf"), "Plane"), "material_post": air}]
    z = 0.0
    for radius, thickness, glass in rows:
        stop = radius == "stop"
        shape = plain(z, "Plane") if stop else plain(z, "StandardGeometry", radius=radius, conic=0.0)
        material = {"type": "AbbeMaterial", "index": [glass[0]], "abbe": [glass[1]]} if glass else air
        model = {"type": "RefractiveReflectiveModel", "is_reflective": False}
        surfaces.append(
            {"type": "Surface", "thickness": thickness, "geometry": shape, "material_post": material, "is_stop": stop,
             "aperture": None, "interaction_model": model}
        )  # fmt: skip
        z += thickness
    surfaces.append({"type": "Surface", "geometry": plain(z, "Plane"), "material_post": air, "is_stop": False})
    waves = [
        {"value": value, "unit": "um", "is_primary": n == 1}
        for n, value in enumerate((0.4861327, 0.5875618, 0.6562725))
    ]
    return {
        "version": 1.0, "name": "Singlet", "aperture": {"type": "EPD", "value": 12.0},
        "fields": {"fields": [{"x": 0.0, "y": 0.0}, {"x": 0.0, "y": 5.0}], "field_type": "angle"},
        "wavelengths": {"wavelengths": waves}, "surface_group": {"surfaces": surfaces},
    }  # fmt: skip


def as_json(data):
    """The text of a JSON file."""
    return json.dumps(data)
