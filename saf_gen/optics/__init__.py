"""The thin lens and its focus drives, in closed form, and the aberrations that a real lens adds.

Lengths are in metres. Positions are fractions of the travel of a drive, 0 to 1.
"""

from collections.abc import Mapping
from typing import Any

from saf_gen.optics._drive import Drive
from saf_gen.optics.axial_colour import AxialColour
from saf_gen.optics.best_focus import FocusCriterion
from saf_gen.optics.distortion import Distortion
from saf_gen.optics.fitted_lens_drive import FittedLensDrive
from saf_gen.optics.fitted_rays import FittedRays
from saf_gen.optics.focal_length_drive import FocalLengthDrive
from saf_gen.optics.image_distance_drive import ImageDistanceDrive
from saf_gen.optics.microscope_stage import Stage
from saf_gen.optics.picture_steps import PictureSteps
from saf_gen.optics.vignetting import Ring
from saf_gen.optics.wavefront import Wavefront

__all__ = [
    "DRIVES",
    "AxialColour",
    "Distortion",
    "Drive",
    "FittedLensDrive",
    "FittedRays",
    "FocalLengthDrive",
    "FocusCriterion",
    "ImageDistanceDrive",
    "PictureSteps",
    "Ring",
    "Stage",
    "Wavefront",
    "drive_from_dict",
]

DRIVES: dict[str, type[Drive]] = {
    drive.kind: drive for drive in (ImageDistanceDrive, FocalLengthDrive, Stage, FittedLensDrive)
}
"""The class of each kind of drive that a scene card can state."""


def drive_from_dict(data: Mapping[str, Any]) -> Drive:
    """Return the drive that :meth:`Drive.as_dict` described, also after a round trip through JSON.

    Raises
    ------
    KeyError
        If the kind is missing or unknown.
    TypeError
        If the other keys are not parameters of the drive.
    """
    numbers = {key: tuple(v) if isinstance(v, list) else v for key, v in data.items() if key != "kind"}
    if wavefront := data.get("wavefront"):
        numbers["wavefront"] = FittedRays.from_dict(wavefront) if "starts" in wavefront else Wavefront(**wavefront)
    if distortion := data.get("distortion"):
        numbers["distortion"] = Distortion(**distortion)
    if ring := data.get("ring"):
        numbers["ring"] = Ring(**ring)
    known: dict[str, type[Drive]] = {**DRIVES, PictureSteps.kind: PictureSteps}
    return known[data["kind"]](**numbers)
