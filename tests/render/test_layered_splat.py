"""Sums of paths in layers of equal blur: against a slow reference, and by the effect on points, edges and noise."""

import numba as nb
import numpy as np
import pytest
from blurred_edges import fit_edge
from random_paths import paths, windows
from scipy.ndimage import correlate1d, maximum_filter
from scipy.stats import qmc

from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.render.host_splat import TracedPaths
from saf_gen.render.layered_splat import (
    COVERAGE_SMOOTHING,
    LAYERS,
    LAYERS_PER_OCTAVE,
    MIN_BLUR,
    SIDE_LAYERS,
    SMOOTHING,
    BlurScale,
    LayeredSums,
    gaussian_taps,
)
from saf_gen.render.surface_hits import Distances
from saf_gen.stack.focal_stack import LAYERED_POSITIONS

SCALE, MAX_RADIANCE = 2.0**22, 1e6
DIAMETER = 100.0  # pixels times metres, for a lens focused at 1 m
FOCUSED = 1.0  # m


def distance_of(blur):
    """The distance at which a point is blurred by so many pixels; positive if nearer than the focus."""
    return 1 / (1 / FOCUSED + np.asarray(blur) / DIAMETER)


def blur_scale(positions=1, *, drift=0.0):
    """A lens of DIAMETER focused at 1 m at the first position, and ``drift`` dioptres nearer at each later one."""
    k = np.arange(positions)
    return BlurScale(np.full(positions, DIAMETER), 1 / FOCUSED + drift * k, np.zeros(positions))


def on_disc(random, count):
    """Points even over the unit disc."""
    r, angle = np.sqrt(random.random(count)), random.uniform(0, 2 * np.pi, count)
    return np.float32(r * np.cos(angle)), np.float32(r * np.sin(angle))


def still(x, y, **more):
    """Paths that have the same point at every position."""
    x, y = np.float32(x), np.float32(y)
    return TracedPaths(x, y, 0 * x, 0 * y, None, **more)


def add_all(shape, *layers, blur=None, groups=1):
    """The stack, float32 (light, focus, row, col), of groups of (line, lens, distance, radiance)."""
    sums = LayeredSums(
        shape,
        blur=blur or blur_scale(shape[0]),
        scale=np.full(groups, SCALE),
        max_radiance=np.full(groups, MAX_RADIANCE),
    )
    for line, lens, distance, radiance in layers:
        count = line.first_x.size
        distance = np.broadcast_to(np.float32(distance), count).copy()
        values = np.broadcast_to(np.float32(radiance), (groups, count)).copy()
        sums.add(line, values, lens=lens, distances=Distances(distance))
    return sums.mean_radiance()


def even_paths(random, shape, per_pixel, *, columns=None):
    """Paths that are even over the lens and the sensor (or a range of its columns) with a border of 20 pixels."""
    _, rows, width = shape
    left, right = columns or (-20, width + 20)
    count = round((rows + 40) * (right - left) * per_pixel)
    line = still(random.uniform(left, right, count), random.uniform(-20, rows + 20, count))
    return line, on_disc(random, count)


def sum_slowly(shape, blur, line, lens, distance, radiance):
    """The stack path by path and layer by layer, in double precision: (focus, row, col)."""
    focus, rows, columns = shape
    out = np.zeros(shape)
    begin = np.zeros(radiance.size, dtype=int) if line.begin is None else line.begin
    end = np.full(radiance.size, focus) if line.end is None else line.end
    weight = np.ones(radiance.size) if line.weight is None else line.weight
    for k in range(focus):
        light, count, landed = np.zeros((3, LAYERS, rows, columns))
        plain_light, is_sharp = np.zeros((rows, columns)), np.zeros((rows, columns), bool)
        for i in range(radiance.size):
            if not begin[i] <= k < end[i]:
                continue
            x, y, layer = line.first_x[i] + k * line.step_x[i], line.first_y[i] + k * line.step_y[i], SIDE_LAYERS
            c = 0.0
            if distance[i] > 0:
                c = blur.diameter[k] * (1 / (distance[i] - blur.shift[k]) - blur.inverse_distance[k])
            if abs(c) >= MIN_BLUR:
                octave = np.log2(abs(c) / MIN_BLUR)
                layer = SIDE_LAYERS - int(np.sign(c)) * min(1 + int(octave * LAYERS_PER_OCTAVE), SIDE_LAYERS)
            if 0 <= x < columns and 0 <= y < rows:
                landed[layer, int(y), int(x)] += weight[i]
                plain_light[int(y), int(x)] += weight[i] * radiance[i]
                is_sharp[int(y), int(x)] |= layer == SIDE_LAYERS and distance[i] > 0 and weight[i] > 0
            if layer != SIDE_LAYERS:
                kept = kept_radius(4 * sigma_of(layer) / abs(c), np.hypot(lens[0][i], lens[1][i]))
                x -= c / 2 * (1 - kept) * lens[0][i]
                y -= c / 2 * (1 - kept) * lens[1][i]
            if 0 <= x < columns and 0 <= y < rows:
                light[layer, int(y), int(x)] += weight[i] * radiance[i]
                count[layer, int(y), int(x)] += weight[i]
        free, is_plain = np.ones((rows, columns)), np.zeros((rows, columns), bool)
        plain = plain_light / np.maximum(landed.sum(axis=0), 1)
        for layer in range(LAYERS):
            if layer > SIDE_LAYERS:
                reach = int(np.ceil(1.5 * SMOOTHING * 2 * sigma_of(layer)))
                mixed = maximum_filter((landed[layer] > 0) & is_sharp, 2 * reach + 1)
                light[layer][mixed] = count[layer][mixed] = 0
                is_plain |= mixed & (landed[layer] > 0)
            one, seen = (smooth(array, sigma_of(layer)) for array in (count[layer], light[layer]))
            narrow = sigma_of(layer) * COVERAGE_SMOOTHING / SMOOTHING
            here, all_behind = (smooth(array, narrow) for array in (landed[layer], landed[layer:].sum(axis=0)))
            with np.errstate(invalid="ignore"):
                covered = np.where((one > 0) & (here > 0), free * here / all_behind, 0)
                out[k] += np.where(covered > 0, covered * seen / one, 0)
            free -= covered
        out[k] = np.where(free < 1, out[k] / np.where(free < 1, 1 - free, 1), 0)
        out[k][is_plain] = plain[is_plain]
    return out


def sigma_of(layer):
    """A fraction of the disc's standard deviation, a quarter of its diameter, at the smallest blur of the layer."""
    if layer == SIDE_LAYERS:
        return 0.0
    return SMOOTHING * MIN_BLUR * 2 ** ((abs(layer - SIDE_LAYERS) - 1) / LAYERS_PER_OCTAVE) / 4


def kept_radius(s, r):
    """The radius of a path divided by that before it was moved, found from the moments of the disc by quadrature.

    s is the standard deviation of the Gaussian divided by that of the disc.
    """
    squares = (np.arange(4000) + 0.5) / 4000  # of radii even over the disc
    mean_square = np.mean(squares * (1 + 1.5 * s**2 - 3 * s**2 * squares) ** 2)
    return np.sqrt((1 - s**2) * 0.5 / mean_square) * (1 + 1.5 * s**2 - 3 * s**2 * r**2)


def smooth(plane, sigma):
    half = gaussian_taps(sigma)
    taps = np.concatenate([half[:0:-1], half])
    return correlate1d(correlate1d(plane, taps, axis=0, mode="constant"), taps, axis=1, mode="constant")


@pytest.mark.parametrize("windowed", [False, True])
def test_the_stack_is_that_of_the_slow_reference(windowed):
    """4,000 paths from in front of and behind the focus, or without a distance, of weights 0 to 4, at three positions.

    Single precision may put a path into a neighbouring pixel or layer, so that a few of 1,800 pixels differ.
    """
    shape, count, random = (3, 24, 25), 4000, np.random.default_rng(2)
    *line, radiance = paths(6, count, shape)
    lens, weight = on_disc(random, count), random.integers(0, 5, count).astype(np.uint32)
    distance = np.float32(distance_of(random.uniform(-60, 60, count)))
    distance[:300], distance[300:600] = 0, np.inf
    more = dict(zip(("begin", "end"), windows(8, count, shape), strict=True)) if windowed else {}
    line, blur = TracedPaths(*line, None, weight=weight, **more), blur_scale(3, drift=0.1)
    found = add_all(shape, (line, lens, distance, radiance), blur=blur)[0]
    expected = sum_slowly(shape, blur, line, lens, distance, radiance)
    assert np.isclose(found, expected, rtol=1e-4, atol=1e-5).mean() > 0.97
    assert np.abs(found - expected).mean() < 1e-3 * expected.mean()


@pytest.mark.parametrize(
    ("drive", "distance_m"),
    [
        (ImageDistanceDrive(0.05, 2.0, (0.4, 0.25)), 0.33),
        (FocalLengthDrive(0.06, 2.0, (0.4, 0.25)), 0.5),
        (Stage(0.05, 2.0, 0.25, (0.06, -0.04)), 0.25),
    ],
)
def test_the_blur_is_how_far_apart_two_rays_of_a_point_land(drive, distance_m):
    """Their distance on the sensor is the blur times their distance at the lens, at every position."""
    focus, pitch_m = np.linspace(0.2, 0.7, 6), 20e-6
    middle = float(focus[0] + focus[-1]) / 2
    scale = BlurScale.from_drive(drive, focus, pitch_m=pitch_m)
    blur = scale.diameter * (1 / (distance_m - scale.shift) - scale.inverse_distance)
    a = np.array([-0.3, 0.4]) * drive.aperture_radius_m
    slope = (0.01 - a) / distance_m  # both come from a point 10 mm off the axis
    x = -drive.image_distance(middle) * (slope + a / drive.object_distance(middle))
    landed = drive.ray_transfer(focus, middle) @ np.array([x, a])  # (focus, point on sensor or lens, ray)
    (x0, x1), (a0, a1) = landed[:, 0].T, landed[:, 1].T
    assert (x1 - x0) / pitch_m == pytest.approx(blur / 2 * (a1 - a0) / drive.aperture_radius_m, rel=1e-6)


def test_an_even_light_stays_even_whatever_is_in_front():
    """A blurred foreground with gaps, leaves in focus and a blurred background, all equally bright."""
    shape, random = (2, 60, 70), np.random.default_rng(3)
    layers = []
    for blur in (40.0, 7.0, 0.0, -12.0, -80.0):
        line, lens = even_paths(random, shape, 3)
        gone = random.random(line.first_x.size) < 0.5
        gone |= np.sin(line.first_x / 5 + blur) > 0.3
        kept = np.flatnonzero(~gone)
        layers.append(
            (TracedPaths(*(a[kept] for a in line[:4]), None), (lens[0][kept], lens[1][kept]), distance_of(blur), 0.37)
        )
    assert add_all(shape, *layers) == pytest.approx(np.round(0.37 * SCALE) / SCALE, rel=3e-6)


@pytest.mark.parametrize(("blur", "side"), [(3.0, -1), (4.3, 1), (23.0, -1), (90.0, 1)])
def test_the_picture_of_a_point_keeps_its_width_and_its_light(blur, side):
    """A point on a dark surface: its flux, and the variance blur²/16 of its disc along each axis, within 1 %.

    The point is even over a pixel and counted in pixels, which both add 1/12. Its 16,000 paths on an even spiral are
    less than a hundredth of the surface's paths in any pixel.
    """
    extent = 2 * (round(0.8 * blur) + 6) + 1
    shape, count = (1, extent, extent), 16_000
    k = np.arange(count) + 0.5
    r, angle = np.sqrt(k / count), k * np.pi * (3 - np.sqrt(5))
    lens = np.float32(r * np.cos(angle)), np.float32(r * np.sin(angle))
    place = (k[:, None] * np.array([0.7548776662, 0.5698402910])) % 1 + extent // 2
    x, y = (place[:, axis] + side * blur / 2 * lens[axis] for axis in (0, 1))
    row, column = (axis.ravel() + 0.5 for axis in np.meshgrid(np.arange(extent), np.arange(extent), indexing="ij"))
    dark = still(column, row, weight=np.full(column.size, 1_000_000, dtype=np.uint32))
    nowhere = np.zeros(column.size, dtype=np.float32)
    distance = distance_of(side * blur)
    picture = add_all(shape, (dark, (nowhere, nowhere), distance, 0.0), (still(x, y), lens, distance, 1.0))[
        0, 0
    ].astype(float)
    assert picture.sum() * 1_000_000 == pytest.approx(count, rel=3e-3)
    across = np.arange(extent) - (extent // 2)
    for axis in (0, 1):
        profile = picture.sum(axis=axis) / picture.sum()
        mean = (profile * across).sum()
        assert mean == pytest.approx(0, abs=0.02)
        variance = (profile * (across - mean) ** 2).sum()
        assert variance - 1 / 6 == pytest.approx(blur**2 / 16, rel=0.01)


@pytest.mark.parametrize("blur", [8.0, 90.0])
def test_a_sharp_edge_before_a_blurred_wall_stays_sharp(blur):
    """Both keep their radiance up to the edge, in every pixel."""
    shape, random = (1, 40, 80), np.random.default_rng(5)
    near, near_lens = even_paths(random, shape, 16, columns=(-20, 40))
    far, far_lens = even_paths(random, shape, 16, columns=(40, 100))
    wall = 3 + random.gamma(1, 1, far.first_x.size)
    picture = add_all(shape, (near, near_lens, FOCUSED, 0.7), (far, far_lens, distance_of(-blur), wall))[0, 0]
    assert picture[:, :40] == pytest.approx(np.round(0.7 * SCALE) / SCALE, rel=1e-6)
    assert picture[:, 40:].min() > 3


def picture_of_edge(own_blur, blur_behind, *, textured=False):
    """Profiles, (col,), of a dark half plane before a bright wall: in layers, and the plain mean of the same paths.

    A ray tracer in numpy: a path that passes the lens at a and lands at x has met a plane of blur c at x - a·c/2.
    ``textured`` gives the wall a texture; without a wall, the half plane is bright beyond its edge.
    """
    widest = max(abs(own_blur), abs(blur_behind or 0))
    rows, columns = 24, 2 * round(0.6 * widest + 8)
    border = 8 + round(widest / 8)
    down, across, samples = rows + 2 * border, columns + 2 * border, 2 ** round(13 - np.log2(widest))
    random = np.random.default_rng(7)
    first = qmc.Sobol(4, rng=random).random(samples)  # the same points in each pixel, shifted as a whole
    points = (first + random.random((down, across, 1, 4))) % 1
    x = (points[..., 0] + np.arange(across)[:, None] - border).ravel()
    y = (points[..., 1] + np.arange(down)[:, None, None] - border).ravel()
    r, angle = np.sqrt(points[..., 2]).ravel(), 2 * np.pi * points[..., 3].ravel()
    lens = np.float32(r * np.cos(angle)), np.float32(r * np.sin(angle))
    hit = x - own_blur / 2 * lens[0] < columns / 2
    light, distance = np.where(hit, 0.2, 1.0), np.full(x.size, distance_of(own_blur), np.float32)
    if blur_behind is not None:
        distance[~hit] = distance_of(blur_behind)
        if textured:
            met = x - blur_behind / 2 * lens[0]
            light = np.where(hit, 0.2, 1 + 0.5 * np.sin(met * 4 / abs(blur_behind)))
    layers = add_all((1, rows, columns), (still(x, y), lens, distance, light))[0, 0].mean(axis=0, dtype=np.float64)
    seen = (y >= 0) & (y < rows) & (x >= 0) & (x < columns)
    column = x[seen].astype(int)
    return layers, np.bincount(column, light[seen]) / np.bincount(column)


NEAR_FOCUS = ((1.5, -12), (1.5, -48), (-1.5, -12), (-1.5, -48), (2.5, -30), (-2.5, -30), (-4.3, -34))
BLURRED = ((6.1, -20), (-12.1, -48), (24.1, 0), (24.1, -24), (48.1, 4))


@pytest.mark.daily(3)
@pytest.mark.parametrize(("own", "behind"), NEAR_FOCUS + BLURRED)
def test_an_edge_before_a_blurred_wall_has_its_own_blur_and_place(own, behind):
    """Fitted blur within 0.5 % of that of the plain mean of the same paths, and nearly the same place.

    Blurs are a little more than the smallest of a layer, where smoothing is widest.
    """
    layers, plain = (fit_edge(profile, abs(own)) for profile in picture_of_edge(own, behind))
    assert layers[0] == pytest.approx(plain[0], rel=0.005)
    assert layers[0] == pytest.approx(abs(own), rel=0.05 if abs(own) < 2 else 0.01)
    assert layers[1] == pytest.approx(plain[1], abs=0.005 + abs(own) / 4000)


@pytest.mark.slow
@pytest.mark.daily(3)
@pytest.mark.parametrize("blur", [1.5, 2.9, 4.3, -6.1, 8.6, -12.1, 24.1, -48.1, 96.1])
def test_an_edge_within_a_blurred_surface_has_the_blur_of_the_surface(blur):
    layers, plain = (fit_edge(profile, abs(blur)) for profile in picture_of_edge(blur, None))
    assert layers[0] == pytest.approx(plain[0], rel=0.005)
    assert layers[0] == pytest.approx(abs(blur), rel=0.05 if abs(blur) < 2 else 0.01)
    assert layers[1] == pytest.approx(plain[1], abs=0.005 + abs(blur) / 4000)


@pytest.mark.parametrize(("own", "behind"), NEAR_FOCUS)
def test_an_edge_near_focus_before_a_blurred_texture_is_as_sharp_as_in_the_plain_mean(own, behind):
    """Energies of Tenengrad and Brenner within 3 %, in the columns of the edge and three on either side.

    The contrast of the texture is 0.5, and from one end of the disc to the other it changes by nearly all of it.
    """
    layers, plain = picture_of_edge(own, behind, textured=True)
    middle, reach = layers.size // 2, round(abs(own) / 2 + 3)
    for step in (1, 2):
        energy, expected = (
            np.sum((profile[step:] - profile[:-step]) ** 2)
            for profile in (layers[middle - reach : middle + reach], plain[middle - reach : middle + reach])
        )
        assert energy == pytest.approx(expected, rel=0.03)


def test_bent_light_leaves_what_is_behind_it_smooth():
    """A tenth of the paths are bent, as bright as the mean of a wall whose paths have a relative noise of 1.

    The plain mean of 16 paths has a standard deviation of 0.24.
    """
    shape, random = (1, 40, 60), np.random.default_rng(12)
    line, lens = even_paths(random, shape, 16)
    bent = random.random(line.first_x.size) < 0.1
    radiance = np.where(bent, 1.0, random.gamma(1, 1, bent.size))
    picture = add_all(shape, (line, lens, np.where(bent, 0.0, distance_of(-30)), radiance))[0, 0]
    assert picture.std() < 0.12


def test_the_number_of_workers_changes_no_bit():
    shape, random = (3, 30, 30), np.random.default_rng(8)
    line, lens = even_paths(random, shape, 4)
    distance, radiance = distance_of(random.uniform(-50, 50, line.first_x.size)), random.random(line.first_x.size)
    threads = nb.get_num_threads()
    try:
        stacks = []
        for workers in range(1, min(threads, 3) + 1):
            nb.set_num_threads(workers)
            stacks.append(add_all(shape, (line, lens, distance, radiance)))
    finally:
        nb.set_num_threads(threads)
    assert all(np.array_equal(stacks[0], other) for other in stacks[1:])


def test_paths_above_the_maximum_radiance_count_as_the_maximum():
    sums = LayeredSums((1, 1, 1), blur=blur_scale(), scale=np.array([SCALE]), max_radiance=np.array([2.0]))
    lens = np.zeros(2, np.float32), np.zeros(2, np.float32)
    line, radiance = still([0.5, 0.5], [0.5, 0.5]), np.float32([[1.0, 500.0]])
    sums.add(line, radiance, lens=lens, distances=Distances(np.zeros(2, np.float32)))
    assert sums.mean_radiance() == pytest.approx(1.5)


@pytest.mark.parametrize("sigma", [0.0, 0.1875, 0.4999, 0.5, 0.75, 4.24])
def test_taps_add_up_to_one_and_have_the_variance(sigma):
    """Three taps have it exactly. A Gaussian that is cut off at three standard deviations lacks 3 %.

    One of half a pixel lacks 12 %, which is 0.03 pixels²; the disc that it smooths has 4.
    """
    taps = gaussian_taps(sigma)
    out = np.arange(taps.size)
    assert taps[0] + 2 * taps[1:].sum() == pytest.approx(1, abs=1e-12)
    assert (taps > 0).all()
    assert (np.diff(taps) < 0).all()
    assert 2 * (taps * out**2).sum() == pytest.approx(
        sigma**2, rel=1e-12 if sigma < 0.5 else 0.12 if sigma < 0.75 else 0.03
    )


def test_layers_fit_the_window_of_a_time_slice_but_not_a_full_travel():
    slice_of_one, travel = (3, 250, 400), (129, 250, 400)
    assert LayeredSums.sums_in_layers(slice_of_one, 3)
    assert not LayeredSums.sums_in_layers(travel, 1)
    assert not LayeredSums.sums_in_layers((LAYERED_POSITIONS + 1, 4, 4), 1)
    assert LayeredSums.sums_in_layers((LAYERED_POSITIONS, 4, 4), 1)
    assert not LayeredSums.sums_in_layers((2, 4000, 4000), 1)


def test_behind_clear_sheets_a_path_is_as_sharp_as_the_sharpest_of_all_that_it_passes():
    """1,000 paths with an end and the nearest and farthest of some sheets, blurred by up to 40 pixels either way.

    Other sheets may be anywhere between the nearest and the farthest. A distance of 0 means that there is no sheet.
    """
    random = np.random.default_rng(31)
    end, one, other = random.uniform(-40, 40, (3, 1000))
    none = random.random(1000) < 0.2
    between = np.where(one * other < 0, 0.0, np.where(np.abs(one) < np.abs(other), one, other))
    sharpest = np.where(none | (np.abs(end) < np.abs(between)), end, between)
    line = still(random.uniform(0, 64, 1000), random.uniform(0, 48, 1000))
    lens, values = on_disc(random, 1000), np.float32(random.random((1, 1000)))

    def summed(*blurs):
        sums = LayeredSums(
            (1, 48, 64), blur=blur_scale(), scale=np.full(1, SCALE), max_radiance=np.full(1, MAX_RADIANCE)
        )
        sums.add(line, values, lens=lens, distances=Distances(*blurs))
        return sums.mean_radiance()

    at = lambda blur: np.float32(distance_of(blur))  # noqa: E731
    near, far = at(np.maximum(one, other)), np.where(none, np.float32(0), at(np.minimum(one, other)))
    assert np.array_equal(summed(at(end), near, far), summed(at(sharpest)))
