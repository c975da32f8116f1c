"""Normals of meshes do not depend on the number of threads, and neither does what is rendered with them."""

import hashlib
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
import trimesh
from written_scenes import needs_llvm

from saf_gen.errors import BadInput
from saf_gen.render import backend, meshes, mitsuba_scene
from saf_gen.render.render_setup import SensorGrid
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import find_scene

THREADS = (1, 2, 4, 8)
CARD = """
id: mixed
title: Meshes of all kinds
licence: Apache-2.0
source: here
camera: {origin_m: [0, 0, -0.5], look_at_m: [0, 0, 0]}
lens: {focal_length_mm: 25, f_number: 2.0, focus_range_m: [0.6, 0.42]}
lights: {lamp: [lamp], glow: [glow]}
target: [ball]
slices_per_s: 10
motion:
  hills: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: [0.02, 0, 0], rotate_deg: 5}]}
  ball: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: [0, 0.02, 0]}]}
"""
SCRIPT = """
from pathlib import Path

import mitsuba as mi
import numpy as np

HERE = Path(__file__).parent


def sheet(name, size, z, tone, *, smooth, bumps=0.0):
    y, x = np.mgrid[0 : 1 : size * 1j, 0 : 1 : size * 1j]
    height = z + bumps * np.sin(40 * x) * np.cos(30 * y)
    at = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    faces = np.stack([at, at + 1, at + size, at + 1, at + size + 1, at + size], 1)
    props = mi.Properties()
    props["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": {"type": "roughplastic", "diffuse_reflectance": tone}})
    made = mi.Mesh(name, size * size, faces.size // 3, props=props, has_vertex_normals=smooth)
    made.set_id(name)
    held = mi.traverse(made)
    held["vertex_positions"] = np.stack([x - 0.5, y - 0.5, height], -1).astype(np.float32).ravel() * 0.4
    held["faces"] = faces.astype(np.uint32).ravel()
    held.update()
    return made


def build(params):
    t = mi.ScalarTransform4f()
    radiance = {"type": "area", "radiance": 2.0}
    return {
        "hills": sheet("hills", 150, 0.5, 0.5, smooth=True, bumps=0.02),
        "plate": sheet("plate", 40, 0.3, 0.8, smooth=False),
        "tie": sheet("tie", 33, 0.3, 0.2, smooth=False),
        "ball": {"type": "ply", "filename": str(HERE / "ball.ply"), "to_world": t.scale(0.05)},
        "lamp": {"type": "ply", "filename": str(HERE / "ball.ply"), "emitter": radiance,
                 "to_world": t.translate([0.2, 0.3, -0.4]).scale(0.1)},
        "glow": {"type": "obj", "filename": str(HERE / "ball.obj"), "emitter": dict(radiance),
                 "to_world": t.translate([-0.3, 0.3, -0.4]).scale([0.1, 0.05, 0.1])},
    }
"""


@pytest.fixture
def mixed(tmp_path, monkeypatch):
    """A scene of smooth meshes, made and from files without normals, of which two move; mesh lamps; coplanar plates."""
    folder = tmp_path / "mixed"
    folder.mkdir()
    (folder / "scene.yaml").write_text(CARD)
    (folder / "scene.py").write_text(SCRIPT)
    ball = trimesh.creation.icosphere(subdivisions=5)
    ball.export(folder / "ball.ply", vertex_normal=False)
    ball.export(folder / "ball.obj", include_normals=False)
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path))
    return find_scene("mixed")


def random_mesh(vertices, faces):
    """A tangle of triangles that share vertices in any order, some of which have no area."""
    random = np.random.default_rng(vertices)
    corners = random.integers(0, vertices, (faces, 3)).astype(np.uint32)
    corners[::7, 1] = corners[::7, 0]
    corners[3::11, 2] = corners[3::11, 1]
    return random.normal(size=(vertices, 3)).astype(np.float32), corners


def mesh_of(positions, faces):
    made = mi.Mesh("made", len(positions), len(faces), has_vertex_normals=True)
    held = mi.traverse(made)
    held["vertex_positions"], held["faces"] = positions.ravel(), faces.ravel()
    held.update()
    return made


def normals_of(mesh, prefix=""):
    return np.array(mi.traverse(mesh)[f"{prefix}vertex_normals"]).reshape(-1, 3)


def weighted_by_angle(positions, faces):
    """The readable twin, float64."""
    total = np.zeros((len(positions), 3))
    for face in faces:
        points = positions[face].astype(np.float64)
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        for n, vertex in enumerate(face):
            one, two = (points[(n + k) % 3] - points[n] for k in (1, 2))
            angle = np.arccos(one @ two / np.linalg.norm(one) / np.linalg.norm(two))
            total[vertex] += angle * normal / np.linalg.norm(normal)
    return total / np.linalg.norm(total, axis=1, keepdims=True)


@pytest.mark.slow
@needs_llvm
def test_normals_are_means_of_faces_weighted_by_their_angles():
    backend.activate_backend("llvm")
    ball = trimesh.creation.icosphere(subdivisions=2)
    positions = (ball.vertices * [1, 2, 0.5]).astype(np.float32)
    found = meshes.vertex_normals(positions, ball.faces.astype(np.uint32))
    assert found == pytest.approx(weighted_by_angle(positions, ball.faces), abs=3e-7)


@needs_llvm
def test_a_vertex_without_a_face_has_the_normal_that_mitsuba_gives_it():
    backend.activate_backend("llvm")
    positions, faces = np.eye(4, 3, dtype=np.float32), np.array([[0, 1, 2], [3, 3, 3]], np.uint32)
    assert meshes.vertex_normals(positions, faces)[3].tolist() == [1, 0, 0]


@needs_llvm
def test_the_poles_of_a_ball_are_not_black():
    """Their faces have areas of 1e-20, as the cosine of a right angle is 6e-17."""
    backend.activate_backend("llvm")
    lat, lon = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, 17), np.linspace(0, 2 * np.pi, 33), indexing="ij")
    points = 0.6 * np.stack([np.cos(lat) * np.sin(lon), np.sin(lat), np.cos(lat) * np.cos(lon)], -1).reshape(-1, 3)
    at = (np.arange(16)[:, None] * 33 + np.arange(32)).ravel()
    faces = np.concatenate([np.stack([at, at + 1, at + 34], 1), np.stack([at, at + 34, at + 33], 1)]).astype(np.uint32)
    positions = (points - [0, 0, 29]).astype(np.float32)
    made = meshes.make_mesh("ball", positions, faces=faces, bsdf={"type": "diffuse"}, smooth=True)
    assert meshes.black_triangles(mi.traverse(made)) == 0
    found = normals_of(made)
    assert np.linalg.norm(found, axis=1) == pytest.approx(1, abs=1e-6)
    assert np.abs((found * points / 0.6).sum(axis=1))[33:-33].min() > 0.95  # poles share slivers, whose sides are noise


def has_eight_lanes():
    flags = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    return "avx2" in flags and "avx512" not in flags


@needs_llvm
@pytest.mark.skipif(not has_eight_lanes(), reason="Mitsuba adds packets of other widths on this processor")
@pytest.mark.parametrize(("vertices", "faces"), [(5, 13), (50, 203), (1000, 4001), (20_000, 60_000)])
def test_normals_are_those_of_mitsuba_on_one_thread_bit_for_bit(vertices, faces):
    backend.activate_backend("llvm", threads=1)
    positions, corners = random_mesh(vertices, faces)
    expected = normals_of(mesh_of(positions, corners))
    backend.activate_backend("llvm", threads=4)
    assert np.array_equal(meshes.vertex_normals(positions, corners), expected)


@pytest.mark.slow
@needs_llvm
def test_what_a_script_makes_has_the_same_normals_on_any_number_of_threads():
    found = []
    for threads in THREADS:
        backend.activate_backend("llvm", threads=threads)
        with meshes.normals_in_order():
            mesh = mesh_of(*random_mesh(20_000, 60_000))
            found.append(normals_of(mesh))
            mesh.recompute_vertex_normals()
            found.append(normals_of(mesh))
            mesh.parameters_changed()
            found.append(normals_of(mesh))
    assert all(np.array_equal(found[0], other) for other in found)


@needs_llvm
def test_normals_that_a_script_gives_are_kept():
    backend.activate_backend("llvm")
    given = np.array([[0, 0, 1], [0, 1, 0], [0, 0.6, 0.8]], np.float32)
    with meshes.normals_in_order():
        mesh = mesh_of(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.uint32))
        held = mi.traverse(mesh)
        held["vertex_positions"], held["vertex_normals"] = 2 * np.eye(3, dtype=np.float32).ravel(), given.ravel()
        held.update()
    assert np.array_equal(normals_of(mesh), given)


@needs_llvm
def test_mitsuba_is_as_it_was_after_a_script():
    backend.activate_backend("llvm")
    names = ("parameters_changed", "recompute_vertex_normals")
    before = mi.load_dict, *(getattr(mi.Mesh, name) for name in names), set(vars(mi.Mesh))
    with pytest.raises(ValueError, match="of the script"), meshes.normals_in_order():
        raise ValueError("of the script")
    assert (mi.load_dict, *(getattr(mi.Mesh, name) for name in names), set(vars(mi.Mesh))) == before


@needs_llvm
def test_a_face_of_a_script_that_names_no_vertex_is_refused():
    backend.activate_backend("llvm")
    with meshes.normals_in_order(), pytest.raises(BadInput, match="a mesh has a face with the vertex 9"):
        mesh_of(np.eye(3, dtype=np.float32), np.array([[0, 1, 9]], np.uint32))


@pytest.mark.slow
@needs_llvm
@pytest.mark.parametrize("ending", ["ply", "obj"])
@pytest.mark.parametrize("grouped", [False, True])
def test_a_file_without_normals_has_the_same_ones_on_any_number_of_threads(tmp_path, ending, grouped):
    trimesh.creation.icosphere(subdivisions=5).export(tmp_path / f"ball.{ending}")
    entry = {"type": ending, "filename": str(tmp_path / f"ball.{ending}"), "id": "the.ball"}
    described = {"type": "scene", "ball": entry, "sky": {"type": "constant"}}
    if grouped:
        instance = {"type": "instance", "group": {"type": "ref", "id": "group"}}
        described |= {"ball": {"type": "shapegroup", "id": "group", "inner": entry}, "shown": instance}
    found = []
    for threads in THREADS:
        backend.activate_backend("llvm", threads=threads)
        entries = {name: entry for name, entry in described.items() if name != "type"}
        loaded, _ = mitsuba_scene.load_lit_scene(entries, ("sky",), max_depth=2)
        key = next(key for key in mi.traverse(loaded).keys() if key.endswith("vertex_normals"))  # noqa: SIM118
        found.append(normals_of(loaded, key.removesuffix("vertex_normals")))
        positions, faces = (np.array(mi.traverse(loaded)[key.replace("vertex_normals", name)]).reshape(-1, 3)
                            for name in ("vertex_positions", "faces"))  # fmt: skip
    assert all(np.array_equal(found[0], other) for other in found)
    assert np.array_equal(found[0], meshes.vertex_normals(positions, faces))


@needs_llvm
@pytest.mark.parametrize("ending", ["ply", "obj"])
def test_a_file_with_the_normals_of_its_faces_stays_flat(tmp_path, ending):
    """A box whose sides share their vertices: its top is lit as a plane and not as a part of a ball."""
    trimesh.creation.box().export(tmp_path / f"box.{ending}")
    entry = {"type": ending, "filename": str(tmp_path / f"box.{ending}"), "face_normals": True}
    backend.activate_backend("llvm")
    loaded, _ = mitsuba_scene.load_lit_scene({"box": entry, "sky": {"type": "constant"}}, ("sky",), max_depth=2)
    hit = loaded.ray_intersect(mi.Ray3f(mi.Point3f(0.3, 0.2, 2), mi.Vector3f(0, 0, -1)))
    assert np.ravel(hit.sh_frame.n) == pytest.approx([0, 0, 1], abs=1e-6)


@needs_llvm
@pytest.mark.parametrize("ending", ["ply", "obj"])
def test_normals_of_a_file_are_kept(tmp_path, ending):
    file = tmp_path / f"one.{ending}"
    if ending == "obj":
        file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n  vn 0 0.6 0.8\nf 1//1 2//1 3//1\n")
    else:
        names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        rows = "".join(f"{x} {y} 0 0 0.6 0.8\n" for x, y in ((0, 0), (1, 0), (0, 1)))
        header = (
            f"ply\nformat ascii 1.0\nelement vertex 3\n{names}element face 1\nproperty list uchar int vertex_index\n"
        )
        file.write_text(f"{header}end_header\n{rows}3 0 1 2\n")
    backend.activate_backend("llvm")
    described = {"one": {"type": ending, "filename": str(file)}, "sky": {"type": "constant"}}
    loaded, _ = mitsuba_scene.load_lit_scene(described, ("sky",), max_depth=2)
    assert normals_of(loaded, "one.") == pytest.approx(np.tile([0, 0.6, 0.8], (3, 1)))


@needs_llvm
def test_the_table_of_a_mesh_lamp_is_the_same_on_any_number_of_threads():
    found = []
    for threads in THREADS:
        backend.activate_backend("llvm", threads=threads)
        mesh = mesh_of(*random_mesh(20_000, 60_000))
        drawn = mi.Point2f(np.random.default_rng(7).random((2, 50_000)).astype(np.float32))
        point = mesh.sample_position(0.0, drawn)
        found.append(np.concatenate([np.array(point.p).ravel(), np.array(point.pdf).ravel()]).tobytes())
    assert len(set(found)) == 1


@needs_llvm
@pytest.mark.slow
def test_stacks_and_slices_are_the_same_on_any_number_of_threads(mixed):
    digests = set()
    for threads in THREADS:
        renderer = SceneRenderer(mixed, SensorGrid(12, 16, 120e-6), backend_name="llvm", max_depth=3, threads=threads)
        seen, digest = renderer.trace_geometry(time_s=0.3), hashlib.sha256()
        for window in (None, (4, 6)):
            stack = renderer.render_stack(seen, positions=17, samples=4, time_s=0.3, window=window).radiance
            assert stack.std() > 0
            digest.update(stack.tobytes())
        digests.add(digest.hexdigest())
    assert len(digests) == 1
