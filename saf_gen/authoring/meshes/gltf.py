"""Shapes of a glTF 2.0 file as trimesh reads it: placed by its nodes, with the matt part of their materials.

References
----------
Khronos Group, "glTF 2.0 Specification", 2021: §3.5 (nodes), §3.7 (meshes), §3.9 (materials), §4 (GLB).
"""

import base64
import binascii
import json
import struct
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote

import numpy as np
from pydantic import ValidationError

from saf_gen.authoring.meshes.gltf_keys import (
    EXTENSIONS,
    Document,
    EmissiveStrength,
    Material,
    MetallicRoughness,
    Primitive,
    Refraction,
    Sampler,
    TextureUse,
)
from saf_gen.authoring.meshes.shapes import (
    GREY,
    MAX_CORNERS,
    MAX_SHAPES,
    LeftOut,
    Pictures,
    Shape,
    Surface,
    as_array,
    load,
    optional,
    read_beside,
    read_bytes,
    uv_of,
)
from saf_gen.errors import BadInput

NEAREST = 9728
WRAPS: dict[int, Literal["repeat", "mirror", "clamp"]] = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
ACCESSORS = {
    "POSITION": ["VEC3 5126"],
    "NORMAL": ["VEC3 5126"],
    "TEXCOORD_0": ["VEC2 5126"],
    "COLOR_0": [
        f"{width} {kind}" for width in ("VEC3", "VEC4") for kind in ("5126", "5121 normalized", "5123 normalized")
    ],
    "indices": ["SCALAR 5121", "SCALAR 5123", "SCALAR 5125"],
}
"""Types and component types of what trimesh reads as it is meant; it does not know that integers may be fractions."""
COMPRESSED = "export it without compression; in Blender: import it, then File > Export > glTF 2.0 without Compression"
HINTS = {
    "KHR_draco_mesh_compression": COMPRESSED,
    "EXT_meshopt_compression": COMPRESSED,
    "KHR_mesh_quantization": "gltf-transform dequantize IN.glb OUT.glb",
    "KHR_texture_basisu": "convert its textures to PNG: gltf-transform ktxdecompress IN.glb OUT.glb",
    "KHR_materials_pbrSpecularGlossiness": "gltf-transform metalrough IN.glb OUT.glb",
    "sparse": "gltf-transform reads and writes it without sparse arrays: gltf-transform copy IN.glb OUT.glb",
    "skin": "apply its pose, in Blender by the armature's modifier, and export it again",
    "targets": "apply its shape keys, and export it again",
    "weights": "apply its shape keys, and export it again",
    "KHR_texture_transform": "apply it to the texture coordinates (UV), and export it again",
    "texCoord": "move its texture coordinates to the first UV map, and export it again",
}
"""Next step for a key or an extension that is not read."""


def read_gltf(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the shapes of a file's scene, placed by its nodes.

    trimesh gets the keys that it reads, with numbers for names and the content of other files.
    """
    from trimesh.exchange.gltf import load_gltf  # trimesh loads in half a second

    document, binary = read_document(path)
    whole = bool(cameras_of(document))
    tree = document.model_dump(by_alias=True, exclude_unset=True, mode="json")
    for kind in ("nodes", "meshes"):
        for n, entry in enumerate(tree.get(kind, ())):
            entry["name"] = str(n)
    used = set[int]()
    for n, material in enumerate(document.materials):
        pbr = material.pbr_metallic_roughness or MetallicRoughness()
        uses = {"baseColorTexture": pbr.base_color_texture, "emissiveTexture": material.emissive_texture}
        uses |= {"metallicRoughnessTexture": pbr.metallic_roughness_texture} if whole else {}
        tree["materials"][n] = {key: {"index": use.index} for key, use in uses.items() if use is not None}
        used |= {use.index for use in uses.values() if use is not None}
    for n, texture in enumerate(document.textures):
        webp = texture.extensions and texture.extensions.ext_texture_webp
        tree["textures"][n] = {"source": webp.source if webp else texture.source} if n in used else {}
    pictured = {texture.get("source") for texture in tree.get("textures", ())}
    tree["images"] = [entry if n in pictured else {} for n, entry in enumerate(tree.get("images", ()))]
    files: dict[str, bytes] = {}
    for what, entries in (("buffer", tree.get("buffers", ())), ("texture", tree["images"])):
        for n, entry in enumerate(entries):
            if "uri" in entry or (what == "buffer" and n == 0 and binary):
                files[f"{what} {n}"] = _resource(entry["uri"], path, what=what) if "uri" in entry else binary
                entry["uri"] = f"{what} {n}"
    _say(document, left_out, whole=whole)
    loaded = load(load_gltf, json.dumps(tree).encode(), path=path, resolver=files)
    reader = _Gltf(path, document, left_out, Pictures(path), whole)
    worlds = {loaded["base_frame"]: np.eye(4)}
    placed: list[tuple[int, int, int, str]] = []
    for edge in loaded["graph"]:
        worlds[edge["frame_to"]] = worlds[edge["frame_from"]] @ edge["matrix"]
        if "geometry" in edge:
            number, _, part = edge["geometry"].partition("_")  # the primitives of mesh 3 are 3, 3_1, 3_2, …
            placed.append((int(edge["frame_to"].partition("_")[0]), int(part or 0), int(number), edge["frame_to"]))
    shapes = []
    for index, k, number, frame in sorted(placed):
        mesh, geometry = document.meshes[number], loaded["geometry"][f"{number}_{k}" if k else str(number)]
        name = document.nodes[index].name or mesh.name or f"node_{index}"
        name = f"{name}_{k + 1}" if len(mesh.primitives) > 1 else name
        shape = reader.shape(geometry, worlds[frame], name=name, primitive=mesh.primitives[k])
        shapes.append(replace(shape, node=document.nodes[index].name))
    return shapes


def read_document(path: Path) -> tuple[Document, bytes]:
    """Return the keys of a file and its binary chunk; raise BadInput if it has other keys than are read."""
    text, binary = _split_container(read_bytes(path), path)
    document = _parse(text, path)
    _check(document, path)
    return document, binary


def cameras_of(document: Document) -> list[int]:
    """Return the nodes of the scene's cameras with a perspective; a file that has one is a whole scene."""
    cameras = ((n, document.nodes[n].camera) for n in placed_nodes(document))
    return [n for n, number in cameras if number is not None and document.cameras[number].perspective]


def placed_nodes(document: Document) -> dict[int, np.ndarray]:
    """Return the transforms to the world, float64 (4, 4), of the scene's nodes, by number in the order of the file."""
    from trimesh.transformations import quaternion_matrix

    worlds = dict[int, np.ndarray]()
    todo = [(n, np.eye(4)) for n in document.scenes[document.scene].nodes]
    while todo:
        n, above = todo.pop()
        node = document.nodes[n]
        own = np.eye(4)
        if node.matrix is not None:
            own = np.reshape(node.matrix, (4, 4)).T
        else:
            x, y, z, w = node.rotation
            own[:3, :3] = quaternion_matrix([w, x, y, z])[:3, :3] * node.scale
            own[:3, 3] = node.translation
        worlds[n] = above @ own
        todo += [(child, worlds[n]) for child in node.children]
    return dict(sorted(worlds.items()))


def _split_container(data: bytes, path: Path) -> tuple[bytes, bytes]:
    """Return the JSON text and the binary chunk of a glTF file, which may be a GLB whatever its name."""
    if data[:4] != b"glTF" and path.suffix.lower() == ".gltf":
        return data, b""
    chunks, at = dict[bytes, bytes](), 12
    try:
        magic, version, length = struct.unpack_from("<4sII", data)
        if magic == b"glTF" and version == 1:
            raise BadInput("the file is glTF 1.0", where=str(path), allowed="2.0", hint="export it again")
        if magic != b"glTF" or version != 2:
            raise ValueError("it does not begin with glTF 2")
        if length != len(data):
            raise ValueError(f"it has {len(data):,} bytes, and says {length:,}")
        while at < length:
            size, kind = struct.unpack_from("<I4s", data, at)
            if at + 8 + size > length:
                raise ValueError("a part is not complete")
            chunks.setdefault(kind, data[at + 8 : at + 8 + size])
            at += 8 + size
        return chunks[b"JSON"], chunks.get(b"BIN\0", b"")
    except (ValueError, KeyError, struct.error) as error:
        why = str(error) if type(error) is ValueError else "it lacks its beginning"
        problem = f"the mesh is damaged: this is not a complete GLB: {why}"
        raise BadInput(problem, where=str(path), hint="export or download it again") from error


def _parse(text: bytes, path: Path) -> Document:
    """Return the document; raise BadInput if it is not glTF 2.0, or has keys or extensions that are not read."""
    try:
        return Document.model_validate_json(text.removeprefix(b"\xef\xbb\xbf"))
    except ValidationError as error:
        first = error.errors()[0]
        at = ".".join(str(key) for key in first["loc"]).removesuffix(".[key]")
        problem = f"{at or 'the file'} is {first['input']!r:.80}"
        allowed = first["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
        if first["type"] in ("extra_forbidden", "missing"):
            problem, allowed = f"{at} is {'missing' if first['type'] == 'missing' else 'not read'}", ""
        elif first["type"] == "value_error":
            problem = f"the extension {first['input']!r:.80} is not read"
        elif first["type"] == "json_invalid":
            problem, allowed = f"the mesh is damaged: this is not JSON: {first['msg']}", ""
        names = [str(first["input"]), *(str(key) for key in reversed(first["loc"]))]
        without = " without it" if first["type"] in ("extra_forbidden", "value_error") else ""
        hint = next((HINTS[name] for name in names if name in HINTS), f"export it again{without}")
        raise BadInput(problem, where=str(path), allowed=allowed, hint=hint) from error


def _check(document: Document, path: Path) -> None:
    """Raise BadInput for a tree that is none, arrays of other types than are read, and too many shapes."""

    def refusal(problem: str, *, allowed: str = "", hint: str = "export it again") -> BadInput:
        return BadInput(problem, where=str(path), allowed=allowed, hint=hint)

    try:
        roots = document.scenes[document.scene].nodes
        children = [*chain.from_iterable(node.children for node in document.nodes), *roots]
        if max(children, default=0) >= max(len(document.nodes), 1):
            raise IndexError
        if any(node.camera is not None and node.camera >= len(document.cameras) for node in document.nodes):
            raise IndexError
        if len(set(children)) < len(children):
            raise refusal("a node has two parents or is listed twice, or the nodes form a circle")
        primitives: list[Primitive] = []
        for mesh in document.meshes:
            primitives += mesh.primitives
        drawn = [p for n in document.nodes if n.mesh is not None for p in document.meshes[n.mesh].primitives]
        if max(len(primitives), len(drawn)) > MAX_SHAPES:
            raise refusal(f"the file has more than {MAX_SHAPES:,} shapes", hint="join its meshes, then export it again")
        for primitive in primitives:
            if "POSITION" not in primitive.attributes:
                raise refusal("a mesh has no POSITION")
            arrays = {**primitive.attributes}
            arrays |= {} if primitive.indices is None else {"indices": primitive.indices}
            for key in ACCESSORS.keys() & arrays.keys():
                accessor = document.accessors[arrays[key]]
                kind = f"{accessor.type} {accessor.component_type}{' normalized' if accessor.normalized else ''}"
                if kind not in ACCESSORS[key]:
                    allowed, hint = ", ".join(ACCESSORS[key]), HINTS["KHR_mesh_quantization"]
                    raise refusal(f"{key} is stored as {kind}", allowed=allowed, hint=hint)
        accessors = [n for p in (*primitives, *drawn) for n in (p.attributes["POSITION"], p.indices) if n is not None]
        corners = sum(document.accessors[n].count for n in accessors)
    except IndexError as error:
        raise refusal("the file names a scene, node, mesh, camera or accessor that does not exist") from error
    if max(corners, sum(accessor.count for accessor in document.accessors)) > 2 * MAX_CORNERS:
        raise refusal(f"its shapes have more than {MAX_CORNERS:,} corners and vertices", hint="reduce the mesh")


def _say(document: Document, left_out: LeftOut, *, whole: bool) -> None:
    """Add what is left out of the file besides its materials."""
    if document.animations:
        left_out.add("animation ignored, the pose of the nodes is used")
    for node in document.nodes:
        if node.camera is not None and not whole:
            left_out.add("cameras ignored", node.name or "camera")
    for entry in (*document.nodes, *document.meshes, *(p for mesh in document.meshes for p in mesh.primitives)):
        for key in entry.extensions:
            if EXTENSIONS[key] and not (whole and key == "KHR_lights_punctual"):
                left_out.add(EXTENSIONS[key], entry.name)
    for n, scene in enumerate(document.scenes):
        if n != document.scene:
            left_out.add("scenes ignored", scene.name or f"scene {n}")


def _resource(uri: str, path: Path, *, what: str) -> bytes:
    """Return the data of a URI, which is in it or in a file beside the mesh."""
    if uri[:5].lower() != "data:":
        return read_beside(unquote(uri), path, what=what)
    head, _, body = uri.partition(",")
    try:
        if not head.lower().endswith(";base64"):
            raise ValueError("no ;base64")
        return base64.b64decode(body, validate=True)
    except (binascii.Error, ValueError) as error:
        raise BadInput(f"a {what} has data that are not base64: {error}", where=str(path)) from error


@dataclass(frozen=True)
class _Gltf:
    """Shapes of what trimesh read of a file, with the matt part of their materials."""

    path: Path
    document: Document
    left_out: LeftOut
    pictures: Pictures
    whole: bool

    def refusal(self, problem: str, *, allowed: str = "") -> BadInput:
        return BadInput(problem, where=str(self.path), allowed=allowed, hint="export it again")

    def shape(self, loaded: dict[str, Any], world: np.ndarray, *, name: str, primitive: Primitive) -> Shape:
        """Return the shape of a primitive below a node with a transform to the scene."""
        visual, attributes = loaded.get("visual"), primitive.attributes
        if any(key.startswith("COLOR_") and key != "COLOR_0" for key in attributes):
            self.left_out.add("second vertex colours ignored", name)
        stored = loaded.get("vertex_colors") if visual is None else visual.vertex_attributes.get("color")
        if (stored is None) == ("COLOR_0" in attributes):
            raise self.refusal(f"the colours of {name!r} do not fit its vertices")
        full = 1 if stored is None or stored.dtype.kind == "f" else np.iinfo(stored.dtype).max
        colours = None if stored is None else as_array(stored) / full
        surface = Surface(GREY if colours is None else (1.0, 1.0, 1.0))
        if primitive.material is not None:
            material = self.document.materials[primitive.material]
            surface = self._surface(material, material.name or name, visual=visual)
        elif colours is None:  # the format's own is a white metal, and Blender shows 0.8
            self.left_out.add(f"no material, so it reflects {GREY[0]:g}", name)
        if colours is not None and (colours[:, 3:] < 1).any() and surface.alpha != "opaque":
            self.left_out.add("opacity of vertices ignored", name)
        linear = world[:3, :3]
        sign = -1 if np.linalg.det(linear) < 0 else 1
        cofactors = np.stack([np.cross(linear[(n + 1) % 3], linear[(n + 2) % 3]) for n in range(3)])
        normals = optional(loaded.get("vertex_normals"))
        return Shape(
            name,
            as_array(loaded["vertices"]) @ linear.T + world[:3, 3],
            as_array(loaded["faces"], np.int64)[:, ::sign],
            surface,
            normals=None if normals is None else normals @ cofactors.T * sign,
            uv=uv_of(visual),
            colours=None if colours is None else np.clip(colours[:, :3], 0, 1),
            flat=normals is None,
        )

    def _surface(self, material: Material, name: str, *, visual: Any) -> Surface:
        pbr = material.pbr_metallic_roughness or MetallicRoughness.model_validate({"metallicFactor": 0})
        self._say_what_is_ignored(material, pbr, name=name)
        glow = material.emissive_factor
        use = material.emissive_texture if any(glow) else None
        base = pbr.base_color_texture
        gloss = pbr.metallic_roughness_texture if self.whole else None
        samplers = {self._sampler(one, name) for one in (base, use, gloss) if one is not None}
        if len(samplers) > 1:
            raise self.refusal(f"the textures of {name!r} have different samplers", allowed="the same for all")
        wrap, smooth = next(iter(samplers), ("repeat", True))
        try:
            stated = material.extensions.get("KHR_materials_emissive_strength", {})
            strength = EmissiveStrength.model_validate(stated).emissive_strength
            index = Refraction.model_validate(material.extensions.get("KHR_materials_ior", {})).ior
        except ValidationError as error:
            problem = f"{error.title} of {name!r} is {error.errors()[0]['input']!r:.80}"
            raise self.refusal(problem, allowed="a strength of 0 or more, an index above 1") from None
        (r, g, b), (red, green, blue, opacity) = glow, pbr.base_color_factor
        return Surface(
            (red, green, blue),
            None if base is None else self._picture(visual.material.baseColorTexture, name),
            opacity=opacity,
            alpha=material.alpha_mode.lower(),  # type: ignore[arg-type]
            cutoff=material.alpha_cutoff,
            emission=(r * strength, g * strength, b * strength),
            emission_picture=None if use is None else self._picture(visual.material.emissiveTexture, name),
            wrap=wrap,
            smooth=smooth,
            roughness=pbr.roughness_factor,
            metallic=pbr.metallic_factor,
            gloss_picture=None if gloss is None else self._picture(visual.material.metallicRoughnessTexture, name),
            index=index,
        )

    def _picture(self, image: Any, name: str) -> np.ndarray:
        return self.pictures.pixels(id(image), lambda: image, name=f"of {name}")

    def _sampler(self, use: TextureUse, name: str) -> tuple[Literal["repeat", "mirror", "clamp"], bool]:
        """Return what a texture shows outside its picture, and whether it is interpolated."""
        try:
            number = self.document.textures[use.index].sampler
            sampler = Sampler() if number is None else self.document.samplers[number]
        except IndexError:
            raise self.refusal(f"the texture of {name!r} does not exist") from None
        if sampler.wrap_t != sampler.wrap_s:
            raise self.refusal(f"the texture of {name!r} repeats otherwise along u than along v", allowed="the same")
        return WRAPS[sampler.wrap_s], sampler.mag_filter != NEAREST

    def _say_what_is_ignored(self, material: Material, pbr: MetallicRoughness, *, name: str) -> None:
        matt = not self.whole
        stated = {
            "metallic ignored": matt and pbr.metallic_factor > 0 and "KHR_materials_unlit" not in material.extensions,
            "gloss ignored": matt and (pbr.roughness_factor < 1 or pbr.metallic_roughness_texture is not None),
            "normal map ignored": material.normal_texture is not None,
            "occlusion map ignored": material.occlusion_texture is not None,
            "emission of back sides ignored": material.double_sided and any(material.emissive_factor),
        }
        lines = [key for key, there in stated.items() if there] + [EXTENSIONS[key] for key in material.extensions]
        for line in filter(None, lines):
            self.left_out.add(line, name)
