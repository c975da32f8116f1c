"""The thin lens and its focus drives, in closed form, and the aberrations that a real lens adds.

Lengths are in metres. Positions are fractions of the travel of a drive, 0 to 1.
"""

from collections.abc import Mapping
from typing import Any

from saf_gen.optics._drive import Drive
from saf_gen.optics.best_focus import FocusCriterion
from saf_gen.optics.distortion import Distortion
from saf_gen.optics.focal_length_drive import FocalLengthDrive
from saf_gen.optics.image_distance_drive import ImageDistanceDrive
from saf_gen.optics.microscope_stage import Stage
from saf_gen.optics.vignetting import Ring
from saf_gen.optics.wavefront import Wavefront

__all__ = [
    "DRIVES",
    "Distortion",
    "Drive",
    "FocalLengthDrive",
    "FocusCriterion",
    "ImageDistanceDrive",
    "Ring",
    "Stage",
    "Wavefront",
    "drive_from_dict",
]

DRIVES: dict[str, type[Drive]] = {drive.kind: drive for drive in (ImageDistanceDrive, FocalLengthDrive, Stage)}
"""The class of each kind of drive."""


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
        numbers["wavefront"] = Wavefront(**wavefront)
    if distortion := data.get("distortion"):
        numbers["distortion"] = Distortion(**distortion)
    if ring := data.get("ring"):
        numbers["ring"] = Ring(**ring)
    return DRIVES[data["kind"]](**numbers)
