"""Untrusted PLY meshes: complete ones pass, and a face never names a vertex that does not exist."""

from contextlib import suppress

import numpy as np
import pytest
from refusals import assert_says, refusal

from saf_gen.errors import BadInput
from saf_gen.scene.ply_file import is_ply, validate_ply

HEADER = """ply
format {order} 1.0
comment made by hand
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property uchar flags
property list uchar int vertex_indices
end_header
"""
FORMATS = ("ascii", "binary_little_endian", "binary_big_endian")


def write_ply(path, faces, *, order="binary_little_endian", vertices=4, stated=None):
    """Write a mesh with these faces, whose header states ``stated`` vertices."""
    header = HEADER.format(order=order, vertices=stated or vertices, faces=len(faces)).encode()
    points = np.arange(3.0 * vertices).reshape(-1, 3)
    if order == "ascii":
        lines = [" ".join(map(str, point)) for point in points]
        lines += [" ".join(map(str, (7, len(face), *face))) for face in faces]
        path.write_bytes(header + "\n".join(lines).encode() + b"\n")
        return
    end = "<" if "little" in order else ">"
    body = points.astype(f"{end}f4").tobytes()
    for face in faces:
        body += bytes([7, len(face)]) + np.array(face, f"{end}i4").tobytes()
    path.write_bytes(header + body)


@pytest.mark.parametrize("order", FORMATS)
def test_a_complete_mesh_passes(tmp_path, order):
    """Triangles and quadrilaterals, in runs that are longer and shorter than one read."""
    faces = [(0, 1, 2)] * 100 + [(0, 1, 2, 3), (3, 2, 1)] * 20 + [(0, 1, 2, 3)] * 50
    write_ply(tmp_path / "a.ply", faces, order=order)
    validate_ply(tmp_path / "a.ply")
    assert is_ply(tmp_path / "a.ply")


@pytest.mark.parametrize("order", FORMATS)
@pytest.mark.parametrize(("bad", "at"), [(4, 0), (-1, 60), (2**31 - 1, 139)])
def test_a_missing_vertex_is_refused_wherever_it_is_named(tmp_path, order, bad, at):
    faces = [(0, 1, 2)] * 100 + [(0, 1, 2, 3), (3, 2, 1)] * 20
    faces[at] = (bad, *faces[at][1:])
    write_ply(tmp_path / "a.ply", faces, order=order)
    assert_says(
        refusal(validate_ply, tmp_path / "a.ply"),
        f"a face names the vertex {bad}, but the number of vertices is 4 | export it again",
    )


@pytest.mark.parametrize("order", FORMATS)
def test_a_mesh_that_ends_too_early_is_refused(tmp_path, order):
    write_ply(tmp_path / "a.ply", [(0, 1, 2)] * 40, order=order)
    content = (tmp_path / "a.ply").read_bytes()
    for end in (100, len(content) - 200, len(content) - 7):
        (tmp_path / "a.ply").write_bytes(content[:end])
        assert_says(refusal(validate_ply, tmp_path / "a.ply"), "the mesh is damaged")


def test_too_large_a_number_of_vertices_is_refused(tmp_path):
    for order in FORMATS:
        write_ply(tmp_path / "a.ply", [(0, 1, 2)], order=order, stated=10**9)
        assert_says(refusal(validate_ply, tmp_path / "a.ply"), "the mesh is damaged")


def test_a_line_of_too_few_numbers_is_refused(tmp_path):
    """Mitsuba would read the rest from the next line, and mistake vertices for counts."""
    write_ply(tmp_path / "a.ply", [(0, 1, 2)], order="ascii")
    text = (tmp_path / "a.ply").read_text()
    (tmp_path / "a.ply").write_text(text.replace("3.0 4.0 5.0\n", "3.0 4.0\n5.0 "))
    assert_says(refusal(validate_ply, tmp_path / "a.ply"), "a vertex has 2 numbers on its line instead of 3")


def test_no_damaged_mesh_raises_anything_else(tmp_path):
    """600 files with a byte changed, seed 3."""
    random = np.random.default_rng(3)
    for order in FORMATS:
        write_ply(tmp_path / "a.ply", [(0, 1, 2), (0, 1, 2, 3)] * 3, order=order)
        content = (tmp_path / "a.ply").read_bytes()
        for _ in range(200):
            damaged = bytearray(content)
            damaged[random.integers(len(content))] ^= 1 << random.integers(8)
            (tmp_path / "a.ply").write_bytes(damaged)
            with suppress(BadInput):
                validate_ply(tmp_path / "a.ply")
