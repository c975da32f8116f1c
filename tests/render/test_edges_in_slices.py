"""Time slices, whose paths are summed in layers, have the edges of stacks of scenes at rest, which have none."""

import numpy as np
import pytest
from blurred_edges import fit_edge
from written_scenes import load_setup, needs_llvm, render_filtered, write_scene

from saf_gen.render.render_setup import SensorGrid

GRID = SensorGrid(rows=32, columns=112, pitch_m=30e-6)
LENS = "{focal_length_mm: 25, f_number: 1.4, focus_range_m: [3.0, 0.42]}"
POSITIONS, NEAR_M, WALL_M = 129, 0.5, 2.0
EDGE, SEAM = 28, -24  # columns right of the middle; x of the scene points to the left


def write_card_before_wall(folder, monkeypatch):
    """Write a dark card, whose edge is at EDGE, before a wall of two halves that meet at SEAM; return the lamps too."""
    near, seam = (-columns * GRID.pitch_m / 26.3e-3 * m for columns, m in ((EDGE, NEAR_M), (SEAM, WALL_M)))
    rectangle = (
        "{{'type': 'rectangle', 'to_world': t.translate([{x}, 0, {z}]).rotate([0, 1, 0], 180).scale(2),"
        " 'emitter': {{'type': 'area', 'radiance': {{'type': 'rgb', 'value': {light}}}}}}}"
    )
    shapes = {
        "card": rectangle.format(x=near - 2, z=0, light=0.2),
        "left": rectangle.format(x=seam - 2, z=WALL_M - NEAR_M, light=1.0),
        "right": rectangle.format(x=seam + 2, z=WALL_M - NEAR_M, light=0.5),
    }
    source = "{" + ", ".join(f"'{name}': {shape}" for name, shape in shapes.items()) + "}"
    return write_scene(
        folder, monkeypatch, lens=LENS, distance_m=NEAR_M, shapes=source, light=", ".join(shapes), target="card"
    ), list(shapes)


@pytest.mark.slow
@pytest.mark.daily(2)
@needs_llvm
@pytest.mark.parametrize("blur", [-3.0, -1.5, 1.5, 3.0, 17.5])
def test_edges_in_a_time_slice_are_those_of_the_scene_at_rest(blur, tmp_path, monkeypatch):
    """The edge of a card, and a seam of the wall behind it, which is blurred by 22 pixels more or less.

    Fitted blur within 0.5 %, or 5 % of 1.5 pixels, of that of the lens; places within 0.02 pixels of the stack at rest.
    """
    scene, names = write_card_before_wall(tmp_path, monkeypatch)
    setups = {"all": load_setup(scene, names, grid=GRID)}
    drive, focus = scene.build_drive(), np.linspace(0, 1, POSITIONS)
    scale = 2 * drive.aperture_radius_m * drive.image_distance(focus) / GRID.pitch_m
    card, wall = (scale * (1 / m - 1 / drive.object_distance(focus)) for m in (NEAR_M, WALL_M))
    k = int(np.abs(card - blur).argmin())
    asked = {"samples": 64, "positions": POSITIONS, "seed": 3}
    still = render_filtered(setups, **asked)["all"][k]
    moving = render_filtered(setups, **asked, window=(k, k + 1))["all"][0]
    for columns, expected in ((slice(68, 100), abs(card[k])), (slice(4, 60), abs(wall[k]))):
        (width, place), (still_width, still_place) = (
            fit_edge(picture[:, columns].mean(axis=0, dtype=np.float64), expected) for picture in (moving, still)
        )
        assert width == pytest.approx(expected, rel=0.05 if expected < 2 else 0.005)
        assert width == pytest.approx(still_width, rel=0.05 if expected < 2 else 0.01)
        assert place == pytest.approx(still_place, abs=0.02)
