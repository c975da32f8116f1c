"""A recipe: the description of a dataset, as one frozen value that is read from a YAML file.

This module draws no numbers and opens no scenes: :mod:`saf_gen.generate.resolve` turns a recipe into sequences.
"""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from saf_gen.core.config import components
from saf_gen.core.config.document import Document, FrozenModel, validate_document
from saf_gen.core.config.json_schema import OPEN, PARAMETER, Schema, define_schema, model_schema
from saf_gen.core.config.ranges import check_parameter, range_extremes
from saf_gen.core.config.yaml_document import read_yaml
from saf_gen.core.shipped import shipped_folder
from saf_gen.errors import BadInput, some_of, unknown
from saf_gen.generate.light_schema import define_lights
from saf_gen.optics import AxialColour
from saf_gen.plugins.lights import read_schedule

NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]*$"


class ExposureSettings(FrozenModel):
    """The amount of light that reaches the sensor.

    With ``mean_rate`` the light is scaled so that the target fires at this rate, in spikes per readout, at best focus
    and gain 1. With ``spikes_per_depth``, so that it fires so often while the lens passes a depth of focus. With
    ``absolute`` the radiances of the scene are not scaled. ``f_number`` replaces the lens's f-number.
    """

    mean_rate: float | dict[str, Any] | None = None
    """Spikes per readout of the target at best focus and gain 1, above the dark rate and below 1; may be a range.
    Give this, ``spikes_per_depth`` or ``absolute: true``."""
    spikes_per_depth: float | dict[str, Any] | None = None
    """Spikes of a pixel of the target, at best focus and gain 1, in the time in which a lens that passes its travel
    once in the recording passes one depth of focus, so that lenses of long and short travels see as much light; may be
    a range."""
    absolute: bool = False
    """Whether the radiances of the scene go through the lens without being scaled."""
    f_number: float | None = Field(default=None, gt=0.5, le=64)
    """F-number that replaces that of the scene's lens."""

    @model_validator(mode="after")
    def _check_one_exposure(self) -> "ExposureSettings":
        if (self.mean_rate is not None) + (self.spikes_per_depth is not None) + self.absolute != 1:
            raise ValueError("either mean_rate: a number above 0 and below 1, or spikes_per_depth, or absolute: true")
        for name, highest in (("mean_rate", 1.0), ("spikes_per_depth", math.inf)):
            stated = getattr(self, name)
            try:
                values = range_extremes(stated) if stated is not None else ()
            except BadInput as error:  # pydantic adds the place in the file to a ValueError alone
                raise ValueError(f"for the range of {name}, {error.allowed}") from error
            for value in values:
                if not (isinstance(value, int | float) and 0 < value < highest):
                    below = f" and below {highest:g} spikes per readout" if highest < math.inf else ", and finite"
                    raise ValueError(f"a {name} above 0{below}")
        return self

    @model_serializer(mode="wrap")
    def _leave_out_what_is_not_stated(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out ``spikes_per_depth`` if it is not given: other recipes keep their text and fingerprint."""
        return {key: value for key, value in serialize(self).items() if key != "spikes_per_depth" or value is not None}


class NoiseSettings(FrozenModel):
    """The imperfections of the sensor that are simulated; None leaves an imperfection as the sensor has it."""

    shot: bool | None = None
    """Shot noise of the light; by default as the sensor has it."""
    dark: bool | None = None
    """Dark current; by default as the sensor has it."""
    response: bool | None = None
    """Differences of response between pixels; by default as the sensor has them."""
    threshold_spread: bool | None = None
    """Differences of threshold between pixels; by default as the sensor has them."""
    threshold_noise: bool | None = None
    """Noise of a pixel's threshold from spike to spike; by default as the sensor has it."""
    dust: bool | None = None
    """Specks that take light from some pixels; by default as the sensor has them."""
    dead: bool | None = None
    """Pixels that never fire; by default as the sensor has them."""
    reset_jitter: bool | None = None
    """Uncertainty of the instant at which a pixel starts again after a spike; by default as the sensor has it."""


class CameraSettings(FrozenModel):
    """The spike camera: its sensor, the number of readouts that it records, and its exposure."""

    sensor: str | tuple[str, ...]
    """Name of a sensor, or path of a sensor file (``.yaml``) relative to the recipe's folder; or a list of it and of
    other cameras, which record every sequence again."""
    frames: int = Field(ge=16, le=10_000_000)
    """Number of readouts of each recording."""
    exposure: ExposureSettings
    noise: NoiseSettings = NoiseSettings()
    reset: Literal["subtract", "hard"] | None = None
    """Whether a pixel keeps or loses the charge above the threshold at a spike; by default as the sensor has it."""
    saturation: Literal["subtract", "dead_readout"] | None = None
    """Law of saturation, for light that is too bright; by default as the sensor has it."""
    filter: Literal["none", "ir_cut"] | None = None
    """Filter in front of the sensor, for lights that state their ``spectrum``; by default as the sensor has it."""

    @field_validator("sensor", mode="before")
    @classmethod
    def _check_names(cls, value: Any) -> Any:
        names = [value] if isinstance(value, str) else value
        if not (isinstance(names, list) and names and all(isinstance(name, str) for name in names)):
            raise ValueError("a sensor, or a list of a spike camera's sensor and other cameras")
        if len(set(names)) < len(names):
            raise ValueError("each camera once")
        return value if isinstance(value, str) else tuple(names)

    @property
    def spike_sensor(self) -> str:
        """The sensor of the spike camera."""
        return self.sensor if isinstance(self.sensor, str) else self.sensor[0]

    @property
    def other_cameras(self) -> tuple[str, ...]:
        """The cameras that record every sequence again."""
        return () if isinstance(self.sensor, str) else self.sensor[1:]

    @model_serializer(mode="wrap")
    def _leave_out_what_is_not_stated(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out ``filter`` if it is not given: recipes keep the text and fingerprint from before this key."""
        return {key: value for key, value in serialize(self).items() if key != "filter" or value is not None}


class FocusSettings(FrozenModel):
    """The focus positions to render, evenly spaced over the travel of the lens, and the motion of the lens.

    If ``drive`` is given, every scene must have a drive of this kind; by default each scene has its own.
    """

    drive: Literal["image_distance", "focal_length", "stage"] | None = None
    """Kind of drive that every scene must have; by default each scene has its own."""
    positions: int = Field(ge=2, le=4096)
    """Number of rendered focus positions, evenly spaced over the travel."""
    motion: dict[str, Any] = Field(default_factory=lambda: {"kind": "sweep"})
    """Lens motion, ``{kind: …}``; may be a choice among several."""
    aberrations: Literal["none", "mild", "strong"] | None = None
    """Aberrations of every lens: none, or those of a typical lens; by default those of its card."""
    axial_colour: AxialColour | None = None
    """Axial colour of every lens, for lights that state their ``spectrum``; by default that of its card."""
    actuator: str | None = None
    """Actuator that the motion commands, by its name, or as the path of an actuator file (``.yaml``) relative to the
    recipe's folder; by default the lens moves exactly as its motion says."""

    @model_serializer(mode="wrap")
    def _leave_out_what_is_not_stated(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out later keys if they are not given: recipes keep the text and fingerprint from before these keys."""
        later = ("aberrations", "axial_colour", "actuator")
        values = {key: value for key, value in serialize(self).items() if key not in later or value is not None}
        if self.axial_colour is not None:
            values["axial_colour"] = self.axial_colour.model_dump(mode="json", exclude_none=True)
        return values

    @field_validator("motion", mode="before")
    @classmethod
    def _check_mapping(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            raise ValueError(f"a lens motion in braces, such as {{kind: {value or 'sweep'}}}")
        return value


class SceneSamples(FrozenModel):
    """Samples of one scene, in place of those of all scenes; what is left out is as for all scenes."""

    samples: int | None = Field(default=None, ge=1, le=65_536)
    """``render.samples`` of this scene."""
    slice_samples: int | None = Field(default=None, ge=1, le=65_536)
    """``render.slice_samples`` of this scene, which must be recorded while it moves; by default as for all scenes or,
    if nothing is stated for them, a quarter of this scene's ``samples``."""

    @model_validator(mode="after")
    def _check_something_is_stated(self) -> "SceneSamples":
        if self.samples is None and self.slice_samples is None:
            raise ValueError("samples, slice_samples, or both")
        return self


class RenderSettings(FrozenModel):
    """Monte Carlo samples per pixel and focus position, the longest light path in segments, and time slices.

    A moving scene is rendered in time slices, ``slices_per_s`` per second (by default as its card states), with
    ``slice_samples`` per pixel (by default a quarter of ``samples``). A slice holds the positions that the recorded
    lens passes at about its time. The closed loop needs all positions: ``whole_slices: true`` renders them for the
    whole recording; a number of seconds renders the slices up to this time again, at all positions. ``diffraction``
    determines whether waves bend the light at the aperture; by default they do if the backend can render them.
    ``estimator: plain`` uses each light path as it was traced, without bias and with more grain.
    """

    samples: int = Field(ge=1, le=65_536)
    """Light paths per pixel and position, for each light group; with ``estimator: filtered``, each light path comes
    with six camera rays."""
    max_depth: int = Field(default=6, ge=2, le=64)
    """Largest number of segments of a light path; with ``estimator: filtered``, segments count only behind the clear
    surfaces through which a camera ray passes."""
    slice_samples: int | None = Field(default=None, ge=1, le=65_536)
    """``samples`` for each time slice of a moving scene; by default a quarter of ``samples``."""
    slices_per_s: float | None = Field(default=None, gt=0, le=20_000)
    """Time slices per second of a moving scene; by default as its card states."""
    whole_slices: bool | float = False
    """Time slices at all positions, which the closed loop needs. A number of seconds adds them to the others from the
    beginning until this time; true replaces the others by them for the whole recording."""
    diffraction: bool | None = None
    """Whether waves bend the light at the aperture, at the sensor's ``wavelength_m``; by default they do if the
    renderer supports it, which ``--variant scalar`` does not."""
    estimator: Literal["filtered", "plain"] = "filtered"
    """``filtered`` lets paths share the light that they find on a surface, which leaves a quarter of the grain and a
    small bias; ``plain`` uses each path as it was traced, as ``scalar`` always does."""
    half_floats: bool = False
    """Whether pictures of scenes at rest are stored as those of moving scenes always are: as half floats, compressed,
    which takes a fifth of the space and changes values by at most 0.05 %."""
    per_scene: dict[str, SceneSamples] = Field(default_factory=dict)
    """Scenes with other numbers of samples than the rest, such as those with more grain."""

    @model_serializer(mode="wrap")
    def _leave_out_what_is_not_stated(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out later keys if they are not given: recipes keep the text and fingerprint from before these keys."""
        values = serialize(self)
        del values["per_scene"]
        if not self.half_floats:
            del values["half_floats"]
        if self.per_scene:
            own = {name: one.model_dump(mode="json", exclude_none=True) for name, one in self.per_scene.items()}
            values["per_scene"] = own
        return values

    @field_validator("whole_slices", mode="before")
    @classmethod
    def _parse_true_or_seconds(cls, value: Any) -> Any:
        if isinstance(value, bool):
            return value
        if not isinstance(value, int | float) or not 0 < value < math.inf:
            raise ValueError("true, false, or seconds above 0")
        return float(value)

    def of_scene(self, name: str) -> "RenderSettings":
        """Return the settings of one scene: its own numbers of samples, and all else as for the others."""
        own = self.per_scene.get(name)
        if own is None:
            return self
        return self.model_copy(update={**own.model_dump(exclude_none=True), "per_scene": {}})

    @property
    def samples_per_slice(self) -> int:
        """Samples per pixel of one time slice."""
        return self.slice_samples or max(1, self.samples // 4)

    @property
    def all_positions_s(self) -> float:
        """Seconds from the beginning in which time slices hold all positions; inf for the whole recording."""
        if isinstance(self.whole_slices, bool):
            return math.inf if self.whole_slices else 0.0
        return self.whole_slices


class TruthSettings(FrozenModel):
    """What is made of the truth beside what every stream holds: the true focus, the depth and the target."""

    sharp: bool = Field(default=False, strict=True)
    """Whether all-in-focus pictures of every recording are rendered, too: its stacks once more, with the aperture of a
    point; for perfect thin lenses and light of one wavelength."""


class SplitSettings(FrozenModel):
    """The sequences of a split: scenes × scene motion × lights × repeats. No two splits share a scene, except for a
    family that gives ``members`` to each, which are scenes of their own.

    ``variants`` is the number of members of each scene's family, which the repeats use in turn. ``scene_motion`` holds
    "static" (everything is at rest), "dynamic" (for scenes in which something moves), or both.
    """

    scenes: tuple[str, ...] = Field(min_length=1)
    """Scenes, each named once and in only one split, unless all its splits have ``members``; ``saf-gen scenes list``
    lists them."""
    lights: tuple[str, ...] = Field(min_length=1)
    """Names from ``lights``, each given once."""
    lights_each: int | None = Field(default=None, ge=1)
    """Number of these lights that each repeat of a scene, or each of its ``members``, draws; by default it has all."""
    repeats: int = Field(default=1, ge=1, le=10_000)
    """Number of recordings of each scene under each light."""
    variants: int = Field(default=1, ge=1, le=10_000)
    """Number of members of each scene's family, which the repeats use in turn; at most the number of repeats."""
    scene_motion: tuple[Literal["static", "dynamic"], ...] = Field(default=("static",), min_length=1)
    """Whether a moving scene is recorded at rest, moving, or both."""
    at_rest: tuple[str, ...] = ()
    """Moving scenes of the split that are recorded only at rest, such as those with many time slices."""
    members: int | None = Field(default=None, ge=1, le=10_000)
    """Number of members that are drawn from each scene's family, in place of ``repeats`` and ``variants``. Each counts
    as a scene of its own in results, and has a lens motion of its own."""
    positions: int | None = Field(default=None, ge=2, le=4096)
    """``focus.positions`` of this split, such as more of them for longer travels."""
    scene_params: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Values or ranges of a scene's parameters in this split, which replace those of the recipe and of the card."""

    @model_serializer(mode="wrap")
    def _leave_out_what_is_not_stated(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out later keys if they are not given: recipes keep the text and fingerprint from before these keys."""
        later = ("lights_each", "members", "positions", "scene_params")
        return {key: value for key, value in serialize(self).items() if key not in later or value not in (None, {})}

    @property
    def recordings(self) -> int:
        """Number of recordings of a scene's family under a light that none leaves out."""
        return self.members or self.repeats

    @field_validator("scenes", "lights", "scene_motion", "at_rest")
    @classmethod
    def _check_no_repeats(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(value)) != len(value):
            raise ValueError("each name once; repeats makes more sequences of each")
        return value

    @model_validator(mode="after")
    def _check_variants(self) -> "SplitSettings":
        if self.variants > self.repeats:
            raise ValueError(f"at most as many variants as repeats, which are {self.repeats}")
        return self

    @model_validator(mode="after")
    def _check_draws(self) -> "SplitSettings":
        if self.members is not None and (self.repeats, self.variants) != (1, 1):
            raise ValueError("either members, or repeats and variants")
        if self.lights_each is not None and self.lights_each > len(self.lights):
            raise ValueError(f"at most as many lights_each as lights, which are {len(self.lights)}")
        return self

    @model_validator(mode="after")
    def _check_at_rest(self) -> "SplitSettings":
        if self.at_rest and "static" not in self.scene_motion:
            raise ValueError("scene_motion: [static, dynamic] if scenes are at_rest")
        return self


def _check_schedule(value: Any) -> Any:
    if not isinstance(value, dict | list):
        raise ValueError(f"a light schedule in braces, such as {{kind: {value or 'constant'}}}, or a list of them")
    return value


class Recipe(FrozenModel):
    """A complete dataset; ``scene_params`` replaces parameters, or their ranges, on the cards of scenes."""

    name: str = Field(pattern=NAME_PATTERN)
    """Name of the dataset: lower-case letters, digits, ``-``, ``_``."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)]
    """Seed of every random number of the dataset."""
    camera: CameraSettings
    focus: FocusSettings
    render: RenderSettings
    lights: dict[str, Annotated[dict[str, Any] | list[Any], BeforeValidator(_check_schedule)]] = Field(min_length=1)
    """Light schedules by name, each ``{kind: …}`` for all light groups, or one for each light group by its name or its
    role; a list of schedules adds up, ``{product: […]}`` multiplies them."""
    splits: dict[str, SplitSettings] = Field(min_length=1)
    """Sequences of each split, by the name of the split."""
    scene_params: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Values or ranges of a scene's parameters, which replace those on its card."""
    truth: TruthSettings = TruthSettings()
    """What is made of the truth beside what every stream holds: the true focus, the depth and the target."""

    @model_serializer(mode="wrap")
    def _leave_out_what_is_not_stated(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out ``truth`` if it asks for nothing: recipes keep the text and fingerprint from before this key."""
        return {key: value for key, value in serialize(self).items() if key != "truth" or self.truth != TruthSettings()}


def read_recipe(path: str | Path) -> Recipe:
    """Read and check a recipe, and the files that its lights and its lens motion name.

    Raises BadInput, with file and line, for the first entry that is wrong.
    """
    document = read_yaml(path)
    recipe = validate_document(Recipe, document)
    lights = {}
    for name, schedule in recipe.lights.items():
        _check_name("light", name, where=document.locate("lights", name))
        lights[name] = read_schedule(schedule, document, keys=("lights", name))
    motion = components.read_component("motions", recipe.focus.motion, document=document, keys=("focus", "motion"))
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
            if scene in owners and not (split.members and recipe.splits[owners[scene]].members):
                raise BadInput(
                    f"scene {scene!r} is in {owners[scene]} and in {split_name}",
                    where=where,
                    allowed="each scene in one split, once, so that nothing leaks from train to test",
                    hint="remove it from one of them; or give both splits members of the family, if it is one",
                )
            owners[scene] = split_name
    for scene in recipe.render.per_scene:
        if scene not in owners:
            where = document.locate("render", "per_scene", scene)
            raise unknown("scene of render.per_scene", scene, allowed=owners, where=where)
    _check_scene_params(recipe.scene_params, document, scenes=owners, keys=("scene_params",))
    for name, split in recipe.splits.items():
        _check_scene_params(split.scene_params, document, scenes=split.scenes, keys=("splits", name, "scene_params"))
    return recipe


def _check_scene_params(
    chosen: Mapping[str, Mapping[str, Any]], document: Document, *, scenes: Iterable[str], keys: tuple[str, ...]
) -> None:
    """Raise BadInput if ``scene_params`` at these keys name another scene, or state what is no value and no range."""
    what = ".".join(keys)
    for scene, params in chosen.items():
        if scene not in scenes:
            raise unknown(f"scene of {what}", scene, allowed=scenes, where=document.locate(*keys, scene))
        for key, value in params.items():
            check_parameter(value, what=f"{what}.{scene}.{key}", where=document.locate(*keys, scene, key))


def _check_name(what: str, name: str, *, where: str) -> None:
    if not name.replace("_", "").replace("-", "").isalnum() or name != name.lower():
        raise BadInput(
            f"{what} {name!r} cannot be part of a file name", where=where, allowed="lower-case letters, digits, - and _"
        )


def recipe_schema() -> Schema:
    """Return the JSON Schema (draft 2020-12) of a recipe, with every registered light schedule and lens motion."""
    schema = model_schema(Recipe, "saf_gen recipe")
    schema["properties"]["lights"]["additionalProperties"] = define_lights(schema)
    for owner in (schema, schema["$defs"]["SplitSettings"]):
        params = {"type": "object", "additionalProperties": PARAMETER}
        owner["properties"]["scene_params"]["additionalProperties"] = params
    exposure, motions = schema["$defs"]["ExposureSettings"]["properties"], define_schema(schema, "motions")
    focus = schema["$defs"]["FocusSettings"]["properties"]
    focus["motion"] = {**motions, "description": focus["motion"]["description"]}
    rate = {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}
    exposure["mean_rate"]["anyOf"] = [rate, OPEN, {"type": "null"}]
    exposure["spikes_per_depth"]["anyOf"] = [{"type": "number", "exclusiveMinimum": 0}, OPEN, {"type": "null"}]
    return schema


def recipe_names() -> list[str]:
    """Return the names of the recipes that come with saf_gen, sorted."""
    return sorted(path.stem for path in shipped_folder("recipes").glob("*.yaml"))


def find_recipe(recipe: str | Path) -> Path:
    """Return the file of a recipe, given by its name if it comes with saf_gen, and otherwise by its path.

    A file in the working directory must be given as a path, such as "./mine", so that a name means the same everywhere.
    Raises BadInput for an unknown name or a folder; a path is returned unchanged.
    """
    name = str(recipe)
    if Path(name).is_dir() and name not in recipe_names():
        inside = sorted(str(path) for path in Path(name).glob("*.y*ml"))
        raise BadInput(f"{name} is a folder", allowed=some_of(inside) or "a recipe file; there is none in it")
    if Path(name).suffix or Path(name).name != name:
        return Path(recipe)
    if name not in recipe_names():
        raise unknown("recipe", name, allowed=recipe_names(), hint="or the path of a recipe file, such as ./mine.yaml")
    return shipped_folder("recipes") / f"{name}.yaml"
