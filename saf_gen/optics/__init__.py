"""The thin lens and what drives its focus. Closed forms only; nothing here renders.

All lengths in metres; a position is the fraction 0...1 of a drive's travel.
"""

from saf_gen.optics._drive import Drive
from saf_gen.optics.focal_length import FocalLength
from saf_gen.optics.image_distance import ImageDistance
from saf_gen.optics.stage import Stage

__all__ = ["DRIVES", "Drive", "FocalLength", "ImageDistance", "Stage"]

DRIVES: dict[str, type[Drive]] = {drive.kind: drive for drive in (ImageDistance, FocalLength, Stage)}
"""The class of each kind of drive."""
