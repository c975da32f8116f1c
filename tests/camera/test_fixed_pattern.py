"""The fixed pattern of one device against the numbers of its sensor. Array 250 × 400, seeds named."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dct

from saf_gen.camera import get_sensor, sensor_names
from saf_gen.camera.fixed_pattern import draw_fixed_pattern

VIDAR = get_sensor("vidar_400x250")
SHAPE = (250, 400)


@pytest.mark.parametrize("name", sensor_names())
def test_every_sensor_has_the_response_map_of_its_numbers(name):
    """Its own array, seed 3. Profiles have their rms exactly; the white rest adds σ²/n to a mean of n pixels.

    White rest over 100,000 pixels and more: its rms within 0.3 %, 1.5 % allowed. A profile is smooth: over
    the upper two thirds of its cosine spectrum only the white rest of the means is left, whose mean power of
    166 and more terms is known to 11 %, 40 % allowed.
    """
    sensor = get_sensor(name)
    shape = (sensor.rows, sensor.columns)
    response = draw_fixed_pattern(sensor, shape, seed=3).response.astype(float)
    if not sensor.noise.response:
        assert (response == 1).all()
        return
    assert response.mean() == pytest.approx(1, abs=1e-5)
    columns, rows = response.mean(axis=0) - 1, response.mean(axis=1) - 1
    white = sensor.response_white_rms
    assert (response - 1 - columns - rows[:, None]).std() == pytest.approx(white, rel=0.015)
    for profile, rms, others in [
        (columns, sensor.response_column_rms, shape[0]),
        (rows, sensor.response_row_rms, shape[1]),
    ]:
        assert profile.std() == pytest.approx(np.hypot(rms, white / np.sqrt(others)), rel=0.01)
        power = dct(profile, norm="ortho") ** 2
        assert power[len(power) // 3 :].mean() == pytest.approx(white**2 / others, rel=0.4)


@pytest.fixture(scope="module")
def pattern():
    return draw_fixed_pattern(VIDAR, SHAPE, seed=1)


def test_response_has_mean_one_and_the_measured_profiles(pattern):
    """The profiles' rms is exact; the white part adds 0.0184/√250 to a column's mean; seed 1."""
    response = pattern.response.astype(float)
    assert response.dtype == np.float64
    assert response.mean() == pytest.approx(1, abs=1e-5)
    columns, rows = response.mean(axis=0), response.mean(axis=1)
    assert columns.std() == pytest.approx(0.041, rel=0.01)
    assert rows.std() == pytest.approx(0.027, rel=0.01)
    rest = response - columns - rows[:, None] + 1
    assert rest.std() == pytest.approx(0.0184, rel=0.02)


def test_profiles_are_smooth(pattern):
    columns = pattern.response.mean(axis=0)
    assert np.diff(columns).std() < 0.2 * columns.std()


def test_the_smooth_part_holds_77_percent_of_the_variance_of_rates(pattern):
    rate = pattern.response.astype(float) / (pattern.threshold / VIDAR.threshold_e)
    smooth = rate.mean(axis=0).var() + rate.mean(axis=1).var()
    assert rate.std() == pytest.approx(0.057, abs=0.003)
    assert smooth / rate.var() == pytest.approx(0.77, abs=0.03)


def test_dark_charge_is_log_normal_with_hot_pixels_and_the_stated_mean():
    """Four devices, 400,000 pixels: the mean within 1 %, 800 hot pixels within 5 sd; seeds 0 to 3."""
    dark = np.stack([draw_fixed_pattern(VIDAR, SHAPE, seed=s).dark for s in range(4)]).astype(float)
    assert dark.mean() == pytest.approx(0.0045 * VIDAR.threshold_e, rel=0.01)
    logs = np.log(dark[dark < 3 * np.median(dark)])
    assert logs.std() == pytest.approx(0.43, rel=0.02)
    hot = (dark > 4 * np.median(dark)).sum()
    assert hot == pytest.approx(0.002 * dark.size, abs=5 * np.sqrt(800))


def test_thresholds_spread_round_the_stated_one(pattern):
    threshold = pattern.threshold.astype(float)
    assert threshold.mean() == pytest.approx(VIDAR.threshold_e, rel=1e-3)
    assert threshold.std() / threshold.mean() == pytest.approx(0.0184, rel=0.02)


def test_maps_lie_on_a_grid_far_coarser_than_the_last_digit(pattern):
    for map_, mean in [
        (pattern.response, 1.0),
        (pattern.dark, 0.0045 * VIDAR.threshold_e),
        (pattern.threshold, VIDAR.threshold_e),
    ]:
        steps = map_.astype(float) / (mean * 2.0**-16)
        assert abs(steps - np.rint(steps)).max() < 0.05  # float32 keeps 24 bits of it
        assert np.unique(map_).size > 1000


@pytest.mark.parametrize(
    ("term", "map_name"), [("response", "response"), ("dark", "dark"), ("threshold_spread", "threshold")]
)
def test_a_switch_flattens_its_own_map_and_no_other(pattern, term, map_name):
    switched = draw_fixed_pattern(VIDAR.with_noise(**{term: False}), SHAPE, seed=1)
    for name in ("response", "dark", "threshold"):
        same = np.array_equal(getattr(switched, name), getattr(pattern, name))
        assert same is not (name == map_name)
    assert np.ptp(getattr(switched, map_name)) == 0


def test_a_device_is_its_seed(pattern):
    assert np.array_equal(pattern.response, draw_fixed_pattern(VIDAR, SHAPE, seed=1).response)
    assert not np.array_equal(pattern.response, draw_fixed_pattern(VIDAR, SHAPE, seed=2).response)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (3, 5), (17, 64)])
def test_any_shape_has_a_pattern(shape):
    pattern = draw_fixed_pattern(VIDAR, shape, seed=1)
    for map_ in (pattern.response, pattern.dark, pattern.threshold):
        assert map_.shape == shape
        assert map_.dtype == np.float32
        assert (map_ > 0).all()


def test_no_dark_rate_and_no_spread_are_flat():
    flat = draw_fixed_pattern(replace(VIDAR, dark_rate=0, threshold_spread_rms=0), (5, 6), seed=1)
    assert not flat.dark.any()
    assert (flat.threshold == np.float32(VIDAR.threshold_e)).all()
    even = draw_fixed_pattern(replace(VIDAR, dark_log_sd=0, dark_hot_fraction=0), (5, 6), seed=1)
    assert even.dark == pytest.approx(0.0045 * VIDAR.threshold_e, rel=1e-4)
