"""Measures of structure at octaves of scale: against slow references and closed forms, and for their purpose."""

import numpy as np
import pytest
from planted_counts import BOARD, CONTRAST, dark_of, expected_score, halves_of

from saf_gen import encode, get_measure, get_sensor
from saf_gen.core.seeds import make_generator


def mean_product(images, down, right):
    """Return the mean product, over two images, of differences of pixels so far apart; None if there are none."""
    rows, columns = images[0].shape
    products = [
        np.prod([image[y + down, x + right] - image[y, x] for image in images])
        for y in range(rows - down)
        for x in range(columns - right)
    ]
    return np.mean(products) if products else None


def octaves(longest):
    return [(apart, step) for apart in (1, 2, 4, 8) if apart <= longest for step in ((apart, 0), (0, apart))]


def slow_calibrated(halves, frames, *, longest=8, dark=0.0045, dark_rms=0.48):
    d = dark * (frames // 2), dark * (frames - frames // 2)
    total = 0.0
    for apart, step in octaves(longest):
        if (found := mean_product(halves.astype(float), *step)) is not None:
            total += (found + 1 / 6 - 2 * dark_rms**2 * d[0] * d[1]) / apart
    return total / np.prod([half.mean() - one for half, one in zip(halves, d, strict=True)])


@pytest.mark.parametrize("shape", [(7, 11), (1, 6), (5, 1)])
@pytest.mark.parametrize("options", [{}, {"longest": 1}, {"longest": 5, "dark": 0.01, "dark_rms": 0.1}])
def test_the_calibrated_structure_is_the_formula(shape, options):
    halves = make_generator("structure").poisson(6, (2, *shape)).astype(np.uint32)
    score = get_measure("structure_calibrated", **options)(halves, frames=101)
    assert score == pytest.approx(slow_calibrated(halves, 101, **options), rel=1e-12)


@pytest.mark.parametrize("shape", [(9, 12), (1, 7), (1, 1)])
@pytest.mark.parametrize("longest", [1, 6])
def test_the_structure_between_octaves_is_the_formula(shape, longest):
    counts = 1 + make_generator("octaves").poisson(6, shape).astype(float)
    expected = 0.0
    for apart, (down, right) in octaves(longest):
        if (far := mean_product([counts, counts], 2 * down, 2 * right)) is not None:
            expected += (far - mean_product([counts, counts], down, right)) / apart
    score = get_measure("octave_structure", longest=longest)(counts.astype(np.uint32))
    assert score == pytest.approx(expected / counts.mean() ** 2, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("sd", [0.5, 3.0], ids=["counting", "hot pixels"])
def test_white_noise_of_any_size_scores_nothing(sd):
    """400 images of 60 x 80 pixels, mean 12: the mean of their scores is 0 within 4 standard errors (p < 1e-4).

    One seed per size. Without the correction the variance would score 2·sd²/144 for each length and axis.
    """
    generator = make_generator("octaves", sd)
    measure = get_measure("octave_structure")
    scores = [measure(12 + sd * generator.standard_normal((60, 80))) for _ in range(400)]
    error = np.std(scores, ddof=1) / len(scores) ** 0.5
    assert abs(np.mean(scores)) < 4 * error
    assert 4 * error < 0.01 * 2 * sd**2 / 144  # the test would detect a hundredth of the noise


@pytest.mark.parametrize(("rate", "frames"), [(0.2, 400), (0.01, 1600)])
def test_the_score_is_the_structure_of_the_light_whatever_the_light(rate, frames):
    """Six devices with known dark charge; the standard error is 2 % at 1/20 of the light.

    Their response adds 1 %; its part that is correlated with dark charge adds 8 % at 1/20 of the light.
    """
    field_structure = 0.0
    for apart in (1, 2, 4, 8):
        for axis, size in enumerate(BOARD.shape):
            ahead, behind = BOARD.take(range(apart, size), axis), BOARD.take(range(size - apart), axis)
            field_structure += CONTRAST**2 * np.mean((ahead - behind) ** 2) / apart
    scores, expected = [], []
    for seed in range(6):
        measure = get_measure("structure_calibrated", **dark_of(seed))
        scores.append(measure(halves_of(rate, frames, seed=seed), frames=frames))
        expected.append(expected_score("structure_calibrated", rate, contrast=CONTRAST, seed=seed))
    assert np.mean(scores) == pytest.approx(np.mean(expected), rel=0.07)
    assert np.mean(expected) == pytest.approx(field_structure, rel=0.02 + 0.005 / rate / 5)


@pytest.mark.slow
def test_an_even_field_has_hardly_any_structure_in_little_light():
    """The response and its part correlated with dark charge give 0.06, and chance 0.02 for each of 12 devices."""
    rate, frames = 0.01, 1600
    sensor, scores, expected = get_sensor("vidar_400x250"), [], []
    charge = np.full((1, 64, 96), rate * sensor.threshold_e, np.float32)
    for seed in range(12):
        spikes = encode(charge, sensor, frames=frames, seed=seed)
        shown = np.unpackbits(spikes, axis=2, bitorder="little")[:, :, :frames].astype(np.uint32)
        halves = np.stack([half.sum(axis=2) for half in np.array_split(shown, 2, axis=2)])
        scores.append(get_measure("structure_calibrated", **dark_of(seed))(halves, frames=frames))
        expected.append(expected_score("structure_calibrated", rate, contrast=0.0, seed=seed))
    assert np.mean(expected) < 0.08
    assert np.mean(scores) == pytest.approx(np.mean(expected), abs=0.025)


@pytest.mark.parametrize("name", ["structure_calibrated", "sd_calibrated"])
def test_in_the_dark_a_calibrated_measure_scores_nothing(name):
    assert get_measure(name)(halves_of(0.0, 2000), frames=2000) == 0.0
    assert get_measure(name)(np.zeros((2, 4, 4)), frames=100) == 0.0


def test_every_octave_weighs_the_same_where_there_are_sharp_edges():
    """Edges at random, farther apart than the longest length: 2,000 columns, 60 edges, one seed."""
    random = make_generator("edges")
    field = np.ones(2000)
    for k, at in enumerate(np.cumsum(random.integers(20, 46, 60))):
        field[at:] = 1 + 0.3 * (k % 2)
    light = np.stack([np.tile(2000 * field, (4, 1))] * 2)
    scores = [get_measure("structure_calibrated", longest=n, dark=0.0)(light) for n in (1, 2, 4, 8)]
    octaves = np.diff(scores, prepend=0.0)
    assert octaves == pytest.approx(octaves.mean(), rel=0.05)


@pytest.mark.parametrize("shape", [(9, 12), (1, 7), (6, 5)])
def test_fine_structure_is_the_formula(shape):
    counts = 1 + make_generator("fine").poisson(6, shape).astype(np.uint32)
    expected = 0.0
    for apart, weight in ((1, -4), (2, 5), (4, -1)):
        pairs = [
            (float(counts[y + dy, x + dx]) - float(counts[y, x])) ** 2
            for dy, dx in ((apart, 0), (0, apart))
            for y in range(shape[0] - dy)
            for x in range(shape[1] - dx)
        ]
        expected += weight * np.mean(pairs) if pairs else 0.0
    assert get_measure("fine_structure")(counts) == pytest.approx(expected / counts.mean() ** 2, rel=1e-12)


def test_fine_structure_sees_neither_noise_nor_shading_but_texture():
    """Noise: 400 images of 60 x 80 pixels, mean 12: the mean score is 0 within 4 standard errors (p < 1e-4), one seed.

    A slope and a bow of brightness cancel but for the pairs at the edges.
    """
    generator, measure = make_generator("fine noise"), get_measure("fine_structure")
    scores = [measure(12 + 3 * generator.standard_normal((60, 80))) for _ in range(400)]
    error = np.std(scores, ddof=1) / len(scores) ** 0.5
    assert abs(np.mean(scores)) < 4 * error
    assert 4 * error < 0.02 * 2 * 9 / 144
    y, x = np.mgrid[:60, :80]
    for light, least in ((100.0 + x + 2 * y, 1e-4), (100 + (x - 40) ** 2 / 16, 5e-3)):
        assert abs(measure(light)) < least * light.var() / light.mean() ** 2
    stripes = 100 + 10 * (-1.0) ** (x // 2)
    assert measure(stripes) == pytest.approx(6 * 0.01, rel=0.05), "5·4σ² − 4·2σ² along rows, none along columns"
