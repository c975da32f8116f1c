"""The card of a scene whose stack is given: pictures that another camera took at equal steps of the focus.

Nothing of such a scene is rendered. Its folder holds the card and the pictures, which `saf-gen scenes from-pictures`
writes there as linear light: ``pictures/0000.npy`` and so on, float32 (row, col).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from saf_gen.core.config.document import FrozenModel, check_plain_file
from saf_gen.errors import BadInput

FOLDER = "pictures"
MAX_BYTES = 1 << 30  # of a picture
MIN_PICTURES = 3
"""Smallest number of pictures that have a peak."""


class GivenStack(FrozenModel):
    """What is known of the pictures of a scene."""

    step_um: float | None = Field(default=None, gt=0, lt=1e9)
    """Distance of the focus between two pictures, µm; by default it is not known."""
    box: tuple[int, int, int, int] | None = None
    """Left, top, columns and rows of the target in pixels of the pictures; by default all that the sensor sees."""

    @property
    def summary(self) -> str:
        """What is known of the lens, in words."""
        return "photographed, " + ("steps not known" if self.step_um is None else f"{self.step_um:g} µm a picture")


class PictureCard(FrozenModel):
    """Everything about a photographed scene that is not its pictures."""

    id: str = Field(pattern=r"^[a-z0-9][a-z0-9_]*$")
    """Name of the folder: lower-case letters, digits, ``_``."""
    title: str
    """Title on one line, for lists."""
    licence: str
    """SPDX identifier of the licence of the pictures."""
    source: str
    """Where the pictures come from."""
    pictures: GivenStack
    """Makes the scene one whose pictures are given."""

    lights: ClassVar[tuple[str, ...]] = ("light",)
    light_roles: ClassVar[Mapping[str, str]] = {"light": "key"}
    slices_per_s: ClassVar[None] = None
    target: ClassVar[tuple[str, ...]] = ()
    illuminance_lux: ClassVar[Mapping[str, float]] = {}
    params: ClassVar[Mapping[str, Any]] = {}
    lenses: ClassVar[Mapping[str, Any]] = {}
    motion: ClassVar[Mapping[str, Any]] = {}

    @property
    def lens(self) -> GivenStack:
        """What stands for the lens, of which nothing else is known."""
        return self.pictures


@dataclass(frozen=True)
class PictureScene:
    """A scene folder whose card states that its pictures are given.

    Attributes
    ----------
    folder : Path
        Folder of the scene.
    card : PictureCard
        Card of the scene.
    digest : str
        SHA-256 (hex) over the pictures and what the card says of them.
    """

    folder: Path
    card: PictureCard
    digest: str

    @property
    def id(self) -> str:
        return self.card.id

    def read_pictures(self) -> Iterator[np.ndarray]:
        """Yield the light of each picture, float32 (row, col), in the order of their names.

        Raises BadInput if one cannot be read, or is no picture of light like the first.
        """
        shape = None
        for path in sorted((self.folder / FOLDER).glob("*.npy")):
            check_plain_file(path, max_bytes=MAX_BYTES)
            try:
                light = np.load(path, mmap_mode="r", allow_pickle=False)
            except (OSError, ValueError) as error:
                raise BadInput(f"cannot be read: {error}", where=str(path)) from error
            shape = light.shape if shape is None else shape
            if light.dtype != np.float32 or light.ndim != 2 or light.shape != shape or not light.size:
                raise BadInput(f"is {light.dtype} {light.shape}", where=str(path), allowed=f"float32 {shape}")
            if not (np.isfinite(light).all() and light.min() >= 0):
                raise BadInput("is negative or not finite", where=str(path), allowed="light, at least 0")
            yield light
