"""The lens of a scene card: the keys of each focus drive, and the drive that they describe."""

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
    """The keys of every lens; its aperture radius stays fixed while it focuses."""

    drive_class: ClassVar[type[Drive]]

    f_number: float = Field(gt=0.5, le=64)
    """For the lens focused at infinity."""
    transmission: float = Field(default=1.0, gt=0, le=1)
    """Fraction of the light that passes the lens."""

    @property
    @abstractmethod
    def summary(self) -> str:
        """The lens in a few words, for lists."""

    def build_drive(self, f_number: float | None = None) -> Drive:
        """Return the lens with its drive, in metres; ``f_number`` replaces the card's.

        Raises BadInput for an impossible travel.
        """
        numbers = self.model_dump(exclude={"drive"}) | ({"f_number": f_number} if f_number else {})
        fields = {}
        for key, value in numbers.items():  # a card gives the lens in millimetres, all else in metres
            if key.endswith("_mm"):
                key, value = f"{key.removesuffix('_mm')}_m", value / 1000
            fields[key] = value
        return self.drive_class(**fields)


class ImageDistanceLens(_Lens):
    """The lens moves; ``focus_range_m`` are the object distances in focus at positions 0 and 1."""

    drive_class = ImageDistanceDrive

    drive: Literal["image_distance"] = "image_distance"
    """The lens moves against the sensor, as in a macro lens."""
    focal_length_mm: FocalLengthMm
    """mm."""
    focus_range_m: tuple[float, float]
    """Object distances in focus at position 0 and at 1, both beyond the focal length, m."""

    @property
    def summary(self) -> str:
        """The lens in a few words, for lists."""
        return f"{self.focal_length_mm:g} mm f/{self.f_number:g}"


class FocalLengthLens(_Lens):
    """The lens changes its power at a fixed distance from the sensor."""

    drive_class = FocalLengthDrive

    drive: Literal["focal_length"]
    """The lens changes its power, as a liquid lens does."""
    image_distance_mm: FocalLengthMm
    """Lens to sensor, mm."""
    focus_range_m: tuple[float, float]
    """Object distances in focus at position 0 and at 1, in front of the lens, m."""

    @property
    def summary(self) -> str:
        """The lens in a few words, for lists."""
        return f"{self.image_distance_mm:g} mm f/{self.f_number:g}, varifocal"


class StageLens(_Lens):
    """The scene moves; ``travel_m`` is how far towards the lens from the card's position, at 0 and at 1."""

    drive_class = Stage

    drive: Literal["stage"]
    """The scene moves against the lens, as under a microscope."""
    focal_length_mm: FocalLengthMm
    """mm."""
    magnification: float = Field(gt=0, le=1000)
    """Of what is in focus, f·(1 + 1/M) away."""
    travel_m: tuple[float, float]
    """How far the scene is moved towards the lens at position 0 and at 1, from where the card places it, m."""

    @property
    def summary(self) -> str:
        """The lens in a few words, for lists."""
        return f"{self.focal_length_mm:g} mm f/{self.f_number:g}, {self.magnification:g}×, stage"


def drive(card: Any) -> str:
    """Return the kind of drive of a card's ``lens``, parsed or not; pydantic's messages name this function."""
    kind = card.get("drive", "image_distance") if isinstance(card, dict) else getattr(card, "drive", "")
    return str(kind)


LensCard = Annotated[
    Annotated[ImageDistanceLens, Tag("image_distance")]
    | Annotated[FocalLengthLens, Tag("focal_length")]
    | Annotated[StageLens, Tag("stage")],
    Discriminator(drive),
]
