"""Lamps mixed from one stack: electrons per lux, conservation, equality in reference light, and the truth of a mix."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal
from scipy.special import j1
from small_dataset import DRIVE, SPEC

from saf_gen.camera import get_sensor
from saf_gen.core.spectrum import NM, power_per_light
from saf_gen.optics import AxialColour, FocalLengthDrive, ImageDistanceDrive
from saf_gen.optics.axial_colour import shifted_positions, stack_margin
from saf_gen.plugins.lights import group_gains
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.colour import SHARES, Colour
from saf_gen.stack.focal_stack import FocalStack
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stack.true_focus import _few_depths, find_true_focus

SENSOR = get_sensor("ideal", rows=16, columns=24, pitch_m=60e-6)
LENS = {"achromat": 500.0}
VARIFOCAL = FocalLengthDrive(0.0265, 2.12, (0.6, 0.42))
CROSSING = [
    {"kind": "ramp", "from": 1.0, "to": 0.0, "spectrum": "tungsten"},
    {"kind": "ramp", "from": 0.0, "to": 1.0, "spectrum": "led"},
]
SWEEP = (np.arange(400) + 0.5) / 400


def find(schedule, *, lens=LENS, sensor=SENSOR, groups=("lamp", "room")):
    return Colour.find(schedule, groups, sensor=sensor, axial_colour=lens)


def lit_by(spectrum, **options):
    return find({"": {"kind": "constant", "spectrum": spectrum}}, **options)


def wide_stack(drive=VARIFOCAL, light=None):
    margin = stack_margin(AxialColour(**LENS), drive, positions=SPEC.positions, reference_nm=555.0)
    spec = replace(SPEC, drive=drive, margin=margin)
    if light is None:
        light = np.random.default_rng(5).uniform(0.1, 1, (2, spec.rendered_count, 16, 24)).astype(np.float32)
    return FocalStack(spec, light, np.full((16, 24), 0.5, np.float32), np.ones((16, 24), bool), "llvm")


def mixed(colour, stack):
    first = stack.spec.first_index
    rendered = range(first, first + stack.spec.rendered_count)
    return colour.mix(stack.radiance, stack.spec, drawn=stack.spec.drawn, rendered=rendered)


def test_groups_without_a_spectrum_are_not_mixed():
    assert find({"": {"kind": "constant"}}) is None
    assert find({"lamp": {"kind": "constant"}}) is None


def test_light_of_the_reference_wavelength_is_the_picture_itself():
    stack = wide_stack()
    lamps = [{"kind": "constant"}, {"kind": "constant", "spectrum": "led"}]
    several = find({"lamp": lamps}, sensor=replace(SENSOR, filter="ir_cut"))
    assert several.names == ("lamp 1", "lamp 2 (led)", "room")
    found = mixed(several, stack)
    inside = stack.radiance[:, stack.spec.margin[0] : stack.spec.rendered_count - stack.spec.margin[1]]
    assert np.array_equal(found[0], inside[0])
    assert np.array_equal(found[2], inside[1])
    assert not np.array_equal(found[1], inside[0])


@pytest.mark.parametrize("lamp", ["led", "tungsten", "sodium", {"daylight": 6504}])
@pytest.mark.parametrize("transmission", ["none", "ir_cut"])
def test_an_even_field_gives_the_electrons_of_an_own_integral(lamp, transmission):
    """By numbers written out here: watts at one lux, photons, electrons; relative to 1/683 W at 555 nm."""
    sensor = replace(SENSOR, filter=transmission)
    colour = lit_by(lamp, sensor=sensor)
    found = mixed(colour, wide_stack(light=np.ones_like(wide_stack().radiance)))
    photons = power_per_light(lamp) * NM / 555.0
    efficiency = sensor.spectral_response() / (NM / 555.0)
    own = float((photons * efficiency).sum())
    assert found == pytest.approx(own, rel=1e-5)
    if transmission == "none" and lamp != "sodium":
        assert own > 1.9  # the eye is blind to most of the light that silicon sees


@pytest.mark.parametrize("drive", [VARIFOCAL, DRIVE], ids=["focal_length", "image_distance"])
def test_a_lamp_sees_each_position_where_its_light_focuses(drive):
    """A stack whose radiance is the square of the position is mixed to the mean of squares, by an own sum."""
    knots = wide_stack(drive).spec.focus
    light = np.broadcast_to((knots**2 + 1)[None, :, None, None], (2, knots.size, 16, 24)).astype(np.float32)
    stack = wide_stack(drive, light)
    colour = lit_by("tungsten")
    found = mixed(colour, stack)[0, :, 0, 0]
    weights = power_per_light("tungsten") * SENSOR.spectral_response()
    shifts = AxialColour(**LENS).relative_power(NM, reference_nm=555.0) / (2 * drive.aperture_radius_m * drive.f_number)
    for k, position in enumerate(np.linspace(0, 1, SPEC.positions)):
        other = shifted_positions(drive, position, shift=shifts)
        own = float(weights @ np.interp(other, knots, knots**2 + 1))
        assert found[k] == pytest.approx(own, rel=1e-5)


def test_two_lamps_are_the_sum_of_each_alone():
    stack = wide_stack()
    both = ChargeSource(PlaneSource.from_stack(stack), SENSOR, colour=find({"": CROSSING}))
    gain = group_gains({"": CROSSING}, stack.spec.groups, frames=400, readout_hz=20_000)
    assert gain.shape == (400, 4)
    alone = [
        ChargeSource(PlaneSource.from_stack(stack), SENSOR, colour=lit_by(lamp)).charge_image(0, 0.3)
        for lamp in ("tungsten", "led")
    ]
    found = both.charge_image(0, 0.3)
    assert np.array_equal(found[0::2], alone[0])
    assert np.array_equal(found[1::2], alone[1])
    assert both.nominal_image(0, 0.3) == pytest.approx((alone[0] + alone[1]).sum(axis=0) / 2, rel=1e-6)


def test_a_wide_stack_gives_the_charge_of_the_travel():
    """In light of one wavelength too: the margin is left out at every position."""
    stack = wide_stack()
    narrow = stack.without_margin()
    assert narrow.spec == replace(stack.spec, margin=(0, 0))
    assert narrow.radiance.shape[1] == len(narrow.spec.focus) == SPEC.positions
    for position in (0.0, 0.37, 1.0):
        found, own = (
            ChargeSource(PlaneSource.from_stack(one), SENSOR).charge_image(0, position) for one in (stack, narrow)
        )
        assert found == pytest.approx(own, rel=1e-6)


def truth_of(schedule, stack, *, gain=None):
    colour = find(schedule)
    if gain is None:
        gain = group_gains(schedule, stack.spec.groups, frames=400, readout_hz=20_000)
    blends = colour.blends(stack.spec, gain=gain, charge=np.ones(len(colour.lamps)))
    return find_true_focus(PlaneSource.from_stack(stack), SWEEP, blends=blends)[0], blends


@pytest.mark.slow
def test_the_truth_follows_the_mix_of_the_lamps():
    """Crossing lamps begin and end with the truth of each alone, and are met where the lens passes the moving truth."""
    stack = wide_stack()
    tungsten, led = (truth_of({"": {"kind": "constant", "spectrum": lamp}}, stack)[0] for lamp in ("tungsten", "led"))
    assert tungsten.track is None
    assert tungsten.least_blur is not None
    crossing, blends = truth_of({"": CROSSING}, stack)
    assert crossing.track[[0, -1]] == pytest.approx([tungsten.position, led.position], abs=2 / SHARES)
    assert abs(tungsten.position - led.position) > 0.1
    assert len(blends.blends) > SHARES / 2
    assert (np.diff(crossing.track) * np.sign(led.position - tungsten.position) > -1e-3).all()
    at = round(crossing.frame)
    assert crossing.position == pytest.approx(SWEEP[at], abs=0.01)
    assert crossing.best_position == pytest.approx(crossing.position, abs=0.02)


def test_lamps_of_one_spectrum_are_one_light():
    stack = wide_stack()
    led = {"kind": "constant", "spectrum": "led"}
    once, blends = truth_of({"": led}, stack)
    twice, _ = truth_of({"lamp": [led, led], "room": led}, stack)
    assert len(blends.blends) == 1
    assert twice.position == once.position


def test_darkness_keeps_the_usual_mix():
    stack = wide_stack()
    gain = np.ones((400, 4), np.float32)
    gain[100:200] = 0
    truth, blends = truth_of({"": CROSSING}, stack, gain=gain)
    assert len(blends.blends) == 1
    assert np.isfinite(truth.position)


def test_a_lens_without_axial_colour_keeps_the_closed_form():
    stack = wide_stack()
    colour = lit_by("led", lens=None)
    blends = colour.blends(stack.spec, gain=np.ones((400, 2)), charge=np.ones(2))
    found = find_true_focus(PlaneSource.from_stack(stack), SWEEP, blends=blends)[0]
    plain = find_true_focus(PlaneSource.from_stack(stack), SWEEP)[0]
    assert found.position == plain.position
    assert found.least_blur is None


def test_a_scale_that_would_be_wrong_is_refused_and_a_lens_that_keeps_it_is_not():
    strong = {"singlet": "n-bk7"}
    macro = ImageDistanceDrive(0.05, 2.0, (0.8, 0.6))
    wide = replace(SPEC, drive=macro, rows=250, columns=400, pitch_m=20e-6)
    assert "scale of pictures" in str(refusal(lit_by("tungsten", lens=strong).check, wide))
    lit_by("tungsten", lens={"achromat": 2000}).check(wide)
    lit_by("tungsten", lens=strong).check(replace(wide, drive=FocalLengthDrive(0.0535, 2.14, (0.8, 0.6))))


def test_waves_that_one_wavelength_cannot_show_are_refused():
    slow = ImageDistanceDrive(0.05, 22.0, (0.8, 0.6))
    spec = replace(SPEC, drive=slow, pitch_m=20e-6, wavelength_m=555e-9)
    assert "waves of" in str(refusal(lit_by("tungsten", lens=None).check, spec))
    lit_by("tungsten", lens=None).check(replace(spec, wavelength_m=0.0))
    lit_by("sodium", lens=None).check(spec)


@pytest.mark.slow
@pytest.mark.parametrize("lamp", ["tungsten", "led"])
def test_the_truth_is_where_mixed_pictures_are_sharpest(lamp):
    """Gratings blurred by a disc, drawn here, mixed by the product, and the truth of the product.

    Their frequencies are spread as the power of the truth's texture; within 0.1 half depths of focus.
    """
    fine = replace(SPEC, drive=VARIFOCAL, positions=65, pitch_m=20e-6)
    margin = stack_margin(AxialColour(**LENS), VARIFOCAL, positions=65, reference_nm=555.0)
    spec = replace(fine, margin=margin)
    defocus = VARIFOCAL.defocus(spec.focus, 0.5)
    radius, v = VARIFOCAL.aperture_radius_m, float(VARIFOCAL.image_distance(0.5))
    column = np.arange(24)
    contrast = np.zeros(65)
    for cycles in np.geomspace(1 / 64, 0.5, 40):
        x = 2 * np.pi * v * radius * cycles / 20e-6 * np.abs(defocus) + 1e-12
        transfer = 2 * j1(x) / x * np.sinc(cycles)
        one = 1 + 0.5 * transfer[:, None] * np.cos(2 * np.pi * cycles * column)
        light = np.broadcast_to(one[None, :, None, :], (2, defocus.size, 16, 24)).astype(np.float32)
        found = mixed(lit_by(lamp), FocalStack(spec, light, np.ones((16, 24)), np.ones((16, 24), bool), "llvm"))[
            0, :, 0
        ]
        basis = np.stack([np.cos(2 * np.pi * cycles * column), np.ones(24)])
        wave, mean = np.linalg.lstsq(basis.T, found.T, rcond=None)[0]
        contrast += (wave / mean) ** 2
    blend = lit_by(lamp).blends(spec, gain=np.ones((1, 2)), charge=np.ones(2)).blends[0]
    depth = np.full((1, 1), 0.5)
    truth = replace(spec.in_focus, blend=blend).true_focus(depth, depth > 0)
    k = int(contrast.argmax())
    low, at, high = contrast[k - 1 : k + 2]
    peak = (k + (low - high) / (2 * (low - 2 * at + high))) / 64
    half = abs(float(VARIFOCAL.depth_of_focus(0.5, 20e-6)[0]) - 0.5)
    assert (truth - peak) / half == pytest.approx(0, abs=0.1)
    assert abs(truth - spec.in_focus.true_focus(depth, depth > 0)) / half > 0.3


def test_few_depths_of_a_relief_have_the_focus_of_all():
    """Within a hundredth of half a depth of focus."""
    depth = 0.5 + 0.02 * np.random.default_rng(2).random((80, 100)) ** 2
    target = depth < 0.515
    few, seen = _few_depths(SPEC, depth, target=target)
    assert few.size < target.sum() / 10
    half = DRIVE.depth_of_focus(0.5, SPEC.pitch_m)[1] - 0.5
    apart = SPEC.in_focus.true_focus(few, seen) - SPEC.in_focus.true_focus(depth, target)
    assert apart / half == pytest.approx(0, abs=0.01)
