"""Nothing is seen through the seams of a closed mesh."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from written_scenes import JIT, needs_llvm

from saf_gen.optics import ImageDistanceDrive
from saf_gen.render import backend, depth_and_target, mitsuba_scene
from saf_gen.render.render_setup import RenderSetup, SensorGrid

HALF_M, AWAY_M, WALL_M = 0.01, 0.5, 0.75  # half an edge of the box, and the distances to its middle and to the wall
DRIVE = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))
POSITION = float(DRIVE.best_position(AWAY_M))


def box_mesh(squares, to_world):
    """A closed box from -1 to 1, transformed; each face has ``squares`` × ``squares`` squares of two triangles."""
    steps = np.linspace(-1, 1, squares + 1)
    down, across = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    corner = (np.arange(squares)[:, None] * (squares + 1) + np.arange(squares)).ravel()
    one, two, three, four = corner, corner + 1, corner + squares + 2, corner + squares + 1
    triangles = np.concatenate([np.stack([one, two, three], axis=1), np.stack([one, three, four], axis=1)])
    vertices, faces = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            face = np.empty((down.size, 3))
            face[:, axis], face[:, axis - 2], face[:, axis - 1] = side, across, down
            faces.append((triangles if side > 0 else triangles[:, ::-1]) + len(vertices) * down.size)
            vertices.append(face)
    matrix = np.array(to_world.matrix, dtype=np.float64)
    placed = (np.concatenate(vertices) @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
    mesh = mi.Mesh("box", len(placed), sum(map(len, faces)))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = placed.ravel()
    parameters["faces"] = np.concatenate(faces).astype(np.uint32).ravel()
    parameters.update()
    return mesh


def load_box(squares, turn):
    wall = mi.ScalarTransform4f().translate([0, 0, WALL_M]).rotate([0, 1, 0], 180)
    described = {
        "box": box_mesh(squares, mi.ScalarTransform4f().translate([0, 0, AWAY_M]) @ turn.scale(HALF_M)),
        "wall": {"type": "rectangle", "to_world": wall},
        "sky": {"type": "constant"},
    }
    return mitsuba_scene.load_lit_scene(described, ("sky",), max_depth=2)


@pytest.mark.parametrize(("squares", "turned"), [(8, 0), (10, 45)])
def test_a_turned_box_has_no_hole_where_seams_lie_on_pixel_centres(every_backend, squares, turned):
    """Its silhouette is a square, and its front has one depth.

    Seams run through the centres of hundreds of pixels. Rays through only the
    centres see the inside of the box, or the wall, in 5 to 27 of these pixels, with either backend.
    """
    scene, integrator = load_box(squares, mi.ScalarTransform4f().rotate([0, 0, 1], turned))
    grid = SensorGrid(rows=256, columns=256, pitch_m=5e-6)
    setup = RenderSetup(scene, integrator, mi.ScalarTransform4f(), DRIVE, grid)
    depth = depth_and_target.trace_depth_at(setup, ("wall",), position=POSITION).depth
    slopes = (np.arange(256) - 127.5) * grid.pitch_m / float(DRIVE.image_distance(POSITION))
    slope_x, slope_y = np.meshgrid(slopes, slopes)
    angle = np.radians(turned)
    along = slope_x * np.cos(angle) + slope_y * np.sin(angle), slope_y * np.cos(angle) - slope_x * np.sin(angle)
    outwards = np.maximum(*np.abs(along)) * (AWAY_M - HALF_M) / HALF_M
    assert depth[outwards < 1 - 1e-4] == pytest.approx(AWAY_M - HALF_M, rel=1e-6)
    assert depth[outwards > 1 + 1e-4] == pytest.approx(WALL_M, rel=1e-6)
    assert 0.2 < (outwards < 1).mean() < 0.8


@pytest.mark.slow
@needs_llvm
def test_random_paths_that_enter_a_closed_mesh_are_too_few_to_count():
    """2²⁰ random rays from outside at a box of 49,152 triangles; 25 enter, more than 105 with p < 10⁻³⁰."""
    backend.activate_backend(JIT)
    scene, _ = load_box(64, mi.ScalarTransform4f().rotate([1, 0.3, 0.2], 37))
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(5, 1 << 20)
    direction = mi.warp.square_to_uniform_sphere(sampler.next_2d())
    aim = mi.Point3f(0, 0, AWAY_M) + mi.warp.square_to_uniform_sphere(sampler.next_2d()) * (HALF_M / 2)
    hit = scene.ray_intersect(mi.Ray3f(aim - direction * 0.1, direction))
    entered = np.array(dr.dot(hit.n, direction)) >= 0
    assert entered.mean() < 1e-4


def test_a_slope_has_the_depth_of_its_pixel_centres(every_backend):
    """A plane turned by 80° about an oblique axis, in closed form: to 10⁻⁶, which a shift by 1/256 pixel exceeds."""
    turn = mi.ScalarTransform4f().rotate([1, 0.7, 0], 80)
    plane = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, AWAY_M]) @ turn.scale(HALF_M)}
    described = {"plane": plane, "sky": {"type": "constant"}}
    scene, integrator = mitsuba_scene.load_lit_scene(described, ("sky",), max_depth=2)
    grid = SensorGrid(rows=64, columns=96, pitch_m=20e-6)
    setup = RenderSetup(scene, integrator, mi.ScalarTransform4f(), DRIVE, grid)
    seen = depth_and_target.trace_depth_at(setup, ("plane",), position=POSITION)
    normal = np.array(turn.matrix)[:3, 2]
    v = float(DRIVE.image_distance(POSITION))
    # Mitsuba's camera looks along +z with +x to the left, and rows go down: slopes fall with column and row.
    slope_x, slope_y = np.meshgrid(*(((n - 1) / 2 - np.arange(n)) * grid.pitch_m / v for n in (96, 64)))
    depth = AWAY_M * normal[2] / (slope_x * normal[0] + slope_y * normal[1] + normal[2])
    assert seen.target.sum() > 300
    assert seen.depth[seen.target] == pytest.approx(depth[seen.target], rel=1e-6)
    beside = np.abs(np.gradient(depth, axis=1)[seen.target]) / 256
    assert np.median(beside) > 3e-6 * AWAY_M
