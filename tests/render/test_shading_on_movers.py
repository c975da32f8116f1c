"""Shading of moving shapes: it moves with the shape instead of staying where the shape was."""

from dataclasses import replace

import numpy as np
import pytest
from written_scenes import JIT, SENSOR_GRID, needs_llvm, write_scene

from saf_gen.render import filtered_pass, one_pass
from saf_gen.render.camera_rays import cast_rays
from saf_gen.render.estimators import MomentShading
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.render.surface_hits import CELL_DEPTH, SurfaceFinder
from saf_gen.scene.keyframes import Keyframe, RigidMotion
from saf_gen.scene.scene_folder import find_scene

LENS = "{focal_length_mm: 25, f_number: 2.0, drive: image_distance, focus_range_m: [0.60, 0.42]}"
# A board with a bar 5 mm in front of it that hides the lamp from its upper half.
SHAPES = """{
    'wall': {'type': 'rectangle', 'to_world': t.translate([0, 0, 0.1 * m]).rotate([0, 1, 0], 180).scale(0.4 * m)},
    'board': {'type': 'rectangle', 'to_world': t.rotate([0, 1, 0], 180).scale([0.03 * m, 0.02 * m, 1]),
              'bsdf': {'type': 'diffuse', 'reflectance': {'type': 'rgb', 'value': 0.8}}},
    'bar': {'type': 'rectangle', 'bsdf': {'type': 'twosided', 'bsdf': {'type': 'diffuse'}},
            'to_world': t.translate([0.012 * m, 0, -0.005 * m]).scale([0.002 * m, 0.02 * m, 1])},
    'sun': {'type': 'directional', 'direction': [-1, 0, 1], 'irradiance': {'type': 'rgb', 'value': 3.0}}}"""
STILL_S, STEP_S, SPEED = 0.5, 0.01, (0.03, 0.0, 0.02)  # m/s: 0.3 mm per moment, half a pixel


@pytest.fixture
def moving_board(tmp_path, monkeypatch):
    """A board and its bar that move together to the side and away; the wall behind them does not move."""
    scene = write_scene(tmp_path, monkeypatch, lens=LENS, distance_m=0.5, shapes=SHAPES, light="sun", target="board")
    end = ", ".join(str(speed) for speed in SPEED)
    motion = f"{{keyframes: [{{time_s: 0}}, {{time_s: 1, translate_m: [{end}], rotate_deg: 10}}], centre_m: [0, 0, 0]}}"
    card = scene.folder / "scene.yaml"
    card.write_text(card.read_text() + f"motion: {{board: {motion}, bar: {motion}}}\nslices_per_s: 100\n")
    return SceneRenderer(find_scene("made"), SENSOR_GRID, backend_name=JIT)


def test_the_shift_of_a_motion_is_that_of_its_centre():
    """For a shape that turns about any point."""
    frames = (Keyframe(time_s=0), Keyframe(time_s=2, translate_m=(1, -2, 0.5), rotate_deg=120))
    motion = RigidMotion(keyframes=frames, axis=(1, 2, -1), centre_m=(0.3, 0.1, -0.7))
    for time_s in (-1.0, 0.0, 0.7, 2.0, 3.0):
        moved = motion.pose_at(time_s) @ [*motion.centre_m, 1]
        assert motion.shift_at(time_s) == pytest.approx(moved[:3] - motion.centre_m, abs=1e-12)


@needs_llvm
def test_a_place_on_a_shape_that_moves_along_is_where_it_would_be_at_rest(moving_board):
    """Points and depths are those without motion, moved back in perspective."""
    setup, focus = moving_board.prepare(("sun",), time_s=STILL_S + 0.3), np.array([0.4, 0.6])
    rays = next(cast_rays(setup, focus, samples=4, seed=1))
    found, *_, distances = SurfaceFinder(setup, emitting=()).find(rays, focus, seed=1)
    as_seen, *_, same = SurfaceFinder(replace(setup, moved_m={}), emitting=()).find(rays, focus, seed=1)
    shift = np.linalg.inv(np.array(setup.to_world.matrix)[:3, :3]) @ (0.3 * np.array(SPEED))
    scale = float(setup.drive.image_distance(0.5)) / SENSOR_GRID.pitch_m
    depth = np.exp(as_seen.depth / scale * CELL_DEPTH)
    assert depth == pytest.approx(distances.end, rel=1e-4)  # both from the lens in the middle of its travel
    x = -(as_seen.column - SENSOR_GRID.columns / 2) * depth / scale - shift[0]
    y = -(as_seen.row - SENSOR_GRID.rows / 2) * depth / scale - shift[1]
    board = distances.end < 0.55
    assert 0.1 < board.mean() < 0.9
    assert np.array_equal(distances.end, same.end)
    for name in ("shape", "reflectance", "normal_u"):
        assert np.array_equal(getattr(found, name), getattr(as_seen, name))
    for name in ("column", "row", "depth"):
        assert np.array_equal(getattr(found, name)[~board], getattr(as_seen, name)[~board])
    depth = (depth - shift[2])[board]
    assert found.column[board] == pytest.approx(SENSOR_GRID.columns / 2 - x[board] / depth * scale, abs=1e-2)
    assert found.row[board] == pytest.approx(SENSOR_GRID.rows / 2 - y[board] / depth * scale, abs=1e-2)
    assert found.depth[board] == pytest.approx(np.log(depth) * scale / CELL_DEPTH, abs=1e-2)


@pytest.mark.slow
@needs_llvm
def test_a_shadow_that_moves_with_its_shape_keeps_its_edge(moving_board):
    """In nine moments a board and the shadow on it move four pixels to the side; compared with plain paths.

    The mean squared error of one render of either kind; with following it was 0.027 to 0.031 of that without, for
    three seeds.
    """
    times = [STILL_S - (8 - n) * STEP_S for n in range(9)]

    def render(follow):
        def show(time_s):
            setup = moving_board.prepare(("sun",), time_s=time_s)
            return {"sun": setup if follow else replace(setup, moved_m={})}

        shading = MomentShading(show, seed=5, emitting=["sun"]).estimate(times, samples=16)
        options = {"positions": 129, "window": (60, 61), "samples": 16, "seed": 6, "emitting": ["sun"]}
        return filtered_pass.render_with_shading(show(STILL_S), shading, **options)["sun"][0][0]

    still = moving_board.prepare(("sun",), time_s=STILL_S)
    reference, _ = one_pass.render_stack(still, positions=129, window=(60, 61), samples=512, seed=7)
    followed, left = (float(((render(follow) - reference[0]) ** 2).mean()) for follow in (True, False))
    assert followed < left / 10


@pytest.mark.slow
@needs_llvm
def test_a_pinhole_has_no_waves_and_a_picture_is_that_of_its_lens(moving_board):
    """Waves of 5 µm would blur a pinhole of f/64 over ten pixels. The end of the travel is also a position."""
    waves = SceneRenderer(moving_board.scene, SENSOR_GRID, backend_name=JIT, wavelength_m=5e-6)
    sharp = moving_board.render_pinhole(0.5, samples=1)
    assert np.array_equal(waves.render_pinhole(0.5, samples=1), sharp)
    assert not np.array_equal(waves.render_picture(0.5, samples=1), moving_board.render_picture(0.5, samples=1))
    seen = moving_board.trace_geometry()
    stack = moving_board.render_stack(seen, positions=5, samples=64, window=(3, 4), as_one_group=True)
    end = moving_board.render_picture(1.0, samples=64)
    assert end.mean() == pytest.approx(stack.radiance[0, 1].mean(), rel=0.01)
