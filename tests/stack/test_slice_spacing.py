"""Time slices are farther apart while what moves is out of focus, and mixing two of them is as exact as in focus."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import j1

from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage, Wavefront
from saf_gen.stack.focal_stack import LAYERED_POSITIONS, StackSpec
from saf_gen.stack.slice_spacing import (
    FACTOR_AT_FOCUS,
    FACTOR_PER_WIDTH,
    MAX_FACTOR,
    even_starts,
    layered_reach,
    slice_step,
    spaced_starts,
    spacing_factor,
)
from saf_gen.stack.time_resolved import slice_windows

FREQUENCIES = np.linspace(1e-3, 30, 30_000)  # per pixel


def mixing_error(moved, *, blur=0.0, waves=0.0):
    """W: the mean square half way between two slices, by its integral; all widths in pixels."""
    f = FREQUENCIES
    transfer = np.sinc(f)
    if blur:
        transfer = transfer * 2 * j1(np.pi * blur * f) / (np.pi * blur * f)
    if waves:  # of a perfect circular aperture, which passes up to 2 / waves
        part = np.clip(f * waves / 2, 0, 1)
        transfer = transfer * 2 / np.pi * (np.arccos(part) - part * np.sqrt(1 - part**2))
    return 2 * np.trapezoid(transfer**2 * (1 - np.cos(np.pi * f * moved)) ** 2 / (2 * np.pi * f) ** 2, f)


@pytest.mark.parametrize("moved", [0.25, 0.5, 1.0])
def test_a_sharp_edge_has_the_error_of_the_closed_form(moved):
    assert mixing_error(moved) == pytest.approx(moved**3 / 24, rel=1e-4)


@pytest.mark.parametrize("waves", [0.0, 1.0, 1.7, 3.0])
@pytest.mark.parametrize("moved", [0.1, 0.5, 1.0, 1.5])
def test_slices_farther_apart_out_of_focus_are_mixed_as_exactly_as_in_focus(moved, waves):
    in_focus = mixing_error(moved, waves=waves)
    for widths in np.linspace(0.6, 12, 12):
        factor = np.clip(FACTOR_AT_FOCUS + FACTOR_PER_WIDTH * widths, 1, MAX_FACTOR)
        blurred = mixing_error(factor * moved, blur=widths * np.hypot(1, waves), waves=waves)
        assert blurred <= 1.01 * in_focus


@pytest.mark.parametrize(
    ("hz", "slices_per_s", "step"), [(20_000, 100, 200), (20_000, 64, 312), (20_000, 1, 20_000), (20_000, 1e4, 8)]
)
def test_even_slices_are_whole_bytes_apart_and_end_with_the_recording(hz, slices_per_s, step):
    assert slice_step(hz, slices_per_s) == step
    for frames in (396, 20_000):
        at = even_starts(frames, step=step)
        assert at[0] == 0
        assert set(np.diff(at)[:-1]) <= {step}
        assert 0 < at[-1] - at[-2] <= step
        assert at[-1] == -(-frames // 8) * 8


def test_of_every_interval_the_sharpest_readout_decides():
    random = np.random.default_rng(3)
    knots = np.cumsum(random.uniform(-0.02, 0.03, 20_000))
    for _ in range(5):
        factor = np.clip(np.cumsum(random.normal(0, 0.02, 20_000)) + 2, 1, MAX_FACTOR)
        at = spaced_starts(step=56, factor=factor, knots=knots, reach=3.0)
        assert at[0] == 0
        assert at[-1] == 20_000
        assert not any(start % 8 for start in at)
        for begin, end in pairwise(at[:-1]):
            assert end - begin >= 56
            if end - begin > 56:
                assert end - begin <= 56 * factor[begin:end].min()
                assert np.ptp(knots[begin:end]) <= 3.0


def test_what_is_always_in_focus_has_even_slices():
    ones = np.ones(20_000)
    assert spaced_starts(step=56, factor=ones, knots=ones, reach=9.0) == even_starts(20_000, step=56)
    third = spaced_starts(step=200, factor=3 * ones, knots=ones, reach=9.0)
    assert third == even_starts(20_000, step=600)


SPEC = StackSpec("plane", "0" * 64, ("lamp",), ImageDistanceDrive(0.025, 2.0, (0.6, 0.42)), 6, 8, 20e-6, 129, 16, 4)
DRIVES = {
    "image_distance": (SPEC.drive, 0.5, 0.55),
    "focal_length": (FocalLengthDrive(0.03, 2.0, (0.6, 0.4)), 0.45, 0.5),
    "stage": (Stage(0.018, 1.8, 10.0, (-1e-4, 1e-4)), 0.01979, 0.01981),
}


@pytest.mark.parametrize("kind", DRIVES)
def test_the_blur_of_what_moves_is_that_of_the_depth_nearest_to_focus(kind):
    drive, near, far = DRIVES[kind]
    spec, position = replace(SPEC, drive=drive), np.linspace(0, 1, 301)
    found = spacing_factor(spec, position, depths=(near, far), wavelength_m=550e-9)
    depths = np.linspace(near, far, 400)
    blur = drive.blur_diameter(position[:, None], depths).min(axis=1)
    width = np.hypot(spec.pitch_m, 550e-9 * drive.image_distance(position) / drive.aperture_radius_m)
    law = np.clip(FACTOR_AT_FOCUS + FACTOR_PER_WIDTH * blur / width, 1, MAX_FACTOR)
    assert found == pytest.approx(law, abs=0.02)
    in_reach = (drive.focus_depth(position) >= near) & (drive.focus_depth(position) <= far)
    assert in_reach.any()
    assert set(found[in_reach]) == {1.0}
    assert found.max() > 2


def test_a_lens_with_colours_counts_where_any_of_them_is_in_focus():
    position = np.linspace(0, 1, 301)
    depths = {"depths": (0.5, 0.51), "wavelength_m": 0.0}
    plain = spacing_factor(SPEC, position, **depths)
    coloured = spacing_factor(replace(SPEC, margin=(10, 5)), position, **depths)
    assert (coloured <= plain + 1e-9).all()
    assert (coloured == 1).sum() > (plain == 1).sum() + 300 * 14 / 128


def test_a_lens_whose_blur_is_no_disc_has_even_slices():
    bent = replace(SPEC, drive=replace(SPEC.drive, wavefront=Wavefront(spherical_m=1e-6, radius_m=6e-3)))
    assert set(spacing_factor(bent, np.linspace(0, 1, 99), depths=(0.5, 0.51), wavelength_m=0.0)) == {1.0}


def test_slices_that_are_farther_apart_are_still_summed_in_layers():
    for margin in ((0, 0), (3, 2)):
        spec = replace(SPEC, margin=margin)
        position = (np.arange(20_000) + 0.5) / 20_000
        factor = np.full(20_000, 3.0)
        for step in (200, 400, 600):
            at = spaced_starts(step=step, factor=factor, knots=position * 128, reach=layered_reach(spec))
            assert max(np.diff(at)) > step
            windows = slice_windows(position, at, positions=129)
            assert max(last - first + 1 for first, last in windows) + sum(margin) <= LAYERED_POSITIONS
