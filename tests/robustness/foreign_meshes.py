"""Meshes as strangers store them, with surfaces that are known: none may look wrong without a word.

``python tests/robustness/foreign_meshes.py --count 200 --seed 1`` draws a format (glTF as .glb, .gltf or with files
beside it; OBJ with MTL; PLY; STL), colours, pictures, opacity, emission, transforms of coordinates and of nodes,
extensions and damage. It writes each file with numpy, Pillow or trimesh, renders what the scene made of it shows, and
compares each quarter of a card with the closed form. It prints how many were right, right but for what was said, and
refused, and ends with 1 if one was wrong in silence.
"""

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "helpers"))
from mesh_cards import FACES, LUMINANCE, POINTS, UV, Gltf, encode, linear, show

from saf_gen.errors import BadInput

FORMATS = ("glb", "gltf", "gltf with files", "obj", "ply", "stl")
PIXELS = [(5, 5), (5, 26), (26, 5), (26, 26)]
"""Pixels of 32 × 32 in the quarters of a card: top left, top right, bottom left, bottom right."""
CENTRES = (np.array(PIXELS)[:, ::-1] + 0.5) / 32
"""Their texture coordinates; turned, mirrored, doubled and halved ones are within the same blocks of pictures."""
TOLERANCE = 0.03


@dataclass
class Drawn:
    """A file, what its quarters should show, and what may be said of it.

    ``expected`` is linear RGB in front of a background of 1, float64 (4, 3), or None if the file must be refused.
    """

    path: Path
    stored: str
    expected: np.ndarray | None
    said: set[str] = field(default_factory=set)


@dataclass
class Look:
    """The parts of a surface, float64 (4, 3) or (4,) in the quarters of the card."""

    colour: np.ndarray
    opacity: np.ndarray
    emission: np.ndarray
    undimmed: np.ndarray | None = None
    """Opacity where that of the vertices does not count: for emission."""

    def shown(self) -> np.ndarray:
        """Return what is seen in front of a background of 1 in light of 1."""
        clear = self.opacity[:, None]
        glow = clear if self.undimmed is None else self.undimmed[:, None]
        return clear * self.colour + 1 - clear + glow * self.emission


def draw_picture(random: np.random.Generator, *, alpha: bool) -> np.ndarray:
    """Return 4 × 4 blocks of 8 × 8 texels, so that it does not matter whether colours are interpolated."""
    channels = 4 if alpha else 3
    pixels = random.integers(0, 256, (4, 4, channels), dtype=np.uint8)
    if alpha:
        pixels[..., 3] = random.choice([0, 60, 180, 255], (4, 4))
    return pixels.repeat(8, 0).repeat(8, 1)


def look_up(picture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Return the texels of a repeating picture at coordinates (point, 2), uint8 (point, channel)."""
    rows, columns = picture.shape[:2]
    u, v = np.floor(uv * [columns, rows]).astype(int).T
    return picture[v % rows, u % columns]


def draw_transform(random: np.random.Generator) -> dict[str, object]:
    """Return a KHR_texture_transform that moves by whole blocks and quarter turns."""
    if random.random() < 0.5:
        return {}
    offset = (random.integers(-4, 5, 2) / 4).tolist()
    angle = float(random.choice([0, np.pi / 2, np.pi, -np.pi / 2]))
    scale = random.choice([-1.0, 0.5, 1.0, 2.0], 2).tolist()
    return {"offset": offset, "rotation": angle, "scale": scale}


def moved(uv: np.ndarray, transform: dict[str, object]) -> np.ndarray:
    """Return coordinates after KHR_texture_transform: scaled, turned counter-clockwise as seen, moved."""
    u, v = (uv * transform.get("scale", [1, 1])).T
    cos, sin = np.cos(transform.get("rotation", 0)), np.sin(transform.get("rotation", 0))
    return np.column_stack([cos * u + sin * v, cos * v - sin * u]) + transform.get("offset", [0, 0])


def at_quarters(corners: np.ndarray) -> np.ndarray:
    """Return values in the middle of the quarters, from values of the corners that change linearly over the card."""
    right, up = corners[1] - corners[0], corners[3] - corners[0]
    return np.array([corners[0] + u * right + (1 - v) * up for u, v in CENTRES])


def draw_corners(random: np.random.Generator, channels: int) -> np.ndarray:
    """Return values of the corners that change linearly over a card, 0 to 1, float32 (4, channel)."""
    first, right, up = random.uniform(0.3, 0.6, channels), *random.uniform(-0.2, 0.2, (2, channels))
    return np.array([first, first + right, first + right + up, first + up], np.float32)


IGNORED = {
    "KHR_materials_clearcoat": ({"clearcoatFactor": 1}, "clearcoat ignored"),
    "KHR_materials_sheen": ({}, "sheen ignored"),
    "KHR_materials_transmission": ({"transmissionFactor": 1}, "transmission ignored"),
    "KHR_materials_ior": ({"ior": 1.4}, ""),
    "XYZ_paint": ({}, "extensions ignored"),
}


def write_gltf(random: np.random.Generator, folder: Path, *, kind: str) -> Drawn:
    """Draw and write a glTF file of one card."""
    file, said, look = Gltf(), set[str](), Look(np.ones((4, 3)), np.ones(4), np.zeros((4, 3)))
    factor = random.choice([1.0, 0.5, 0.2, 0.8], 4)
    pbr: dict[str, object] = {"baseColorFactor": factor.tolist()}
    material: dict[str, object] = {"name": "paint"}
    look.colour = np.tile(factor[:3], (4, 1))
    alpha, highest = np.full(4, factor[3]), factor[3]
    chosen, sets = int(random.integers(3)), int(random.integers(1, 4))
    chosen = min(chosen, sets - 1)
    uv = [UV if n == chosen else UV * 0 + 0.1 for n in range(sets)]
    transform = draw_transform(random)
    where = moved(CENTRES, transform)
    use = (
        {"texCoord": chosen, "extensions": {"KHR_texture_transform": transform}} if transform else {"texCoord": chosen}
    )
    sampler = {"magFilter": 9728} if random.random() < 0.5 else None
    has_texture = random.random() < 0.6
    if has_texture:
        picture = draw_picture(random, alpha=random.random() < 0.5)
        mime = str(random.choice(["image/png", "image/webp"]))
        pbr["baseColorTexture"] = {"index": file.add_texture(picture, mime=mime, sampler=sampler), **use}
        if mime == "image/webp":
            file.json["extensionsUsed"] = ["EXT_texture_webp"]
        texel = look_up(picture, where)
        look.colour = look.colour * linear(texel[:, :3])
        if picture.shape[2] == 4:
            alpha, highest = alpha * texel[:, 3] / 255, highest * picture[..., 3].max() / 255
    attributes = {}
    if random.random() < 0.35:
        corners = draw_corners(random, 4)
        stored = str(random.choice(["f4", "u1", "u2"]))
        top = {"f4": 1, "u1": 255, "u2": 65535}[stored]
        values = corners if stored == "f4" else (corners * top).round().astype(stored)
        attributes["COLOR_0"] = file.add_array(values, normalized=stored != "f4")
        corners = values / np.float64(top)
        look.colour = look.colour * at_quarters(corners)[:, :3]
        highest = highest * corners[:, 3].max()
    mode = str(random.choice(["OPAQUE", "MASK", "BLEND"], p=[0.4, 0.3, 0.3]))
    material["alphaMode"] = mode
    if mode == "BLEND":
        look.opacity, look.undimmed = alpha * (at_quarters(corners)[:, 3] if attributes else 1), alpha
    elif mode == "MASK":
        material["alphaCutoff"] = float(random.choice([0.1, 0.33, 0.45]))
        look.opacity = (alpha >= material["alphaCutoff"]).astype(float)
        if attributes:
            said.add("opacity of vertices ignored beside a mask")
    if random.random() < 0.3:
        said |= {"opacity of vertices ignored for emission"} if attributes and mode == "BLEND" else set()
        glow = random.choice([1.0, 0.5, 0.25], 3)
        strength = float(random.choice([1, 1, 6]))
        material["emissiveFactor"] = glow.tolist()
        material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
        look.emission = np.tile(glow * strength, (4, 1))
        if random.random() < 0.5:
            other = draw_picture(random, alpha=False)
            material["emissiveTexture"] = {"index": file.add_texture(other, sampler=sampler), **use}
            look.emission = look.emission * linear(look_up(other, where))
    if random.random() < 0.3:
        key = str(random.choice(list(IGNORED)))
        material["extensions"] = {**material.get("extensions", {}), key: IGNORED[key][0]}  # type: ignore[dict-item]
        said |= {IGNORED[key][1]} - {""}
    node, order = draw_node(random)
    normals = {"NORMAL": file.add_array(np.tile(np.float32([0, 0, 1]), (4, 1)))} if random.random() < 0.5 else {}
    card = {"uv": uv, "attributes": {**attributes, **normals}, "material": file.add_material(pbr=pbr, **material)}
    if random.random() < 0.5:
        file.add_card(node=node, **card)
    else:  # below a parent that moves it
        child = file.add_node(mesh=file.add_mesh(**card), name="card", in_scene=False, **node)
        file.add_node(children=[child], scale=[2, 2, 2], translation=random.uniform(-9, 9, 3).tolist())
    expected, fault = look.shown()[order], draw_fault(random, file)
    suffix = ".glb" if kind == "glb" else ".gltf"
    path = file.save(folder / f"a{suffix}", beside=kind == "gltf with files")
    stored = f"{kind} texture {has_texture} vertices {bool(attributes)} {mode} node {node} {transform} {fault}"
    invisible = highest < {"OPAQUE": 0, "MASK": material.get("alphaCutoff"), "BLEND": 1e-6}[mode]  # type: ignore[operator]
    return Drawn(path, stored, None if fault or invisible else expected, said)


def draw_node(random: np.random.Generator) -> tuple[dict[str, object], list[int]]:
    """Return the transform of a node, and the quarter of the card that each quarter of the picture then shows."""
    kind = int(random.integers(4))
    if kind == 0:
        return {}, [0, 1, 2, 3]
    if kind == 1:
        return {"scale": [1, -1, 1]}, [2, 3, 0, 1]  # mirrored, and its front is still seen
    if kind == 2:
        return {"rotation": [0, 0, 1, 0], "translation": random.uniform(-9, 9, 3).tolist()}, [3, 2, 1, 0]
    return {"matrix": [-3, 0, 0, 0, 0, 3, 0, 0, 0, 0, 3, 0, 4, 5, 6, 1]}, [1, 0, 3, 2]


def draw_fault(random: np.random.Generator, file: Gltf) -> str:
    """Damage one file in eight, and return how; '' for a whole file."""
    if random.random() > 0.125:
        return ""
    fault = str(random.choice(["required", "draco", "index", "nan", "short", "uv", "outside"]))
    primitive = file.json["meshes"][0]["primitives"][0]
    if fault == "required":
        file.json["extensionsRequired"] = ["XYZ_needed"]
    elif fault == "draco":
        file.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    elif fault == "index":
        primitive["indices"] = file.add_array(np.uint16([0, 1, 9]))
    elif fault == "nan":
        primitive["attributes"]["POSITION"] = file.add_array(np.full((4, 3), np.nan, np.float32))
    elif fault == "short":
        file.json["bufferViews"][0]["byteLength"] = 4
        file.json["accessors"][0]["bufferView"] = 0
        primitive["attributes"]["POSITION"] = 0
    elif fault == "uv":
        number = file.add_texture(np.zeros((4, 4, 3), np.uint8))
        file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": number, "texCoord": 7}
    else:
        number = file.add_texture(np.zeros((4, 4, 3), np.uint8))
        file.json["images"][file.json["textures"][number]["source"]] = {"uri": "../a.png"}
        file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": number}
    return fault


def write_obj(random: np.random.Generator, folder: Path) -> Drawn:
    """Draw and write an OBJ file of one card with its MTL."""
    look, said = Look(np.full((4, 3), 0.6), np.ones(4), np.zeros((4, 3))), set[str]()
    offset, scale = (random.integers(-4, 5, 2) / 4).tolist(), random.choice([-1.0, 1.0, 2.0], 2).tolist()
    placed = random.random() < 0.5
    options = f"-o {offset[0]} {offset[1]} 0 -s {scale[0]} {scale[1]} 1 " if placed else ""
    where = CENTRES * [1, -1] + [0, 1]  # v points up
    where = (where * scale + offset if placed else where) * [1, -1] + [0, 1]
    lines, mode = (
        ["newmtl paint"],
        str(random.choice(["plain", "lost", "no library", "missing"], p=[0.85, 0.05, 0.05, 0.05])),
    )
    if random.random() < 0.7:
        factor = random.choice([1.0, 0.5, 0.2], 3)
        lines.append("Kd {} {} {}".format(*factor))
        look.colour = np.tile(factor, (4, 1))
    has_texture = random.random() < 0.6
    if has_texture:
        picture = draw_picture(random, alpha=False)
        suffix = str(random.choice(["png", "tiff", "bmp", "tga", "webp"]))
        (folder / f"my print.{suffix}").write_bytes(encode(picture, suffix))
        lines.append(f"map_Kd {options}my print.{suffix}")
        known = look.colour if any(line.startswith("Kd") for line in lines) else 1
        look.colour = known * linear(look_up(picture, where))
    if random.random() < 0.3:
        opacity = float(random.choice([0.25, 0.5, 0.75]))
        lines.append(f"d {opacity}" if random.random() < 0.5 else f"Tr {1 - opacity}")
        look.opacity = np.full(4, opacity)
    if random.random() < 0.3:
        mask = random.choice([0, 60, 180, 255], (4, 4)).astype(np.uint8).repeat(8, 0).repeat(8, 1)
        (folder / "mask.png").write_bytes(encode(mask, "png"))
        lines.append(f"map_d {options}mask.png")
        look.opacity = look.opacity * look_up(mask, where) / 255
    if random.random() < 0.3:
        glow = random.choice([0.5, 1.0, 3.0], 3)
        lines.append("Ke {} {} {}".format(*glow))
        look.emission = np.tile(glow, (4, 1))
    if random.random() < 0.3:
        lines.append("map_Bump gone.png")
        said.add("bump map ignored")
    if random.random() < 0.3:
        lines.append("Ks 0.5 0.5 0.5")
        said.add("specular reflection ignored")
    if mode == "missing":
        lines.append("map_Kd gone.png")
    if mode in ("lost", "no library"):
        look, said = Look(np.full((4, 3), 0.6), np.ones(4), np.zeros((4, 3))), {"materials are grey"}
    (folder / "a.mtl").write_text("newmtl other\nKd 0 0 1\n" + "\n".join(lines if mode != "lost" else []) + "\n")
    colours = random.choice([None, 3])
    points = POINTS * float(random.choice([1, 1000, 0.001])) + random.uniform(-50, 50, 3).round(2)
    rows = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points]
    if colours:
        coded = np.tile(random.uniform(0.3, 1, 3).round(3), (4, 1))
        rows = [f"{row} {r} {g} {b}" for row, (r, g, b) in zip(rows, coded, strict=True)]
        vertex = linear(coded[0] * 255)
        look.colour = np.tile(vertex, (4, 1)) * (1 if mode in ("lost", "no library") else look.colour)
    rows += [f"vt {u} {1 - v}" for u, v in UV]
    faces = str(random.choice(["f 1/1 2/2 3/3 4/4", "f -4/-4 -3/-3 -2/-2 -1/-1", "f 1/1 2/2 3/3\nf 1/1 3/3 4/4"]))
    head = [] if mode == "no library" else ["mtllib a.mtl"]
    end = str(random.choice(["\n", "\r\n"]))
    text = "\n".join([*head, "o card", *rows, "usemtl paint", "s off", faces, ""]).replace("\n", end)
    (folder / "a.obj").write_bytes(text.encode())
    return Drawn(folder / "a.obj", f"obj {lines} {mode} {faces!r}", None if mode == "missing" else look.shown(), said)


def write_ply(random: np.random.Generator, folder: Path) -> Drawn:
    """Draw and write a PLY file of one card, with the colours of its corners, with trimesh or by hand."""
    order = str(random.choice(["ascii", "binary_little_endian", "binary_big_endian"]))
    coded = np.tile(random.integers(0, 256, 4), (4, 1)).astype(np.uint8)
    names, said = ["red", "green", "blue", "alpha"], set[str]()
    channels = int(random.choice([0, 3, 4]))
    fault = str(random.choice(["", "index", "cut"], p=[0.9, 0.05, 0.05]))
    polygon = bool(random.integers(2))
    faces = [[0, 1, 2, 3]] if polygon else FACES.tolist()
    if fault == "index":
        faces[0][0] = 7
    kinds = [f"property float {name}" for name in "xyz"] + [f"property uchar {name}" for name in names[:channels]]
    edges = bool(random.integers(2)) and fault != "cut"
    header = ["ply", f"format {order} 1.0", "comment a card", "element vertex 4", *kinds, f"element face {len(faces)}"]
    header += ["property list uchar int vertex_indices", *(["element edge 1", "property int vertex1"] if edges else [])]
    sign = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}[order]
    if order == "ascii":
        rows = [" ".join(map(str, [*point, *row[:channels]])) for point, row in zip(POINTS, coded, strict=True)]
        rows += [" ".join(map(str, [len(face), *face])) for face in faces] + (["0"] if edges else [])
        body = ("\n".join(rows) + "\n").encode()
    else:
        body = b"".join(
            point.astype(f"{sign}f4").tobytes() + row[:channels].tobytes()
            for point, row in zip(POINTS, coded, strict=True)
        )
        body += b"".join(bytes([len(face)]) + np.array(face, f"{sign}i4").tobytes() for face in faces)
        body += bytes(4) if edges else b""
    data = ("\n".join([*header, "end_header"]) + "\n").encode() + body
    path = folder / "a.ply"
    path.write_bytes(data[:-9] if fault == "cut" else data)
    look = Look(np.full((4, 3), 0.6), np.ones(4), np.zeros((4, 3)))
    if channels:
        look.colour = linear(coded[:, :3])
    if channels == 4:
        look.opacity = coded[:, 3] / 255
        if not coded[0, 3]:
            fault = "invisible"
    said |= {"elements ignored"} if edges else set()
    return Drawn(path, f"ply {order} {channels} {polygon} {fault}", None if fault else look.shown(), said)


def write_stl(random: np.random.Generator, folder: Path) -> Drawn:
    """Draw and write an STL file of a card with trimesh."""
    card = trimesh.Trimesh(POINTS * random.uniform(0.01, 1000), FACES, process=False)
    kind = str(random.choice(["stl", "stl_ascii"]))
    data = card.export(file_type=kind)
    data = data if isinstance(data, bytes) else data.encode()
    cut = random.random() < 0.2
    (folder / "a.stl").write_bytes(data[: len(data) // 2] if cut else data)
    return Drawn(folder / "a.stl", f"{kind} {cut}", None if cut else np.full((4, 3), 0.6))


def write_foreign(random: np.random.Generator, folder: Path) -> tuple[str, Drawn]:
    """Draw and write one file, and return its format too."""
    kind = str(random.choice(FORMATS, p=[0.3, 0.15, 0.15, 0.25, 0.1, 0.05]))
    if kind == "obj":
        return kind, write_obj(random, folder)
    if kind in ("ply", "stl"):
        return kind, (write_ply if kind == "ply" else write_stl)(random, folder)
    return kind, write_gltf(random, folder, kind=kind)


def judge(drawn: Drawn) -> str:
    """Return ``right``, ``said``, ``refused`` or what is wrong."""
    try:
        picture, lines = show(drawn.path, size=32, samples=4096, pixels=PIXELS)
    except BadInput as error:
        return "refused" if drawn.expected is None else f"wrong: refused a good file: {error}"
    if drawn.expected is None:
        return "wrong: accepted"
    missing = [part for part in drawn.said if not any(line.startswith(part) for line in lines)]
    more = [line for line in lines if not any(line.startswith(part) for part in drawn.said)]
    if missing or more:
        return f"wrong: said {lines}, not {sorted(drawn.said)}"
    found, expected = picture @ LUMINANCE, drawn.expected @ LUMINANCE
    if np.abs(found - expected).max() > TOLERANCE * max(1.0, float(expected.max())):
        return f"wrong: shows {found.round(3)}, not {expected.round(3)}"
    return "said" if lines else "right"


def run(count: int, seed: int) -> tuple[Counter[tuple[str, str]], list[str]]:
    """Return how many files of each format were right, right but for what was said, and refused, and the faults."""
    found: Counter[tuple[str, str]] = Counter()
    faults = []
    for number in range(count):
        random = np.random.default_rng([seed, number])
        with TemporaryDirectory(prefix="foreign-") as folder:
            kind, drawn = write_foreign(random, Path(folder))
            verdict = judge(drawn)
        found[kind, verdict.partition(":")[0]] += 1
        if verdict.startswith("wrong"):
            faults.append(f"--seed {seed} number {number}: {drawn.stored}: {verdict}")
    return found, faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    found, faults = run(asked.count, asked.seed)
    for kind in FORMATS:
        counts = {verdict: found[kind, verdict] for verdict in ("right", "said", "refused", "wrong")}
        print(f"{kind:16} " + "  ".join(f"{name} {n}" for name, n in counts.items()))
    print("\n".join(faults) or "none looked wrong in silence")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
