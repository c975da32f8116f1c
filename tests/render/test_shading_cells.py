"""Shading gathered from paths: planted shadings and planted noise, and what is found of them."""

import numba as nb
import numpy as np
import pytest
from scipy.stats import binom

from saf_gen.render import shading_cells
from saf_gen.render.shading_cells import CellTable, ShadingCells, SurfaceHits
from saf_gen.render.shading_kernels import FINEST, LEVELS

COARSEST = FINEST * 2 ** (LEVELS - 1)  # pixels


def hits_at(column, row, *, shape=1, depth=0.5, u=0.55, v=0.55, reflectance=1.0):
    """Paths that meet a surface there; what is one number is the same for all."""
    fields = np.broadcast_arrays(shape, column, row, depth, u, v, reflectance)
    arrays = [np.ascontiguousarray(field, dtype=np.float32) for field in fields]
    return SurfaceHits(arrays[0].astype(np.uint32), *arrays[1:])


def scatter(random, side, per_pixel, **kind):
    """Paths evenly at random over a square of ``side`` pixels."""
    count = side * side * per_pixel
    return hits_at(random.uniform(0, side, count), random.uniform(0, side, count), **kind)


def middles(side):
    """One ray in the middle of each finest cell, row by row; moved at random, it stays in its cell."""
    middle = (np.arange(round(side / FINEST)) + 0.5) * FINEST
    row, column = (axis.ravel() for axis in np.meshgrid(middle, middle, indexing="ij"))
    return hits_at(column, row)


def gather(*told, groups=1):
    """The field that some (hits, radiance) tell."""
    cells = CellTable(groups)
    for hits, radiance in told:
        cells.add(hits, np.atleast_2d(radiance).astype(np.float32))
    return cells.by_tile().estimate()


def reflect(field, hits, *, first=0, seed=1):
    return field.reflect(hits, first=first, seed=seed)


def cell_means(hits, radiance, side):
    """Each finest cell's own mean, the slow and simple way: (2·side · 2·side,); NaN in a cell without a path."""
    cells = round(side / FINEST)
    row, column = (np.minimum(np.int64(place // FINEST), cells - 1) for place in (hits.row, hits.column))
    index = row * cells + column
    count, total = np.bincount(index, minlength=cells**2), np.bincount(index, radiance, minlength=cells**2)
    with np.errstate(invalid="ignore"):
        return total / count


def noisy(random, truth, spread):
    """Radiance of paths of this mean: gamma-distributed, relative standard deviation ``spread``, never below 0."""
    shape = 1 / spread**2
    return (truth * random.gamma(shape, 1 / shape, truth.shape)).astype(np.float32)


def test_constant_shading_is_told_apart_from_any_texture():
    random = np.random.default_rng(1)
    told, asked = (scatter(random, 40, n, reflectance=random.uniform(0.02, 0.9, 1600 * n)) for n in (6, 2))
    shading = np.array([[0.7], [3.0]])
    found = reflect(gather((told, shading * told.reflectance), groups=2), asked)
    assert found.dtype == np.float32
    assert found == pytest.approx(shading * asked.reflectance, rel=1e-5)


def test_nothing_is_known_of_other_shapes_or_of_places_far_away():
    random = np.random.default_rng(2)
    told = scatter(random, 16, 4)
    field = gather((told, np.ones(told.shape.size)))
    assert reflect(field, told) == pytest.approx(1.0, rel=1e-6)
    assert (reflect(field, told._replace(shape=told.shape + 1)) == 0).all()
    assert (reflect(field, told._replace(column=told.column + 2 * np.float32(COARSEST))) == 0).all()
    assert (reflect(field, told._replace(shape=0 * told.shape)) == 0).all()


def test_paths_that_share_nothing_tell_nothing():
    random = np.random.default_rng(3)
    told = scatter(random, 8, 4, shape=0)
    for field in (gather((told, np.ones(told.shape.size))), CellTable(1).by_tile().estimate()):
        assert (reflect(field, told._replace(shape=told.shape + 1)) == 0).all()


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
    """Other shapes, depths (a leaf before a wall, both of one mesh) and normals (the sides of an edge)."""
    random = np.random.default_rng(4)
    surfaces = [scatter(random, 20, 8, **kind) for kind in kinds]
    field = gather(*((hits, np.full(hits.shape.size, e)) for hits, e in zip(surfaces, (0.25, 4.0), strict=True)))
    for hits, e in zip(surfaces, (0.25, 4.0), strict=True):
        assert reflect(field, hits) == pytest.approx(e, rel=1e-6)


def test_portions_and_threads_change_no_bit(monkeypatch):
    random = np.random.default_rng(5)
    hits = scatter(random, 48, 8, reflectance=random.uniform(0.1, 1, 48 * 48 * 8))
    radiance = noisy(random, np.stack([hits.reflectance, 2 * hits.reflectance]), 1.0)
    whole = reflect(gather((hits, radiance), groups=2), hits)
    monkeypatch.setattr(shading_cells, "PATHS_AT_ONCE", 1000)
    parts = [slice(0, 1), slice(1, 5000), slice(5000, None)]
    told = [(SurfaceHits(*(array[part] for array in hits)), radiance[:, part]) for part in parts]
    threads = nb.get_num_threads()
    try:
        nb.set_num_threads(1)
        assert np.array_equal(reflect(gather(*told, groups=2), hits), whole)
    finally:
        nb.set_num_threads(threads)


def test_the_order_of_paths_changes_only_how_sums_round():
    random = np.random.default_rng(6)
    hits = scatter(random, 24, 8)
    radiance, order = noisy(random, np.ones(hits.shape.size), 1.0), random.permutation(hits.shape.size)
    shuffled = SurfaceHits(*(array[order] for array in hits))
    one, other = gather((hits, radiance)), gather((shuffled, radiance[order]))
    assert reflect(one, hits) == pytest.approx(reflect(other, hits), rel=1e-6)


def test_random_places_depend_on_number_and_seed_alone():
    random = np.random.default_rng(7)
    hits = scatter(random, 12, 16)
    field = gather((hits, hits.column // FINEST))
    whole = reflect(field, hits)
    later = SurfaceHits(*(array[100:] for array in hits))
    assert np.array_equal(reflect(field, later, first=100), whole[:, 100:])
    assert not np.array_equal(reflect(field, later, first=0), whole[:, 100:])
    assert not np.array_equal(reflect(field, hits, seed=2), whole)


@pytest.mark.parametrize("place", [0.5, 0.6, 0.75, 1.0])
def test_neighbouring_cells_blend(place):
    """A ray between the middles of two cells takes the farther one's shading as often as it lies that near to it.

    Binomial, 20,000 rays, significance 1e-6.
    """
    random = np.random.default_rng(8)
    hits = scatter(random, 8, 64)
    field = gather((hits, np.float32(hits.column >= 0.5)))
    found = reflect(field, hits_at(np.full(20_000, place), 4.25))[0]
    bright = np.count_nonzero(found > 0.5)
    assert ((found > 0.98) | (found < 0.02)).all()
    share = min(1.0, 0.5 + (place - 0.5) / FINEST)
    assert binom.ppf(5e-7, 20_000, share) <= bright <= binom.ppf(1 - 5e-7, 20_000, share)


def test_a_gap_takes_the_shading_around_it():
    random = np.random.default_rng(9)
    hits = scatter(random, 16, 16)
    known = ~((np.abs(hits.column - 6) < 1) & (np.abs(hits.row - 6) < 1))  # two pixels, to the borders of cells
    field = gather((SurfaceHits(*(array[known] for array in hits)), np.full(known.sum(), 0.3)))
    assert reflect(field, hits) == pytest.approx(0.3, rel=1e-6)


def test_more_cells_than_there_was_room_for(monkeypatch):
    """64 times as many: each path finds its own again, in a table that is at most half full."""
    monkeypatch.setattr(shading_cells, "ROOM", 1 << 10)
    side, random = 128, np.random.default_rng(10)
    order = random.permutation((2 * side) ** 2)
    hits = SurfaceHits(*(array[order] for array in middles(side)))
    cells = CellTable(1)
    capacity = cells._keys.size
    # The largest cells differ. Without noise in any, and with one path in each of the smallest, theirs is the shading.
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


def errors_of(name, per_pixel, *, seed, spread=1.0, side=64):
    """Squared errors of a planted shading, of the cells' own means and of the estimate: their means over cells."""
    random = np.random.default_rng(seed)
    hits, asked = scatter(random, side, per_pixel, reflectance=1.0), middles(side)
    truth = SHADINGS[name](hits.column, hits.row)
    radiance = noisy(random, truth, spread)
    own, true = cell_means(hits, radiance, side), cell_means(hits, truth, side)
    known = ~np.isnan(own)
    found = reflect(gather((hits, radiance)), asked)[0]
    return np.mean((own - true)[known] ** 2), np.mean((found - true)[known] ** 2)


@pytest.mark.parametrize("spread", [0.5, 1.0])
@pytest.mark.parametrize(("per_pixel", "bound"), [(4, 0.32), (16, 0.08), (64, 0.06)])
def test_an_even_light_is_shared(per_pixel, bound, spread):
    """Variance of an evenly lit wall over that of the smallest cells, 16,384 of them; one seed.

    The largest cells alone would give 1/1024. What chance adds where a neighbourhood looks uneven is far more, and must
    stay below the bound; measured 0.19 to 0.25, 0.046 to 0.054 and 0.048.
    """
    own, found = errors_of("even", per_pixel, seed=11, spread=spread)
    assert found < bound * own


@pytest.mark.parametrize("name", SHADINGS)
@pytest.mark.parametrize("per_pixel", [4, 16, 64])
def test_the_estimate_is_nearer_to_the_truth_than_the_cells_own_means(name, per_pixel):
    """Mean squared errors over 16,384 cells, one seed; measured 0.04 to 0.4 of that of the cells' own means.

    The ratio's own standard error is 2 %, so that the bound is out of the reach of chance.
    """
    own, found = errors_of(name, per_pixel, seed=12)
    assert found < 0.6 * own


def test_where_nothing_is_alike_the_cells_keep_their_own_means():
    """Shading that differs at random from cell to cell, by twice the noise of a cell's own mean: no worse than these.

    16,384 cells, one seed, 5 % for chance (2 % is one standard error).
    """
    random, side = np.random.default_rng(13), 64
    asked = middles(side)
    shading = random.gamma(4, 0.25, asked.shape.size)
    hits = scatter(random, side, 64)
    place = np.int64(hits.row // FINEST) * round(side / FINEST) + np.int64(hits.column // FINEST)
    truth = shading[np.minimum(place, shading.size - 1)]
    radiance = noisy(random, truth, 1.0)
    own, true = cell_means(hits, radiance, side), cell_means(hits, truth, side)
    found = reflect(gather((hits, radiance)), asked)[0]
    assert np.mean((found - true) ** 2) < 1.05 * np.mean((own - true) ** 2)


def test_more_paths_bring_the_edge_of_a_shadow_nearer():
    """Bias along the columns beside an edge from 1 to 4, the mean over 128 rows and four seeds, over the step.

    In the smallest cells that lie a pixel and more away from the edge it is below the first bound and falls as paths
    grow; from four pixels on it is below the second. Were 16 pixels to share one shading it would be a half.
    Measured at most 0.23, 0.061 and 0.008, and 0.035, 0.014 and 0.006.
    """
    side, worst = 64, []
    for per_pixel, near, far in ((16, 0.4, 0.06), (64, 0.12, 0.03), (256, 0.03, 0.015)):
        profile = np.zeros(2 * side)
        for seed in range(4):
            random = np.random.default_rng(20 + seed)
            hits = scatter(random, side, per_pixel)
            radiance = noisy(random, SHADINGS["edge of a shadow"](hits.column, hits.row), 1.0)
            profile += reflect(gather((hits, radiance)), middles(side))[0].reshape(2 * side, -1).mean(axis=0) / 4
        column = (np.arange(2 * side) + 0.5) * FINEST
        away = np.abs(column - 33.3)
        bias = np.abs(profile - SHADINGS["edge of a shadow"](column, 0 * column)) / 3
        worst.append(bias[away >= 1].max())
        assert worst[-1] < near
        assert bias[away >= 4].max() < far
    assert worst[0] > worst[1] > worst[2]


def estimate_slowly(hits, radiance):
    """Both parts of the shading of the smallest cells of even depth and normal, by (shape, row, column)."""
    paths = [{} for _ in range(LEVELS)]
    for shape, x, y, rho, value in zip(hits.shape, hits.column, hits.row, hits.reflectance, radiance, strict=True):
        for level, cells in enumerate(paths):
            width = FINEST * 2**level
            cells.setdefault((int(shape), int(y // width), int(x // width)), []).append((float(rho), float(value)))
    paths = [{key: np.array(told).T for key, told in cells.items()} for cells in paths]

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
    whole = {}
    for key in shading:
        whole.setdefault(parent(key, LEVELS - 1), []).append(key)
    for largest, keys in whole.items():
        reflected = sum(weights(0, key, gloss[key]).sum() * shading[key] for key in keys)
        for key in keys:
            shading[key] *= paths[LEVELS - 1][largest][1].sum() / reflected
    return {key: (shading[key] * (1 - gloss[key]), shading[key] * gloss[key]) for key in shading}


@pytest.mark.parametrize("chance", [0.002, 0.05])
def test_rare_bright_paths_are_not_lost(chance):
    """Few paths bring all light of an even wall: 4 paths in each smallest cell, 64 largest cells.

    Together the cells reflect what the paths brought. Were they weighed by their noise alone, as much as 80 % (of one
    bright path in 500) and 2 % (of one in 20) would be lost.
    """
    random = np.random.default_rng(22)
    place = (np.arange(512) + 0.5) / 4
    hits = hits_at(*(grid.ravel() for grid in np.meshgrid(place, place)))
    radiance = np.float32((random.random(hits.shape.size) < chance) / chance)
    assert reflect(gather((hits, radiance)), middles(128)).mean() == pytest.approx(radiance.mean(), rel=1e-4)


@pytest.mark.slow
def test_the_estimate_is_that_of_its_slow_and_simple_way():
    """Two shapes that lie over four tiles and beyond the picture's corner; cells of one path up to forty."""
    random = np.random.default_rng(21)
    place = random.normal(6, 7, (2, 6000))
    shape = random.integers(1, 3, place.shape[1])
    hits = hits_at(*place, shape=shape, reflectance=random.uniform(0.1, 0.9, place.shape[1]))
    radiance = noisy(random, hits.reflectance * np.where(hits.column > 5, 1.0, 4.0), 1.0)
    slow = estimate_slowly(hits, radiance)
    middle = np.array([[column + 0.5, row + 0.5] for _, row, column in slow]).T * FINEST
    assert middle.min() < -10
    assert middle.max() > 20
    asked = hits_at(*middle, shape=np.array([shape for shape, _, _ in slow]))
    field, (matt, gloss) = gather((hits, radiance)), np.array(list(slow.values())).T
    for rho in (0.0, 0.3, 1.0):
        found = reflect(field, asked._replace(reflectance=np.full(gloss.size, rho, np.float32)))[0]
        assert found == pytest.approx(matt * rho + gloss, rel=1e-5, abs=1e-6)
    assert 0.1 < (gloss > 0).mean() < 0.9


@pytest.mark.parametrize(("noise", "bound"), [(0.0, 1e-5), (0.5, 0.4)])
def test_gloss_is_told_from_the_texture_under_it(noise, bound):
    """A gloss of 0.5 over a texture lit by 2, 16 paths a pixel: against shading that the texture multiplies, all of it.

    That is 1.4/m times ρ, m = 0.45 the mean of ρ, and has the mean squared error 0.25·mean(1 - ρ/m)². One seed;
    measured 8e-8 of it without noise, and 0.2 where a path scatters by half its mean.
    """
    random, side = np.random.default_rng(22), 48
    hits = scatter(random, side, 16, reflectance=random.uniform(0.05, 0.85, side * side * 16), shape=1)
    radiance = 2 * hits.reflectance + 0.5
    told = noisy(random, radiance, noise) if noise else radiance
    found = reflect(gather((hits, told)), hits)[0]
    multiplied = 0.25 * np.mean((1 - hits.reflectance / 0.45) ** 2)
    assert np.mean((found - radiance) ** 2) < bound * multiplied


def test_a_matt_surface_has_no_gloss():
    random = np.random.default_rng(23)
    hits = scatter(random, 32, 16, reflectance=random.uniform(0.05, 0.85, 32 * 32 * 16), shape=2)
    matt = gather((hits, noisy(random, hits.reflectance, 1.0)))
    assert (matt.shading[..., 0] > 0).any()
    assert not matt.shading[..., 1].any()


def test_a_highlight_is_as_bright_on_both_sides_of_an_edge():
    """Dark glass beside paint ten times as bright, under one highlight of eight pixels; no noise, 36 paths a pixel.

    Were the highlight multiplied by what is under it, as it is on a matt surface, it would jump tenfold at the edge.
    Mean squared error with gloss over that without; measured 0.48, most of it from cells on the edge.
    """
    random, side = np.random.default_rng(24), 32
    place = scatter(random, side, 36)
    rho = np.where(place.column < 16.2, 0.05, 0.5).astype(np.float32)
    highlight = 10 * np.exp(-((place.column - 16.2) ** 2 + (place.row - 16) ** 2) / 128)
    errors = []
    for shape in (1, 2):
        hits = place._replace(reflectance=rho, shape=np.full(rho.size, shape, np.uint32))
        found = reflect(gather((hits, rho + highlight)), hits)[0]
        errors.append(np.mean((found - rho - highlight) ** 2))
    assert errors[0] < 0.7 * errors[1]


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
@pytest.mark.parametrize("per_pixel", [1, 4, 40])
def test_every_estimate_is_finite_and_none_is_negative_without_cause(per_pixel):
    """Rare paths that bring very much, cells with one path, black cells, radiance from 1e-12 to 1e12."""
    random = np.random.default_rng(15)
    hits = scatter(random, 32, per_pixel)
    hits = hits._replace(reflectance=np.float32(random.choice([0.0, 1e-6, 0.01, 0.9], hits.shape.size)))
    radiance = hits.reflectance * random.choice([0.0, 1e-12, 1.0, 1e12], hits.shape.size)
    found = reflect(gather((hits, radiance)), hits)
    assert np.isfinite(found).all()
    assert (found >= 0).all()


def moment(random, shading, side, per_pixel):
    """Cells that the paths of one moment tell, of the noise of a whole path; ``shading`` of columns and rows."""
    hits = scatter(random, side, per_pixel)
    cells = CellTable(1)
    cells.add(hits, noisy(random, shading(hits.column, hits.row), 1.0)[None])
    return cells.by_tile()


def test_moments_together_are_their_paths_together():
    random = np.random.default_rng(16)
    moments = [moment(random, SHADINGS["slope"], 16, 8) for _ in range(16)]
    assert ShadingCells.merged(moments[:1]) is moments[0]
    asked, together, one_by_one = middles(16), ShadingCells.merged(moments), CellTable(1)
    random = np.random.default_rng(16)
    for _ in moments:
        hits = scatter(random, 16, 8)
        one_by_one.add(hits, noisy(random, SHADINGS["slope"](hits.column, hits.row), 1.0)[None])
    assert together.keys.size == one_by_one.count
    expected = reflect(one_by_one.by_tile().estimate(), asked)
    assert reflect(together.estimate(), asked) == pytest.approx(expected, rel=1e-6)


def test_cores_change_no_bit_of_what_moments_tell():
    def tell():
        random = np.random.default_rng(19)
        moments = [moment(random, SHADINGS["slope"], 48, 8) for _ in range(16)]
        together = ShadingCells.merged(moments)
        return reflect(moments[-1].estimate(together.estimate()), middles(48))

    threads, whole = nb.get_num_threads(), tell()
    try:
        nb.set_num_threads(1)
        assert np.array_equal(tell(), whole)
    finally:
        nb.set_num_threads(threads)


def test_a_moment_like_those_before_takes_their_shading():
    """Sixteen moments of 4 paths a pixel: the latest adds at most a tenth to the error of all together; one seed."""
    random, side = np.random.default_rng(17), 64
    moments = [moment(random, SHADINGS["slope"], side, 4) for _ in range(16)]
    together, asked = ShadingCells.merged(moments).estimate(), middles(side)
    truth = SHADINGS["slope"](asked.column, asked.row)
    before, now = (
        np.mean((reflect(field, asked)[0] - truth) ** 2) for field in (together, moments[-1].estimate(together))
    )
    assert now < 1.1 * before


def test_what_has_changed_since_is_told_by_the_latest_moment():
    """A shadow of 32 pixels goes away in the last of sixteen moments: it is left at a sixth of its depth at most.

    By the moments together alone, 15/16 of it would stay. One seed; means of 1,024 pixels scatter by 1 %.
    """
    random, side = np.random.default_rng(18), 64
    moments = [moment(random, lambda x, y: np.where(x < 32, 0.25, 1.0), side, 4) for _ in range(15)]
    moments.append(moment(random, lambda x, y: 1 + 0 * x, side, 4))
    together, asked = ShadingCells.merged(moments).estimate(), middles(side)
    inner = (np.abs(asked.column - 16) < 12) & (np.abs(asked.row - 32) < 28)
    stale, now = (reflect(field, asked)[0][inner].mean() for field in (together, moments[-1].estimate(together)))
    assert stale == pytest.approx(0.25 + 0.75 / 16, abs=0.03)
    assert now > 1 - 0.75 / 6
