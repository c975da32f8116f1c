"""Focus measures against closed forms, and against slow twins written with scipy."""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import sobel
from scipy.signal import convolve2d

from saf_gen import get_measure
from saf_gen.errors import BadInput
from saf_gen.measures import ByBrightness, measure_names
from saf_gen.seeds import generator

SHAPES = [(250, 400), (64, 64), (37, 51), (4, 4), (3, 5), (1, 1)]
NORMALISED = [name for name in measure_names() if get_measure(name).degree == 0]
KERNEL = np.outer([1, 1, -1, -1], [1, 1, -1, -1])


def counts_of(shape, *, highest=60):
    return generator("test_measures", *shape).integers(0, highest, shape, dtype=np.uint32)


@pytest.mark.parametrize("shape", SHAPES)
def test_sd_is_variance_over_squared_mean_and_sd_code_is_n_times_that(shape):
    c = counts_of(shape).astype(float)
    expected = c.var() / c.mean() ** 2
    assert get_measure("sd")(c) == pytest.approx(expected, rel=1e-12)
    assert get_measure("sd")(c.astype(np.uint32)) == pytest.approx(expected, rel=1e-12)
    assert get_measure("sd_code")(c.astype(np.uint32)) == pytest.approx(c.size * expected, rel=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("highest", [60, 20_000])
def test_sd_code_is_event_rate_over_squared_mean_less_the_number_of_pixels(shape, highest):
    c = counts_of(shape, highest=highest)
    event_rate = get_measure("er_sumsq")(c)
    expected = event_rate / c.mean(dtype=float) ** 2 - c.size
    assert get_measure("sd_code")(c) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_event_rates_are_the_sums_of_counts_and_of_their_squares():
    c = np.array([[1, 2, 3], [4, 5, 6]], dtype=np.uint8)
    assert get_measure("er_count")(c) == 21.0
    assert get_measure("er_sumsq")(c) == 91.0


def test_sums_beyond_int64_are_still_right():
    c = np.full((20, 30), 2**32 - 1, dtype=np.uint32)
    assert get_measure("er_sumsq")(c) == pytest.approx(600 * (2**32 - 1) ** 2, rel=1e-12)
    assert get_measure("sd")(c) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_gradient_is_the_sum_of_sobel_magnitudes_with_replicated_borders(shape):
    c = counts_of(shape).astype(float)
    expected = np.hypot(sobel(c, axis=0, mode="nearest"), sobel(c, axis=1, mode="nearest")).sum()
    assert get_measure("gradient_code")(c.astype(np.uint16)) == pytest.approx(expected, rel=1e-12)


def test_gradient_of_a_ramp_has_the_gain_of_an_unnormalised_sobel():
    ramp = np.tile(np.arange(10), (6, 1))
    assert get_measure("gradient_code")(ramp) == 6 * (8 * 8 + 2 * 4)  # borders see half the step


@pytest.mark.parametrize("shape", SHAPES)
def test_mfdct_code_convolves_each_whole_tile_alone_and_in_full(shape):
    c = counts_of(shape).astype(np.int64)
    tiles = [
        c[y : y + 4, x : x + 4]
        for y in range(0, shape[0] // 4 * 4, 4)
        for x in range(0, shape[1] // 4 * 4, 4)
    ]
    expected = sum(int((convolve2d(tile, KERNEL, mode="full") ** 2).sum()) for tile in tiles)
    assert get_measure("mfdct_code")(c) == expected


@pytest.mark.parametrize("shape", SHAPES)
def test_mfdct_lee_convolves_the_image_where_the_kernel_fits(shape):
    c = counts_of(shape).astype(np.int64)
    fits = min(shape) >= 4
    expected = ((sliding_window_view(c, (4, 4)) * KERNEL).sum(axis=(2, 3)) ** 2).sum() if fits else 0
    assert get_measure("mfdct_lee")(c) == expected


def test_a_constant_image_of_seven_scores_as_the_closed_forms_say():
    c = np.full((250, 400), 7, dtype=np.uint32)
    assert get_measure("mfdct_code")(c) == 144 * 49 * 62 * 100 == 43_747_200
    for name in ("mfdct_lee", "gradient_code", "sd", "sd_code"):
        assert get_measure(name)(c) == 0.0
    assert get_measure("er_count")(c) == 700_000
    assert get_measure("er_sumsq")(c) == 4_900_000


def test_rows_beyond_the_last_whole_tile_do_not_enter_mfdct_code():
    c = counts_of((250, 402))
    changed = c.copy()
    changed[248:], changed[:, 400:] = 0, 0
    assert get_measure("mfdct_code")(c) == get_measure("mfdct_code")(changed)
    changed[247] += 1
    assert get_measure("mfdct_code")(c) != get_measure("mfdct_code")(changed)


@pytest.mark.parametrize("name", measure_names())
@pytest.mark.parametrize("factor", [2, 7, 100])
def test_counts_times_a_give_the_score_times_a_to_the_degree(name, factor):
    measure, c = get_measure(name), counts_of((41, 60))
    assert measure(c * factor) == pytest.approx(measure(c) * float(factor) ** measure.degree, rel=1e-12)


@pytest.mark.parametrize("name", NORMALISED)
def test_normalised_measures_score_zero_where_there_is_no_spike(name):
    assert get_measure(name)(np.zeros((20, 30), dtype=np.uint32)) == 0.0


def test_every_measure_that_grows_with_brightness_has_a_twin_and_no_other_has():
    names = measure_names()
    for name in [n for n in names if not n.endswith("_n")]:
        assert (f"{name}_n" in names) == (get_measure(name).degree > 0)
    assert {"er_sumsq_n", "er_count_n", "gradient_code_n", "mfdct_code_n", "mfdct_lee_n"} <= set(names)


@pytest.mark.parametrize("name", [n for n in measure_names() if n.endswith("_n")])
def test_a_twin_is_its_measure_over_the_mean_to_its_degree(name):
    measure, twin, c = get_measure(name.removesuffix("_n")), get_measure(name), counts_of((40, 60))
    assert isinstance(twin, ByBrightness)
    assert twin.degree == 0
    assert twin(c) == pytest.approx(measure(c) / c.mean(dtype=float) ** measure.degree, rel=1e-12)
    assert measure.source in twin.source


def test_the_twin_of_the_event_count_is_exactly_the_number_of_pixels():
    for highest in range(2, 40):
        assert get_measure("er_count_n")(counts_of((25, 40), highest=highest)) == 1000.0


def test_an_unknown_measure_is_told_with_the_nearest_name():
    with pytest.raises(BadInput, match=r"unknown focus measure 'mfdct_le'; allowed: .*mean 'mfdct_lee'\?"):
        get_measure("mfdct_le")
    with pytest.raises(BadInput, match=r"mean 'gradient_code_n'\?"):
        get_measure("gradient_cod_n")


def test_a_measure_free_of_brightness_has_no_twin():
    with pytest.raises(BadInput, match=r"'sd' has no twin 'sd_n': .* brightness; allowed: .*mean 'sd'\?"):
        get_measure("sd_n")


@pytest.mark.parametrize("name", ["sd", "er_count_n"])
def test_an_unknown_option_of_a_measure_is_refused(name):
    with pytest.raises(BadInput, match=r"unknown key of focus measure '\w+': 'window'"):
        get_measure(name, window=3)


@pytest.mark.parametrize(
    ("counts", "message"),
    [
        (np.zeros(5), r"counts have shape \(5,\); allowed: \(rows, columns\)"),
        (np.zeros((0, 3)), r"counts have shape \(0, 3\); allowed: .*at least one pixel"),
        (np.array([["a"]]), r"counts have dtype <U1; allowed: numbers"),
        (np.array([[np.nan]]), r"values that are not finite; allowed: finite numbers"),
    ],
)
def test_what_is_no_image_of_counts_is_refused(counts, message):
    with pytest.raises(BadInput, match=message):
        get_measure("gradient_code_n")(counts)
