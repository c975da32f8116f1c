"""The axial colour of a lens read from a file.

The polynomials of a lens know its rays at every wavelength. In focus on the axis, at the middle of the travel, is for
light λ the plane whose rays have least squared slopes: if w(a) is what aberrations add to the slope of the ray through
a, then 1/u changes by δ(λ) = -Σ a·(w_λ - w_0)/Σ a² over the aperture. Pictures in light λ are those of the position
that δ names (:mod:`saf_gen.optics.axial_colour`). They leave out that rays of λ land beside those pictures: all of a
point's rays together, which is lateral colour, and each beside their mean, which is spherochromatism.
"""

import numpy as np

from saf_gen.optics.axial_colour import AxialColour
from saf_gen.optics.fitted_file import FittedLens
from saf_gen.optics.fitted_lens_drive import FittedLensDrive
from saf_gen.optics.texture_contrast import lens_points

STEP_NM, DIGITS = 10.0, 9
MIDDLE = 0.5  # of the travel


def lens_colour(lens: FittedLens, drive: FittedLensDrive, *, drawn_nm: float) -> AxialColour:
    """Return the axial colour of a lens whose pictures are drawn in light of ``drawn_nm``.

    Beyond the wavelengths for which the lens is fitted, light is taken to focus as at their ends.
    """
    low, high = lens.waves_nm
    waves = np.append(np.arange(low, high - 1e-6, STEP_NM), high)
    a = lens_points(drive.aperture_radius_m)
    v, u = float(drive.image_distance(MIDDLE)), float(drive.object_distance(MIDDLE))
    along, size = [], float((a[0] ** 2 + a[1] ** 2).sum())
    for nm in (drawn_nm, *waves):
        slope = lens.rays_at(float(nm)).seen_from(u, v).slope(a, (0.0, 0.0))
        along.append(float((a[0] * slope[0] + a[1] * slope[1]).sum()) / size)
    power = 1 - drive.focal_length_m * (np.array(along[1:]) - along[0])
    shifts = np.round(1 / power - 1, DIGITS)
    pairs = zip(np.round(waves, 6).tolist(), shifts.tolist(), strict=True)
    return AxialColour(measured=tuple(pairs), reference_nm=drawn_nm)
