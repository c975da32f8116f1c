"""The thin lens and what drives its focus. Closed forms only; nothing here renders.

All lengths in metres; a position is the fraction 0...1 of a drive's travel.
"""

from collections.abc import Mapping
from typing import Any

from saf_gen.optics._drive import Drive
from saf_gen.optics.focal_length_drive import FocalLengthDrive
from saf_gen.optics.image_distance_drive import ImageDistanceDrive
from saf_gen.optics.microscope_stage import Stage

__all__ = ["DRIVES", "Drive", "FocalLengthDrive", "ImageDistanceDrive", "Stage", "drive_from_dict"]

DRIVES: dict[str, type[Drive]] = {
    drive.kind: drive for drive in (ImageDistanceDrive, FocalLengthDrive, Stage)
}
"""The class of each kind of drive."""


def drive_from_dict(said: Mapping[str, Any]) -> Drive:
    """The drive that :meth:`Drive.as_dict` told of, after JSON too. Else KeyError or TypeError."""
    numbers = {key: tuple(v) if isinstance(v, list) else v for key, v in said.items() if key != "kind"}
    return DRIVES[said["kind"]](**numbers)
