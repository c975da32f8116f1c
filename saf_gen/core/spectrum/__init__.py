"""Spectra by wavelength: the light of lamps, what sensors and filters leave of it, and what the eye sees.

A curve is an array over :data:`NM`, every nanometre from 380 to 1,100. Published tables in steps of 10 nm are files of
this folder with their sources; values between their lines are interpolated linearly. Light outside 380 to 1,100 nm is
left out: glass absorbs the shorter waves, and silicon does not see the longer ones.

The spectrum of a lamp is written in one of these forms::

    led                    CIE illuminant LED-B3, a white LED of 4103 K
    tungsten               CIE illuminant A, a black body of 2856 K
    sodium                 the two lines of low-pressure sodium, at 589.00 and 589.59 nm
    {blackbody: 3200}      Planck's law at a temperature in kelvins
    {daylight: 6504}       CIE daylight at a correlated colour temperature in kelvins
    {file: lamp.csv}       columns wavelength_nm, power (relative, per nanometre), zero outside

References
----------
CIE 015:2018, "Colorimetry", doi:10.25039/TR.015.2018, for daylight, illuminant A and illuminant LED-B3.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.constants import c, h, k

from saf_gen.core.config.ranges import is_number
from saf_gen.core.csv_table import parse_columns, parse_csv
from saf_gen.errors import BadInput, closest

NM = np.arange(380.0, 1101.0)
"""Wavelengths of all curves, nm."""

NAMES = ("led", "tungsten", "sodium")
FORMS = {"blackbody": (1000, 20_000), "daylight": (4000, 25_000)}
"""Forms with a temperature, and the range of the temperature in kelvins."""
TUNGSTEN_K = 2856.0
LAST_DAYLIGHT_NM = 830.0

Spectrum = str | Mapping[str, Any]
"""The spectrum of a lamp as a recipe writes it; a file is held as ``{"path": ..., "text": ...}``."""


def shipped_curve(name: str, column: str) -> np.ndarray:
    """Return a published curve of this folder, float64 (wavelength,), zero outside its table."""
    nm, values = _table(name, ("wavelength_nm", column))
    return np.interp(NM, nm, values, left=0.0, right=0.0)


def luminous_efficiency() -> np.ndarray:
    """Return V(λ), which is 1 at 555 nm, float64 (wavelength,)."""
    return shipped_curve("luminous_efficiency", "efficiency")


def check_spectrum(spectrum: object) -> None:
    """Raise BadInput unless ``spectrum`` is in one of the forms of this module and gives visible light."""
    power = _power(spectrum)
    if not float(power @ luminous_efficiency()) > 1e-6 * float(power.sum()):
        raise BadInput(
            f"the spectrum {describe(spectrum)} gives no light that the eye sees",
            allowed="light between 400 and 700 nm, because gains are illuminances",
        )


def describe(spectrum: object) -> str:
    """Return a spectrum as a short text, such as ``blackbody 3200 K`` or the path of its file."""
    if isinstance(spectrum, Mapping) and len(spectrum) == 1:
        ((form, value),) = spectrum.items()
        if form == "file":
            return str(value["path"] if isinstance(value, Mapping) and "path" in value else value)
        return f"{form} {value} K"
    return str(spectrum)


def power_per_light(spectrum: Spectrum) -> np.ndarray:
    """Return the power of a lamp per nanometre, for as much light to the eye as 1 W at 555 nm gives (683 lumens).

    Parameters
    ----------
    spectrum : str or mapping
        The spectrum in one of the forms of this module.

    Returns
    -------
    ndarray of float64, shape (wavelength,)
        Watts per nanometre.

    Raises
    ------
    BadInput
        See :func:`check_spectrum`.
    """
    check_spectrum(spectrum)
    power = _power(spectrum)
    return power / float(power @ luminous_efficiency())


def _power(spectrum: object) -> np.ndarray:
    """Return the relative power of a lamp per nanometre."""
    if isinstance(spectrum, str) and spectrum in NAMES:
        return _NAMED[spectrum]()
    if isinstance(spectrum, Mapping) and len(spectrum) == 1:
        ((form, value),) = spectrum.items()
        if form == "file":
            return _from_file(value)
        if form in FORMS:
            low, high = FORMS[form]
            if not (is_number(value) and low <= value <= high):
                raise BadInput(f"{form} is {value!r}", allowed=f"{low:,} to {high:,} kelvins")
            return _black_body(float(value)) if form == "blackbody" else _daylight(float(value))
    forms = (
        {name: name for name in NAMES}
        | {form: f"{{{form}: KELVINS}}" for form in FORMS}
        | {"file": "{file: TABLE.csv}"}
    )
    name = next(iter(spectrum)) if isinstance(spectrum, Mapping) and spectrum else spectrum
    near = closest(str(name), forms)
    raise BadInput(f"spectrum is {spectrum!r}", allowed=", ".join(forms.values()), nearest=forms.get(near, ""))


def _black_body(kelvins: float) -> np.ndarray:
    metres = NM * 1e-9
    return np.asarray((NM / 560.0) ** -5 / np.expm1(h * c / (metres * k * kelvins)))


def _led() -> np.ndarray:
    return shipped_curve("led", "power")


def _sodium() -> np.ndarray:
    """Return the lines at 588.995 and 589.592 nm, the first twice as strong, between the two nearest nanometres."""
    power = np.zeros_like(NM)
    for nm, strength in ((588.995, 2.0), (589.592, 1.0)):
        first = int(np.floor(nm - NM[0]))
        power[first : first + 2] += strength * np.array([NM[first + 1] - nm, nm - NM[first]])
    return power


def _daylight(kelvins: float) -> np.ndarray:
    """Return S0 + M1·S1 + M2·S2; beyond the end of the tables, a black body of the same temperature (assumed)."""
    t = 1e3 / kelvins
    if kelvins <= 7000:
        x = 0.244063 + 0.09911 * t + 2.9678 * t**2 - 4.6070 * t**3
    else:
        x = 0.237040 + 0.24748 * t + 1.9018 * t**2 - 2.0064 * t**3
    y = -3.0 * x**2 + 2.870 * x - 0.275
    scale = 0.0241 + 0.2562 * x - 0.7341 * y
    first = (-1.3515 - 1.7703 * x + 5.9114 * y) / scale
    second = (0.0300 - 31.4424 * x + 30.0717 * y) / scale
    nm, s0, s1, s2 = _table("daylight", ("wavelength_nm", "s0", "s1", "s2"))
    power = np.interp(NM, nm, s0 + first * s1 + second * s2)
    beyond, body = LAST_DAYLIGHT_NM < NM, _black_body(kelvins)
    power[beyond] = power[NM == LAST_DAYLIGHT_NM] * body[beyond] / body[NM == LAST_DAYLIGHT_NM]
    return np.maximum(power, 0.0)


def _from_file(file: object) -> np.ndarray:
    nm, power = parse_csv(file, ("wavelength_nm", "power"))
    path = file["path"] if isinstance(file, Mapping) else ""
    if power.min() < 0 or power.max() <= 0:
        raise BadInput(f"power is {power.min():g}", where=path, allowed="0 or more, and above 0 somewhere")
    if not (nm[0] >= 100 and nm[-1] <= 100_000):
        raise BadInput(f"wavelength_nm runs from {nm[0]:g} to {nm[-1]:g}", where=path, allowed="nanometres")
    return np.interp(NM, nm, power, left=0.0, right=0.0)


_NAMED: dict[str, Callable[[], np.ndarray]] = {
    "led": _led,
    "tungsten": lambda: _black_body(TUNGSTEN_K),
    "sodium": _sodium,
}


@lru_cache(maxsize=16)
def _table(name: str, columns: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    path = Path(__file__).parent / f"{name}.csv"
    return parse_columns(path.read_text(encoding="utf-8"), columns, name=path.name)
