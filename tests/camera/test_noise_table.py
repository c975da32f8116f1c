import numpy as np
from scipy import stats

from saf_gen.camera.encoder_kernel import LANES, NOISE_TABLE_SIZE, make_noise_table


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
