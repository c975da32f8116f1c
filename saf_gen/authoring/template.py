"""A scene of one's own, begun: a commented skeleton that renders at once, or an exported scene."""

import json
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from saf_gen.core.files import unwritable_error
from saf_gen.errors import BadInput
from saf_gen.scene.scene_folder import load_scene_folder, scene_names
from saf_gen.scene.xml import SceneXml, read_scene_xml

if TYPE_CHECKING:
    from saf_gen.render.exported_camera import ExportedCamera

__all__ = ["TEMPLATE_KINDS", "create_scene", "import_exported_scene"]

TEMPLATE_KINDS = ("script", "xml")
_TEMPLATES = Path(__file__).parent / "templates"
NAME = re.compile(r"[a-z0-9][a-z0-9_]*")
OWN = ("scene.xml", "scene.yaml", "scene.py", "SOURCE.md")
NOT_TEXT = frozenset("y n yes no on off true false null".split())  # noqa: SIM905  what YAML takes for something else


def create_scene(name: str, root: Path, *, kind: str = "script") -> list[Path]:
    """Write a skeleton to ``root/name``; ``kind`` is script (scene.py) or xml (scene.xml). Gives its files.

    Raises BadInput for a name that no scene can have, and for one that is taken.
    """
    template = _TEMPLATES / kind
    written = []
    with _begun(name, root) as folder:
        for source in sorted(p for p in template.rglob("*") if p.is_file()):
            file = source.relative_to(template).as_posix().removesuffix(".in")
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            if source.suffix in (".png", ".obj"):
                shutil.copyfile(source, folder / file)
            else:
                text = source.read_text(encoding="utf-8")
                (folder / file).write_text(re.sub(r"\bNAME\b", name, text), encoding="utf-8")
            written.append(root / name / file)
    return written


def import_exported_scene(exported: Path, name: str, root: Path) -> list[Path]:
    """Copy an exported scene and the files it names to ``root/name``, and write its card. Gives its files.

    Files keep the names that the scene calls them by; links are followed. The card's camera is the first that
    the file has; its lens sees the same field; its target is the shape in the middle of the picture; every
    lamp is a light group of its own.

    Raises BadInput as reading the scene does, where it has no camera, lamp, or nothing in the middle, and
    where no card can have its camera. Nothing is left then.
    """
    read = read_scene_xml(exported, {})
    with _begun(name, root) as folder:
        from saf_gen.render.exported_camera import read_exported_camera  # loads Mitsuba

        texts = {
            "scene.yaml": _card(name, read_exported_camera(read, exported)),
            "SOURCE.md": (_TEMPLATES / "xml" / "SOURCE.md").read_text(encoding="utf-8"),
        }
        sources = _sources(read, exported)
        for file, source in sources.items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, folder / file)
        for file, text in texts.items():
            (folder / file).write_text(re.sub(r"\bNAME\b", name, text), encoding="utf-8")
        try:
            load_scene_folder(folder)  # what was written is a scene
        except BadInput as refused:
            raise BadInput(
                f"no card can have this camera: {refused.problem}",
                where=str(exported),
                allowed=refused.allowed,
                hint="change the camera and export again, or write the card by hand",
            ) from refused
    return [root / name / file for file in (*sources, *texts)]


def _sources(read: SceneXml, exported: Path) -> dict[str, Path]:
    """Where each file of the copy comes from."""
    sources = {"scene.xml": exported}
    for file, source in read.files:
        if file in OWN or sources.setdefault(file, source) != source:
            raise BadInput(
                f"the scene names a file {file!r}, and the copy has another of that name",
                where=str(exported),
                hint="rename it, there and in the scene",
            )
    return sources


@contextmanager
def _begun(name: str, root: Path) -> Iterator[Path]:
    """A hidden folder ``name`` to fill, which becomes ``root/name`` when all is done; on an error it goes."""
    folder, made = _free(name, root), not root.exists()
    try:
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{name}.", suffix=".part", dir=root) as hidden:
            part = Path(hidden) / name
            part.mkdir()
            yield part
            part.rename(folder)
    except OSError as error:
        raise unwritable_error(folder, error) from error
    finally:
        if made:
            with suppress(OSError):  # there is something in it
                root.rmdir()


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


def _card(name: str, seen: "ExportedCamera") -> str:
    def vector(metres: tuple[float, ...]) -> str:
        return "[" + ", ".join(f"{round(x, 9) + 0.0:.6g}" for x in metres) + "]"

    def quoted(name: str) -> str:
        plain = re.fullmatch(r"[A-Za-z][\w.-]*", name) and name.lower() not in NOT_TEXT
        return name if plain else json.dumps(name, ensure_ascii=False)

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
