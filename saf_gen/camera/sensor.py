"""Spike-camera sensors: the values in a sensor file, immutable."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import ConfigDict, PlainValidator
from pydantic.dataclasses import dataclass

from saf_gen.core.config.presets import Sources, Switch, Text, between, change_fields, checked
from saf_gen.core.config.ranges import is_number
from saf_gen.core.spectrum import NM, shipped_curve
from saf_gen.errors import BadInput


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class NoiseSwitches:
    """Switches of the sensor's imperfections, each independent of the others.

    A switch does not change the numbers of the sensor.

    Parameters
    ----------
    shot : bool
        Poisson noise of electrons; the charge between two spikes has the variance ``threshold_e`` (e-²).
    dark : bool
        Dark current, log-normal over the pixels, with hot pixels.
    response : bool
        Photo-response non-uniformity of the chip: profiles of columns and rows, the twist, the first column and row,
        the white rest, and the part proportional to dark charge.
    threshold_spread : bool
        Thresholds differ between pixels and are constant in time.
    threshold_noise : bool
        A new random threshold is drawn after each spike.
    dust : bool, default False
        Some pixels lie in the shadow of a speck.
    dead : bool, default False
        Some pixels never fire.
    reset_jitter : bool, default False
        The instant of a reset is uncertain.
    """

    shot: Switch
    dark: Switch
    response: Switch
    threshold_spread: Switch
    threshold_noise: Switch
    dust: Switch = False
    dead: Switch = False
    reset_jitter: Switch = False


# The ranges are wide, but narrow enough to reject a pitch in micrometres, a wavelength in nanometres or an rms in
# percent.
MAX_DARK_RATE = 0.5
PixelCount = Annotated[int, between(1, 16_384, unit="pixels", integer=True)]
Pitch = Annotated[float, between(2e-7, 1e-3, unit="metres")]
FillFactor = Annotated[float, between(1e-4, 1, unit="of the pixel's area")]
Wavelength = Annotated[float, between(1e-7, 1e-5, unit="metres")]
Celsius = Annotated[float, between(-100, 150, unit="°C")]
Fraction = Annotated[float, between(0, 1, unit="of all pixels")]
ResponseRms = Annotated[float, between(0, 0.3, unit="of the mean")]
ResponseExcess = Annotated[float, between(-0.9, 0.9, unit="of the mean")]


def _are_fractions(value: Any) -> bool:
    fits = isinstance(value, list | tuple) and len(value) <= 8 and all(is_number(x) and 0 <= x <= 1 for x in value)
    return fits and sum(value) <= 1 + 1e-9


LegendreFractions = Annotated[
    tuple[float, ...],
    PlainValidator(
        checked(_are_fractions, "a list of at most 8 fractions, each 0 to 1 and together at most 1", convert=tuple)
    ),
    "fractions of the profile's variance in Legendre polynomials of degree 1, 2, …; the rest is white",
]


CURVES = {"spectral_qe": ("silicon",), "filter": ("none", "ir_cut")}
"""Shipped curves over the wavelength, by the field of a sensor that may name them."""


SpectralCurve = str | tuple[tuple[float, float], ...]
"""A curve over the wavelength: the name of a shipped one, or pairs of a wavelength (nm) and a fraction."""


def spectral_curve(names: tuple[str, ...]) -> PlainValidator:
    """Return a pydantic validator of a :data:`SpectralCurve` that may have one of these names."""

    def fits(value: Any) -> bool:
        if isinstance(value, str):
            return value in names
        if not isinstance(value, list | tuple) or not 2 <= len(value) <= 1000:
            return False
        if not all(isinstance(row, list | tuple) and len(row) == 2 and all(map(is_number, row)) for row in value):
            return False
        rises = all(a[0] < b[0] for a, b in pairwise(value))
        return rises and 100 <= value[0][0] <= 3000 and all(0 <= fraction <= 1 for _, fraction in value)

    def convert(value: Any) -> Any:
        return value if isinstance(value, str) else tuple((float(nm), float(fraction)) for nm, fraction in value)

    table = "[[400, 0.1], [500, 0.8], …], pairs of a rising wavelength in nm and a fraction"
    return PlainValidator(checked(fits, f"{', '.join(names)}, or {table}", convert=convert))


SpectralQe = Annotated[SpectralCurve, spectral_curve(CURVES["spectral_qe"])]
Filter = Annotated[SpectralCurve, spectral_curve(CURVES["filter"])]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Sensor:
    """The array of a spike camera: geometry, conversion of light to charge, spiking, and noise.

    Lengths are in metres, charge is in electrons, and rms values are fractions of the mean. Fields with a default may
    be left out of a sensor file; their effect is then absent. The functions of this module raise BadInput for a value
    that is not allowed; the constructor and ``dataclasses.replace`` raise a ValueError.

    Parameters
    ----------
    name : str
        Name of the sensor.
    rows, columns : int
        Size of the array, pixels.
    pitch_m : float
        Pitch of the pixels, metres.
    readout_hz : float
        Readouts per second.
    threshold_e : float
        Mean charge at which a pixel fires, electrons.
    quantum_efficiency : float
        Electrons per photon that reaches the light-sensitive area.
    fill_factor : float
        Light-sensitive fraction of the area of a pixel.
    wavelength_m : float
        The single wavelength at which light is converted to electrons, metres.
    reset : str
        ``subtract`` if a spike subtracts the threshold from the charge, or ``hard`` if it clears the charge, which
        makes rates wrong by −4 to −20 %.
    saturation : str
        With ``subtract``, the rate is charge/threshold up to 1. With ``dead_readout``, the readout after a spike
        collects nothing, and the rate is 1/(1 + threshold/charge).
    reset_loss : float
        Fraction of its charge that the readout after a spike loses.
    dark_rate : float
        Mean dark rate over the pixels, spikes per readout.
    dark_log_sd : float
        Standard deviation of the natural logarithm of the dark charge over the pixels.
    dark_hot_fraction : float
        Fraction of the pixels above ``dark_hot_factor`` times the median, including the tail of the log-normal law.
    dark_hot_factor : float
        Multiple of the median dark charge above which a pixel is hot.
    dark_hot_exponent : float
        Exponent a of the Pareto law of hot pixels: the number of pixels above x medians is proportional to x⁻ᵃ.
    response_column_rms, response_row_rms : float
        Rms of the profile of the columns, and of the rows.
    response_column_legendre, response_row_legendre : tuple of float
        Fractions of the variance of the profile in Legendre polynomials of degree 1 (tilt), 2 (bow) and so on; the
        rest is white noise. The signs of the terms differ between devices.
    response_white_rms : float
        Rms of the white rest, which is normal.
    threshold_spread_rms : float
        Rms of the differences of the mean threshold between pixels.
    threshold_noise_rms : float
        Rms of the random threshold about the mean threshold of its pixel.
    noise : NoiseSwitches
        Imperfections that are switched on.
    sources : tuple of str
        Sources of the numbers.
    response_twist_rms : float, default 0
        Rms of the twist, a tilt of the columns multiplied by a tilt of the rows.
    response_first_column, response_first_row : float, default 0
        Excess response of the first column, and of the first row.
    response_per_dark : float, default 0
        Mean increase of a pixel's relative response if its dark charge rises by the mean dark charge.
    response_per_dark_spread : float, default 0
        Rms over the pixels of ``response_per_dark``, relative to its mean.
    dust_fraction : float, default 0
        Fraction of the pixels in the shadow of a speck.
    dust_depth_rms : float, default 0
        Rms fraction of the light that a speck blocks, half-normal.
    dead_fraction : float, default 0
        Fraction of the pixels that never fire.
    reset_jitter : float, default 0
        Standard deviation of the instant of a reset, readouts.
    row_skew : float, default 0
        Time between reading the first and the last row, readouts. The time of a frame is when its last row is read.
    dark_doubling_k : float, default 8
        Rise of temperature that doubles the dark current, kelvins.
    dark_temperature_c : float, default 25
        Temperature at which ``dark_rate`` holds, °C.
    temperature_c : float, default 25
        Temperature of the sensor, °C.
    spectral_qe : str or tuple, default 'silicon'
        Shape of the quantum efficiency over the wavelength, for lamps that state their spectrum: ``silicon`` (assumed:
        5 µm of it), or pairs of a wavelength (nm) and a fraction. It is scaled to ``quantum_efficiency`` at
        ``wavelength_m``.
    filter : str or tuple, default 'none'
        Filter in front of the sensor, for the same lamps: ``none``, ``ir_cut`` (650 nm), or pairs of a wavelength (nm)
        and a transmission.
    """

    kind: ClassVar[str] = "spikes"
    switched: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "dark": ("dark_rate",),
        "response": ("response_column_rms", "response_row_rms", "response_white_rms"),
        "threshold_spread": ("threshold_spread_rms",),
        "threshold_noise": ("threshold_noise_rms",),
        "reset_jitter": ("reset_jitter",),
    }
    name: Text
    rows: PixelCount
    columns: PixelCount
    pitch_m: Pitch
    readout_hz: Annotated[float, between(1, 1e7, unit="hertz")]
    threshold_e: Annotated[float, between(1e-3, 1e7, unit="electrons")]
    quantum_efficiency: Annotated[float, between(1e-4, 1, unit="electrons per photon")]
    fill_factor: FillFactor
    wavelength_m: Wavelength
    reset: Literal["subtract", "hard"]
    saturation: Literal["subtract", "dead_readout"]
    reset_loss: Annotated[float, between(0, 1, unit="of the next readout's charge")]
    dark_rate: Annotated[float, between(0, MAX_DARK_RATE, unit="spikes per readout")]
    dark_log_sd: Annotated[float, between(0, 2, unit="(standard deviation of the natural logarithm)")]
    dark_hot_fraction: Annotated[float, between(0, 0.1, unit="of all pixels")]
    dark_hot_factor: Annotated[float, between(1, 1000, unit="times the median")]
    dark_hot_exponent: Annotated[
        float,
        between(1.5, 20, unit="(exponent of the Pareto law of hot pixels)"),
        "the number of hot pixels above x medians is proportional to x to the power of minus this value",
    ]
    response_column_rms: ResponseRms
    response_column_legendre: LegendreFractions
    response_row_rms: ResponseRms
    response_row_legendre: LegendreFractions
    response_white_rms: ResponseRms
    threshold_spread_rms: Annotated[float, between(0, 0.2, unit="of the mean")]
    threshold_noise_rms: Annotated[float, between(0, 0.2, unit="of the threshold")]
    noise: NoiseSwitches
    sources: Sources
    response_twist_rms: ResponseRms = 0.0
    response_first_column: ResponseExcess = 0.0
    response_first_row: ResponseExcess = 0.0
    response_per_dark: Annotated[float, between(0, 0.2, unit="of the mean, for each mean dark charge")] = 0.0
    response_per_dark_spread: Annotated[float, between(0, 1, unit="of response_per_dark")] = 0.0
    dust_fraction: Fraction = 0.0
    dust_depth_rms: Annotated[float, between(0, 1, unit="of the light")] = 0.0
    dead_fraction: Fraction = 0.0
    reset_jitter: Annotated[float, between(0, 0.2, unit="readouts")] = 0.0
    row_skew: Annotated[float, between(0, 1, unit="readouts")] = 0.0
    dark_doubling_k: Annotated[float, between(1, 100, unit="kelvins")] = 8.0
    dark_temperature_c: Celsius = 25.0
    temperature_c: Celsius = 25.0
    spectral_qe: SpectralQe = "silicon"
    filter: Filter = "none"

    def __post_init__(self) -> None:
        if self.noise.shot and self.threshold_e < 25:
            raise BadInput(
                f"threshold_e is {self.threshold_e:g} with shot noise on",
                where=f"sensor {self.name}",
                allowed="at least 25 electrons, because Poisson statistics are then close enough to normal",
                hint="raise threshold_e, or switch noise.shot off",
            )
        if not self.dark_rate_at_temperature <= MAX_DARK_RATE:
            raise BadInput(
                f"at temperature_c {self.temperature_c:g} the dark rate is {self.dark_rate_at_temperature:.3g}",
                where=f"sensor {self.name}",
                allowed=f"at most {MAX_DARK_RATE:g} spikes per readout",
                hint=f"dark_rate is {self.dark_rate:g} at {self.dark_temperature_c:g} °C and doubles every "
                f"{self.dark_doubling_k:g} kelvins",
            )

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as plain data; curves over the wavelength only if they are not the default."""
        values = asdict(self)
        defaults = {field.name: field.default for field in fields(self) if field.name in CURVES}
        return {key: value for key, value in values.items() if key not in CURVES or value != defaults[key]}

    def spectral_response(self) -> np.ndarray:
        """Return the electrons per joule and nanometre of light, relative to light of ``wavelength_m`` unfiltered.

        It is QE(λ)·T(λ)·λ, divided by QE·λ at ``wavelength_m``, float64 (wavelength,) over
        :data:`saf_gen.core.spectrum.NM`.

        Raises
        ------
        BadInput
            If the sensor does not see light of ``wavelength_m``, or would count more than one electron per photon.
        """
        return spectral_response(
            self.spectral_qe, self.filter, wavelength_m=self.wavelength_m, quantum_efficiency=self.quantum_efficiency
        )

    @property
    def post_spike_loss(self) -> float:
        """Fraction of its charge that the readout after a spike loses: 1 with ``dead_readout``, else ``reset_loss``."""
        return 1.0 if self.saturation == "dead_readout" else self.reset_loss

    @property
    def max_excess_thresholds(self) -> int:
        """Largest charge above the threshold that is kept at a spike, in thresholds.

        The photodiode cannot hold more, so the effect of an overload ends soon. One threshold is enough for
        ``subtract``. The law of ``dead_readout`` needs the charge of a full readout; with 15 thresholds it holds up to
        a rate of 0.94.
        """
        return 15 if self.saturation == "dead_readout" else 1

    @property
    def dark_rate_at_temperature(self) -> float:
        """Mean dark rate at ``temperature_c``, spikes per readout, regardless of the switch ``noise.dark``."""
        return self.dark_rate * 2.0 ** ((self.temperature_c - self.dark_temperature_c) / self.dark_doubling_k)

    @property
    def mean_dark_e(self) -> float:
        """Mean dark charge at ``temperature_c``, electrons per readout; 0 if dark current is switched off."""
        return self.dark_rate_at_temperature * self.threshold_e if self.noise.dark else 0.0

    def with_noise(self, **switches: bool) -> "Sensor":
        """Return a copy with some noise switched on or off, such as ``with_noise(shot=False)``.

        Raises BadInput if a switch is unknown.
        """
        return change_fields(self, {"noise": switches}, where=f"sensor {self.name}")


@lru_cache(maxsize=64)
def spectral_response(
    spectral_qe: SpectralCurve, transmission: SpectralCurve, *, wavelength_m: float, quantum_efficiency: float
) -> np.ndarray:
    """Return :meth:`Sensor.spectral_response` of a sensor with these fields."""
    nm = wavelength_m * 1e9
    shape = shipped_curve("silicon", "efficiency") if isinstance(spectral_qe, str) else _interpolated(spectral_qe)
    at_nominal = float(np.interp(nm, NM, shape, left=0.0, right=0.0))
    if not at_nominal > 0:
        raise BadInput(f"spectral_qe is 0 at wavelength_m, {nm:g} nm", allowed="above 0 there")
    if (largest := quantum_efficiency * float(shape.max()) / at_nominal) > 1 + 1e-9:
        raise BadInput(
            f"with quantum_efficiency {quantum_efficiency:g} at {nm:g} nm, spectral_qe reaches {largest:.3g}",
            allowed="at most 1 electron per photon at any wavelength",
        )
    passed = np.ones_like(NM)
    if not isinstance(transmission, str):
        passed = _interpolated(transmission)
    elif transmission != "none":
        passed = shipped_curve(transmission, "transmission")
    return np.asarray(shape / at_nominal * passed * NM / nm)


def _interpolated(table: tuple[tuple[float, float], ...]) -> np.ndarray:
    """Return a table over NM, zero outside it."""
    nm, values = np.array(table).T
    return np.interp(NM, nm, values, left=0.0, right=0.0)
