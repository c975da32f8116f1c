"""Aberrations of a typical lens, mild or strong, for recipes that replace those of the cards.

They are stated in what they do, so that they are alike for every lens: spherical aberration that moves the least blur
by some half depths of focus, and a curved field that moves the focus at the corner of the sensor by as many. A mild
lens moves each by one half depth, as a corrected photographic lens at a wide aperture does; a strong one by three.

Where waves spread a point over half a pixel or more, as under a microscope, both together stay within the quarter of a
wave that rays can show (:class:`saf_gen.optics.FocusCriterion`), in the same proportion.
"""

from dataclasses import replace

import numpy as np

from saf_gen.optics._drive import Drive
from saf_gen.optics.best_focus import FocusCriterion
from saf_gen.optics.wavefront import Wavefront

HALF_DEPTHS = {"none": 0.0, "mild": 1.0, "strong": 3.0}
"""By how many half depths of focus spherical aberration and the curved field move the focus, by severity."""
BALANCE = 4 / 3  # defocus of the least blur divided by the spherical aberration, both at the edge of the aperture


def with_typical_aberrations(criterion: FocusCriterion, severity: str, *, rows: int, columns: int) -> Drive:
    """Return the drive of a lens with typical aberrations in place of its own; distortion is among those that go.

    Parameters
    ----------
    criterion : FocusCriterion
        The lens in front of its pixels.
    severity : {'none', 'mild', 'strong'}
        How much.
    rows, columns : int
        Size of the sensor, pixels.
    """
    drive, amount = replace(criterion.drive, wavefront=None, distortion=None), HALF_DEPTHS[severity]  # type: ignore[type-var]
    if not amount:
        return drive
    radius = drive.aperture_radius_m
    path = amount * criterion.imaging.resolved_defocus * radius**2 / 2
    spherical, curvature = path / BALANCE, path
    if (most := criterion.largest_path_m) is not None:
        share = min(most / (spherical + curvature), 1.0)
        spherical, curvature = spherical * share, curvature * share
    corner = float(np.hypot(rows, columns)) / 2 * criterion.pitch_m
    wavefront = Wavefront(spherical_m=spherical, field_curvature_m=curvature, radius_m=radius, height_m=corner)
    return replace(drive, wavefront=wavefront)  # type: ignore[type-var]
