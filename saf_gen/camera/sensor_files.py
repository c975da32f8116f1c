"""Sensor files: their text, their nominal keys (assumed or derived, not measured), and their implausible values."""

import re
from collections.abc import Iterator
from dataclasses import asdict
from math import exp, log
from pathlib import Path
from typing import Any

from scipy.special import ndtr

from saf_gen.camera import Sensor, electrons_per_irradiance
from saf_gen.camera.events.sensor import PRESETS as EVENT_CAMERAS
from saf_gen.camera.frames.sensor import PRESETS as FRAME_CAMERAS
from saf_gen.camera.sensor import PRESETS as SPIKE_CAMERAS
from saf_gen.camera.spad.sensor import PRESETS as SPADS
from saf_gen.core.config.document import read_text
from saf_gen.core.config.presets import Presets, is_preset_file
from saf_gen.errors import unknown

KINDS: dict[str, Presets[Any]] = {
    "spikes": SPIKE_CAMERAS, "events": EVENT_CAMERAS, "photons": SPADS, "frames": FRAME_CAMERAS
}  # fmt: skip
"""By what it reads out: the sensors that come with saf_gen."""

OF_KIND = {"spad": "photons", "frames": "frames"}
"""What a sensor reads out, by the ``kind`` in its file; files of spike and event cameras state none."""

_NOMINAL = re.compile(r"^(\w+):[^#\n]*#[^\n]*\b(assumed|derived|nominal)\b", re.MULTILINE)
_AS_IN = re.compile(r"^#[^\n]*is as in[ \n#]+(\w+)\.yaml", re.MULTILINE)
_USUAL: dict[str, tuple[float, float, float, str]] = {
    "pitch_m": (1e6, 5, 50, "µm"),
    "threshold_e": (1, 1e3, 5e5, "electrons"),
    "quantum_efficiency": (1, 0.05, 0.95, "electrons per photon"),
    "fill_factor": (1, 0.05, 1, "of the pixel's area"),
    "wavelength_m": (1e9, 350, 1000, "nm"),
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
_SWITCHED = {
    "dark": ("dark_rate",),
    "response": ("response_column_rms", "response_row_rms", "response_white_rms"),
    "threshold_spread": ("threshold_spread_rms",),
    "threshold_noise": ("threshold_noise_rms",),
    "reset_jitter": ("reset_jitter",),
}
"""By noise switch: the keys that have an effect only if it is on."""


def sensor_text(name: str | Path) -> str:
    """Return the text of a sensor file of any kind, with comments and sources.

    Raises BadInput if the name is unknown, or the file of a user cannot be read.
    """
    if is_preset_file(name):
        return read_text(Path(name))
    for presets in KINDS.values():
        if str(name) in presets.names():
            return read_text(presets.folder / f"{name}.yaml")
    allowed = [known for presets in KINDS.values() for known in presets.names()]
    raise unknown("sensor", name, allowed=allowed, hint="or give the path of a .yaml file")


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


def implausible_keys(sensor: Sensor) -> Iterator[str]:
    """Yield a line for each value of a sensor that is allowed but unusual, and for each that has no effect."""
    values = asdict(sensor)
    for key, (factor, low, high, unit) in _USUAL.items():
        shown = values[key] * factor
        if not low <= shown <= high:
            yield f"{key} is {' '.join(filter(None, (f'{shown:.4g}', unit)))}; usual: {low:g} to {high:g}"
    for switch, keys in _SWITCHED.items():
        on, some = getattr(sensor.noise, switch), any(values[key] > 0 for key in keys)
        if on and not some:
            yield f"noise.{switch} is on, but {' and '.join(keys)} {'is' if len(keys) == 1 else 'are'} 0"
        if some and not on:
            yield f"noise.{switch} is off: {', '.join(key for key in keys if values[key] > 0)} has no effect"
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
