"""The lens of a scene card: the keys of each kind of focus drive, and the construction of the drive."""

from abc import abstractmethod
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, PrivateAttr, Tag, field_validator, model_validator

from saf_gen.core.config.document import FrozenModel
from saf_gen.optics._drive import Drive
from saf_gen.optics.axial_colour import AxialColour
from saf_gen.optics.distortion import Distortion
from saf_gen.optics.fitted_file import FittedLens, check_reach, read_lens
from saf_gen.optics.fitted_lens_drive import FittedLensDrive
from saf_gen.optics.focal_length_drive import FocalLengthDrive
from saf_gen.optics.image_distance_drive import ImageDistanceDrive
from saf_gen.optics.microscope_stage import Stage
from saf_gen.optics.vignetting import Ring
from saf_gen.optics.wavefront import Wavefront

FocalLengthMm = Annotated[float, Field(ge=0.5, le=2000)]


class Aberrations(FrozenModel):
    """How far the waves that leave a lens depart from spheres, by Seidel's sum (docs/physics.md)."""

    spherical: float = Field(default=0.0, ge=-20, le=20)
    """Spherical aberration W040 at the edge of the aperture, waves."""
    coma: float = Field(default=0.0, ge=-20, le=20)
    """Coma W131 at the edge of the aperture and at ``height_mm``, waves."""
    astigmatism: float = Field(default=0.0, ge=-20, le=20)
    """Astigmatism W222 at the edge of the aperture and at ``height_mm``, waves."""
    field_curvature: float = Field(default=0.0, ge=-20, le=20)
    """Field curvature W220 at the edge of the aperture and at ``height_mm``, waves."""
    distortion: float = Field(default=0.0, ge=-20, le=20)
    """Percent by which a point at ``height_mm`` is displaced away from the middle (pincushion), or below 0 towards it
    (barrel)."""
    wave_nm: float = Field(default=550.0, ge=200, le=2000)
    """Length of the waves in which the aberrations are given, nm."""
    height_mm: float | None = Field(default=None, gt=0, le=200)
    """Distance from the middle of the sensor at which coma, astigmatism, field curvature and distortion are given,
    mm."""

    @model_validator(mode="after")
    def _states_its_height(self) -> "Aberrations":
        names = ("coma", "astigmatism", "field_curvature", "distortion")
        off_axis = [name for name in names if getattr(self, name)]
        if off_axis and self.height_mm is None:
            raise ValueError(
                f"{off_axis[0]} needs height_mm, the distance from the middle of the sensor where it holds"
            )
        return self

    def wavefront(self, radius_m: float) -> Wavefront | None:
        """Return the wavefront of a lens with this radius of its aperture (m), or None if all aberrations are 0."""
        wave_m = self.wave_nm * 1e-9
        off_axis = (self.coma * wave_m, self.astigmatism * wave_m, self.field_curvature * wave_m)
        if not (self.spherical or any(off_axis)):
            return None
        return Wavefront(self.spherical * wave_m, *off_axis, radius_m, (self.height_mm or 1e3) / 1e3)

    def displacement(self, image_distance_m: float) -> Distortion | None:
        """Return the distortion of a lens at this distance (m) from the sensor halfway, or None if there is none."""
        if not self.distortion:
            return None
        return Distortion(self.distortion / 100, (self.height_mm or 1e3) / 1e3, image_distance_m)


class Vignetting(FrozenModel):
    """A ring in front of the lens, through which rays from the edge of the picture pass only in part."""

    radius_mm: float = Field(gt=0, le=1000)
    """Radius of its opening, mm."""
    distance_mm: float = Field(gt=0, le=1000)
    """Distance from the lens towards the scene, mm."""


class _Lens(FrozenModel):
    """The keys that all lenses share. The aperture radius does not change while the lens focuses."""

    drive_class: ClassVar[type[Drive]]

    f_number: float = Field(gt=0.5, le=64)
    """f-number of the lens focused at infinity."""
    transmission: float = Field(default=1.0, gt=0, le=1)
    """Fraction of the light that the lens transmits."""
    aberrations: Aberrations | None = None
    """Aberrations of the lens at the f-number of the card; by default none."""
    axial_colour: AxialColour | None = None
    """How the focus changes with the wavelength of lamps that state their spectrum; by default not at all."""
    vignetting: Vignetting | None = None
    """Ring in front of the lens that takes light from the edge of the picture; by default none."""
    veiling_glare: float = Field(default=0.0, ge=0, le=0.5)
    """Share of the light in the frame that the lens spreads evenly over it."""

    @property
    @abstractmethod
    def summary(self) -> str:
        """Short description of the lens, for lists."""

    def build_drive(self, f_number: float | None = None) -> Drive:
        """Return the drive of the lens, with lengths in metres.

        ``f_number``, if given, replaces that of the card. Raises BadInput if the travel is impossible.
        """
        numbers = self.model_dump(exclude={"drive", "aberrations", "axial_colour", "vignetting"})
        numbers |= {"f_number": f_number} if f_number else {}
        fields = {}
        for key, value in numbers.items():  # a card gives lengths of the lens in millimetres, all others in metres
            if key.endswith("_mm"):
                key, value = f"{key.removesuffix('_mm')}_m", value / 1000
            fields[key] = value
        drive = self.drive_class(**fields)
        if (ring := self.vignetting) is not None:
            drive = replace(drive, ring=Ring(ring.radius_mm / 1e3, ring.distance_mm / 1e3))  # type: ignore[type-var]
        if self.aberrations is None:
            return drive
        # Stopped down, the lens keeps its waves and uses less of them.
        radius_m = drive.aperture_radius_m * drive.f_number / self.f_number
        distortion = self.aberrations.displacement(float(drive.image_distance(0.5)))
        wavefront = self.aberrations.wavefront(radius_m)
        return replace(drive, wavefront=wavefront, distortion=distortion)  # type: ignore[type-var]


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


class LensFile(FrozenModel):
    """A real lens, fitted by ``saf-gen lens fit``, that moves as a whole; it brings its own aberrations."""

    drive_class: ClassVar[type[Drive]] = FittedLensDrive

    drive: Literal["image_distance"] = "image_distance"
    """The lens moves relative to the sensor; gaps and power of a fitted lens cannot change."""
    file: str
    """Name of a lens that comes with saf_gen, or of a file of a fitted lens (.yaml) in the scene's folder."""
    f_number: float = Field(gt=0.5, le=64)
    """f-number of the lens focused at infinity; the file says the smallest."""
    focus_range_m: tuple[float, float]
    """Object distances in focus at position 0 and at position 1, from the entrance pupil, m."""
    transmission: float = Field(default=1.0, gt=0, le=1)
    """Fraction of the light that the lens transmits."""
    wave_nm: float | None = Field(default=None, ge=200, le=3000)
    """Wavelength whose rays are traced, nm; may be left out: then the primary wavelength of the lens."""
    veiling_glare: float = Field(default=0.0, ge=0, le=0.5)
    """Share of the light in the frame that the lens spreads evenly over it."""
    aberrations: None = None
    """A real lens brings its own."""
    vignetting: None = None
    """The pupil of a real lens is the same all over the picture."""
    _lens: FittedLens | None = PrivateAttr(default=None)

    @field_validator("aberrations", "vignetting", mode="before")
    @classmethod
    def _brings_its_own(cls, given: Any) -> None:
        if given is not None:
            raise ValueError("neither aberrations nor vignetting beside file: a real lens brings its own")

    @field_validator("file")
    @classmethod
    def _has_no_folder(cls, file: str) -> str:
        if Path(file).name != file:
            raise ValueError("the name of a lens, or of a file in the scene's folder")
        return file

    def read_from(self, folder: Path) -> "LensFile":
        """Return this card with its lens read; a file counts from ``folder``. Raises BadInput if it cannot be."""
        found = self.model_copy()
        found._lens = read_lens(self.file, folder=folder)
        return found

    @property
    def lens(self) -> FittedLens:
        """The fitted lens."""
        return self._lens or read_lens(self.file)

    @property
    def summary(self) -> str:
        """Short description of the lens, for lists."""
        return f"{self.lens.focal_length_mm:.3g} mm f/{self.f_number:g}, {self.lens.name}"

    def build_drive(self, f_number: float | None = None) -> Drive:
        """Return the drive of the lens, as :meth:`ImageDistanceLens.build_drive` does.

        Raises BadInput if aperture, travel or wavelength are not among those for which the lens is fitted.
        """
        lens, used = self.lens, f_number or self.f_number
        check_reach(lens, f_number=used, focus_range_m=self.focus_range_m)
        return FittedLensDrive(
            focal_length_m=lens.focal_length_mm / 1e3,
            f_number=used,
            focus_range_m=self.focus_range_m,
            pupil_magnification=lens.pupil_magnification,
            transmission=self.transmission,
            wavefront=lens.rays_at(self.wave_nm),
            veiling_glare=self.veiling_glare,
        )


def drive(card: Any) -> str:
    """Return the kind of drive of a card's ``lens``, parsed or not, or "lens file" if it names one.

    Pydantic names this function in its messages.
    """
    if isinstance(card, LensFile) or (isinstance(card, dict) and "file" in card):
        return "lens file"
    kind = card.get("drive", "image_distance") if isinstance(card, dict) else getattr(card, "drive", "")
    return str(kind)


LensCard = Annotated[
    Annotated[ImageDistanceLens, Tag("image_distance")]
    | Annotated[FocalLengthLens, Tag("focal_length")]
    | Annotated[StageLens, Tag("stage")]
    | Annotated[LensFile, Tag("lens file")],
    Discriminator(drive),
]
