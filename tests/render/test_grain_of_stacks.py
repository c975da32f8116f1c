"""The second render of stacks for their grain: which are rendered, and that the noise of both is independent."""

from dataclasses import replace

import numpy as np
import pytest
from capture_dataset import write_moving_plane
from small_dataset import SPEC
from written_scenes import SENSOR_GRID, VARIANT, needs_llvm

from saf_gen.render import render_missing
from saf_gen.render.grain import _choose_positions, measure_by_repeat
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.focal_stack import StackSpec, StackStore
from saf_gen.stack.grain import FILE, estimate_grain, read_grain
from saf_gen.stack.second_render import stacks_to_repeat


def specs_of(scene, times, *, samples, window=(3, 4)):
    return [
        StackSpec.from_scene(
            scene,
            SENSOR_GRID,
            positions=9,
            samples=samples,
            max_depth=3,
            time_s=time_s,
            wavelength_m=0.0,
            window=window,
        )
        for time_s in times
    ]


@pytest.fixture
def plane(tmp_path, monkeypatch):
    write_moving_plane(tmp_path, monkeypatch)
    return find_scene("plane")


@needs_llvm
@pytest.mark.slow
def test_the_grain_of_a_stored_stack_is_that_of_two_full_renders(plane, tmp_path):
    """64 samples against 8: the law of 1/n may overestimate it, here by less than a half."""
    root = tmp_path / "stacks"
    (spec,) = specs_of(plane, [0.02], samples=64, window=None)
    (other,) = specs_of(plane, [0.02], samples=65, window=None)
    for each in (spec, other):
        render_missing(plane, [each], root=root, backend_name=VARIANT)
    reported = set()
    measure_by_repeat(plane, [spec], root=root, backend_name=VARIANT, progress=lambda name, _: reported.add(name))
    assert reported == {"grain"}
    found = read_grain(root, spec)
    assert found.samples == (64, 8)
    first, second = (StackStore(root, each).load().radiance.sum(axis=0) for each in (spec, other))
    for k in (0, 4, 8):
        full = estimate_grain(first[k], second[k])
        assert 0.9 < found.mix(k, np.ones(2))[0] / full.rms.value < 1.5
        assert np.corrcoef(first[k].ravel() - second[k].ravel(), first[k].ravel())[0, 1] < 0.2


@pytest.mark.slow
@needs_llvm
def test_what_has_been_measured_is_not_rendered_again(plane, tmp_path):
    specs = specs_of(plane, [0.0, 0.02, 0.04], samples=4)
    render_missing(plane, specs, root=tmp_path, backend_name=VARIANT)
    measure_by_repeat(plane, specs, root=tmp_path, backend_name=VARIANT)
    written = {path: path.stat().st_mtime_ns for path in tmp_path.rglob(FILE)}
    assert 1 <= len(written) <= 2
    measure_by_repeat(plane, specs, root=tmp_path, backend_name="no such backend")
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob(FILE)} == written
    next(iter(written)).unlink()
    measure_by_repeat(plane, specs, root=tmp_path, backend_name=VARIANT)
    assert set(tmp_path.rglob(FILE)) == set(written)


def store_geometry(root, seen, depths, windows):
    """Store only the geometry of stacks: whether the target is seen, its depth, and the window of positions."""
    specs = []
    for n, (visible, depth, window) in enumerate(zip(seen, depths, windows, strict=True)):
        spec = replace(SPEC, time_s=n / 100, window=window)
        target = np.full((16, 24), visible)
        StackStore(root, spec).write_geometry(np.full((16, 24), depth, np.float32), target, backend="llvm")
        specs.append(spec)
    return specs


@pytest.mark.slow
def test_the_slices_are_spread_evenly_and_hold_the_one_in_focus(tmp_path):
    """Of 100 slices the window passes the focus of 0.5 m, 0.462 of the travel, at slice 46: knot 3.7 of 8."""
    windows = [(round(n * 7 / 99), round(n * 7 / 99) + 1) for n in range(100)]
    specs = store_geometry(tmp_path, [True] * 100, [0.5] * 100, windows)
    chosen = [specs.index(spec) for spec in stacks_to_repeat(specs, tmp_path)]
    assert 6 <= len(chosen) <= 7
    assert np.diff(sorted({0, *chosen, 99})).max() <= 15
    middle = [float(spec.focus.mean()) for spec in specs]
    best = SPEC.drive.least_blur(np.array([0.5]))
    assert min(abs(middle[n] - best) for n in chosen) == min(abs(m - best) for m in middle)


@pytest.mark.slow
def test_slices_that_see_no_target_are_left_out(tmp_path):
    specs = store_geometry(tmp_path, [n < 30 for n in range(60)], [0.5] * 60, [(3, 4)] * 60)
    assert all(specs.index(spec) < 30 for spec in stacks_to_repeat(specs, tmp_path))
    unseen = store_geometry(tmp_path, [False] * 3, [0.5] * 3, [(2, 3)] * 3)
    assert stacks_to_repeat(unseen, tmp_path) == []


def test_a_long_stack_is_measured_at_some_positions_and_in_focus():
    spec = replace(SPEC, positions=513)
    chosen = _choose_positions(spec, 0.2512)
    assert 33 <= chosen.size <= 34
    assert {0, 129, 512} <= set(chosen.tolist())
    assert np.diff(chosen).max() <= 16
    assert _choose_positions(SPEC, 0.5).tolist() == list(range(9))
