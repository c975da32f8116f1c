"""Light schedules by name, and the gain of every readout."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from saf_gen.core.config import registry
from saf_gen.core.config.components import Component
from saf_gen.core.config.ranges import range_extremes
from saf_gen.core.spectrum import check_spectrum
from saf_gen.errors import BadInput, closest, unknown
from saf_gen.parts import Light, is_endless
from saf_gen.plugins.lights._groups import ROLES
from saf_gen.plugins.lights._lamps import PRODUCT, Schedule, list_lamps
from saf_gen.plugins.lights._product import multiply

COMMON_KEYS = {
    "offset": "Gain, 0 or more (0): constant light of the same group, which is added to the schedule.",
    "unit": "ratio or lux (ratio): with lux, the gains and the offset are illuminances of the target in lux.",
    "lux_at_gain_1": "Lux, above 0 (from the scene card): with unit lux, the illuminance of the target at gain 1.",
    "spectrum": "led, tungsten, sodium, or one in braces (one wavelength, that of the sensor): the spectrum of the "
    "light; {blackbody: KELVINS}, {daylight: KELVINS}, or {file: TABLE.csv} with the columns wavelength_nm, power.",
}
"""Keys that every kind of light schedule takes in addition to the fields of its class, with their meaning."""

UNITS = ("ratio", "lux")
GAIN_GRID = 2.0**-20
"""Gains are rounded to multiples of this step, so that spikes are the same on machines whose cosines differ in the last
digit."""


def get_light(
    name: str,
    /,
    *,
    offset: float = 0.0,
    unit: str = "ratio",
    lux_at_gain_1: float | None = None,
    spectrum: Any = None,
    **options: Any,
) -> Light:
    """Return a light schedule by its name.

    Parameters
    ----------
    name : str
        Kind of schedule: a file of ``saf_gen/plugins/lights``, a kind that another package offers,
        ``package.module:Class`` or ``file.py:Class``.
    offset : float, default 0
        Constant light added to the schedule, in ``unit``, 0 or more.
    unit : {"ratio", "lux"}, default "ratio"
        Unit of the schedule: gains, or illuminances of the target, which are divided by ``lux_at_gain_1``.
    lux_at_gain_1 : float, optional
        Illuminance of the target at gain 1 in lux, above 0; required if ``unit`` is "lux".
    spectrum : str or mapping, optional
        Spectrum of the light (:mod:`saf_gen.core.spectrum`). It is checked, and changes no gain: a gain is an
        illuminance.
    **options
        Fields of the schedule's class.

    Returns
    -------
    Light
        The schedule; gain 1 is the light as the scene defines it.

    Raises
    ------
    BadInput
        If the name or an option is unknown, or if a value is not allowed.
    """
    known = registry.option_fields("lights", name)
    for key in options:
        if key not in known:
            raise unknown(f"key of light schedule {name!r}:", key, allowed=(*known, *COMMON_KEYS))
    light: Light = registry.build_plugin("lights", name, **options)
    return scale_light(light, offset=offset, unit=unit, lux_at_gain_1=lux_at_gain_1, spectrum=spectrum)


def scale_light(
    light: Light, *, offset: float = 0.0, unit: str = "ratio", lux_at_gain_1: float | None = None, spectrum: Any = None
) -> Light:
    """Return a schedule under the keys that every schedule takes; :func:`get_light` says which values are allowed."""
    if spectrum is not None:
        check_spectrum(spectrum)
    if not (isinstance(offset, int | float) and 0 <= offset < inf):
        raise BadInput(f"offset is {offset!r}", allowed="0 or more, added to the gain")
    if unit not in UNITS:
        raise BadInput(f"unit is {unit!r}", allowed=", ".join(UNITS), nearest=closest(unit, UNITS))
    if unit == "lux" and lux_at_gain_1 is None:
        raise BadInput(
            "the schedule is in lux, but the illuminance at gain 1 is unknown",
            allowed="illuminance_lux on the scene's card, or lux_at_gain_1 in the schedule",
        )
    if unit == "ratio" and lux_at_gain_1 is not None:
        raise BadInput(f"lux_at_gain_1 is {lux_at_gain_1!r} in a schedule of ratios", hint="add unit: lux")
    unit_gain = 1.0 if lux_at_gain_1 is None else lux_at_gain_1
    if not (isinstance(unit_gain, int | float) and 0 < unit_gain < inf):
        raise BadInput(f"lux_at_gain_1 is {unit_gain!r}", allowed="lux, above 0")
    return light if offset == 0 and unit_gain == 1 else _ScaledLight(light, offset, unit_gain)


def build_light(component: Component) -> Light:
    """Return the schedule of a component, ``{kind: ..., ...}`` or ``{product: [...], ...}``, without open numbers.

    Raises BadInput if the component is neither, or by a value that is not allowed.
    """
    if PRODUCT in component:
        light = multiply(map(build_light, list_factors(component)))
        return scale_light(light, **{key: value for key, value in component.items() if key != PRODUCT})
    if "kind" not in component:
        raise BadInput("a light schedule has no kind", allowed="{kind: ..., ...}, or {product: [...]}")
    return get_light(component["kind"], **{key: value for key, value in component.items() if key != "kind"})


def list_factors(component: Component) -> list[Component]:
    """Return the factors of a product, each of them a component with a kind, or a choice among several.

    Raises BadInput if there are fewer than two factors, if one of them is no schedule, another product or a list, or if
    it has a key that belongs to the product.
    """
    factors = component[PRODUCT]
    for key in component:
        if key == "kind":
            raise BadInput(
                f"a schedule has the kind {component[key]!r} and a product",
                allowed="one of the two",
                hint="make the kind one of the factors",
            )
        if key != PRODUCT and key not in COMMON_KEYS:
            raise unknown("key of a product of light schedules:", key, allowed=(PRODUCT, *COMMON_KEYS))
    if not isinstance(factors, list) or len(factors) < 2:
        one = isinstance(factors, dict) or (isinstance(factors, list) and len(factors) == 1)
        raise BadInput(
            f"the product is {factors!r}",
            allowed="a list of at least two schedules, [{kind: ramp, from: 1, to: 2}, {kind: flicker, depth: 0.3}]",
            hint="write a single schedule without product" if one else "",
        )
    for n, factor in enumerate(factors, start=1):
        for one in range_extremes(factor):
            _check_factor(one, what=f"factor {n} of the product")
    return factors


def _check_factor(factor: Any, *, what: str) -> None:
    """Raise BadInput unless a factor is one schedule by its kind, and leaves to the product what belongs to that."""
    if isinstance(factor, dict) and PRODUCT in factor:
        raise BadInput(f"{what} is a product itself", hint="put all factors into one list: order does not matter")
    if not isinstance(factor, dict) or "kind" not in factor:
        raise BadInput(
            f"{what} is {factor!r}",
            allowed=f"{{kind: ..., ...}} with a kind among {', '.join(registry.names('lights'))}",
            hint="lights that add up are a list of schedules" if isinstance(factor, list) else "",
        )
    for key in COMMON_KEYS:
        if key in factor:
            raise BadInput(
                f"{what} has the key {key!r}, which belongs to the whole lamp",
                allowed=f"{key} beside product",
                hint=f"write {{product: [...], {key}: ...}}",
            )


@dataclass(frozen=True)
class _ScaledLight:
    """The schedule (``light`` + ``offset``) / ``unit_gain``."""

    light: Light
    offset: float
    unit_gain: float

    @property
    def endless(self) -> bool:
        """Whether the schedule goes on after the recording."""
        return is_endless(self.light)

    def integral(self, seconds: np.ndarray, duration_s: float) -> np.ndarray:
        """Return the integral of the gain from 0 to each time, in seconds."""
        steady = self.offset * np.asarray(seconds, dtype=np.float64)
        return (self.light.integral(seconds, duration_s) + steady) / self.unit_gain


def gains_at_readouts(light: Light, frames: int, *, readout_hz: float, duration_s: float | None = None) -> np.ndarray:
    """Return the mean gain of each readout.

    Gains are means over a readout instead of samples, as on a sensor that integrates: a lamp that flickers at 100 Hz
    gives the same sum in every window of 200 readouts at 20 kHz.

    Parameters
    ----------
    light : Light
        The schedule.
    frames : int
        Number of readouts.
    readout_hz : float
        Readouts per second.
    duration_s : float, optional
        Length of the recording, in seconds, if it has fewer readouts than these; the light must then be endless.

    Returns
    -------
    ndarray of float32, shape (frames,)
        Gains, 0 or more, rounded to multiples of 2**-20.

    Raises
    ------
    BadInput
        If the gain falls below 0.
    """
    edges = np.arange(frames + 1) / readout_hz
    recorded_s = frames / readout_hz if duration_s is None else duration_s
    integral = registry.sample_function(light, light.integral, seconds=edges, duration_s=recorded_s)
    gains = np.diff(integral) * readout_hz
    if not gains.min() >= -1e-9:
        raise BadInput(f"the gain of {light!r} falls to {gains.min():.3g}", allowed="gains of 0 or more")
    return (np.round(np.maximum(gains, 0) / GAIN_GRID) * GAIN_GRID).astype(np.float32)


def group_gains(
    schedule: Mapping[str, Schedule],
    groups: Sequence[str],
    *,
    frames: int,
    readout_hz: float,
    duration_s: float | None = None,
) -> np.ndarray:
    """Return the mean gain of each readout for each light group, or each lamp of :func:`list_lamps`.

    Parameters
    ----------
    schedule : mapping of str to mapping
        Components by light group, as :func:`draw_schedule` returns them. A group that is missing has gain 1.
    groups : sequence of str
        Light groups of the scene.
    frames : int
        Number of readouts.
    readout_hz : float
        Readouts per second.
    duration_s : float, optional
        Length of the recording, in seconds, as of :func:`gains_at_readouts`.

    Returns
    -------
    ndarray of float32, shape (frames, L)
        Gains, 0 or more, of L lamps: one for each group, or as many as it has schedules.

    Raises
    ------
    BadInput
        If the schedule names a group that the scene does not have, if a gain falls below 0, or if float32 cannot hold
        a gain.
    """
    for name in schedule:
        if name and name not in groups:
            raise BadInput(
                f"the scene has no light group {name!r}",
                allowed=f"{', '.join(groups)}, or a role: {', '.join(ROLES)}",
                nearest=closest(name, [*groups, *ROLES, PRODUCT]),
                hint="saf-gen scenes list shows groups and roles",
            )
    lamps = list_lamps(schedule, groups)
    gains = np.ones((frames, len(lamps)), dtype=np.float32)
    for g, (_, component, _) in enumerate(lamps):
        if component is not None:
            light = build_light(component)
            with np.errstate(over="ignore", invalid="ignore"):  # an overflow raises BadInput below
                gains[:, g] = gains_at_readouts(light, frames, readout_hz=readout_hz, duration_s=duration_s)
            if not np.isfinite(gains[:, g]).all():
                raise BadInput(
                    f"the gain of {light!r} is too large to be recorded",
                    allowed=f"gains up to {np.finfo(np.float32).max:.2g}",
                )
    return gains
