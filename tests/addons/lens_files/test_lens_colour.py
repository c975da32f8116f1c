"""The colour of lenses read from files, against rays through their surfaces."""

import numpy as np
import pytest
from lens_texts import LENSES
from pydantic import TypeAdapter
from ray_by_ray import surfaces_of, traced

from saf_gen.addons.lens_files.fit import traced_rays
from saf_gen.addons.lens_files.reading import read_prescription
from saf_gen.optics.axial_colour import shifted_positions
from saf_gen.optics.fitted_file import read_lens
from saf_gen.optics.lens_card import LensCard
from saf_gen.optics.lens_colour import lens_colour, neglected

D_NM = 587.5618
CARDS = {
    "double_gauss": (2.0, [2.0, 0.6], 4.7e-3),
    "c_mount": (1.4, [1.0, 0.4], 4.7e-3),
    "smartphone": (2.4, [1.0, 0.15], 1.8e-3),
}


def built(name):
    f_number, travel, _ = CARDS[name]
    card = {"file": name, "f_number": f_number, "focus_range_m": travel}
    return read_lens(name), TypeAdapter(LensCard).validate_python(card).build_drive()


@pytest.mark.parametrize("name", CARDS)
@pytest.mark.parametrize("nm", [440.0, 486.1327, 680.0])
def test_the_focus_on_the_axis_moves_as_that_of_rays_through_the_surfaces(name, nm):
    """Rays of a point in focus, forward by root finding: the sensor where their squares are least, within 0.1 half
    depths of focus of pixels of 20 µm: even in the entrance pupil here, in the exit pupil there.
    """
    lens, drive = built(name)
    u, r = 1e3 * float(drive.object_distance(0.5)), 1e3 * drive.aperture_radius_m
    text = (LENSES / f"{name}.zmx").read_text()
    best = []
    for light in (D_NM, nm):
        surfaces = surfaces_of(text, wave_um=light / 1e3)
        zones = r * np.sqrt((np.arange(12) + 0.5) / 12)
        rays = [traced(surfaces, (zone * (1 - lens.entrance_pupil_mm / u), 0.0), (zone / u, 0.0)) for zone in zones]
        at, slope = np.array([(place[0], way[0]) for place, way in rays]).T
        best.append(-(at @ slope) / (slope @ slope))
    shift = lens_colour(lens, drive, drawn_nm=D_NM).shifts(drive, np.array([nm]), reference_nm=555.0)
    moved = -1e3 * float(drive.image_distance(0.5)) ** 2 * shift[0]
    half_depth = 20e-3 * CARDS[name][0]
    assert moved == pytest.approx(best[1] - best[0], abs=0.1 * half_depth)


@pytest.mark.parametrize("name", CARDS)
def test_what_mixed_pictures_lack_is_what_rays_through_the_surfaces_land_beside_them(name):
    """At 450 nm: both numbers of traced rays within 0.02 pixels of 20 µm, with 400 random rays (seed 4)."""
    lens, drive = built(name)
    made, corner = read_prescription(LENSES / f"{name}.zmx"), CARDS[name][2]
    colour, nm = lens_colour(lens, drive, drawn_nm=D_NM), np.array([450.0])
    found = neglected(lens, drive, colour=colour, weights=np.ones(1), nm=nm, height_m=corner)
    shift = colour.shifts(drive, nm, reference_nm=555.0)
    position = shifted_positions(drive, 0.5, shift=shift)[0]
    rng, v = np.random.default_rng(4), float(drive.image_distance(0.5))
    r, angle = np.sqrt(rng.random(400)), 2 * np.pi * rng.random(400)
    a = 1e3 * drive.aperture_radius_m * r * np.stack([np.cos(angle), np.sin(angle)])
    depth = 1e3 / (1 / float(drive.object_distance(0.5)) + shift[0])
    lateral, blur = [], []
    for part in (0.0, 0.7, 1.0):
        x = np.array([[1e3 * part * corner], [0.0]])
        met = [
            traced_rays(made, lens, a=a, x=x, image_distance_mm=1e3 * float(drive.image_distance(at)), wave_nm=light)
            for light, at in ((450.0, 0.5), (D_NM, position))
        ]
        apart = (met[0].at(depth).place - met[1].at(depth).place) * 1e3 * v / depth
        middle = apart.mean(axis=1, keepdims=True)
        lateral.append(np.hypot(*middle)[0])
        blur.append(np.sqrt(((apart - middle) ** 2).sum(axis=0).mean()))
    assert 1e3 * found.lateral_m == pytest.approx(max(lateral), abs=0.02 * 20e-3 + 0.05 * max(lateral))
    assert 1e3 * found.blur_m == pytest.approx(max(blur), abs=0.02 * 20e-3 + 0.05 * max(blur))
