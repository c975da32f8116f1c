"""Motion of a lens on a spring behind its seat: a damped oscillator, solved exactly piece by piece.

While the seat moves with constant acceleration, y = y₀ + v₀·s + a·s²/2 at the time s, the lens is at x = p(s) + e(s).
Here p = y(s) - (2ζ/ω)·(v₀ + a·s) + (4ζ² - 1)·a/ω² solves x″ + 2ζω·x′ + ω²·x = ω²·y, and e is a free oscillation. The
state that is kept from readout to readout is e and its speed divided by ω. It advances by the exponential of a 2×2
matrix, which is computed here as a series: only the four basic operations are used and none is fused or reordered (no
fastmath), so the bits are the same on every machine.
"""

from typing import Any

from saf_gen.core.compiled import compiled

TOLERANCE = 1e-12  # allowed distance beyond a stop, as a fraction of the travel
HALVINGS = 50


@compiled
def lens_oscillator_propagator(angle: Any, damping: Any) -> Any:
    """Return exp(angle·[[0, 1], [-1, -2ζ]]) by rows, from a Taylor series of degree 14 and repeated squaring."""
    halvings, small = 0, angle
    while small * (1 + 2 * damping) > 0.5:
        small, halvings = small / 2, halvings + 1
    a, b, c, d = 1.0, 0.0, 0.0, 1.0
    for power in range(14, 0, -1):  # Horner: I + M/1·(I + M/2·(I + ...))
        m = small / power
        a, b, c, d = 1 + m * c, m * d, -m * (a + 2 * damping * c), 1 - m * (b + 2 * damping * d)
    for _ in range(halvings):
        a, b, c, d = a * a + b * c, b * (a + d), c * (a + d), d * d + b * c
    return a, b, c, d


@compiled
def _smooth(piece: Any, time: Any, omega: Any, damping: Any) -> Any:
    """Return the position and the speed of the part of the lens's response that does not oscillate, p(s)."""
    passed, acceleration = time - piece[0], piece[3]
    lag = 2 * damping / omega
    flat = piece[1] - lag * piece[2] + (4 * damping * damping - 1) * acceleration / (omega * omega)
    speed = piece[2] - lag * acceleration
    return flat + passed * (speed + acceleration * passed / 2), speed + acceleration * passed


@compiled
def _hit(piece: Any, begin: Any, end: Any, off: Any, swing: Any, stop: Any, omega: Any, damping: Any) -> Any:
    """Return the time between ``begin`` (inside the travel) and ``end`` (beyond it) at which the lens hits the stop."""
    low, high = begin, end
    for _ in range(HALVINGS):
        middle = low + (high - low) / 2
        a, b, _c, _d = lens_oscillator_propagator(omega * (middle - begin), damping)
        position = _smooth(piece, middle, omega, damping)[0] + a * off + b * swing
        if (position > stop) == (stop > 0.5):
            high = middle
        else:
            low = middle
    return high


@compiled
def _advance(piece: Any, begin: Any, end: Any, off: Any, swing: Any, turned: Any, omega: Any, damping: Any) -> Any:
    """Return e and its speed divided by ω at ``end``, with stops; ``turned`` propagates from ``begin`` to ``end``."""
    a, b, c, d = turned
    off_then, swing_then = a * off + b * swing, c * off + d * swing
    for attempt in range(2):
        base, speed = _smooth(piece, end, omega, damping)
        position = base + off_then
        if -TOLERANCE <= position <= 1 + TOLERANCE:
            break
        stop = 1.0 if position > 0.5 else 0.0
        if attempt == 1:  # still pushed against the stop
            off_then, swing_then = stop - base, -speed / omega
            break
        hit = _hit(piece, begin, end, off, swing, stop, omega, damping)
        at_hit, speed_at_hit = _smooth(piece, hit, omega, damping)
        off_hit, swing_hit = stop - at_hit, -speed_at_hit / omega
        a, b, c, d = lens_oscillator_propagator(omega * (end - hit), damping)
        off_then, swing_then = a * off_hit + b * swing_hit, c * off_hit + d * swing_hit
    return off_then, swing_then


@compiled
def integrate_lens_oscillator(
    pieces: Any, state: Any, first: Any, readout_hz: Any, omega: Any, damping: Any, out: Any
) -> Any:
    """Compute the positions of the lens in the middle of the readouts from ``first`` on.

    Parameters
    ----------
    pieces : ndarray of float64, shape (m, 4)
        Trajectory of the seat, beginning with the piece that contains the middle of the readout before ``first``.
    state : ndarray of float64, shape (2,)
        e and its speed divided by ω, in the middle of that readout; replaced by those of the last readout.
    first : int
        Number of the first readout.
    readout_hz : float
        Readouts per second.
    omega : float
        Angular frequency ω of the undamped oscillator, radians per second.
    damping : float
        Damping ratio ζ.
    out : ndarray of float64, shape (frames,)
        Receives the positions, as fractions of the travel.

    Returns
    -------
    int
        Index of the piece that contains the middle of the last readout.
    """
    every = lens_oscillator_propagator(omega / readout_hz, damping)
    off, swing, now, j = state[0], state[1], (first - 0.5) / readout_hz, 0
    for k in range(out.shape[0]):
        time, uninterrupted = (first + k + 0.5) / readout_hz, True
        while j + 1 < pieces.shape[0] and pieces[j + 1, 0] < time:
            border, uninterrupted = pieces[j + 1, 0], False
            turned = lens_oscillator_propagator(omega * (border - now), damping)
            off, swing = _advance(pieces[j], now, border, off, swing, turned, omega, damping)
            base, speed = _smooth(pieces[j], border, omega, damping)
            next_base, next_speed = _smooth(pieces[j + 1], border, omega, damping)
            off += base - next_base
            swing += (speed - next_speed) / omega
            now, j = border, j + 1
        turned = every if uninterrupted else lens_oscillator_propagator(omega * (time - now), damping)
        off, swing = _advance(pieces[j], now, time, off, swing, turned, omega, damping)
        out[k] = min(max(_smooth(pieces[j], time, omega, damping)[0] + off, 0.0), 1.0)
        now = time
    state[0], state[1] = off, swing
    return j
