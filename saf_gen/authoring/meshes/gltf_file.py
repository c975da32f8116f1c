"""A glTF 2.0 file as it is stored: container, checked document, buffers, arrays and pictures.

Nothing outside the file's folder is read, and no array is larger than the bytes that the file has for it.

References
----------
Khronos Group, "glTF 2.0 Specification", 2021: §3.6 (buffers and accessors), §4 (GLB).
"""

import base64
import binascii
import json
import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar
from urllib.parse import unquote

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.alias_generators import to_camel

from saf_gen.authoring.meshes.shapes import MAX_CORNERS
from saf_gen.authoring.meshes.side_files import Pictures, find_side_file, read_bytes
from saf_gen.errors import BadInput

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MAX_ZEROS = 6_000_000
"""Most numbers of an accessor without a buffer view: zeros, of which the file holds none."""
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942

Index = Annotated[int, Field(ge=0)]
Vector2 = tuple[float, float]
Vector3 = tuple[float, float, float]
Vector4 = tuple[float, float, float, float]
Unit = Annotated[float, Field(ge=0, le=1)]


class Entry(BaseModel):
    """A part of the document; keys that are not listed are ignored, as glTF demands."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False, alias_generator=to_camel, protected_namespaces=())
    name: str = ""
    extensions: dict[str, Any] = {}


class Asset(Entry):
    version: str
    min_version: str = ""


class Buffer(Entry):
    byte_length: Index
    uri: str | None = None


class BufferView(Entry):
    buffer: Index
    byte_offset: Index = 0
    byte_length: Index
    byte_stride: Annotated[int, Field(ge=4, le=252)] | None = None


class SparseIndices(Entry):
    buffer_view: Index
    byte_offset: Index = 0
    component_type: Literal[5121, 5123, 5125]


class SparseValues(Entry):
    buffer_view: Index
    byte_offset: Index = 0


class Sparse(Entry):
    count: Index
    indices: SparseIndices
    values: SparseValues


class Accessor(Entry):
    buffer_view: Index | None = None
    byte_offset: Index = 0
    component_type: Literal[5120, 5121, 5122, 5123, 5125, 5126]
    normalized: bool = False
    count: Index
    type: Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]
    sparse: Sparse | None = None


class Primitive(Entry):
    attributes: dict[str, Index]
    indices: Index | None = None
    material: Index | None = None
    mode: Annotated[int, Field(ge=0, le=6)] = 4
    targets: list[dict[str, Index]] = []


class Mesh(Entry):
    primitives: list[Primitive]
    weights: list[float] = []


class Node(Entry):
    children: list[Index] = []
    mesh: Index | None = None
    skin: Index | None = None
    camera: Index | None = None
    matrix: Annotated[list[float], Field(min_length=16, max_length=16)] | None = None
    translation: Vector3 = (0, 0, 0)
    rotation: Vector4 = (0, 0, 0, 1)
    scale: Vector3 = (1, 1, 1)
    weights: list[float] | None = None


class Scene(Entry):
    nodes: list[Index] = []


class Skin(Entry):
    inverse_bind_matrices: Index | None = None
    joints: list[Index]


class Picture(Entry):
    uri: str | None = None
    buffer_view: Index | None = None


class Sampler(Entry):
    mag_filter: int = 9729
    wrap_s: Literal[10497, 33648, 33071] = 10497
    wrap_t: Literal[10497, 33648, 33071] = 10497


class Texture(Entry):
    sampler: Index | None = None
    source: Index | None = None


class TextureUse(Entry):
    index: Index
    tex_coord: Index = 0


class MetallicRoughness(Entry):
    base_color_factor: tuple[Unit, Unit, Unit, Unit] = (1, 1, 1, 1)
    base_color_texture: TextureUse | None = None
    metallic_factor: Unit = 1
    roughness_factor: Unit = 1
    metallic_roughness_texture: TextureUse | None = None


class Material(Entry):
    pbr_metallic_roughness: MetallicRoughness | None = None
    normal_texture: TextureUse | None = None
    occlusion_texture: TextureUse | None = None
    emissive_texture: TextureUse | None = None
    emissive_factor: tuple[Unit, Unit, Unit] = (0, 0, 0)
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    alpha_cutoff: Annotated[float, Field(ge=0)] = 0.5
    double_sided: bool = False


class Document(Entry):
    """The document: glTF 2.0 §5.17."""

    asset: Asset
    scene: Index | None = None
    scenes: list[Scene] = []
    nodes: list[Node] = []
    meshes: list[Mesh] = []
    accessors: list[Accessor] = []
    buffers: list[Buffer] = []
    buffer_views: list[BufferView] = []
    materials: list[Material] = []
    textures: list[Texture] = []
    images: list[Picture] = []
    samplers: list[Sampler] = []
    skins: list[Skin] = []
    animations: list[Any] = []
    cameras: list[Any] = []
    extensions_used: list[str] = []
    extensions_required: list[str] = []


One = TypeVar("One")


class GltfFile:
    """An open glTF file: its document, and its arrays and pictures by index."""

    def __init__(self, path: Path) -> None:
        self.path = path
        text, self._binary = _split_container(read_bytes(path), path)
        self.document = _parse(text, path)
        self._buffers: dict[int, bytes] = {}
        self._pictures = Pictures(path)

    def refuse(self, problem: str, *, hint: str = "export it again", allowed: str = "") -> BadInput:
        """Return the error for a fault of the file."""
        return BadInput(problem, where=str(self.path), hint=hint, allowed=allowed)

    def get(self, entries: Sequence[One], index: int, *, what: str) -> One:
        """Return an entry of a list of the document; raise BadInput if it does not exist."""
        if index >= len(entries):
            raise self.refuse(f"{what} {index} does not exist: the file has {len(entries)}")
        return entries[index]

    def array(self, index: int, *, kinds: Sequence[str] = ()) -> np.ndarray:
        """Return the values of an accessor: float64 if they are stored so or normalised, else int64.

        Parameters
        ----------
        index : int
            Number of the accessor.
        kinds : sequence of str, optional
            Allowed types, such as VEC3.

        Returns
        -------
        ndarray
            Shape (count,) for a scalar, (count, components) otherwise; a matrix is in columns.

        Raises
        ------
        BadInput
            If it does not exist, has another type, or the file is shorter than it says.
        """
        accessor = self.get(self.document.accessors, index, what="accessor")
        if kinds and accessor.type not in kinds:
            raise self.refuse(f"accessor {index} has the type {accessor.type}", allowed=" or ".join(kinds))
        width, kind = WIDTHS[accessor.type], np.dtype(COMPONENTS[accessor.component_type])
        most = MAX_CORNERS if accessor.buffer_view is not None else MAX_ZEROS
        if accessor.count * width > most:
            raise self.refuse(
                f"accessor {index} has {accessor.count * width:,} numbers",
                allowed=f"up to {most:,}",
                hint="reduce the mesh",
            )
        if accessor.buffer_view is None:
            stored = np.zeros((accessor.count, width), kind)
        else:
            stored = self._read(
                accessor.buffer_view, accessor.byte_offset, count=accessor.count, kind=kind, width=width
            )
        if accessor.sparse is not None:
            stored = self._fill_in(stored, accessor.sparse, index=index)
        values = stored.astype(np.float64) if accessor.component_type == 5126 else stored.astype(np.int64)
        if accessor.normalized and accessor.component_type != 5126:
            values = np.maximum(values / np.iinfo(kind).max, -1.0)
        return values[:, 0] if accessor.type == "SCALAR" else values

    def _fill_in(self, stored: np.ndarray, sparse: Sparse, *, index: int) -> np.ndarray:
        kind = np.dtype(COMPONENTS[sparse.indices.component_type])
        if sparse.count > len(stored):
            raise self.refuse(f"accessor {index} replaces {sparse.count} of its {len(stored)} values")
        at = self._read(
            sparse.indices.buffer_view, sparse.indices.byte_offset, count=sparse.count, kind=kind, width=1
        ).ravel()
        if at.size and at.max() >= len(stored):
            raise self.refuse(f"accessor {index} replaces value {at.max()} of {len(stored)}")
        filled = stored.copy()
        filled[at] = self._read(
            sparse.values.buffer_view,
            sparse.values.byte_offset,
            count=sparse.count,
            kind=stored.dtype,
            width=stored.shape[1],
        )
        return filled

    def _read(self, view: int, offset: int, *, count: int, kind: np.dtype, width: int) -> np.ndarray:
        """Return (count, width) values of a part of a buffer view."""
        data, stride = self._view(view)
        size = kind.itemsize * width
        step = stride or size
        if count and (step < size or offset + step * (count - 1) + size > len(data)):
            raise self.refuse(f"the file is shorter than it says: buffer view {view} has {len(data):,} bytes")
        if not count:
            return np.zeros((0, width), kind)
        values = np.ndarray((count, width), kind, data, offset, (step, kind.itemsize))
        return values

    def _view(self, index: int) -> tuple[bytes, int | None]:
        view = self.get(self.document.buffer_views, index, what="buffer view")
        if "EXT_meshopt_compression" in view.extensions or "KHR_meshopt_compression" in view.extensions:
            buffer = self.get(self.document.buffers, view.buffer, what="buffer")
            if buffer.uri is None and not (view.buffer == 0 and self._binary):
                raise self.refuse("its arrays are compressed with meshopt", hint=COMPRESSED)
        data = self._buffer(view.buffer)
        if view.byte_offset + view.byte_length > len(data):
            raise self.refuse(f"buffer view {index} ends after the {len(data):,} bytes of its buffer")
        return data[view.byte_offset : view.byte_offset + view.byte_length], view.byte_stride

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            buffer = self.get(self.document.buffers, index, what="buffer")
            if buffer.uri is not None:
                data = self._resource(buffer.uri, what="buffer")
            elif index == 0 and self._binary:
                data = self._binary
            else:
                raise self.refuse(f"buffer {index} has no data")
            if len(data) < buffer.byte_length:
                raise self.refuse(
                    f"buffer {index} has {len(data):,} bytes, not the {buffer.byte_length:,} that the file states"
                )
            self._buffers[index] = data
        return self._buffers[index]

    def picture(self, index: int) -> np.ndarray:
        """Return the pixels of an image, sRGB-coded, uint8 (rows, columns, 4); raise BadInput if it is unreadable."""
        image = self.get(self.document.images, index, what="image")
        name = image.name or f"image {index}"
        if image.uri is not None and not image.uri.startswith("data:"):
            name = image.uri

        def load() -> bytes:
            if image.buffer_view is not None:
                return self._view(image.buffer_view)[0]
            if image.uri is None:
                raise self.refuse(f"image {index} has no data")
            return self._resource(image.uri, what="texture")

        return self._pictures.decode(index, load, name=name)

    def _resource(self, uri: str, *, what: str) -> bytes:
        """Return the data of a URI, which is in it or in a file beside the mesh."""
        if uri[:5].lower() == "data:":
            head, comma, body = uri.partition(",")
            if not comma or not head.lower().endswith(";base64"):
                raise self.refuse(f"a {what} has data that are not base64: {uri[:40]!r}")
            try:
                return base64.b64decode(body, validate=True)
            except (binascii.Error, ValueError) as error:
                raise self.refuse(f"a {what} has data that are not base64: {error}") from error
        if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", uri):
            raise self.refuse(
                f"the {what} {uri!r} is on another machine or named by an absolute path",
                hint=f"copy it beside {self.path.name} and name it from there",
            )
        return read_bytes(find_side_file(unquote(uri), self.path, what=what))


COMPRESSED = "export it without compression; in Blender: import it, then File > Export > glTF 2.0 without Compression"


def _split_container(data: bytes, path: Path) -> tuple[bytes, bytes]:
    """Return the JSON text and the binary chunk of a glTF file, which may be a GLB whatever its name."""
    if data[:4] != b"glTF":
        if path.suffix.lower() == ".glb":
            raise BadInput("this is not a GLB: it does not begin with glTF", where=str(path), hint="export it again")
        return data, b""
    damaged = BadInput("the mesh is damaged: it is not a complete GLB", where=str(path), hint="export it again")
    if len(data) < 20:
        raise damaged
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise BadInput(f"the file is glTF {version}", where=str(path), allowed="glTF 2.0", hint="export it again")
    if length != len(data):
        raise BadInput(
            f"the mesh is damaged: it has {len(data):,} bytes, and says {length:,}",
            where=str(path),
            hint="export or download it again",
        )
    chunks, at = [], 12
    while at < length:
        if at + 8 > length:
            raise damaged
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise damaged
        chunks.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    if chunks[0][0] != JSON_CHUNK:
        raise damaged
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == BINARY_CHUNK else b""
    return chunks[0][1], binary


def _parse(text: bytes, path: Path) -> Document:
    """Return the checked document; raise BadInput if it is not glTF 2."""

    def refuse_constant(name: str) -> float:
        raise ValueError(f"{name} is not a number of JSON")

    try:
        data = json.loads(text.decode("utf-8-sig"), parse_constant=refuse_constant)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"the mesh is damaged: this is not JSON: {error}", where=str(path)) from error
    asset = data.get("asset") if isinstance(data, dict) else None
    version = asset.get("version") if isinstance(asset, dict) else None
    if not isinstance(version, str) or not version.startswith("2."):
        what = "is not glTF" if version is None else f"is glTF {str(version)[:20]}"
        raise BadInput(f"the file {what}", where=str(path), allowed="glTF 2.0", hint="export it again")
    try:
        document = Document.model_validate(data)
        if document.asset.min_version not in ("", "2.0"):
            needed = document.asset.min_version[:20]
            raise BadInput(f"the file needs glTF {needed}", where=str(path), allowed="glTF 2.0", hint="export it again")
        return document
    except ValidationError as error:
        first = error.errors()[0]
        at = ".".join(str(key) for key in first["loc"])
        value = repr(first["input"])[:80]
        raise BadInput(
            f"{at} is {value}",
            where=str(path),
            allowed=first["msg"].removeprefix("Input should be "),
            hint="export it again",
        ) from error
    except RecursionError as error:
        raise BadInput("the mesh is damaged: it is nested too deep", where=str(path)) from error
