"""A lens that its actuator is moving: its state goes on from call to call."""

from bisect import bisect_left
from functools import lru_cache
from math import floor, hypot, isfinite, pi
from numbers import Real

import numpy as np

from saf_gen.core.region import validate_window
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.optics.actuators.actuator import Actuator
from saf_gen.optics.actuators.oscillator import integrate_lens
from saf_gen.optics.actuators.trajectory import Trajectory, apply_backlash, plan_move, state_at

__all__ = ["ActuatedLens"]

BLOCK = 4096


class ActuatedLens:
    """One actuator with the lens on it. Time goes by readouts of the camera, and only in :meth:`run`.

    The same commands at the same frames give the same bits, however the readouts are cut into calls.

    Parameters
    ----------
    actuator : see :class:`Actuator`.
    start : where the lens rests at first, fraction of the travel, the motor in the middle of its play.
    readout_hz : readouts of the camera a second.
    seed : names the random streams, the noise of the position sensor and the missed places.

    Raises BadInput for a start outside the travel and for a rate that is no positive number.
    """

    def __init__(self, actuator: Actuator, *, start: float, readout_hz: float, seed: int) -> None:
        _check_place("start", start)
        if not (isfinite(readout_hz) and readout_hz > 0):
            raise BadInput(f"readout_hz is {readout_hz!r}", allowed="readouts a second, above 0")
        self.actuator, self.readout_hz, self.seed = actuator, float(readout_hz), seed
        self.frames = 0
        """Readouts that have been run."""
        self.target = float(start)
        """The place last commanded."""
        self._missed = 0.0  # how far off its target the motor is sent, unknowing
        self._commands = 0
        begin = -0.5 / self.readout_hz
        self._motor: Trajectory = [(begin, float(start), 0.0, 0.0)]
        self._seat: Trajectory = self._motor[:]
        self._swing = np.zeros(2)
        self._read = np.empty(BLOCK)

    def command(self, to: float) -> None:
        """Send the lens to ``to``; it is in force after the actuator's latency, from now.

        Raises BadInput for a place outside the travel.
        """
        self._missed, self._motor, self._seat = self._sent(to)
        self.target = float(to)
        self._commands += 1

    def run(self, frames: int) -> np.ndarray:
        """Let so many readouts pass: where the lens is in the middle of each, float64 (frames,), 0...1.

        Raises BadInput for a negative number.
        """
        if frames < 0:
            raise BadInput(f"{frames} frames were to be run", allowed="0 or more")
        places = np.empty(frames)
        first, stop = self.frames, self.frames + frames
        if frames:
            omega = 2 * pi * self.actuator.resonance_hz
            pieces = np.array(_until(self._seat, (stop - 0.5) / self.readout_hz))
            passed = integrate_lens(
                pieces, self._swing, first, self.readout_hz, omega, self.actuator.damping, places
            )
            del self._seat[:passed]
            motor = self._motor_places(first, stop)
            self._keep(first, stop, places if self.actuator.reads == "lens" else motor)
        self.frames = stop
        return places

    def read_sensor(self, first: int, stop: int) -> np.ndarray:
        """What the position sensor reads at frames ``first <= t < stop`` that have passed, float64.

        With noise it may read a little outside 0...1. Raises BadInput for a window of other frames.
        """
        window = validate_window(first, stop, total=self.frames)
        read = self._read[window.start : window.stop].copy()
        if rms := self.actuator.position_noise_rms:
            blocks = range(window.start // BLOCK, (window.stop - 1) // BLOCK + 1)
            noise = np.concatenate([_normals(self.seed, "position", block) for block in blocks])
            begin = window.start - blocks.start * BLOCK
            read += rms * noise[begin : begin + len(window)]
        return read

    def resting_position(self, to: float | None = None) -> float:
        """Where the lens comes to rest if nothing else is commanded; ``to``: if it were sent there now.

        Backlash, steps and the missed place are in it. Raises BadInput for a place outside the travel.
        """
        seat = self._seat if to is None else self._sent(to)[2]
        return seat[-1][1]

    def is_settled(self, within: float) -> bool:
        """Whether the lens will never again be more than ``within`` off its resting place, uncommanded."""
        # One piece is left, the rest; and the energy of the swing only falls.
        return len(self._seat) == 1 and hypot(*self._swing) <= within

    def _sent(self, to: float) -> tuple[float, Trajectory, Trajectory]:
        """How far the motor misses, its course and the seat's if the lens were sent to ``to`` now."""
        _check_place("to", to)
        part = self.actuator
        place, missed = self._rounded(to), self._missed
        if part.place_rms:
            block, number = divmod(self._commands, BLOCK)
            error = float(_normals(self.seed, "place", block)[number])
            missed += part.place_rms * abs(place - self._rounded(self.target)) * error
            missed = min(max(place + missed, 0.0), 1.0) - place
        aim = min(max(place + missed, 0.0), 1.0)
        begin = self.frames / self.readout_hz + part.latency_s
        place, speed = state_at(self._motor, begin)
        motor = plan_move(aim, begin, place, speed, part.speed, part.acceleration)
        seat = apply_backlash(motor, state_at(self._seat, begin)[0], part.backlash)
        return missed, _until(self._motor, begin) + motor, _until(self._seat, begin) + seat

    def _rounded(self, place: float) -> float:
        """The place in whole steps of the motor, within the travel."""
        step = self.actuator.step
        if not step:
            return float(place)
        whole = floor(place / step + 0.5)
        return whole * step if whole * step <= 1 else (whole - 1) * step

    def _motor_places(self, first: int, stop: int) -> np.ndarray:
        times = (np.arange(first, stop) + 0.5) / self.readout_hz
        begins, places, speeds, accelerations = np.array(_until(self._motor, stop / self.readout_hz)).T
        piece = np.searchsorted(begins, times, side="right") - 1
        passed = times - begins[piece]
        del self._motor[: piece[-1]]
        return places[piece] + passed * (speeds[piece] + accelerations[piece] * passed / 2)

    def _keep(self, first: int, stop: int, read: np.ndarray) -> None:
        while stop > len(self._read):
            self._read = np.concatenate([self._read, np.empty_like(self._read)])
        self._read[first:stop] = read


def _until(course: Trajectory, seconds: float) -> Trajectory:
    """The pieces that begin before a time."""
    return course[: bisect_left(course, (seconds,))]


def _check_place(key: str, value: object) -> None:
    if isinstance(value, bool) or not (isinstance(value, Real) and 0 <= float(value) <= 1):
        raise BadInput(f"{key} is {value!r}", allowed="0 to 1, a fraction of the travel")


@lru_cache(maxsize=64)
def _normals(seed: int, purpose: str, block: int) -> np.ndarray:
    """Block ``block`` of a stream of normal numbers, read-only (BLOCK,)."""
    normals = make_generator("actuator", seed, purpose, block).standard_normal(BLOCK)
    normals.flags.writeable = False
    return normals
