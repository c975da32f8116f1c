"""Where a focus measure of rendered pictures peaks for a lens with aberrations, against a sum over its pupil."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
from written_scenes import dispersion, load_setup, needs_llvm, render_stack_once, write_scene

from saf_gen.optics import FocalLengthDrive, Wavefront
from saf_gen.render import filtered_pass
from saf_gen.render.render_setup import SensorGrid
from studies.laws.pupils import FINEST, find_peak, pupil_transfer, seidel, texture, texture_dispersion

WAVE_M, PITCH_M, F_NUMBER, IMAGE_M, DISTANCE_M = 555e-9, 20e-6, 2.0, 0.055, 0.5
GRID = SensorGrid(rows=64, columns=96, pitch_m=PITCH_M)
MOST_WAVES, POSITIONS = 7.0, 37
"""Defocus at the ends of the travel, wavelengths; a step is 0.39 of them, or 0.17 half depths of focus."""
TEXTURE = inspect.getsource(texture) + f"texture = texture({GRID.rows}, {GRID.columns})\n"
"""A radiance whose one period fills the picture."""


def travelling(spherical):
    """A liquid lens whose travel spans MOST_WAVES of defocus on either side of 0.5 m, with spherical aberration."""
    edge = MOST_WAVES * WAVE_M * 2 / (IMAGE_M / (2 * F_NUMBER)) ** 2
    drive = FocalLengthDrive(IMAGE_M, F_NUMBER, (1 / (1 / DISTANCE_M + edge), 1 / (1 / DISTANCE_M - edge)))
    if not spherical:
        return drive
    wavefront = Wavefront(spherical * WAVE_M, 0.0, 0.0, 0.0, radius_m=drive.aperture_radius_m, height_m=4e-3)
    return replace(drive, wavefront=wavefront)


def half_depth_in_steps(drive):
    low, high = drive.depth_of_focus(0.5, PITCH_M, wavelength_m=WAVE_M)
    return (high - low) / 2 * (POSITIONS - 1)


def textured(folder, monkeypatch, drive):
    """The texture as a lamp 0.5 m away, where one period is as large as what the sensor sees."""
    width, height = (count * PITCH_M * DISTANCE_M / IMAGE_M for count in (GRID.columns, GRID.rows))
    shapes = (
        "{'glow': {'type': 'rectangle',"
        f" 'to_world': t.rotate([0, 1, 0], 180).scale([{1.5 * width} * m, {1.5 * height} * m, 1]),"
        " 'emitter': {'type': 'area', 'radiance': {'type': 'bitmap', 'raw': True, 'filter_type': 'bilinear',"
        " 'wrap_mode': 'repeat', 'bitmap': mi.Bitmap(texture[..., None]),"
        " 'to_uv': mi.ScalarTransform4f().scale([3, 3, 1])}}}}"
    )
    scene = write_scene(
        folder, monkeypatch, lens="{focal_length_mm: 50, f_number: 2, focus_range_m: [0.55, 0.45]}",
        distance_m=DISTANCE_M, shapes=shapes, light="glow", target="glow", unit_m=0.001,
    )  # fmt: skip
    script = scene.folder / "scene.py"
    script.write_text(script.read_text().replace("def build", TEXTURE + "def build"))
    return replace(load_setup(scene, ("glow",), grid=GRID, drive=drive), wavelength_m=WAVE_M)


def own_dispersion(drive, spherical):
    """SD of the texture at each position by Parseval: its waves through the transfers of pupil, texels and pixels."""
    known = np.linspace(0, FINEST, 46)
    radius, found = drive.aperture_radius_m, []
    for position in np.linspace(0, 1, POSITIONS):
        defocus = float(drive.defocus(position, DISTANCE_M)) * radius**2 / 2 / WAVE_M
        waves = seidel(spherical=spherical, defocus=defocus)
        found.append(pupil_transfer(waves, fractions=known / PITCH_M * WAVE_M * IMAGE_M / (2 * radius)))
    return texture_dispersion(GRID.rows, GRID.columns, cycles=known, transfers=np.array(found))


def filtered(setup, *, samples, seed):
    asked = {"samples": samples, "emitting": ["glow"]}
    shading = filtered_pass.estimate_shading([filtered_pass.gather_shading({"glow": setup}, seed=1000 + seed, **asked)])
    return filtered_pass.render_with_shading({"glow": setup}, shading, seed=seed, positions=POSITIONS, **asked)["glow"][
        0
    ]


ESTIMATORS = {
    "plain": lambda setup: render_stack_once(setup, positions=POSITIONS, samples=256, seed=3),
    "filtered": lambda setup: filtered(setup, samples=64, seed=3),
}


@pytest.mark.daily(2)
@needs_llvm
@pytest.mark.parametrize(
    ("spherical", "estimator"),
    [
        (1.0, "plain"),
        (2.0, "filtered"),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in ((0.0, "plain"), (1.0, "filtered"), (2.0, "plain"))),
    ],
)
def test_the_dispersion_of_pictures_peaks_where_the_pupil_says(tmp_path, monkeypatch, spherical, estimator):
    """Within 0.02 half depths of focus on steps of 0.17, and within 1 % everywhere; seed 3.

    The peaks are at 0, -0.57 and -1.14 half depths for 0, 1 and 2 waves; found were differences of at most 0.008.
    """
    drive = travelling(spherical)
    step = half_depth_in_steps(drive)
    assert 1 / step <= 0.2
    own = own_dispersion(drive, spherical)
    seen = dispersion(ESTIMATORS[estimator](textured(tmp_path, monkeypatch, drive)))
    assert abs(find_peak(seen) - find_peak(own)) / step <= 0.02
    assert seen == pytest.approx(own, rel=0.01)
