"""Rendered pictures of a lens with distortion: places of stripes, even fields, depth and target, by closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from written_scenes import load_setup, needs_llvm, render_filtered, render_stack_once, write_scene

from saf_gen.optics import Distortion, FocalLengthDrive, ImageDistanceDrive, Wavefront
from saf_gen.render.depth_and_target import trace_geometry
from saf_gen.render.render_setup import SensorGrid

PITCH_M = 60e-6
HEIGHT_M = 7e-3
GRID = SensorGrid(rows=6, columns=240, pitch_m=PITCH_M)
CARD = "{focal_length_mm: 50, f_number: 2, focus_range_m: [0.55, 0.45]}"  # replaced by the lens of each test
DRIVES = {
    "image_distance": ImageDistanceDrive(0.05, 4.0, (0.52, 0.48)),
    "focal_length": FocalLengthDrive(0.055, 4.0, (0.52, 0.48)),
}
every_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)


def distorted(drive, share=0.06):
    return replace(drive, distortion=Distortion(share, HEIGHT_M, float(drive.image_distance(0.5))))


def glowing(folder, monkeypatch, drive, *, places_m, half_m, grid=GRID, turned=0.0):
    """Glowing stripes, of which some are as wide as the scene, in the plane that the middle of the travel focuses."""
    folder.mkdir(exist_ok=True)
    glow = "'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': 1.0}}"
    shapes = ", ".join(
        f"'glow{n}': {{'type': 'rectangle', 'to_world': t.rotate([0, 1, 0], {180 + turned}).translate([{-x} * m, 0, 0])"
        f".scale([{half_m} * m, 0.2 * m, 1]), {glow}}}"
        for n, x in enumerate(places_m)
    )
    names = [f"glow{n}" for n in range(len(places_m))]
    scene = write_scene(
        folder, monkeypatch, lens=CARD, distance_m=float(drive.focus_depth(0.5)), shapes=f"{{{shapes}}}",
        light=", ".join(names), target=", ".join(names), unit_m=0.001,
    )  # fmt: skip
    return load_setup(scene, names, grid=grid, drive=drive), tuple(names)


def seen_at(drive, place_m, position, share):
    """The height on the sensor (m) of a place in the scene: the root of x·(1 - D·(x/h)²) = that of the perfect lens."""
    v, half = float(drive.image_distance(position)), float(drive.image_distance(0.5))
    slope = place_m / float(drive.focus_depth(0.5))
    bent = share * (half / HEIGHT_M) ** 2
    return v * brentq(lambda s: s * (1 - bent * s * s) - slope, -0.3, 0.3)


@needs_llvm
@pytest.mark.parametrize("filtered", [False, True], ids=["plain", "filtered"])
@pytest.mark.parametrize("share", [0.06, -0.04])
@every_drive
def test_stripes_are_where_the_closed_form_displaces_them(tmp_path, monkeypatch, drive, share, filtered):
    """In focus and at both ends of the travel, within 0.06 pixels of up to 5 by which they are displaced."""
    places = (-0.058, -0.03, 0.012, 0.05)
    setup, _ = glowing(tmp_path, monkeypatch, distorted(drive, share), places_m=places, half_m=0.0011)
    asked = {"samples": 64, "positions": 3}
    stack = render_filtered({"lamp": setup}, **asked)["lamp"] if filtered else render_stack_once(setup, seed=1, **asked)
    profile = stack.astype(np.float64).sum(axis=1)
    column = np.arange(GRID.columns)
    largest = 0.0
    for k, position in enumerate((0.0, 0.5, 1.0)):
        plain = [float(drive.image_distance(position)) * x / float(drive.focus_depth(0.5)) for x in places]
        expected = [seen_at(drive, x, position, share) for x in places]
        found = []
        for height in expected:
            middle = (GRID.columns - 1) / 2 - height / PITCH_M  # the camera's right is on the left of the scene
            near = np.abs(column - middle) < 12
            found.append((GRID.columns - 1) / 2 - profile[k, near] @ column[near] / profile[k, near].sum())
        assert np.array(found) == pytest.approx(np.array(expected) / PITCH_M, abs=0.06)
        largest = max(largest, np.abs(np.subtract(plain, expected)).max() / PITCH_M)
    assert largest > 3


@needs_llvm
@every_drive
def test_an_even_field_stays_even(tmp_path, monkeypatch, drive):
    """Radiance does not change along a ray, so no light is lost or gained at the edge."""
    setup, _ = glowing(tmp_path, monkeypatch, distorted(drive), places_m=(0.0,), half_m=0.3)
    stack = render_stack_once(setup, samples=8, positions=3, seed=1)
    assert stack == pytest.approx(np.ones_like(stack), abs=1e-5)


@needs_llvm
@every_drive
def test_depth_and_target_are_where_the_distorted_picture_has_them(tmp_path, monkeypatch, drive):
    """A tilted plane: depth by cutting it with the turned ray, and the target's edges with the lit pixels."""
    lens = distorted(drive)
    setup, names = glowing(tmp_path, monkeypatch, lens, places_m=(-0.004,), half_m=0.05, turned=20.0)
    seen = trace_geometry(setup, names)
    position = float(np.clip(setup.in_focus.true_focus(seen.depth, seen.target), 0, 1))
    row, column = np.nonzero(seen.target)
    v = float(drive.image_distance(position))
    slope = np.stack([column - 119.5, row - 2.5]) * PITCH_M / v
    bent = 0.06 * (float(drive.image_distance(0.5)) / HEIGHT_M) ** 2
    straight = slope * (1 - bent * np.square(slope).sum(axis=0))
    signs = []
    for sign in (1, -1):  # the plane is turned about the vertical axis; which way depends on Mitsuba's handedness
        expected = float(drive.focus_depth(0.5)) / (1 - sign * np.tan(np.radians(20)) * straight[0])
        signs.append(np.abs(seen.depth[row, column] / expected - 1).max())
    assert min(signs) < 2e-6 * 10
    picture = render_stack_once(setup, samples=64, positions=3, seed=1)[round(2 * position)]
    assert 60 < seen.target.mean() * 240 < 220
    assert np.abs(picture.sum() - seen.target.sum()) < 0.02 * seen.target.sum()


@needs_llvm
def test_distortion_adds_to_other_aberrations_and_leaves_the_truth(tmp_path, monkeypatch):
    drive = distorted(DRIVES["image_distance"])
    both = replace(drive, wavefront=Wavefront(spherical_m=5e-7, radius_m=drive.aperture_radius_m))
    truths = []
    for n, lens in enumerate((replace(both, distortion=None), both)):
        setup, names = glowing(tmp_path / str(n), monkeypatch, lens, places_m=(0.0,), half_m=0.3)
        seen = trace_geometry(setup, names)
        truths.append(setup.in_focus.true_focus(seen.depth, seen.target))
    assert truths[0] == pytest.approx(truths[1], abs=1e-4)
