"""Scenes that tests of the renderer write, load and render."""

import os

import numpy as np
import pytest

from saf_gen.render import backend, filtered_pass, mitsuba_scene, one_pass
from saf_gen.render.render_setup import RenderSetup, SensorGrid
from saf_gen.scene.scene_folder import find_scene

ASKED = os.environ.get("SAF_GEN_TEST_VARIANT", "")
"""The variant of the option --variant, or an empty string without it."""
JIT = "cuda" if ASKED == "cuda" else "llvm"
"""The variant that traces all positions at once."""
CAN_TRACE = ASKED != "scalar" and (JIT == "cuda" or backend.probe_backends().llvm_usable)
VARIANT = JIT if CAN_TRACE else "scalar"
SENSOR_GRID = SensorGrid(rows=40, columns=64, pitch_m=60e-6)
LENS = "{focal_length_mm: 25, f_number: 2.0, focus_range_m: [0.6, 0.42]}"
needs_llvm = pytest.mark.skipif(not CAN_TRACE, reason=backend.probe_backends().llvm_description)
"""Marks a test of what the variant scalar cannot do; with --variant cuda it needs no LLVM."""


def load_setup(scene, burning=("lamp", "room"), *, name=JIT, grid=SENSOR_GRID, drive=None, max_depth=3):
    """Return a scene ready to render, with the scene's drive unless another one is given."""
    backend.activate_backend(name)
    described = mitsuba_scene.scene_dict(scene)
    lit, integrator = mitsuba_scene.load_lit_scene(described, burning, max_depth=max_depth)
    to_world, unit = mitsuba_scene.camera_to_world(scene), scene.card.unit_m
    return RenderSetup(lit, integrator, to_world, drive or scene.build_drive(), grid, unit)


def render_stack_once(setup, **options):
    """Return the stack, and assert that no firefly was clipped."""
    stack, clipped = one_pass.render_stack(setup, **options)
    assert clipped == 0
    return stack


def render_filtered(setups, *, samples, positions, seed=1, window=None):
    """Return the stacks of the light groups lamp and room, rendered with shared shading."""
    asked = {"samples": samples, "emitting": ["lamp", "room"]}
    shading = filtered_pass.estimate_shading([filtered_pass.gather_shading(setups, seed=1000 + seed, **asked)])
    found = filtered_pass.render_with_shading(setups, shading, positions=positions, seed=seed, window=window, **asked)
    return {name: stack for name, (stack, _) in found.items()}


def write_scene(folder, monkeypatch, *, lens=LENS, distance_m=0.5, shapes, light, target, unit_m=1.0):
    """Write and find a scene of one light; the lens is ``distance_m`` in front of the origin and looks along +z.

    ``lens`` is the card's lens. ``light`` names the emitters, separated by commas; the first also names their group.
    ``shapes`` is the source text of the dictionary that build() returns; it multiplies
    lengths in metres by ``m``, the number of scene units per metre.
    """
    scene = folder / "made"
    scene.mkdir()
    (scene / "scene.yaml").write_text(
        f"id: made\ntitle: Made\nlicence: Apache-2.0\nsource: here\nunit_m: {unit_m}\n"
        f"camera: {{origin_m: [0, 0, {-distance_m}], look_at_m: [0, 0, 0]}}\n"
        f"lens: {lens}\nlights: {{{light.partition(',')[0]}: [{light}]}}\ntarget: [{target}]\n"
    )
    (scene / "scene.py").write_text(
        "import mitsuba as mi\nimport numpy as np\n"
        "def build(params):\n"
        f"    t, m = mi.ScalarTransform4f(), {1 / unit_m!r}\n"
        f"    return {shapes}\n"
    )
    monkeypatch.setenv("SAF_GEN_SCENES", str(folder))
    return find_scene("made")


def write_edge_scene(folder, monkeypatch, *, lens, distance_m, edge_m=0.0, unit_m=1.0):
    """Write a scene of a bright half plane, so that the camera sees one straight edge, ``edge_m`` off the axis."""
    half = 0.5 * distance_m
    shapes = (
        f"{{'glow': {{'type': 'rectangle',"
        f" 'to_world': t.translate([{edge_m + half} * m, 0, 0]).rotate([0, 1, 0], 180).scale({half} * m),"
        " 'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': 1.0}}}}"
    )
    return write_scene(
        folder, monkeypatch, lens=lens, distance_m=distance_m, shapes=shapes, light="glow", target="glow", unit_m=unit_m
    )


def measure_edge(image, pitch_m):
    """Return width and position, in metres from the middle, of a blurred edge along the columns.

    The profile of an edge blurred by a disc of diameter c has a derivative of standard deviation c/4; a pixel
    and the difference of two pixels each add 1/12 of a squared pixel. Its centre of gravity is where the centre
    of the lens sees the edge. The width is at least 0.
    """
    slope = np.diff(image.astype(np.float64).mean(axis=0))
    slope /= slope.sum()
    x = np.arange(1, slope.size + 1)  # the derivative is between two pixels
    centre = (slope * x).sum()
    variance = (slope * (x - centre) ** 2).sum() - 1 / 6
    return 4 * np.sqrt(max(variance, 0.0)) * pitch_m, (centre - image.shape[1] / 2) * pitch_m


def dispersion(stack):
    """Return variance over squared mean at each position, the noise-free sharpness."""
    stack = stack.astype(np.float64)
    return stack.var(axis=(1, 2)) / stack.mean(axis=(1, 2)) ** 2
