"""From a scene folder to a Mitsuba scene with one light group burning."""

import importlib.util
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mitsuba as mi

from saf_gen.errors import BadInput, unknown
from saf_gen.scene import Scene

__all__ = ["build", "camera_to_world", "load"]


def build(scene: Scene) -> dict[str, Any]:
    """Run the folder's ``build(params)`` and check it against the card.

    Returns the Mitsuba dictionary, every light group in it.
    Raises BadInput where the script fails, or names on the card are absent from what it built.
    """
    described = _run(scene)
    emitters = [name for name, entry in described.items() if _emits(entry)]
    shapes = [name for name, entry in described.items() if _kind(entry) not in (None, "scene")]
    card = str(scene.folder / "scene.yaml")
    for group, names in scene.card.lights.items():
        for name in names:
            if name not in emitters:
                raise unknown(f"emitter of light group {group!r}:", name, emitters, where=card)
    for name in scene.card.target:
        if name not in described:
            raise unknown("target shape", name, shapes, where=card)
    listed = {name for names in scene.card.lights.values() for name in names}
    for name in emitters:
        if name not in listed:
            raise BadInput(
                f"the emitter {name!r} belongs to no light group", where=card, hint="name it under lights"
            )
    return described


def load(described: Mapping[str, Any], burning: tuple[str, ...], max_depth: int) -> tuple[Any, Any]:
    """The Mitsuba scene with only these emitters, and the integrator to trace it.

    The other emitters are left out, not dimmed: none of the samples is then spent on a dark lamp. Their
    shapes stay and go on casting shadows.
    """
    lit = {name: _without_light(entry, name in burning) for name, entry in described.items()}
    lit = {name: entry for name, entry in lit.items() if entry is not None}
    try:
        loaded = mi.load_dict({"type": "scene", **lit}, optimize=False)
    except (RuntimeError, ValueError, TypeError, KeyError) as error:
        raise BadInput(f"Mitsuba cannot load the scene: {error}") from error
    integrator = mi.load_dict({"type": "path", "max_depth": max_depth, "hide_emitters": False})
    return loaded, integrator


def camera_to_world(scene: Scene) -> Any:
    """Transform of camera space (looking along +z, x to the left) to the world."""
    pose = scene.card.camera
    return mi.ScalarTransform4f().look_at(
        origin=list(pose.origin_m), target=list(pose.look_at_m), up=list(pose.up)
    )


def _kind(entry: Any) -> str | None:
    return entry.get("type") if isinstance(entry, dict) else None


def _emits(entry: Any) -> bool:
    if isinstance(entry, mi.Emitter):
        return True
    if not isinstance(entry, dict):
        return isinstance(entry, mi.Shape) and entry.is_emitter()
    return _is_emitter(entry) or any(_is_emitter(part) for part in entry.values())


EMITTERS = (
    "area",
    "constant",
    "envmap",
    "point",
    "spot",
    "directional",
    "directionalarea",
    "projector",
    "sunsky",
)


def _is_emitter(entry: Any) -> bool:
    return _kind(entry) in EMITTERS or isinstance(entry, mi.Emitter)


def _without_light(entry: Any, burning: bool) -> Any:
    """The entry as it is when it burns; else its shape without the lamp in it, or nothing."""
    if burning or not _emits(entry):
        return entry
    if _is_emitter(entry):
        return None
    if not isinstance(entry, dict):
        raise BadInput(
            f"the shape {entry.id()!r} was made with its emitter inside",
            hint="give it as a dictionary with an emitter entry, so that its light can be turned off",
        )
    dark = {key: part for key, part in entry.items() if not _is_emitter(part)}
    if not any(_is_bsdf(part) for part in dark.values()):
        # Mitsuba makes a lamp without a surface of its own black, any other such shape grey.
        dark["bsdf"] = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    return dark


def _is_bsdf(part: Any) -> bool:
    if _kind(part) in (None, "ref"):
        return isinstance(part, mi.BSDF) or _kind(part) == "ref"
    return isinstance(mi.load_dict(part), mi.BSDF)


def _run(scene: Scene) -> dict[str, Any]:
    script = scene.folder / "scene.py"
    spec = importlib.util.spec_from_file_location(f"saf_gen_scene_{scene.id}", script)
    if spec is None or spec.loader is None:
        raise BadInput(f"{script} cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    with _on_path(scene.folder):
        try:
            spec.loader.exec_module(module)
            described = module.build(dict(scene.card.params))
        except BadInput:
            raise
        except Exception as error:  # a scene is anybody's code: whatever it raises is told in one line
            raise BadInput(f"{script} failed: {type(error).__name__}: {error}") from error
    if not isinstance(described, dict):
        raise BadInput(f"build() of {script} gave {type(described).__name__}", allowed="a Mitsuba dictionary")
    return {name: entry for name, entry in described.items() if name != "type"}


@contextmanager
def _on_path(folder: Path) -> Iterator[None]:
    """Lets scene.py import its neighbours, and forgets them after, so that two scenes never mix."""
    before = set(sys.modules)
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in set(sys.modules) - before:
            origin = getattr(sys.modules[name], "__file__", None)
            if origin and Path(origin).parent == folder:
                del sys.modules[name]
