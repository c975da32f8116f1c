"""The bench of grain scene by scene: each in turn is handed on, and kept in a folder, as soon as it is measured.

All scenes take minutes. A run that was stopped goes on where it was: what is kept counts for the same code, scene,
sensor and numbers of samples alone.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import saf_gen
from saf_gen.acceptance.speed.bench_figure import BenchFigure, BenchSize
from saf_gen.core.files import check_folder_writable, write_text_atomically
from saf_gen.errors import BadInput, SafGenError
from saf_gen.scene.scene_folder import Scene, find_scene, scene_names

FORMAT = "saf-gen bench grain 1"
MOVING_WORK = 4  # work of a scene that moves over that of one at rest, roughly; only the time left depends on it


@dataclass(frozen=True)
class SceneFound:
    """What was found of a scene: figures, and remarks on what was left out.

    It is the ``number``-th of ``count`` scenes, from 1. ``seconds_left`` is about how long the others will take; None
    as long as nothing was measured from which to tell, because all so far was kept.
    """

    scene: str
    found: tuple[BenchFigure | str, ...]
    number: int
    count: int
    seconds_left: float | None


def bench_each_scene(
    size: BenchSize, *, measure: Callable[[BenchSize], Sequence[BenchFigure | str]], folder: Path | None = None
) -> Iterator[SceneFound]:
    """Yield what ``measure`` finds of each scene, or what an earlier run has kept of it in ``folder``.

    A scene that fails is left out, with a remark, and the others go on; the next run tries it again. Raises BadInput
    for a scene that is named but not known, a sensor that is not known, and a folder that cannot be written.
    """
    if folder is not None:
        check_folder_writable(folder)
    scenes = {name: _find(name, named=bool(size.scenes)) for name in size.scenes or scene_names()}
    identities = _identify(scenes, size)  # now, not when a scene is done: code may be edited meanwhile
    kept = {} if folder is None else _read_kept(folder, identities)
    work = {name: MOVING_WORK if scene and scene.card.slices_per_s else 1 for name, scene in scenes.items()}
    todo, begin, measured = [name for name in scenes if name not in kept], perf_counter(), 0
    for number, name in enumerate(scenes, 1):
        found = kept.get(name)
        if found is None:
            found = _measure_scene(replace(size, scenes=(name,)), measure)
            if folder is not None and any(isinstance(f, BenchFigure) and f.cell for f in found):
                _keep(folder / f"{name}.json", identities[name], found=found)
            measured += work[todo.pop(0)]
        left = sum(work[later] for later in todo)
        seconds = (perf_counter() - begin) / measured * left if measured else None
        yield SceneFound(name, found, number, len(scenes), seconds if left else 0.0)


def _find(name: str, *, named: bool) -> Scene | None:
    """Return a scene, or None for one that cannot be read and that nobody has asked for by name."""
    try:
        return find_scene(name)
    except BadInput:
        if named:
            raise
        return None


def _measure_scene(
    size: BenchSize, measure: Callable[[BenchSize], Sequence[BenchFigure | str]]
) -> tuple[BenchFigure | str, ...]:
    try:
        return tuple(measure(size))
    except SafGenError as error:
        return (f"grain: {size.scenes[0]} is left out: {error}",)


def _keep(path: Path, identity: str, *, found: Sequence[BenchFigure | str]) -> None:
    document = {"format": FORMAT, "of": identity, "found": [f if isinstance(f, str) else asdict(f) for f in found]}
    write_text_atomically(path, json.dumps(document, ensure_ascii=False, indent=1) + "\n")


def _read_kept(folder: Path, identities: Mapping[str, str]) -> dict[str, tuple[BenchFigure | str, ...]]:
    """Return what the folder holds of scenes as they are now, by name."""
    kept = {}
    for name, identity in identities.items():
        try:
            document = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
            if (document["format"], document["of"]) == (FORMAT, identity):
                kept[name] = tuple(f if isinstance(f, str) else _read_figure(f) for f in document["found"])
        except (OSError, ValueError, KeyError, TypeError):
            continue  # not there, or not written by this program: measured anew
    return kept


def _read_figure(figure: dict[str, Any]) -> BenchFigure:
    cell = figure.pop("cell")
    return BenchFigure(**figure, cell=None if cell is None else (cell[0], cell[1]))


def _identify(scenes: Mapping[str, Scene | None], size: BenchSize) -> dict[str, str]:
    """Return a digest, for each scene, of what decides its figures: the scene, the workload and this package's code."""
    from saf_gen.camera import get_sensor  # every process of a bench imports this module, and few need a camera

    workload = (get_sensor(size.sensor), size.positions[0], size.still_samples, size.slice_samples)
    package = Path(saf_gen.__file__).parent
    code = b"".join(path.read_bytes() for path in sorted(package.rglob("*.py")))
    identities = {}
    for name, scene in scenes.items():
        shown = scene and (scene.digest, scene.params, scene.card)  # a scene's own digest leaves out keys of its card
        identities[name] = hashlib.sha256(repr((shown, workload)).encode() + code).hexdigest()
    return identities
