"""A scene: a folder with its card (``scene.yaml``) and its geometry (``scene.py`` with ``build(params)``).

This module reads and checks the card and knows where scenes live; only :mod:`saf_gen.render` builds one.
"""

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from saf_gen.core import seeds
from saf_gen.core.config.ranges import check_parameter, draw_value
from saf_gen.core.config.yaml_document import FrozenModel, read_model
from saf_gen.errors import BadInput, unknown
from saf_gen.lights._schedule import RESERVED_GROUP_NAMES, check_light_groups
from saf_gen.optics import Drive
from saf_gen.optics.lens_card import LensCard
from saf_gen.scene.keyframes import RigidMotion
from saf_gen.scene.scene_digest import folder_digest

__all__ = [
    "RESERVED_GROUP_NAMES",
    "Scene",
    "SceneCard",
    "find_scene",
    "load_scene_folder",
    "scene_names",
    "scene_roots",
]

CARD_FILE, SCRIPT_FILE = "scene.yaml", "scene.py"
KEYS_WITHOUT_PIXEL_EFFECT = frozenset(
    "title licence source illuminance_lux params slices_per_s interpolation_error still_s".split()  # noqa: SIM905
)
"""Keys of a card that change no focal stack, or that a stack's own name tells."""
Vector = tuple[float, float, float]


class CameraPose(FrozenModel):
    """Where the lens centre is, a point on its axis, and which way is up (m, world axes)."""

    origin_m: Vector
    look_at_m: Vector
    up: Vector = (0.0, 1.0, 0.0)

    @model_validator(mode="after")
    def _has_an_axis(self) -> "CameraPose":
        axis = [b - a for a, b in zip(self.origin_m, self.look_at_m, strict=True)]
        cross = (
            axis[1] * self.up[2] - axis[2] * self.up[1],
            axis[2] * self.up[0] - axis[0] * self.up[2],
            axis[0] * self.up[1] - axis[1] * self.up[0],
        )
        if math.hypot(*cross) < 1e-9:
            raise ValueError("look_at_m away from origin_m, and up not along that axis")
        return self


class SceneCard(FrozenModel):
    """What a scene says of itself.

    ``motion``: how shapes move, on top of the pose that the scene gives them. ``slices_per_s``: time slices
    to render of a scene that moves, so many that the straight line between two hardly differs from a render.
    ``interpolation_error``: how far that line is from a render half way at most, for every member: rms over
    the box round the target in focus, over the mean brightness there; :mod:`saf_gen.authoring.checks`
    measures it. ``still_s``: the moment that is seen where the scene is to stand still.
    ``unit_m``: metres in one unit of the scene's geometry; the card itself is in metres all the same.
    ``illuminance_lux``: mean illuminance of the target at gain 1 by each light group alone, for all of them
    or for none; light schedules in lux need it.
    """

    id: str = Field(pattern=r"^[a-z0-9][a-z0-9_]*$")
    title: str
    licence: str
    source: str
    unit_m: float = Field(default=1.0, gt=0)
    camera: CameraPose
    lens: LensCard
    lights: dict[str, tuple[str, ...]] = Field(min_length=1)
    illuminance_lux: dict[str, float] = Field(default_factory=dict)
    target: tuple[str, ...] = Field(min_length=1)
    params: dict[str, Any] = Field(default_factory=dict)
    motion: dict[str, RigidMotion] = Field(default_factory=dict)
    slices_per_s: float | None = Field(default=None, gt=0, le=20_000)
    interpolation_error: float | None = Field(default=None, gt=0, lt=1)
    still_s: float = 0.5

    @model_validator(mode="after")
    def _light_is_measured_whole(self) -> "SceneCard":
        lux = self.illuminance_lux
        if lux and not (set(lux) == set(self.lights) and all(value > 0 for value in lux.values())):
            raise ValueError(f"illuminance_lux above 0 for each of {', '.join(self.lights)}, or for none")
        return self


@dataclass(frozen=True)
class Scene:
    """A scene folder whose card has been read: one member of the family that its open parameters make.

    ``digest`` covers every file that can change a picture, so that a stored focal stack is never taken
    for that of an edited scene. ``params`` are the parameters, all of them, with every range drawn.
    """

    folder: Path
    card: SceneCard
    digest: str
    params: Mapping[str, Any]

    @property
    def id(self) -> str:
        return self.card.id

    @property
    def has_script(self) -> bool:
        """Whether the geometry is a script, ``scene.py``, rather than ``scene.xml``."""
        return (self.folder / SCRIPT_FILE).is_file()

    def build_drive(self, f_number: float | None = None) -> Drive:
        """The lens with its drive; ``f_number`` replaces the card's."""
        return self.card.lens.build_drive(f_number)

    def draw_member(self, *stream: str | int) -> "Scene":
        """The member of the family that the random streams of this name draw."""
        params = {
            key: draw_value(value, seeds.make_generator(*stream, "param", key))
            for key, value in self.card.params.items()
        }
        return replace(self, params=params)

    def with_params(self, chosen: Mapping[str, Any]) -> "Scene":
        """This scene with some parameters as given; raises BadInput for one that the card does not have."""
        for key in chosen:
            if key not in self.params:
                raise unknown(f"parameter of scene {self.id!r}:", key, self.params)
        return replace(self, params={**self.params, **chosen})


def scene_roots() -> list[Path]:
    """Folders of scenes that the user trusts to run code, the first that has a name wins.

    ``$SAF_GEN_SCENES`` (folders separated as in PATH), ``scenes/`` here, ``scenes/`` of the checkout. The
    ``scenes/`` of a dataset is somebody's data, and no root although a user may have gone into the dataset.
    """
    named = [Path(p) for p in os.environ.get("SAF_GEN_SCENES", "").split(os.pathsep) if p]
    here = [] if Path("manifest.json").exists() else [Path("scenes").resolve()]
    return [*named, *here, Path(__file__).resolve().parents[2] / "scenes"]


def scene_names() -> list[str]:
    """Names of every scene that can be found."""
    return sorted({p.parent.name for root in scene_roots() for p in root.glob(f"*/{CARD_FILE}")})


def find_scene(name: str) -> Scene:
    """The scene ``name``, with open parameters drawn once and for all, for looking at it.

    A name is no path: a recipe from somewhere cannot lead to code from elsewhere. Raises BadInput where there
    is none of that name, its card does not fit, or its geometry is missing.
    """
    for root in scene_roots():
        if Path(name).name == name and (root / name / CARD_FILE).is_file():
            return _read(root / name)
    raise unknown("scene", name, scene_names(), hint="see: saf-gen scenes list")


def load_scene_folder(folder: Path) -> Scene:
    """The scene of a folder, wherever it lies; one with a script only where the user trusts that place.

    Raises BadInput as :func:`find_scene` does, and for a ``scene.py`` out of all :func:`scene_roots`.
    """
    folder = folder.resolve()
    trusted = folder.parent in {root.resolve() for root in scene_roots()}
    if (folder / SCRIPT_FILE).exists() and not trusted:
        raise BadInput(
            f"{folder / SCRIPT_FILE} is code, and would be run",
            allowed="scene.py in ./scenes or in a folder of SAF_GEN_SCENES; a scene.xml anywhere",
            hint=f"read it, and if you trust it: SAF_GEN_SCENES={folder.parent}",
        )
    return _read(folder)


def _read(folder: Path) -> Scene:
    path = folder / CARD_FILE
    card, document = read_model(SceneCard, path)
    if card.id != folder.name:
        raise BadInput(
            f"id is {card.id!r}", where=document.locate("id"), allowed=f"{folder.name}, as the folder"
        )
    geometry = [name for name in (SCRIPT_FILE, "scene.xml") if (folder / name).is_file()]
    if not geometry:
        raise BadInput(
            f"{folder} has neither scene.py nor scene.xml",
            hint="add scene.py with build(params) -> Mitsuba dictionary, or an exported scene.xml",
        )
    if len(geometry) > 1:
        raise BadInput(f"{folder} has scene.py and scene.xml", hint="keep one of the two")
    check_light_groups(card.lights, document)
    for key, value in card.params.items():
        check_parameter(value, what=f"params.{key}", where=document.locate("params", key))
    scene = Scene(folder, card, _digest(folder, card), {}).draw_member("scene", card.id)
    try:
        scene.build_drive()
    except BadInput as error:
        raise BadInput(str(error), where=document.locate("lens", card.lens.drive_class.travel_key)) from error
    return scene


def _digest(folder: Path, card: SceneCard) -> str:
    """SHA-256 over the files of the folder that change a picture; linked folders count with what they hold.

    Of the card only what it says counts, and of that nothing that changes no picture: a title mended or a lux
    measured anew renders nothing again. Parameters and moments are named by each stack itself.
    """
    said = card.model_dump(mode="json", exclude_unset=True, exclude=set(KEYS_WITHOUT_PIXEL_EFFECT))
    # Only a script can read out of the folder: what an XML scene names must lie within.
    leave = (folder / SCRIPT_FILE).is_file()
    return folder_digest(folder, contents={CARD_FILE: json.dumps(said, sort_keys=True).encode()}, leave=leave)
