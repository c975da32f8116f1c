"""Checks of a scene: each examines one aspect, and reports in one line what it found and what to do.

>>> for finding in check_scene(find_scene("camel"), get_sensor("vidar_400x250")):  # doctest: +SKIP
...     print(finding.level, finding.text)
"""

from collections.abc import Callable, Iterator

from saf_gen.authoring.checks.geometry import (
    check_family,
    check_motion,
    check_reach,
    check_units,
    implausible_unit,
    out_of_reach,
)
from saf_gen.authoring.checks.grain import check_grain
from saf_gen.authoring.checks.pictures import check_curve, check_detail, check_exposure, check_slices
from saf_gen.authoring.checks.repeat import check_repeat
from saf_gen.authoring.checks.subject import SceneUnderTest
from saf_gen.camera import Sensor
from saf_gen.core.finding import Finding
from saf_gen.errors import BadInput, closest
from saf_gen.scene.scene_folder import Scene

__all__ = [
    "SceneUnderTest",
    "check_curve",
    "check_detail",
    "check_exposure",
    "check_family",
    "check_grain",
    "check_motion",
    "check_reach",
    "check_repeat",
    "check_scene",
    "check_slices",
    "check_units",
]

CHECKS_OF_BUILT_SCENES: tuple[Callable[[SceneUnderTest], Iterator[Finding]], ...] = (
    check_repeat,
    check_units,
    check_reach,
    check_exposure,
    check_detail,
    check_curve,
    check_motion,
    check_slices,
    check_grain,
    check_family,
)


CHECKS_OF_SECTIONS: tuple[Callable[[SceneUnderTest], Iterator[Finding]], ...] = (
    check_repeat,
    check_units,
    check_reach,
    check_exposure,
    check_family,
)
"""Nothing in a thin section moves or is random."""


def check_scene(
    scene: Scene, sensor: Sensor, *, backend: str = "auto", progress: Callable[[float], None] = lambda done: None
) -> Iterator[Finding]:
    """Yield the findings of all checks as they are made.

    If a check cannot be completed, for example because the scene cannot be built, its finding is an error, and checks
    that need its result do not run.

    Parameters
    ----------
    scene : Scene
        Scene to check.
    sensor : Sensor
        Sensor for which the scene is checked.
    backend : {'auto', 'cuda', 'llvm', 'scalar'}, default 'auto'
        Backend of the renderer.
    progress : callable, optional
        Called with the fraction done, 0 to 1.

    Yields
    ------
    Finding
    """
    yield from check_licence(scene)
    subject = SceneUnderTest(scene, sensor, backend=backend)
    try:
        contents = subject.renderer.contents()
        yield Finding("geometry", "ok", f"{contents}, light groups {', '.join(scene.card.lights)}")
    except BadInput as problem:
        yield Finding("geometry", "error", str(problem))
        return
    progress(0.1)
    try:
        subject.true_focus  # noqa: B018
    except BadInput as problem:
        yield out_of_reach(subject, problem)
        return
    if wrong := implausible_unit(subject):
        yield wrong
        return
    checks = CHECKS_OF_BUILT_SCENES if scene.card.section is None else CHECKS_OF_SECTIONS
    for n, check in enumerate(checks, 1):
        try:
            yield from check(subject)
        except BadInput as problem:
            yield Finding(check.__name__.removeprefix("check_"), "error", str(problem))
        progress(0.1 + 0.9 * n / len(checks))


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


def check_licence(scene: Scene) -> Iterator[Finding]:
    """Check the card's ``licence`` and ``source``, and the file to which ``source`` refers."""
    licence, source = scene.card.licence.strip(), scene.card.source.strip()
    words = licence.replace("(", " ").replace(")", " ").split()
    names = [word for word in words if word not in ("AND", "OR", "WITH")]
    unknown_names = [name for name in names if name not in OPEN]
    if not names:
        yield Finding(
            "licence",
            "warning",
            "licence is empty: a dataset of this scene cannot be published until you write one in scene.yaml, such as "
            "CC-BY-4.0",
        )
    elif any("-NC" in name or "-ND" in name for name in unknown_names):
        yield Finding(
            "licence",
            "warning",
            f"{licence} forbids some uses or changes: datasets of this scene cannot be shared freely",
        )
    elif unknown_names:
        near = closest(unknown_names[0], OPEN)
        hint = f", did you mean {near}?" if near else ", such as CC-BY-4.0 or Apache-2.0"
        yield Finding("licence", "warning", f"{unknown_names[0]} is not the SPDX name of a known open licence{hint}")
    else:
        yield Finding("licence", "ok", licence)
    yield _check_source(scene, source)


def _check_source(scene: Scene, source: str) -> Finding:
    assets = sorted(p.name for p in scene.folder.rglob("*") if p.suffix.lower() in ASSETS)
    content = "who made each mesh and texture, where it is from, its licence, and what was changed"
    if not source:
        return Finding("source", "error", f"source is empty: name SOURCE.md, and state in it {content}")
    if source.endswith((".md", ".txt")):
        path = scene.folder / source
        if not path.is_file():
            return Finding("source", "error", f"{source} does not exist: state in it {content}")
        if len(path.read_text(encoding="utf-8", errors="replace").split()) < 10:
            return Finding("source", "warning", f"{source} says too little: state in it {content}")
        return Finding("source", "ok", source)
    if assets:
        return Finding(
            "source", "warning", f"{assets[0]} has no documented origin: name SOURCE.md, and state in it {content}"
        )
    return Finding("source", "ok", source)
