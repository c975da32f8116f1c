"""The terms of the closed loop: what moves the lens, how long it may take."""

import math
from dataclasses import dataclass

from saf_gen.actuators import Actuator
from saf_gen.errors import BadInput
from saf_gen.take import Take

__all__ = ["Terms"]


@dataclass(frozen=True)
class Terms:
    """What is the same for all methods.

    ``budget_s``: time until the lens is judged; None is the length of the recording, and its most.
    ``sweep_s``: time of a sweep from end to end, for searches that need one; None is half the budget.
    """

    actuator: Actuator
    budget_s: float | None = None
    sweep_s: float | None = None

    def __post_init__(self) -> None:
        for name, value in (("budget", self.budget_s), ("sweep", self.sweep_s)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise BadInput(f"the {name} is {value:g} s", allowed="seconds, above 0")

    def frames(self, take: Take) -> tuple[int, int]:
        """Frames of the budget and of a sweep. Raises BadInput for more than the recording has."""
        hz = take.sensor.readout_hz
        budget = take.frames if self.budget_s is None else round(self.budget_s * hz)
        if not 16 <= budget <= take.frames:
            raise BadInput(
                f"a budget of {budget / hz * 1e3:g} ms",
                allowed=f"{16 / hz * 1e3:g} to {take.frames / hz * 1e3:g} ms, as long as was recorded",
            )
        sweep = budget // 2 if self.sweep_s is None else round(self.sweep_s * hz)
        if not 16 <= sweep <= budget:
            raise BadInput(
                f"a sweep of {sweep / hz * 1e3:g} ms",
                allowed=f"{16 / hz * 1e3:g} ms to the budget of {budget / hz * 1e3:g} ms",
            )
        return budget, sweep

    def describe(self, take: Take) -> str:
        """All of it in one line, as records carry it."""
        hz = take.sensor.readout_hz
        budget, sweep = self.frames(take)
        return f"{self.actuator.name}, {budget / hz * 1e3:g} ms, sweep {sweep / hz * 1e3:g} ms"
