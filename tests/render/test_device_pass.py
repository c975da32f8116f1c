"""The estimators on the device that traces the rays: the bits of those on the cores, and what they copy and launch."""

from collections import Counter

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from random_paths import paths, windows
from written_scenes import JIT, load_setup, needs_llvm, write_scene

from saf_gen.optics import Stage
from saf_gen.render import backend, camera_rays, device_splat, filtered_pass, one_pass
from saf_gen.render.device_layers import DeviceLayeredSums
from saf_gen.render.device_shading import DeviceField
from saf_gen.render.host_splat import TracedPaths
from saf_gen.render.layered_splat import BlurScale, LayeredSums
from saf_gen.render.shading_cells import CellTable, SurfaceHits
from saf_gen.render.surface_hits import Distances
from saf_gen.scene.scene_folder import find_scene

pytestmark = needs_llvm

LENS = "{focal_length_mm: 25, f_number: 2.0, drive: image_distance, focus_range_m: [0.60, 0.42]}"
WALL = """
    'wall': {'type': 'rectangle', 'to_world': t.translate([0, 0, 0.1 * m]).rotate([0, 1, 0], 180).scale(0.4 * m),
             'bsdf': {'type': 'diffuse', 'reflectance': {'type': 'bitmap', 'raw': True,
                      'bitmap': mi.Bitmap(np.random.default_rng(1).uniform(0.1, 0.9, (64, 64, 1)).astype('f4'))}}},
    'ball': {'type': 'sphere', 'center': [0.02 * m, 0, -0.02 * m], 'radius': 0.02 * m,
             'bsdf': {'type': 'roughplastic', 'alpha': 0.2}},
    'lamp': {'type': 'sphere', 'center': [0.03 * m, 0.03 * m, 0.05 * m], 'radius': 0.01 * m,
             'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': 20.0}}},
    'room': {'type': 'constant', 'radiance': {'type': 'rgb', 'value': 0.2}}"""
METAL = """,
    'metal': {'type': 'sphere', 'center': [-0.03 * m, -0.02 * m, 0], 'radius': 0.02 * m,
              'bsdf': {'type': 'roughconductor', 'alpha': 0.1}}"""
CLEAR = """,
    'glass': {'type': 'sphere', 'center': [-0.03 * m, 0.01 * m, 0], 'radius': 0.015 * m,
              'bsdf': {'type': 'dielectric'}},
    'sheet': {'type': 'rectangle', 'to_world': t.translate([0.03 * m, 0, -0.05 * m]).scale(0.03 * m),
              'bsdf': {'type': 'mask', 'opacity': 0.4, 'bsdf': {'type': 'twosided', 'bsdf': {'type': 'diffuse'}}}},
    'pane': {'type': 'rectangle', 'to_world': t.translate([-0.03 * m, 0, -0.06 * m]).scale(0.03 * m),
             'bsdf': {'type': 'thindielectric'}}"""
LAMP = WALL[WALL.index("    'lamp'") :]
SHAPES = {"walls": WALL, "metal": WALL + METAL, "clear": WALL + METAL + CLEAR, "bare": LAMP + METAL}
DRIVES = {"lens": None, "stage": Stage(0.025, 2.0, 1 / 19, (-0.08, 0.10))}  # whose paths have windows
EMITTING = ["lamp", "room"]


@pytest.fixture
def still_life(request, tmp_path, monkeypatch):
    shapes, drive = request.param
    text = f"{{{SHAPES[shapes]}}}"
    scene = write_scene(tmp_path, monkeypatch, lens=LENS, distance_m=0.5, shapes=text, light="lamp", target="lamp")
    card = scene.folder / "scene.yaml"
    card.write_text(card.read_text().replace("lights: {lamp: [lamp]}", "lights: {lamp: [lamp], room: [room]}"))
    scene = find_scene("made")
    return {name: load_setup(scene, (name,), drive=DRIVES[drive], max_depth=8) for name in scene.card.lights}


every_scene = pytest.mark.parametrize(
    "still_life",
    [("walls", "lens"), ("walls", "stage"), ("metal", "lens"), ("clear", "stage"), ("bare", "lens")],
    ids="-".join,
    indirect=True,
)


def render(setups, field, *, window, on_device, samples=4):
    how = {"positions": 33, "samples": samples, "seed": 2, "emitting": EMITTING}
    return filtered_pass.render_with_shading(setups, field, window=window, on_device=on_device, **how)


@pytest.mark.daily(2)
@every_scene
@pytest.mark.slow
def test_cells_stacks_and_slices_are_those_of_the_cores(still_life, monkeypatch):
    """Also in bands, the first of which sets the limit of radiance, and with sums in bands of rows on the device."""
    for rays, at_once in ((camera_rays.RAYS_PER_PASS, 1), (30_000, 1), (30_000, 3), (30_000, 50)):
        monkeypatch.setattr(camera_rays, "RAYS_PER_PASS", rays)
        monkeypatch.setattr(backend, "bands_at_once", lambda at_once=at_once: at_once)
        how = {"samples": 4, "seed": 1, "emitting": EMITTING}
        cells, same = (filtered_pass.gather_shading(still_life, on_device=where, **how) for where in (False, True))
        assert all(np.array_equal(*pair) for pair in zip(cells.content, same.content, strict=True))
        assert np.array_equal(cells.rays, same.rays)
        field = filtered_pass.estimate_shading([cells])
        for window in (None, (15, 17)):
            host = render(still_life, field, window=window, on_device=False)
            device = render(still_life, field, window=window, on_device=True)
            for name, (stack, clipped) in host.items():
                assert np.array_equal(stack, device[name][0]), (name, window, rays)
                assert clipped == device[name][1]
        monkeypatch.setattr(device_splat, "ACCUMULATOR_BYTES", 8 * 33 * 64 * 15)


def random_hits(random, count):
    """Hits in and beside the picture, on four shapes, one of them none; most of them near some cells."""
    fields = [random.uniform(-20, 40, (2, count)), random.normal(0, 2, (1, count)), random.random((3, count))]
    arrays = np.concatenate(fields).astype(np.float32)
    return SurfaceHits(random.integers(0, 4, count).astype(np.uint32), *arrays)


def test_shading_is_looked_up_as_on_the_cores():
    """100,000 rays among the cells of 20,000 paths: known cells, larger ones around them, and none."""
    backend.activate_backend(JIT)
    random = np.random.default_rng(8)
    cells, hits, rays = CellTable(2), random_hits(random, 20_000), random_hits(random, 100_000)
    cells.add(hits, random.random((2, 20_000), dtype=np.float32))
    field = cells.by_tile().estimate()
    on_cores = field.reflect(rays, first=(1 << 33) + 5, seed=1 << 40 | 77)
    there = SurfaceHits(mi.UInt32(rays.shape), *map(mi.Float, rays[1:]))
    on_device = DeviceField(field).reflect(there, first=(1 << 33) + 5, seed=1 << 40 | 77)
    assert np.array_equal(on_cores, [values.numpy() for values in on_device])
    assert 0.2 < (on_cores > 0).mean() < 0.74


@pytest.mark.parametrize("clear", [False, True])
@pytest.mark.parametrize(("windowed", "weighted"), [(False, False), (True, False), (False, True)])
def test_layers_are_those_of_the_cores(clear, windowed, weighted):
    """60,000 paths that end nowhere, at unknown, near, far and focused distances, behind sheets or none."""
    backend.activate_backend(JIT)
    random, shape, count = np.random.default_rng(3), (3, 20, 32), 60_000
    *line, _ = paths(5, count, shape)
    window = windows(8, count, shape) if windowed else ()
    weight = random.integers(0, 4, count).astype(np.uint32) if weighted else None
    radiance = random.random((2, count), dtype=np.float32)
    lens = random.uniform(-0.7, 0.7, (2, count)).astype(np.float32)
    end = random.uniform(0.3, 3, count).astype(np.float32)
    end[:3000], end[3000:6000], end[6000:9000] = 0, np.inf, 1.0
    nearest = random.uniform(0.3, 1, count).astype(np.float32)
    farthest = (nearest + random.random(count, dtype=np.float32)) * (random.random(count) < 0.7)
    nearest[farthest == 0] = np.inf
    sheets = (nearest, farthest.astype(np.float32)) if clear else (None, None)
    k = np.arange(shape[0])
    blur = BlurScale(90.0 + k, 1.0 + 0.1 * k, 0.01 * k)
    how = {"blur": blur, "scale": np.array([1.2345e6, 2e6]), "max_radiance": np.array([0.9, 2.0])}
    host, device = LayeredSums(shape, **how), DeviceLayeredSums(shape, **how)
    host.add(
        TracedPaths(*line, None, *window, weight=weight), radiance, lens=tuple(lens), distances=Distances(end, *sheets)
    )
    to = lambda array: None if array is None else mi.Float(array)  # noqa: E731
    there = TracedPaths(
        *map(mi.Float, line), None, *map(mi.Int32, window), weight=None if weight is None else mi.UInt32(weight)
    )
    device.add(
        there,
        [mi.Float(values) for values in radiance],
        lens=tuple(map(mi.Float, lens)),
        distances=Distances(*map(to, (end, *sheets))),
    )
    stack = host.mean_radiance()
    assert np.array_equal(stack, device.mean_radiance())
    for name in ("_sums", "_landed", "_unmoved"):
        assert np.array_equal(getattr(host, name).sum(axis=0), getattr(device, name)[0]), name
    assert (stack > 0).mean() > 0.9


@pytest.fixture
def copies(monkeypatch):
    """Copies to the host so far, by size in bytes: arrays as numpy arrays, and numbers that are read one by one."""
    backend.activate_backend(JIT)
    made = Counter()

    def watch(kind):
        real = kind.numpy

        def count(array):
            made[real(array).nbytes > 64] += 1
            return real(array)

        monkeypatch.setattr(kind, "numpy", count)

    for kind in (mi.Float, mi.UInt32, mi.Int32, mi.Int64, mi.Bool):
        watch(kind)
    return made


def launches_and_copies(copies, run):
    """Kernels that a second run launches, and arrays that it copies to the host."""
    run()
    copies.clear()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        run()
        kernels = len(dr.kernel_history([dr.KernelType.JIT]))
    return kernels, copies[True]


def per_band(monkeypatch, copies, run):
    """Launches and copies of each band of rows beyond the first four, by two runs with more bands."""
    found = []
    monkeypatch.setattr(backend, "bands_at_once", lambda: 1)
    for rays in (30_000, 5_000):
        bands = []
        monkeypatch.setattr(camera_rays, "RAYS_PER_PASS", rays)
        counted = launches_and_copies(copies, lambda bands=bands: run(bands.append))
        found.append((*counted, len(set(bands))))
    (few, fewer, low), (many, more, high) = found
    assert high >= low + 4
    return (many - few) / (high - low), (more - fewer) / (high - low), more


@pytest.mark.slow
@pytest.mark.parametrize("still_life", [("walls", "lens")], ids=["walls"], indirect=True)
def test_only_the_stack_comes_down(still_life, monkeypatch, copies):
    """Launches per band: the plain estimator traces and adds; the filtered one casts, looks up, lands, adds per light.

    The plain estimator traces each band again at one sample, for the limit of radiance; so does the filtered one.
    """
    setup = still_life["lamp"]

    def plain(progress):
        how = {"positions": 9, "samples": 16, "seed": 3, "on_device": True}
        one_pass.render_stack(setup, progress=progress, **how)

    launched, copied, in_all = per_band(monkeypatch, copies, plain)
    assert launched <= 3
    assert (copied, in_all) == (0, 1)
    how = {"samples": 4, "emitting": EMITTING}
    field = filtered_pass.estimate_shading([filtered_pass.gather_shading(still_life, seed=1, **how)])
    for window, at_most, arrays in ((None, 8, 2), ((15, 17), 7, 3)):

        def filtered(progress, window=window):
            how = {"positions": 33, "samples": 4, "seed": 2, "emitting": EMITTING, "on_device": True}
            filtered_pass.render_with_shading(still_life, field, window=window, progress=progress, **how)

        launched, copied, in_all = per_band(monkeypatch, copies, filtered)
        assert launched <= at_most, launched
        assert (copied, in_all) == (0, arrays)
