"""Open numbers are drawn within their ranges."""

import numpy as np
import pytest
from scipy.stats import kstest

from saf_gen.errors import BadInput
from saf_gen.ranges import draw, ends, is_range
from saf_gen.seeds import generator


def test_a_fixed_value_is_drawn_as_itself():
    assert draw(3.5, generator(0)) == 3.5
    assert draw([1, 2], generator(0)) == [1, 2]
    assert not is_range({"uniform": [0, 1], "choice": [1]})


def test_uniform_draws_fill_their_range_evenly():
    """Kolmogorov–Smirnov at 1e-4, 2,000 draws, one fixed seed."""
    random = generator("ranges")
    draws = [draw({"uniform": [2, 6]}, random) for _ in range(2000)]
    assert kstest((np.array(draws) - 2) / 4, "uniform").pvalue > 1e-4


def test_log_uniform_draws_are_uniform_in_the_logarithm():
    """Kolmogorov–Smirnov at 1e-4, 2,000 draws, one fixed seed."""
    random = generator("ranges")
    draws = [draw({"log_uniform": [0.1, 10]}, random) for _ in range(2000)]
    assert kstest((np.log10(draws) + 1) / 2, "uniform").pvalue > 1e-4


def test_a_choice_draws_every_value():
    random = generator("ranges")
    assert {draw({"choice": ["a", "b"]}, random) for _ in range(50)} == {"a", "b"}


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ({"uniform": [2, 1]}, r"uniform is \[2, 1\]; allowed: \[low, high\] with low < high"),
        ({"uniform": 3}, r"uniform is 3"),
        ({"log_uniform": [0, 1]}, r"with low < high, both above 0"),
        ({"choice": []}, r"choice is \[\]; allowed: a list of at least one value"),
    ],
)
def test_a_degenerate_range_is_refused(value, told):
    with pytest.raises(BadInput, match=told):
        ends(value)
