"""A recipe: what to make, as one frozen value read from a YAML file.

Nothing here renders, opens a scene or draws a number; :mod:`saf_gen.generate.plan` turns a recipe into
sequences.
"""

import math
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from saf_gen.core.config import components
from saf_gen.core.config.document import Document, FrozenModel, validate
from saf_gen.core.config.ranges import check_parameter, extreme_values
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.errors import BadInput, unknown
from saf_gen.lights import read_schedule

__all__ = [
    "CameraSettings",
    "ExposureSettings",
    "FocusSettings",
    "NoiseSwitches",
    "Recipe",
    "RenderSettings",
    "SplitSettings",
    "read_recipe",
]

NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]*$"


class ExposureSettings(FrozenModel):
    """How much light reaches the sensor.

    Either ``mean_rate``: the scene is scaled so that the target fires this often (spikes a readout) at its
    best focus and gain 1; or ``absolute``: the scene's own radiances through the lens, in electrons.
    ``f_number`` replaces the lens's own.
    """

    mean_rate: float | dict[str, Any] | None = None
    absolute: bool = False
    f_number: float | None = Field(default=None, gt=0.5, le=64)

    @model_validator(mode="after")
    def _one_of_two(self) -> "ExposureSettings":
        if (self.mean_rate is None) is not self.absolute:
            raise ValueError("either mean_rate: a number above 0 and below 1, or absolute: true")
        for value in extreme_values(self.mean_rate) if self.mean_rate is not None else ():
            if not (isinstance(value, int | float) and 0 < value < 1):
                raise ValueError("a mean_rate above 0 and below 1 spikes a readout")
        return self


class NoiseSwitches(FrozenModel):
    """Which of the sensor's imperfections act; what is not named stays as the sensor has it."""

    shot: bool | None = None
    dark: bool | None = None
    response: bool | None = None
    threshold_spread: bool | None = None
    threshold_noise: bool | None = None


class CameraSettings(FrozenModel):
    """The spike camera: which sensor, how long it records, how bright the scene is."""

    sensor: str
    frames: int = Field(ge=16, le=10_000_000)
    exposure: ExposureSettings
    noise: NoiseSwitches = NoiseSwitches()
    reset: Literal["subtract", "hard"] | None = None
    saturation: Literal["subtract", "dead_readout"] | None = None


class FocusSettings(FrozenModel):
    """How many focus positions to render, evenly over the lens's travel, and how the lens moves over it.

    ``drive``, where given, is what every scene must have; else each scene is filmed with its own.
    """

    drive: Literal["image_distance", "focal_length", "stage"] | None = None
    positions: int = Field(ge=2, le=4096)
    motion: dict[str, Any] = Field(default_factory=lambda: {"kind": "sweep"})

    @field_validator("motion", mode="before")
    @classmethod
    def _is_a_mapping(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            raise ValueError(f"a lens motion in braces, such as {{kind: {value or 'sweep'}}}")
        return value


class RenderSettings(FrozenModel):
    """Monte Carlo samples a pixel at each focus position, and the longest light path in segments.

    A scene that moves is rendered in time slices: ``slice_samples`` a pixel each (a quarter of ``samples``
    where not given) and ``slices_per_s`` in place of what the scene's card says. A slice holds the positions
    that the recorded lens passes then. The closed-loop track needs all positions: ``whole_slices`` has them
    for the whole recording (true), or beside the others for as many seconds from the beginning.
    """

    samples: int = Field(ge=1, le=65_536)
    max_depth: int = Field(default=6, ge=2, le=64)
    slice_samples: int | None = Field(default=None, ge=1, le=65_536)
    slices_per_s: float | None = Field(default=None, gt=0, le=20_000)
    whole_slices: bool | float = False

    @field_validator("whole_slices", mode="before")
    @classmethod
    def _true_or_seconds(cls, value: Any) -> Any:
        if isinstance(value, bool):
            return value
        if not isinstance(value, int | float) or not 0 < value < math.inf:
            raise ValueError("true, false, or seconds above 0")
        return float(value)

    @property
    def samples_per_slice(self) -> int:
        """Samples a pixel of one time slice."""
        return self.slice_samples or max(1, self.samples // 4)

    @property
    def all_positions_s(self) -> float:
        """For so long from the beginning time slices hold all positions, s."""
        if isinstance(self.whole_slices, bool):
            return math.inf if self.whole_slices else 0.0
        return self.whole_slices


class SplitSettings(FrozenModel):
    """Scenes × scene motion × lights × repeats; a split owns its scenes: no other split may use them.

    ``variants``: so many members of each scene's family, which repeats take in turn. ``scene_motion``:
    ``static`` (everything stands still) or ``dynamic`` (what moves, moves; only scenes that move have it).
    """

    scenes: tuple[str, ...] = Field(min_length=1)
    lights: tuple[str, ...] = Field(min_length=1)
    repeats: int = Field(default=1, ge=1, le=10_000)
    variants: int = Field(default=1, ge=1, le=10_000)
    scene_motion: tuple[Literal["static", "dynamic"], ...] = Field(default=("static",), min_length=1)

    @field_validator("scenes", "lights", "scene_motion")
    @classmethod
    def _each_once(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(value)) != len(value):
            raise ValueError("each of them once; repeats makes more sequences of each")
        return value

    @model_validator(mode="after")
    def _variants_are_used(self) -> "SplitSettings":
        if self.variants > self.repeats:
            raise ValueError(f"at most as many variants as repeats, which are {self.repeats}")
        return self


class Recipe(FrozenModel):
    """A whole dataset, from lens to splits.

    ``scene_params``: by scene, values or ranges of its parameters in place of those of its card.
    """

    name: str = Field(pattern=NAME_PATTERN)
    seed: int = Field(ge=0, le=2**63 - 1)
    camera: CameraSettings
    focus: FocusSettings
    render: RenderSettings
    lights: dict[str, dict[str, Any]] = Field(min_length=1)
    splits: dict[str, SplitSettings] = Field(min_length=1)
    scene_params: dict[str, dict[str, Any]] = Field(default_factory=dict)


def read_recipe(path: str | Path) -> Recipe:
    """Read and check a recipe, and the files that its lights and its lens motion name.

    Raises BadInput with file and line where something does not fit.
    """
    document = read_yaml(path)
    recipe = validate(Recipe, document)
    lights = {}
    for name, schedule in recipe.lights.items():
        _check_name("light", name, document, ("lights", name))
        lights[name] = read_schedule(schedule, document, keys=("lights", name))
    motion = components.read_component(
        "motions", recipe.focus.motion, document=document, keys=("focus", "motion")
    )
    focus = recipe.focus.model_copy(update={"motion": motion})
    recipe = recipe.model_copy(update={"lights": lights, "focus": focus})
    owners: dict[str, str] = {}
    for split_name, split in recipe.splits.items():
        _check_name("split", split_name, document, ("splits", split_name))
        for i, light in enumerate(split.lights):
            if light not in recipe.lights:
                raise unknown(
                    "light",
                    light,
                    allowed=recipe.lights,
                    where=document.locate("splits", split_name, "lights", i),
                )
        for i, scene in enumerate(split.scenes):
            where = document.locate("splits", split_name, "scenes", i)
            if scene in owners:
                raise BadInput(
                    f"scene {scene!r} stands in {owners[scene]} and in {split_name}",
                    where=where,
                    allowed="each scene in one split, once, so that nothing leaks from train to test",
                    hint="remove it from one of them",
                )
            owners[scene] = split_name
    for scene, params in recipe.scene_params.items():
        where = document.locate("scene_params", scene)
        if scene not in owners:
            raise unknown("scene of scene_params", scene, allowed=owners, where=where)
        for key, value in params.items():
            where = document.locate("scene_params", scene, key)
            check_parameter(value, what=f"scene_params.{scene}.{key}", where=where)
    return recipe


def _check_name(what: str, name: str, document: Document, keys: tuple[str, ...]) -> None:
    if not name.replace("_", "").replace("-", "").isalnum() or name != name.lower():
        raise BadInput(
            f"{what} {name!r} cannot be part of a file name",
            where=document.locate(*keys),
            allowed="lower-case letters, digits, - and _",
        )
