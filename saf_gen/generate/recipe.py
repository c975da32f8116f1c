"""A recipe: what a dataset is made of, as one frozen value read from a YAML file.

No number is drawn and no scene opened here: :mod:`saf_gen.generate.plan` turns a recipe into sequences.
"""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, WithJsonSchema, field_validator, model_validator

from saf_gen.core.config import components
from saf_gen.core.config.document import FrozenModel, validate_document
from saf_gen.core.config.ranges import check_config_parameter, config_range_extremes
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.errors import BadInput, unknown
from saf_gen.generate.sealing import SealedSeed, open_sealed_recipe_seed
from saf_gen.plugins.lights import read_light_schedule

NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]*$"


SEED_SCHEMA = {"anyOf": [{"type": "integer", "minimum": 0, "maximum": 2**63 - 1}, SealedSeed.model_json_schema()]}
"""What an editor takes for a seed: a number, or a sealed one, which is a number once it is open."""


class ExposureSettings(FrozenModel):
    """How much light reaches the sensor.

    With ``mean_rate`` the light is scaled so that the target fires this often, in spikes per readout, at best
    focus and gain 1. With ``absolute`` the scene's own radiances are used. ``f_number`` replaces the lens's.
    """

    mean_rate: float | dict[str, Any] | None = None
    """Spikes per readout of the target at best focus and gain 1, above the dark rate and below 1; may be a range.
    Either this, or ``absolute: true``."""
    absolute: bool = False
    """The scene's own radiances go through the lens, and nothing is scaled."""
    f_number: float | None = Field(default=None, gt=0.5, le=64)
    """Replaces that of the scene's lens."""

    @model_validator(mode="after")
    def _one_of_two(self) -> "ExposureSettings":
        if (self.mean_rate is None) is not self.absolute:
            raise ValueError("either mean_rate: a number above 0 and below 1, or absolute: true")
        for value in config_range_extremes(self.mean_rate) if self.mean_rate is not None else ():
            if not (isinstance(value, int | float) and 0 < value < 1):
                raise ValueError("a mean_rate above 0 and below 1 spikes per readout")
        return self


class NoiseSettings(FrozenModel):
    """Which of the sensor's imperfections act; None leaves one as the sensor has it."""

    shot: bool | None = None
    """Shot noise of the light; where it is left out, as the sensor has it."""
    dark: bool | None = None
    """Dark current, the same."""
    response: bool | None = None
    """Differences of response between pixels, the same."""
    threshold_spread: bool | None = None
    """Differences of threshold between pixels, the same."""
    threshold_noise: bool | None = None
    """Noise of a pixel's threshold from spike to spike, the same."""
    dust: bool | None = None
    """Specks that take light from some pixels, the same."""
    dead: bool | None = None
    """Pixels that never fire, the same."""
    reset_jitter: bool | None = None
    """Uncertainty of the instant at which a pixel begins anew, the same."""


class CameraSettings(FrozenModel):
    """The spike camera: its sensor, how many readouts it records, and its exposure."""

    sensor: str
    """A sensor's name, or the path of a sensor file (``.yaml``) from the recipe's folder."""
    frames: int = Field(ge=16, le=10_000_000)
    """Readouts of each recording."""
    exposure: ExposureSettings
    noise: NoiseSettings = NoiseSettings()
    reset: Literal["subtract", "hard"] | None = None
    """What becomes of the charge over the threshold; where it is left out, as the sensor has it."""
    saturation: Literal["subtract", "dead_readout"] | None = None
    """What happens where light is too bright, the same."""


class FocusSettings(FrozenModel):
    """The focus positions to render, evenly over the travel of the lens, and the motion of the lens.

    ``drive``, where given, is the kind that every scene must have; else each scene has its own.
    """

    drive: Literal["image_distance", "focal_length", "stage"] | None = None
    """The drive that every scene must have; where it is left out, each scene has its own."""
    positions: int = Field(ge=2, le=4096)
    """Rendered focus positions, evenly over the travel."""
    motion: dict[str, Any] = Field(default_factory=lambda: {"kind": "sweep"})
    """A lens motion, ``{kind: …}``; may be a choice of several."""

    @field_validator("motion", mode="before")
    @classmethod
    def _is_a_mapping(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            raise ValueError(f"a lens motion in braces, such as {{kind: {value or 'sweep'}}}")
        return value


class RenderSettings(FrozenModel):
    """Monte Carlo samples per pixel and focus position, and the longest light path in segments.

    A moving scene is rendered in time slices, ``slices_per_s`` of them (by default as many as its card says), with
    ``slice_samples`` per pixel (by default a quarter of ``samples``). A slice holds the positions that the recorded
    lens passes at its time. The closed-loop track needs all positions: ``whole_slices`` true renders them for the whole
    recording; a number of seconds renders the slices up to then once more, at all positions. ``diffraction`` says
    whether waves bend the light at the aperture; by default they do wherever the backend can render them.
    ``estimator`` "plain" takes each light path as it was traced, without bias and with more grain.
    """

    samples: int = Field(ge=1, le=65_536)
    """Light paths per pixel and position, for each light group; under ``estimator: filtered``, six camera rays as
    well for each."""
    max_depth: int = Field(default=6, ge=2, le=64)
    """Segments of a light path; with shared shading those behind the clear surfaces that a camera ray looks
    through."""
    slice_samples: int | None = Field(default=None, ge=1, le=65_536)
    """``samples`` for each time slice of a scene that moves; where it is left out, a quarter of ``samples``."""
    slices_per_s: float | None = Field(default=None, gt=0, le=20_000)
    """Time slices per second of a scene that moves; where it is left out, as its card says."""
    whole_slices: bool | float = False
    """Time slices at all positions, which the closed loop needs: for so many seconds from the beginning, beside the
    others, or for all of the recording, in place of them."""
    diffraction: bool | None = None
    """Whether waves bend the light at the aperture, at the sensor's ``wavelength_m``; where it is left out,
    wherever the renderer can: not with ``--variant scalar``."""
    estimator: Literal["filtered", "plain"] = "filtered"
    """``filtered`` shares what paths tell about the light on a surface and leaves a quarter of the grain, with a
    small bias; ``plain`` takes each path as it was traced, as ``scalar`` always does."""

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
        """Samples per pixel of one time slice."""
        return self.slice_samples or max(1, self.samples // 4)

    @property
    def all_positions_s(self) -> float:
        """Seconds from the beginning for which time slices hold all positions; inf for all of them."""
        if isinstance(self.whole_slices, bool):
            return math.inf if self.whole_slices else 0.0
        return self.whole_slices


class SplitSettings(FrozenModel):
    """The sequences of a split: scenes × scene motion × lights × repeats. No two splits share a scene.

    ``variants`` is the number of members of each scene's family, which the repeats use in turn. Under
    ``scene_motion`` "static" everything stands still; "dynamic" is for scenes in which something moves.
    """

    scenes: tuple[str, ...] = Field(min_length=1)
    """Scenes, each once, and in one split alone; ``saf-gen scenes list`` names them."""
    lights: tuple[str, ...] = Field(min_length=1)
    """Names from ``lights``, each once."""
    repeats: int = Field(default=1, ge=1, le=10_000)
    """Recordings of each scene under each light."""
    variants: int = Field(default=1, ge=1, le=10_000)
    """Members of each scene's family, which the repeats use in turn; at most as many as repeats."""
    scene_motion: tuple[Literal["static", "dynamic"], ...] = Field(default=("static",), min_length=1)
    """Whether a scene that moves is recorded standing still, moving, or both."""
    at_rest: tuple[str, ...] = ()
    """Scenes of the split that move and are recorded standing still all the same, such as those of many time slices."""

    @field_validator("scenes", "lights", "scene_motion", "at_rest")
    @classmethod
    def _each_once(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(value)) != len(value):
            raise ValueError("each name once; repeats makes more sequences of each")
        return value

    @model_validator(mode="after")
    def _variants_are_used(self) -> "SplitSettings":
        if self.variants > self.repeats:
            raise ValueError(f"at most as many variants as repeats, which are {self.repeats}")
        return self

    @model_validator(mode="after")
    def _at_rest_is_recorded(self) -> "SplitSettings":
        if self.at_rest and "static" not in self.scene_motion:
            raise ValueError("scene_motion: [static, dynamic] where scenes are at_rest")
        return self


class Recipe(FrozenModel):
    """A whole dataset; ``scene_params`` replaces parameters, or their ranges, on the cards of scenes."""

    name: str = Field(pattern=NAME_PATTERN)
    """Name of the dataset: lower-case letters, digits, ``-``, ``_``."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1), WithJsonSchema(SEED_SCHEMA)]
    """Names every random number of the dataset; ``saf-gen recipes seal`` hides it until its secret is opened."""
    camera: CameraSettings
    focus: FocusSettings
    render: RenderSettings
    lights: dict[str, dict[str, Any]] = Field(min_length=1)
    """A light schedule, ``{kind: …}``, for all light groups or for each by its name."""
    splits: dict[str, SplitSettings] = Field(min_length=1)
    """The sequences of each split, by its name."""
    scene_params: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Values or ranges of a scene's parameters, in place of its card's."""

    def with_fewer_repeats(self, most: int) -> "Recipe":
        """Return the recipe with at most so many repeats, and so members of a family, in each split."""

        def cut(split: SplitSettings) -> SplitSettings:
            repeats = min(split.repeats, most)
            return split.model_copy(update={"repeats": repeats, "variants": min(split.variants, repeats)})

        return self.model_copy(update={"splits": {name: cut(split) for name, split in self.splits.items()}})


def read_recipe(path: str | Path) -> Recipe:
    """Read and check a recipe and the files that its lights and its lens motion name.

    Raises BadInput with file and line where something does not fit.
    """
    document = read_yaml(path)
    open_sealed_recipe_seed(document)
    recipe = validate_document(Recipe, document)
    lights = {}
    for name, schedule in recipe.lights.items():
        _check_name("light", name, where=document.locate("lights", name))
        lights[name] = read_light_schedule(schedule, document, keys=("lights", name))
    motion = components.read_config_component(
        "motions", recipe.focus.motion, document=document, keys=("focus", "motion")
    )
    recipe = recipe.model_copy(update={"lights": lights, "focus": recipe.focus.model_copy(update={"motion": motion})})
    owners: dict[str, str] = {}
    for split_name, split in recipe.splits.items():
        _check_name("split", split_name, where=document.locate("splits", split_name))
        for i, light in enumerate(split.lights):
            if light not in recipe.lights:
                raise unknown(
                    "light", light, allowed=recipe.lights, where=document.locate("splits", split_name, "lights", i)
                )
        for i, scene in enumerate(split.at_rest):
            if scene not in split.scenes:
                where = document.locate("splits", split_name, "at_rest", i)
                raise unknown(f"scene of {split_name} in at_rest:", scene, allowed=split.scenes, where=where)
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
            check_config_parameter(value, what=f"scene_params.{scene}.{key}", where=where)
    return recipe


def _check_name(what: str, name: str, *, where: str) -> None:
    if not name.replace("_", "").replace("-", "").isalnum() or name != name.lower():
        raise BadInput(
            f"{what} {name!r} cannot be part of a file name", where=where, allowed="lower-case letters, digits, - and _"
        )
