"""Cards that face the camera, as glTF, OBJ and PLY files of strangers, and the picture of what a scene makes of them.

A card spans -1 to 1 in x and y. Its texture coordinates are (0, 0) at the top left of the picture, as in glTF.
"""

import base64
import io
import json
import struct
from pathlib import Path

import mitsuba as mi
import numpy as np
from PIL import Image

from saf_gen.authoring.mesh_scene import scene_of_mesh
from saf_gen.render import backend
from saf_gen.render.mitsuba_scene import parse_scene_dict
from saf_gen.scene.xml import read_scene_xml

POINTS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint16)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
COMPONENTS = {"u1": 5121, "i1": 5120, "u2": 5123, "i2": 5122, "u4": 5125, "f4": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def linear(coded):
    """Return linear values of sRGB bytes."""
    value = np.asarray(coded, float) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


class Gltf:
    """A glTF file that is put together piece by piece: ``json`` may be changed at will before it is saved."""

    def __init__(self, **top):
        self.data = bytearray()
        self.json = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "meshes": [], "nodes": []}
        self.json |= {"scene": 0, "scenes": [{"nodes": []}], **top}

    def add_view(self, data, **more):
        """Add bytes to the buffer, and return the number of their view."""
        self.data += b"\0" * (-len(self.data) % 4)
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def add_array(self, values, **more):
        """Add an accessor for an array (value,) or (value, component), and return its number."""
        values = np.ascontiguousarray(values)
        width = values.shape[1] if values.ndim == 2 else 1
        accessor = {"bufferView": self.add_view(values.tobytes()), "count": len(values), "type": KINDS[width]}
        self.json["accessors"].append({**accessor, "componentType": COMPONENTS[values.dtype.str[1:]], **more})
        return len(self.json["accessors"]) - 1

    def add_texture(self, pixels, *, mime="image/png", sampler=None, **more):
        """Add a picture inside the file and a texture of it, and return the texture's number."""
        image = {"bufferView": self.add_view(encode(pixels, mime.removeprefix("image/"))), "mimeType": mime}
        self.json.setdefault("images", []).append(image)
        texture = {"source": len(self.json["images"]) - 1, **more}
        if sampler is not None:
            self.json.setdefault("samplers", []).append(sampler)
            texture["sampler"] = len(self.json["samplers"]) - 1
        self.json.setdefault("textures", []).append(texture)
        return len(self.json["textures"]) - 1

    def add_material(self, **material):
        """Add a material that is not metallic, unless it says so, and return its number."""
        pbr = {"metallicFactor": 0, **material.pop("pbr", {})}
        self.json.setdefault("materials", []).append({"pbrMetallicRoughness": pbr, **material})
        return len(self.json["materials"]) - 1

    def add_mesh(self, *, points=POINTS, uv=(UV,), faces=FACES, material=None, attributes=(), **more):
        """Add a mesh of one primitive, and return its number; ``attributes`` are accessors by name."""
        used = {"POSITION": self.add_array(points), **dict(attributes)}
        used |= {f"TEXCOORD_{n}": self.add_array(np.asarray(one, np.float32)) for n, one in enumerate(uv)}
        primitive = {"attributes": used, **more}
        if faces is not None:
            primitive["indices"] = self.add_array(np.asarray(faces).ravel())
        if material is not None:
            primitive["material"] = material
        self.json["meshes"].append({"primitives": [primitive]})
        return len(self.json["meshes"]) - 1

    def add_card(self, *, name="card", node=None, **mesh):
        """Add a mesh and a node in the scene, and return the node's number."""
        return self.add_node(mesh=self.add_mesh(**mesh), name=name, **(node or {}))

    def add_node(self, *, in_scene=True, **node):
        """Add a node, and return its number."""
        self.json["nodes"].append(node)
        number = len(self.json["nodes"]) - 1
        if in_scene:
            self.json["scenes"][0]["nodes"].append(number)
        return number

    def save(self, path, *, beside=False):
        """Write the file, and return its path: a .glb, or a .gltf whose buffer is in it or ``beside`` it."""
        document = dict(self.json)
        data = bytes(self.data) + b"\0" * (-len(self.data) % 4)
        if path.suffix == ".glb":
            document.setdefault("buffers", [{"byteLength": len(data)}])
            text = json.dumps(document).encode()
            text += b" " * (-len(text) % 4)
            chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
            path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
        else:
            uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
            if beside:
                uri = f"{path.stem}.bin"
                path.with_suffix(".bin").write_bytes(data)
            document.setdefault("buffers", [{"byteLength": len(data), "uri": uri}])
            path.write_text(json.dumps(document))
        return path


def encode(pixels, suffix):
    """Return the picture file of uint8 pixels."""
    buffer = io.BytesIO()
    finest = {"webp": {"lossless": True, "exact": True}, "jpeg": {"quality": 100, "subsampling": 0}}
    Image.fromarray(np.asarray(pixels, np.uint8)).save(buffer, suffix, **finest.get(suffix, {}))
    return buffer.getvalue()


def blocks(*colours, size=8):
    """Return a picture of 2 × 2 blocks of sRGB colours: top left, top right, bottom left, bottom right."""
    grid = np.array(colours, np.uint8).reshape(2, 2, -1)
    return grid.repeat(size // 2, axis=0).repeat(size // 2, axis=1)


def quarters(picture):
    """Return the colour in the middle of each quarter of a picture of 8 × 8: top left, top right, bottom left, …"""
    return np.array([picture[r : r + 2, c : c + 2].mean(axis=(0, 1)) for r in (1, 5) for c in (1, 5)])


def show(mesh: Path, *, variant="scalar", **how):
    """Return the linear picture (row, column, RGB) of the shapes of a scene around a mesh, and what was said.

    The other options are those of :func:`render`. All variants but scalar give luminance alone.
    """
    said: list[str] = []
    folder = mesh.parent / "shown"
    for file, data in scene_of_mesh(mesh, "shown", notify=said.append).items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(data)
    backend.activate_backend(variant)
    scene = folder / "scene.xml"
    described = parse_scene_dict(read_scene_xml(scene, {}).text, scene)
    shapes = {name: entry for name, entry in described.items() if name.startswith("mesh")}
    return render(shapes, **how), said


def render(shapes, *, size=8, samples=64, path=False, lamp=False, pixels=None):
    """Return the linear picture (row, column, RGB) of shapes within 5 cm of the origin, seen along z from the front.

    The light is 1 from everywhere, so that a flat card shows its reflectance, and the background is 1. A lamp from the
    upper right makes slopes visible; with ``path``, light is reflected more than once. With ``pixels``, pairs of row
    and column, only these are rendered: (pixel, RGB).
    """
    lamps = {"room": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}}
    if lamp:
        lamps["sun"] = {"type": "directional", "direction": [-1, -1, -1], "irradiance": {"type": "rgb", "value": 2.0}}
    # Samples of the surface alone: a matt one then shows its reflectance without noise.
    integrator = {"type": "path"} if path else {"type": "direct", "bsdf_samples": 1, "emitter_samples": 0}
    scene = mi.load_dict({"type": "scene", **shapes, **lamps, "integrator": integrator})

    def look(**crop):
        return np.array(mi.render(scene, sensor=_camera(size, **crop), spp=samples, seed=1))[..., :3].astype(float)

    if pixels is None:
        return look()
    crops = [{"crop_offset_x": c, "crop_offset_y": r, "crop_width": 1, "crop_height": 1} for r, c in pixels]
    return np.array([look(**crop)[0, 0] for crop in crops])


def _camera(size, **crop):
    to_world = mi.ScalarTransform4f().look_at(origin=[0, 0, 1], target=[0, 0, 0], up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, **crop}
    film["pixel_format"] = "rgb" if mi.variant() == "scalar_rgb" else "luminance"
    to_world = to_world @ mi.ScalarTransform4f().scale([0.05, 0.05, 1])
    return mi.load_dict({"type": "orthographic", "to_world": to_world, "film": film})
