"""The colour of lenses read from files, against rays through their surfaces."""

import numpy as np
import pytest
from lens_texts import LENSES
from pydantic import TypeAdapter
from ray_by_ray import surfaces_of, traced

from saf_gen.optics.fitted_file import read_lens
from saf_gen.optics.lens_card import LensCard
from saf_gen.optics.lens_colour import lens_colour

D_NM = 587.5618
CARDS = {"double_gauss": (2.0, [2.0, 0.6]), "c_mount": (1.4, [1.0, 0.4]), "smartphone": (2.4, [1.0, 0.15])}


def built(name):
    f_number, travel = CARDS[name]
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
