"""Sums over a pupil with which checks and tests compare pictures: nothing of the package is used.

Points of a pupil are in units of its radius, wavefronts in wavelengths.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import j1

ACROSS = 240
Waves = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""A wavefront (wavelengths) as a function of the points x, y of a pupil."""


def pupil_transfer(waves: Waves, *, fractions: np.ndarray) -> np.ndarray:
    """Return the complex transfer of a round lens along x at these fractions of its cut-off frequency.

    It is the overlap of two copies of the pupil, with the phase between them: H. H. Hopkins, 1955,
    doi:10.1098/rspa.1955.0158.
    """
    x = (np.arange(ACROSS) + 0.5) / ACROSS * 2 - 1
    x, y = np.meshgrid(x, x)
    found = []
    for s in fractions:
        both = (abs(x) + s) ** 2 + y**2 <= 1
        phase = waves(x[both] + s, y[both]) - waves(x[both] - s, y[both])
        found.append(np.exp(2j * np.pi * phase).sum())
    return np.array(found) / np.count_nonzero(x**2 + y**2 <= 1)


def seidel(
    *,
    spherical: float = 0.0,
    coma: float = 0.0,
    astigmatism: float = 0.0,
    field_curvature: float = 0.0,
    defocus: float = 0.0,
    eta: Sequence[float] = (0.0, 0.0),
) -> Waves:
    """Return Seidel's sum at a point η of the picture, in units of the height at which coefficients are stated.

    Source: W. T. Welford, Aberrations of Optical Systems, 1986, chapter 7.
    """

    def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        squared, along = x**2 + y**2, eta[0] * x + eta[1] * y
        field = eta[0] ** 2 + eta[1] ** 2
        return (
            spherical * squared**2
            + coma * along * squared
            + astigmatism * along**2
            + (field_curvature * field + defocus) * squared
        )

    return waves


def disc_transfer(diameter: np.ndarray, cycles: np.ndarray) -> np.ndarray:
    """Return the transfer of a disc, 2·J₁(x)/x; its diameter and the frequency broadcast, in inverse units."""
    x = np.pi * np.abs(diameter) * cycles
    return np.asarray(np.where(x > 1e-9, 2 * j1(x) / np.maximum(x, 1e-9), 1.0))


def section_transfer(
    fractions: np.ndarray, *, coherence: float, waves: Waves, across: int = 500
) -> tuple[np.ndarray, np.ndarray]:
    """Return the transfer (absorption, phase) of a weak thin section at fractions of the cut-off of the aperture.

    The sum is over points of the condenser, whose aperture is ``coherence`` times that of the lens. Both are 1 where
    all diffracted light passes in phase, or in quadrature: H. H. Hopkins, 1953, doi:10.1098/rspa.1953.0071.
    """
    s = ((np.arange(across) + 0.5) / across * 2 - 1) * min(coherence, 1)
    x, y = np.meshgrid(s, s)
    here = x**2 + y**2 <= min(coherence, 1) ** 2
    x, y = x[here], y[here]
    straight = np.exp(-2j * np.pi * waves(x, y))
    sides = []
    for fraction in (*fractions, *-fractions):
        passes = (x + fraction) ** 2 + y**2 <= 1
        diffracted = np.exp(2j * np.pi * waves(x + fraction, y)) * straight
        sides.append((diffracted * passes).sum() / x.size)
    one, other = np.array(sides).reshape(2, -1)
    return ((one + other) / 2).real, (1j * (one + other) / 2).real


FINEST = 0.45
"""Cycles per pixel of the finest waves of the texture: pixels see no aliases of it, wherever they are."""


def texture(rows: int, columns: int) -> np.ndarray:
    """Return a texture of waves with power 1/f² and phases of one seed, float32 (texel, texel), 1 ± 0.8.

    Its one period fills a picture of ``rows`` × ``columns`` pixels of a lens that stays at one distance from the
    sensor, with four texels per pixel and axis. Scenes hold the source of this function, and therefore numbers only.
    """
    cycles = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n * 4) * 4 for n in (columns, rows))))
    kept = (cycles > 0) & (cycles < 0.45)
    turn = np.exp(2j * np.pi * np.random.default_rng(5).random(kept.shape))
    waves = np.fft.ifft2(np.where(kept, 1 / np.maximum(cycles, 1e-9), 0) * turn).real
    return np.asarray(1 + 0.8 * waves / np.abs(waves).max(), np.float32)


def texture_dispersion(rows: int, columns: int, *, cycles: np.ndarray, transfers: np.ndarray) -> np.ndarray:
    """Return variance over squared mean of pictures of the texture: its waves through texels, lens and pixels.

    By Parseval's theorem, nothing of the picture is needed but the power of each wave.

    Parameters
    ----------
    rows, columns : int
        Size of the picture, pixels.
    cycles : ndarray of float64, shape (frequency,)
        Frequencies, cycles per pixel from 0 to FINEST, at which the transfer of the lens is known.
    transfers : ndarray of complex128, shape (picture, frequency)
        Transfer of the lens in each picture, the same in all directions.
    """
    texels = 4
    drawn = texture(rows, columns).astype(np.float64)
    fy, fx = np.meshgrid(*(np.fft.fftfreq(n) * texels for n in drawn.shape), indexing="ij")
    radial = np.hypot(fx, fy)
    blurred_by_texels, by_pixels = (np.sinc(fx / n) * np.sinc(fy / n) for n in (texels, 1))
    power = np.abs(np.fft.fft2(drawn) / drawn.size / drawn.mean() * blurred_by_texels**2 * by_pixels) ** 2
    seen = (radial > 0) & (radial < FINEST)
    return np.array(
        [(power[seen] * np.interp(radial[seen], cycles, np.abs(one)) ** 2).sum() for one in np.asarray(transfers)]
    )


def find_peak(curve: np.ndarray, around: int = 4) -> float:
    """Return the place, in steps, of the peak of a parabola fitted round a focus curve's largest value."""
    k = int(curve.argmax())
    near = slice(max(k - around, 0), k + around + 1)
    parabola = np.polynomial.Polynomial.fit(np.arange(len(curve))[near], curve[near], 2)
    return float(np.real(parabola.deriv().roots()[0]))
