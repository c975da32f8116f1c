"""Sensor files of all kinds of cameras: one reader, the files that come with saf_gen, and what is unlikely in a file.

A sensor file states its ``kind``, which says whose keys the others are. What a recording stores of its sensor has no
``kind``, because the recording has one, and no fingerprint covers it.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import cache, partial
from math import exp, log
from pathlib import Path
from typing import Any, Literal, overload

from scipy.special import ndtr

from saf_gen.camera.exposure import electrons_per_irradiance
from saf_gen.camera.kinds import camera_type, kinds_of_cameras
from saf_gen.camera.sensor import Sensor
from saf_gen.core.config.document import Document, read_text, validate_document
from saf_gen.core.config.presets import Presets, is_preset_file
from saf_gen.core.config.yaml_document import MAX_YAML_BYTES, parse_yaml
from saf_gen.errors import BadInput, closest, unknown

FOLDER = Path(__file__).parent / "sensors"

_NOMINAL = re.compile(r"^(\w+):[^#\n]*#[^\n]*\b(assumed|derived|nominal)\b", re.MULTILINE)
_AS_IN = re.compile(r"^#[^\n]*is as in[ \n#]+(\w+)\.yaml", re.MULTILINE)
_USUAL: dict[str, tuple[float, float, float, str]] = {
    "quantum_efficiency": (1, 0.05, 0.95, "electrons per photon"),
    "fill_factor": (1, 0.05, 1, "of the pixel's area"),
    "wavelength_m": (1e9, 350, 1000, "nm"),
}
_USUAL_OF_OTHERS = _USUAL | {"pitch_m": (1e6, 1, 50, "µm")}
_USUAL_OF_SPIKES = _USUAL | {
    "pitch_m": (1e6, 5, 50, "µm"),
    "threshold_e": (1, 1e3, 5e5, "electrons"),
    "readout_hz": (1, 1e3, 1e5, "readouts per second"),
    "dark_rate": (1, 0, 0.05, "spikes per readout"),
    "dark_log_sd": (1, 0, 1, ""),
    "response_column_rms": (100, 0, 15, "%"),
    "response_row_rms": (100, 0, 15, "%"),
    "response_white_rms": (100, 0, 10, "%"),
    "threshold_spread_rms": (100, 0, 10, "%"),
    "threshold_noise_rms": (100, 0, 10, "%"),
    "reset_loss": (100, 0, 10, "% of the next readout"),
}
"""By key: factor to the displayed unit, ends of the usual range in that unit, and the unit."""


def sensor_names(*kinds: str) -> list[str]:
    """Return the names of the sensors that come with saf_gen, sorted: those of these kinds, or all."""
    names = _presets(kinds_of_cameras()).names()
    return [name for name in names if _shipped(name).kind in kinds] if kinds else names


@overload
def get_sensor(name: str | Path, *, kind: Literal["spikes"] = "spikes", **changes: Any) -> Sensor: ...
@overload
def get_sensor(name: str | Path, *, kind: str, **changes: Any) -> Any: ...
def get_sensor(name: str | Path, *, kind: str = "spikes", **changes: Any) -> Any:
    """Return a sensor by name or from a user's YAML file, with some fields changed.

    Parameters
    ----------
    name : str or Path
        A name of :func:`sensor_names`, or the path of a .yaml file.
    kind : str, default 'spikes'
        What its camera reads out: ``spikes``, ``photons``, ``frames`` or ``events``.
    **changes : optional
        Fields of the sensor and their new values; ``noise`` may be a mapping of some switches.

    Returns
    -------
    Sensor, SpadSensor, FrameSensor or EventSensor
        The sensor.

    Raises
    ------
    BadInput
        If a name or field is unknown, a value is not allowed, or the sensor is of another kind.

    Examples
    --------
    >>> get_sensor("vidar_400x250", threshold_e=400, noise={"dark": False}).threshold_e
    400
    >>> get_sensor("davis346", kind="events").threshold_on
    0.2
    """
    return read_sensor(name, kinds=(kind,), **changes)


def read_sensor(name: str | Path, *, kinds: Sequence[str] = (), **changes: Any) -> Any:
    """Return a sensor of one of these kinds, or of any, as :func:`get_sensor` does; its ``kind`` says which.

    Raises BadInput as that does.
    """
    if not is_preset_file(name) and str(name) not in sensor_names():
        raise unknown("sensor", name, allowed=sensor_names(*kinds), hint="or give the path of a .yaml file")
    return _presets(tuple(kinds) or kinds_of_cameras()).get(name, changes)


def sensor_text(name: str | Path) -> str:
    """Return the text of a valid sensor file of any kind, with comments and sources.

    Raises BadInput as :func:`read_sensor` does.
    """
    if not is_preset_file(name):
        read_sensor(name)
        return read_text(FOLDER / f"{name}.yaml")
    text = read_text(Path(name), max_bytes=MAX_YAML_BYTES)
    _parse(parse_yaml(text, name), kinds_of_cameras())
    return text


def _presets(kinds: tuple[str, ...]) -> Presets[Any]:
    """Return the sensors that come with saf_gen; those of other kinds are refused when they are read."""
    return Presets("sensor", partial(_parse, kinds=kinds), folder=FOLDER)


@cache
def _shipped(name: str) -> Any:
    return _presets(kinds_of_cameras()).get(name, {})


def _parse(document: Document, kinds: tuple[str, ...]) -> Any:
    """Return the sensor in a file; raise BadInput if it is not valid or of another kind than these."""
    data = document.data
    if not isinstance(data, dict) or "kind" not in data:
        raise BadInput("the key 'kind' is missing", where=document.locate(), allowed=", ".join(kinds_of_cameras()))
    kind, where = data["kind"], document.locate("kind")
    if kind not in (known := kinds_of_cameras()):
        nearest = closest(kind, list(known))
        raise BadInput(f"kind is {kind!r:.200}", where=where, allowed=", ".join(known), nearest=nearest)
    if kind not in kinds:
        allowed = "; ".join(f"{kind} ({', '.join(sensor_names(kind))})" for kind in kinds)
        shipped = document.path.parent == FOLDER
        problem = f"the sensor {document.path.stem} is of kind {kind}" if shipped else f"kind is {kind!r}"
        nearest = closest(document.path.stem, sensor_names(*kinds)) if shipped else ""
        raise BadInput(problem, where="" if shipped else where, allowed=allowed, nearest=nearest)
    return validate_document(camera_type(kind).sensor_type, document.without("kind"))


def nominal_keys(text: str) -> list[str]:
    """Return the keys of a sensor file whose comments say that they are assumed, derived or nominal.

    A file that differs from another in some keys names the other in its first lines ("is as in NAME.yaml"); the
    comments of the other file then apply to keys without a comment.
    """
    found = [found[1] for found in _NOMINAL.finditer(text)]
    if other := _AS_IN.search(text):
        explained = set(re.findall(r"^(\w+):[^#\n]*#", text, re.MULTILINE))
        found += [key for key in nominal_keys(sensor_text(other[1])) if key not in explained]
    return list(dict.fromkeys(found))


def implausible_keys(sensor: Any) -> Iterator[str]:
    """Yield a line for each value of a sensor that is allowed but unusual, and for each that has no effect."""
    spikes, values = isinstance(sensor, Sensor), asdict(sensor)
    usual = _USUAL_OF_SPIKES if spikes else {key: _USUAL_OF_OTHERS[key] for key in _USUAL_OF_OTHERS if key in values}
    for key, (factor, low, high, unit) in usual.items():
        shown = values[key] * factor
        if not low <= shown <= high:
            yield f"{key} is {' '.join(filter(None, (f'{shown:.4g}', unit)))}; usual: {low:g} to {high:g}"
    for switch, keys in sensor.switched.items():
        on, some = getattr(sensor.noise, switch), any(values[key] > 0 for key in keys)
        if on and not some:
            yield f"noise.{switch} is on, but {' and '.join(keys)} {'is' if len(keys) == 1 else 'are'} 0"
        if some and not on:
            yield f"noise.{switch} is off: {', '.join(key for key in keys if values[key] > 0)} has no effect"
    if spikes:
        yield from _implausible_laws(sensor)


def _implausible_laws(sensor: Sensor) -> Iterator[str]:
    if sensor.noise.dark and sensor.dark_log_sd > 0:
        tail = float(ndtr(-log(sensor.dark_hot_factor) / sensor.dark_log_sd)) if sensor.dark_hot_factor > 1 else 0.5
        if tail > 2 * sensor.dark_hot_fraction:
            yield (
                f"dark_hot_fraction is {sensor.dark_hot_fraction:.2g}, but a dark_log_sd of {sensor.dark_log_sd:g} "
                f"alone has {tail:.2g} of the pixels above {sensor.dark_hot_factor:g} times the median"
            )
    if sensor.saturation == "dead_readout" and sensor.reset_loss > 0:
        yield "reset_loss has no effect: with saturation dead_readout the readout after a spike collects nothing"
    if sensor.reset == "hard":
        yield "reset hard loses the charge above the threshold: rates are wrong by −4 to −20 % and rise in steps"
    lux = 0.5 * sensor.threshold_e / electrons_per_irradiance(sensor) * 683
    if not 100 <= lux <= 50_000:
        yield f"a rate of 0.5 takes {lux:.3g} lux at the sensor (555 nm); usual: 100 to 50,000; see threshold_e"
    if sensor.noise.dark and sensor.dark_rate * exp(2 * sensor.dark_log_sd) > 0.3:
        yield "one pixel in fifty fires in the dark at more than 0.3 spikes per readout"
