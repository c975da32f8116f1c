"""Single-photon arrays: the values in a sensor file, immutable."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from saf_gen.camera.exposed_sensor import ExposedSensor
from saf_gen.camera.sensor import FillFactor, Filter, Pitch, PixelCount, ResponseRms, SpectralQe, Wavelength
from saf_gen.core.config.presets import Sources, Switch, Text, between
from saf_gen.errors import BadInput

RATE = 0.5
"""Share of the frames in which an array that chooses its exposure detects a photon of the target."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class SpadNoise:
    """Switches of the imperfections of a single-photon array, each independent of the others.

    A switch does not change the numbers of the sensor. That photons are detected at random is not an imperfection.

    Parameters
    ----------
    dark : bool
        Dark counts, log-normal over the pixels, with hot pixels.
    response : bool
        The detection probability differs between pixels.
    dead_time : bool
        After an avalanche a pixel is blind for ``dead_time_s``; it matters to ``recharge: passive`` alone.
    afterpulsing : bool
        An avalanche may cause another.
    """

    dark: Switch
    response: Switch
    dead_time: Switch
    afterpulsing: Switch


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class SpadSensor(ExposedSensor):
    """An array of single-photon avalanche diodes with one bit of memory per pixel. Lengths in metres, times in seconds.

    A frame is a readout: its bit says whether a pixel has detected a photon while its gate was open. The functions of
    this module raise BadInput for a value that is not allowed; the constructor and ``dataclasses.replace`` raise a
    ValueError.

    Parameters
    ----------
    name : str
        Name of the sensor.
    rows, columns : int
        Size of the array, pixels.
    pitch_m : float
        Pitch of the pixels, metres.
    readout_hz : float
        Frames per second.
    exposure_s : float
        Time for which the gate is open, from the beginning of each frame, seconds; at most a frame.
    shortest_exposure_s : float
        Shortest time for which the gate can be open, seconds.
    quantum_efficiency : float
        Detection probability of a photon that reaches the light-sensitive area.
    fill_factor : float
        Light-sensitive fraction of the area of a pixel.
    wavelength_m : float
        The single wavelength at which light is detected, metres.
    recharge : str
        ``clocked`` if all pixels are recharged at the beginning of a frame, and only then: a pixel detects one photon
        per frame. ``passive`` if each pixel recharges itself after ``dead_time_s``, which a photon that comes while it
        is blind does not prolong: such a detector is called non-paralysable. Circuits with passive recharge are often
        paralysable in bright light, which is not modelled.
    dead_time_s : float
        Time for which a pixel is blind after an avalanche, seconds, with ``passive``.
    dark_hz : float
        Mean rate of dark counts over the pixels, hot ones included, hertz. Makers state the median, which is lower, by
        a factor of 2.3 with the spread and the hot pixels of the arrays that come with saf_gen.
    dark_log_sd : float
        Standard deviation of the natural logarithm of that rate over the pixels.
    dark_hot_fraction : float
        Fraction of the pixels above ``dark_hot_factor`` times the median.
    dark_hot_factor : float
        Multiple of the median above which a pixel is hot.
    dark_hot_exponent : float
        Exponent a of the Pareto law of hot pixels: the number of pixels above x medians is proportional to x⁻ᵃ.
    response_rms : float
        Rms of the detection probability's differences between pixels, relative to its mean.
    afterpulse : float
        Probability that an avalanche causes another: in the next frame with ``clocked``, at the end of the dead time
        with ``passive``.
    noise : SpadNoise
        Imperfections that are switched on.
    sources : tuple of str
        Sources of the numbers.
    spectral_qe : str or tuple, default 'silicon'
        Shape of the detection probability over the wavelength, as in :class:`saf_gen.camera.Sensor`.
    filter : str or tuple, default 'none'
        Filter in front of the sensor, as in :class:`saf_gen.camera.Sensor`.
    """

    kind: ClassVar[str] = "photons"
    switched: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "dark": ("dark_hz",),
        "response": ("response_rms",),
        "afterpulsing": ("afterpulse",),
    }
    name: Text
    rows: PixelCount
    columns: PixelCount
    pitch_m: Pitch
    readout_hz: Annotated[float, between(1, 1e7, unit="hertz")]
    exposure_s: Annotated[float, between(1e-10, 1, unit="seconds")]
    shortest_exposure_s: Annotated[float, between(1e-10, 1, unit="seconds")]
    quantum_efficiency: Annotated[float, between(1e-4, 1, unit="detections per photon")]
    fill_factor: FillFactor
    wavelength_m: Wavelength
    recharge: Literal["clocked", "passive"]
    dead_time_s: Annotated[float, between(0, 1e-3, unit="seconds")]
    dark_hz: Annotated[float, between(0, 1e6, unit="hertz")]
    dark_log_sd: Annotated[float, between(0, 2, unit="(standard deviation of the natural logarithm)")]
    dark_hot_fraction: Annotated[float, between(0, 0.1, unit="of all pixels")]
    dark_hot_factor: Annotated[float, between(1, 1000, unit="times the median")]
    dark_hot_exponent: Annotated[float, between(1.5, 20, unit="(exponent of the Pareto law of hot pixels)")]
    response_rms: ResponseRms
    afterpulse: Annotated[float, between(0, 0.5, unit="avalanches per avalanche")]
    noise: SpadNoise
    sources: Sources
    spectral_qe: SpectralQe = "silicon"
    filter: Filter = "none"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.recharge == "clocked" and self.dead_time_s:
            raise BadInput(
                f"dead_time_s is {self.dead_time_s:g} with recharge: clocked",
                where=f"sensor {self.name}",
                allowed="0, because a pixel is then blind until the next frame; or recharge: passive",
            )

    @property
    def gate(self) -> float:
        """Fraction of a frame in which the gate is open."""
        return min(self.exposure_s * self.readout_hz, 1.0)

    @property
    def dead_frames(self) -> float:
        """Dead time in frames; 0 if it is switched off, or pixels are recharged by the clock."""
        return self.dead_time_s * self.readout_hz * self.noise.dead_time

    @property
    def afterpulse_on(self) -> float:
        """Probability of an afterpulse; 0 if it is switched off."""
        return self.afterpulse * self.noise.afterpulsing

    @property
    def mean_dark(self) -> float:
        """Mean dark counts per frame while the gate is open; 0 if dark counts are switched off."""
        return self.dark_hz * self.gate / self.readout_hz * self.noise.dark

    def exposed_for(self, electrons_per_s: np.ndarray) -> Self:
        """Return a copy whose gate is open for as long as pixels need to detect a photon in half of the frames.

        It is at most a frame, and at least the shortest exposure; dead time, dark counts and afterpulses do not count.

        Parameters
        ----------
        electrons_per_s : ndarray, shape (n,)
            Detections per second of pixels that are never blind; the rate is their mean.
        """
        light = np.asarray(electrons_per_s, np.float64)
        low, high = self.shortest_exposure_s, 1 / self.readout_hz
        if -np.expm1(-light * high).mean() <= RATE:
            return replace(self, exposure_s=high)
        for _ in range(60):  # the rate rises with the exposure, so bisection converges to double precision
            middle = (low + high) / 2
            if -np.expm1(-light * middle).mean() < RATE:
                low = middle
            else:
                high = middle
        return replace(self, exposure_s=float(f"{high:.6g}"))  # so that the order of a sum does not show


def detection_rate(photons: np.ndarray | float, sensor: SpadSensor) -> np.ndarray:
    """Return the mean of a pixel's bit at constant light: the share of frames in which it detects a photon.

    With ``clocked`` recharge a frame without avalanche before it has p = 1 − exp(−H), and one after an avalanche
    1 − (1 − p)(1 − q), so that the mean is p/(1 − q(1 − p)). With ``passive`` recharge and an open gate, avalanches are
    a renewal process whose intervals are the dead time τ and then, unless an afterpulse follows at once, a time of mean
    1/H. No avalanche falls into a frame with the probability ∫ P(interval > x) dx, from a frame to infinity, divided by
    the mean interval (D. R. Cox, Renewal Theory, 1962, section 5.2).

    Parameters
    ----------
    photons : ndarray or float
        Mean detections H of a pixel that is never blind, per frame while its gate is open, dark counts included.
    sensor : SpadSensor
        The sensor; with ``passive`` recharge and a dead time its gate must be open for the whole frame.

    Raises
    ------
    BadInput
        If the gate is shorter than a frame, with ``passive`` recharge and a dead time.
    """
    photons = np.asarray(photons, np.float64)
    q, dead = sensor.afterpulse_on, sensor.dead_frames
    if sensor.recharge == "clocked":
        p = -np.expm1(-photons)
        return p / (1 - q * (1 - p))
    if sensor.gate < 1 and dead:
        raise BadInput(f"the gate is open for {sensor.gate:.3g} of a frame", allowed="the whole frame, in this law")
    with np.errstate(divide="ignore", invalid="ignore"):
        wait = (1 - q) / photons
        if dead >= 1:
            empty = (dead - 1 + wait) / (dead + wait)
        else:
            empty = wait * np.exp(-photons * (sensor.gate - dead)) / (dead + wait)
    return np.where(photons > 0, 1 - empty, 0.0)
