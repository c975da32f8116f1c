"""Actuators, which move a lens: immutable values read from ``presets/<name>.yaml`` or from a user's file."""

import hashlib
from dataclasses import asdict
from functools import cache, partial
from math import pi, sqrt
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from saf_gen.core.config.document import validate_document
from saf_gen.core.config.presets import Presets, Sources, Text, between


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Drift:
    """The drift of a lens by heat, towards an offset that depends on its temperature.

    The lens is per_k·(ambient_k + heating_k·q) away from where its current would put it if it were as warm as when its
    travel was measured. A current i, as a fraction of the largest, warms it by i²: q′ = (i² - q)/time_s, which is
    Newton's law of cooling. First q is in balance with the current.

    Parameters
    ----------
    per_k : float
        Change of position per kelvin, as a fraction of the travel.
    ambient_k : float
        Kelvins by which the surroundings are warmer than they were when the travel was measured.
    heating_k : float
        Kelvins by which the largest current warms the lens in the end.
    time_s : float
        Seconds in which 63 % of a change of temperature are over.
    """

    per_k: Annotated[float, between(-0.05, 0.05, unit="of the travel per kelvin")]
    ambient_k: Annotated[float, between(-60, 60, unit="kelvins")]
    heating_k: Annotated[float, between(0, 100, unit="kelvins")]
    time_s: Annotated[float, between(0.1, 1e5, unit="seconds")]


# The ranges reject a latency in milliseconds or a fraction in percent, but allow an ideal lens.
@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Actuator:
    """The mechanism between a command and the position of the lens, in fractions of the travel and seconds.

    A command passes through these stages: latency, rounding to steps, positioning error, motion of the motor,
    hysteresis, backlash, oscillation of the lens, and drift. A stop at each end of the travel absorbs all speed.
    :func:`get_actuator` raises BadInput for a value that is not allowed; the constructor and ``dataclasses.replace``
    raise a ValueError.

    Parameters
    ----------
    name : str
        Name of the actuator.
    speed, acceleration : float
        Limits of the motor, in travels per second and per second squared. It moves as fast as both allow, and brakes to
        rest.
    resonance_hz, damping : float
        The lens at x follows its seat at y by x″ + 2ζω·x′ + ω²·x = ω²·y, with ω = 2π·resonance_hz and the damping ζ.
        Below ζ = 1 it rings at resonance_hz·√(1 - ζ²).
    backlash : float
        Total play between motor and lens. The lens stays until half of the play is taken up in the direction of the
        move, and then trails the motor by that half. It therefore comes to rest half the play short of the position, on
        the side from which it came. A coil against springs of the stiffness k that rub with the force F has this
        hysteresis, 2F/k wide.
    step : float
        The commanded position is rounded to the nearest multiple of this step; 0 for no steps.
    place_rms : float
        Rms of the positioning error, as a fraction of the length of a move: each move is too long or too short by a
        normal error. The controller does not know the errors, which add up from move to move, up to an end of the
        travel.
    reads : str
        Part that the position sensor reads: the ``lens``, or the ``motor``, as with counted steps or a commanded
        current or voltage, which shows neither play, hysteresis nor drift, and no ringing.
    position_noise_rms : float
        Rms of the white noise of the position sensor, independent at each readout of the camera.
    latency_s : float
        Delay from a command to its effect; until then the previous command remains in force.
    sources : tuple of str
        Sources of the numbers.
    hysteresis : float, default 0
        Width of the loop of position over command, in the middle of the travel, if the commands go from end to end, as
        a fraction of the travel; :mod:`saf_gen.optics.actuators.hysteresis` is the model.
    drift : Drift, optional
        Drift by heat; by default none.

    References
    ----------
    K. Ogata, Modern Control Engineering, 5th edition, 2010, section 5-3 (the oscillator).
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
    hysteresis: Annotated[float, between(0, 0.3, unit="of the travel")] = 0.0
    drift: Drift | None = None

    @property
    def label(self) -> str:
        """The name if all numbers equal those of the preset; otherwise the name with a digest of the numbers.

        Examples are ``voice_coil`` and ``voice_coil (own, 1a2b3c4d5e6f)``. Two actuators with the same label move a
        lens in the same way, whatever their sources say.
        """
        if self.name in actuator_names() and _preset(self.name)._numbers() == self._numbers():
            return self.name
        return f"{self.name} (own, {hashlib.sha256(self._numbers().encode()).hexdigest()[:12]})"

    def _numbers(self) -> str:
        """Return everything that affects the motion as text, in which 1 equals 1.0 and 0 equals -0.

        Keys that came later are left out where they have no effect, so that older labels stay as they are.
        """
        held = {key: value for key, value in asdict(self).items() if key not in ("name", "sources", "drift")}
        if not self.hysteresis:
            del held["hysteresis"]
        held |= {} if self.drift is None else {f"drift.{key}": value for key, value in asdict(self.drift).items()}
        return "\n".join(
            f"{key} {value if isinstance(value, str) else repr(float(value) + 0.0)}" for key, value in held.items()
        )

    def move_s(self, distance: float) -> float:
        """Return the time, in seconds, of a move of the motor from rest to rest, without latency and settling."""
        if distance * self.acceleration < self.speed**2:
            return 2 * sqrt(distance / self.acceleration)
        return distance / self.speed + self.speed / self.acceleration

    @property
    def end_to_end_s(self) -> float:
        """Seconds of the shortest sweep: latency, motion of the motor from end to end, and settling of the lens.

        Half a cycle of the resonance is added to the settling time that ``command_sweep_s`` allows, because the lens
        responds to a fast motor as to a jump.
        """
        return self.latency_s + self.move_s(1) + 3 * self._trail_s + 1 / (2 * self.resonance_hz)

    def command_sweep_s(self, sweep_s: float) -> float:
        """Return the duration, in seconds, of uniform commands from end to end for which the lens takes ``sweep_s``.

        If commands move at a speed v, the lens reaches the end later: by the latency, by the time v/a in which the
        motor brakes, and by three times 2ζ/ω, in which the lens catches up with the motor. A ``sweep_s`` shorter than
        ``end_to_end_s`` is replaced by ``end_to_end_s``.
        """
        left = max(sweep_s, self.end_to_end_s) - self.latency_s - 3 * self._trail_s
        return (left + sqrt(max(left * left - 4 / self.acceleration, 0.0))) / 2

    @property
    def sensor_lead_s(self) -> float:
        """Seconds by which a uniformly moving lens trails its sensor reading; 0 if the sensor reads the lens."""
        return 0.0 if self.reads == "lens" else self._trail_s

    @property
    def _trail_s(self) -> float:
        """Seconds by which the lens trails a uniformly moving motor: 2ζ/ω of the oscillator."""
        return self.damping / (pi * self.resonance_hz)

    @property
    def lag_s(self) -> float:
        """Seconds in which the distance between lens and motor falls to 1/e; 0 if the sensor reads the lens.

        A sensor that reads the motor does not see this distance. The time follows from the slower root of the
        oscillator's equation; play is not included.
        """
        if self.reads == "lens":
            return 0.0
        slowed = self.damping - sqrt(max(self.damping**2 - 1, 0.0))
        return 1 / (2 * pi * self.resonance_hz * slowed)


PRESETS = Presets("actuator", partial(validate_document, Actuator), folder=Path(__file__).parent / "presets")


def actuator_names() -> list[str]:
    """Return the names of the actuators that come with saf_gen, sorted."""
    return PRESETS.names()


def get_actuator(name: str | Path, **changes: Any) -> Actuator:
    """Return an actuator by name or from a user's YAML file, with some fields changed.

    Parameters
    ----------
    name : str or Path
        A name of :func:`actuator_names`, or the path of a .yaml file.
    **changes : optional
        Fields of :class:`Actuator` and their new values, as in ``get_actuator("voice_coil", damping=0.2)``.

    Returns
    -------
    Actuator
        The actuator.

    Raises
    ------
    BadInput
        If a name or field is unknown, or a value is not allowed.
    """
    return PRESETS.get(name, changes)


_preset = cache(get_actuator)
