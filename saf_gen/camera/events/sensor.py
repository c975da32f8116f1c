"""Event-camera sensors: the values in a sensor file, immutable."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from saf_gen.camera.sensor import FillFactor, Pitch, PixelCount, Sensor, Wavelength
from saf_gen.core.config.presets import Sources, Switch, Text, between, change_fields


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class EventNoise:
    """Switches of the imperfections of an event camera, each independent of the others.

    A switch does not change the numbers of the sensor.

    Parameters
    ----------
    mismatch : bool
        Thresholds and leaks differ between pixels and are constant in time.
    bandwidth : bool
        The photoreceptor follows the light with a delay, which is longer in dim light.
    refractory : bool
        After an event a pixel is held in reset.
    leak : bool
        The stored level drifts, so that pixels in constant light report brighter light now and then.
    shot : bool
        Pixels report changes at random, more often in dim light.
    hot : bool
        Some pixels leak much faster.
    readout : bool
        Events wait until those before them have been read.
    """

    mismatch: Switch
    bandwidth: Switch
    refractory: Switch
    leak: Switch
    shot: Switch
    hot: Switch
    readout: Switch


Threshold = Annotated[float, between(0.01, 2, unit="of the natural logarithm of the light")]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class EventSensor:
    """The array of an event camera. Lengths are in metres, times in seconds, light in photo-electrons per second.

    The functions of this module raise BadInput for a value that is not allowed; the constructor and
    ``dataclasses.replace`` raise a ValueError.

    Parameters
    ----------
    name : str
        Name of the sensor.
    rows, columns : int
        Size of the array, pixels.
    pitch_m : float
        Pitch of the pixels, metres.
    quantum_efficiency : float
        Electrons per photon that reaches the light-sensitive area.
    fill_factor : float
        Light-sensitive fraction of the area of a pixel.
    wavelength_m : float
        The single wavelength at which light is converted to electrons, metres.
    dark_e_per_s : float
        Dark current, electrons per second; it adds to the light.
    threshold_on, threshold_off : float
        Rise, and fall, of the natural logarithm of the light that makes an event.
    threshold_rms : float
        Rms of the thresholds' differences between pixels, of the same logarithm.
    receptor_e : float
        Charge Q that the photoreceptor's input node needs for a change by e, electrons: in light of I electrons per
        second, its time constant is Q/I.
    receptor_s : float
        Time constant of the photoreceptor in the brightest light, seconds; it adds to Q/I.
    refractory_s : float
        Time in reset after an event, seconds.
    leak_hz : float
        Mean rate of events of a pixel in constant light, because its stored level drifts, hertz. It does not grow with
        the light, as it does in real pixels.
    leak_log_sd : float
        Standard deviation of the natural logarithm of that rate over the pixels.
    shot_hz : float
        Rate of random events of a pixel in the dark, hertz; half of them are of either polarity.
    shot_half_e_per_s : float
        Light in which that rate is half of it, electrons per second.
    hot_fraction : float
        Fraction of the pixels that are hot.
    hot_hz : float
        Rate of events of a hot pixel in constant light, hertz.
    readout_events_per_s : float
        Events that the chip can read in a second.
    noise : EventNoise
        Imperfections that are switched on.
    sources : tuple of str
        Sources of the numbers.
    """

    kind: ClassVar[str] = "events"
    switched: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "mismatch": ("threshold_rms", "leak_log_sd"),
        "bandwidth": ("receptor_e", "receptor_s"),
        "refractory": ("refractory_s",),
        "leak": ("leak_hz",),
        "shot": ("shot_hz",),
        "hot": ("hot_fraction",),
    }
    name: Text
    rows: PixelCount
    columns: PixelCount
    pitch_m: Pitch
    quantum_efficiency: Annotated[float, between(1e-4, 1, unit="electrons per photon")]
    fill_factor: FillFactor
    wavelength_m: Wavelength
    dark_e_per_s: Annotated[float, between(1e-3, 1e9, unit="electrons per second")]
    threshold_on: Threshold
    threshold_off: Threshold
    threshold_rms: Annotated[float, between(0, 0.5, unit="of the natural logarithm of the light")]
    receptor_e: Annotated[float, between(0, 1e6, unit="electrons")]
    receptor_s: Annotated[float, between(0, 1, unit="seconds")]
    refractory_s: Annotated[float, between(0, 1, unit="seconds")]
    leak_hz: Annotated[float, between(0, 1e3, unit="hertz")]
    leak_log_sd: Annotated[float, between(0, 2, unit="(standard deviation of the natural logarithm)")]
    shot_hz: Annotated[float, between(0, 1e4, unit="hertz")]
    shot_half_e_per_s: Annotated[float, between(1e-3, 1e12, unit="electrons per second")]
    hot_fraction: Annotated[float, between(0, 0.1, unit="of all pixels")]
    hot_hz: Annotated[float, between(0, 1e3, unit="hertz")]
    readout_events_per_s: Annotated[float, between(1, 1e12, unit="events per second")]
    noise: EventNoise
    sources: Sources

    def with_noise(self, **switches: bool) -> "EventSensor":
        """Return a copy with some imperfections switched on or off, such as ``with_noise(shot=False)``.

        Raises BadInput if a switch is unknown.
        """
        return change_fields(self, {"noise": switches}, where=f"sensor {self.name}")

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as plain data."""
        return asdict(self)

    def in_place_of(self, grid: Sensor) -> Self:
        """Return the sensor itself: rows, columns, pitch, fill factor and quantum efficiency are then not used."""
        return self

    def exposed_for(self, electrons_per_s: np.ndarray) -> Self:
        """Return the sensor itself, because it has no exposure."""
        return self

    def readouts(self, seconds: float) -> None:
        """Return None: pixels answer to the light at any instant."""
