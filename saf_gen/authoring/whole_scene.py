"""A glTF file with a camera as a scene in Mitsuba's XML: meshes with their gloss, cameras, and punctual lamps.

References
----------
Khronos Group, "glTF 2.0 Specification", 2021: §3.10 (cameras); "KHR_lights_punctual", 2018: candela and lux.
"""

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from pydantic import ValidationError

from saf_gen.authoring.mesh_scene import SIZE_M, Files, number, rgb, unique_name, visible_shapes
from saf_gen.authoring.meshes import READERS, LeftOut
from saf_gen.authoring.meshes.gltf import cameras_of, placed_nodes, read_document, read_gltf
from saf_gen.authoring.meshes.gltf_keys import Document, Light, Lights, LightUse, Perspective
from saf_gen.errors import BadInput

LUMENS_PER_WATT = 683
"""The factor with which exporters write W/sr and W/m² as candela and lux, Blender among them."""
LAMPS = "KHR_lights_punctual"
PLACED = f"placed as a mesh with a largest side of {SIZE_M:g} m, in front of a lens, a lamp and a wall of a template"
FILM_ROWS = 1000


@dataclass(frozen=True)
class WholeScene:
    """A scene of a file, without a card.

    Attributes
    ----------
    files : dict of str to bytes
        ``scene.xml``, its meshes and its pictures, by name.
    nodes : dict of str to str
        Node of each shape, by the shape's id.
    lit : bool
        Whether the file has a lamp; otherwise the scene has light from all around alone, called ``room``.
    lines : list of str
        What is not as in the file.
    """

    files: dict[str, bytes]
    nodes: dict[str, str]
    lit: bool
    lines: list[str]


def read_whole_scene(path: Path) -> WholeScene | None:
    """Return the scene of a glTF file that has a camera with a perspective, or None for any other mesh file.

    Raises BadInput if the file cannot be read.
    """
    if READERS[path.suffix.lower()] is not read_gltf:
        return None
    document, _ = read_document(path)
    if not cameras_of(document):
        return None
    left_out = LeftOut()
    files = Files(glossy=True)
    nodes: dict[str, str] = {}
    glows = False
    for shape in visible_shapes(path, left_out):
        name = unique_name(shape.name, nodes)
        nodes[name] = shape.node or shape.name
        glows |= any(shape.surface.emission)
        files.add_shape(name, shape)
    worlds = placed_nodes(document)
    lamps = list(_lamps(document, worlds, path=path, left_out=left_out))
    lit = glows or bool(lamps)
    if not lit:
        lamps = [f'<emitter type="constant" id="room">{rgb("radiance", (0.5, 0.5, 0.5))}</emitter>']
    _name_empty_nodes(document, worlds, left_out=left_out)
    body = "".join(f"\t{element}\n" for element in (*_cameras(document, worlds), *lamps))
    text = f'<scene version="3.0.0">\n{body}{"".join(files.xml)}</scene>\n'
    return WholeScene({"scene.xml": text.encode(), **files.data}, nodes, lit, left_out.lines())


def describe_lack_of_camera(path: Path) -> list[str]:
    """Return lines about a mesh file of which :func:`read_whole_scene` makes no scene: why, where its mesh is placed.

    They name the nodes of a glTF file that have no content.

    Raises BadInput if the file cannot be read.
    """
    if READERS[path.suffix.lower()] is not read_gltf:
        return [PLACED]
    document, _ = read_document(path)
    left_out = LeftOut()
    _name_empty_nodes(document, placed_nodes(document), left_out=left_out)
    why = "no camera in the file: export it with Cameras and Punctual Lights to have the whole scene"
    return [why, *left_out.lines(), PLACED]


def _name_empty_nodes(document: Document, worlds: Iterable[int], *, left_out: LeftOut) -> None:
    for n in worlds:
        node = document.nodes[n]
        if node.mesh is None and node.camera is None and not node.children and LAMPS not in node.extensions:
            left_out.add("nodes without content, such as area lamps, left out", node.name or f"node_{n}")


def _cameras(document: Document, worlds: dict[int, np.ndarray]) -> Iterator[str]:
    """Yield all cameras of the scene as sensors, with films of their aspect."""
    names: list[str] = []
    for n, world in worlds.items():
        if (which := document.nodes[n].camera) is None:
            continue
        name = document.nodes[n].name or document.cameras[which].name or "camera"
        names.append(name if name not in names else f"{name}_{n}")
        camera = document.cameras[which].perspective
        kind, field = ("perspective", _field(camera)) if camera else ("orthographic", "")
        yield f'<sensor type="{kind}" id={quoteattr(names[-1])}>{field}{_pose(world)}</sensor>'


def _field(camera: Perspective) -> str:
    """Return the field of view and the film of a camera."""
    columns = round(FILM_ROWS * camera.aspect_ratio)
    size = "".join(f'<integer name="{k}" value="{v}"/>' for k, v in (("width", columns), ("height", FILM_ROWS)))
    axis = '<string name="fov_axis" value="y"/>'
    return f'{number("fov", math.degrees(camera.yfov))}{axis}<film type="hdrfilm">{size}</film>'


def _lamps(document: Document, worlds: dict[int, np.ndarray], *, path: Path, left_out: LeftOut) -> Iterator[str]:
    """Yield the lamps of the scene as emitters."""
    try:
        lights = Lights.model_validate_json(json.dumps(document.extensions.get(LAMPS, {}))).lights
        uses = {n: document.nodes[n].extensions[LAMPS] for n in worlds if LAMPS in document.nodes[n].extensions}
        placed = [(n, lights[LightUse.model_validate(use).light]) for n, use in uses.items()]
    except ValidationError as error:
        first = error.errors()[0]
        problem = f"{LAMPS}.{'.'.join(map(str, first['loc']))} is {first['input']!r:.80}"
        raise BadInput(problem, where=str(path), allowed=first["msg"], hint="export it again") from error
    except IndexError:
        raise BadInput("a node names a lamp that does not exist", where=str(path), hint="export it again") from None
    names: list[str] = []
    for n, light in placed:
        node = document.nodes[n].name or light.name or str(n)
        if not any(light.intensity * part for part in light.color):
            left_out.add("lamps without light left out", node)
            continue
        if light.range is not None:
            left_out.add("range of lamps ignored", node)
        names.append(unique_name(node, names, kind="light"))
        kind, inside = _lamp(light, worlds[n])
        if light.type == "spot" and light.spot.inner_cone_angle < 0.95 * light.spot.outer_cone_angle:
            left_out.add("edges of spots fall off linearly in the angle", node)
        yield f'<emitter type="{kind}" id="{names[-1]}">{inside}</emitter>'


def _lamp(light: Light, world: np.ndarray) -> tuple[str, str]:
    """Return the plug-in and the content of the emitter of a lamp, which shines along -z of its node."""
    strength = [light.intensity * part / LUMENS_PER_WATT for part in light.color]
    if light.type == "point":
        return "point", _vector("point", "position", values=world[:3, 3]) + rgb("intensity", strength)
    if light.type == "directional":
        return "directional", _vector("vector", "direction", values=-world[:3, 2]) + rgb("irradiance", strength)
    outer = math.degrees(light.spot.outer_cone_angle)
    inner = min(math.degrees(light.spot.inner_cone_angle), 0.999 * outer)
    angles = number("cutoff_angle", outer) + number("beam_width", inner)
    return "spot", rgb("intensity", strength) + angles + _pose(world)


def _vector(tag: str, name: str, *, values: np.ndarray) -> str:
    x, y, z = (f"{value:.9g}" for value in values)
    return f'<{tag} name="{name}" x="{x}" y="{y}" z="{z}"/>'


def _pose(world: np.ndarray) -> str:
    """Return the transform of what looks along -z of its node, as Mitsuba has it, along +z; without scale."""
    pose = world @ np.diag([-1.0, 1.0, -1.0, 1.0])
    pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
    matrix = " ".join(f"{value:.9g}" for value in pose.ravel())
    return f'<transform name="to_world"><matrix value="{matrix}"/></transform>'
