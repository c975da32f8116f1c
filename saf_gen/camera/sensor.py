"""Spike-camera sensors: frozen values read from ``sensors/<name>.yaml`` or from a user's own file."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, PlainValidator
from pydantic.dataclasses import dataclass

from saf_gen.core.config.document import validate_document
from saf_gen.core.config.presets import Presets, Sources, Switch, Text, between, change_preset_fields, checked
from saf_gen.core.config.ranges import is_number
from saf_gen.core.config.yaml_document import parse_yaml
from saf_gen.errors import BadInput


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class NoiseSwitches:
    """Which imperfections act. Each is switched on its own; its numbers stay in the sensor.

    shot : Poisson electrons; the charge between two spikes has the variance ``threshold_e`` (e-²).
    dark : dark current, log-normal over the pixels, with hot pixels.
    response : photo-response non-uniformity of the chip: profiles of columns and rows, the twist, the first column and
        row, the white rest, and what goes with dark charge.
    threshold_spread : thresholds differ between pixels and stay as they are.
    threshold_noise : the threshold is drawn anew after each spike.
    dust : some pixels lie in the shadow of a speck.
    dead : some pixels never fire.
    reset_jitter : the instant of a reset is uncertain.
    """

    shot: Switch
    dark: Switch
    response: Switch
    threshold_spread: Switch
    threshold_noise: Switch
    dust: Switch = False
    dead: Switch = False
    reset_jitter: Switch = False


# The ranges are wide, and narrow enough to refuse a pitch in micrometres, a wavelength in nanometres or an
# rms in percent.
MAX_DARK_RATE = 0.5
PixelCount = Annotated[int, between(1, 16_384, unit="pixels", whole=True)]
Celsius = Annotated[float, between(-100, 150, unit="°C")]
Fraction = Annotated[float, between(0, 1, unit="of all pixels")]
ResponseRms = Annotated[float, between(0, 0.3, unit="of the mean")]
ResponseExcess = Annotated[float, between(-0.9, 0.9, unit="of the mean")]


def _are_shares(value: Any) -> bool:
    fits = isinstance(value, list | tuple) and len(value) <= 8 and all(is_number(x) and 0 <= x <= 1 for x in value)
    return fits and sum(value) <= 1 + 1e-9


LegendreShares = Annotated[
    tuple[float, ...],
    PlainValidator(
        checked(_are_shares, "a list of at most 8 shares, each 0 to 1 and together at most 1", convert=tuple)
    ),
    "shares of the profile's variance in Legendre polynomials of degree 1, 2, …; the rest is white",
]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Sensor:
    """The array of a spike camera: geometry, conversion of light to charge, spiking, and noise.

    Lengths are in metres, charge is in electrons, and rms values are fractions of the mean.

    wavelength_m : light is converted to electrons at this one wavelength.
    reset : a spike subtracts the threshold from the charge (``subtract``), or clears the charge (``hard``,
        which makes rates wrong by −4 to −20 %).
    saturation : with ``subtract``, rate = charge/threshold up to 1; with ``dead_readout`` the readout after a
        spike collects nothing, and rate = 1/(1 + threshold/charge).
    reset_loss : fraction of its charge that the readout after a spike loses.
    dark_rate : mean over the pixels, spikes per readout.
    dark_hot_fraction : fraction of pixels above ``dark_hot_factor`` × the median, including the tail of the
        log-normal itself.
    dark_hot_exponent : hot pixels follow a Pareto law: above x medians lie so many as x to the power of minus this.
    response_column_rms, response_row_rms : rms of the profile of all columns, and of all rows.
    response_column_legendre, response_row_legendre : how much of its variance is smooth, degree by degree; a bow
        is of degree 2, a tilt of degree 1. Their signs are the device's.
    response_white_rms : what is left is normal and white.
    response_twist_rms : a tilt of the columns times a tilt of the rows.
    response_first_column, response_first_row : how much more the pixels at these two edges of the array respond.
    response_per_dark, response_per_dark_spread : mean rise of a pixel's response for each mean dark charge that it
        has, and how much that rise differs between pixels, relative rms.
    dust_fraction, dust_depth_rms : fraction of pixels in the shadow of a speck; the light that it takes, half-normal.
    dead_fraction : fraction of pixels that never fire.
    reset_jitter : standard deviation of the instant of a reset, readouts.
    row_skew : time from the reading of the first row to that of the last, readouts. Frame t is that of the last row.
    dark_doubling_k, dark_temperature_c, temperature_c : dark current doubles every so many kelvins; ``dark_rate`` holds
        at the first temperature (°C), the sensor works at the second.

    A key with a default may be left out of a file: the thing is absent then, as it was before there was such a key.

    A value that is not allowed raises BadInput from the functions of this module, and a ValueError from the
    constructor and from ``dataclasses.replace``.
    """

    name: Text
    rows: PixelCount
    columns: PixelCount
    pitch_m: Annotated[float, between(2e-7, 1e-3, unit="metres")]
    readout_hz: Annotated[float, between(1, 1e7, unit="hertz")]
    threshold_e: Annotated[float, between(1e-3, 1e7, unit="electrons")]
    quantum_efficiency: Annotated[float, between(1e-4, 1, unit="electrons per photon")]
    fill_factor: Annotated[float, between(1e-4, 1, unit="of the pixel's area")]
    wavelength_m: Annotated[float, between(1e-7, 1e-5, unit="metres")]
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
        "how steeply hot pixels grow rare: above x medians lie so many as x to the power of minus this",
    ]
    response_column_rms: ResponseRms
    response_column_legendre: LegendreShares
    response_row_rms: ResponseRms
    response_row_legendre: LegendreShares
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

    def __post_init__(self) -> None:
        if self.noise.shot and self.threshold_e < 25:
            raise BadInput(
                f"threshold_e is {self.threshold_e:g} with shot noise on",
                where=f"sensor {self.name}",
                allowed="at least 25 electrons, where Poisson statistics are close enough to normal",
                hint="or switch noise.shot off",
            )
        if not self.dark_rate_at_temperature <= MAX_DARK_RATE:
            raise BadInput(
                f"at temperature_c {self.temperature_c:g} the dark rate is {self.dark_rate_at_temperature:.3g}",
                where=f"sensor {self.name}",
                allowed=f"at most {MAX_DARK_RATE:g} spikes per readout",
                hint=f"dark_rate is {self.dark_rate:g} at {self.dark_temperature_c:g} °C and doubles every "
                f"{self.dark_doubling_k:g} kelvins",
            )

    @property
    def post_spike_loss(self) -> float:
        """Fraction of its charge that the readout after a spike loses, whatever the reason."""
        return 1.0 if self.saturation == "dead_readout" else self.reset_loss

    @property
    def max_excess_thresholds(self) -> int:
        """The most charge above the threshold that is kept at a spike, in thresholds.

        The photodiode cannot hold more, so that an overload does not echo for long. One is enough for ``subtract``. The
        law of ``dead_readout`` needs the charge of a whole readout; with 15 it holds up to a rate of 0.94.
        """
        return 15 if self.saturation == "dead_readout" else 1

    @property
    def dark_rate_at_temperature(self) -> float:
        """Mean dark rate at ``temperature_c``, spikes per readout, whether it is switched on or not."""
        return self.dark_rate * 2.0 ** ((self.temperature_c - self.dark_temperature_c) / self.dark_doubling_k)

    @property
    def mean_dark_e(self) -> float:
        """Mean dark charge at ``temperature_c`` (e- per readout); 0 when dark current is switched off."""
        return self.dark_rate_at_temperature * self.threshold_e if self.noise.dark else 0.0

    def with_noise(self, **switches: bool) -> "Sensor":
        """Return a copy with some noise switched: ``with_noise(shot=False)``; BadInput if unknown."""
        return change_preset_fields(self, {"noise": switches}, where=f"sensor {self.name}")


PRESETS = Presets("sensor", Sensor, folder=Path(__file__).parent / "sensors")


def sensor_names() -> list[str]:
    """Return the names of the sensors that come with saf_gen, sorted."""
    return PRESETS.names()


def get_sensor(name: str | Path, **changes: Any) -> Sensor:
    """Return a sensor by name, or from a YAML file of one's own, with some fields changed.

    Parameters
    ----------
    name : a name of :func:`sensor_names`, or the path of a .yaml file.
    **changes : fields of :class:`Sensor` and their new values; ``noise`` may be a mapping of some switches.

    Returns
    -------
    Sensor

    Raises
    ------
    BadInput : an unknown name or field, or a value that is not allowed.

    Examples
    --------
    >>> get_sensor("vidar_400x250", threshold_e=400, noise={"dark": False}).threshold_e
    400
    """
    return PRESETS.get(name, changes)


def parse_sensor(text: str, where: str | Path) -> Sensor:
    """Return the sensor that the text of a sensor file describes; every stream file holds such a text.

    ``where`` stands in messages. Raises BadInput as :func:`get_sensor` does.
    """
    return validate_document(Sensor, parse_yaml(text, where))
