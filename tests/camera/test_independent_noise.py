"""Noise: its table is normal, and terms and pixels are independent."""

import numpy as np
import pytest
from scipy import stats

from saf_gen.camera import Encoder, encode, get_sensor
from saf_gen.camera.encoder_kernel import LANES, NOISE_TABLE_SIZE, make_noise_table

THETA, NOISE = 29_900.0, 0.1  # threshold noise, of the threshold
QUIET = {"shot": False, "dark": False, "response": False, "threshold_spread": False, "threshold_noise": False}


def test_dark_charge_does_not_depend_on_the_response_to_light():
    """Without light the spikes do not depend on the response of pixels; with light they do."""
    dark, light = (np.full((1, 20, 33), charge, np.float32) for charge in (0.0, 0.1 * THETA))
    sensors = [
        get_sensor("vidar_400x250", dark_rate=0.05, noise={**QUIET, "dark": True, "response": response})
        for response in (False, True)
    ]
    even, uneven = (encode(dark, sensor, frames=2_000, seed=4) for sensor in sensors)
    assert np.bitwise_count(even).sum() > 50_000
    assert np.array_equal(even, uneven)
    assert not np.array_equal(*(encode(light, sensor, frames=2_000, seed=4) for sensor in sensors))


@pytest.fixture(scope="module")
def intervals():
    """The interval after each spike of 12,800 pixels, int (readout, pixel), 0 if there is no spike."""
    sensor = get_sensor(
        "vidar_400x250", reset_loss=0, threshold_noise_rms=NOISE, noise={**QUIET, "threshold_noise": True}
    )
    frames, shape = 480, (128, 100)
    packed = Encoder(sensor, shape, seed=6).encode(
        np.full((1, 1, *shape), THETA / 40, np.float32),
        index=np.zeros(frames, int),
        fraction=np.zeros(frames),
        gain=np.ones((frames, 1)),
    )
    spikes = np.unpackbits(packed, axis=-1, bitorder="little").reshape(-1, frames).T.astype(bool)
    following = np.full(spikes.shape[1], frames)
    after = np.zeros(spikes.shape, int)
    for t in range(frames - 1, -1, -1):
        after[t] = np.where(spikes[t] & (following < frames), following - t, 0)
        following[spikes[t]] = t
    return after


@pytest.mark.parametrize("apart", [1, LANES, LANES + 1, 2 * LANES])
def test_pixels_that_fire_together_draw_independent_thresholds(intervals, apart):
    """Intervals after simultaneous spikes of two pixels, in the same block of 64 or in two, are uncorrelated.

    12,700 pairs of pixels have about 3,500 simultaneous spikes; significance 10⁻⁴ each, two-sided, seed 6. If pixels
    shared their draws, the correlation would be 0.99: noise is 4 readouts, and intervals are rounded to readouts.
    """
    one, other = intervals[:, :-apart], intervals[:, apart:]
    both = (one > 0) & (other > 0)
    assert both.sum() > 3_000
    correlation = np.corrcoef(one[both], other[both])[0, 1]
    assert abs(correlation) * np.sqrt(both.sum()) < stats.norm.isf(0.5e-4)


def test_the_table_is_standard_normal():
    """χ² test of 65,536 entries in 256 classes of equal probability; significance 1e-4; the table has one seed."""
    table = make_noise_table()[:NOISE_TABLE_SIZE].astype(np.float64)
    assert abs(table.mean()) < 1e-6
    assert abs(table.var() - 1) < 1e-6
    assert 4 < np.abs(table).max() < 5
    classes = np.bincount((stats.norm.cdf(table) * 256).astype(int), minlength=256)
    assert stats.chisquare(classes).pvalue > 1e-4


def test_entries_know_nothing_of_each_other_at_any_distance():
    """The circular autocorrelation is -1/(N - 1); that of independent draws would scatter by 1/√N = 0.004."""
    table = make_noise_table()[:NOISE_TABLE_SIZE].astype(np.float64)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(table)) ** 2) / NOISE_TABLE_SIZE
    assert abs(correlation[0] - 1) < 1e-6
    assert np.abs(correlation[1:]).max() < 1e-4


def test_a_block_may_begin_anywhere():
    table = make_noise_table()
    assert table.shape == (NOISE_TABLE_SIZE + LANES,)
    assert np.array_equal(table[NOISE_TABLE_SIZE:], table[:LANES])
    assert not table.flags.writeable
