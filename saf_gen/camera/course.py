"""Light and lens over time, for cameras that do not read all pixels at one rate.

A course divides a recording into cells of time. In each of them the position of the lens and the gain of every light
group are linear; a gain may jump from one cell to the next. Where a schedule bends or jumps, cells are halved until
they follow it, down to 0.1 µs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from saf_gen.camera.encoder import knot_weights
from saf_gen.errors import BadInput

STEP_S = 2.5e-4  # longest cell: in a fast sweep, light then changes by about a percent in it
SHORTEST_S = 1e-7
NUDGE_S = 1e-8  # over which a gain is measured from its integral: to 1e-8 of it
GAIN_TOLERANCE = 1e-5  # of the gain at hand, because its logarithm counts, and at least of a thousandth of the largest
KNOT_TOLERANCE = 1e-2  # of the distance between two knots
PROBES = (0.37, 0.71)  # where a cell is examined; not symmetric, so that a jump in its middle is seen


@dataclass(frozen=True)
class LightCourse:
    """What the light and the lens do over time.

    Attributes
    ----------
    seconds : ndarray of float64, shape (n + 1,)
        Edges of the cells, rising.
    index : ndarray of int64, shape (n + 1,)
        Knot before the position of the lens at each edge.
    fraction : ndarray of float64, shape (n + 1,)
        Fraction of the way to the next knot.
    gain : ndarray of float64, shape (n, 2, G)
        Gain of each light group at the beginning and at the end of each cell, 0 or more.
    """

    seconds: np.ndarray
    index: np.ndarray
    fraction: np.ndarray
    gain: np.ndarray

    @classmethod
    def follow(
        cls,
        position: Callable[[np.ndarray], np.ndarray],
        integrals: Sequence[Callable[[np.ndarray], np.ndarray]],
        *,
        span_s: tuple[float, float],
        knots: int,
        parts: int = 1,
    ) -> "LightCourse":
        """Return the course of a lens and of light groups over a recording, or a part of it.

        Parameters
        ----------
        position : callable
            Position of the lens at each time, 0 at the first knot to 1 at the last.
        integrals : sequence of callable
            Integral of the gain from 0 to each time, one for each light group.
        span_s : tuple of float
            Begin and end, seconds.
        knots : int
            Number of knots, evenly spaced over the travel. Where the lens passes more than one of them in a cell, cells
            end at knots.
        parts : int, optional
            Equal parts of the recording; cells end where these do.

        Raises
        ------
        BadInput
            If the end is not after the begin, or a gain falls below 0.
        """
        begin, end = span_s
        if not 0 <= begin < end < np.inf:
            raise BadInput(
                f"the recording lasts from {begin!r} to {end!r} s", allowed="seconds, the end after the begin"
            )
        edges = np.linspace(begin, end, parts * max(int(np.ceil((end - begin) / parts / STEP_S)), 1) + 1)
        while True:
            bent = _bends(edges, position=position, knots=knots)
            for integral in integrals:
                bent |= _misses(edges, integral)
            bent &= np.diff(edges) > SHORTEST_S
            if not bent.any():
                break
            middles = 0.5 * (edges[:-1] + edges[1:])[bent]
            edges = np.sort(np.concatenate([edges, middles]))
        edges = np.sort(np.concatenate([edges, _passages(edges, position(edges) * (knots - 1))]))
        index, fraction = knot_weights(position(edges), knots)
        gain = np.stack([np.stack(_ends(edges, integral), axis=1) for integral in integrals], axis=-1)
        if not gain.min() >= -1e-6:
            raise BadInput(f"a gain falls to {gain.min():.3g}", allowed="gains of 0 or more")
        return cls(edges, index, fraction, np.maximum(gain, 0.0))

    @classmethod
    def joined(cls, courses: "Sequence[LightCourse]") -> "LightCourse":
        """Return the course of consecutive courses."""

        def edges(name: str) -> np.ndarray:
            parts = [getattr(course, name) for course in courses]
            return np.concatenate([*(part[:-1] for part in parts), parts[-1][-1:]])

        gain = np.concatenate([course.gain for course in courses])
        return cls(edges("seconds"), edges("index"), edges("fraction"), gain)

    def block(self, begin: int, end: int) -> "LightCourse":
        """Return the cells ``begin`` to ``end``, the latter not included."""
        edges = slice(begin, end + 1)
        return LightCourse(self.seconds[edges], self.index[edges], self.fraction[edges], self.gain[begin:end])

    def mixed(self, begin_s: float, end_s: float) -> "LightCourse":
        """Return the course of twice as many groups: those of an earlier picture of the scene, then of a later one.

        The picture changes evenly from the earlier one at ``begin_s`` to the later one at ``end_s``.
        """
        later = np.stack([self.seconds[:-1], self.seconds[1:]], axis=1)
        later = np.clip((later - begin_s) / (end_s - begin_s), 0.0, 1.0)[:, :, None]
        gain = np.concatenate([self.gain * (1 - later), self.gain * later], axis=2)
        return replace(self, gain=gain)

    def seen_from(self, knot: int) -> "LightCourse":
        """Return the course for a stack whose first knot is this one."""
        return replace(self, index=self.index - knot)


def _ends(edges: np.ndarray, integral: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the gain just after the beginning and just before the end of each cell, (n,) each."""
    after = (integral(edges[:-1] + NUDGE_S) - integral(edges[:-1])) / NUDGE_S
    before = (integral(edges[1:]) - integral(edges[1:] - NUDGE_S)) / NUDGE_S
    return after, before


def _misses(edges: np.ndarray, integral: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return which cells have a gain that is not linear, bool (n,)."""
    span = np.diff(edges)
    first, last = _ends(edges, integral)
    at_hand = np.maximum(np.abs(first), np.abs(last))
    tolerance = GAIN_TOLERANCE * np.maximum(at_hand, max(1e-3 * at_hand.max(), 1e-12))
    missed = np.zeros(span.size, bool)
    for share in PROBES:
        mean = (integral(edges[:-1] + share * span) - integral(edges[:-1])) / (share * span)
        missed |= np.abs(mean - (first + 0.5 * share * (last - first))) > tolerance
    return missed


def _passages(edges: np.ndarray, knot: np.ndarray) -> np.ndarray:
    """Return when a lens passes knots, (m,), in the cells in which it moves by more than one; ``knot`` is its course.

    In shorter cells it jumps, and nothing that lies on its way is seen.
    """
    times = []
    for n in np.nonzero((np.abs(np.diff(knot)) > 1.0 + KNOT_TOLERANCE) & (np.diff(edges) > SHORTEST_S))[0]:
        low, high = sorted(knot[n : n + 2])
        passed = np.arange(np.floor(low) + 1, np.ceil(high))
        at = edges[n] + (edges[n + 1] - edges[n]) * (passed - knot[n]) / (knot[n + 1] - knot[n])
        times.append(at[(at > edges[n] + SHORTEST_S) & (at < edges[n + 1] - SHORTEST_S)])
    return np.concatenate(times) if times else np.empty(0)


def _bends(edges: np.ndarray, *, position: Callable[[np.ndarray], np.ndarray], knots: int) -> np.ndarray:
    """Return in which cells the lens does not move evenly, bool (n,)."""
    at, span = position(edges), np.diff(edges)
    bent = np.zeros(span.size, bool)
    for share in PROBES:
        straight = at[:-1] + share * np.diff(at)
        bent |= np.abs(position(edges[:-1] + share * span) - straight) * (knots - 1) > KNOT_TOLERANCE
    return bent
