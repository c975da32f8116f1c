"""The splat on the device against that on the cores: the same bits for the same paths; here on LLVM."""

import re
from itertools import product

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from random_paths import paths, windows
from written_scenes import JIT, load_setup, needs_llvm

from saf_gen.optics import ImageDistanceDrive, Stage
from saf_gen.render import backend, device_splat, one_pass
from saf_gen.render.device_splat import DeviceAccumulator
from saf_gen.render.host_splat import HostAccumulator, TracedPaths
from saf_gen.scene.scene_folder import find_scene

SCALE, MAX_RADIANCE = 1.2345e9, 0.9  # no power of two, so that products round; a tenth of radiances 0...1 is clipped


@pytest.fixture
def llvm():
    backend.activate_backend(JIT)


def traced(arrays, window=(), weight=None):
    weights = None if weight is None else mi.UInt32(weight)
    return TracedPaths(*map(mi.Float, arrays), *map(mi.Int32, window), weight=weights)


def both(arrays, window, shape, weight=None):
    """Sums (row, col, focus) over all workers, stack and number of clipped paths, by the cores and by the device."""
    found = []
    for kind in (HostAccumulator, DeviceAccumulator):
        sums = kind(shape, (0, shape[1]), scale=SCALE, max_radiance=MAX_RADIANCE)
        clipped = sums.add(traced(arrays, window, weight))
        clipped = clipped if kind is HostAccumulator else clipped[0]
        total = sums.sums.sum(axis=0) if kind is HostAccumulator else sums.sums.numpy()
        found.append((total.reshape(*shape[1:], shape[0]), sums.mean_radiance(), clipped))
    return found


def assert_same(host, device):
    assert np.array_equal(host[0], device[0])
    assert np.array_equal(host[1], device[1])
    assert host[1].dtype == device[1].dtype == np.float32
    assert host[2] == device[2]


@needs_llvm
@pytest.mark.parametrize(("shape", "windowed"), [((17, 9, 13), True), ((2, 5, 4), False), ((513, 20, 30), True)])
def test_sums_stack_and_clipped_are_those_of_the_cores(llvm, shape, windowed):
    arrays = paths(5, 50_000, shape)
    host, device = both(arrays, windows(8, 50_000, shape) if windowed else (), shape)
    assert_same(host, device)
    assert 4000 < host[2] < 6000
    assert (host[1] > 0).mean() > 0.9


@needs_llvm
@pytest.mark.parametrize(("max_weight", "windowed"), [(0, False), (4, True), (1000, False)])
def test_weighted_paths_are_those_of_the_cores(llvm, windowed, max_weight):
    """Weights 0...max_weight: paths of weight 0 leave nothing, and are not counted as clipped."""
    shape = (17, 9, 13)
    arrays = paths(5, 20_000, shape)
    weight = np.random.default_rng(4).integers(0, max_weight + 1, 20_000).astype(np.uint32)
    host, device = both(arrays, windows(8, 20_000, shape) if windowed else (), shape, weight)
    assert_same(host, device)
    assert host[2] == np.count_nonzero((arrays[4] > np.float64(MAX_RADIANCE)) & (weight > 0))
    assert host[1].any() == (max_weight > 0)


@needs_llvm
@pytest.mark.parametrize("windowed", [False, True])
def test_paths_on_borders_and_corners_and_beyond_the_frame_are_those_of_the_cores(llvm, windowed):
    """All combinations of starts, steps and windows that may be treated differently: 146,410 paths.

    Paths go through corners, along borders, rest on a border, leave the frame and enter it; windows are empty, hold one
    position, or reach the last position and beyond it.
    """
    shape = (9, 4, 5)
    starts = (-2.0, -1.0, -0.5, -0.0, 0.0, 0.25, 1.0, 2.5, 3.999999, 4.0, 7.5)
    steps = (-8.0, -1.0, -0.5, -1e-7, -0.0, 0.0, 1e-7, 0.125, 0.3, 1.0, 8.0)
    spans = ((0, 9), (0, 0), (3, 3), (4, 5), (2, 9), (8, 9), (5, 12), (9, 9), (6, 2), (0, -1))
    lines = [(*line, *span) for *line, span in product(starts, starts, steps, steps, spans)]
    *line, begin, end = np.array(lines).T
    arrays = [a.astype(np.float32) for a in (*line, np.linspace(0, 1, len(lines)))]
    window = (begin.astype(np.int32), end.astype(np.int32)) if windowed else ()
    host, device = both(arrays, window, shape)
    assert_same(host, device)
    assert (host[1] > 0).all()


@pytest.mark.parametrize(("shape", "count"), [((129, 250, 400), 1), ((1025, 1000, 1000), 4), ((513, 1100, 1000), 3)])
def test_bands_cover_all_rows_once_and_fit(shape, count):
    bands = DeviceAccumulator.split_into_bands(shape)
    assert len(bands) == count
    assert [0, *(end for _, end in bands)] == [*(begin for begin, _ in bands), shape[1]]
    assert all(8 * shape[0] * shape[2] * (b - a) <= device_splat.ACCUMULATOR_BYTES for a, b in bands)


def test_a_band_has_a_row_at_least(monkeypatch):
    monkeypatch.setattr(device_splat, "ACCUMULATOR_BYTES", 8)
    assert DeviceAccumulator.split_into_bands((17, 3, 13)) == [(0, 1), (1, 2), (2, 3)]


@needs_llvm
@pytest.mark.skipif(JIT != "llvm", reason="LLVM's program is searched")
def test_there_is_nothing_that_a_compiler_may_fuse_or_divide_in_single_precision(llvm):
    """Operations that CUDA would round differently appear in any device's program, so LLVM's program is searched.

    There is no product and no quotient of float32, and no addition of float64, so that no product meets an addition
    before it is rounded.
    """
    shape = (17, 9, 13)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        sums = DeviceAccumulator(shape, (0, 9), scale=SCALE, max_radiance=MAX_RADIANCE)
        sums.add(traced(paths(5, 3000, shape), windows(8, 3000, shape)))
        sums.mean_radiance()
        programs = [kernel["ir"].getvalue() for kernel in dr.kernel_history([dr.KernelType.JIT])]
    program = "\n".join(programs)
    done = set(re.findall(r"= (f\w+) (?:<\d+ x )?(float|double)\b", program))
    assert {("fadd", "float"), ("fmul", "double"), ("fdiv", "double")} <= done
    assert not done & {("fmul", "float"), ("fdiv", "float"), ("fadd", "double"), ("fsub", "double")}
    assert "llvm.fma" not in program


DRIVES = {
    "image_distance": ImageDistanceDrive(0.025, 2.0, (0.60, 0.42)),
    "stage": Stage(0.025, 2.0, 1 / 19, (-0.08, 0.10)),  # its paths have windows
}


@needs_llvm
@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
def test_a_rendered_stack_is_that_of_the_cores(test_scenes, monkeypatch, drive):
    setup = load_setup(find_scene("plane"), drive=drive)
    options = {"positions": 9, "samples": 16, "seed": 3}
    host, clipped = one_pass.render_stack(setup, **options, on_device=False)
    device = one_pass.render_stack(setup, **options, on_device=True)
    assert np.array_equal(host, device[0])
    assert clipped == device[1]
    reported = []
    monkeypatch.setattr(device_splat, "ACCUMULATOR_BYTES", 8 * 9 * setup.grid.columns * 15)
    banded = one_pass.render_stack(setup, **options, on_device=True, progress=reported.append)
    assert np.array_equal(host, banded[0])
    assert clipped == banded[1]
    assert reported == sorted(reported)
    assert reported[-1] == 1.0
    assert len(reported) == 3


@needs_llvm
def test_the_cores_splat_what_they_traced_and_a_card_what_it_traced(llvm, monkeypatch):
    monkeypatch.setattr(dr, "backend_v", lambda _: dr.JitBackend.LLVM)
    assert one_pass.choose_accumulator(None) is HostAccumulator
    assert one_pass.choose_accumulator(True) is DeviceAccumulator
    monkeypatch.setattr(dr, "backend_v", lambda _: dr.JitBackend.CUDA)
    assert one_pass.choose_accumulator(None) is DeviceAccumulator
    assert one_pass.choose_accumulator(False) is HostAccumulator


@pytest.mark.gpu
@pytest.mark.skipif(not backend.probe_backends().cuda, reason="no NVIDIA card that Mitsuba can use")
@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
def test_a_card_makes_the_stack_that_cores_make_of_its_paths(test_scenes, drive):
    setup = load_setup(find_scene("plane"), name="cuda", drive=drive)
    options = {"positions": 129, "samples": 64, "seed": 3}
    host, device = (one_pass.render_stack(setup, **options, on_device=where) for where in (False, True))
    assert np.array_equal(host[0], device[0])
    assert host[1] == device[1]
