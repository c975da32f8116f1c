"""Sensors: what a spike camera is, as a frozen value read from ``sensors/<name>.yaml``."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from math import isfinite
from pathlib import Path
from typing import Any

from saf_gen.core.config.document import Document
from saf_gen.core.config.yaml_document import parse_yaml, read_yaml
from saf_gen.errors import BadInput, closest, unknown

__all__ = ["NoiseSwitches", "Sensor", "get_sensor", "is_sensor_file", "sensor_from_text", "sensor_names"]

_FOLDER = Path(__file__).parent / "sensors"

# Least and most of every number, both allowed, and its unit. The ranges are wide, and narrow enough to
# refuse a pitch in micrometres, a wavelength in nanometres or an rms in percent.
_RANGES: dict[str, tuple[float, float, str]] = {
    "rows": (1, 16_384, "pixels"),
    "columns": (1, 16_384, "pixels"),
    "pitch_m": (2e-7, 1e-3, "metres"),
    "readout_hz": (1, 1e7, "hertz"),
    "threshold_e": (1e-3, 1e7, "electrons"),
    "quantum_efficiency": (1e-4, 1, "electrons a photon"),
    "fill_factor": (1e-4, 1, "of the pixel's area"),
    "wavelength_m": (1e-7, 1e-5, "metres"),
    "reset_loss": (0, 1, "of the next readout's charge"),
    "dark_rate": (0, 0.5, "spikes a readout"),
    "dark_log_sd": (0, 2, "(standard deviation of the natural logarithm)"),
    "dark_hot_fraction": (0, 0.1, "of all pixels"),
    "dark_hot_factor": (1, 1000, "times the median"),
    "response_column_rms": (0, 0.3, "of the mean"),
    "response_row_rms": (0, 0.3, "of the mean"),
    "response_white_rms": (0, 0.3, "of the mean"),
    "threshold_spread_rms": (0, 0.2, "of the mean"),
    "threshold_noise_rms": (0, 0.2, "of the threshold"),
}
_CHOICES = {"reset": ("subtract", "hard"), "saturation": ("subtract", "dead_readout")}


@dataclass(frozen=True)
class NoiseSwitches:
    """Which imperfections act; each is switched alone, and its numbers stay in the sensor.

    shot : Poisson electrons; the charge between two spikes has variance threshold (e-²).
    dark : dark current, log-normal between pixels, with hot pixels.
    response : photo-response non-uniformity, smooth column and row profiles and a white rest.
    threshold_spread : thresholds differ between pixels, once and for all.
    threshold_noise : the threshold is drawn anew at each spike.
    """

    shot: bool
    dark: bool
    response: bool
    threshold_spread: bool
    threshold_noise: bool

    def __post_init__(self) -> None:
        for term, value in asdict(self).items():
            if not isinstance(value, bool):
                raise BadInput(f"noise.{term} is {value!r}", allowed="true or false")


@dataclass(frozen=True)
class Sensor:
    """A spike camera's array: geometry, conversion of light to charge, spiking, and noise.

    Lengths in metres, charge in electrons, rms values as a fraction of the mean.

    wavelength_m : light is turned to electrons at this one wavelength.
    reset : a spike takes the threshold off the charge (``subtract``), or clears it (``hard``, which is
        wrong by −4 to −20 % in rate).
    saturation : ``subtract``, rate = charge/threshold up to 1; or ``dead_readout``, where the readout
        after a spike collects nothing, rate = 1/(1 + threshold/charge).
    reset_loss : share of its charge that the readout after a spike loses.
    dark_rate : mean over pixels, spikes a readout.
    dark_hot_fraction : pixels above ``dark_hot_factor`` × the median, the log-normal's own tail included.

    Raises BadInput for a value that is not allowed, however the sensor is made.
    """

    name: str
    rows: int
    columns: int
    pitch_m: float
    readout_hz: float
    threshold_e: float
    quantum_efficiency: float
    fill_factor: float
    wavelength_m: float
    reset: str
    saturation: str
    reset_loss: float
    dark_rate: float
    dark_log_sd: float
    dark_hot_fraction: float
    dark_hot_factor: float
    response_column_rms: float
    response_row_rms: float
    response_white_rms: float
    threshold_spread_rms: float
    threshold_noise_rms: float
    noise: NoiseSwitches
    sources: tuple[str, ...]

    def __post_init__(self) -> None:
        for key in ("name", *_RANGES, *_CHOICES):
            _check(key, getattr(self, key), f"sensor {self.name}")
        if self.noise.shot and self.threshold_e < 25:
            raise BadInput(
                f"threshold_e is {self.threshold_e:g} with shot noise on",
                where=f"sensor {self.name}",
                allowed="at least 25 electrons, where Poisson statistics are near enough to normal",
                hint="or switch noise.shot off",
            )

    @property
    def post_spike_loss(self) -> float:
        """Share of its charge that the readout after a spike loses, whatever the reason."""
        return 1.0 if self.saturation == "dead_readout" else self.reset_loss

    @property
    def max_excess_thresholds(self) -> int:
        """Most charge kept over the threshold at a spike, in thresholds.

        The diode holds no more, and overload echoes no longer. One is enough for ``subtract``; the law
        of ``dead_readout`` asks for the charge of one readout, and with 15 it holds to a rate of 0.94.
        """
        return 15 if self.saturation == "dead_readout" else 1

    @property
    def mean_dark_e(self) -> float:
        """Mean dark charge (e- a readout); 0 when switched off."""
        return self.dark_rate * self.threshold_e if self.noise.dark else 0.0

    def with_noise(self, **switches: bool) -> "Sensor":
        """A copy with some noise terms switched: ``with_noise(shot=False)``; BadInput for no such term."""
        _check_keys("noise term", switches, NoiseSwitches, lambda key: f"sensor {self.name}", missing=False)
        return replace(self, noise=replace(self.noise, **switches))


def sensor_names() -> list[str]:
    """The sensors that come with saf_gen, sorted."""
    return sorted(p.stem for p in _FOLDER.glob("*.yaml"))


def is_sensor_file(name: str | Path) -> bool:
    """Whether this is the path of a sensor file, and no sensor's name."""
    return Path(name).suffix in (".yaml", ".yml")


def get_sensor(name: str | Path, **changes: Any) -> Sensor:
    """The sensor ``name``, or the one in your own YAML file, with some keys changed.

    ``get_sensor("vidar_400x250", threshold_e=400, noise={"dark": False})``

    Raises BadInput for an unknown name or key and for a value that is not allowed.
    """
    if is_sensor_file(name):
        path = Path(name)
    elif str(name) in sensor_names():
        path = _FOLDER / f"{name}.yaml"
    else:
        raise unknown("sensor", name, sensor_names(), hint="or give the path of a .yaml file")
    sensor = _from_document(read_yaml(path))
    _check_keys("sensor key", changes, Sensor, lambda key: f"sensor {name}", missing=False)
    switches = changes.pop("noise", {})
    if isinstance(switches, NoiseSwitches):
        switches = asdict(switches)
    return replace(sensor.with_noise(**switches), **changes)


def sensor_from_text(text: str, where: str | Path) -> Sensor:
    """A sensor from the text of a sensor file, as every stream holds one; ``where`` is for messages.

    Raises BadInput as :func:`get_sensor` does.
    """
    return _from_document(parse_yaml(text, where))


def _from_document(document: Document) -> Sensor:
    if not isinstance(document.data, dict):
        raise BadInput("the file holds no keys", where=str(document.path), allowed=", ".join(_names(Sensor)))
    card: dict[str, Any] = document.data
    _check_keys("sensor key", card, Sensor, document.locate)
    for key, value in card.items():
        _check(key, value, document.locate(key))
    _check_keys("noise term", card["noise"], NoiseSwitches, lambda term: document.locate("noise", term))
    return Sensor(**card | {"noise": NoiseSwitches(**card["noise"]), "sources": tuple(card["sources"])})


def _names(cls: type) -> list[str]:
    return [f.name for f in fields(cls)]


def _check_keys(
    what: str, given: Iterable[str], cls: type, where: Callable[[str], str], *, missing: bool = True
) -> None:
    known = _names(cls)
    for key in given:
        if key not in known:
            raise unknown(what, key, known, where=where(key))
    for key in known:
        if missing and key not in given:
            raise BadInput(f"the {what} {key!r} is missing", where=where(key))


def _check(key: str, value: Any, where: str) -> None:
    if key in _CHOICES and value not in _CHOICES[key]:
        choices = _CHOICES[key]
        raise BadInput(
            f"{key} is {value!r}", where=where, allowed=", ".join(choices), nearest=closest(value, choices)
        )
    if key in _RANGES:
        least, most, unit = _RANGES[key]
        kind = int if key in ("rows", "columns") else (int, float)
        number = isinstance(value, kind) and not isinstance(value, bool) and isfinite(value)
        if not (number and least <= value <= most):
            whole = "a whole number " if kind is int else ""
            raise BadInput(
                f"{key} is {value!r}",
                where=where,
                allowed=f"{whole}{least:g} to {most:g} {unit}",
                hint="YAML reads 1e-5 as text: write 1.0e-5" if isinstance(value, str) else "",
            )
    if key == "noise" and not isinstance(value, Mapping | NoiseSwitches):
        raise BadInput(
            f"noise is {value!r}", where=where, allowed=", ".join(_names(NoiseSwitches)) + ", true or false"
        )
    if key == "name" and not (isinstance(value, str) and value.strip()):
        raise BadInput(f"name is {value!r}", where=where, allowed="a text")
    texts = isinstance(value, list | tuple) and all(isinstance(s, str) and s.strip() for s in value)
    if key == "sources" and not (value and texts):
        raise BadInput(f"sources is {value!r}", where=where, allowed="a list of at least one text")
