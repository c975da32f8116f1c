"""Licence and source: may others use the scene, and is the origin of all its parts documented?"""

from collections.abc import Iterator

from saf_gen.authoring.checks._scene_finding import SceneFinding, scene_check_error, scene_check_ok, scene_check_warning
from saf_gen.errors import closest
from saf_gen.scene.scene_folder import Scene

OPEN = frozenset(
    {
        *("Apache-2.0", "MIT", "BSD-2-Clause", "BSD-3-Clause", "ISC", "Zlib", "0BSD", "Unlicense"),
        *("CC0-1.0", "CC-BY-3.0", "CC-BY-4.0", "CC-BY-SA-3.0", "CC-BY-SA-4.0", "ODbL-1.0", "PDDL-1.0"),
        *("GPL-2.0-only", "GPL-2.0-or-later", "GPL-3.0-only", "GPL-3.0-or-later", "LGPL-3.0-or-later"),
        *("MPL-2.0", "EUPL-1.2", "OFL-1.1", "FAL-1.3"),
    }
)
"""SPDX names of licences that let others use, change and redistribute a work (spdx.org/licenses)."""
PICTURES = frozenset({".png", ".jpg", ".jpeg", ".exr", ".hdr", ".tga", ".bmp", ".pfm"})
ASSETS = PICTURES | {".ply", ".obj", ".serialized", ".vol", ".spd", ".bsdf"}  # files whose authors must be named


def check_licence(scene: Scene) -> Iterator[SceneFinding]:
    """Check the card's ``licence`` and ``source``, and the file to which ``source`` refers."""
    licence, source = scene.card.licence.strip(), scene.card.source.strip()
    words = licence.replace("(", " ").replace(")", " ").split()
    names = [word for word in words if word not in ("AND", "OR", "WITH")]
    unknown_names = [name for name in names if name not in OPEN]
    if not names:
        yield scene_check_error(
            "licence", "licence is empty: write one in scene.yaml that lets others use the scene, such as CC-BY-4.0"
        )
    elif any("-NC" in name or "-ND" in name for name in unknown_names):
        yield scene_check_warning(
            "licence", f"{licence} forbids some uses or changes: datasets of this scene cannot be shared freely"
        )
    elif unknown_names:
        near = closest(unknown_names[0], OPEN)
        hint = f", did you mean {near}?" if near else ", such as CC-BY-4.0 or Apache-2.0"
        yield scene_check_warning("licence", f"{unknown_names[0]} is not the SPDX name of a known open licence{hint}")
    else:
        yield scene_check_ok("licence", licence)
    yield _check_source(scene, source)


def _check_source(scene: Scene, source: str) -> SceneFinding:
    assets = sorted(p.name for p in scene.folder.rglob("*") if p.suffix.lower() in ASSETS)
    content = "who made each mesh and texture, where it is from, its licence, and what was changed"
    if not source:
        return scene_check_error("source", f"source is empty: name SOURCE.md, and state in it {content}")
    if source.endswith((".md", ".txt")):
        path = scene.folder / source
        if not path.is_file():
            return scene_check_error("source", f"{source} does not exist: state in it {content}")
        if len(path.read_text(encoding="utf-8", errors="replace").split()) < 10:
            return scene_check_warning("source", f"{source} says too little: state in it {content}")
        return scene_check_ok("source", source)
    if assets:
        return scene_check_warning(
            "source", f"{assets[0]} has no documented origin: name SOURCE.md, and state in it {content}"
        )
    return scene_check_ok("source", source)
