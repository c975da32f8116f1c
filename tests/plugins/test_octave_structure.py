"""Structure between octaves: by formula, by hand, and without the contribution of white noise."""

import numpy as np
import pytest

from saf_gen import get_measure
from saf_gen.core.seeds import make_generator


def slow(counts, *, longest=4):
    """The formula, pixel by pixel."""
    counts = counts.astype(float)
    rows, columns = counts.shape

    def structure(down, right):
        found = [
            (counts[y + down, x + right] - counts[y, x]) ** 2
            for y in range(rows - down)
            for x in range(columns - right)
        ]
        return np.mean(found) if found else None

    total, apart = 0.0, 1
    while apart <= longest:
        for far, near in (((2 * apart, 0), (apart, 0)), ((0, 2 * apart), (0, apart))):
            if (large := structure(*far)) is not None:
                total += (large - structure(*near)) / apart
        apart *= 2
    return total / counts.mean() ** 2


@pytest.mark.parametrize("shape", [(9, 12), (1, 7), (1, 1)])
@pytest.mark.parametrize("longest", [1, 6])
def test_it_is_the_formula(shape, longest):
    counts = 1 + make_generator("octaves").poisson(6, shape).astype(np.uint32)
    assert get_measure("octave_structure", longest=longest)(counts) == pytest.approx(
        slow(counts, longest=longest), rel=1e-12, abs=1e-12
    )


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
