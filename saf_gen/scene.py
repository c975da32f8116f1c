"""A scene: a folder with its card (``scene.yaml``) and its geometry (``scene.py`` with ``build(params)``).

This module reads and checks the card and knows where scenes live; only :mod:`saf_gen.render` builds one.
"""

import hashlib
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from saf_gen.documents import Frozen, read_as
from saf_gen.errors import BadInput, unknown
from saf_gen.optics import ImageDistance

__all__ = ["Card", "Scene", "find_scene", "scene_names"]

Vector = tuple[float, float, float]


class Pose(Frozen):
    """Where the lens centre is, a point on its axis, and which way is up (m, world axes)."""

    origin_m: Vector
    look_at_m: Vector
    up: Vector = (0.0, 1.0, 0.0)

    @model_validator(mode="after")
    def _has_an_axis(self) -> "Pose":
        axis = [b - a for a, b in zip(self.origin_m, self.look_at_m, strict=True)]
        cross = (
            axis[1] * self.up[2] - axis[2] * self.up[1],
            axis[2] * self.up[0] - axis[0] * self.up[2],
            axis[0] * self.up[1] - axis[1] * self.up[0],
        )
        if math.hypot(*cross) < 1e-9:
            raise ValueError("look_at_m away from origin_m, and up not along that axis")
        return self


class LensCard(Frozen):
    """The lens: ``focus_range_m`` are the object distances in focus at position 0 and at position 1."""

    focal_length_mm: float = Field(gt=0, le=2000)
    f_number: float = Field(gt=0.5, le=64)
    drive: Literal["image_distance"] = "image_distance"
    focus_range_m: tuple[float, float]
    transmission: float = Field(default=1.0, gt=0, le=1)


class Card(Frozen):
    """What a scene says of itself."""

    id: str = Field(pattern=r"^[a-z0-9][a-z0-9_]*$")
    title: str
    licence: str
    source: str
    camera: Pose
    lens: LensCard
    lights: dict[str, tuple[str, ...]] = Field(min_length=1)
    target: tuple[str, ...] = Field(min_length=1)
    params: dict[str, Any] = Field(default_factory=dict)


@dataclass(frozen=True)
class Scene:
    """A scene folder whose card has been read.

    ``digest`` covers every file that can change a picture, so that a stored focal stack is never taken
    for that of an edited scene.
    """

    folder: Path
    card: Card
    digest: str

    @property
    def id(self) -> str:
        return self.card.id

    def drive(self, f_number: float | None = None) -> ImageDistance:
        """The lens with its drive; ``f_number`` replaces the card's."""
        lens = self.card.lens
        return ImageDistance(
            focal_length_m=lens.focal_length_mm * 1e-3,
            f_number=f_number or lens.f_number,
            focus_range_m=lens.focus_range_m,
            transmission=lens.transmission,
        )


def scene_roots() -> list[Path]:
    """Folders of scenes, the first that has a name wins.

    ``$SAF_GEN_SCENES`` (folders separated as in PATH), ``scenes/`` here, ``scenes/`` of the checkout.
    """
    named = [Path(p) for p in os.environ.get("SAF_GEN_SCENES", "").split(os.pathsep) if p]
    return [*named, Path("scenes").resolve(), Path(__file__).resolve().parent.parent / "scenes"]


def scene_names() -> list[str]:
    """Names of every scene that can be found."""
    return sorted({p.parent.name for root in scene_roots() for p in root.glob("*/scene.yaml")})


def find_scene(name: str) -> Scene:
    """The scene ``name``.

    Raises BadInput where there is none of that name, its card does not fit, or its geometry is missing.
    """
    for root in scene_roots():
        if (root / name / "scene.yaml").is_file():
            return _read(root / name)
    raise unknown("scene", name, scene_names(), hint="see: saf-gen scenes list")


def _read(folder: Path) -> Scene:
    path = folder / "scene.yaml"
    card, document = read_as(Card, path)
    if card.id != folder.name:
        raise BadInput(
            f"id is {card.id!r}", where=document.where("id"), allowed=f"{folder.name}, as the folder"
        )
    if not (folder / "scene.py").is_file():
        raise BadInput(f"{folder} has no scene.py", hint="add one with build(params) -> Mitsuba dictionary")
    groups = [e for emitters in card.lights.values() for e in emitters]
    for emitter in groups:
        if groups.count(emitter) > 1:
            raise BadInput(f"emitter {emitter!r} is in two light groups", where=document.where("lights"))
    scene = Scene(folder, card, _digest(folder))
    try:
        scene.drive()
    except BadInput as error:
        raise BadInput(str(error), where=document.where("lens", "focus_range_m")) from error
    return scene


def _digest(folder: Path) -> str:
    """SHA-256 over names and bytes of the folder's files, prose and pictures of the result aside."""
    sha = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        name = path.relative_to(folder).as_posix()
        if "__pycache__" in name or path.suffix == ".md" or name.startswith("preview"):
            continue
        content = path.read_bytes()
        sha.update(f"{name}\0{len(content)}\0".encode() + content)
    return sha.hexdigest()
