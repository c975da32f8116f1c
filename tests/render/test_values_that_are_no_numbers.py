"""nan, which Dr.Jit's minimum and maximum hand on, neither stops a render nor spreads in it."""

from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from written_scenes import needs_llvm, write_scene

from saf_gen.render import backend, irradiance, mitsuba_scene
from saf_gen.render.device_splat import DeviceAccumulator
from saf_gen.render.host_splat import HostAccumulator, TracedPaths
from saf_gen.render.render_setup import SensorGrid
from saf_gen.render.scene_renderer import SceneRenderer


@needs_llvm
@pytest.mark.parametrize(
    "bsdf",
    ["{'type': 'diffuse', 'reflectance': holed}", "{'type': 'mask', 'opacity': holed, 'inner': {'type': 'diffuse'}}"],
)
def test_a_texel_that_is_nan_leaves_all_pixels_finite(tmp_path, monkeypatch, bsdf):
    """A quarter of the plane's picture is nan, as if computed: scenes with such files are refused."""
    monkeypatch.setattr(mitsuba_scene, "check_values", lambda described, where: None)
    holed = "np.where(np.indices((8, 8)).sum(0) % 4 == 0, np.nan, 0.5).astype(np.float32)[..., None]"
    picture = f"{{'type': 'bitmap', 'bitmap': mi.Bitmap({holed}), 'raw': True, 'filter_type': 'nearest'}}"
    turned = "t.rotate([0, 1, 0], 180)"
    shapes = (
        f"(lambda holed: {{'plane': {{'type': 'rectangle', 'to_world': {turned}, 'bsdf': {bsdf}}},"
        f" 'behind': {{'type': 'rectangle', 'to_world': t.translate([0, 0, 0.2]) @ {turned}}},"
        f" 'sky': {{'type': 'constant'}}}})({picture})"
    )
    made = write_scene(tmp_path, monkeypatch, shapes=shapes, light="sky", target="plane")
    renderer = SceneRenderer(made, SensorGrid(12, 16, 60e-6), backend_name="llvm", max_depth=3, threads=2)
    stack = renderer.render_stack(renderer.trace_geometry(allow_unseen_target=True), positions=17, samples=16)
    assert np.isfinite(stack.radiance).all()
    assert 0.1 < stack.radiance.mean() < 1


@needs_llvm
def test_a_path_on_a_border_whose_step_has_no_reciprocal_ends():
    """On one thread, because the others take so small a step as 0."""
    backend.activate_backend("llvm", threads=1)
    shape = (5, 4, 4)
    path = [np.array([value], np.float32) for value in (2, 1.5, -1e-40, 0.3, 0.5)]
    for kind in (HostAccumulator, DeviceAccumulator):
        sums = kind(shape, (0, 4), scale=1e9, max_radiance=1.0)
        sums.add(TracedPaths(*map(mi.Float, path)))
        assert sums.mean_radiance().sum() == pytest.approx(8 * 0.5)  # a pixel that it has left keeps its mean


@pytest.mark.parametrize("name", ["scalar", pytest.param("llvm", marks=needs_llvm)])
def test_a_lamp_in_the_lit_point_gives_no_direct_light(name):
    backend.activate_backend(name)
    nan = SimpleNamespace(d=mi.Vector3f(dr.nan))
    nothing = SimpleNamespace(
        emitter=lambda *_: SimpleNamespace(eval=lambda *_: mi.Color1f(0) if "mono" in str(mi.variant()) else 0.0),
        bsdf=lambda _: SimpleNamespace(flags=lambda: mi.UInt32(0)),
        is_valid=lambda: True,
    )
    scene = SimpleNamespace(sample_emitter_direction=lambda *_: (nan, 0.0), ray_intersect=lambda *_: nothing)
    setup = SimpleNamespace(
        mitsuba_scene=scene, integrator=SimpleNamespace(sample=lambda *_: (mi.Float(0.25), None, None))
    )
    hit = SimpleNamespace(spawn_ray=lambda towards: mi.Ray3f(mi.Point3f(0), towards))
    sampler = SimpleNamespace(next_2d=lambda: mi.Point2f(0.5))
    found = irradiance._sample_side(setup, hit, sampler=sampler, normal=mi.Normal3f(0, 0, 1), active=mi.Bool(True))
    assert np.ravel(found) == pytest.approx(0.25 * np.pi)
