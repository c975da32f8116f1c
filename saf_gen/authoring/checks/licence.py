"""Licence and source: may others use this, and do they know where it is from?"""

from collections.abc import Iterator

from saf_gen.authoring.checks._scene_finding import SceneFinding, error, ok, warning
from saf_gen.errors import closest
from saf_gen.scene.scene_folder import Scene

__all__ = ["check_licence"]

OPEN = frozenset(
    {
        *("Apache-2.0", "MIT", "BSD-2-Clause", "BSD-3-Clause", "ISC", "Zlib", "0BSD", "Unlicense"),
        *("CC0-1.0", "CC-BY-3.0", "CC-BY-4.0", "CC-BY-SA-3.0", "CC-BY-SA-4.0", "ODbL-1.0", "PDDL-1.0"),
        *("GPL-2.0-only", "GPL-2.0-or-later", "GPL-3.0-only", "GPL-3.0-or-later", "LGPL-3.0-or-later"),
        *("MPL-2.0", "EUPL-1.2", "OFL-1.1", "FAL-1.3"),
    }
)
"""SPDX names of licences that let others use, change and pass on what they get (spdx.org/licenses)."""
PICTURES = frozenset({".png", ".jpg", ".jpeg", ".exr", ".hdr", ".tga", ".bmp", ".pfm"})
OUTSIDE = PICTURES | {".ply", ".obj", ".serialized", ".vol", ".spd", ".bsdf"}  # files that somebody made


def check_licence(scene: Scene) -> Iterator[SceneFinding]:
    """The card's ``licence`` and ``source``, and the file that it names."""
    licence, source = scene.card.licence.strip(), scene.card.source.strip()
    parts = licence.replace("(", " ").replace(")", " ").split()
    names = [part for part in parts if part not in ("AND", "OR", "WITH")]
    strange = [name for name in names if name not in OPEN]
    if not names:
        yield error("licence", "licence is empty: name one that lets others use the scene, such as CC-BY-4.0")
    elif any("-NC" in name or "-ND" in name for name in strange):
        yield warning(
            "licence", f"{licence} forbids some uses or changes: datasets of it cannot be shared freely"
        )
    elif strange:
        near = closest(strange[0], OPEN)
        hint = f", did you mean {near}?" if near else ", such as CC-BY-4.0 or Apache-2.0"
        yield warning("licence", f"{strange[0]} is no SPDX name of an open licence that is known here{hint}")
    else:
        yield ok("licence", licence)
    yield _source(scene, source)


def _source(scene: Scene, source: str) -> SceneFinding:
    outside = sorted(p.name for p in scene.folder.rglob("*") if p.suffix.lower() in OUTSIDE)
    told = "who made each mesh and texture, where it is from, under which licence, what was changed"
    if not source:
        return error("source", f"source is empty: name SOURCE.md, and write in it {told}")
    if source.endswith((".md", ".txt")):
        path = scene.folder / source
        if not path.is_file():
            return error("source", f"{source} does not exist: write in it {told}")
        if len(path.read_text(encoding="utf-8", errors="replace").split()) < 10:
            return warning("source", f"{source} says hardly anything: write in it {told}")
        return ok("source", source)
    if outside:
        return warning("source", f"{outside[0]} is not explained: name SOURCE.md, and write in it {told}")
    return ok("source", source)
