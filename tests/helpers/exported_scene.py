"""Writes tests/scenes/workbench in the form that Blender's Mitsuba add-on exports: XML, binary PLY, a PNG texture.

    .venv/bin/python tests/helpers/exported_scene.py [FOLDER]

Layout, element order and numbers are those of the add-on: metres, y up, a camera that looks along its -z in
Blender and is written as a lookat, area lamps as rectangles with a null surface, `elm__N` for objects without
a name, and parameters for samples and resolution.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

HERE = Path(__file__).parents[1]
TEXELS, SQUARE = 512, 8  # texels per side of the picture; texels per side of a square

SCENE = """\
<scene version="3.5.2">

<!-- Defaults, these can be set via the command line: -Darg=value -->

\t<default name="spp" value="64"/>
\t<default name="resx" value="1280"/>
\t<default name="resy" value="800"/>

<!-- Camera and Rendering Parameters -->

\t<integrator type="path" id="elm__0" name="elm__0">
\t\t<integer name="max_depth" value="12"/>
\t</integrator>
\t<sensor type="perspective" id="Camera" name="Camera">
\t\t<string name="fov_axis" value="x"/>
\t\t<float name="fov" value="18.180556"/>
\t\t<float name="principal_point_offset_x" value="0.000000"/>
\t\t<float name="principal_point_offset_y" value="-0.000000"/>
\t\t<float name="near_clip" value="0.010000"/>
\t\t<float name="far_clip" value="100.000000"/>
\t\t<transform name="to_world">
\t\t\t<lookat origin="0.000000, 0.200000, 0.550000" target="0.000000, 0.157000, 0.390000" up="0, 1, 0"/>
\t\t</transform>
\t\t<sampler type="independent" name="sampler">
\t\t\t<integer name="sample_count" value="$spp"/>
\t\t</sampler>
\t\t<film type="hdrfilm" name="film">
\t\t\t<integer name="width" value="$resx"/>
\t\t\t<integer name="height" value="$resy"/>
\t\t</film>
\t</sensor>

<!-- Materials -->

\t<bsdf type="twosided" id="mat-Print" name="mat-Print">
\t\t<bsdf type="diffuse" name="bsdf">
\t\t\t<texture type="bitmap" name="reflectance">
\t\t\t\t<string name="filename" value="textures/print.png"/>
\t\t\t\t<string name="filter_type" value="bilinear"/>
\t\t\t\t<string name="wrap_mode" value="repeat"/>
\t\t\t\t<boolean name="raw" value="false"/>
\t\t\t</texture>
\t\t</bsdf>
\t</bsdf>
\t<bsdf type="twosided" id="mat-Bench" name="mat-Bench">
\t\t<bsdf type="principled" name="bsdf">
\t\t\t<rgb name="base_color" value="0.320000 0.210000 0.120000"/>
\t\t\t<float name="roughness" value="0.600000"/>
\t\t\t<float name="specular" value="0.300000"/>
\t\t</bsdf>
\t</bsdf>
\t<bsdf type="twosided" id="mat-Ball" name="mat-Ball">
\t\t<bsdf type="diffuse" name="bsdf">
\t\t\t<rgb name="reflectance" value="0.600000 0.100000 0.080000"/>
\t\t</bsdf>
\t</bsdf>

<!-- Emitters -->

\t<emitter type="constant" id="World" name="World">
\t\t<rgb name="radiance" value="0.400000 0.450000 0.500000"/>
\t</emitter>
\t<shape type="rectangle" id="emit-Lamp" name="emit-Lamp">
\t\t<boolean name="flip_normals" value="true"/>
\t\t<transform name="to_world">
\t\t\t<matrix value="{lamp}"/>
\t\t</transform>
\t\t<emitter type="area" name="emitter">
\t\t\t<rgb name="radiance" value="40.000000 38.000000 34.000000"/>
\t\t</emitter>
\t\t<bsdf type="null" name="bsdf"/>
\t</shape>

<!-- Shapes -->

\t<shape type="ply" id="mesh-Bench" name="mesh-Bench">
\t\t<string name="filename" value="meshes/Bench.ply"/>
\t\t<boolean name="face_normals" value="true"/>
\t\t<ref id="mat-Bench" name="bsdf"/>
\t</shape>
\t<shape type="ply" id="mesh-Crate.001" name="mesh-Crate.001">
\t\t<string name="filename" value="meshes/Crate.001.ply"/>
\t\t<boolean name="face_normals" value="true"/>
\t\t<ref id="mat-Print" name="bsdf"/>
\t</shape>
\t<shape type="ply" id="mesh-Ball" name="mesh-Ball">
\t\t<string name="filename" value="meshes/Ball.ply"/>
\t\t<ref id="mat-Ball" name="bsdf"/>
\t</shape>
</scene>
"""


def write_exported_scene(folder: Path) -> None:
    """Write scene.xml, meshes/ and textures/."""
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    (folder / "textures").mkdir(exist_ok=True)
    write_ply(folder / "meshes/Bench.ply", *box((0, -0.02, -0.2), (1.2, 0.04, 1.4)))
    write_ply(folder / "meshes/Crate.001.ply", *box((0, 0.05, -0.05), (0.1, 0.1, 0.1)))
    write_ply(folder / "meshes/Ball.ply", *ball((0.09, 0.03, -0.2), 0.03))
    random = np.random.default_rng(3)
    squares = random.choice([40, 235], size=(TEXELS // SQUARE,) * 2).astype(np.uint8)
    print_ = np.kron(squares, np.ones((SQUARE, SQUARE), dtype=np.uint8))
    Image.fromarray(print_).save(folder / "textures/print.png", optimize=True)
    (folder / "scene.xml").write_text(SCENE.format(lamp=" ".join(f"{x:.6f}" for x in lamp().ravel())))


def lamp() -> np.ndarray:
    """Return the matrix of a lamp of 0.2 m × 0.2 m, upper left, that faces the crate along its -z, as in Blender."""
    place, target = np.array([-0.35, 0.55, 0.45]), np.array([0.0, 0.05, 0.0])
    back = (place - target) / np.linalg.norm(place - target)
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = 0.1 * np.column_stack([right, np.cross(back, right), back])
    matrix[:3, 3] = place
    return matrix


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
