"""The lens of a scene card: the keys of each kind of focus drive, and the construction of the drive."""

from abc import abstractmethod
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, Tag

from saf_gen.core.config.document import FrozenModel
from saf_gen.optics._drive import Drive
from saf_gen.optics.focal_length_drive import FocalLengthDrive
from saf_gen.optics.image_distance_drive import ImageDistanceDrive
from saf_gen.optics.microscope_stage import Stage

FocalLengthMm = Annotated[float, Field(gt=0, le=2000)]


class _Lens(FrozenModel):
    """The keys that all lenses share. The aperture radius does not change while the lens focuses."""

    drive_class: ClassVar[type[Drive]]

    f_number: float = Field(gt=0.5, le=64)
    """f-number of the lens focused at infinity."""
    transmission: float = Field(default=1.0, gt=0, le=1)
    """Fraction of the light that the lens transmits."""

    @property
    @abstractmethod
    def summary(self) -> str:
        """Short description of the lens, for lists."""

    def build_drive(self, f_number: float | None = None) -> Drive:
        """Return the drive of the lens, with lengths in metres.

        ``f_number``, if given, replaces that of the card. Raises BadInput if the travel is impossible.
        """
        numbers = self.model_dump(exclude={"drive"}) | ({"f_number": f_number} if f_number else {})
        fields = {}
        for key, value in numbers.items():  # a card gives lengths of the lens in millimetres, all others in metres
            if key.endswith("_mm"):
                key, value = f"{key.removesuffix('_mm')}_m", value / 1000
            fields[key] = value
        return self.drive_class(**fields)


class ImageDistanceLens(_Lens):
    """A lens that moves; ``focus_range_m`` gives the object distances in focus at positions 0 and 1."""

    drive_class = ImageDistanceDrive

    drive: Literal["image_distance"] = "image_distance"
    """The lens moves relative to the sensor, as in a macro lens."""
    focal_length_mm: FocalLengthMm
    """Focal length, mm."""
    focus_range_m: tuple[float, float]
    """Object distances in focus at position 0 and at position 1, both beyond the focal length, m."""

    @property
    def summary(self) -> str:
        """Short description of the lens, for lists."""
        return f"{self.focal_length_mm:g} mm f/{self.f_number:g}"


class FocalLengthLens(_Lens):
    """A lens that changes its power at a fixed distance from the sensor."""

    drive_class = FocalLengthDrive

    drive: Literal["focal_length"]
    """The lens changes its power, as a liquid lens does."""
    image_distance_mm: FocalLengthMm
    """Distance from the lens to the sensor, mm."""
    focus_range_m: tuple[float, float]
    """Object distances in focus at position 0 and at position 1, in front of the lens, m."""

    @property
    def summary(self) -> str:
        """Short description of the lens, for lists."""
        return f"{self.image_distance_mm:g} mm f/{self.f_number:g}, varifocal"


class StageLens(_Lens):
    """A lens in front of which the scene moves, as on the stage of a microscope."""

    drive_class = Stage

    drive: Literal["stage"]
    """The scene moves relative to the lens, as under a microscope."""
    focal_length_mm: FocalLengthMm
    """Focal length, mm."""
    magnification: float = Field(gt=0, le=1000)
    """Magnification M of the plane in focus, which is f·(1 + 1/M) from the lens."""
    travel_m: tuple[float, float]
    """Distance by which the scene is moved from its place on the card towards the lens, at positions 0 and 1, m."""

    @property
    def summary(self) -> str:
        """Short description of the lens, for lists."""
        return f"{self.focal_length_mm:g} mm f/{self.f_number:g}, {self.magnification:g}×, stage"


def drive(card: Any) -> str:
    """Return the kind of drive of a card's ``lens``, parsed or not; pydantic names this function in its messages."""
    kind = card.get("drive", "image_distance") if isinstance(card, dict) else getattr(card, "drive", "")
    return str(kind)


LensCard = Annotated[
    Annotated[ImageDistanceLens, Tag("image_distance")]
    | Annotated[FocalLengthLens, Tag("focal_length")]
    | Annotated[StageLens, Tag("stage")],
    Discriminator(drive),
]
