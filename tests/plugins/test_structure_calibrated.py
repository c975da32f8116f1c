"""Structure at octaves of scale: by hand, against a slow reference and closed forms, and for its purpose."""

import numpy as np
import pytest
from planted_counts import BOARD, CONTRAST, dark_of, expected_score, halves_of

from saf_gen import get_measure
from saf_gen.core.seeds import make_generator


def slow(halves, frames, *, longest=8, dark=0.0045, dark_rms=0.48):
    """The formula, pixel by pixel."""
    lengths = frames // 2, frames - frames // 2
    d = [dark * n for n in lengths]
    rows, columns = halves.shape[1:]
    total, apart = 0.0, 1
    while apart <= longest:
        for down, right in ((apart, 0), (0, apart)):
            products = [
                np.prod([half[y + down, x + right] - half[y, x] for half in halves.astype(float)])
                for y in range(rows - down)
                for x in range(columns - right)
            ]
            if products:
                total += (np.mean(products) + 1 / 6 - 2 * dark_rms**2 * d[0] * d[1]) / apart
        apart *= 2
    return total / np.prod([half.mean() - one for half, one in zip(halves, d, strict=True)])


@pytest.mark.parametrize("shape", [(7, 11), (1, 6), (5, 1)])
@pytest.mark.parametrize("options", [{}, {"longest": 1}, {"longest": 5, "dark": 0.01, "dark_rms": 0.1}])
def test_it_is_the_formula(shape, options):
    halves = make_generator("structure").poisson(6, (2, *shape)).astype(np.uint32)
    score = get_measure("structure_calibrated", **options)(halves, frames=101)
    assert score == pytest.approx(slow(halves, 101, **options), rel=1e-12)


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
