"""A whole scene as Blender's glTF export writes it, without a renderer."""

import json
import struct

import numpy as np
import trimesh


def write_whole_scene(path):
    """Write a globe, a book and a tin on a desk, a camera and a lamp, as Blender exports them."""
    pbr = trimesh.visual.material.PBRMaterial
    globe = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    globe.visual = trimesh.visual.TextureVisuals(material=pbr(baseColorFactor=[90, 120, 200, 255], metallicFactor=0.0))
    desk = trimesh.creation.box(extents=(0.6, 0.02, 0.4))
    desk.apply_translation((0, -0.04, 0))
    wall = trimesh.creation.box(extents=(1, 0.6, 0.01))
    wall.apply_translation((0, 0.2, -0.2))
    book = trimesh.creation.box(extents=(0.05, 0.02, 0.07))
    book.apply_translation((-0.055, -0.02, 0))
    book.visual = trimesh.visual.TextureVisuals(material=pbr(baseColorFactor=[200, 80, 60, 255], metallicFactor=0.0))
    tin = trimesh.creation.cylinder(radius=0.015, height=0.04)
    tin.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0), (0, 0, 0)))
    tin.apply_translation((0.055, -0.01, 0))
    tin.visual = trimesh.visual.TextureVisuals(material=pbr(metallicFactor=1.0, roughnessFactor=0.4))
    scene = trimesh.Scene({"Globe": globe, "Desk": desk, "Wall": wall, "Book": book, "Tin": tin})
    raw = scene.export(file_type="glb")
    size = struct.unpack("<I", raw[12:16])[0]
    tree, binary = json.loads(raw[20 : 20 + size]), raw[20 + size :]
    first = len(tree["nodes"])
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.2, "aspectRatio": 16 / 9, "znear": 0.1}}]
    lamps = {"lights": [{"type": "point", "intensity": 54.351}]}
    tree["extensions"] = {"KHR_lights_punctual": lamps}
    tree["nodes"] += [
        {"name": "Camera", "camera": 0, "translation": [0, 0, 0.5]},
        {"name": "Lamp", "translation": [0.2, 0.3, 0.2], "extensions": {"KHR_lights_punctual": {"light": 0}}},
    ]
    tree["scenes"][tree.get("scene", 0)]["nodes"] += [first, first + 1]
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path
