"""Bands: lenses read from files, drawn at several wavelengths, against an own sum over many.

The pictures are drawn here, without a renderer and without noise: a strip of pixels far off the axis looks at a flat
target of random bars, or at an edge; each pixel is the mean of the target over pupil and pixel, by the rays of the lens
at one wavelength.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from small_dataset import SPEC

from saf_gen.camera import get_sensor
from saf_gen.core.spectrum import NM, power_per_light
from saf_gen.optics import FocusCriterion
from saf_gen.optics.axial_colour import BAND_NM, stack_margin
from saf_gen.optics.lens_card import LensFile
from saf_gen.optics.lens_colour import band_waves, hats, lens_colour
from saf_gen.optics.texture_contrast import Light, lens_points
from saf_gen.stack.colour import Colour

SENSOR = replace(get_sensor("ideal", rows=1, columns=64, pitch_m=20e-6), filter="ir_cut")
WAVES = 25  # of the own sum
POSITIONS = 33
REACH = 2.5  # depths of focus that the travel covers
BARS = np.random.default_rng(3).uniform(0.2, 1, 200).astype(np.float32)  # 3 pixels wide


class Lens(NamedTuple):
    card: LensFile
    height_m: float
    """Of the middle of the strip."""
    depth_m: float

    @property
    def spec(self):
        return replace(SPEC, drive=self.card.build_drive(), groups=("lamp",), rows=1, columns=64, positions=POSITIONS)


@cache
def lens(name, pitch_um):
    """A lens whose travel is a few depths of focus round the best focus of a strip, which is at the corner of 400 × 250
    pixels of 20 µm; of ``smartphone`` at the corner of what it draws.
    """
    f_number, depth, height = {"double_gauss": (2.0, 0.6, 4.7e-3), "c_mount": (1.4, 0.5, 4.7e-3)}.get(
        name, (2.4, 0.2, 1.7e-3)
    )
    one = Lens(LensFile(file=name, f_number=f_number, focus_range_m=(depth * 1.05, depth / 1.05)), height, depth)
    nearest = one.card.lens.nearest_m
    for reach in (10 * REACH, REACH):  # field curvature first
        drive = one.card.build_drive()
        low, high = drive.depth_of_focus(0.5, pitch_um * 1e-6)
        tried = 0.5 + reach * (high - low) * np.linspace(-0.5, 0.5, 41)
        tried = tried[(drive.object_distance(tried) > nearest) & (drive.object_distance(tried) < 10)]
        green = own_pictures(one, 550.0, tuple(tried), pitch_um=pitch_um)[0]
        best = tried[green.var(axis=1).argmax()]
        ends = drive.object_distance(best + REACH * (high - low) * np.array([-0.5, 0.5]))
        one = one._replace(card=LensFile(file=name, f_number=f_number, focus_range_m=tuple(ends)))
    return one


@cache
def own_pictures(lens, nm, position, *, pitch_um):
    """The strip before the bars and before the edge, at one wavelength: float32 (target, position, pixel)."""
    drive = lens.card.build_drive()
    rays = lens.card.lens.rays_at(float(nm))
    a = tuple(part[::4].astype(np.float32) for part in lens_points(drive.aperture_radius_m))
    depth, v0 = lens.depth_m, float(drive.image_distance(0.5))
    x = (lens.height_m + (np.arange(192) - 95.5) / 3 * pitch_um * 1e-6).astype(np.float32)[:, None]
    # What the green ray through the middle of the pupil meets from the middle of the strip is the middle of the target.
    zero, at = np.zeros(1), np.full(1, lens.height_m)
    b, s = lens.card.lens.rays_at(550.0).turn((zero, zero), (at, zero), image_distance_m=v0)
    middle = -lens.height_m / v0 + float(s[0][0] + b[0][0] / depth)
    found = []
    for p in position:
        v, u = float(drive.image_distance(p)), float(drive.object_distance(p))
        b, s = rays.turn(a, (x, np.float32(0)), image_distance_m=np.float32(v))
        seen = (
            middle - (a[0] * np.float32(1 / depth - 1 / u) - x / np.float32(v) + s[0] + b[0] / np.float32(depth))
        ) * v0
        places = seen / (pitch_um * 1e-6)
        bars = BARS[np.clip(np.floor(places / 3).astype(int) + 100, 0, 199)]
        found.append([one.mean(axis=1).reshape(64, 3).mean(axis=1) for one in (bars, places > 0)])
    return np.swapaxes(np.array(found, np.float32), 0, 1)


def weights(nm, lamp):
    return np.interp(nm, NM, power_per_light(lamp) * SENSOR.spectral_response())


def own_sum(one, lamp, *, pitch_um):
    """What a lamp draws at each position of the travel, by an own sum over wavelengths."""
    nm, travel = np.linspace(*one.card.lens.waves_nm, WAVES), tuple(np.linspace(0, 1, POSITIONS))
    share = np.interp(nm, NM, power_per_light(lamp) * SENSOR.spectral_response())
    pictures = (own_pictures(one, at, travel, pitch_um=pitch_um) for at in nm)
    return sum(w * light for w, light in zip(share / share.sum(), pictures, strict=True))


def mixed(one, lamp, *, pitch_um, bands):
    """The same by saf_gen's mix of stacks at few wavelengths, or of one stack at the lens's own."""
    fitted, spec = one.card.lens, one.spec
    colour = lens_colour(fitted, spec.drive, drawn_nm=fitted.primary_nm)
    waves = band_waves(fitted, bands) if bands > 1 else ()
    drawn = waves or (fitted.primary_nm,)
    margins = [
        stack_margin(colour.relative_to(at), spec.drive, positions=POSITIONS, reference_nm=0.0, nm=BAND_NM[part > 0])
        for part, at in zip(hats(BAND_NM, waves), drawn, strict=True)
    ]
    spec = replace(spec, margin=tuple(np.max(margins, axis=0).tolist()))
    found = Colour.find(
        {"": {"kind": "constant", "spectrum": lamp}},
        ("lamp",),
        sensor=SENSOR,
        axial_colour=colour.model_dump(mode="json", exclude_none=True),
        bands_nm=waves,
    )
    wide = range(spec.first_index, spec.first_index + spec.rendered_count)
    total = 0.0
    for band, at in enumerate(drawn):
        light = own_pictures(one, at, tuple(spec.focus), pitch_um=pitch_um)[:, :, None]
        parts = [found.mix(target[None], spec, band=band, drawn=spec.drawn, rendered=wide)[0, :, 0] for target in light]
        total = total + np.array(parts)
    return total / found.weights[0].sum()


def peak(pictures, one, pitch_um):
    """Where SD is largest, in half depths of focus from the first position."""
    middle = pictures[:, 8:-8]
    curve = middle.var(axis=1) / middle.mean(axis=1) ** 2
    k = int(curve.argmax())
    step = np.polyfit(np.arange(-3, 4), curve[k - 3 : k + 4], 2)
    low, high = one.spec.drive.depth_of_focus(0.5, pitch_um * 1e-6)
    return (k - step[1] / (2 * step[0])) / (POSITIONS - 1) / ((high - low) / 2)


def errors(name, pitch_um, lamp, *, bands):
    """Errors of the focus in half depths of focus, and of the place of the edge in pixels: that of a step with as much
    light, the largest within half a depth of focus."""
    one = lens(name, pitch_um)
    (bars, step), (own_bars, own_step) = (
        mixed(one, lamp, pitch_um=pitch_um, bands=bands),
        own_sum(one, lamp, pitch_um=pitch_um),
    )
    near = slice(POSITIONS // 2 - 6, POSITIONS // 2 + 7)
    places = (step - own_step)[near].sum(axis=1)
    return abs(peak(bars, one, pitch_um) - peak(own_bars, one, pitch_um)), float(np.abs(places).max())


LONG = pytest.mark.long
CASES = [
    ("double_gauss", 20, 4),
    pytest.param("c_mount", 20, 4, marks=LONG),
    pytest.param("smartphone", 5, 4, marks=LONG),
]


@pytest.mark.parametrize(("name", "pitch_um", "bands"), CASES)
def test_few_bands_draw_what_an_own_sum_of_25_wavelengths_draws(name, pitch_um, bands):
    """Far off the axis: SD's focus within 0.05 half depths of focus, edges within 0.05 pixels, and four times nearer
    than pictures of one wavelength.
    """
    focus, place = errors(name, pitch_um, "led", bands=bands)
    assert focus < 0.05
    assert place < 0.05
    assert place < errors(name, pitch_um, "led", bands=1)[1] / 3


def test_light_is_drawn_by_the_two_bands_next_to_it_in_linear_shares():
    waves = (550.0, 450.0, 650.0)
    nm = np.array([400.0, 450.0, 475.0, 550.0, 640.0, 700.0])
    own = [[0, 0, 0.25, 1, 0.1, 0], [1, 1, 0.75, 0, 0, 0], [0, 0, 0, 0, 0.9, 1]]
    assert hats(nm, waves) == pytest.approx(np.array(own))
    assert hats(nm, ()).tolist() == [[1] * 6]


@pytest.mark.parametrize("lamp", ["led", "tungsten", "sodium", {"daylight": 6504}])
def test_bands_lose_no_light_and_count_none_twice(lamp):
    one = LensFile(file="double_gauss", f_number=2.0, focus_range_m=(0.62, 0.58))
    colour = lens_colour(one.lens, one.build_drive(), drawn_nm=one.lens.primary_nm)
    found = Colour.find(
        {"": {"kind": "constant", "spectrum": lamp}},
        ("lamp",),
        sensor=SENSOR,
        axial_colour=colour.model_dump(mode="json", exclude_none=True),
        bands_nm=band_waves(one.lens, 5),
    )
    spec = replace(SPEC, drive=one.build_drive(), groups=("lamp",))
    rows = [found.mixing(0, spec, band=band, drawn=spec.drawn, rendered=spec.drawn).sum(axis=1) for band in range(5)]
    own = float((power_per_light(lamp) * SENSOR.spectral_response()).sum())
    assert np.sum(rows, axis=0) == pytest.approx(own, rel=1e-5)


def test_the_truth_of_bands_is_that_of_the_rays_of_25_wavelengths():
    """On the axis, where one wavelength's aberrations stand for all: within 0.02 half depths of focus."""
    card = LensFile(file="double_gauss", f_number=2.0, focus_range_m=(0.65, 0.55))
    colour = lens_colour(card.lens, card.build_drive(), drawn_nm=card.lens.primary_nm)
    waves = band_waves(card.lens, 4)
    found = Colour.find(
        {"": {"kind": "constant", "spectrum": "led"}},
        ("lamp",),
        sensor=SENSOR,
        axial_colour=colour.model_dump(mode="json", exclude_none=True),
        bands_nm=waves,
    )
    spec = replace(SPEC, drive=card.build_drive(), groups=("lamp",))
    specs = [replace(spec, drive=replace(spec.drive, wavefront=card.lens.rays_at(nm))) for nm in waves]
    blend = found.blends(specs, gain=np.ones((1, 1)), charge=np.ones(1)).blends[0]
    assert sum(share for share, _ in blend) == pytest.approx(1)
    nm = np.linspace(*card.lens.waves_nm, WAVES)
    share = np.interp(nm, NM, found.weights[0])
    each = zip(share / share.sum(), nm, strict=True)
    own = tuple((float(w), Light((0.0,), (1.0,), card.lens.rays_at(float(at)))) for w, at in each)
    depth, target = np.full((1, 1), 0.6), np.ones((1, 1), bool)
    low, high = spec.drive.depth_of_focus(0.5, 20e-6)
    for sort in ("true_focus", "least_blur"):
        at, expected = (
            getattr(FocusCriterion(one.drive, 20e-6, 0.0, light), sort)(depth, target)
            for one, light in ((specs[0], blend), (spec, own))
        )
        assert at == pytest.approx(expected, abs=0.02 * (high - low) / 2)
