"""The terms of the closed loop: what moves the lens, how long it may take."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

from saf_gen.benchmark.view.running_camera import REST_CHECK_FRAMES, REST_TOLERANCE
from saf_gen.errors import BadInput
from saf_gen.optics.actuators import ActuatedLens, Actuator
from saf_gen.stack.capture import Capture

__all__ = ["ClosedLoopProtocol"]

MIN_FRAMES = 16
"""Frames of a budget, and of a sweep: two packets of the camera."""
MAX_DURATION_S = 86_400.0
"""A day: more than anybody records, and few enough frames to count."""


@dataclass(frozen=True)
class ClosedLoopProtocol:
    """What is the same for all methods.

    ``budget_s``: time until the lens is judged; None is as long as the recording can be filmed, and its most.
    ``sweep_s``: time of a sweep from end to end, for searches that need one; None is half the budget, more
    where the drive needs more, less where the lens rests too late at the end where it begins.

    Raises BadInput for a time that no recording could keep.
    """

    actuator: Actuator
    budget_s: float | None = None
    sweep_s: float | None = None

    def __post_init__(self) -> None:
        for name, value in (("budget", self.budget_s), ("sweep", self.sweep_s)):
            if value is not None and not 0 < value <= MAX_DURATION_S:
                raise BadInput(
                    f"the {name} is {value:g} s", allowed=f"seconds, above 0, at most {MAX_DURATION_S:g}"
                )

    def count_frames(self, take: Capture) -> tuple[int, int]:
        """Frames of the budget and of a sweep. Raises BadInput for more than can be filmed.

        Whether the drive gets from end to end in a sweep is another matter: see ``check_sweep``.
        """
        hz = take.sensor.readout_hz
        budget = take.frames if self.budget_s is None else round(self.budget_s * hz)
        if not MIN_FRAMES <= budget <= take.frames:
            raise BadInput(
                f"a budget of {_ms(budget, hz)}",
                allowed=f"{_number(MIN_FRAMES, hz)} to {_ms(take.frames, hz)}, "
                + (
                    "as long as was recorded"
                    if take.frames == len(take.gain)
                    else "as long as its time slices hold all focus positions"
                ),
            )
        if self.sweep_s is None:
            return budget, max(min(max(budget // 2, self._end_to_end(hz)), budget - self._to_begin(hz)), 0)
        sweep = round(self.sweep_s * hz)
        if not MIN_FRAMES <= sweep <= budget:
            raise BadInput(
                f"a sweep of {_ms(sweep, hz)}",
                allowed=f"{_ms(MIN_FRAMES, hz)} to the budget of {_ms(budget, hz)}",
            )
        return budget, sweep

    def check_sweep(self, take: Capture) -> None:
        """For methods that are given a sweep. Raises BadInput where the drive is too slow for it.

        A sweep that ends before the lens could have been everywhere would show such a method a part of the
        travel, and one that commands the lens all of it; and where the lens comes to the end that it starts
        from too late, the budget is spent before the sweep is over.
        """
        hz = take.sensor.readout_hz
        (budget, sweep), least, before = self.count_frames(take), self._end_to_end(hz), self._to_begin(hz)
        most = budget - before
        if most < least:
            to_begin, across = _number(before, hz), _number(least, hz)
            raise BadInput(
                f"the actuator {self.actuator.label} needs {_ms(before + least, hz)} for a sweep: "
                f"{to_begin} until it rests where that begins, {across} from end to end",
                allowed=f"at most the budget of {_ms(budget, hz)}",
                hint="record longer, take a quicker --actuator, or run only methods that command the lens",
            )
        if not least <= sweep <= most:
            raise BadInput(
                f"a sweep of {_ms(sweep, hz)} with the actuator {self.actuator.label}",
                allowed=f"{_ms(least, hz)}, in which it gets from end to end, to {_ms(most, hz)}, the budget "
                f"of {_ms(budget, hz)} less {_number(before, hz)} until it rests where the sweep begins",
                hint="give another --sweep, or take a quicker --actuator",
            )

    def describe(self, take: Capture) -> str:
        """All of it in one line, as records carry it; a sweep that the drive cannot make is none."""
        hz = take.sensor.readout_hz
        budget, sweep = self.count_frames(take)
        whole = self._end_to_end(hz) <= sweep <= budget - self._to_begin(hz)
        swept = f"sweep {_ms(sweep, hz)}" if whole else "no sweep"
        return f"{self.actuator.label}, {_ms(budget, hz)}, {swept}"

    def _end_to_end(self, hz: float) -> int:
        """Frames of the shortest sweep: until a command is in force, and the lens at the other end."""
        frames = self.actuator.end_to_end_s * hz
        return max(MIN_FRAMES, math.ceil(frames - 0.01))  # 500.007 frames are 500

    def _to_begin(self, hz: float) -> int:
        """Frames until the lens rests at the nearer end, from the middle of the travel."""
        return _to_rest(self.actuator, hz)


@lru_cache(maxsize=64)
def _to_rest(actuator: Actuator, hz: float) -> int:
    lens = ActuatedLens(replace(actuator, place_rms=0.0), start=0.5, readout_hz=hz, seed=0)
    lens.command(0.0)
    frames = int((actuator.latency_s + actuator.move_s(0.5)) * hz) // REST_CHECK_FRAMES * REST_CHECK_FRAMES
    lens.run(frames)  # not before the motor is there
    while not lens.is_settled(REST_TOLERANCE):
        step = max(
            REST_CHECK_FRAMES, frames // 100
        )  # of a drive that takes minutes nobody looks at every millisecond
        lens.run(step)
        frames += step
    return frames


def _number(frames: int, hz: float) -> str:
    return f"{frames / hz * 1e3:g}"


def _ms(frames: int, hz: float) -> str:
    return f"{_number(frames, hz)} ms"
