"""What saf_gen reads of glTF 2.0: a list of keys before trimesh, which ignores the others and so changes what is shown.

References
----------
Khronos Group, "glTF 2.0 Specification", 2021: §5 (properties).
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic.alias_generators import to_camel

EXTENSIONS = {
    "KHR_materials_emissive_strength": "",
    "EXT_texture_webp": "",
    "KHR_materials_anisotropy": "anisotropy ignored",
    "KHR_materials_clearcoat": "clearcoat ignored",
    "KHR_materials_diffuse_transmission": "diffuse transmission ignored",
    "KHR_materials_dispersion": "dispersion ignored",
    "KHR_materials_ior": "",
    "KHR_materials_iridescence": "iridescence ignored",
    "KHR_materials_sheen": "sheen ignored",
    "KHR_materials_specular": "specular reflection ignored",
    "KHR_materials_transmission": "transmission ignored",
    "KHR_materials_unlit": "unlit shading ignored",
    "KHR_materials_volume": "volume ignored",
    "KHR_materials_variants": "material variants ignored, the default is used",
    "KHR_lights_punctual": "lamps ignored",
    "KHR_xmp_json_ld": "",  # names and licences
}
"""Extensions that are read or change nothing that saf_gen draws, and the line for each that is left out."""


def _listed(name: str) -> str:
    if name not in EXTENSIONS:
        raise ValueError(", ".join([*(known for known, line in EXTENSIONS.items() if not line), "lamps and materials"]))
    return name


Index = Annotated[int, Field(ge=0)]
Unit = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(ge=0)]
Vector3 = tuple[float, float, float]
Ignored = Annotated[Any, Field(exclude=True)]
Extensions = Annotated[dict[Annotated[str, AfterValidator(_listed)], Any], Field(exclude=True)]
Attribute = Annotated[str, Field(pattern=r"^(POSITION|NORMAL|TANGENT|(TEXCOORD|COLOR)_\d|_\w+)$")]


class Entry(BaseModel):
    """A part of the document; keys that are not listed are refused."""

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, alias_generator=to_camel, protected_namespaces=()
    )
    name: Annotated[str, Field(exclude=True)] = ""
    extras: Ignored = None
    extensions: Extensions = {}


class Asset(Entry):
    version: Literal["2.0"]
    min_version: Literal["2.0"] = "2.0"
    generator: Ignored = None
    copyright: Ignored = None


class Buffer(Entry):
    byte_length: Index
    uri: str | None = None


class BufferView(Entry):
    buffer: Index
    byte_offset: Index = 0
    byte_length: Index
    byte_stride: Annotated[int, Field(ge=4, le=252)] | None = None
    target: Ignored = None


class Accessor(Entry):
    buffer_view: Index
    byte_offset: Index = 0
    component_type: Literal[5120, 5121, 5122, 5123, 5125, 5126]
    normalized: bool = False
    count: Annotated[int, Field(ge=1)]
    type: Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]
    min: Ignored = None
    max: Ignored = None


class Primitive(Entry):
    attributes: dict[Attribute, Index]
    indices: Index | None = None
    material: Index | None = None
    mode: Literal[4] = 4


class Mesh(Entry):
    primitives: Annotated[list[Primitive], Field(min_length=1)]


class Node(Entry):
    children: list[Index] = []
    mesh: Index | None = None
    camera: Annotated[Index | None, Field(exclude=True)] = None
    matrix: Annotated[list[float], Field(min_length=16, max_length=16)] | None = None
    translation: Vector3 = (0, 0, 0)
    rotation: tuple[float, float, float, float] = (0, 0, 0, 1)
    scale: Vector3 = (1, 1, 1)


class Scene(Entry):
    nodes: list[Index] = []


class Perspective(Entry):
    yfov: Annotated[float, Field(gt=0, lt=3.1)]
    aspect_ratio: Annotated[float, Field(gt=0.01, lt=100)] = 1.6
    znear: Ignored = None
    zfar: Ignored = None


class Camera(Entry):
    type: Literal["perspective", "orthographic"]
    perspective: Perspective | None = None
    orthographic: Ignored = None


class Spot(Entry):
    """Angles from the axis to where the light begins to fall off, and to its end."""

    inner_cone_angle: Annotated[float, Field(ge=0)] = 0
    outer_cone_angle: Annotated[float, Field(gt=0, le=1.5708)] = 0.785398163


class Light(Entry):
    """A lamp of KHR_lights_punctual: candela, or lux if it is directional."""

    type: Literal["point", "spot", "directional"]
    color: tuple[Positive, Positive, Positive] = (1, 1, 1)
    intensity: Positive = 1
    spot: Spot = Spot()
    range: float | None = None


class Lights(Entry):
    lights: list[Light] = []


class LightUse(Entry):
    light: Index


class Image(Entry):
    uri: str | None = None
    buffer_view: Index | None = None
    mime_type: Ignored = None


class Sampler(Entry):
    mag_filter: int = 9729
    min_filter: Ignored = None
    wrap_s: Literal[10497, 33648, 33071] = 10497
    wrap_t: Literal[10497, 33648, 33071] = 10497


class WebP(Entry):
    source: Index


class TextureExtensions(Entry):
    ext_texture_webp: Annotated[WebP | None, Field(alias="EXT_texture_webp")] = None


class Texture(Entry):
    sampler: Index | None = None
    source: Index | None = None
    extensions: TextureExtensions | None = None  # type: ignore[assignment]


class TextureUse(Entry):
    index: Index
    tex_coord: Literal[0] = 0


class MetallicRoughness(Entry):
    base_color_factor: tuple[Unit, Unit, Unit, Unit] = (1, 1, 1, 1)
    base_color_texture: TextureUse | None = None
    metallic_factor: Unit = 1
    roughness_factor: Unit = 1
    metallic_roughness_texture: TextureUse | None = None


class Refraction(Entry):
    ior: Annotated[float, Field(gt=1, le=4)] = 1.5


class EmissiveStrength(Entry):
    emissive_strength: Annotated[float, Field(ge=0)] = 1


class Material(Entry):
    pbr_metallic_roughness: MetallicRoughness | None = None
    normal_texture: Ignored = None
    occlusion_texture: Ignored = None
    emissive_texture: TextureUse | None = None
    emissive_factor: tuple[Unit, Unit, Unit] = (0, 0, 0)
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    alpha_cutoff: Annotated[float, Field(ge=0)] = 0.5
    double_sided: bool = False


class Document(Entry):
    """The document: glTF 2.0 §5.17."""

    asset: Asset
    extensions_required: list[Annotated[str, AfterValidator(_listed)]] = []
    extensions_used: Ignored = None  # those in use stand where they are used
    scene: Index = 0
    scenes: list[Scene] = []
    nodes: list[Node] = []
    meshes: list[Mesh] = []
    accessors: list[Accessor] = []
    buffers: list[Buffer] = []
    buffer_views: list[BufferView] = []
    materials: list[Material] = []
    textures: list[Texture] = []
    images: list[Image] = []
    samplers: list[Sampler] = []
    animations: Ignored = None
    cameras: Annotated[list[Camera], Field(exclude=True)] = []
