"""Shading estimated from paths: known shadings with known noise, and how well they are recovered."""

import numba as nb
import numpy as np
import pytest
from scipy.stats import binom

from saf_gen.render import shading_cells
from saf_gen.render.shading_cells import CellTable, ShadingCells, SurfaceHits
from saf_gen.render.shading_kernels import FINEST, LEVELS

COARSEST = FINEST * 2 ** (LEVELS - 1)  # pixels


def hits_at(column, row, *, shape=1, depth=0.5, u=0.55, v=0.55, reflectance=1.0):
    """Paths that meet a surface at these points; a single number holds for all of them."""
    fields = np.broadcast_arrays(shape, column, row, depth, u, v, reflectance)
    arrays = [np.ascontiguousarray(field, dtype=np.float32) for field in fields]
    return SurfaceHits(arrays[0].astype(np.uint32), *arrays[1:])


def scatter(random, side, per_pixel, **kind):
    """Random paths, evenly over a square of ``side`` pixels."""
    count = side * side * per_pixel
    return hits_at(random.uniform(0, side, count), random.uniform(0, side, count), **kind)


def middles(side):
    """One ray in the middle of each finest cell, row by row; a random offset keeps it in its cell."""
    middle = (np.arange(round(side / FINEST)) + 0.5) * FINEST
    row, column = (axis.ravel() for axis in np.meshgrid(middle, middle, indexing="ij"))
    return hits_at(column, row)


def gather(*traced, groups=1):
    """The field estimated from some (hits, radiance)."""
    cells = CellTable(groups)
    for hits, radiance in traced:
        cells.add(hits, np.atleast_2d(radiance).astype(np.float32))
    return cells.by_tile().estimate()


def reflect(field, hits, *, first=0, seed=1):
    return field.reflect(hits, first=first, seed=seed)


def cell_means(hits, radiance, side):
    """The mean of each finest cell, computed directly: (2·side · 2·side,); NaN in a cell without a path."""
    cells = round(side / FINEST)
    row, column = (np.minimum(np.int64(axis // FINEST), cells - 1) for axis in (hits.row, hits.column))
    index = row * cells + column
    count, total = np.bincount(index, minlength=cells**2), np.bincount(index, radiance, minlength=cells**2)
    with np.errstate(invalid="ignore"):
        return total / count


def noisy(random, truth, spread):
    """Radiance of paths with this mean: gamma-distributed, with a relative standard deviation of ``spread``."""
    shape = 1 / spread**2
    return (truth * random.gamma(shape, 1 / shape, truth.shape)).astype(np.float32)


def test_constant_shading_is_separated_from_any_texture():
    random = np.random.default_rng(1)
    traced, rays = (scatter(random, 40, n, reflectance=random.uniform(0.02, 0.9, 1600 * n)) for n in (6, 2))
    shading = np.array([[0.7], [3.0]])
    found = reflect(gather((traced, shading * traced.reflectance), groups=2), rays)
    assert found.dtype == np.float32
    assert found == pytest.approx(shading * rays.reflectance, rel=1e-5)


def test_nothing_is_known_of_other_shapes_or_of_places_far_away():
    random = np.random.default_rng(2)
    traced = scatter(random, 16, 4)
    field = gather((traced, np.ones(traced.shape.size)))
    assert reflect(field, traced) == pytest.approx(1.0, rel=1e-6)
    assert (reflect(field, traced._replace(shape=traced.shape + 1)) == 0).all()
    assert (reflect(field, traced._replace(column=traced.column + 2 * np.float32(COARSEST))) == 0).all()
    assert (reflect(field, traced._replace(shape=0 * traced.shape)) == 0).all()


def test_paths_without_a_shape_give_no_shading():
    random = np.random.default_rng(3)
    traced = scatter(random, 8, 4, shape=0)
    for field in (gather((traced, np.ones(traced.shape.size))), CellTable(1).by_tile().estimate()):
        assert (reflect(field, traced._replace(shape=traced.shape + 1)) == 0).all()


@pytest.mark.parametrize(
    "kinds",
    [
        [{"shape": 1}, {"shape": 2}],
        [{"depth": 0.5}, {"depth": 100.5}],
        [{"depth": -300.5}, {"depth": 0.5}],
        [{"u": 0.05}, {"u": 0.95}],
        [{"v": 0.30}, {"v": 0.45}],
    ],
)
def test_surfaces_in_the_same_pixels_do_not_mix(kinds):
    """Other shapes, depths (a leaf in front of a wall, both in one mesh) and normals (the sides of an edge)."""
    random = np.random.default_rng(4)
    surfaces = [scatter(random, 20, 8, **kind) for kind in kinds]
    field = gather(*((hits, np.full(hits.shape.size, e)) for hits, e in zip(surfaces, (0.25, 4.0), strict=True)))
    for hits, e in zip(surfaces, (0.25, 4.0), strict=True):
        assert reflect(field, hits) == pytest.approx(e, rel=1e-6)


@pytest.mark.slow
def test_portions_and_threads_change_no_bit(monkeypatch):
    """Of the paths of a stack, and of what its moments tell about the latest."""
    random = np.random.default_rng(5)
    hits = scatter(random, 48, 8, reflectance=random.uniform(0.1, 1, 48 * 48 * 8))
    radiance = noisy(random, np.stack([hits.reflectance, 2 * hits.reflectance]), 1.0)
    moments = [moment(random, SHADINGS["slope"], 48, 8) for _ in range(16)]

    def reflect_latest():
        return reflect(moments[-1].estimate(ShadingCells.merged(moments).estimate()), middles(48))

    expected, latest = reflect(gather((hits, radiance), groups=2), hits), reflect_latest()
    monkeypatch.setattr(shading_cells, "PATHS_AT_ONCE", 1000)
    parts = [slice(0, 1), slice(1, 5000), slice(5000, None)]
    traced = [(SurfaceHits(*(array[part] for array in hits)), radiance[:, part]) for part in parts]
    threads = nb.get_num_threads()
    try:
        nb.set_num_threads(1)
        assert np.array_equal(reflect(gather(*traced, groups=2), hits), expected)
        assert np.array_equal(reflect_latest(), latest)
    finally:
        nb.set_num_threads(threads)


def test_random_places_depend_on_number_and_seed_alone():
    random = np.random.default_rng(7)
    hits = scatter(random, 12, 16)
    field = gather((hits, hits.column // FINEST))
    found = reflect(field, hits)
    later = SurfaceHits(*(array[100:] for array in hits))
    assert np.array_equal(reflect(field, later, first=100), found[:, 100:])
    assert not np.array_equal(reflect(field, later, first=0), found[:, 100:])
    assert not np.array_equal(reflect(field, hits, seed=2), found)


@pytest.mark.parametrize("column", [0.5, 0.6, 0.75, 1.0])
def test_neighbouring_cells_blend(column):
    """Between the middles of two cells a ray takes the shading of the farther one with linear probability.

    Binomial, 20,000 rays, significance 1e-6.
    """
    random = np.random.default_rng(8)
    hits = scatter(random, 8, 64)
    field = gather((hits, np.float32(hits.column >= 0.5)))
    found = reflect(field, hits_at(np.full(20_000, column), 4.25))[0]
    bright = np.count_nonzero(found > 0.5)
    assert ((found > 0.98) | (found < 0.02)).all()
    probability = min(1.0, 0.5 + (column - 0.5) / FINEST)
    assert binom.ppf(5e-7, 20_000, probability) <= bright <= binom.ppf(1 - 5e-7, 20_000, probability)


def test_a_gap_takes_the_shading_around_it():
    random = np.random.default_rng(9)
    hits = scatter(random, 16, 16)
    known = ~((np.abs(hits.column - 6) < 1) & (np.abs(hits.row - 6) < 1))  # two pixels, to the borders of cells
    field = gather((SurfaceHits(*(array[known] for array in hits)), np.full(known.sum(), 0.3)))
    assert reflect(field, hits) == pytest.approx(0.3, rel=1e-6)


def test_more_cells_than_there_was_room_for(monkeypatch):
    """64 times as many: each path finds its cell again, in a table that is at most half full."""
    monkeypatch.setattr(shading_cells, "INITIAL_CELLS", 1 << 10)
    side, random = 128, np.random.default_rng(10)
    order = random.permutation((2 * side) ** 2)
    hits = SurfaceHits(*(array[order] for array in middles(side)))
    cells = CellTable(1)
    capacity = cells._keys.size
    # The largest cells differ. Without noise, and with one path in each smallest cell, the shading is theirs.
    radiance = np.float32(1 + hits.column // COARSEST + 100 * (hits.row // COARSEST))
    for part in np.array_split(np.arange(order.size), 7):
        cells.add(SurfaceHits(*(array[part] for array in hits)), radiance[None, part])
    assert cells.count == order.size == 64 * capacity
    assert 2 * cells.count <= cells._slots.size
    np.testing.assert_allclose(reflect(cells.by_tile().estimate(), hits), radiance[None], rtol=1e-6)


SHADINGS = {
    "even": lambda column, row: 1 + 0 * column,
    "edge of a shadow": lambda column, row: 1 + 3.0 * (column > 33.3),
    "faint edge": lambda column, row: 1 + 0.3 * (column > 33.5),
    "slope": lambda column, row: 1 + column / 32,
    "waves of 16 pixels": lambda column, row: 1 + 0.3 * np.sin(column * np.pi / 8),
    "waves of 4 pixels": lambda column, row: 1 + 0.8 * np.sin(column * np.pi / 2),
}


def errors_of(name, per_pixel, *, seed, side=64):
    """Mean squared errors over cells, of the means of single cells and of the estimate, for a known shading."""
    random = np.random.default_rng(seed)
    hits, rays = scatter(random, side, per_pixel, reflectance=1.0), middles(side)
    truth = SHADINGS[name](hits.column, hits.row)
    radiance = noisy(random, truth, 1.0)
    own, true = cell_means(hits, radiance, side), cell_means(hits, truth, side)
    known = ~np.isnan(own)
    found = reflect(gather((hits, radiance)), rays)[0]
    return np.mean((own - true)[known] ** 2), np.mean((found - true)[known] ** 2)


@pytest.mark.parametrize(("per_pixel", "bound"), [(4, 0.32), (64, 0.06)])
def test_an_even_light_is_shared(per_pixel, bound):
    """The variance for an evenly lit wall over that of single smallest cells; 16,384 cells, one seed.

    The largest cells by themselves would give 1/1024. Chance adds far more where a neighbourhood looks uneven, and must
    stay below the bound; 0.19 to 0.25 and 0.048 were measured.
    """
    own, found = errors_of("even", per_pixel, seed=11)
    assert found < bound * own


@pytest.mark.parametrize("name", SHADINGS)
def test_the_estimate_is_nearer_to_the_truth_than_the_cells_own_means(name):
    """Mean squared errors over 16,384 cells, one seed; 0.04 to 0.4 of that of the cells' means was measured.

    The standard error of the ratio is 2 %, so that chance cannot reach the bound.
    """
    own, found = errors_of(name, 16, seed=12)
    assert found < 0.6 * own


def test_where_nothing_is_alike_the_cells_keep_their_own_means():
    """For random shading from cell to cell, by twice the noise of a cell's mean, the estimate is no worse than means.

    16,384 cells, one seed, 5 % for chance (2 % is one standard error).
    """
    random, side = np.random.default_rng(13), 64
    rays = middles(side)
    shading = random.gamma(4, 0.25, rays.shape.size)
    hits = scatter(random, side, 64)
    cell = np.int64(hits.row // FINEST) * round(side / FINEST) + np.int64(hits.column // FINEST)
    truth = shading[np.minimum(cell, shading.size - 1)]
    radiance = noisy(random, truth, 1.0)
    own, true = cell_means(hits, radiance, side), cell_means(hits, truth, side)
    found = reflect(gather((hits, radiance)), rays)[0]
    assert np.mean((found - true) ** 2) < 1.05 * np.mean((own - true) ** 2)


def estimate_slowly(hits, radiance):
    """Both parts of the shading of the smallest cells, for one depth and normal, by (shape, row, column)."""
    paths = [{} for _ in range(LEVELS)]
    for shape, x, y, rho, value in zip(hits.shape, hits.column, hits.row, hits.reflectance, radiance, strict=True):
        for level, cells in enumerate(paths):
            width = FINEST * 2**level
            cells.setdefault((int(shape), int(y // width), int(x // width)), []).append((float(rho), float(value)))
    paths = [{key: np.array(traced).T for key, traced in cells.items()} for cells in paths]

    def weights(level, key, gloss):
        return (1 - gloss) * paths[level][key][0] + gloss

    def residual(key):
        rho, value = paths[0][key]
        return ((value - value.sum() / rho.sum() * rho) ** 2).sum(), rho.size - 1

    def parent(key, up):
        return key[0], key[1] >> up, key[2] >> up

    shading, gloss = {}, {}
    for level in reversed(range(LEVELS)):
        up = min(2, LEVELS - 1 - level)
        pools, larger, gloss = {}, shading, {key: gloss.get(parent(key, 1), 0.0) for key in paths[level]}
        weight = {key: weights(level, key, gloss[key]).sum() for key in paths[level]}
        own = {key: value.sum() / weight[key] for key, (_, value) in paths[level].items()}
        shading = dict(own) if level == LEVELS - 1 else {key: larger[parent(key, 1)] for key in paths[level]}
        for key in paths[level]:
            pools.setdefault(parent(key, up), []).append(key)
        for pool, keys in pools.items():
            inside = [key for key in paths[0] if parent(key, level + up) == pool]
            squares, freedom = np.sum([residual(key) for key in inside], axis=0)
            per_path = squares / max(freedom, 1)
            if level < LEVELS - 1:
                seconds = {key: (weights(level, key, gloss[key]) ** 2).sum() for key in keys}
                per_weight = per_path * sum(paths[level][key][0].size for key in keys) / sum(seconds.values())
                noise = {key: per_weight * seconds[key] / weight[key] ** 2 for key in keys}
                away = {key: own[key] - shading[key] for key in keys}
                excess = sum(weight[key] * (away[key] ** 2 - noise[key]) for key in keys)
                excess /= sum(weight[key] for key in keys)
                for key in keys:
                    shading[key] += away[key] * excess / (excess + noise[key]) if excess > 0 and freedom >= 1 else 0.0
            lines = {key: paths[level][key] for key in keys if key[0] % 2}  # glossy ones
            lines = {
                key: line for key, line in lines.items() if line[0].size * line[0].var() > 1e-6 * (line[0] ** 2).sum()
            }
            varied = {key: rho.size * rho.var() for key, (rho, _) in lines.items()}
            slope = {
                key: ((rho - rho.mean()) * value).sum() / varied[key] - shading[key] * (1 - gloss[key])
                for key, (rho, value) in lines.items()
            }
            excess = sum(varied[key] * slope[key] ** 2 - per_path for key in lines) / max(sum(varied.values()), 1e-30)
            for key, (rho, _) in lines.items() if excess > 0 and freedom >= 1 else ():
                matt, added = shading[key] * (1 - gloss[key]), shading[key] * gloss[key]
                change = slope[key] * excess / (excess + per_path / varied[key])
                change = np.clip(change, -matt, added / rho.mean())
                shading[key] = matt + change + added - change * rho.mean()
                gloss[key] = (added - change * rho.mean()) / shading[key] if shading[key] > 0 else 0.0
    members = {}
    for key in shading:
        members.setdefault(parent(key, LEVELS - 1), []).append(key)
    for largest, keys in members.items():
        reflected = sum(weights(0, key, gloss[key]).sum() * shading[key] for key in keys)
        for key in keys:
            shading[key] *= paths[LEVELS - 1][largest][1].sum() / reflected
    return {key: (shading[key] * (1 - gloss[key]), shading[key] * gloss[key]) for key in shading}


@pytest.mark.parametrize("chance", [0.002, 0.05])
def test_rare_bright_paths_are_not_lost(chance):
    """Few paths bring all light of an even wall: 4 paths in each smallest cell, 64 largest cells.

    Together the cells reflect what the paths brought. If they were weighted only by their noise, up to 80 % (with one
    bright path in 500) or 2 % (with one in 20) would be lost.
    """
    random = np.random.default_rng(22)
    grid = (np.arange(512) + 0.5) / 4
    hits = hits_at(*(axis.ravel() for axis in np.meshgrid(grid, grid)))
    radiance = np.float32((random.random(hits.shape.size) < chance) / chance)
    assert reflect(gather((hits, radiance)), middles(128)).mean() == pytest.approx(radiance.mean(), rel=1e-4)


@pytest.mark.slow
def test_the_estimate_is_that_of_its_slow_and_simple_way():
    """Two shapes over four tiles and beyond the corner of the picture; cells of one to forty paths."""
    random = np.random.default_rng(21)
    points = random.normal(6, 7, (2, 6000))
    shape = random.integers(1, 3, points.shape[1])
    hits = hits_at(*points, shape=shape, reflectance=random.uniform(0.1, 0.9, points.shape[1]))
    radiance = noisy(random, hits.reflectance * np.where(hits.column > 5, 1.0, 4.0), 1.0)
    slow = estimate_slowly(hits, radiance)
    middle = np.array([[column + 0.5, row + 0.5] for _, row, column in slow]).T * FINEST
    assert middle.min() < -10
    assert middle.max() > 20
    rays = hits_at(*middle, shape=np.array([shape for shape, _, _ in slow]))
    field, (matt, gloss) = gather((hits, radiance)), np.array(list(slow.values())).T
    for rho in (0.0, 0.3, 1.0):
        found = reflect(field, rays._replace(reflectance=np.full(gloss.size, rho, np.float32)))[0]
        assert found == pytest.approx(matt * rho + gloss, rel=1e-5, abs=1e-6)
    assert 0.1 < (gloss > 0).mean() < 0.9


@pytest.mark.parametrize(("noise", "bound"), [(0.0, 1e-5), (0.5, 0.4)])
def test_gloss_is_separated_from_the_texture_under_it(noise, bound):
    """A gloss of 0.5 over a texture lit by 2, 16 paths per pixel, against shading that is multiplied by the texture.

    That is 1.4/m times ρ, with the mean m = 0.45 of ρ, and has the mean squared error 0.25·mean(1 - ρ/m)². One seed;
    8e-8 of it was measured without noise, and 0.2 if a path scatters by half its mean.
    """
    random, side = np.random.default_rng(22), 48
    hits = scatter(random, side, 16, reflectance=random.uniform(0.05, 0.85, side * side * 16), shape=1)
    radiance = 2 * hits.reflectance + 0.5
    traced = noisy(random, radiance, noise) if noise else radiance
    found = reflect(gather((hits, traced)), hits)[0]
    multiplied = 0.25 * np.mean((1 - hits.reflectance / 0.45) ** 2)
    assert np.mean((found - radiance) ** 2) < bound * multiplied


def test_a_matt_surface_has_no_gloss():
    random = np.random.default_rng(23)
    hits = scatter(random, 32, 16, reflectance=random.uniform(0.05, 0.85, 32 * 32 * 16), shape=2)
    matt = gather((hits, noisy(random, hits.reflectance, 1.0)))
    assert (matt.shading[..., 0] > 0).any()
    assert not matt.shading[..., 1].any()


@pytest.mark.filterwarnings("error")
def test_what_is_black_reflects_nothing():
    random = np.random.default_rng(14)
    black = scatter(random, 8, 16, reflectance=0.0)
    assert (reflect(gather((black, np.zeros(black.shape.size))), black) == 0).all()
    mixed = scatter(random, 8, 16, reflectance=np.where(random.random(8 * 8 * 16) < 0.5, 0.0, 0.5))
    field = gather((mixed, 2 * mixed.reflectance))
    assert (reflect(field, black) == 0).all()
    assert reflect(field, mixed) == pytest.approx(2 * mixed.reflectance[None], rel=1e-6)


@pytest.mark.filterwarnings("error")
def test_every_estimate_is_finite_and_none_is_negative_without_cause():
    """Rare bright paths, cells with one path, black cells, and radiance from 1e-12 to 1e12."""
    random = np.random.default_rng(15)
    hits = scatter(random, 32, 4)
    hits = hits._replace(reflectance=np.float32(random.choice([0.0, 1e-6, 0.01, 0.9], hits.shape.size)))
    radiance = hits.reflectance * random.choice([0.0, 1e-12, 1.0, 1e12], hits.shape.size)
    found = reflect(gather((hits, radiance)), hits)
    assert np.isfinite(found).all()
    assert (found >= 0).all()


def moment(random, shading, side, per_pixel):
    """The cells of one moment's paths, whose noise equals their mean; ``shading`` is a function of columns and rows."""
    hits = scatter(random, side, per_pixel)
    cells = CellTable(1)
    cells.add(hits, noisy(random, shading(hits.column, hits.row), 1.0)[None])
    return cells.by_tile()


def test_moments_together_are_their_paths_together():
    random = np.random.default_rng(16)
    moments = [moment(random, SHADINGS["slope"], 16, 8) for _ in range(16)]
    assert ShadingCells.merged(moments[:1]) is moments[0]
    rays, together, one_by_one = middles(16), ShadingCells.merged(moments), CellTable(1)
    random = np.random.default_rng(16)
    for _ in moments:
        hits = scatter(random, 16, 8)
        one_by_one.add(hits, noisy(random, SHADINGS["slope"](hits.column, hits.row), 1.0)[None])
    assert together.keys.size == one_by_one.count
    expected = reflect(one_by_one.by_tile().estimate(), rays)
    assert reflect(together.estimate(), rays) == pytest.approx(expected, rel=1e-6)


def test_a_moment_like_those_before_takes_their_shading():
    """Sixteen moments of 4 paths per pixel: the latest adds at most a tenth to the error of all together; one seed."""
    random, side = np.random.default_rng(17), 64
    moments = [moment(random, SHADINGS["slope"], side, 4) for _ in range(16)]
    together, rays = ShadingCells.merged(moments).estimate(), middles(side)
    truth = SHADINGS["slope"](rays.column, rays.row)
    before, now = (
        np.mean((reflect(field, rays)[0] - truth) ** 2) for field in (together, moments[-1].estimate(together))
    )
    assert now < 1.1 * before


def test_the_latest_moment_reveals_a_change():
    """A shadow of 32 pixels disappears in the last of sixteen moments: at most a sixth of its depth remains.

    With all moments weighted equally 15/16 would remain. One seed; means of 1,024 pixels scatter by 1 %.
    """
    random, side = np.random.default_rng(18), 64
    moments = [moment(random, lambda x, y: np.where(x < 32, 0.25, 1.0), side, 4) for _ in range(15)]
    moments.append(moment(random, lambda x, y: 1 + 0 * x, side, 4))
    together, rays = ShadingCells.merged(moments).estimate(), middles(side)
    inner = (np.abs(rays.column - 16) < 12) & (np.abs(rays.row - 32) < 28)
    stale, now = (reflect(field, rays)[0][inner].mean() for field in (together, moments[-1].estimate(together)))
    assert stale == pytest.approx(0.25 + 0.75 / 16, abs=0.03)
    assert now > 1 - 0.75 / 6
