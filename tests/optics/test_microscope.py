"""The stage at its real size: an objective of 4 mm at f/1.1 and 20×, and pixels of 20 µm that see 1 µm."""

import numpy as np
import pytest
from written_scenes import load_setup, measure_edge, needs_llvm, render_stack_once, write_edge_scene, write_scene

from saf_gen.optics import FocusCriterion
from saf_gen.render import depth_and_target, thin_lens
from saf_gen.render.render_setup import SensorGrid
from studies.laws.pupils import find_peak

pytestmark = needs_llvm

PITCH = 20e-6
FOCUS_M = 0.0042  # f·(1 + 1/20)
TRAVEL = "travel_m: [-3.0e-5, 3.0e-5]"
OBJECTIVE = f"{{drive: stage, focal_length_mm: 4, f_number: 1.1, magnification: 20, {TRAVEL}}}"
STOPPED_DOWN = f"{{drive: stage, focal_length_mm: 4, f_number: 20, magnification: 20, {TRAVEL}}}"


@pytest.mark.slow
def test_an_edge_is_blurred_placed_and_in_focus_by_the_closed_forms(tmp_path, monkeypatch):
    """Tolerances: depth 1 nm, widths 2 %, edge positions 0.05 pixel, the sharpest focus position a quarter step.

    One stack of 21 positions 3 µm apart, 2.6 million paths; blur up to 26 pixels. Between seeds the width
    scatters by 0.3 %.
    """
    height_m, grid = 8e-6, SensorGrid(rows=16, columns=96, pitch_m=PITCH)
    scene = write_edge_scene(tmp_path, monkeypatch, lens=OBJECTIVE, distance_m=FOCUS_M, edge_m=height_m, unit_m=0.001)
    setup = load_setup(scene, ("glow",), grid=grid)
    drive = setup.drive
    seen = depth_and_target.trace_geometry(setup, ("glow",))
    assert seen.depth[seen.target] == pytest.approx(FOCUS_M, abs=1e-9)
    assert 60e-6 * np.diff(FocusCriterion(drive, PITCH).depth_of_focus(seen.depth, seen.target)) == pytest.approx(
        2.31e-6, abs=1e-8
    )

    stack = render_stack_once(setup, positions=21, samples=500, seed=2)
    edges = [measure_edge(image, PITCH) for image in stack]
    for k in (0, 3, 7, 13, 17, 20):
        width, offset = edges[k]
        assert width == pytest.approx(float(drive.blur_diameter(k / 20, FOCUS_M)), rel=0.02)
        scale = 0.084 / (FOCUS_M - float(drive.shift(k / 20)))
        assert offset == pytest.approx(-scale * height_m, abs=0.05 * PITCH)
    assert edges[10][0] < 0.3 * PITCH
    curve = -(np.array([width for width, _ in edges]) ** 2)
    assert abs(find_peak(curve) - 20 * drive.best_position(FOCUS_M)) < 0.25


@pytest.mark.slow
def test_mitsubas_thin_lens_sees_the_same_in_a_tiny_unit(tmp_path, monkeypatch):
    """Widths of the edge as Mitsuba's thin lens renders it, at both ends: within 2 % of c (4 million paths)."""
    grid = SensorGrid(rows=16, columns=96, pitch_m=PITCH)
    scene = write_edge_scene(tmp_path, monkeypatch, lens=OBJECTIVE, distance_m=FOCUS_M, unit_m=1e-7)
    setup = load_setup(scene, ("glow",), grid=grid)
    for position in (0.0, 1.0):
        image = thin_lens.render_position(setup, position=position, samples=2500, seed=1)
        expected = float(setup.drive.blur_diameter(position, FOCUS_M))
        assert measure_edge(image, PITCH)[0] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("unit_m", "shadow"), [(0.001, True), (1.0, False)])
def test_a_card_shades_what_lies_under_it_where_the_unit_suits(tmp_path, monkeypatch, unit_m, shadow):
    """A white plane 20 µm under a black half plane is lit by (1 + x/√(x² + h²))/2 of an even sky.

    Mitsuba starts a shadow ray 0.00009 units off the surface: 0.09 µm if the unit is a millimetre, but 90 µm, above
    the card, if it is a metre. Within 2 % from 6 to 45 µm from the card's edge; in metres there is no shadow.
    """
    h, grid = 20e-6, SensorGrid(rows=40, columns=96, pitch_m=PITCH)
    shapes = (
        "{'plane': {'type': 'rectangle', 'to_world': t.rotate([0, 1, 0], 180).scale(0.005 * m),"
        " 'bsdf': {'type': 'diffuse', 'reflectance': 0.8}},"
        f" 'card': {{'type': 'rectangle', 'to_world': t.translate([-0.005 * m, 0, -{h} * m])"
        ".rotate([0, 1, 0], 180).scale(0.005 * m), 'bsdf': {'type': 'diffuse', 'reflectance': 0.0}},"
        " 'sky': {'type': 'constant', 'radiance': 1.0}}"
    )
    scene = write_scene(
        tmp_path,
        monkeypatch,
        lens=STOPPED_DOWN,
        distance_m=FOCUS_M,
        shapes=shapes,
        light="sky",
        target="plane",
        unit_m=unit_m,
    )
    setup = load_setup(scene, ("sky",), grid=grid)
    profile = render_stack_once(setup, positions=3, samples=256, seed=5)[1].mean(axis=0)
    x = -(np.arange(96) + 0.5 - 48) * PITCH / 20
    beside = (x > 6e-6) & (x < 45e-6)
    lit = 0.8 * (1 + x / np.hypot(x, h)) / 2 if shadow else np.full(96, 0.8)
    assert profile[beside] == pytest.approx(lit[beside], rel=0.02)
    assert profile[x < -6e-6] == pytest.approx(0.0, abs=1e-6)
