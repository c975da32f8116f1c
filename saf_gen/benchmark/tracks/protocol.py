"""Protocol of the closed loop: the actuator, the budget and the sweep."""

import math
import re
from dataclasses import dataclass, replace
from functools import lru_cache

from saf_gen.benchmark.view.clock import Clock, clock_of
from saf_gen.benchmark.view.running_camera import REST_TOLERANCE
from saf_gen.errors import BadInput
from saf_gen.optics.actuators import ActuatedLens, Actuator, actuator_names, get_actuator
from saf_gen.stack.capture import Capture

MIN_FRAMES = 16
"""Shortest budget or sweep, in frames: two packets of the camera."""
MAX_RATE = 1e15
MAX_DURATION_S = 86_400.0
"""Longest budget or sweep, in seconds: one day, which is longer than any recording but safe to convert to frames."""
USUAL_S = 1.0
"""Usual budget, in seconds, where a recording without an end is too short for a sweep."""
MAX_ENDLESS_S = 20.0
"""Longest budget, in seconds, beyond a recording without an end; all readouts of a region are kept in memory."""


@dataclass(frozen=True)
class ClosedLoopProtocol:
    """The conditions that all methods of a closed-loop evaluation share.

    Parameters
    ----------
    actuator : Actuator
        Motor that moves the lens.
    budget_s : float, optional
        Time until the lens is judged, in seconds, above 0. By default it is the length of the recording, and a second
        or more if the actuator cannot sweep within it; for a moving scene, as long as it can be captured again.
    sweep_s : float, optional
        Duration of a sweep from end to end, in seconds, for searches that need one. By default it is half the budget,
        but at least what the actuator needs, and at most what is left after the lens has come to rest at the start of
        the sweep.
    operations_per_s : float, optional
        Rate at which the clock advances while a method computes, above 0: its declared operations divided by this. By
        default computing takes no time, as in records that state no rate.

    Raises
    ------
    BadInput
        If a time is not above 0, or is longer than MAX_DURATION_S.
    """

    actuator: Actuator
    budget_s: float | None = None
    sweep_s: float | None = None
    operations_per_s: float | None = None

    def __post_init__(self) -> None:
        for name, value in (("budget", self.budget_s), ("sweep", self.sweep_s)):
            if value is not None and not 0 < value <= MAX_DURATION_S:
                raise BadInput(f"the {name} is {value:g} s", allowed=f"seconds, above 0, at most {MAX_DURATION_S:g}")
        rate = self.operations_per_s
        if rate is not None and not 1 <= rate <= MAX_RATE:
            raise BadInput(f"{rate:g} operations per second", allowed=f"1 to {MAX_RATE:g}")

    def longest_frames(self, capture: Capture) -> int:
        """Return how many readouts the budget asks a capture for, at most those of MAX_ENDLESS_S."""
        if self.budget_s is None:
            return self.usual_frames(capture.frames, clock_of(capture))
        return round(min(self.budget_s, MAX_ENDLESS_S) * capture.sensor.readout_hz)

    def usual_frames(self, frames: int, clock: Clock) -> int:
        """Return the usual budget for a recording of this length without an end, in readouts.

        It is the length of the recording; if the actuator cannot sweep within it, a second or twice what it needs.
        """
        needed = self._count_sweep_frames(clock.readout_hz) + _simulate_rest_frames(self.actuator, clock)
        return frames if needed <= frames else max(round(USUAL_S * clock.readout_hz), 2 * needed)

    def count_frames(self, capture: Capture) -> tuple[int, int]:
        """Return the number of frames of the budget and of a sweep.

        Whether the actuator gets from end to end within a sweep is checked by ``check_sweep``, not here.

        Parameters
        ----------
        capture : Capture
            The recording that is captured again.

        Returns
        -------
        budget, sweep : int
            Numbers of frames.

        Raises
        ------
        BadInput
            If the camera cannot run in a closed loop, the budget is shorter than MIN_FRAMES or longer than can be
            captured, or a given sweep is shorter than MIN_FRAMES or longer than the budget.
        """
        hz = capture.sensor.readout_hz
        budget = capture.frames if self.budget_s is None else round(self.budget_s * hz)
        if not MIN_FRAMES <= budget <= capture.frames:
            end = capture.end
            raise BadInput(
                f"a budget of {_ms(budget, hz)} ms",
                allowed=f"{_ms(MIN_FRAMES, hz)} to {_ms(capture.frames, hz)} ms{end and ', '}{end}",
                hint=_name_ways_out(capture, needed=budget, budget=capture.frames)
                if end and budget > MIN_FRAMES
                else "",
            )
        if self.sweep_s is None:
            sweep = max(budget // 2, self._count_sweep_frames(hz))
            return budget, max(min(sweep, budget - self._count_rest_frames(capture)), 0)
        sweep = round(self.sweep_s * hz)
        if not MIN_FRAMES <= sweep <= budget:
            raise BadInput(
                f"a sweep of {_ms(sweep, hz)} ms",
                allowed=f"{_ms(MIN_FRAMES, hz)} ms to the budget of {_ms(budget, hz)} ms",
            )
        return budget, sweep

    def check_sweep(self, capture: Capture) -> None:
        """Raise BadInput if the actuator is too slow for the sweep that some methods are given.

        In a sweep that is too short, these methods would see only a part of the travel. The budget must also cover the
        time in which the lens comes to rest at the start of the sweep.
        """
        hz = capture.sensor.readout_hz
        budget, sweep = self.count_frames(capture)
        min_sweep, rest_frames = self._count_sweep_frames(hz), self._count_rest_frames(capture)
        max_sweep = budget - rest_frames
        if max_sweep < min_sweep:
            raise BadInput(
                f"the actuator {self.actuator.label} needs {_ms(rest_frames + min_sweep, hz)} ms for a sweep: "
                f"{_ms(rest_frames, hz)} until it rests where the sweep begins, {_ms(min_sweep, hz)} from end to end",
                allowed=f"at most the budget of {_ms(budget, hz)} ms",
                hint=_name_ways_out(capture, needed=rest_frames + min_sweep, budget=budget)
                + ", or run only methods that command the lens",
            )
        if not min_sweep <= sweep <= max_sweep:
            raise BadInput(
                f"a sweep of {_ms(sweep, hz)} ms with the actuator {self.actuator.label}",
                allowed=f"{_ms(min_sweep, hz)} ms, in which it gets from end to end, to {_ms(max_sweep, hz)} ms: the "
                f"budget of {_ms(budget, hz)} less {_ms(rest_frames, hz)} until it rests where the sweep begins",
                hint="choose another --sweep or a faster --actuator",
            )

    def describe(self, capture: Capture) -> str:
        """Return the protocol on one line, for records; it says ``no sweep`` if a sweep is impossible."""
        hz = capture.sensor.readout_hz
        budget, sweep = self.count_frames(capture)
        sweep_fits = self._count_sweep_frames(hz) <= sweep <= budget - self._count_rest_frames(capture)
        sweep_text = f"sweep {_ms(sweep, hz)} ms" if sweep_fits else "no sweep"
        computing = f", {self.operations_per_s:g} op/s" if self.operations_per_s else ""
        return f"{self.actuator.label}, {_ms(budget, hz)} ms, {sweep_text}{computing}"

    @staticmethod
    def rate_in(terms: str) -> float | None:
        """Return the operations per second in the ``terms`` of a record, None if computing took no time."""
        found = re.search(r", (\S+) op/s$", terms)
        return float(found[1]) if found else None

    def _count_sweep_frames(self, hz: float) -> int:
        """Return the length of the shortest sweep, in frames: latency, motion, and the trailing of the lens."""
        frames = self.actuator.end_to_end_s * hz
        return max(MIN_FRAMES, math.ceil(frames - 0.01))  # 500.007 counts as 500

    def _count_rest_frames(self, capture: Capture) -> int:
        """Return the number of frames until a lens that starts at the middle of the travel rests at an end."""
        return _simulate_rest_frames(self.actuator, clock_of(capture))


@lru_cache(maxsize=64)
def _simulate_rest_frames(actuator: Actuator, clock: Clock) -> int:
    lens = ActuatedLens(replace(actuator, place_rms=0.0), start=0.5, readout_hz=clock.lens_hz, seed=0)
    lens.command(0.0)
    check = clock.rest_check
    frames = int((actuator.latency_s + actuator.move_s(0.5)) * clock.readout_hz) // check * check
    lens.run(frames * clock.steps)  # the lens cannot rest before the motor has arrived
    while not lens.is_settled(REST_TOLERANCE):
        step = max(check, frames // 100)  # an actuator that takes minutes is checked less often
        lens.run(step * clock.steps)
        frames += step
    return frames


def _name_ways_out(capture: Capture, *, needed: int, budget: int) -> str:
    """Return what gives a method the frames that it needs, and the drives that sweep within the budget, in frames."""
    hz = capture.sensor.readout_hz
    if not capture.end:
        longer = f"choose a --budget of {_ms(needed, hz)} or more"
    elif needed <= len(capture.gain):
        longer = f"state render: {{whole_slices: {needed / hz:g}}} in the recipe"
    else:
        longer = f"state camera: {{frames: {needed}}} in the recipe"
    in_time = []
    for name in actuator_names():
        drive = ClosedLoopProtocol(get_actuator(name))
        left = budget - drive._count_sweep_frames(hz)
        if left > 0 and drive._count_rest_frames(capture) <= left:
            in_time.append(name)
    return longer + (f", or take an --actuator that sweeps in time ({', '.join(in_time)})" if in_time else "")


def _ms(frames: int, hz: float) -> str:
    return f"{frames / hz * 1e3:g}"
