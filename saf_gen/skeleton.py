"""A scene of one's own, begun: a commented skeleton that renders at once, or an exported scene."""

import json
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from saf_gen.errors import BadInput
from saf_gen.scene import scene_at, scene_names
from saf_gen.scene_xml import read_scene_xml

if TYPE_CHECKING:
    from saf_gen.render.camera_of import Camera

__all__ = ["KINDS", "new_scene", "take_over"]

KINDS = ("script", "xml")
_TEMPLATES = Path(__file__).parent / "skeletons"
NAME = re.compile(r"[a-z0-9][a-z0-9_]*")


def new_scene(name: str, root: Path, *, kind: str = "script") -> list[Path]:
    """Write a skeleton to ``root/name``; ``kind`` is script (scene.py) or xml (scene.xml). Gives its files.

    Raises BadInput for a name that no scene can have, and for one that is taken.
    """
    folder = _free(name, root)
    template = _TEMPLATES / kind
    written = []
    for source in sorted(p for p in template.rglob("*") if p.is_file()):
        target = folder / source.relative_to(template).as_posix().removesuffix(".in")
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.suffix in (".png", ".obj"):
            shutil.copyfile(source, target)
        else:
            text = source.read_text(encoding="utf-8")
            target.write_text(re.sub(r"\bNAME\b", name, text), encoding="utf-8")
        written.append(target)
    return written


def take_over(exported: Path, name: str, root: Path) -> list[Path]:
    """Copy an exported scene and the files it names to ``root/name``, and write its card. Gives its files.

    The card's camera is the first that the file has; its lens sees the same field; its target is the shape
    in the middle of the picture; every lamp is a light group of its own.

    Raises BadInput as reading the scene does, where it has no camera, lamp, or nothing in the middle.
    """
    read = read_scene_xml(exported, {})
    folder = _free(name, root)
    from saf_gen.render.camera_of import camera_of  # loads Mitsuba

    seen = camera_of(read, exported)
    base = exported.parent.resolve()
    written = []
    for source in (exported.resolve(), *read.files):
        target = folder / ("scene.xml" if source == exported.resolve() else source.relative_to(base))
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
        written.append(target)
    texts = {"scene.yaml": _card(name, seen), "SOURCE.md": (_TEMPLATES / "xml" / "SOURCE.md").read_text()}
    for file, text in texts.items():
        (folder / file).write_text(re.sub(r"\bNAME\b", name, text), encoding="utf-8")
        written.append(folder / file)
    scene_at(folder)  # what was written is a scene
    return written


def _free(name: str, root: Path) -> Path:
    if not NAME.fullmatch(name):
        near = re.sub(r"[^a-z0-9_]+", "_", name.lower()).strip("_")
        raise BadInput(
            f"a scene cannot be called {name!r}",
            allowed="lower-case letters, digits and _, a letter or digit first",
            nearest=near if NAME.fullmatch(near) else "",
        )
    folder = root / name
    if folder.exists():
        raise BadInput(f"{folder} is there already", hint="choose another name, or remove it")
    if name in scene_names():
        raise BadInput(
            f"there is a scene {name!r} already", hint="choose another name: see saf-gen scenes list"
        )
    return folder


def _card(name: str, seen: "Camera") -> str:
    def vector(metres: tuple[float, ...]) -> str:
        return "[" + ", ".join(f"{round(x, 9) + 0.0:.6g}" for x in metres) + "]"

    def quoted(name: str) -> str:
        return name if re.fullmatch(r"[A-Za-z][\w.-]*", name) else json.dumps(name, ensure_ascii=False)

    far, near = 1.5 * seen.distance_m, 0.75 * seen.distance_m
    lights = "".join(f"  {group}: [{quoted(emitter)}]\n" for group, emitter in seen.lights.items())
    return f"""\
id: {name}
title: {name.replace("_", " ").capitalize()}, exported
licence: CC-BY-4.0                           # an SPDX name: may others use it?
source: SOURCE.md                            # where everything came from

camera:                                      # the file's own {seen.name}
  origin_m: {vector(seen.origin_m)}
  look_at_m: {vector(seen.look_at_m)}
  up: {vector(seen.up)}

lens:                                        # the field of the file's camera on 400 pixels of 20 µm
  drive: image_distance
  focal_length_mm: {seen.focal_length_mm:.4g}
  f_number: {seen.f_number:.3g}
  focus_range_m: [{far:.4g}, {near:.4g}]             # in focus at position 0 and at 1

lights:                                      # lamps that are switched together
{lights}
target: [{quoted(seen.target)}]                  # the shape in the middle of the picture
"""
