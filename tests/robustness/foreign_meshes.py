"""Meshes as others store them, with surfaces that are known: none may look wrong without a word.

``python tests/robustness/foreign_meshes.py --count 300 --seed 1`` draws a format (glTF as .glb, .gltf or with files
beside it; OBJ with MTL; PLY; STL), colours, pictures, opacity, emission, transforms of nodes, extensions, what is not
read, and damage. It writes each file with numpy, Pillow or trimesh, renders what the scene made of it shows, and
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

    def shown(self) -> np.ndarray:
        """Return what is seen in front of a background of 1 in light of 1."""
        clear = self.opacity[:, None]
        return clear * self.colour + 1 - clear + self.emission


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


def at_quarters(corners: np.ndarray) -> np.ndarray:
    """Return values in the middle of the quarters, from values of the corners that change linearly over the card."""
    right, up = corners[1] - corners[0], corners[3] - corners[0]
    return np.array([corners[0] + u * right + (1 - v) * up for u, v in CENTRES])


def draw_corners(random: np.random.Generator, channels: int) -> np.ndarray:
    """Return values of the corners that change linearly over a card, 0 to 1, float32 (4, channel)."""
    first, right, up = random.uniform(0.45, 0.55, channels), *random.uniform(-0.2, 0.2, (2, channels))
    return np.array([first, first + right, first + right + up, first + up], np.float32)


IGNORED = {
    "KHR_materials_clearcoat": ({"clearcoatFactor": 1}, "clearcoat ignored"),
    "KHR_materials_sheen": ({}, "sheen ignored"),
    "KHR_materials_transmission": ({"transmissionFactor": 1}, "transmission ignored"),
    "KHR_materials_ior": ({"ior": 1.4}, ""),
}


def write_gltf(random: np.random.Generator, folder: Path, *, kind: str) -> Drawn:
    """Draw and write a glTF file of one card."""
    file, said, look = Gltf(), set[str](), Look(np.ones((4, 3)), np.ones(4), np.zeros((4, 3)))
    factor = random.choice([1.0, 0.5, 0.2, 0.8], 4)
    pbr: dict[str, object] = {"baseColorFactor": factor.tolist()}
    material: dict[str, object] = {"name": "paint"}
    look.colour = np.tile(factor[:3], (4, 1))
    alpha, highest = np.full(4, factor[3]), factor[3]
    uv = [UV, UV * 0 + 0.1][: int(random.integers(1, 3))]
    sampler = {"magFilter": 9728} if random.random() < 0.5 else None
    has_texture = random.random() < 0.6
    if has_texture:
        picture = draw_picture(random, alpha=random.random() < 0.5)
        mime = str(random.choice(["image/png", "image/webp"]))
        pbr["baseColorTexture"] = {"index": file.add_texture(picture, mime=mime, sampler=sampler)}
        if mime == "image/webp":
            file.json["extensionsUsed"] = ["EXT_texture_webp"]
        texel = look_up(picture, CENTRES)
        look.colour = look.colour * linear(texel[:, :3])
        if picture.shape[2] == 4:
            alpha, highest = alpha * texel[:, 3] / 255, highest * picture[..., 3].max() / 255
    attributes = {}
    if random.random() < 0.35:
        corners = draw_corners(random, 4)
        corners = (
            corners[:1].repeat(4, 0) if has_texture else corners
        )  # a texture beside colours that differ is refused
        stored = str(random.choice(["f4", "u1", "u2"]))
        top = {"f4": 1, "u1": 255, "u2": 65535}[stored]
        values = corners if stored == "f4" else (corners * top).round().astype(stored)
        attributes["COLOR_0"] = file.add_array(values, normalized=stored != "f4")
        look.colour = look.colour * at_quarters(values / np.float64(top))[:, :3]
    mode = str(random.choice(["OPAQUE", "MASK", "BLEND"], p=[0.4, 0.3, 0.3]))
    material["alphaMode"] = mode
    if attributes and mode != "OPAQUE":
        said.add("opacity of vertices ignored")
    if mode == "BLEND":
        look.opacity = alpha
    elif mode == "MASK":
        material["alphaCutoff"] = float(random.choice([0.1, 0.33, 0.45]))
        look.opacity = (alpha >= material["alphaCutoff"]).astype(float)
    emits = random.random() < 0.3
    if emits:
        glow = random.choice([1.0, 0.5, 0.25], 3)
        strength = float(random.choice([1, 1, 6]))
        material["emissiveFactor"] = glow.tolist()
        material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
        look.emission = np.tile(glow * strength, (4, 1))
        if random.random() < 0.5:
            other = draw_picture(random, alpha=False)
            material["emissiveTexture"] = {"index": file.add_texture(other, sampler=sampler)}
            look.emission = look.emission * linear(look_up(other, CENTRES))
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
    stored = f"{kind} texture {has_texture} vertices {bool(attributes)} {mode} emits {emits} node {node} {fault}"
    invisible = highest < {"OPAQUE": 0, "MASK": material.get("alphaCutoff"), "BLEND": 1e-6}[mode]  # type: ignore[operator]
    lit = emits and mode != "OPAQUE"  # what is clear in part would emit as a whole
    return Drawn(path, stored, None if fault or invisible or lit else expected, said)


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


FAULTS = {
    "required": {"extensionsRequired": ["XYZ_needed"]},
    "draco": {"extensionsRequired": ["KHR_draco_mesh_compression"]},
    "skin": {"nodes.0.skin": 0},
    "instances": {"nodes.0.extensions": {"EXT_mesh_gpu_instancing": {}}},
    "strip": {"meshes.0.primitives.0.mode": 5},
    "targets": {"meshes.0.primitives.0.targets": [{"POSITION": 0}], "meshes.0.weights": [0.5]},
    "unknown": {"materials.0.extensions": {"XYZ_paint": {}}},
    "gloss": {"materials.0.extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 0, 0, 1]}}},
    "transform": {"texture": {"extensions": {"KHR_texture_transform": {"offset": [0.5, 0]}}}},
    "set": {"texture": {"texCoord": 1}},
    "uv": {"texture": {"texCoord": 7}},
    "outside": {"texture": {}},
    "sparse": {"accessors.0.sparse": {"count": 1}},
    "negative": {"accessors.0.bufferView": -1},
    "true": {"meshes.0.primitives.0.material": True},
    "short": {"bufferViews.0.byteLength": 4},
}
"""Changes of the document, by path, after which it must be refused."""


def draw_fault(random: np.random.Generator, file: Gltf) -> str:
    """Change one file in six so that it is not read, and return how; '' for a whole file."""
    if random.random() > 1 / 6:
        return ""
    fault = str(random.choice([*FAULTS, "index", "nan", "quantised", "plain colours", "bytes for UV"]))
    attributes = file.json["meshes"][0]["primitives"][0]["attributes"]
    for path, value in FAULTS.get(fault, {}).items():
        if path == "texture":
            number = file.add_texture(np.zeros((4, 4, 3), np.uint8))
            if fault == "outside":
                file.json["images"][-1] = {"uri": "../a.png"}
            file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": number, **value}
            continue
        *way, last = (int(key) if key.isdigit() else key for key in path.split("."))
        place = file.json
        for key in way:
            place = place[key]
        place[last] = value
    if fault in ("short", "sparse", "negative"):
        attributes["POSITION"] = 0
    elif fault == "index":
        file.json["meshes"][0]["primitives"][0]["indices"] = file.add_array(np.uint16([0, 1, 9]))
    elif fault == "nan":
        attributes["POSITION"] = file.add_array(np.full((4, 3), np.nan, np.float32))
    elif fault == "quantised":
        attributes["POSITION"] = file.add_array((POINTS * 127).astype("i1"), normalized=True)
        file.json["extensionsRequired"] = ["KHR_mesh_quantization"] * int(random.integers(2))
    elif fault == "plain colours":
        attributes["COLOR_0"] = file.add_array(np.full((4, 3), 9, np.uint8))
    elif fault == "bytes for UV":
        attributes["TEXCOORD_0"] = file.add_array((UV * 255).astype("u1"), normalized=True)
    return fault


MTL_FAULTS = {"options": "map_Kd -o 0.5 0 0 my.png", "mask": "map_d my.png", "words": "map_Ke my.png"}
OBJ_FAULTS = {
    **dict.fromkeys(("nan", "short", *MTL_FAULTS), ""),
    "far": "f 1/1 2/2 9/3",
    "crossed": "f 1/1 3/3 2/2 4/4",
    "mixed": "f 1/1 2/2 3/3\nf 1/1 3/3 4",
    "curve": "cstype bezier\nf 1/1 2/2 3/3 4/4",
    "two corners": "f 1/1 2/2 3/3 4/4\nf 1/1 2/2",
}
"""Faces of files that must be refused; those of the other faults are as in good files."""


def write_obj(random: np.random.Generator, folder: Path) -> Drawn:
    """Draw and write an OBJ file of one card with its MTL."""
    look, said = Look(np.full((4, 3), 0.6), np.ones(4), np.zeros((4, 3))), set[str]()
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
        lines.append(f"map_Kd my print.{suffix}")
        known = look.colour if any(line.startswith("Kd") for line in lines) else 1
        look.colour = known * linear(look_up(picture, CENTRES))
    if random.random() < 0.3:
        opacity = float(random.choice([0.25, 0.5, 0.75]))
        lines.append(f"d {opacity}" if random.random() < 0.5 else f"Tr {1 - opacity}")
        look.opacity = np.full(4, opacity)
    if random.random() < 0.3:
        glow = random.choice([0.5, 1.0, 3.0], 3)
        lines.append("Ke {} {} {}".format(*glow))
        look.emission = np.tile(glow, (4, 1))
    if random.random() < 0.3:
        lines.append("map_Bump gone.png")
        said.add("map_bump ignored")
    if random.random() < 0.3:
        lines.append("Ks 0.5 0.5 0.5")
        said.add("ks ignored")
    if mode == "missing":
        lines.append("map_Kd gone.png")
    if mode in ("lost", "no library"):
        look, said = Look(np.full((4, 3), 0.6), np.ones(4), np.zeros((4, 3))), {"materials are grey"}
    fault = str(random.choice(["", *OBJ_FAULTS], p=[0.85] + [0.15 / len(OBJ_FAULTS)] * len(OBJ_FAULTS)))
    if fault in MTL_FAULTS:
        lines.append(MTL_FAULTS[fault])
    unused = mode in ("lost", "no library")
    bad = mode == "missing" or (fault != "" and not (fault in MTL_FAULTS and unused))
    bad |= bool(look.emission.any() and look.opacity[0] < 1)
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
    faces = OBJ_FAULTS.get(fault) or faces
    rows += {"nan": ["v nan 0 0"], "short": ["v 0 0"]}.get(fault, [])
    head = [] if mode == "no library" else ["mtllib a.mtl"]
    end = str(random.choice(["\n", "\r\n"]))
    text = "\n".join([*head, "o card", *rows, "usemtl paint", "s off", faces, ""]).replace("\n", end)
    (folder / "a.obj").write_bytes(text.encode())
    return Drawn(folder / "a.obj", f"obj {lines} {mode} {fault} {faces!r}", None if bad else look.shown(), said)


def write_ply(random: np.random.Generator, folder: Path) -> Drawn:
    """Draw and write a PLY file of one card, with the colours of its corners, with trimesh or by hand."""
    order = str(random.choice(["ascii", "binary_little_endian", "binary_big_endian"]))
    coded = np.tile(random.integers(0, 256, 4), (4, 1)).astype(np.uint8)
    names, said = ["red", "green", "blue", "alpha"], set[str]()
    channels = int(random.choice([0, 3, 4]))
    faults = ["", "index", "cut", "polygon", "edges", "floats"]
    fault = str(random.choice(faults, p=[0.75, *[0.05] * 5]))
    polygon, edges = fault == "polygon", fault == "edges"
    if fault == "floats":
        channels, coded = 3, coded / np.float32(255)
    faces = [[0, 1, 2, 3]] if polygon else FACES.tolist()
    if fault == "index":
        faces[0][0] = 7
    kinds = [f"property float {name}" for name in "xyz"] + [
        f"property {'float' if fault == 'floats' else 'uchar'} {name}" for name in names[:channels]
    ]
    header = [
        "ply",
        f"format {order} 1.0",
        "comment end_header is not here",
        "element vertex 4",
        *kinds,
        f"element face {len(faces)}",
    ]
    header += ["property list uchar int vertex_indices", *(["element edge 1", "property int vertex1"] if edges else [])]
    sign = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}[order]
    if order == "ascii":
        rows = [" ".join(map(str, [*point, *row[:channels]])) for point, row in zip(POINTS, coded, strict=True)]
        rows += [" ".join(map(str, [len(face), *face])) for face in faces] + (["0"] if edges else [])
        body = ("\n".join(rows) + "\n").encode()
    else:
        body = b"".join(
            point.astype(f"{sign}f4").tobytes() + row[:channels].astype(f"{sign}{row.dtype.str[1:]}").tobytes()
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
    said |= {"opacity of vertices ignored"} if channels == 4 and coded[0, 3] < 255 else set()
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
    parser.add_argument("--count", type=int, default=300)
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
