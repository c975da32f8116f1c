"""Actuators, which move a lens: frozen values read from ``presets/<name>.yaml`` or from a user's own file."""

import hashlib
from dataclasses import asdict
from functools import cache
from math import pi, sqrt
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from saf_gen.core.config.presets import Presets, Sources, Text, between


# The ranges refuse a latency in milliseconds or a fraction in percent, and leave room for an ideal lens.
@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Actuator:
    """What stands between a command and the position of the lens, in fractions of the travel and seconds.

    A command goes through five stages, in this order:

    latency_s : delay from a command to its effect; until then the previous command stays in force.
    step : the commanded position is rounded to the nearest whole multiple; 0 for no steps.
    place_rms : a move is too long or too short by a normal error of this rms, a fraction of its length. The
        motor does not know it: the errors add up from move to move, up to an end of the travel.
    speed, acceleration : the motor moves as fast as both allow and brakes to rest.
    backlash : total play between motor and lens. The lens stays until half of it is taken up in the direction
        of the move, then trails the motor by that half; so it comes to rest half the play short of the
        position, on the side that it came from.
    resonance_hz, damping : the lens x follows y, what pulls it, by x″ + 2ζω·x′ + ω²·x = ω²·y with
        ω = 2π·resonance_hz. Below ζ = 1 it rings at resonance_hz·√(1 - ζ²).

    A stop at each end of the travel takes all speed.

    reads : what the position sensor reads: the ``lens``, or the ``motor``, which knows nothing of play and
        ringing (counted steps, a commanded current).
    position_noise_rms : white noise of the position sensor, drawn anew at each readout of the camera.

    A value that is not allowed raises BadInput from :func:`get_actuator`, and a ValueError from the
    constructor and from ``dataclasses.replace``.

    Reference for the oscillator: K. Ogata, Modern Control Engineering, 5th edition, 2010, section 5-3.
    """

    name: Text
    speed: Annotated[float, between(1e-3, 1e6, unit="travels per second")]
    acceleration: Annotated[float, between(1e-3, 1e12, unit="travels per second squared")]
    resonance_hz: Annotated[float, between(0.1, 1e6, unit="hertz")]
    damping: Annotated[float, between(0.01, 10, unit="of the critical damping")]
    backlash: Annotated[float, between(0, 0.2, unit="of the travel")]
    step: Annotated[float, between(0, 0.1, unit="of the travel, 0 for no steps")]
    place_rms: Annotated[float, between(0, 0.3, unit="of the move")]
    reads: Literal["lens", "motor"]
    position_noise_rms: Annotated[float, between(0, 0.1, unit="of the travel")]
    latency_s: Annotated[float, between(0, 1, unit="seconds")]
    sources: Sources

    @property
    def label(self) -> str:
        """The name, if all numbers are those of the preset of that name; otherwise with a digest of them.

        ``voice_coil``, or ``voice_coil (own, 1a2b3c4d5e6f)``: two actuators with one label move a lens alike,
        whatever their sources say.
        """
        if self.name in actuator_names() and _preset(self.name)._numbers() == self._numbers():
            return self.name
        return f"{self.name} (own, {hashlib.sha256(self._numbers().encode()).hexdigest()[:12]})"

    def _numbers(self) -> str:
        """Return all that moves the lens as text; 1 and 1.0 are the same number, and so are 0 and -0."""
        return "\n".join(
            f"{key} {value if isinstance(value, str) else repr(float(value) + 0.0)}"
            for key, value in asdict(self).items()
            if key not in ("name", "sources")
        )

    def move_s(self, distance: float) -> float:
        """Return the seconds of a move of the motor from rest to rest, without latency and settling."""
        if distance * self.acceleration < self.speed**2:
            return 2 * sqrt(distance / self.acceleration)
        return distance / self.speed + self.speed / self.acceleration

    @property
    def end_to_end_s(self) -> float:
        """Seconds of the shortest sweep: latency, the motor from end to end, and the lens behind it.

        Half a cycle of the resonance is added to what ``command_sweep_s`` leaves for the lens, because a fast
        motor is a jump to it.
        """
        return self.latency_s + self.move_s(1) + 3 * self._behind_s + 1 / (2 * self.resonance_hz)

    def command_sweep_s(self, sweep_s: float) -> float:
        """Return the seconds in which commands run evenly from end to end so that the lens takes ``sweep_s``.

        The commands, at a speed v, reach the end before the lens does: by its latency, by the time v/a in
        which the motor brakes, and by three times 2ζ/ω, in which the lens makes up what it trails. A sweep
        shorter than ``end_to_end_s`` is commanded like that one.
        """
        left = max(sweep_s, self.end_to_end_s) - self.latency_s - 3 * self._behind_s
        return (left + sqrt(max(left * left - 4 / self.acceleration, 0.0))) / 2

    @property
    def sensor_lead_s(self) -> float:
        """Seconds by which a steadily moving lens trails its sensor's reading; 0 for a sensor at the lens."""
        return 0.0 if self.reads == "lens" else self._behind_s

    @property
    def _behind_s(self) -> float:
        """Seconds by which the lens trails a steady motor: 2ζ/ω of the oscillator."""
        return self.damping / (pi * self.resonance_hz)

    @property
    def lag_s(self) -> float:
        """Seconds in which the distance between lens and motor, unseen by the sensor, falls to 1/e.

        0 for a sensor that reads the lens. It follows from the slower root of the oscillator's equation; play
        is not included.
        """
        if self.reads == "lens":
            return 0.0
        slowed = self.damping - sqrt(max(self.damping**2 - 1, 0.0))
        return 1 / (2 * pi * self.resonance_hz * slowed)


PRESETS = Presets("actuator", Actuator, folder=Path(__file__).parent / "presets")


def actuator_names() -> list[str]:
    """Return the names of the actuators that come with saf_gen, sorted."""
    return PRESETS.names()


def get_actuator(name: str | Path, **changes: Any) -> Actuator:
    """Return an actuator by name, or from a YAML file of one's own, with some fields changed.

    ``get_actuator("voice_coil", damping=0.2)``

    Raises BadInput for an unknown name or field, and for a value that is not allowed.
    """
    return PRESETS.get(name, changes)


_preset = cache(get_actuator)
