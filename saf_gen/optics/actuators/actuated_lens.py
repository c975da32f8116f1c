"""A lens moved by its actuator, with a state that is kept from call to call."""

from bisect import bisect_left, bisect_right
from functools import lru_cache
from math import copysign, floor, hypot, inf, isfinite, pi, sqrt
from numbers import Real
from typing import Any

import numpy as np

from saf_gen.core.compiled import compiled
from saf_gen.core.region import validate_window
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.optics.actuators.actuator import Actuator

# Trajectories with piecewise constant acceleration, of the motor and of the lens seat that it moves with backlash.
#
# A piece is (begin, position, speed, acceleration), in seconds and travels. It lasts until the next piece begins; the
# last piece does not end. The direction does not change within a piece. Only the four basic operations and square
# roots
# are used, which all machines round in the same way.


TrajectoryPiece = tuple[float, float, float, float]
Trajectory = list[TrajectoryPiece]


def trajectory_at(trajectory: Trajectory, seconds: float) -> tuple[float, float]:
    """Return position and speed at a time, which must not be before the first piece."""
    begin, position, speed, acceleration = trajectory[bisect_right(trajectory, (seconds, inf)) - 1]
    elapsed = seconds - begin
    return position + elapsed * (speed + acceleration * elapsed / 2), speed + acceleration * elapsed


def move_fastest(
    target: float, begin: float, *, position: float, speed: float, max_speed: float, acceleration: float
) -> Trajectory:
    """Return the fastest trajectory from a position and speed at the time ``begin`` to rest at ``target``.

    It consists of full acceleration, maximum speed if the distance is long enough, and full braking, which is the
    time-optimal control of a double integrator.
    """
    stop = position + speed * abs(speed) / (2 * acceleration)  # position of rest if it brakes now
    direction = 1.0 if target >= stop else -1.0
    ahead = direction * speed
    if ahead < 0:  # it must reverse first
        reversed_at = begin - ahead / acceleration
        limits = {"max_speed": max_speed, "acceleration": acceleration}
        rest = move_fastest(target, reversed_at, position=stop, speed=0.0, **limits)
        return [(begin, position, speed, direction * acceleration), *rest]
    distance = direction * (target - position)
    peak = sqrt(max(acceleration * distance + ahead * ahead / 2, 0.0))
    top = max(min(peak, max_speed), ahead)
    gain, brake = (top * top - ahead * ahead) / (2 * acceleration), top * top / (2 * acceleration)
    trajectory, time = [], begin
    if top > ahead:
        trajectory.append((time, position, speed, direction * acceleration))
        time += (top - ahead) / acceleration
    if peak > top > 0 and distance > gain + brake:
        trajectory.append((time, position + direction * gain, direction * top, 0.0))
        time += (distance - gain - brake) / top
    if top > 0:
        trajectory.append((time, target - direction * brake, direction * top, -direction * acceleration))
        time += top / acceleration
    return [*trajectory, (time, target, 0.0, 0.0)]


def apply_backlash(motor: Trajectory, seat: float, *, backlash: float) -> Trajectory:
    """Return the trajectory of the lens seat, which starts at ``seat`` and which the motor moves with backlash.

    The motor moves freely until it is half the backlash ahead of the seat; from there on it moves the seat along.
    """
    if backlash == 0:
        return motor
    half, trajectory = backlash / 2, []
    for number, (begin, position, speed, acceleration) in enumerate(motor):
        if number + 1 == len(motor):
            trajectory.append((begin, seat, 0.0, 0.0))
            break
        end, position_at_end = motor[number + 1][:2]
        direction = copysign(1.0, speed or acceleration)
        gap = half - direction * (position - seat)
        if gap > 0:
            ahead, rate = direction * speed, direction * acceleration
            reached = ahead * ahead + 2 * rate * gap
            delay = 2 * gap / (ahead + sqrt(reached)) if reached > 0 else inf
            trajectory.append((begin, seat, 0.0, 0.0))
            if begin + delay >= end:
                continue
            trajectory.append((begin + delay, seat, speed + acceleration * delay, acceleration))
        else:
            trajectory.append((begin, position - direction * half, speed, acceleration))
        seat = position_at_end - direction * half
    return trajectory


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


BLOCK = 4096


class ActuatedLens:
    """An actuator and its lens. Time advances by readouts of the camera, and only in :meth:`run`.

    The same commands at the same frames give the same bits, however the readouts are divided into calls.

    Parameters
    ----------
    actuator : Actuator
        The actuator.
    start : float
        Position at which the lens rests first, as a fraction of the travel; the motor is in the middle of its backlash.
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
        self._seat: Trajectory = self._motor[:]
        self._oscillation = np.zeros(2)
        self._read = np.empty(BLOCK)

    def command(self, to: float) -> None:
        """Command the lens to the position ``to``, 0 to 1; the command takes effect after the actuator's latency.

        Raises
        ------
        BadInput
            If ``to`` is outside 0 to 1.
        """
        self._positioning_error, self._motor, self._seat = self._plan(to)
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
            pieces = np.array(_until(self._seat, (stop - 0.5) / self.readout_hz))
            passed = integrate_oscillator(
                pieces, self._oscillation, first, self.readout_hz, omega, float(self.actuator.damping), positions
            )
            del self._seat[:passed]
            motor = self._motor_positions(first, stop)
            while stop > len(self._read):
                self._read = np.concatenate([self._read, np.empty_like(self._read)])
            self._read[first:stop] = positions if self.actuator.reads == "lens" else motor
        self.frames = stop
        return positions

    def read_sensor(self, first: int, stop: int) -> np.ndarray:
        """Return the readings of the position sensor at past frames ``first <= t < stop``, float64.

        Noise may put them slightly outside 0 to 1.

        Raises
        ------
        BadInput
            If the window includes frames that have not passed.
        """
        window = validate_window(first, stop, total=self.frames)
        read = self._read[window.start : window.stop].copy()
        if rms := self.actuator.position_noise_rms:
            blocks = range(window.start // BLOCK, (window.stop - 1) // BLOCK + 1)
            noise = np.concatenate([_normals(self.seed, "position", block=block) for block in blocks])
            begin = window.start - blocks.start * BLOCK
            read += rms * noise[begin : begin + len(window)]
        return read

    def resting_position(self, to: float | None = None) -> float:
        """Return the position at which the lens will come to rest without further commands, or if sent to ``to`` now.

        Backlash, steps and positioning errors are included.

        Raises
        ------
        BadInput
            If ``to`` is outside 0 to 1.
        """
        seat = self._seat if to is None else self._plan(to)[2]
        return seat[-1][1]

    def is_settled(self, within: float) -> bool:
        """Return whether the lens will stay closer than ``within`` to its resting position without further commands."""
        # If only the piece at rest is left, the energy of the oscillation can only decrease.
        return len(self._seat) == 1 and hypot(*self._oscillation) <= within

    def _plan(self, to: float) -> tuple[float, Trajectory, Trajectory]:
        """Return the positioning error of the motor and the trajectories of motor and seat for a command to ``to``."""
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
        seat = apply_backlash(motor, trajectory_at(self._seat, begin)[0], backlash=actuator.backlash)
        return error, _until(self._motor, begin) + motor, _until(self._seat, begin) + seat

    def _round_to_steps(self, position: float) -> float:
        """Return the nearest position within the travel that is a multiple of the motor's step."""
        step = self.actuator.step
        if not step:
            return float(position)
        count = floor(position / step + 0.5)
        return count * step if count * step <= 1 else (count - 1) * step

    def _motor_positions(self, first: int, stop: int) -> np.ndarray:
        times = (np.arange(first, stop) + 0.5) / self.readout_hz
        begins, positions, speeds, accelerations = np.array(_until(self._motor, stop / self.readout_hz)).T
        piece = np.searchsorted(begins, times, side="right") - 1
        elapsed = times - begins[piece]
        del self._motor[: piece[-1]]
        return positions[piece] + elapsed * (speeds[piece] + accelerations[piece] * elapsed / 2)


def _until(trajectory: Trajectory, seconds: float) -> Trajectory:
    """Return the pieces of a trajectory that begin before a time."""
    return trajectory[: bisect_left(trajectory, (seconds,))]


def _check_position(key: str, value: object) -> None:
    if isinstance(value, bool) or not (isinstance(value, Real) and 0 <= float(value) <= 1):
        raise BadInput(f"{key} is {value!r}", allowed="0 to 1, a fraction of the travel")


@lru_cache(maxsize=64)
def _normals(seed: int, purpose: str, *, block: int) -> np.ndarray:
    """Return one block of a sequence of normal random numbers, read-only (BLOCK,)."""
    normals = make_generator("actuator", seed, purpose, block).standard_normal(BLOCK)
    normals.flags.writeable = False
    return normals
