"""A recipe: what to make, as one frozen value read from a YAML file.

Nothing here renders, opens a scene or draws a number; :mod:`saf_gen.plan` turns a recipe into sequences.
"""

from itertools import product
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from saf_gen import registry
from saf_gen.documents import Document, Frozen, read_as
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.ranges import ends

__all__ = ["Camera", "Exposure", "Focus", "Motion", "Noise", "Recipe", "Render", "Split", "read_recipe"]

NAME = r"^[a-z0-9][a-z0-9_-]*$"


class Exposure(Frozen):
    """How much light reaches the sensor.

    Either ``mean_rate``: the scene is scaled so that the target fires this often (spikes a readout) at its
    best focus and gain 1; or ``absolute``: the scene's own radiances through the lens, in electrons.
    ``f_number`` replaces the lens's own.
    """

    mean_rate: float | dict[str, Any] | None = None
    absolute: bool = False
    f_number: float | None = Field(default=None, gt=0.5, le=64)

    @model_validator(mode="after")
    def _one_of_two(self) -> "Exposure":
        if (self.mean_rate is None) is not self.absolute:
            raise ValueError("either mean_rate: a number above 0 and below 1, or absolute: true")
        for value in ends(self.mean_rate) if self.mean_rate is not None else ():
            if not (isinstance(value, int | float) and 0 < value < 1):
                raise ValueError("a mean_rate above 0 and below 1 spikes a readout")
        return self


class Noise(Frozen):
    """Which of the sensor's imperfections act; what is not named stays as the sensor has it."""

    shot: bool | None = None
    dark: bool | None = None
    response: bool | None = None
    threshold_spread: bool | None = None
    threshold_noise: bool | None = None


class Camera(Frozen):
    """The spike camera: which sensor, how long it records, how bright the scene is."""

    sensor: str
    frames: int = Field(ge=16, le=10_000_000)
    exposure: Exposure
    noise: Noise = Noise()
    reset: Literal["subtract", "hard"] | None = None
    saturation: Literal["subtract", "dead_readout"] | None = None


class Motion(Frozen):
    """How the lens moves over the recording: a ``sweep`` passes the whole travel once at constant speed."""

    kind: Literal["sweep"] = "sweep"


class Focus(Frozen):
    """The lens drive and the focus positions to render, evenly spaced over its travel."""

    drive: Literal["image_distance"] = "image_distance"
    positions: int = Field(ge=2, le=4096)
    motion: Motion = Motion()


class Render(Frozen):
    """Monte Carlo samples a pixel at each focus position, and the longest light path in segments."""

    samples: int = Field(ge=1, le=65_536)
    max_depth: int = Field(default=6, ge=2, le=64)


class Split(Frozen):
    """Scenes × lights × repeats; a split owns its scenes: no other split may use them."""

    scenes: tuple[str, ...] = Field(min_length=1)
    lights: tuple[str, ...] = Field(min_length=1)
    repeats: int = Field(default=1, ge=1, le=10_000)


class Recipe(Frozen):
    """A whole dataset, from lens to splits."""

    name: str = Field(pattern=NAME)
    seed: int = Field(ge=0, le=2**63 - 1)
    camera: Camera
    focus: Focus
    render: Render
    lights: dict[str, dict[str, Any]] = Field(min_length=1)
    splits: dict[str, Split] = Field(min_length=1)


def read_recipe(path: str | Path) -> Recipe:
    """Read and check a recipe; raises BadInput with file and line where something does not fit."""
    recipe, document = read_as(Recipe, path)
    for name, schedule in recipe.lights.items():
        _check_name("light", name, document, ("lights", name))
        for group, part in by_group(schedule, document.where("lights", name)).items():
            keys = ("lights", name) if group == "" else ("lights", name, group)
            _check_light(part, document, keys)
    owners: dict[str, str] = {}
    for split_name, split in recipe.splits.items():
        _check_name("split", split_name, document, ("splits", split_name))
        for i, light in enumerate(split.lights):
            if light not in recipe.lights:
                raise unknown(
                    "light", light, recipe.lights, where=document.where("splits", split_name, "lights", i)
                )
        for i, scene in enumerate(split.scenes):
            where = document.where("splits", split_name, "scenes", i)
            if scene in owners:
                raise BadInput(
                    f"scene {scene!r} stands in {owners[scene]} and in {split_name}",
                    where=where,
                    allowed="each scene in one split, once, so that nothing leaks from train to test",
                    hint="remove it from one of them",
                )
            owners[scene] = split_name
    return recipe


def by_group(schedule: dict[str, Any], where: str = "") -> dict[str, dict[str, Any]]:
    """A light schedule as {light group: part}; the key '' stands for all groups at once."""
    if "kind" in schedule:
        return {"": schedule}
    for group, part in schedule.items():
        if not isinstance(part, dict) or "kind" not in part:
            raise BadInput(
                f"light group {group!r} has no kind",
                where=where,
                allowed="{kind: ..., ...}, or such a mapping for each light group",
                hint=f"kinds: {', '.join(registry.names('lights'))}",
            )
    return schedule


def _check_name(what: str, name: str, document: Document, keys: tuple[str, ...]) -> None:
    if not name.replace("_", "").replace("-", "").isalnum() or name != name.lower():
        raise BadInput(
            f"{what} {name!r} cannot be part of a file name",
            where=document.where(*keys),
            allowed="lower-case letters, digits, - and _",
        )


def _check_light(part: dict[str, Any], document: Document, keys: tuple[str, ...]) -> None:
    """Build the part at every corner of its ranges, so that no draw can fail hours later."""
    kind, options = part["kind"], {k: v for k, v in part.items() if k != "kind"}
    if kind not in registry.names("lights"):
        raise unknown("light kind", kind, registry.names("lights"), where=document.where(*keys, "kind"))
    known = registry.keys("lights", kind)
    for key in options:
        if key not in known:
            raise unknown(f"key of light {kind!r}:", key, known, where=document.where(*keys, key))
    corners = [ends(v, where=document.where(*keys, k)) for k, v in options.items()]
    for values in product(*corners):
        try:
            registry.build("lights", kind, **dict(zip(options, values, strict=True)))
        except SafGenError as error:
            raise BadInput(str(error), where=document.where(*keys)) from error
