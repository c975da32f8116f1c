"""New scenes: a commented template that can be rendered at once, an exported scene with a card, or given pictures."""

import json
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from saf_gen.authoring.mesh_scene import is_mesh, left_out_text, scene_of_mesh
from saf_gen.authoring.whole_scene import describe_lack_of_camera, read_whole_scene
from saf_gen.core.files import rename_durably, temporary_folder, unwritable
from saf_gen.errors import BadInput, escape_controls
from saf_gen.scene.obj_file import counts_from_the_end, with_positive_indices
from saf_gen.scene.picture_card import FOLDER, MIN_PICTURES
from saf_gen.scene.ply_file import is_ply, triangulated_ply
from saf_gen.scene.scene_folder import CARD_FILE, load_any_scene, load_scene, scene_names
from saf_gen.scene.xml import SceneXml, read_scene_xml

if TYPE_CHECKING:
    from saf_gen.render.exported_camera import ExportedCamera

_TEMPLATES = Path(__file__).parent / "templates"
NAME = re.compile(r"[a-z0-9][a-z0-9_]*")
RESERVED_FILES = ("scene.xml", "scene.yaml", "scene.py", "SOURCE.md")
EXPORTED_SOURCE = """# NAME

Copied from an exported scene by `saf-gen scenes new --from`.
LEFT_OUTFor each mesh and texture, state here who made it, where it is from, its licence, and what was changed.
"""
WHOLE_SOURCE = """# NAME

Made from FILE by `saf-gen scenes new --from`.
LEFT_OUTState here who made the scene and its textures, where they are from, their licence, and what was changed.
"""
YAML_KEYWORDS = frozenset("y n yes no on off true false null".split())  # noqa: SIM905  YAML does not read these as text


def scene_from_template(name: str, root: Path, *, kind: str = "script") -> list[Path]:
    """Write a template to ``root/name``, and return the paths of its files.

    Parameters
    ----------
    name : str
        Name of the new scene.
    root : Path
        Folder of scene folders.
    kind : {'script', 'xml'}, default 'script'
        Kind of geometry: scene.py or scene.xml.

    Returns
    -------
    list of Path

    Raises
    ------
    BadInput
        If no scene can have this name, the name is taken, or the folder cannot be written.
    """
    template = _TEMPLATES / kind
    written = []
    with _new_folder(name, root) as folder:
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


def scene_from_export(
    exported: Path,
    name: str,
    *,
    root: Path,
    camera: str = "",
    target: str = "",
    notify: Callable[[str], None] = lambda line: None,
) -> list[Path]:
    """Copy an exported scene and its files to ``root/name``, write its card, and return the paths of the files.

    Files keep the names that the scene uses; links are followed. The card has the pose and the field of view of the
    first camera in the file, the shape in the middle of the image as its target, and a light group for each lamp. If
    the file is a mesh without a camera, the new scene shows this mesh in front of a wall, with a lamp.

    Parameters
    ----------
    exported : Path
        A scene.xml or a mesh file.
    name : str
        Name of the new scene.
    root : Path
        Folder of scene folders.
    camera : str, optional
        Camera of the file, in place of its first with a perspective.
    target : str, optional
        Shape or node that should be in focus, in place of that in the middle of the image.
    notify : callable, optional
        Called with a line of text for each thing that is left out, changed or guessed.

    Returns
    -------
    list of Path

    Raises
    ------
    BadInput
        If the scene cannot be read; has no camera, or none of this name, no lamp or no shape in the middle; has a
        camera that no card can describe; or if the name cannot be used. In these cases, no file is left behind.
    """
    whole = read_whole_scene(exported) if is_mesh(exported) else None
    if is_mesh(exported) and whole is None:
        if camera:
            raise BadInput(
                f"the file has no camera with a perspective, and --camera names {camera!r}",
                where=str(exported),
                hint="export it with its cameras, or leave --camera out to place its mesh",
            )
        for line in describe_lack_of_camera(exported):
            notify(line)
        files = scene_of_mesh(exported, name, target=target, notify=notify)
        with _new_folder(name, root) as folder:
            _write(files, folder)
        return [root / name / file for file in files]
    with _new_folder(name, root) as folder:
        from saf_gen.render.exported_camera import exported_camera  # loads Mitsuba

        if whole is None:
            read = read_scene_xml(exported, {}, convertible=True)
            sources = _copied_files(read, exported)
            changed = list(_copy(sources, folder))
            copies = {sources[file]: folder / file for file, _ in changed}
            taken = exported_camera(read.with_copies(copies), exported, camera=camera, target=target)
            lines = [*taken.notes, *(f"mesh rewritten: {file} ({how})" for file, how in changed)]
            written, source = list(sources), EXPORTED_SOURCE
        else:
            _write(whole.files, folder)
            read = read_scene_xml(folder / "scene.xml", {})
            taken = exported_camera(read, exported, camera=camera, target=target, nodes=whole.nodes)
            lines = [*whole.lines, *taken.notes]
            if not whole.lit:
                taken = _add_lamp(folder / "scene.xml", taken)
                lines.append("no lamp in the file: a lamp beside the camera and light from all around are added")
            written = list(whole.files)
            source = WHOLE_SOURCE.replace("FILE", exported.name)
        lines = [escape_controls(line) for line in dict.fromkeys(lines)]
        source = re.sub(r"\bNAME\b", name, source).replace("LEFT_OUT", left_out_text(lines))
        texts = {"scene.yaml": _format_card(name, taken), "SOURCE.md": source}
        _write({file: text.encode() for file, text in texts.items()}, folder)
        try:
            load_scene(folder)  # checks the card
        except BadInput as refused:
            raise BadInput(
                f"no card can describe this camera: {refused.problem}",
                where=str(exported),
                allowed=refused.allowed,
                hint="change the camera and export again, or write the card by hand",
            ) from refused
    for line in lines:
        notify(line)
    return [root / name / file for file in (*written, *texts)]


def _write(files: Mapping[str, bytes], folder: Path) -> None:
    for file, data in files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(data)


LAMP = """\
	<shape type="rectangle" id="lamp">
		<transform name="to_world">
			<scale value="{half}"/>
			<lookat origin="{origin}" target="{target}" up="{up}"/>
		</transform>
		<emitter type="area"><rgb name="radiance" value="60 60 60"/></emitter>
	</shape>
</scene>
"""
"""The lamp of the template of a mesh, for a camera at any distance."""


def _add_lamp(file: Path, camera: "ExportedCamera") -> "ExportedCamera":
    """Add a lamp beside the camera to a scene, and return the camera with its light group."""
    origin, target, up = (np.array(v) for v in (camera.origin_m, camera.look_at_m, camera.up))
    ahead = (target - origin) / camera.distance_m
    place = origin + camera.distance_m * (0.6 * np.cross(ahead, up) + 0.6 * up - 0.2 * ahead)
    points = {"origin": place / camera.unit_m, "target": target / camera.unit_m, "up": up}
    lamp = LAMP.format(
        half=f"{0.16 * camera.distance_m / camera.unit_m:.6g}",
        **{key: ", ".join(f"{value:.9g}" for value in point) for key, point in points.items()},
    )
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("</scene>\n", lamp), encoding="utf-8")
    return replace(camera, lights={"lamp": "lamp", **camera.lights})


def scene_from_pictures(
    pictures: Path,
    name: str,
    *,
    root: Path,
    linear: bool = False,
    transfer: str | None = None,
    licence: str,
    step_um: float | None = None,
    box: tuple[int, int, int, int] | None = None,
) -> list[Path]:
    """Write pictures at equal steps of the focus to ``root/name`` as a scene, and return its card and their folder.

    Parameters
    ----------
    pictures : Path
        Folder of pictures, in the order of the numbers in their names, or file with several.
    name : str
        Name of the new scene.
    root : Path
        Folder of scene folders.
    linear : bool, default False
        Whether their values are linear light, as those of OpenEXR are.
    transfer : {'srgb', 'bt709'}, optional
        The curve by which their values stand for light otherwise; needed where the files do not state it.
    licence : str
        SPDX identifier of the licence of the pictures.
    step_um : float, optional
        Distance of the focus between two pictures, µm; by default it counts as not known.
    box : tuple of int, optional
        Left, top, columns and rows of the target in pixels of the pictures; by default all that the sensor sees.

    Raises
    ------
    BadInput
        If the pictures cannot be read or are fewer than three, if what is stated is not allowed or contradicts their
        tags, or if the name cannot be used. In these cases, no file is left behind.
    """
    from saf_gen.stream.interop.picture_frames import open_pictures  # readers that other scenes do not need

    frames = open_pictures(pictures, linear=linear, transfer=transfer)
    frames.check_stated()
    stated = {"step_um": step_um, "box": None if box is None else list(box)}
    known = {key: value for key, value in stated.items() if value is not None}
    origin = f"pictures {pictures.name}"
    card = {"id": name, "title": name, "licence": licence, "source": origin, "pictures": known}
    with _new_folder(name, root) as folder:
        (folder / FOLDER).mkdir()
        count = 0
        for light in frames:
            np.save(folder / FOLDER / f"{count:04d}.npy", np.ascontiguousarray(light, np.float32))
            count += 1
        if count < MIN_PICTURES:
            raise BadInput(f"has {count} pictures", where=str(pictures), allowed=f"at least {MIN_PICTURES}")
        lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}\n" for key, value in card.items()]  # JSON is YAML
        (folder / CARD_FILE).write_text("".join(lines), encoding="utf-8")
        load_any_scene(folder)  # checks the card
    return [root / name / CARD_FILE, root / name / FOLDER]


def _copied_files(read: SceneXml, exported: Path) -> dict[str, Path]:
    """Return the files to copy, by the name of the copy; raise BadInput if two files have the same name."""
    sources = {"scene.xml": exported}
    for file, source in read.files:
        if file in RESERVED_FILES or sources.setdefault(file, source) != source:
            raise BadInput(
                f"the scene refers to a file {file!r}, and the copy needs this name for another file",
                where=str(exported),
                hint="rename the file, and its name in the scene",
            )
    return sources


def _copy(sources: dict[str, Path], folder: Path) -> Iterator[tuple[str, str]]:
    """Copy files into a folder, and yield the names of those that must be rewritten for Mitsuba, and how they were."""
    for file, source in sources.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        if is_ply(source) and (data := triangulated_ply(source)) is not None:
            (folder / file).write_bytes(data)
            yield file, "faces of more than three corners are split into triangles"
        elif source.suffix.lower() == ".obj" and counts_from_the_end(source):
            (folder / file).write_bytes(with_positive_indices(source))
            yield file, "negative indices are counted from the beginning"
        else:
            shutil.copyfile(source, folder / file)


@contextmanager
def _new_folder(name: str, root: Path) -> Iterator[Path]:
    """Yield a hidden folder to fill, which becomes ``root/name`` at the end; after an error it is removed."""
    folder, created_root = _check_name(name, root), not root.exists()
    try:
        with temporary_folder(folder) as hidden:
            (hidden / name).mkdir()  # a card can be checked only in a folder with its scene's name
            yield hidden / name
            rename_durably(hidden / name, folder)
    except OSError as error:
        raise unwritable(folder, error) from error
    finally:
        if created_root:
            with suppress(OSError):  # it is not empty
                root.rmdir()


def _check_name(name: str, root: Path) -> Path:
    """Return the folder of a new scene; raise BadInput if the name cannot be used."""
    if not NAME.fullmatch(name):
        near = re.sub(r"[^a-z0-9_]+", "_", name.lower()).strip("_")
        raise BadInput(
            f"a scene cannot be called {name!r}",
            allowed="lower-case letters, digits and _, a letter or digit first",
            nearest=near if NAME.fullmatch(near) else "",
        )
    folder = root / name
    if folder.exists():
        raise BadInput(f"{folder} already exists", hint="choose another name, or remove it")
    if name in scene_names():
        raise BadInput(f"a scene {name!r} already exists", hint="choose another name: see saf-gen scenes list")
    return folder


def _format_card(name: str, camera: "ExportedCamera") -> str:
    def vector(metres: tuple[float, ...]) -> str:
        return "[" + ", ".join(f"{round(x, 9) + 0.0:.6g}" for x in metres) + "]"

    def quoted(name: str) -> str:
        plain = re.fullmatch(r"[A-Za-z][\w.-]*", name) and name.lower() not in YAML_KEYWORDS
        return name if plain else json.dumps(name, ensure_ascii=False)

    far, near = 1.5 * camera.distance_m, 0.75 * camera.distance_m
    unit = f"unit_m: {camera.unit_m:g}                                  # metres per unit of the geometry\n\n"
    lights = "".join(f"  {group}: [{quoted(emitter)}]\n" for group, emitter in camera.lights.items())
    return f"""\
id: {name}
title: {name.replace("_", " ").capitalize()}, exported
licence: ""                                  # you decide: an SPDX name, such as CC-BY-4.0; may others use it?
source: SOURCE.md                            # where everything came from

{unit if camera.unit_m != 1 else ""}camera:                                      # from the file: {camera.name}
  origin_m: {vector(camera.origin_m)}
  look_at_m: {vector(camera.look_at_m)}
  up: {vector(camera.up)}

lens:                                        # the field of view of the file's camera, on 400 pixels of 20 µm
  drive: image_distance
  focal_length_mm: {camera.focal_length_mm:.4g}
  f_number: {camera.f_number:.3g}
  focus_range_m: [{far:.4g}, {near:.4g}]             # in focus at position 0 and at 1

lights:                                      # lamps that are switched together
{lights}
target: [{", ".join(map(quoted, camera.target))}]                  # shapes that should be in focus
"""
