"""The bench ``grain``, scene by scene: the results of a scene are yielded and saved as soon as it has been measured.

All scenes together take minutes. An interrupted run is resumed from the saved results, which are used only for the same
code, scene, sensor and numbers of positions and samples.
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
from saf_gen.core.files import check_writable, write_text
from saf_gen.errors import BadInput, SafGenError
from saf_gen.scene.scene_folder import Scene, find_scene, scene_names

FORMAT = "saf-gen bench grain 1"
MOVING_WORK = 4  # rough ratio of the work for a moving and a still scene; only the estimated time left depends on it


@dataclass(frozen=True)
class SceneResult:
    """The results of the bench ``grain`` for one scene.

    Attributes
    ----------
    scene : str
        Name of the scene.
    found : tuple of BenchFigure or str
        Figures, and remarks on what was left out.
    number, count : int
        Number of this scene, from 1, and the number of all scenes.
    seconds_left : float or None
        Estimated time for the remaining scenes; None until a scene has been measured rather than read.
    """

    scene: str
    found: tuple[BenchFigure | str, ...]
    number: int
    count: int
    seconds_left: float | None


def bench_each_scene(
    size: BenchSize, *, measure: Callable[[BenchSize], Sequence[BenchFigure | str]], folder: Path | None = None
) -> Iterator[SceneResult]:
    """Yield the results of ``measure`` for each scene, or the results that an earlier run has saved in ``folder``.

    A scene that fails is left out, with a remark; the others continue, and the next run tries it again. Raises BadInput
    if a requested scene or the sensor is unknown, or if the folder cannot be written.
    """
    if folder is not None:
        check_writable(folder)
    scenes = {name: _find(name, named=bool(size.scenes)) for name in size.scenes or scene_names()}
    identities = _identify(scenes, size)  # now, because code may be edited before a scene is done
    saved = {} if folder is None else _read_saved_results(folder, identities)
    work = {name: MOVING_WORK if scene and scene.card.slices_per_s else 1 for name, scene in scenes.items()}
    todo, begin, measured = [name for name in scenes if name not in saved], perf_counter(), 0
    for number, name in enumerate(scenes, 1):
        found = saved.get(name)
        if found is None:
            found = _measure_scene(replace(size, scenes=(name,)), measure)
            if folder is not None and any(isinstance(f, BenchFigure) and f.cell for f in found):
                _save_result(folder / f"{name}.json", identities[name], found=found)
            measured += work[todo.pop(0)]
        left = sum(work[later] for later in todo)
        seconds = (perf_counter() - begin) / measured * left if measured else None
        yield SceneResult(name, found, number, len(scenes), seconds if left else 0.0)


def _find(name: str, *, named: bool) -> Scene | None:
    """Return a scene; None if it cannot be read and was not requested by name."""
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


def _save_result(path: Path, identity: str, *, found: Sequence[BenchFigure | str]) -> None:
    document = {"format": FORMAT, "of": identity, "found": [f if isinstance(f, str) else asdict(f) for f in found]}
    write_text(path, json.dumps(document, ensure_ascii=False, indent=1) + "\n")


def _read_saved_results(folder: Path, identities: Mapping[str, str]) -> dict[str, tuple[BenchFigure | str, ...]]:
    """Return the saved results, by scene, that are valid for the present scenes and code."""
    saved = {}
    for name, identity in identities.items():
        try:
            document = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
            if (document["format"], document["of"]) == (FORMAT, identity):
                saved[name] = tuple(f if isinstance(f, str) else _read_figure(f) for f in document["found"])
        except (OSError, ValueError, KeyError, TypeError):
            continue  # missing, or not written by this program: measured again
    return saved


def _read_figure(figure: dict[str, Any]) -> BenchFigure:
    cell = figure.pop("cell")
    return BenchFigure(**figure, cell=None if cell is None else (cell[0], cell[1]))


def _identify(scenes: Mapping[str, Scene | None], size: BenchSize) -> dict[str, str]:
    """Return, for each scene, a digest of what determines its figures: scene, workload and the code of saf_gen."""
    from saf_gen.camera import get_sensor  # every process of a bench imports this module, and few need a camera

    workload = (get_sensor(size.sensor), size.positions[0], size.still_samples, size.slice_samples)
    package = Path(saf_gen.__file__).parent
    code = b"".join(path.read_bytes() for path in sorted(package.rglob("*.py")))
    identities = {}
    for name, scene in scenes.items():
        shown = scene and (scene.digest, scene.params, scene.card)  # the digest of a scene leaves out keys of its card
        identities[name] = hashlib.sha256(repr((shown, workload)).encode() + code).hexdigest()
    return identities
