"""Shapes of a glTF 2.0 file: placed by its nodes in their rest pose, with the matt part of their materials.

References
----------
Khronos Group, "glTF 2.0 Specification", 2021: §3.5 (nodes), §3.7 (meshes, skins, morph targets), §3.9 (materials).
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from saf_gen.authoring.meshes.gltf_file import (
    COMPRESSED,
    Entry,
    GltfFile,
    Index,
    Material,
    MetallicRoughness,
    Node,
    Primitive,
    TextureUse,
    Vector2,
)
from saf_gen.authoring.meshes.shapes import GREY, MAX_CORNERS, MAX_SHAPES, LeftOut, Shape, Surface, checked

COMPRESSIONS = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
KEPT = (
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "EXT_texture_webp",
)
IGNORED = {
    "KHR_materials_anisotropy": "anisotropy",
    "KHR_materials_clearcoat": "clearcoat",
    "KHR_materials_diffuse_transmission": "diffuse transmission",
    "KHR_materials_dispersion": "dispersion",
    "KHR_materials_ior": "",  # alone, it changes only the gloss
    "KHR_materials_iridescence": "iridescence",
    "KHR_materials_sheen": "sheen",
    "KHR_materials_specular": "specular reflection",
    "KHR_materials_transmission": "transmission",
    "KHR_materials_unlit": "unlit shading",
    "KHR_materials_volume": "volume",
}
"""What each extension of a material adds that is left out."""
SAID = ("KHR_lights_punctual", "KHR_materials_variants", "KHR_xmp_json_ld", "KHR_animation_pointer")
KNOWN = (*KEPT, *IGNORED, *SAID)
WRAPS = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
NEAREST = 9728
MAX_SKIN_SETS = 4


def read_gltf(path: Path, left_out: LeftOut) -> list[Shape]:
    """Return the shapes of the file's scene, in its coordinates.

    Parameters
    ----------
    path : Path
        A .gltf or .glb file.
    left_out : LeftOut
        Receives what is left out.

    Returns
    -------
    list of Shape

    Raises
    ------
    BadInput
        If the file is damaged, needs an extension that is not supported, or names a file that is missing or outside
        its folder.
    """
    return _Reader(GltfFile(path), left_out).shapes()


class TextureTransform(Entry):
    """The extension KHR_texture_transform."""

    offset: Vector2 = (0, 0)
    rotation: float = 0
    scale: Vector2 = (1, 1)
    tex_coord: Index | None = None


class SpecularGlossiness(Entry):
    """The extension KHR_materials_pbrSpecularGlossiness, of which the diffuse part is used."""

    diffuse_factor: tuple[float, float, float, float] = (1, 1, 1, 1)
    diffuse_texture: TextureUse | None = None


class EmissiveStrength(Entry):
    """The extension KHR_materials_emissive_strength."""

    emissive_strength: float = 1


class _Reader:
    def __init__(self, file: GltfFile, left_out: LeftOut) -> None:
        self.file, self.left_out = file, left_out
        self.document = file.document
        self._worlds: list[np.ndarray] = []  # transforms of the nodes to the scene
        self._corners = 0

    def shapes(self) -> list[Shape]:
        self._check_extensions()
        self._say_what_is_not_drawn()
        self._worlds = self._place_nodes()
        shapes: list[Shape] = []
        for index in self._drawn_nodes():
            node = self.document.nodes[index]
            if node.mesh is None:
                continue
            mesh = self.file.get(self.document.meshes, node.mesh, what="mesh")
            name = node.name or mesh.name or f"node_{index}"
            weights = node.weights if node.weights is not None else mesh.weights
            for k, primitive in enumerate(mesh.primitives):
                self._say_extensions(node, mesh, primitive)
                of = f"{name}_{k + 1}" if len(mesh.primitives) > 1 else name
                shape = self._shape(primitive, of, index=index, weights=weights)
                shapes += [shape] if shape is not None else []
                if len(shapes) > MAX_SHAPES:
                    raise self.file.refuse(
                        f"the file has more than {MAX_SHAPES:,} shapes", hint="join its meshes, then export it again"
                    )
        return shapes

    def _check_extensions(self) -> None:
        missing = [name for name in self.document.extensions_required if name not in KNOWN]
        if missing:
            compressed = [name for name in missing if name in COMPRESSIONS]
            hint = COMPRESSED if compressed else f"export it without {', '.join(missing)}"
            if "KHR_texture_basisu" in missing:
                hint = "convert its textures to PNG: gltf-transform ktxdecompress IN.glb OUT.glb"
            raise self.file.refuse(f"the file requires {', '.join(missing)}, which saf_gen cannot read", hint=hint)
        for name in self.document.extensions_used:
            if name not in (*KNOWN, *COMPRESSIONS, "KHR_texture_basisu"):
                self.left_out.add("extensions ignored", name)

    def _say_extensions(self, *entries: Entry) -> None:
        for name in (name for entry in entries for name in entry.extensions):
            if name not in (*KNOWN, *COMPRESSIONS):
                self.left_out.add("extensions ignored", name)

    def _say_what_is_not_drawn(self) -> None:
        document = self.document
        if "KHR_materials_variants" in document.extensions:
            self.left_out.add("material variants ignored, the default is used")
        if document.animations:
            self.left_out.add("animation ignored, the pose of the nodes is used")
        cameras = [node.name or "camera" for node in document.nodes if node.camera is not None]
        lamps = [node.name or "lamp" for node in document.nodes if "KHR_lights_punctual" in node.extensions]
        for kind, names in (("cameras ignored", cameras), ("lamps ignored", lamps)):
            for name in names:
                self.left_out.add(kind, name)
        for n, scene in enumerate(document.scenes):
            if n != (document.scene or 0):
                self.left_out.add("scenes ignored", scene.name or f"scene {n}")

    def _drawn_nodes(self) -> Iterator[int]:
        """Yield the nodes of the file's scene, parents first; all nodes if the file has no scene."""
        document = self.document
        if not document.scenes:
            yield from range(len(document.nodes))
            return
        left = list(reversed(self.file.get(document.scenes, document.scene or 0, what="scene").nodes))
        while left:  # no node has two parents, so this ends
            index = left.pop()
            left += reversed(self.file.get(document.nodes, index, what="node").children)
            yield index

    def _place_nodes(self) -> list[np.ndarray]:
        """Return the transform to the scene of each node, float64 (4, 4)."""
        nodes = self.document.nodes
        parents: dict[int, int] = {}
        for index, node in enumerate(nodes):
            for child in node.children:
                self.file.get(nodes, child, what="node")
                if parents.setdefault(child, index) != index or node.children.count(child) > 1:
                    raise self.file.refuse(f"node {child} has two parents")
        worlds: dict[int, np.ndarray] = {}
        left = [index for index in range(len(nodes)) if index not in parents]
        while left:
            index = left.pop()
            own = _local(nodes[index])
            worlds[index] = worlds[parents[index]] @ own if index in parents else own
            left += nodes[index].children
        if len(worlds) < len(nodes):
            raise self.file.refuse("its nodes form a circle")
        roots = [index for scene in self.document.scenes for index in scene.nodes]
        if any(index in parents for index in roots) or any(
            len(set(s.nodes)) < len(s.nodes) for s in self.document.scenes
        ):
            raise self.file.refuse("a node of the scene has a parent, or is listed twice")
        return [worlds[index] for index in range(len(nodes))]

    def _shape(self, primitive: Primitive, name: str, *, index: int, weights: list[float]) -> Shape | None:
        """Return the shape of a primitive below a node, or None if it has no triangle."""
        if "KHR_draco_mesh_compression" in primitive.extensions:
            first = self.file.get(self.document.accessors, primitive.attributes.get("POSITION", 0), what="accessor")
            if first.buffer_view is None:  # the file has no copy that is not compressed
                raise self.file.refuse(f"the mesh {name!r} is compressed with Draco", hint=COMPRESSED)
        if primitive.mode < 4:
            self.left_out.add("points and lines ignored", name)
            return None
        if "POSITION" not in primitive.attributes:
            self.left_out.add("meshes without coordinates ignored", name)
            return None
        points = self._attribute(primitive, "POSITION", kinds=("VEC3",))
        triangles = self._triangles(primitive, len(points))
        self._corners += triangles.size + len(points)
        if self._corners > MAX_CORNERS:
            raise self.file.refuse(
                f"its shapes have more than {MAX_CORNERS:,} corners and vertices", hint="reduce the mesh"
            )
        if not triangles.size:
            return None
        normals = self._attribute(primitive, "NORMAL", kinds=("VEC3",)) if "NORMAL" in primitive.attributes else None
        if any(weights):
            points, normals = self._morphed(primitive, weights, points=points, normals=normals)
        elif primitive.targets:
            self.left_out.add("morph targets ignored, their weights are 0", name)
        skin = self.document.nodes[index].skin
        if skin is None or "JOINTS_0" not in primitive.attributes:
            points, normals, mirrored = _placed(points, normals, world=self._worlds[index])
        else:
            points, normals, mirrored = self._skinned(primitive, skin, points=points, normals=normals)
        if mirrored:
            triangles = triangles[:, [0, 2, 1]]
        colours = self._colours(primitive, name)
        if primitive.material is None:
            surface, where = Surface(GREY if colours is None else (1.0, 1.0, 1.0)), None
        else:
            material = self.file.get(self.document.materials, primitive.material, what="material")
            surface, where = self._surface(material, material.name or name)
        uv = self._uv(primitive, where, name=name) if where is not None else None
        shape = Shape(name, points, triangles, surface, normals, uv, colours, normals is None)
        return checked(shape, self.left_out, path=self.file.path)

    def _attribute(self, primitive: Primitive, key: str, *, kinds: tuple[str, ...]) -> np.ndarray:
        values = self.file.array(primitive.attributes[key], kinds=kinds).astype(np.float64)
        count = self.file.get(self.document.accessors, primitive.attributes["POSITION"], what="accessor").count
        if len(values) != count:
            raise self.file.refuse(f"a mesh has {len(values)} values of {key} for {count} vertices")
        return values

    def _triangles(self, primitive: Primitive, count: int) -> np.ndarray:
        """Return the vertices of the triangles, int64 (triangle, 3), of a list, a strip or a fan."""
        if primitive.indices is None:
            at = np.arange(count)
        else:
            at = self.file.array(primitive.indices, kinds=("SCALAR",)).astype(np.int64)
        if primitive.mode == 4:
            if at.size % 3:
                raise self.file.refuse(f"a mesh has {at.size} corners, which is not a multiple of 3")
            return at.reshape(-1, 3)
        if at.size < 3:
            return np.zeros((0, 3), np.int64)
        if primitive.mode == 6:
            return np.stack([np.full(at.size - 2, at[0]), at[1:-1], at[2:]], axis=1)
        strip = np.stack([at[:-2], at[1:-1], at[2:]], axis=1)
        strip[1::2] = strip[1::2][:, [1, 0, 2]]  # every other triangle is wound the other way
        return strip

    def _morphed(
        self, primitive: Primitive, weights: list[float], *, points: np.ndarray, normals: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | None]:
        for weight, target in zip(weights, primitive.targets, strict=False):
            for key in ("POSITION", "NORMAL"):
                if not weight or key not in target or (key == "NORMAL" and normals is None):
                    continue
                moved = self.file.array(target[key], kinds=("VEC3",))
                if moved.shape != points.shape:
                    raise self.file.refuse(f"a morph target has {len(moved)} values for {len(points)} vertices")
                if key == "POSITION":
                    points = points + weight * moved
                elif normals is not None:
                    normals = normals + weight * moved
        return points, normals

    def _skinned(
        self, primitive: Primitive, index: int, *, points: np.ndarray, normals: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | None, bool]:
        """Return points and normals as the joints place them; the transform of the mesh's node is ignored."""
        skin = self.file.get(self.document.skins, index, what="skin")
        poses = np.array([self.file.get(self._worlds, joint, what="node") for joint in skin.joints]).reshape(-1, 4, 4)
        if skin.inverse_bind_matrices is not None:
            binds = self.file.array(skin.inverse_bind_matrices, kinds=("MAT4",))
            if len(binds) < len(poses):
                raise self.file.refuse(f"skin {index} has {len(binds)} matrices for {len(poses)} joints")
            poses = poses @ binds[: len(poses)].reshape(-1, 4, 4).transpose(0, 2, 1)
        blend = np.zeros((len(points), 4, 4))
        for k in range(MAX_SKIN_SETS):
            if f"JOINTS_{k}" not in primitive.attributes or f"WEIGHTS_{k}" not in primitive.attributes:
                break
            joints = self._attribute(primitive, f"JOINTS_{k}", kinds=("VEC4",)).astype(np.int64)
            shares = self._attribute(primitive, f"WEIGHTS_{k}", kinds=("VEC4",))
            if joints.size and not (joints.min() >= 0 and joints.max() < len(poses)):
                raise self.file.refuse(f"a vertex has the joint {joints.max()} of {len(poses)}")
            for n in range(4):
                blend += shares[:, n, None, None] * poses[joints[:, n]]
        scale = blend[:, 3, 3]
        if not (np.isfinite(blend).all() and (scale > 1e-6).all()):
            raise self.file.refuse(f"the weights of skin {index} do not add up to 1")
        blend = blend / scale[:, None, None]
        moved = np.einsum("nij,nj->ni", blend[:, :3, :3], points) + blend[:, :3, 3]
        turned = None if normals is None else np.einsum("nij,nj->ni", blend[:, :3, :3], normals)
        mirrored = bool(np.median(np.linalg.det(blend[:, :3, :3])) < 0)
        return moved, turned, mirrored

    def _colours(self, primitive: Primitive, name: str) -> np.ndarray | None:
        """Return the linear colours and the opacity of the vertices, float64 (vertex, 4)."""
        if any(key.startswith("COLOR_") and key != "COLOR_0" for key in primitive.attributes):
            self.left_out.add("second vertex colours ignored", name)
        if "COLOR_0" not in primitive.attributes:
            return None
        colours = self._attribute(primitive, "COLOR_0", kinds=("VEC3", "VEC4"))
        accessor = self.document.accessors[primitive.attributes["COLOR_0"]]
        if accessor.component_type != 5126 and not accessor.normalized:
            raise self.file.refuse(f"the vertex colours of {name!r} are integers that are not normalised")
        colours = np.clip(colours, 0, 1)
        return colours if colours.shape[1] == 4 else np.column_stack([colours, np.ones(len(colours))])

    def _uv(self, primitive: Primitive, where: tuple[int, TextureTransform], *, name: str) -> np.ndarray:
        number, transform = where
        key = f"TEXCOORD_{number}"
        if key not in primitive.attributes:
            raise self.file.refuse(f"the texture of {name!r} needs {key}, which its mesh does not have")
        return transform_uv(self._attribute(primitive, key, kinds=("VEC2",)), transform)

    def _surface(self, material: Material, name: str) -> tuple[Surface, tuple[int, TextureTransform] | None]:
        """Return a material's surface, and the set and transform of its texture coordinates, None without a texture."""
        pbr = material.pbr_metallic_roughness or MetallicRoughness()
        use, factor = pbr.base_color_texture, pbr.base_color_factor
        self._say_what_is_ignored(material, pbr, name=name)
        old = material.extensions.get("KHR_materials_pbrSpecularGlossiness")
        if old is not None:
            gloss = self._extension(SpecularGlossiness, old)
            use, factor = gloss.diffuse_texture, gloss.diffuse_factor
        picture, where, smooth, wrap = self._texture(use, name)
        emission, glow, glow_where = material.emissive_factor, None, None
        if any(emission) and material.emissive_texture is not None:
            glow, glow_where, glow_smooth, glow_wrap = self._texture(material.emissive_texture, name)
            if picture is None:
                smooth, wrap = glow_smooth, glow_wrap
            elif glow_where != where:
                self.left_out.add("emission ignored, its texture has other coordinates than the colour's", name)
                emission, glow = (0.0, 0.0, 0.0), None
            elif (glow_smooth, glow_wrap) != (smooth, wrap):
                self.left_out.add("sampler of the emission ignored, that of the colour is used", name)
        strength = self._extension(
            EmissiveStrength, material.extensions.get("KHR_materials_emissive_strength", {})
        ).emissive_strength
        red, green, blue = (float(np.clip(c, 0, 1)) for c in factor[:3])
        surface = Surface(
            colour=(red, green, blue),
            picture=picture,
            opacity=float(factor[3]),
            alpha=material.alpha_mode.lower(),  # type: ignore[arg-type]
            cutoff=material.alpha_cutoff,
            emission=(emission[0] * strength, emission[1] * strength, emission[2] * strength),
            emission_picture=glow,
            wrap=wrap,  # type: ignore[arg-type]
            smooth=smooth,
        )
        return surface, where or glow_where

    def _say_what_is_ignored(self, material: Material, pbr: MetallicRoughness, *, name: str) -> None:
        ext = material.extensions
        old = "KHR_materials_pbrSpecularGlossiness" in ext
        found = {
            "metallic": not old and pbr.metallic_factor > 0 and "KHR_materials_unlit" not in ext,
            "gloss": old or pbr.roughness_factor < 1 or pbr.metallic_roughness_texture is not None,
            "normal map": material.normal_texture is not None,
            "occlusion map": material.occlusion_texture is not None,
            "emission of back sides": material.double_sided and any(material.emissive_factor),
        } | {what: key in ext for key, what in IGNORED.items() if what}
        if material.pbr_metallic_roughness is None and not old:
            found["metallic"] = False  # the file says nothing
        for what, there in found.items():
            if there:
                self.left_out.add(f"{what} ignored", name)
        self._say_extensions(material)

    def _texture(
        self, use: TextureUse | None, name: str
    ) -> tuple[np.ndarray | None, tuple[int, TextureTransform] | None, bool, str]:
        """Return picture, coordinates (set and transform), whether it is interpolated, and how it repeats."""
        if use is None:
            return None, None, True, "repeat"
        texture = self.file.get(self.document.textures, use.index, what="texture")
        source = texture.source
        webp = texture.extensions.get("EXT_texture_webp")
        if isinstance(webp, dict) and isinstance(webp.get("source"), int) and webp["source"] >= 0:
            source = webp["source"]
        if source is None:
            raise self.file.refuse(
                f"the texture of {name!r} is stored by {', '.join(texture.extensions) or 'nothing'}",
                hint="convert it to PNG: gltf-transform ktxdecompress IN.glb OUT.glb",
                allowed="PNG, JPEG, WebP",
            )
        transform = self._extension(TextureTransform, use.extensions.get("KHR_texture_transform", {}))
        number = transform.tex_coord if transform.tex_coord is not None else use.tex_coord
        nearest, wrap = False, "repeat"
        if texture.sampler is not None:
            sampler = self.file.get(self.document.samplers, texture.sampler, what="sampler")
            nearest, wrap = sampler.mag_filter == NEAREST, WRAPS[sampler.wrap_s]
            if sampler.wrap_t != sampler.wrap_s:
                self.left_out.add("wrapT ignored, wrapS is used for both axes", name)
        where = (number, transform.model_copy(update={"tex_coord": None}))
        return self.file.picture(source), where, not nearest, wrap

    def _extension(self, model: type[Any], data: Any) -> Any:
        try:
            return model.model_validate(data)
        except ValidationError as error:
            first = error.errors()[0]
            at = ".".join([model.__name__, *(str(key) for key in first["loc"])])
            raise self.file.refuse(f"{at} is {repr(first['input'])[:80]}", allowed=first["msg"]) from error


def transform_uv(uv: np.ndarray, transform: TextureTransform) -> np.ndarray:
    """Return texture coordinates after KHR_texture_transform, float64 (vertex, 2).

    The sign of the rotation is that of the extension's text and of its example, which shows the lower left quarter of
    a picture; its GLSL has the other sign (issue 1563 of KhronosGroup/glTF).
    """
    (u, v), (x, y) = (uv * transform.scale).T, transform.offset
    cos, sin = math.cos(transform.rotation), math.sin(transform.rotation)
    return np.column_stack([cos * u + sin * v + x, cos * v - sin * u + y])


def _local(node: Node) -> np.ndarray:
    """Return a node's transform to its parent, float64 (4, 4)."""
    if node.matrix is not None:
        return np.array(node.matrix).reshape(4, 4).T
    x, y, z, w = np.array(node.rotation) / (np.linalg.norm(node.rotation) or 1)
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    local = np.eye(4)
    local[:3, :3], local[:3, 3] = np.array(turn) * node.scale, node.translation
    return local


def _placed(
    points: np.ndarray, normals: np.ndarray | None, *, world: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None, bool]:
    """Return points and normals after a transform, and whether it mirrors."""
    linear = world[:3, :3]
    moved = points @ linear.T + world[:3, 3]
    cofactors = np.stack([np.cross(linear[(n + 1) % 3], linear[(n + 2) % 3]) for n in range(3)])
    mirrored = bool(np.linalg.det(linear) < 0)
    turned = None if normals is None else normals @ cofactors.T * (-1 if mirrored else 1)
    return moved, turned, mirrored
