"""A scene around a mesh: the mesh in front of the lens, a lamp, a wall, and a card.

Surfaces are seen from both sides. Mitsuba multiplies no textures, so colour factors become part of the
picture.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from saf_gen.authoring.meshes import READERS, LeftOut, Shape, Surface, encode_png, read_mesh, srgb_to_linear
from saf_gen.errors import BadInput, unknown

UNREADABLE_MESHES = {
    ".blend": "a Blender file",
    ".fbx": "an FBX file",
    ".dae": "a Collada file",
    ".usd": "a USD file",
    ".usdz": "a USD file",
    ".3ds": "a 3ds Max file",
    ".max": "a 3ds Max file",
}
SIZE_M = 0.1
"""Largest side of the mesh in the scene, in metres; at a distance of half a metre, it fills most of the frame."""
CARD = """\
id: NAME
title: TITLE
licence: ""                                  # you decide: an SPDX name, such as CC-BY-4.0; may others use it?
source: SOURCE.md                            # where everything came from

camera:
  origin_m: [0, 0, 0.5]                      # y is up, and the mesh is around the origin
  look_at_m: [0, 0, 0]
  up: [0, 1, 0]

lens:
  drive: image_distance
  focal_length_mm: 25
  f_number: 2.0
  focus_range_m: [0.65, 0.40]                # in focus at position 0 and at 1

lights:                                      # lamps that are switched together
  lamp: [lamp]
  room: [ROOM]

target: [TARGET]                             # shapes that should be in focus
"""
SOURCE = """\
# NAME

Made from FILE by `saf-gen scenes new --from`, scaled by SCALE, with lamp and wall from a template that is free to use.
LEFT_OUTState here who made the mesh and its textures, where they are from, their licence, and what was changed.
"""
SURROUNDINGS = """\
	<!-- The background: wider than the field of view, because blur brings in what is just outside -->
	<shape type="rectangle" id="wall">
		<transform name="to_world"><scale value="0.5"/><translate z="-0.2"/></transform>
		<bsdf type="diffuse"><rgb name="reflectance" value="0.3 0.3 0.3"/></bsdf>
	</shape>

	<!-- A shape that emits light, and light from all directions -->
	<shape type="rectangle" id="lamp">
		<transform name="to_world">
			<scale value="0.08"/>
			<lookat origin="0.3, 0.3, 0.6" target="0, 0, 0" up="0, 1, 0"/>
		</transform>
		<emitter type="area"><rgb name="radiance" value="60 60 60"/></emitter>
	</shape>
	<emitter type="constant" id="room"><rgb name="radiance" value="0.5 0.5 0.5"/></emitter>
</scene>
"""


def is_mesh(path: Path) -> bool:
    """Return whether the file is a mesh around which a scene can be made.

    Raises BadInput if it is missing, or for a file format of another program, with a hint on how to convert it.
    """
    suffix = path.suffix.lower()
    if suffix in UNREADABLE_MESHES:
        raise BadInput(
            f"{path} is {UNREADABLE_MESHES[suffix]}, which saf_gen cannot read",
            allowed=f"a scene.xml, or a mesh: {', '.join(READERS)}",
            hint="in Blender, use File > Export > glTF 2.0 (.glb) with Cameras and Punctual Lights, or Mitsuba (.xml)"
            " of the add-on mitsuba-blender",
        )
    if suffix in READERS and not path.is_file():
        raise BadInput(f"{path} cannot be read: there is no such file")
    return suffix in READERS


def scene_of_mesh(
    path: Path, name: str, *, target: str = "", notify: Callable[[str], None] = lambda line: None
) -> dict[str, bytes]:
    """Return the content of the files of a scene around a mesh, by file name.

    The mesh is scaled so that its largest side is SIZE_M, and centred at the origin, 0.5 m in front of the lens. All
    its shapes form the target, or those of ``target``; those that emit light belong to the light group ``room``.

    Parameters
    ----------
    path : Path
        Mesh file.
    name : str
        Name of the scene.
    target : str, optional
        Shape, node or material that should be in focus.
    notify : callable, optional
        Called with a line of text for each kind of thing that is left out.

    Returns
    -------
    dict of str to bytes

    Raises
    ------
    BadInput
        If the file cannot be read, or if the mesh has no size, cannot be seen, or has no such target.
    """
    left_out = LeftOut()
    shapes = visible_shapes(path, left_out)
    low, high = (np.array([f(s.points, axis=0) for s in shapes]) for f in (np.min, np.max))
    extent = np.array([low.min(axis=0), high.max(axis=0)])
    with np.errstate(over="ignore"):
        side = float((extent[1] - extent[0]).max())
    if not (np.isfinite(side) and side > 0):
        raise BadInput("the mesh has no size", where=str(path), allowed="finite coordinates that differ")
    scale, middle = SIZE_M / side, extent[0] / 2 + extent[1] / 2
    if not np.isfinite(scale):
        raise BadInput(f"the largest side of the mesh is {side:.3g}", where=str(path), hint="enlarge it")
    files = Files()
    names: list[str] = []
    for shape in shapes:
        names.append(unique_name(shape.name, names))
        files.add_shape(names[-1], replace(shape, points=(shape.points - middle) * scale))
    lines = left_out.lines()
    for line in lines:
        notify(line)
    focused = [name for name, shape in zip(names, shapes, strict=True) if target in ("", name, shape.name, shape.node)]
    if not focused:
        raise unknown("target", target, allowed=[shape.node or shape.name for shape in shapes], where=str(path))
    glow = [one for one, shape in zip(names, shapes, strict=True) if any(shape.surface.emission)]
    texts = {
        "scene.xml": f'<scene version="3.0.0">\n{"".join(files.xml)}\n{SURROUNDINGS}',
        "scene.yaml": CARD.replace("TARGET", ", ".join(focused))
        .replace("ROOM", ", ".join(["room", *glow]))
        .replace("TITLE", f"{name.replace('_', ' ').capitalize()}, in front of a wall")
        .replace("NAME", name),
        "SOURCE.md": SOURCE.replace("NAME", name)
        .replace("FILE", path.name)
        .replace("SCALE", f"{scale:.4g}")
        .replace("LEFT_OUT", left_out_text(lines)),
    }
    return files.data | {file: text.encode() for file, text in texts.items()}


def visible_shapes(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the shapes of a mesh file that can be seen; raise BadInput if there is none."""
    shapes = [shape for shape in map(_simplified, read_mesh(path, left_out)) if _is_visible(shape, left_out)]
    if not shapes:
        raise BadInput("the mesh cannot be seen: its opacity is 0", where=str(path), hint="export it with opacity")
    return shapes


def left_out_text(lines: Sequence[str]) -> str:
    """Return the part of SOURCE.md about what is not as in the file."""
    listed = "".join(f"- {line}\n" for line in lines)
    return f"\nNot everything in the file is used:\n\n{listed}\n" if lines else ""


def unique_name(name: str, taken: Collection[str], *, kind: str = "mesh") -> str:
    """Return the id of a shape or lamp, which begins with its kind and is none of those in use."""
    plain = "_".join([kind, *filter(None, [re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:60]])])
    return f"{plain}_{len(taken) + 1}" if plain in taken else plain


def _simplified(shape: Shape) -> Shape:
    """Return a shape without colours of vertices that are all the same: they become part of its surface."""
    colours = shape.colours
    if colours is None or (colours != colours[0]).any():
        return shape
    red, green, blue = np.array(shape.surface.colour) * colours[0]
    return replace(shape, colours=None, surface=replace(shape.surface, colour=(red, green, blue)))


def _is_visible(shape: Shape, left_out: LeftOut) -> bool:
    surface = shape.surface
    highest = surface.opacity
    if surface.picture is not None:
        highest *= float(surface.picture[..., 3].max()) / 255
    least = {"opaque": -1.0, "mask": surface.cutoff, "blend": 1e-6}[surface.alpha]
    if highest < least:
        left_out.add("shapes left out, they cannot be seen", shape.name)
    return highest >= least


MAX_BYTES = 4 << 30
"""Limit of the files of a scene."""


class Files:
    """The files of the shapes, and their XML; shapes with the same picture share its file.

    Surfaces are matt unless ``glossy`` says that their roughness and metal count, and they are not wholly rough.
    """

    def __init__(self, *, glossy: bool = False) -> None:
        self._glossy = glossy
        self.data: dict[str, bytes] = {}
        self.xml: list[str] = []
        self._stored: dict[tuple[object, ...], str] = {}

    def add_shape(self, name: str, shape: Shape) -> None:
        """Add the mesh, the pictures and the XML of a shape whose coordinates are in metres."""
        attributes: dict[str, np.ndarray] = {}
        bsdf = f'<bsdf type="twosided">{self._reflection(name, shape, attributes=attributes)}</bsdf>'
        for opacity in self._opacities(name, shape.surface):
            bsdf = f'<bsdf type="mask">{opacity}{bsdf}</bsdf>'
        flat = '\t\t<boolean name="face_normals" value="true"/>\n' if shape.flat else ""
        self._add(f"meshes/{name}.ply", _format_ply(shape, attributes))
        self.xml.append(
            f'\t<shape type="ply" id="{name}">\n\t\t<string name="filename" value="meshes/{name}.ply"/>\n'
            f"{flat}\t\t{bsdf}\n{self._emission(name, shape.surface)}\t</shape>\n"
        )

    def _add(self, file: str, data: bytes) -> None:
        self.data[file] = data
        if sum(map(len, self.data.values())) > MAX_BYTES:
            raise BadInput(f"the scene needs more than {MAX_BYTES >> 30} GiB", hint="reduce the mesh or its textures")

    def _reflection(self, name: str, shape: Shape, *, attributes: dict[str, np.ndarray]) -> str:
        """Return the BSDF of colour × picture × colours of the vertices."""
        surface, colours = shape.surface, shape.colours
        # At grazing angles, those of Mitsuba's principled are twice as bright as those of other renderers.
        rough = surface.roughness == 1 and surface.metallic == 0 and surface.gloss_picture is None
        matt = rough or not self._glossy
        key = "reflectance" if matt else "base_color"
        if surface.picture is None and colours is None:
            colour = rgb(key, surface.colour)
        elif surface.picture is None and colours is not None:
            attributes |= {f"color_{n}": colours[:, n] * surface.colour[n] for n in range(3)}
            colour = _attribute(key, "color")
        elif surface.picture is not None and colours is None:
            colour = self._coloured(name, surface, picture=surface.picture, key=key)
        else:
            raise BadInput(
                f"the mesh {shape.name!r} has a texture and colours of vertices that differ",
                allowed="one of them",
                hint="remove the colours of its vertices, and export it again",
            )
        if matt:
            return f'<bsdf type="diffuse">{colour}</bsdf>'
        return f'<bsdf type="principled">{colour}{"".join(self._gloss(name, surface))}</bsdf>'

    def _coloured(self, name: str, surface: Surface, *, picture: np.ndarray, key: str) -> str:
        """Return the texture of colour × picture: a copy of the picture if the colour is white."""
        if surface.colour == (1.0, 1.0, 1.0):
            file = self._store(f"{name}.png", (picture, "colour"), encode=partial(encode_png, picture[..., :3]))
            return _bitmap(key, file, surface=surface, raw=False)
        known = (picture, "colour", *surface.colour)
        file = self._store(f"{name}.pfm", known, encode=partial(_tinted, picture, surface.colour))
        return _bitmap(key, file, surface=surface)

    def _gloss(self, name: str, surface: Surface) -> Iterator[str]:
        """Yield roughness, metal and refractive index of a surface; green and blue of a picture are factors."""
        picture = surface.gloss_picture
        for channel, key, value in ((1, "roughness", surface.roughness), (2, "metallic", surface.metallic)):
            if picture is None:
                yield number(key, value)
                continue
            values = picture[..., channel : channel + 1] / 255 * value
            file = self._store(f"{name}_{key}.pfm", (picture, key, value), encode=partial(_encode_pfm, values))
            yield _bitmap(key, file, surface=surface)
        yield number("eta", surface.index)

    def _opacities(self, name: str, surface: Surface) -> Iterator[str]:
        """Yield the XML of each factor of the opacity of a surface that is not opaque."""
        picture, masked = surface.picture, surface.alpha == "mask"
        if surface.alpha == "opaque":
            return
        if picture is not None and int(picture[..., 3].min()) < 255:
            alpha = picture[..., 3]
            if masked:
                alpha = np.where(alpha / 255 * surface.opacity >= surface.cutoff, 255, 0).astype(np.uint8)
            key = (picture, "opacity", *((surface.opacity, surface.cutoff) if masked else ()))
            yield _bitmap(
                "opacity", self._store(f"{name}_opacity.png", key, encode=partial(encode_png, alpha)), surface=surface
            )
        if not masked and surface.opacity < 1:
            yield number("opacity", surface.opacity)

    def _emission(self, name: str, surface: Surface) -> str:
        """Return the lamp of a shape that emits light; it shines from the front."""
        if not any(surface.emission):
            return ""
        glow = surface.emission_picture
        if glow is None:
            radiance = rgb("radiance", surface.emission)
        else:
            key = (glow, "emission", *surface.emission)
            file = self._store(f"{name}_emission.pfm", key, encode=partial(_tinted, glow, surface.emission))
            radiance = _bitmap("radiance", file, surface=surface)
        return f'\t\t<emitter type="area">{radiance}</emitter>\n'

    def _store(self, file: str, key: tuple[object, ...], *, encode: Callable[[], bytes]) -> str:
        """Return the name of a picture's file, which is added unless a file with this key is there."""
        known = tuple(id(part) if isinstance(part, np.ndarray) else part for part in key)
        if known not in self._stored:
            self._stored[known] = f"textures/{file}"
            self._add(f"textures/{file}", encode())
        return self._stored[known]


def rgb(name: str, values: Iterable[float]) -> str:
    return f'<rgb name="{name}" value="{" ".join(f"{value:.6g}" for value in values)}"/>'


def number(name: str, value: float) -> str:
    return f'<float name="{name}" value="{value:.9g}"/>'


def _attribute(name: str, attribute: str) -> str:
    return f'<texture type="mesh_attribute" name="{name}"><string name="name" value="vertex_{attribute}"/></texture>'


def _bitmap(name: str, file: str, *, surface: Surface, raw: bool = True) -> str:
    words = [("filename", file)]
    words += [("wrap_mode", surface.wrap)] if surface.wrap != "repeat" else []
    words += [] if surface.smooth else [("filter_type", "nearest")]
    inner = "".join(f'<string name="{key}" value="{value}"/>' for key, value in words)
    linear = '<boolean name="raw" value="true"/>' if raw else ""
    return f'<texture type="bitmap" name="{name}">{inner}{linear}</texture>'


def _tinted(picture: np.ndarray, colour: tuple[float, float, float]) -> bytes:
    """Return the file of the linear product of a picture and a colour."""
    decoded = srgb_to_linear(np.arange(256) / 255)
    return _encode_pfm(np.stack([(decoded * colour[n])[picture[..., n]] for n in range(3)], axis=-1))


def _encode_pfm(values: np.ndarray) -> bytes:
    """Return a portable float map of one or three channels (rows, columns, channel), which begins at the bottom.

    It is larger than OpenEXR, which Mitsuba reads on several threads or never: see ``read_picture`` in
    :mod:`saf_gen.render.backend`.
    """
    rows, columns, channels = values.shape
    return (
        f"{'PF' if channels == 3 else 'Pf'}\n{columns} {rows}\n-1.0\n".encode() + values[::-1].astype("<f4").tobytes()
    )


def _format_ply(shape: Shape, attributes: Mapping[str, np.ndarray]) -> bytes:
    """Return a binary PLY file as Mitsuba reads it; it names attributes of vertices ``NAME_0``, ``NAME_1``, …"""
    columns = dict(zip("xyz", shape.points.T, strict=True))
    if shape.normals is not None and not shape.flat:
        columns |= dict(zip(("nx", "ny", "nz"), shape.normals.T, strict=True))
    if shape.uv is not None:
        columns |= dict(zip("st", shape.uv.T, strict=True))
    columns |= attributes
    vertices = np.column_stack(list(columns.values())).astype("<f4")
    faces = np.empty(len(shape.triangles), np.dtype([("sides", "u1"), ("corners", "<i4", 3)]))
    faces["sides"], faces["corners"] = 3, shape.triangles
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name in columns),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(header).encode() + vertices.tobytes() + faces.tobytes()
