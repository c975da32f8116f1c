"""Irradiance of the surfaces that the camera sees, against closed forms."""

import math

import mitsuba as mi
import numpy as np
import pytest

from saf_gen.optics import ImageDistanceDrive
from saf_gen.render import backend
from saf_gen.render.irradiance import target_irradiance
from saf_gen.render.render_setup import RenderSetup, SensorGrid

pytestmark = pytest.mark.slow

DRIVE = ImageDistanceDrive(0.025, 2.0, (0.6, 0.4))
GRID = SensorGrid(12, 16, 1e-4)
EVERY_PIXEL = np.ones((12, 16), dtype=bool)


@pytest.fixture(autouse=True)
def _scalar():
    """The simplest backend, unless a test asks for every one."""
    backend.activate_backend("scalar")


def received(shapes, *, depth=4, target=EVERY_PIXEL, position=0.5):
    """Irradiance and its standard error, for a lens 0.5 m above the plane z = 0 that looks down."""
    down = mi.ScalarTransform4f().look_at(origin=[0, 0, 0.5], target=[0, 0, 0], up=[0, 1, 0])
    loaded = mi.load_dict({"type": "scene", **shapes}, optimize=False)
    integrator = mi.load_dict({"type": "path", "max_depth": depth})
    return target_irradiance(RenderSetup(loaded, integrator, down, DRIVE, GRID), position=position, target=target)


def plane(**more):
    at = mi.ScalarTransform4f().scale(2)
    return {"type": "rectangle", "to_world": at, "bsdf": {"type": "diffuse", "reflectance": 0.3}, **more}


def assert_agrees(pair, expected):
    """Assert agreement within four standard errors and a percent, which covers the positions of the points."""
    value, error = pair
    assert error < 0.03 * expected
    assert value == pytest.approx(expected, abs=4 * error + 0.01 * expected)


def test_the_light_of_a_point_falls_as_the_inverse_square_and_the_cosine():
    lamp = {"type": "point", "position": [0.3, 0, 0.4], "intensity": 2.0}
    assert_agrees(received({"plane": plane(), "lamp": lamp}), 2.0 * 0.4 / 0.5 / 0.5**2)


def test_a_sky_of_radiance_l_gives_pi_l():
    assert_agrees(received({"plane": plane(), "sky": {"type": "constant", "radiance": 0.7}}), math.pi * 0.7)


@pytest.mark.parametrize("surface", ["grey", "null", "none"])
def test_a_disc_above_gives_pi_l_sin_squared(every_backend, surface):
    """E = π·L·R²/(R² + h²) on its axis, also for a lamp without a surface, as Blender exports it."""
    down = mi.ScalarTransform4f().translate([0, 0, 0.8]).rotate([1, 0, 0], 180).scale(0.4)
    lamp = {"type": "disk", "to_world": down, "emitter": {"type": "area", "radiance": 5.0}}
    if surface != "none":
        lamp["bsdf"] = {"type": "null"} if surface == "null" else {"type": "diffuse", "reflectance": 0.0}
    expected = math.pi * 5.0 * 0.4**2 / (0.4**2 + 0.8**2)
    assert_agrees(received({"plane": plane(), "lamp": lamp}), expected)


def test_light_by_way_of_a_wall_counts(every_backend):
    """In a closed white furnace of radiance L the sheet receives π·L, over paths of any length."""
    shell = {
        "type": "sphere",
        "radius": 1.5,
        "flip_normals": True,
        "bsdf": {"type": "diffuse", "reflectance": 0.5},
        "emitter": {"type": "area", "radiance": 1.0},
    }
    grey = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": 0.5}}
    sheet = {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(0.2), "bsdf": grey}
    # The shell emits 1 and reflects a half, so that L = 1 + L/2 if the sheet is small.
    pair = received({"shell": shell, "sheet": sheet}, depth=40)
    assert pair[0] == pytest.approx(2 * math.pi, rel=0.03)


@pytest.mark.parametrize(
    ("surface", "fraction"),
    [
        ({"type": "diffuse"}, 0.0),
        ({"type": "twosided", "bsdf": {"type": "diffuse"}}, 0.0),
        ({"type": "principledthin", "diff_trans": 1.0}, 1.0),
        ({"type": "thindielectric"}, 1.0),
        ({"type": "mask", "opacity": 0.5, "bsdf": {"type": "diffuse"}}, 1.0),
    ],
    ids=["diffuse", "twosided", "translucent", "glass", "half there"],
)
def test_light_on_the_back_counts_where_the_surface_lets_it_through(surface, fraction):
    """A disc 0.8 m behind gives π·L·R²/(R² + h²) on the back."""
    up = mi.ScalarTransform4f().translate([0, 0, -0.8]).scale(0.4)
    lamp = {"type": "disk", "to_world": up, "emitter": {"type": "area", "radiance": 5.0}}
    value, error = received({"plane": {**plane(), "bsdf": surface}, "lamp": lamp})
    expected = fraction * math.pi * 5.0 * 0.4**2 / (0.4**2 + 0.8**2)
    assert value == pytest.approx(expected, abs=4 * error + 0.01 * expected)
    assert error <= 0.03 * expected


def test_only_the_target_counts():
    """The right half of the picture is in the shadow of a screen."""
    lamp = {"type": "directional", "direction": [0, 0, -1], "irradiance": 3.0}
    at = mi.ScalarTransform4f().translate([1.0, 0, 0.8]).scale(1.0)
    screen = {"type": "rectangle", "to_world": at, "bsdf": {"type": "diffuse", "reflectance": 0.0}}
    left = np.zeros_like(EVERY_PIXEL)
    left[:, :8] = True
    shapes = {"plane": plane(), "lamp": lamp, "screen": screen}
    values = sorted(received(shapes, target=half)[0] for half in (left, ~left))
    assert values == pytest.approx([0, 3.0], abs=1e-3)
