"""A lens moved by its actuator, with a state that is kept from call to call."""

from functools import lru_cache
from math import floor, hypot, isfinite, pi
from numbers import Real
from typing import Any

import numpy as np

from saf_gen.core.compiled import compiled
from saf_gen.core.region import validate_window
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.optics.actuators.actuator import Actuator
from saf_gen.optics.actuators.hysteresis import apply_hysteresis, drive_position, operators_at_rest, states_at
from saf_gen.optics.actuators.trajectory import Trajectory, apply_backlash, move_fastest, pieces_until, trajectory_at

# Motion of a lens on a spring behind its seat: a damped oscillator, solved exactly piece by piece.
#
# While the seat moves with constant acceleration, y = y₀ + v₀·s + a·s²/2 at the time s, the lens is at x = p(s) +
# e(s).
# Here p = y(s) - (2ζ/ω)·(v₀ + a·s) + (4ζ² - 1)·a/ω² solves x″ + 2ζω·x′ + ω²·x = ω²·y, and e is a free oscillation.
# The
# state that is kept from readout to readout is e and its speed divided by ω. It advances by the exponential of a 2×2
# matrix, which is computed here as a series: only the four basic operations are used and none is fused or reordered
# (no
# fastmath), so the bits are the same on every machine.


TOLERANCE = 1e-12  # allowed distance beyond a stop, as a fraction of the travel
HALVINGS = 50


@compiled
def propagator(angle: Any, damping: Any) -> Any:
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
        a, b, _c, _d = propagator(omega * (middle - begin), damping)
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
        a, b, c, d = propagator(omega * (end - hit), damping)
        off_then, swing_then = a * off_hit + b * swing_hit, c * off_hit + d * swing_hit
    return off_then, swing_then


@compiled
def integrate_oscillator(
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
    every = propagator(omega / readout_hz, damping)
    off, swing, now, j = state[0], state[1], (first - 0.5) / readout_hz, 0
    for k in range(out.shape[0]):
        time, uninterrupted = (first + k + 0.5) / readout_hz, True
        while j + 1 < pieces.shape[0] and pieces[j + 1, 0] < time:
            border, uninterrupted = pieces[j + 1, 0], False
            turned = propagator(omega * (border - now), damping)
            off, swing = _advance(pieces[j], now, border, off, swing, turned, omega, damping)
            base, speed = _smooth(pieces[j], border, omega, damping)
            next_base, next_speed = _smooth(pieces[j + 1], border, omega, damping)
            off += base - next_base
            swing += (speed - next_speed) / omega
            now, j = border, j + 1
        turned = every if uninterrupted else propagator(omega * (time - now), damping)
        off, swing = _advance(pieces[j], now, time, off, swing, turned, omega, damping)
        out[k] = min(max(_smooth(pieces[j], time, omega, damping)[0] + off, 0.0), 1.0)
        now = time
    state[0], state[1] = off, swing
    return j


@compiled
def relax(heat: Any, state: Any, share: Any, out: Any) -> Any:
    """Compute q in the middle of readouts, which follows s by q′ = (s - q)/τ; by the trapezoid rule.

    Parameters
    ----------
    heat : ndarray of float64, shape (frames,)
        s in the middle of the readouts.
    state : ndarray of float64, shape (2,)
        q and s in the middle of the readout before; replaced by those of the last readout.
    share : float
        Length of a readout divided by τ.
    out : ndarray of float64, shape (frames,)
        Receives q.
    """
    q, before = state[0], state[1]
    for k in range(out.shape[0]):
        q = ((1 - share / 2) * q + share / 2 * (before + heat[k])) / (1 + share / 2)
        before = heat[k]
        out[k] = q
    state[0], state[1] = q, before


BLOCK = 4096
COMMAND_FRAMES = 8
"""Number of readouts from one command of a motion to the next, as in a sweep of the closed loop."""


class ActuatedLens:
    """An actuator and its lens. Time advances by readouts of the camera, and only in :meth:`run`.

    The same commands at the same frames give the same bits, however the readouts are divided into calls.

    Parameters
    ----------
    actuator : Actuator
        The actuator.
    start : float
        Position at which the motor rests first, in the middle of its backlash, as a fraction of the travel. The lens is
        there too, but for hysteresis (the motor came from the middle of the travel) and drift (its heat is in balance).
    readout_hz : float
        Readouts of the camera per second.
    seed : int
        Seed of the noise of the position sensor and of the positioning errors.

    Raises
    ------
    BadInput
        If the start is outside 0 to 1, or ``readout_hz`` is not a positive finite number.
    """

    def __init__(self, actuator: Actuator, *, start: float, readout_hz: float, seed: int) -> None:
        _check_position("start", start)
        if not (isfinite(readout_hz) and readout_hz > 0):
            raise BadInput(f"readout_hz is {readout_hz!r}", allowed="readouts per second, above 0")
        self.actuator, self.readout_hz, self.seed = actuator, float(readout_hz), seed
        self.frames = 0
        """Readouts so far."""
        self.target = float(start)
        """The position commanded last, as a fraction of the travel."""
        self._positioning_error = 0.0  # accumulated positioning error of the motor, unknown to its controller
        self._commands = 0
        begin = -0.5 / self.readout_hz
        self._motor: Trajectory = [(begin, float(start), 0.0, 0.0)]
        self._operators: list[Trajectory] = []
        self._seat: Trajectory = self._motor[:]
        if actuator.hysteresis:
            states = operators_at_rest(float(start))
            self._operators = [[(begin, state, 0.0, 0.0)] for state in states]
            seat = drive_position(float(start), states, hysteresis=actuator.hysteresis)
            self._seat = [(begin, seat, 0.0, 0.0)]
        self._warmth = np.full(2, float(start) ** 2)  # of the lens and of its current, as fractions of those in the end
        self._oscillation = np.zeros(2)
        self._read, self._forgotten = np.empty(BLOCK), 0

    def command(self, to: float) -> None:
        """Command the lens to the position ``to``, 0 to 1; the command takes effect after the actuator's latency.

        Raises
        ------
        BadInput
            If ``to`` is outside 0 to 1.
        """
        self._positioning_error, self._motor, self._operators, self._seat = self._plan(to)
        self.target = float(to)
        self._commands += 1

    def run(self, frames: int) -> np.ndarray:
        """Advance by a number of readouts and return the lens position in the middle of each, float64 (frames,).

        Raises
        ------
        BadInput
            If ``frames`` is negative.
        """
        if frames < 0:
            raise BadInput(f"the number of frames is {frames}", allowed="0 or more")
        positions = np.empty(frames)
        first, stop = self.frames, self.frames + frames
        if frames:
            omega = 2 * pi * self.actuator.resonance_hz
            pieces = np.array(pieces_until(self._seat, (stop - 0.5) / self.readout_hz))
            passed = integrate_oscillator(
                pieces, self._oscillation, first, self.readout_hz, omega, float(self.actuator.damping), positions
            )
            del self._seat[:passed]
            motor = self._motor_positions(first, stop)
            for operator in self._operators:
                del operator[: len(pieces_until(operator, stop / self.readout_hz)) - 1]
            if self.actuator.drift is not None:
                warmth = np.empty(frames)
                relax(motor * motor, self._warmth, 1 / (self.readout_hz * self.actuator.drift.time_s), warmth)
                positions = self._drifted(positions, warmth)
            first, last = first - self._forgotten, stop - self._forgotten
            while last > len(self._read):
                self._read = np.concatenate([self._read, np.empty_like(self._read)])
            self._read[first:last] = positions if self.actuator.reads == "lens" else motor
        self.frames = stop
        return positions

    def forget_readings(self) -> None:
        """Drop the readings of all past frames, so that a lens that runs for hours takes no more memory."""
        self._read, self._forgotten = np.empty(BLOCK), self.frames

    def read_sensor(self, first: int, stop: int) -> np.ndarray:
        """Return the readings of the position sensor at past frames ``first <= t < stop``, float64.

        Noise may put them slightly outside 0 to 1.

        Raises
        ------
        BadInput
            If the window includes frames that have not passed, or whose readings are forgotten.
        """
        window = validate_window(first, stop, total=self.frames)
        if window.start < self._forgotten:
            raise BadInput(f"the reading at frame {window.start} is forgotten", allowed=f"from frame {self._forgotten}")
        read = self._read[window.start - self._forgotten : window.stop - self._forgotten].copy()
        if rms := self.actuator.position_noise_rms:
            blocks = range(window.start // BLOCK, (window.stop - 1) // BLOCK + 1)
            noise = np.concatenate([_normals(self.seed, "position", block=block) for block in blocks])
            begin = window.start - blocks.start * BLOCK
            read += rms * noise[begin : begin + len(window)]
        return read

    def resting_position(self, to: float | None = None) -> float:
        """Return the position at which the lens will come to rest without further commands, or if sent to ``to`` now.

        Backlash, hysteresis, steps and positioning errors are included, and the drift at the present temperature; the
        temperature may change for minutes.

        Raises
        ------
        BadInput
            If ``to`` is outside 0 to 1.
        """
        seat = self._seat if to is None else self._plan(to)[3]
        return float(self._drifted(seat[-1][1], self._warmth[0]))

    def is_settled(self, within: float) -> bool:
        """Return whether the lens will stay closer than ``within`` to its resting position without further commands.

        A change of temperature is left out, as in :meth:`resting_position`.
        """
        # If only the piece at rest is left, the energy of the oscillation can only decrease.
        return len(self._seat) == 1 and hypot(*self._oscillation) <= within

    def _plan(self, to: float) -> tuple[float, Trajectory, list[Trajectory], Trajectory]:
        """Return the positioning error of the motor and the trajectories of motor, operators and seat for a command."""
        _check_position("to", to)
        actuator = self.actuator
        target, error = self._round_to_steps(to), self._positioning_error
        if actuator.place_rms:
            block, number = divmod(self._commands, BLOCK)
            relative_error = float(_normals(self.seed, "place", block=block)[number])
            error += actuator.place_rms * abs(target - self._round_to_steps(self.target)) * relative_error
            error = min(max(target + error, 0.0), 1.0) - target
        aim = min(max(target + error, 0.0), 1.0)
        begin = self.frames / self.readout_hz + actuator.latency_s
        position, speed = trajectory_at(self._motor, begin)
        limits = {"max_speed": actuator.speed, "acceleration": actuator.acceleration}
        motor = move_fastest(aim, begin, position=position, speed=speed, **limits)
        driven, operators = motor, []
        if actuator.hysteresis:
            states = states_at(self._operators, begin)
            driven, plays = apply_hysteresis(motor, states, hysteresis=actuator.hysteresis)
            operators = [pieces_until(a, begin) + b for a, b in zip(self._operators, plays, strict=True)]
        seat = apply_backlash(driven, trajectory_at(self._seat, begin)[0], backlash=actuator.backlash)
        return error, pieces_until(self._motor, begin) + motor, operators, pieces_until(self._seat, begin) + seat

    def _round_to_steps(self, position: float) -> float:
        """Return the nearest position within the travel that is a multiple of the motor's step."""
        step = self.actuator.step
        if not step:
            return float(position)
        count = floor(position / step + 0.5)
        return count * step if count * step <= 1 else (count - 1) * step

    def _drifted(self, position: Any, warmth: Any) -> Any:
        """Return positions with the drift of a lens of this warmth, within the travel."""
        drift = self.actuator.drift
        if drift is None:
            return position
        return np.clip(position + drift.per_k * (drift.ambient_k + drift.heating_k * warmth), 0.0, 1.0)

    def _motor_positions(self, first: int, stop: int) -> np.ndarray:
        times = (np.arange(first, stop) + 0.5) / self.readout_hz
        begins, positions, speeds, accelerations = np.array(pieces_until(self._motor, stop / self.readout_hz)).T
        piece = np.searchsorted(begins, times, side="right") - 1
        elapsed = times - begins[piece]
        del self._motor[: piece[-1]]
        return positions[piece] + elapsed * (speeds[piece] + accelerations[piece] * elapsed / 2)


def follow_commands(
    actuator: Actuator, told: np.ndarray, *, readout_hz: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return where a lens was, and what its position sensor read, while its actuator was told to move.

    Parameters
    ----------
    actuator : Actuator
        The actuator; the lens rests first where it is told to be in the first readout.
    told : ndarray of float64, shape (frames,)
        The position to be at in the middle of each readout, 0 to 1. A command is given every COMMAND_FRAMES readouts,
        and is the position at the end of these.
    readout_hz : float
        Readouts per second.
    seed : int
        Seed of the actuator.

    Returns
    -------
    positions, readings : ndarray of float64, shape (frames,)
        Positions of the lens in the middle of the readouts, 0 to 1, and readings, which noise may put a little outside.
    """
    lens = ActuatedLens(actuator, start=float(told[0]), readout_hz=readout_hz, seed=seed)
    positions = np.empty(len(told))
    for first in range(0, len(told), COMMAND_FRAMES):
        stop = min(first + COMMAND_FRAMES, len(told))
        lens.command(float(told[stop - 1]))
        positions[first:stop] = lens.run(stop - first)
    return positions, lens.read_sensor(0, len(told))


def _check_position(key: str, value: object) -> None:
    if isinstance(value, bool) or not (isinstance(value, Real) and 0 <= float(value) <= 1):
        raise BadInput(f"{key} is {value!r}", allowed="0 to 1, a fraction of the travel")


@lru_cache(maxsize=64)
def _normals(seed: int, purpose: str, *, block: int) -> np.ndarray:
    """Return one block of a sequence of normal random numbers, read-only (BLOCK,)."""
    normals = make_generator("actuator", seed, purpose, block).standard_normal(BLOCK)
    normals.flags.writeable = False
    return normals
