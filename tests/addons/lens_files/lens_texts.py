"""Lens files of known content: those that come with saf_gen, and made-up ones of Zemax and tables of surfaces."""

from pathlib import Path

import saf_gen

LENSES = Path(saf_gen.__file__).parent / "addons/lens_files/lenses"
"""The surfaces of the lenses that come with saf_gen, a .zmx file each."""

BICONVEX = ((50.0, 6.0, (1.5168, 64.17)), ("stop", 2.0, None), (-80.0, 60.0, None))
"""Radius ("stop" for a stop in air behind it), thickness to the next surface and glass of a made-up lens, mm."""
SINGLET = ((50.0, 6.0, (1.5168, 64.17)), (-80.0, 2.0, None), ("stop", 60.0, None))


def zemax_text(rows=SINGLET, *, system=(), drop=(), extra=None):
    """A .zmx file; ``extra`` gives further lines of surfaces by their number, ``drop`` words that are left out."""
    lines = [
        "MODE SEQ", "NAME Singlet", "UNIT MM X W X CM MR CPMM", "ENPD 12", "FTYP 0 0 2 3 0 0 0",
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


def table_text(rows=SINGLET):
    """A table of the surfaces of the same lens."""
    lines = ["name: Singlet", "f_number: 4.5", "height_mm: 5", "waves_nm: [486.1327, 656.2725]", "primary_nm: 587.5618"]
    lines.append("surfaces:")
    for radius, thickness, glass in rows:
        more = ", stop: true" if radius == "stop" else ""
        more += f", glass: [{glass[0]}, {glass[1]}]" if glass else ""
        lines.append(f"- {{radius_mm: {'flat' if radius == 'stop' else radius}, thickness_mm: {thickness}{more}}}")
    return "\n".join(lines) + "\n"
