"""A lens moved by its actuator, with a state that is kept from call to call."""

from bisect import bisect_left
from functools import lru_cache
from math import floor, hypot, isfinite, pi
from numbers import Real

import numpy as np

from saf_gen.core.region import validate_window
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.optics.actuators.actuator import Actuator
from saf_gen.optics.actuators.oscillator import integrate_lens_oscillator
from saf_gen.optics.actuators.trajectory import (
    Trajectory,
    actuator_trajectory_at,
    apply_actuator_backlash,
    move_actuator_fastest,
)

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
            passed = integrate_lens_oscillator(
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
        position, speed = actuator_trajectory_at(self._motor, begin)
        limits = {"max_speed": actuator.speed, "acceleration": actuator.acceleration}
        motor = move_actuator_fastest(aim, begin, position=position, speed=speed, **limits)
        seat = apply_actuator_backlash(motor, actuator_trajectory_at(self._seat, begin)[0], backlash=actuator.backlash)
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
