"""Spectra of lamps against closed forms and published numbers."""

import numpy as np
import pytest
from refusals import refusal

from saf_gen.core.spectrum import NM, check_spectrum, describe, luminous_efficiency, power_per_light

HC_OVER_K = 0.014387768775  # metre kelvins, CODATA 2018


@pytest.mark.parametrize("kelvins", [1000, 2856, 6500, 20_000])
def test_a_black_body_follows_plancks_law(kelvins):
    metres = NM * 1e-9
    law = metres**-5 / (np.exp(HC_OVER_K / (metres * kelvins)) - 1)
    found = power_per_light({"blackbody": kelvins})
    assert found / found[180] == pytest.approx(law / law[180], rel=1e-7)
    if kelvins == 2856:
        assert np.array_equal(found, power_per_light("tungsten"))


def test_daylight_of_6504_kelvins_is_illuminant_d65():
    """Published values of D65 (CIE 015:2018), relative to 100 at 560 nm."""
    published = {400: 82.7549, 460: 117.812, 500: 109.354, 560: 100.0, 620: 87.6987, 700: 71.6091, 780: 63.3828}
    found = power_per_light({"daylight": 6504})
    for nm, value in published.items():
        assert 100 * found[nm - 380] / found[180] == pytest.approx(value, rel=5e-4), nm


def test_sodium_is_two_thirds_at_589_nm_with_the_lines_mean_wavelength():
    found = power_per_light("sodium")
    assert found.sum() * float(np.interp(589.19, NM, luminous_efficiency())) == pytest.approx(1, rel=0.005)
    assert found @ NM / found.sum() == pytest.approx((2 * 588.995 + 589.592) / 3, abs=1e-6)


def test_the_eye_sees_what_the_cie_published():
    """V is 1 at 555 nm; its integral is 106.9 nm, and 683 lm/W times 0.7 % of illuminant A's visible power per watt."""
    seen = luminous_efficiency()
    assert seen[[510 - 380, 560 - 380, 610 - 380]] == pytest.approx([0.503, 0.995, 0.503])
    assert seen.sum() == pytest.approx(106.857, rel=2e-3)
    assert NM[seen.argmax()] == pytest.approx(555, abs=5)


@pytest.mark.parametrize("lamp", ["led", "tungsten", "sodium", {"blackbody": 3200}, {"daylight": 5000}])
def test_every_lamp_gives_the_light_of_one_watt_at_555_nm(lamp):
    power = power_per_light(lamp)
    assert power.min() >= 0
    assert power @ luminous_efficiency() == pytest.approx(1)


def test_a_table_is_interpolated_and_zero_outside():
    table = {"file": {"path": "lamp.csv", "text": "wavelength_nm,power\n# mine\n500,0\n550,2\n600,0\n"}}
    power = power_per_light(table)
    assert power[NM < 500].max() == power[NM > 600].max() == 0
    assert power[NM == 525] == pytest.approx(power[NM == 550] / 2)
    assert describe(table) == "lamp.csv"


def a_table(text):
    return {"file": {"path": "lamp.csv", "text": text}}


@pytest.mark.parametrize(
    ("spectrum", "said"),
    [
        ("LED", "did you mean 'led'"),
        ("tungsen", "did you mean 'tungsten'"),
        (2856, "spectrum is 2856"),
        ({"blackbody": 300}, "1,000 to 20,000 kelvins"),
        ({"blackbody": True}, "1,000 to 20,000 kelvins"),
        ({"blackbody": "2856"}, "1,000 to 20,000 kelvins"),
        ({"daylight": 2856}, "4,000 to 25,000 kelvins"),
        ({"dayligth": 6504}, "did you mean '{daylight: KELVINS}'"),
        ("daylight", "did you mean '{daylight: KELVINS}'"),
        ("file", "did you mean '{file: TABLE.csv}'"),
        ({"led": 4103}, "did you mean 'led'"),
        ({"blackbody": 3000, "daylight": 5000}, "allowed: led, tungsten"),
        ({}, "allowed: led, tungsten"),
        ([500, 600], "allowed: led, tungsten"),
        (a_table("nm,power\n500,1\n"), "lamp.csv:1: the columns are"),
        (a_table("wavelength_nm,power\n500,1\n490,1\n"), "lamp.csv:3: wavelength_nm goes from 500 to 490"),
        (a_table("wavelength_nm,power\n500,-1\n600,1\n"), "power is -1; allowed: 0 or more"),
        (a_table("wavelength_nm,power\n500,0\n600,0\n"), "above 0 somewhere"),
        (a_table("wavelength_nm,power\n0.5,1\n0.6,1\n"), "allowed: nanometres"),
        (a_table("wavelength_nm,power\n900,1\n950,1\n"), "no light that the eye sees"),
        (a_table("wavelength_nm,power\n"), "no rows"),
    ],
)
def test_what_is_no_lamp_is_refused_in_one_line(spectrum, said):
    text = str(refusal(check_spectrum, spectrum))
    assert said in text
    assert "\n" not in text
