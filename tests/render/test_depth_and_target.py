"""Depth and target when the scale of the image changes strongly over the travel."""

import numpy as np
import pytest
from refusals import refusal
from written_scenes import SENSOR_GRID, load_setup, write_scene

from saf_gen.authoring.checks import check_scene
from saf_gen.camera import get_sensor
from saf_gen.optics import ImageDistanceDrive, Stage
from saf_gen.render import depth_and_target

HALF_M = SENSOR_GRID.columns * SENSOR_GRID.pitch_m / 2
MACRO = ImageDistanceDrive(0.05, 4.0, (1.0, 0.12))  # its picture grows by 1.6
STAGE = Stage(0.025, 2.0, 1 / 19, (-0.08, 0.10))


def half_field(drive, position, depth_m):
    """Half of the width (m) that the frame sees of a plane at this depth."""
    return HALF_M * (depth_m - float(drive.shift(position))) / float(drive.image_distance(position))


@pytest.fixture
def patch(tmp_path, monkeypatch):
    """Load a shining square of 2 % of the half field, at an offset from the axis that is given in half fields."""

    def placed(drive, depth_m, offset, at):
        across = half_field(drive, at, depth_m)
        shapes = (
            f"{{'glow': {{'type': 'rectangle', 'emitter': {{'type': 'area', 'radiance': 1.0}},"
            f" 'to_world': t.translate([{offset * across}, 0, 0])"
            f".rotate([0, 1, 0], 180).scale({0.02 * across})}}}}"
        )
        lens = "{focal_length_mm: 25, f_number: 2, focus_range_m: [0.6, 0.42]}"  # replaced by the test's lens
        scene = write_scene(
            tmp_path, monkeypatch, lens=lens, distance_m=depth_m, shapes=shapes, light="glow", target="glow"
        )
        return load_setup(scene, ("glow",), name="scalar", drive=drive)

    return placed


def same(one, other):
    return np.array_equal(one.depth, other.depth) and np.array_equal(one.target, other.target)


def at(setup, position):
    return depth_and_target.trace_depth_at(setup, ("glow",), position=position)


@pytest.mark.parametrize(("offset", "passing"), [(0.82, False), (0.9, True), (0.96, False)])
def test_a_target_that_is_in_the_frame_only_where_it_is_in_focus_is_seen(patch, offset, passing):
    """In focus at 0.9 m the frame sees 1.31 times as much as at the middle of the travel."""
    best = float(MACRO.best_position(0.9))
    setup = patch(MACRO, 0.9, offset, best)
    assert not at(setup, 0.5).target.any()
    seen = depth_and_target.trace_geometry(setup, ("glow",), allow_unseen_target=passing)
    columns = np.flatnonzero(seen.target.any(axis=0))
    assert columns.mean() + 0.5 == pytest.approx(SENSOR_GRID.columns / 2 * (1 - offset), abs=0.5)
    assert seen.depth[seen.target] == pytest.approx(0.9, rel=1e-5)
    assert same(seen, at(setup, MACRO.least_blur(seen.depth[seen.target])))


OUT = [
    pytest.param(MACRO, 0.125, 0.9, 0.5, id="seen half way"),
    pytest.param(MACRO, 0.125, 0.9, 0.0, id="seen at one end"),
    pytest.param(STAGE, 0.58, 0.94, 0.5, id="stage"),
]


@pytest.mark.parametrize(("drive", "depth_m", "offset", "seen_at"), OUT)
def test_a_target_that_is_out_of_the_frame_when_in_focus_is_refused(patch, drive, depth_m, offset, seen_at):
    setup = patch(drive, depth_m, offset, seen_at)
    best = float(drive.best_position(depth_m))
    assert 0 < best < 1
    assert at(setup, seen_at).target.any()
    error = refusal(depth_and_target.trace_geometry, setup, ("glow",))
    assert f"outside the image at {best:.3f} of the travel, where it is in focus" in error.problem
    assert drive.travel_key in error.hint


@pytest.mark.parametrize(("drive", "depth_m", "offset", "seen_at"), OUT)
def test_a_moment_at_which_it_has_left_the_frame_has_an_empty_mask(patch, drive, depth_m, offset, seen_at):
    setup = patch(drive, depth_m, offset, seen_at)
    seen = depth_and_target.trace_geometry(setup, ("glow",), allow_unseen_target=True)
    assert not seen.target.any()
    where = float(drive.best_position(depth_m)) if seen_at == 0.5 else 0.5
    assert seen.depth.shape == (SENSOR_GRID.rows, SENSOR_GRID.columns)
    assert same(seen, at(setup, where))


@pytest.mark.parametrize("passing", [False, True])
def test_a_target_that_is_visible_over_the_full_travel_is_traced_twice(patch, passing, monkeypatch):
    """Once at the middle of the travel and once where it is in focus, which gives the mask."""
    setup, positions, trace_at = patch(MACRO, 0.5, 0.3, 0.5), [], depth_and_target.trace_depth_at

    def counted(setup, shapes, *, position, **rays):
        positions.append(position)
        return trace_at(setup, shapes, position=position, **rays)

    monkeypatch.setattr(depth_and_target, "trace_depth_at", counted)
    seen = depth_and_target.trace_geometry(setup, ("glow",), allow_unseen_target=passing)
    assert positions == [0.5, pytest.approx(float(MACRO.best_position(0.5)), abs=1e-5)]
    assert same(seen, trace_at(setup, ("glow",), position=positions[1]))


def test_a_target_that_is_in_no_frame_is_refused(patch):
    setup = patch(MACRO, 0.9, 1.2, 0.0)
    error = refusal(depth_and_target.trace_geometry, setup, ("glow",))
    assert "(glow) is not visible" in error.problem
    assert "camera and target" in error.hint
    seen = depth_and_target.trace_geometry(setup, ("glow",), allow_unseen_target=True)
    assert not seen.target.any()


def test_the_checks_report_a_target_whose_shape_has_another_id(tmp_path, monkeypatch, small_sensor):
    """No unit is suggested for it, as its size is unknown."""
    lens = "{focal_length_mm: 25, f_number: 2, focus_range_m: [0.6, 0.42]}"
    shapes = "{'card': {'type': 'rectangle', 'id': 'printed'}, 'sky': {'type': 'constant'}}"
    scene = write_scene(tmp_path, monkeypatch, lens=lens, distance_m=0.5, shapes=shapes, light="sky", target="card")
    last = list(check_scene(scene, get_sensor(str(small_sensor)), backend="scalar"))[-1]
    assert (last.check, last.level) == ("reach", "error")
    assert "(card) is not visible" in last.text
    assert last.text.endswith("no shape has that id: in scene.py, set the id of the shape to its key, 'card'")
