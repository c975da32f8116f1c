"""A table of normal noise with a flat spectrum, so that its entries are uncorrelated at every distance.

The encoder takes the noise of 64 neighbouring pixels from 64 neighbouring entries, beginning at an entry drawn anew for
each readout. The draws of one pixel are then independent. Two pixels of a block are as independent as entries a few
positions apart, and in a sequence with a flat spectrum those have a correlation of exactly -1/(N - 1) at every distance
[1]_. Independent normal draws would leave correlations of 1/sqrt(N), the same ones in every block of the array.

.. [1] M. R. Schroeder, Synthesis of low-peak-factor signals and binary sequences with low autocorrelation,
   IEEE Trans. Inf. Theory 16, 1970, doi:10.1109/TIT.1970.1054411.
"""

from functools import cache

import numpy as np

from saf_gen.core import seeds

LANES = 64  # pixels that the encoder advances together
NOISE_TABLE_SIZE = 1 << 16
_GRID = 2.0**12


@cache
def make_sensor_noise_table() -> np.ndarray:
    """Return standard normal noise, float32 (NOISE_TABLE_SIZE + LANES,), read-only.

    The last LANES entries repeat the first. Mean 0 and variance 1 are exact to 1e-6; the largest value is
    below 5. Values are multiples of 2⁻¹², far below what a threshold resolves, which makes the table the
    same on machines whose sine differs in the last digit.
    """
    phase = 2 * np.pi * seeds.make_generator("encoder", "noise table").random(NOISE_TABLE_SIZE // 2 - 1)
    spectrum = np.zeros(NOISE_TABLE_SIZE // 2 + 1, np.complex128)  # nothing at frequency 0: the mean is 0
    spectrum[1:-1] = np.exp(1j * phase)
    noise = np.fft.irfft(spectrum)
    noise = (np.round(noise / noise.std() * _GRID) / _GRID).astype(np.float32)
    table = np.concatenate([noise, noise[:LANES]])
    table.flags.writeable = False
    return table
