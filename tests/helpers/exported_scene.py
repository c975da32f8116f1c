"""Writes the meshes and the picture of tests/scenes/workbench, as Blender's Mitsuba add-on exports them.

    .venv/bin/python tests/helpers/exported_scene.py [FOLDER]

The file scene.xml there was written by hand. Layout, element order and numbers are those of the add-on: metres, y up,
a camera that looks along its -z in Blender and is written as a lookat, area lamps as rectangles with a null surface,
`elm__N` for objects without a name, and parameters for samples and resolution.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

HERE = Path(__file__).parents[1]
TEXELS, SQUARE = 512, 8  # texels per side of the picture; texels per side of a square


def write_exported_scene(folder: Path) -> None:
    """Write meshes/ and textures/."""
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    (folder / "textures").mkdir(exist_ok=True)
    write_ply(folder / "meshes/Bench.ply", *box((0, -0.02, -0.2), (1.2, 0.04, 1.4)))
    write_ply(folder / "meshes/Crate.001.ply", *box((0, 0.05, -0.05), (0.1, 0.1, 0.1)))
    write_ply(folder / "meshes/Ball.ply", *ball((0.09, 0.03, -0.2), 0.03))
    random = np.random.default_rng(3)
    squares = random.choice([40, 235], size=(TEXELS // SQUARE,) * 2).astype(np.uint8)
    print_ = np.kron(squares, np.ones((SQUARE, SQUARE), dtype=np.uint8))
    Image.fromarray(print_).save(folder / "textures/print.png", optimize=True)


def box(centre, size) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices, normals and texture coordinates of a box, four per side, and its triangles."""
    points, normals, uv, faces = [], [], [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            first = len(points)
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = np.zeros(3)
                corner[axis], corner[u], corner[v] = sign, a * sign, b
                points.append(centre + corner * np.array(size) / 2)
                normals.append(np.eye(3)[axis] * sign)
                uv.append(((a + 1) / 2, (b + 1) / 2))
            faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return np.array(points), np.array(normals), np.array(uv), np.array(faces)


def ball(centre, radius, rings=12, around=24) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices, normals, texture coordinates and triangles of a smooth sphere of latitudes and longitudes."""
    v, u = np.meshgrid(np.linspace(0, 1, rings + 1), np.linspace(0, 1, around + 1), indexing="ij")
    up, turn = np.pi * v.ravel(), 2 * np.pi * u.ravel()
    normals = np.stack([np.sin(up) * np.cos(turn), np.cos(up), -np.sin(up) * np.sin(turn)], axis=1)
    first = (np.arange(rings)[:, None] * (around + 1) + np.arange(around)).ravel()
    below = first + around + 1
    faces = np.concatenate(
        [np.stack([first, below, below + 1], axis=1), np.stack([first, below + 1, first + 1], axis=1)]
    )
    return centre + radius * normals, normals, np.stack([u.ravel(), v.ravel()], axis=1), faces


def write_ply(path: Path, points, normals, uv, faces) -> None:
    """Write a binary little-endian PLY file with the properties that Mitsuba writes."""
    names = ("x", "y", "z", "nx", "ny", "nz", "u", "v")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_index", "end_header", ""]
    vertices = np.column_stack([points, normals, uv]).astype("<f4")
    sides = np.zeros(len(faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    sides["count"], sides["index"] = 3, faces
    path.write_bytes("\n".join(header).encode() + vertices.tobytes() + sides.tobytes())


if __name__ == "__main__":
    write_exported_scene(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "scenes" / "workbench")
