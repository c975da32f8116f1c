"""The splat by runs of pixels, against adding each path at each position."""

import numpy as np
import pytest
from random_paths import paths, windows

from saf_gen.render import host_splat
from saf_gen.render.host_splat import TracedPaths


def splat(sums, *arguments):
    *path, scale, max_radiance = arguments[:7]
    return host_splat.splat_paths(sums, TracedPaths(*path, *arguments[7:]), scale=scale, max_radiance=max_radiance)


def one_by_one(first_x, first_y, step_x, step_y, value, shape, begin=None, end=None):
    """A slow reference: sums and counts of the values that fall into each pixel at each position."""
    focus, rows, columns = shape
    begin = np.zeros(len(value), dtype=int) if begin is None else begin
    end = np.full(len(value), focus) if end is None else end
    total, count = np.zeros(shape), np.zeros(shape, dtype=int)
    for x, y, dx, dy, v, b, e in zip(first_x, first_y, step_x, step_y, value, begin, end, strict=True):
        for k in range(b, min(e, focus)):
            column, row = int(np.floor(x + k * dx)), int(np.floor(y + k * dy))
            if 0 <= row < rows and 0 <= column < columns:
                total[k, row, column] += v
                count[k, row, column] += 1
    return total, count


@pytest.mark.parametrize(("shape", "windowed"), [((17, 9, 13), True), ((2, 5, 4), False), ((64, 6, 6), False)])
def test_the_stack_is_that_of_adding_paths_one_by_one(shape, windowed):
    arrays = paths(5, 3000, shape)
    window = windows(8, 3000, shape) if windowed else ()
    sums = host_splat.allocate_sums(2, shape)
    assert splat(sums, *arrays, 2.0**30, 1e9, *window) == 0
    total, count = one_by_one(*arrays, shape, *window)
    seen = count > 0
    # with the reference's order of rounding, float32 points may fall on the other side of a pixel's border
    agree = np.isclose(host_splat.mean_radiance_of(sums, 2.0**30)[seen], (total[seen] / count[seen]), atol=1e-5)
    assert agree.mean() > 0.9995


def test_the_number_of_workers_changes_no_bit():
    shape = (17, 9, 13)
    arrays = paths(6, 5000, shape)
    stacks = []
    for workers in (1, 2, 5):
        sums = host_splat.allocate_sums(workers, shape)
        splat(sums, *arrays, 2.0**30, 1e9)
        stacks.append(host_splat.mean_radiance_of(sums, 2.0**30))
    assert np.array_equal(stacks[0], stacks[1])
    assert np.array_equal(stacks[0], stacks[2])


def test_fireflies_are_clipped_and_counted():
    one = np.ones(3, dtype=np.float32)
    sums = host_splat.allocate_sums(1, (2, 3, 3))
    value = np.array([1, 2, 500], dtype=np.float32)
    assert splat(sums, 1.5 * one, 1.5 * one, 0 * one, 0 * one, value, 2.0**20, 100.0) == 1
    assert host_splat.mean_radiance_of(sums, 2.0**20)[0, 1, 1] == pytest.approx((1 + 2 + 100) / 3)


@pytest.mark.parametrize("windowed", [False, True])
def test_a_weight_counts_a_path_as_often(windowed):
    """The sums are those of paths repeated by their weights, bit for bit; each clipped path is counted once."""
    shape, count = (17, 9, 13), 5000
    arrays = [*paths(7, count, shape)]
    window = windows(9, count, shape) if windowed else (None, None)
    weight = np.random.default_rng(3).integers(0, 5, count).astype(np.uint32)
    often = np.repeat(np.arange(count), weight)
    weighted, one_by_one = (host_splat.allocate_sums(2, shape) for _ in range(2))
    clipped = splat(weighted, *arrays, 2.0**30, 0.9, *window, weight)
    repeated = [None if array is None else array[often] for array in (*arrays, *window)]
    splat(one_by_one, *repeated[:5], 2.0**30, 0.9, *repeated[5:])
    assert np.array_equal(weighted.sum(axis=0), one_by_one.sum(axis=0))
    assert clipped == np.count_nonzero((arrays[4] > 0.9) & (weight > 0)) > 100


def test_stacks_that_share_the_memory_have_fewer_workers():
    shape = (129, 250, 400)
    workers = host_splat.ACCUMULATOR_BYTES // (8 * 129 * 250 * 400)
    assert len(host_splat.allocate_sums(64, shape)) == workers
    assert len(host_splat.allocate_sums(64, shape, stacks=3)) == workers // 3
    assert len(host_splat.allocate_sums(64, shape, stacks=1000)) == 1
