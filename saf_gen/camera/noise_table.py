"""A table of normal noise: a flat spectrum of random phases, so that no entry knows its neighbours.

The encoder takes the noise of 64 neighbouring pixels from 64 neighbouring entries, from a place drawn anew
for each readout. For one pixel the draws are then independent; two pixels of a block are as independent as
entries a few places apart, and in a sequence whose spectrum is flat those have correlation -1/(N - 1) at
every distance, exactly (M. R. Schroeder, Synthesis of low-peak-factor signals and binary sequences with
low autocorrelation, IEEE Trans. Inf. Theory 16, 1970, doi:10.1109/TIT.1970.1054411). Independent normal
draws would have left correlations of 1/sqrt(N), the same ones for every block of the array.
"""

from functools import cache

import numpy as np

from saf_gen.core import seeds

__all__ = ["LANES", "NOISE_TABLE_SIZE", "noise_table"]

LANES = 64  # pixels that the encoder advances together
NOISE_TABLE_SIZE = 1 << 16
_GRID = 2.0**12


@cache
def noise_table() -> np.ndarray:
    """Standard normal noise, float32 (NOISE_TABLE_SIZE + LANES,), read-only; the last LANES entries repeat
    the first.

    Mean 0 and variance 1 to within 1e-6, largest value below 5. Rounded to multiples of 2⁻¹², which is
    far below what a threshold can show and makes the table the same on machines whose sine differs in the
    last place.
    """
    phase = 2 * np.pi * seeds.make_generator("encoder", "noise table").random(NOISE_TABLE_SIZE // 2 - 1)
    spectrum = np.zeros(NOISE_TABLE_SIZE // 2 + 1, np.complex128)  # nothing at frequency 0: the mean is 0
    spectrum[1:-1] = np.exp(1j * phase)
    noise = np.fft.irfft(spectrum)
    noise = (np.round(noise / noise.std() * _GRID) / _GRID).astype(np.float32)
    table = np.concatenate([noise, noise[:LANES]])
    table.flags.writeable = False
    return table
