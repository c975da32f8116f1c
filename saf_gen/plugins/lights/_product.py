"""The product of light schedules: one lamp under several of them, such as mains flicker while a dimmer turns."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import isfinite, prod

import numpy as np

from saf_gen.core.config import registry
from saf_gen.core.user_code import named_user_code
from saf_gen.errors import BadInput
from saf_gen.parts import Light, LightFactor, is_endless
from saf_gen.plugins.lights._breaks import MAX_PIECES
from saf_gen.plugins.lights.constant import Constant

NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)
BLOCK = 65_536  # pieces at a time, so that a long recording fits into memory


def multiply(lights: Iterable[Light]) -> "Product":
    """Return the product of light schedules.

    Raises BadInput if one of them does not say its gain at a moment, as a schedule of users need not.
    """
    factors = []
    for light in lights:
        if not isinstance(light, LightFactor):
            raise BadInput(
                f"{light!r} cannot be a factor of a product: it does not say its gain at a moment",
                allowed="schedules with the methods gain and breaks, as all have that come with saf_gen",
                hint="add both methods to it: docs/add-a-method.md",
            )
        factors.append(light)
    return Product(tuple(factors))


@dataclass(frozen=True)
class Product:
    """The gain is the product of the gains of ``factors`` at each moment.

    It is integrated by Gauss-Legendre quadrature of ten nodes in each piece between two neighbouring breaks of any
    factor. That is exact for the product of up to 19 straight lines, and right to 1e-12 for that of eight sines, as the
    breaks of each are at most a quarter of its shortest period apart, or four time constants of a decay. Constant
    factors are taken out first, so that the product of one schedule and constant light is exactly that schedule.

    References
    ----------
    G. H. Golub and J. H. Welsch, Calculation of Gauss quadrature rules, Mathematics of Computation 23, 1969,
    doi:10.1090/S0025-5718-69-99647-1.
    """

    factors: tuple[LightFactor, ...]
    _tables: dict[tuple[float, float], tuple[np.ndarray, np.ndarray]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    def endless(self) -> bool:
        """Whether all factors go on after the recording."""
        return all(map(is_endless, self.factors))

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds.

        Raises BadInput if a factor falls below 0, or if the product is too large or has too many pieces.
        """
        seconds = np.asarray(seconds, dtype=np.float64)
        level = prod(factor.level for factor in self.factors if isinstance(factor, Constant))
        if not isfinite(level):
            raise _too_large()
        others = [factor for factor in self.factors if not isinstance(factor, Constant)]
        if not others:
            return level * seconds
        if len(others) == 1:
            return level * others[0].integral(seconds, duration_s)
        edges, cumulative = self._table(duration_s, end_s=float(seconds.max(initial=duration_s)))
        times = seconds.ravel()
        piece = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(edges) - 2)
        since = self._integrals(edges[piece], times, duration_s=duration_s)
        return (level * (cumulative[piece] + since)).reshape(seconds.shape)

    def _table(self, duration_s: float, *, end_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the edges of the pieces until ``end_s``, and the integral from 0 to each, for constant factors of 1.

        After the recording there are also its own breaks, such as the end of a ramp that takes all of it.
        """
        if (duration_s, end_s) not in self._tables:
            breaks = [_breaks(factor, time_s) for time_s in {duration_s, end_s} for factor in self.factors]
            within = np.concatenate(breaks)
            within = within[(within > 0) & (within < end_s)]
            if within.size > MAX_PIECES:
                raise BadInput(
                    f"a product has {within.size:,} pieces in {end_s:g} s", allowed=f"at most {MAX_PIECES:,}"
                )
            edges = np.unique(np.concatenate(([0.0], within, [end_s])))
            pieces = self._integrals(edges[:-1], edges[1:], duration_s=duration_s)
            self._tables[duration_s, end_s] = edges, np.concatenate(([0.0], np.cumsum(pieces)))
        return self._tables[duration_s, end_s]

    def _integrals(self, begin: np.ndarray, end: np.ndarray, *, duration_s: float) -> np.ndarray:
        """Return the integral from each begin to each end (n,), between which no factor jumps or bends."""
        total = np.zeros(begin.size)
        for first in range(0, begin.size, BLOCK):
            block = slice(first, first + BLOCK)
            middle, half = 0.5 * (begin[block] + end[block]), 0.5 * (end[block] - begin[block])
            at = middle + NODES[:, None] * half
            gains = np.ones_like(at)
            with np.errstate(over="ignore", invalid="ignore"):  # an overflow raises BadInput below
                for factor in self.factors:
                    if not isinstance(factor, Constant):
                        gains *= _gains(factor, at, duration_s=duration_s)
            if not np.isfinite(gains).all():
                raise _too_large()
            for weight, row in zip(WEIGHTS, gains, strict=True):  # in this order, whatever the number of times
                total[block] += weight * row
            total[block] *= half
        return total


def _too_large() -> BadInput:
    return BadInput("a product of gains is too large", allowed="products that float64 can hold")


def _gains(factor: LightFactor, seconds: np.ndarray, *, duration_s: float) -> np.ndarray:
    """Return the gain of a factor at each time; raise BadInput below 0, as two such factors would make light."""
    gains = registry.sample_function(factor, factor.gain, seconds=seconds, duration_s=duration_s)
    if gains.size and not gains.min() >= -1e-9:
        raise BadInput(f"the gain of {factor!r} falls to {gains.min():.3g}", allowed="gains of 0 or more")
    return gains


def _breaks(factor: LightFactor, duration_s: float) -> np.ndarray:
    with named_user_code(factor):
        breaks = np.asarray(factor.breaks(duration_s), dtype=np.float64)
    if breaks.ndim != 1 or not np.isfinite(breaks).all():
        raise BadInput(f"the breaks of {factor!r} are {breaks!r}", allowed="a list of times in seconds")
    return breaks
