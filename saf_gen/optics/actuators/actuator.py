"""Actuators: what moves a lens, as a frozen value read from ``presets/<name>.yaml``."""

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from functools import cache
from math import isfinite, pi, sqrt
from pathlib import Path
from typing import Any

from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.errors import BadInput, closest, unknown

__all__ = ["Actuator", "actuator_names", "get_actuator", "is_actuator_file"]

_FOLDER = Path(__file__).parent / "presets"

# Least and most of every number, both allowed, and its unit. They refuse a latency in milliseconds or a
# share in percent, and leave room for a lens that obeys at once.
_RANGES: dict[str, tuple[float, float, str]] = {
    "speed": (1e-3, 1e6, "travels a second"),
    "acceleration": (1e-3, 1e12, "travels a second squared"),
    "resonance_hz": (0.1, 1e6, "hertz"),
    "damping": (0.01, 10, "of the critical damping"),
    "backlash": (0, 0.2, "of the travel"),
    "step": (0, 0.1, "of the travel, 0 for none"),
    "place_rms": (0, 0.3, "of the move"),
    "position_noise_rms": (0, 0.1, "of the travel"),
    "latency_s": (0, 1, "seconds"),
}
_READS = ("lens", "motor")


@dataclass(frozen=True)
class Actuator:
    """What stands between a command and the place of the lens. Places are fractions of the travel.

    A command goes through five stages, in this order:

    latency_s : it is in force so many seconds after it was given; the one before is in force until then.
    step : the place is rounded to the nearest whole multiple; 0 for none.
    place_rms : a move is too long or too short by a normal error of this rms, a fraction of its length. The
        motor does not know; its misses add up from move to move, until it comes to an end of the travel.
    speed, acceleration : the motor goes there by the fastest way within both, and brakes to rest.
    backlash : play between motor and lens, in all: the lens stays until half of it is taken up in the
        direction of the move, then trails the motor by that half. So it rests half the play short of a place,
        on the side that it came from.
    resonance_hz, damping : the lens x follows what pulls it, y, by x″ + 2ζω·x′ + ω²·x = ω²·y with
        ω = 2π·resonance_hz. Below ζ = 1 it rings at resonance_hz·√(1 - ζ²).

    At both ends of the travel is a stop that takes all speed.

    reads : what the position sensor reads: the ``lens``, or the ``motor``, of whose play and ringing it
        knows nothing (counted steps, a commanded current).
    position_noise_rms : its white noise, anew at each readout of the camera.

    Source of the oscillator: K. Ogata, Modern Control Engineering, 5th edition, 2010, section 5-3.

    Raises BadInput for a value that is not allowed, however the actuator is made.
    """

    name: str
    speed: float
    acceleration: float
    resonance_hz: float
    damping: float
    backlash: float
    step: float
    place_rms: float
    reads: str
    position_noise_rms: float
    latency_s: float
    sources: tuple[str, ...]

    def __post_init__(self) -> None:
        for key in _KEYS:
            _check(key, getattr(self, key), f"actuator {self.name}")

    @property
    def label(self) -> str:
        """The name, where all numbers are those of the preset of that name; else with a digest of them.

        ``voice_coil``, or ``voice_coil (own, 1a2b3c4d5e6f)``: two drives of one label move a lens alike,
        whatever their sources say.
        """
        preset = _preset(self.name) if self.name in actuator_names() else None
        if preset is not None and preset._numbers() == self._numbers():
            return self.name
        return f"{self.name} (own, {hashlib.sha256(self._numbers().encode()).hexdigest()[:12]})"

    def _numbers(self) -> str:
        """All that moves the lens, as text; 1 and 1.0 are the same number, and so are 0 and -0."""
        said = {key: getattr(self, key) for key in _KEYS if key not in ("name", "sources")}
        return "\n".join(
            f"{key} {value if isinstance(value, str) else repr(float(value) + 0.0)}"
            for key, value in said.items()
        )

    def move_s(self, distance: float) -> float:
        """Seconds in which the motor, from rest to rest, goes so far; latency and settling are not in it."""
        if distance * self.acceleration < self.speed**2:
            return 2 * sqrt(distance / self.acceleration)
        return distance / self.speed + self.speed / self.acceleration

    @property
    def end_to_end_s(self) -> float:
        """Seconds of the shortest sweep: latency, the motor from end to end, the lens behind it.

        It gets half a cycle of its resonance more than ``command_sweep_s`` gives it: a quick motor is a jump
        to it.
        """
        return self.latency_s + self.move_s(1) + 3 * self._behind_s + 1 / (2 * self.resonance_hz)

    def command_sweep_s(self, sweep_s: float) -> float:
        """Seconds in which commands go evenly from end to end, so that the lens arrives in ``sweep_s``.

        The commands come to the end before the lens, at a speed v, by its latency, the time v/a in which the
        motor brakes, and three times 2ζ/ω, in which the lens makes up what it trails. A sweep of less than
        ``end_to_end_s`` is led like that one.
        """
        left = max(sweep_s, self.end_to_end_s) - self.latency_s - 3 * self._behind_s
        return (left + sqrt(max(left * left - 4 / self.acceleration, 0.0))) / 2

    @property
    def sensor_lead_s(self) -> float:
        """Seconds by which the lens, led steadily, trails what its sensor reads; 0 for one at the lens."""
        return 0.0 if self.reads == "lens" else self._behind_s

    @property
    def _behind_s(self) -> float:
        """Seconds by which the lens trails a steady motor: 2ζ/ω of the oscillator."""
        return self.damping / (pi * self.resonance_hz)

    @property
    def lag_s(self) -> float:
        """Seconds in which the way between lens and motor, unseen by the sensor, falls to 1/e.

        0 where it reads the lens. By the slower root of the oscillator's equation; play is not in it.
        """
        if self.reads == "lens":
            return 0.0
        slowed = self.damping - sqrt(max(self.damping**2 - 1, 0.0))
        return 1 / (2 * pi * self.resonance_hz * slowed)


_KEYS = tuple(f.name for f in fields(Actuator))


def actuator_names() -> list[str]:
    """The actuators that come with saf_gen, sorted."""
    return sorted(p.stem for p in _FOLDER.glob("*.yaml"))


def is_actuator_file(name: str | Path) -> bool:
    """Whether this is the path of an actuator's file, and no actuator's name."""
    return Path(name).suffix in (".yaml", ".yml")


def get_actuator(name: str | Path, **changes: Any) -> Actuator:
    """The actuator ``name``, or the one in your own YAML file, with some keys changed.

    ``get_actuator("voice_coil", damping=0.2)``

    Raises BadInput for an unknown name or key and for a value that is not allowed.
    """
    if is_actuator_file(name):
        path = Path(name)
    elif str(name) in actuator_names():
        path = _FOLDER / f"{name}.yaml"
    else:
        raise unknown("actuator", name, actuator_names(), hint="or give the path of a .yaml file")
    document = read_yaml(path)
    if not isinstance(document.data, dict):
        raise BadInput("the file holds no keys", where=str(path), allowed=", ".join(_KEYS))
    card: dict[str, Any] = document.data
    _check_keys(card, document.locate)
    for key in _KEYS:
        if key not in card:
            raise BadInput(f"the actuator key {key!r} is missing", where=document.locate())
        _check(key, card[key], document.locate(key))
    actuator = Actuator(**card | {"sources": tuple(card["sources"])})
    _check_keys(changes, lambda key: f"actuator {name}")
    return replace(actuator, **changes)


@cache
def _preset(name: str) -> Actuator:
    return get_actuator(name)


def _check_keys(given: Iterable[str], where: Callable[[str], str]) -> None:
    for key in given:
        if key not in _KEYS:
            raise unknown("actuator key", key, _KEYS, where=where(key))


def _check(key: str, value: Any, where: str) -> None:
    if key in _RANGES:
        least, most, unit = _RANGES[key]
        number = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
        if not (number and least <= value <= most):
            raise BadInput(
                f"{key} is {value!r}",
                where=where,
                allowed=f"{least:g} to {most:g} {unit}",
                hint="YAML reads 1e-5 as text: write 1.0e-5" if isinstance(value, str) else "",
            )
    elif key == "reads":
        if value not in _READS:
            near = closest(value, _READS)
            raise BadInput(f"reads is {value!r}", where=where, allowed=", ".join(_READS), nearest=near)
    elif key == "name":
        if not (isinstance(value, str) and value.strip()):
            raise BadInput(f"name is {value!r}", where=where, allowed="a text")
    elif not (
        isinstance(value, list | tuple) and value and all(isinstance(s, str) and s.strip() for s in value)
    ):
        raise BadInput(f"sources is {value!r}", where=where, allowed="a list of at least one text")
