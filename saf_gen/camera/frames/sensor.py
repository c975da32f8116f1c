"""Frame-camera sensors: the values in a sensor file, immutable."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from saf_gen.camera.camera import Readouts
from saf_gen.camera.exposed_sensor import ExposedSensor
from saf_gen.camera.sensor import FillFactor, Filter, Pitch, PixelCount, ResponseRms, SpectralQe, Wavelength
from saf_gen.core.config.presets import Sources, Switch, Text, between
from saf_gen.errors import BadInput

SHARE = 0.5
"""Share of its well that a pixel of the target fills if the camera chooses its exposure."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class FrameNoise:
    """Switches of the noise of a frame camera, each independent of the others.

    A switch does not change the numbers of the sensor.

    Parameters
    ----------
    shot : bool
        Electrons come at random (Poisson).
    read : bool
        Each reading is off by ``read_noise_e``.
    dark : bool
        Dark current, log-normal over the pixels, with hot pixels.
    response : bool
        The response differs between pixels.
    """

    shot: Switch
    read: Switch
    dark: Switch
    response: Switch


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class FrameSensor(ExposedSensor):
    """The array of a frame camera. Lengths are in metres, times in seconds, charge in electrons.

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
    readout_hz : float
        Frames per second.
    exposure_s : float
        Time for which a row collects light in each frame, from the beginning of the frame, seconds; at most a frame.
    shortest_exposure_s : float
        Shortest exposure, seconds.
    shutter : str
        ``global`` if all rows are exposed at once, ``rolling`` if each begins ``row_s`` after the one above it.
    row_s : float
        Time from the exposure of a row to that of the next, seconds; 0 with ``global``.
    quantum_efficiency : float
        Electrons per photon that reaches the light-sensitive area.
    fill_factor : float
        Light-sensitive fraction of the area of a pixel.
    wavelength_m : float
        The single wavelength at which light is converted to electrons, metres.
    full_well_e : float
        Charge that a pixel can hold, electrons; it is read as the largest number.
    read_noise_e : float
        Rms of a reading, electrons.
    bits : int
        Bits of a number that is read out.
    black_level_dn : int
        Number that a pixel without charge reads on average (the offset of EMVA 1288), so that the read noise is not cut
        off at 0; below the largest number.
    dark_e_per_s : float
        Mean dark current over the pixels, electrons per second.
    dark_log_sd : float
        Standard deviation of the natural logarithm of the dark current over the pixels.
    dark_hot_fraction : float
        Fraction of the pixels above ``dark_hot_factor`` times the median.
    dark_hot_factor : float
        Multiple of the median above which a pixel is hot.
    dark_hot_exponent : float
        Exponent a of the Pareto law of hot pixels: the number of pixels above x medians is proportional to x⁻ᵃ.
    response_rms : float
        Rms of the response's differences between pixels, relative to its mean.
    noise : FrameNoise
        Noise that is switched on.
    sources : tuple of str
        Sources of the numbers.
    spectral_qe : str or tuple, default 'silicon'
        Shape of the quantum efficiency over the wavelength, as in :class:`saf_gen.camera.Sensor`.
    filter : str or tuple, default 'none'
        Filter in front of the sensor, as in :class:`saf_gen.camera.Sensor`.
    """

    kind: ClassVar[str] = "frames"
    switched: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "read": ("read_noise_e",),
        "dark": ("dark_e_per_s",),
        "response": ("response_rms",),
    }
    name: Text
    rows: PixelCount
    columns: PixelCount
    pitch_m: Pitch
    readout_hz: Annotated[float, between(0.1, 1e6, unit="hertz")]
    exposure_s: Annotated[float, between(1e-8, 100, unit="seconds")]
    shortest_exposure_s: Annotated[float, between(1e-8, 1, unit="seconds")]
    shutter: Literal["global", "rolling"]
    row_s: Annotated[float, between(0, 1, unit="seconds")]
    quantum_efficiency: Annotated[float, between(1e-4, 1, unit="electrons per photon")]
    fill_factor: FillFactor
    wavelength_m: Wavelength
    full_well_e: Annotated[float, between(10, 1e7, unit="electrons")]
    read_noise_e: Annotated[float, between(0, 1e4, unit="electrons")]
    bits: Annotated[int, between(1, 16, unit="bits", integer=True)]
    black_level_dn: Annotated[int, between(0, 2**16 - 2, unit="(number that is read out)", integer=True)]
    dark_e_per_s: Annotated[float, between(0, 1e6, unit="electrons per second")]
    dark_log_sd: Annotated[float, between(0, 2, unit="(standard deviation of the natural logarithm)")]
    dark_hot_fraction: Annotated[float, between(0, 0.1, unit="of all pixels")]
    dark_hot_factor: Annotated[float, between(1, 1000, unit="times the median")]
    dark_hot_exponent: Annotated[float, between(1.5, 20, unit="(exponent of the Pareto law of hot pixels)")]
    response_rms: ResponseRms
    noise: FrameNoise
    sources: Sources
    spectral_qe: SpectralQe = "silicon"
    filter: Filter = "none"

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.shutter == "global") != (self.row_s == 0):
            raise BadInput(
                f"row_s is {self.row_s:g} with shutter: {self.shutter}",
                where=f"sensor {self.name}",
                allowed="0 with global, above 0 with rolling",
            )
        if self.black_level_dn >= self.levels:
            raise BadInput(
                f"black_level_dn is {self.black_level_dn} with {self.bits} bits",
                where=f"sensor {self.name}",
                allowed=f"0 to {self.levels - 1}, below the largest number",
            )

    @property
    def levels(self) -> int:
        """The largest number that is read out."""
        return 2**self.bits - 1

    @property
    def electrons_per_level(self) -> float:
        """Electrons by which a number rises by one: from the black level to the largest number, the well fills."""
        return self.full_well_e / (self.levels - self.black_level_dn)

    @property
    def mean_dark_e(self) -> float:
        """Mean dark charge of an exposure, electrons; 0 if dark current is switched off."""
        return self.dark_e_per_s * self.exposure_s * self.noise.dark

    def rows_s(self) -> np.ndarray:
        """Return when the exposure of each row begins, seconds from the beginning of a frame: (H,), or (1,) for all."""
        return np.arange(self.rows) * self.row_s if self.shutter == "rolling" else np.zeros(1)

    def exposed_for(self, electrons_per_s: np.ndarray) -> Self:
        """Return a copy that is exposed for as long as pixels need to fill half of their well on average.

        It is at most a frame, and at least the shortest exposure.

        Parameters
        ----------
        electrons_per_s : ndarray, shape (n,)
            Electrons per second of the pixels, without dark current.
        """
        mean = float(np.mean(electrons_per_s, dtype=np.float64))
        wanted = SHARE * self.full_well_e / mean if mean > 0 else np.inf
        seconds = min(max(wanted, self.shortest_exposure_s), 1 / self.readout_hz)
        rounded = float(f"{seconds:.6g}")  # so that the order of a sum does not show
        return replace(self, exposure_s=rounded if rounded * self.readout_hz <= 1 else 1 / self.readout_hz)

    def readouts(self, seconds: float) -> Readouts:
        """Return the frames whose last row is exposed before the end of a recording, each taken amid its exposure.

        Raises BadInput if the recording is shorter than that.
        """
        rows_s = self.rows_s()
        last_s = float(rows_s[-1]) + self.exposure_s
        frames = int((seconds - last_s) * self.readout_hz + 1e-9) + 1
        if frames < 1 or seconds < last_s:
            raise BadInput(f"the sequence lasts {seconds:g} s", allowed="at least a frame")
        middle_s = float(rows_s.mean()) + self.exposure_s / 2
        return Readouts(frames, self.readout_hz, self.exposure_s, rows_s, middle_s)
