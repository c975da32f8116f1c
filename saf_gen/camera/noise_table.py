"""A table of normal noise with a flat spectrum, so that its entries are uncorrelated at every distance.

The encoder takes the noise of 64 neighbouring pixels from 64 consecutive entries, and draws the first of them at random
for each readout. The noise of one pixel is therefore independent from readout to readout. Two pixels of a block are
correlated like two entries at a fixed distance, and in a sequence of N entries with a flat spectrum this correlation is
exactly -1/(N - 1) at every distance [1]_. A table of independent normal draws would have correlations of 1/sqrt(N),
which would be the same in every block of the array.

References
----------
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

    The last LANES entries repeat the first. Mean 0 and variance 1 are exact to 1e-6, and the largest absolute value is
    below 5. Values are rounded to multiples of 2⁻¹², far below what a threshold resolves, so that the table is
    identical on machines whose sine differs in the last digit.
    """
    phase = 2 * np.pi * seeds.make_generator("encoder", "noise table").random(NOISE_TABLE_SIZE // 2 - 1)
    spectrum = np.zeros(NOISE_TABLE_SIZE // 2 + 1, np.complex128)  # 0 at frequency 0, so that the mean is 0
    spectrum[1:-1] = np.exp(1j * phase)
    noise = np.fft.irfft(spectrum)
    noise = (np.round(noise / noise.std() * _GRID) / _GRID).astype(np.float32)
    table = np.concatenate([noise, noise[:LANES]])
    table.flags.writeable = False
    return table
