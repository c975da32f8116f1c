"""Open numbers are drawn within their ranges."""

import datetime

import numpy as np
import pytest
from scipy.stats import kstest

from saf_gen.core.config.ranges import check_parameter, draw_value, extreme_values, is_range
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput


def test_a_fixed_value_is_drawn_as_itself():
    assert draw_value(3.5, make_generator(0)) == 3.5
    assert draw_value([1, 2], make_generator(0)) == [1, 2]
    assert not is_range({"uniform": [0, 1], "choice": [1]})


def test_uniform_draws_fill_their_range_evenly():
    """Kolmogorov–Smirnov at 1e-4, 2,000 draws, one fixed seed."""
    random = make_generator("ranges")
    draws = [draw_value({"uniform": [2, 6]}, random) for _ in range(2000)]
    assert kstest((np.array(draws) - 2) / 4, "uniform").pvalue > 1e-4


def test_log_uniform_draws_are_uniform_in_the_logarithm():
    """Kolmogorov–Smirnov at 1e-4, 2,000 draws, one fixed seed."""
    random = make_generator("ranges")
    draws = [draw_value({"log_uniform": [0.1, 10]}, random) for _ in range(2000)]
    assert kstest((np.log10(draws) + 1) / 2, "uniform").pvalue > 1e-4


def test_a_choice_draws_every_value():
    random = make_generator("ranges")
    assert {draw_value({"choice": ["a", "b"]}, random) for _ in range(50)} == {"a", "b"}


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
        extreme_values(value)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ({"uniform": [0, float("inf")]}, r"uniform is \[0, inf\]; allowed: .*finite numbers"),
        ({"uniform": [0, float("nan")]}, r"uniform is \[0, nan\]"),
        ({"uniform": [-1.7e308, 1.7e308]}, r"uniform is .*finite numbers"),
        ({"uniform": [0, 10**400]}, r"uniform is \[0, 10000"),
        ({"uniform": [False, True]}, r"uniform is \[False, True\]"),
        ({"uniform": [0, "1e-3"]}, r"uniform is \[0, '1e-3'\]"),
        ({"log_uniform": [1e-300, 1e300]}, r"log_uniform is \[1e-300, 1e\+300\]"),
        (
            {"choice": [1, {"uniform": [0, 1]}]},
            r"a choice holds the range \{'uniform': \[0, 1\]\}; allowed: ",
        ),
        ({"choice": [{"choice": [1, 2]}]}, r"a choice holds the range"),
    ],
)
def test_what_would_draw_no_finite_number_or_a_range_is_refused(value, told):
    with pytest.raises(BadInput, match=told):
        extreme_values(value)
    with pytest.raises(BadInput, match=told):
        draw_value(value, make_generator(0))


@pytest.mark.parametrize(
    "value",
    [0, -2.5, "near", True, [1, 2.0, 3], ["a", False], {"uniform": [0, 1]}, {"choice": ["a", [1, 2]]}],
    ids=str,
)
def test_a_parameter_is_plain_or_a_range_of_what_is_plain(value):
    check_parameter(value)


DATE = datetime.date(2024, 5, 1)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (
            DATE,
            r"r.yaml:3: params.made is the date 2024-05-01; allowed: a finite number, text, true or false",
        ),
        ({"choice": [DATE, "no date"]}, r"params.made is the date 2024-05-01"),
        (float("nan"), r"params.made is nan; allowed"),
        pytest.param(10**400, r"params.made is 1000", id="huge"),
        ([1, float("inf")], r"params.made is inf"),
        ([[1, 2]], r"params.made is \[1, 2\]"),
        (None, r"params.made is empty"),
        (
            {"unifrm": [0, 1]},
            r"params.made is \{'unifrm': \[0, 1\]\}; .*\{uniform: \[...\]\}.*did you mean 'uniform'\?",
        ),
        ({}, r"params.made is \{\}"),
    ],
)
def test_a_parameter_that_no_file_could_record_is_told(value, told):
    with pytest.raises(BadInput, match=told) as caught:
        check_parameter(value, what="params.made", where="r.yaml:3")
    assert "\n" not in str(caught.value)
