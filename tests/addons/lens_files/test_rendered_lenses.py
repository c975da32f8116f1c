"""Rendered pictures of a lens read from a file, against rays traced through its surfaces one by one."""

from dataclasses import replace

import numpy as np
import pytest
from lens_texts import LENSES
from refusals import refusal
from written_scenes import load_setup, needs_llvm, render_stack_once, write_scene

from saf_gen.addons.lens_files.reading import read_prescription
from saf_gen.addons.lens_files.trace import Rays, trace_back
from saf_gen.optics import FittedLensDrive
from saf_gen.optics.fitted_file import read_lens
from saf_gen.render.camera_rays import cast_rays
from saf_gen.render.depth_and_target import trace_depth_at
from saf_gen.render.render_setup import SensorGrid
from saf_gen.render.scene_renderer import SceneRenderer

PITCH_M, NM = 20e-6, 587.5618
GRID = SensorGrid(rows=8, columns=480, pitch_m=PITCH_M)
CARD = "{file: double_gauss, f_number: 2.0, focus_range_m: [1.1, 0.91]}"
GLOW = "'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': 1.0}}"
EDGE_M, DISTANCE_M = 0.0805, 1.0  # an edge about 4.4 mm from the middle of the sensor


def edge_setup(folder, monkeypatch, *, edge_m=EDGE_M, grid=GRID):
    """A bright half plane 1 m in front of the entrance pupil, whose edge crosses the picture."""
    half = 0.5
    shapes = (
        f"{{'glow': {{'type': 'rectangle', 'to_world': t.translate([{edge_m + half} * m, 0, 0])"
        f".rotate([0, 1, 0], 180).scale({half} * m), {GLOW}}}}}"
    )
    scene = write_scene(
        folder, monkeypatch, lens=CARD, distance_m=DISTANCE_M, shapes=shapes, light="glow", target="glow", unit_m=0.001
    )
    return load_setup(scene, ("glow",), grid=grid)


def traced(drive, a, x, *, position):
    """Rays in the plane of the entrance pupil (m), traced through the surfaces of the double Gauss."""
    made, lens = read_prescription(LENSES / "double_gauss.zmx"), read_lens("double_gauss")
    m, v = drive.pupil_magnification, float(drive.image_distance(position))
    behind = Rays(1e3 * m * a, (a - x / m) / v).at(lens.exit_pupil_mm)
    rays = trace_back(made, behind, wavelength_nm=NM)[0].at(-lens.entrance_pupil_mm)
    return Rays(rays.place / 1e3, rays.slope)


@needs_llvm
def test_rays_leave_the_lens_as_they_do_when_traced_through_its_surfaces(tmp_path, monkeypatch):
    """What a ray meets 1 m in front of the lens, within 0.05 pixels rms and 0.2 at worst; float32 included."""
    setup = edge_setup(tmp_path, monkeypatch)
    drive = setup.drive
    assert isinstance(drive, FittedLensDrive)
    rays = next(cast_rays(setup, np.linspace(0, 1, 3), samples=4, seed=1))
    a, x = np.array(rays.lens, np.float64), np.stack([np.array(rays.x), np.array(rays.y)]).astype(np.float64)
    origin, way = (np.array(v, np.float64) for v in (rays.ray.o, rays.ray.d))
    to_camera = np.linalg.inv(np.array(setup.to_world.matrix, np.float64))
    origin = to_camera[:3, :3] @ origin + to_camera[:3, 3:]
    way = to_camera[:3, :3] @ way
    met = (origin[:2] + way[:2] / way[2] * (1e3 * DISTANCE_M - origin[2])) / 1e3
    expected = traced(drive, a, x, position=0.5).at(DISTANCE_M).place
    off = np.hypot(*(met - expected)) * float(drive.image_distance(0.5)) / DISTANCE_M / PITCH_M
    assert np.sqrt((off**2).mean()) < 0.05
    assert off.max() < 0.2


@pytest.mark.slow
@needs_llvm
def test_an_edge_is_the_sum_of_traced_rays(tmp_path, monkeypatch):
    """Plain paths against rays through the surfaces, eight independent sums each: Welch's t of every column that the
    blurred edge touches, at five positions. Family-wise significance 0.001 (Bonferroni); seeds 0 to 7.
    """
    setup = edge_setup(tmp_path, monkeypatch)
    drive, seeds, samples = setup.drive, range(8), 256
    stacks = np.stack([render_stack_once(setup, positions=5, samples=samples, seed=seed) for seed in seeds])
    seen = stacks.mean(axis=2)  # (seed, position, column): all rows show the same to 1e-3 pixels
    worst, cases = 0.0, 0
    for k, position in enumerate(np.linspace(0, 1, 5)):
        middle = int(np.abs(np.diff(seen[:, k].mean(axis=0))).argmax())
        columns = slice(middle - 12, middle + 14)
        expected = np.stack([edge_of_traced_rays(drive, columns, position=position, seed=seed) for seed in seeds])
        found = seen[:, k, columns]
        spread = found.var(axis=0, ddof=1) / 8 + expected.var(axis=0, ddof=1) / 8
        touched = spread > 1e-8
        t = np.abs(found.mean(axis=0) - expected.mean(axis=0))[touched] / np.sqrt(spread[touched])
        worst, cases = max(worst, float(t.max())), cases + int(touched.sum())
        assert found.mean(axis=0)[~touched] == pytest.approx(expected.mean(axis=0)[~touched], abs=2e-3)
    from scipy.stats import t as student

    assert cases > 25
    assert worst < student.ppf(1 - 0.001 / 2 / cases, 10)


def edge_of_traced_rays(drive, columns, *, position, seed):
    """Columns of the picture of the edge, by random rays through pixels and aperture, float64 (column,)."""
    rng = np.random.default_rng(100 + seed)
    count, size = columns.stop - columns.start, 600
    angle, r = 2 * np.pi * rng.random(count * size), np.sqrt(rng.random(count * size))
    a = drive.aperture_radius_m * r * np.stack([np.cos(angle), np.sin(angle)])
    at = np.repeat(np.arange(columns.start, columns.stop), size) + rng.random(count * size)
    row = GRID.rows * (rng.random(count * size) - 0.5)
    x = np.stack([(at - GRID.columns / 2) * PITCH_M, row * PITCH_M])
    met = traced(drive, a, x, position=position).at(DISTANCE_M).place[0]
    return (met > EDGE_M).reshape(count, size).mean(axis=1)


@needs_llvm
def test_the_depth_of_each_pixel_is_that_of_the_ray_through_the_middle_of_the_lens(tmp_path, monkeypatch):
    """The edge of the target is where the traced chief ray meets it, within a pixel: 1.3 pixels from a lens without
    distortion at 9 mm.
    """
    grid = replace(GRID, columns=1000)
    setup = edge_setup(tmp_path, monkeypatch, edge_m=0.170, grid=grid)
    found = trace_depth_at(setup, ("glow",), position=0.5)
    x = (np.arange(grid.columns) + 0.5 - grid.columns / 2) * PITCH_M
    chief = traced(setup.drive, np.zeros((2, x.size)), np.stack([x, 0 * x]), position=0.5).at(DISTANCE_M).place[0]
    bright = chief > 0.170
    plain = x / float(setup.drive.image_distance(0.5)) * DISTANCE_M
    assert abs(int(found.target[4].sum()) - int(bright.sum())) <= 1
    assert abs(int((-plain > 0.170).sum()) - int(bright.sum())) > 1


def test_scalar_refuses_a_lens_from_a_file(tmp_path, monkeypatch):
    scene = write_scene(
        tmp_path, monkeypatch, lens=CARD, distance_m=1.0, shapes="{}", light="glow", target="glow", unit_m=0.001
    )
    assert refusal(SceneRenderer, scene, GRID, backend_name="scalar").allowed == "llvm, cuda"
