"""The draw of a recipe: its sequences in all splits, each with every number drawn and a name of its own."""

import json
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any

import numpy as np

from saf_gen.core import seeds
from saf_gen.core.config import components
from saf_gen.core.config.ranges import draw_range, is_number, is_range, range_extremes
from saf_gen.errors import BadInput, closest, located, some_of, unknown
from saf_gen.generate.recipe import Recipe
from saf_gen.optics.actuators import Actuator
from saf_gen.optics.actuators.actuated_lens import follow_commands
from saf_gen.plugins.lights import Schedule, draw_schedule, list_lamps
from saf_gen.plugins.motions import POSITION_GRID, lens_positions


@dataclass(frozen=True)
class SceneFamily:
    """The facts about a scene from which sequences are drawn, from its card.

    Attributes
    ----------
    params : mapping
        Parameters of the scene, with their values or ranges.
    moves : bool
        Whether anything in the scene moves.
    illuminance_lux : mapping of str to float
        Illuminance of the target at gain 1, by light group.
    roles : mapping of str to str
        Role of each light group.
    axial_colour : mapping or None
        Axial colour of the lens, as the card states it.
    """

    params: Mapping[str, Any] = field(default_factory=dict)
    moves: bool = False
    illuminance_lux: Mapping[str, float] = field(default_factory=dict)
    roles: Mapping[str, str] = field(default_factory=dict)
    axial_colour: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class PlannedSequence:
    """One recording to make, with all numbers drawn.

    Attributes
    ----------
    id : str
        Name within the dataset.
    split, scene, light : str
        Names, as in the recipe.
    member : int
        Number of the member of the scene's family within the split, from 0.
    params : dict
        Parameters of that member.
    scene_motion : str
        "static" or "dynamic".
    repeat : int
        Number of the repeat, from 0.
    seed : int
        Seed of the random streams of this recording alone.
    schedule : dict
        Light schedule, ``{kind: ..., ...}`` or a list of them, by light group; '' means all groups.
    motion : dict
        Lens motion, ``{kind: ..., ...}``.
    mean_rate : float or None
        Spikes per readout of the target at best focus and gain 1; None for the absolute exposure. As drawn, before the
        lens is known, it may be spikes per depth of focus.
    axial_colour : dict or None
        Axial colour of the lens, if any light has a spectrum.
    actuator : Actuator or None
        What is told the lens motion; None if the lens moves as its motion says.
    actuator_seed : int
        Seed of the actuator, 0 without one.
    is_scene : bool
        Whether the member counts as a scene of its own in results.
    """

    id: str
    split: str
    scene: str
    member: int
    params: dict[str, Any]
    scene_motion: str
    light: str
    repeat: int
    seed: int
    schedule: dict[str, Schedule]
    motion: dict[str, Any]
    mean_rate: float | None
    axial_colour: dict[str, Any] | None = None
    actuator: Actuator | None = None
    actuator_seed: int = 0
    is_scene: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return the sequence as plain data under the keys that files use, in which ``member`` is "variant".

        ``axial_colour`` is left out if there is none, and what results count as a scene. The
        actuator is there with its seed and without its texts, if there is one.
        """
        data = {"variant" if key == "member" else key: value for key, value in asdict(self).items()}
        del data["is_scene"]  # which changes no spike
        if self.axial_colour is None:
            del data["axial_colour"]
        seed, actuator = data.pop("actuator_seed"), data.pop("actuator")
        if actuator is not None:
            del actuator["name"], actuator["sources"]  # texts do not move the lens
            data["actuator"] = {**actuator, "seed": seed}
        return data

    def lens_course(self, frames: int, *, readout_hz: float) -> tuple[np.ndarray, np.ndarray]:
        """Return where the lens is in the middle of each readout, and its log.

        Without an actuator, both are the lens motion. With one, the motion is the command to the actuator, the position
        is what comes of it, and the log is what its position sensor reads: the lens or the motor, as its card says.

        Parameters
        ----------
        frames : int
            Number of readouts.
        readout_hz : float
            Readouts per second.

        Returns
        -------
        position, log : ndarray of float64, shape (frames,)
            Fractions of the travel, which float32 holds exactly; 0 to 1, but noise may put the log a little outside.

        Raises
        ------
        BadInput
            If the motion does not fit the recording, or leaves the travel.
        """
        commands = lens_positions(self.motion, frames, readout_hz=readout_hz)
        if self.actuator is None:
            return commands, commands
        ends = follow_commands(self.actuator, commands, readout_hz=readout_hz, seed=self.actuator_seed)
        position, log = (np.round(end / POSITION_GRID) * POSITION_GRID for end in ends)
        return position, log

    @property
    def file(self) -> str:
        """Path of the stream file within the dataset."""
        return f"{self.split}/{self.id}.h5"

    @property
    def counted_as(self) -> str:
        """Name of the scene in manifests and results: a member that counts as a scene has a name of its own."""
        return _name_member(self.scene, self.split, member=self.member) if self.is_scene else self.scene

    @property
    def label(self) -> str:
        """Name of the captured scene in messages: its name, the member, and whether it moves."""
        member = f"{self.scene} (member {self.member})" if self.params and not self.is_scene else self.counted_as
        return f"{member}, {self.scene_motion}" if self.scene_motion == "dynamic" else member


def draw_sequences(
    recipe: Recipe, families: Mapping[str, SceneFamily] | None = None, *, actuator: Actuator | None = None
) -> list[PlannedSequence]:
    """Return the sequences of a recipe, in the order of splits, scenes, static and dynamic, lights, repeats.

    ``families`` holds the scene families by scene; a scene that it lacks has no parameters, no motion and no
    illuminance. ``actuator`` is the recipe's.

    Raises BadInput if the recipe sets a parameter that a scene does not have, or a value that its card does not allow,
    if a split asks for motion but nothing moves, if two sequences would have the same id, or if the recipe, a split or
    a sequence cannot name files.
    """
    families = defaultdict(SceneFamily, families or {})
    sequences = []
    for split_name, split in recipe.splits.items():
        moving = [s for s in split.scenes if s not in split.at_rest and families[s].moves]
        if "dynamic" in split.scene_motion and not moving:
            raise BadInput(
                f"split {split_name!r} asks for dynamic, but nothing moves in {', '.join(split.scenes)}",
                allowed="scene_motion: [static]",
                hint="or add a scene whose card has motion; see: saf-gen scenes list",
            )
        for scene in split.scenes:
            motions = [m for m in split.scene_motion if m == "static" or scene in moving]
            lights = [_draw_lights(recipe, split_name, scene=scene, repeat=r) for r in range(split.recordings)]
            for motion, light, repeat in product(motions, split.lights, range(split.recordings)):
                if light not in lights[repeat]:
                    continue
                sequences.append(
                    _draw_sequence(
                        recipe,
                        split_name,
                        scene=scene,
                        family=families[scene],
                        scene_motion=motion,
                        light=light,
                        repeat=repeat,
                        actuator=actuator,
                    )
                )
    _check_ids(sequences)
    names = [("recipe", recipe.name), *(("split", split) for split in recipe.splits)]
    for what, name in [*names, *(("sequence", s.id) for s in sequences)]:
        _check_file_name(what, name)
    _check_members(sequences)
    return sequences


def _draw_lights(recipe: Recipe, split: str, *, scene: str, repeat: int) -> tuple[str, ...]:
    """Return the lights under which a repeat of a scene is recorded."""
    names, count = recipe.splits[split].lights, recipe.splits[split].lights_each
    if count is None:
        return names
    random = seeds.make_generator(recipe.seed, split, scene, repeat, "lights")
    return tuple(names[int(n)] for n in random.permutation(len(names))[:count])


def _check_members(sequences: list[PlannedSequence]) -> None:
    """Raise BadInput if two members that count as scenes are the same."""
    met: dict[str, PlannedSequence] = {}
    for s in sequences:
        if s.is_scene:
            one = met.setdefault(json.dumps([s.scene, s.params], sort_keys=True), s)
            if one.counted_as != s.counted_as:
                raise BadInput(
                    f"{s.counted_as} and {one.counted_as} are the same scene",
                    allowed="members of a family with a parameter that is drawn from uniform or log_uniform",
                    hint="use repeats in place of members, or add a seed to params of the scene's card",
                )


def _check_ids(sequences: list[PlannedSequence]) -> None:
    """Raise BadInput if two sequences have the same id, because a manifest that lists both cannot be read again."""
    first: dict[str, PlannedSequence] = {}
    for s in sequences:
        one = first.setdefault(s.id, s)
        if one is not s:
            both = (f"{s.scene}, {s.scene_motion}, under {s.light!r} in {s.split!r}" for s in (one, s))
            raise BadInput(
                f"two sequences would have the id {s.id!r}: {', and '.join(both)}",
                allowed="each id once in a dataset",
                hint=f"rename the light {one.light!r}",
            )


MAX_NAME_BYTES = 150
"""Longest name of a recipe, split or sequence. Files may have 255 bytes; what is being written has up to 100 more."""
RESERVED = {"aux", "con", "nul", "prn", *(f"{port}{n}" for port in ("com", "lpt") for n in "0123456789¹²³")}
"""Names that Windows gives to devices."""


def _check_file_name(what: str, name: str) -> None:
    size = len(name.encode())
    if size > MAX_NAME_BYTES:
        raise BadInput(
            f"the {what} {name!r} cannot name files: it has {size} bytes",
            allowed=f"at most {MAX_NAME_BYTES}",
            hint="shorten the name of the light or the scene" if what == "sequence" else "",
        )
    if name in RESERVED or name.startswith("-"):
        raise BadInput(
            f"the {what} {name!r} cannot name files",
            allowed="names without - at the beginning, except those of devices of Windows (con, aux, com1, …)",
        )


def _name_member(scene: str, split: str, *, member: int) -> str:
    return f"{scene}-{split}-{member:03d}"


def _draw_sequence(
    recipe: Recipe,
    split: str,
    *,
    scene: str,
    family: SceneFamily,
    scene_motion: str,
    light: str,
    repeat: int,
    actuator: Actuator | None,
) -> PlannedSequence:
    settings, exposure = recipe.splits[split], recipe.camera.exposure
    moves = ["dynamic"] if scene_motion == "dynamic" else []
    if settings.members:  # of the same family in several splits
        name = "-".join([_name_member(scene, split, member=repeat), *moves, light])
    else:
        name = "-".join([scene, *moves, light, f"{repeat:02d}"])
    stream = (recipe.seed, split, name)
    # All lights have the same lens motion, so that they can be compared and share the stacks of a moving scene.
    under_any_light = (recipe.seed, split, "-".join([scene, scene_motion, f"{repeat:02d}"]))
    member = repeat if settings.members else repeat % settings.variants
    with located("", prefix=f"light {light!r} on {scene}: "):
        schedule = draw_schedule(
            recipe.lights[light], stream, illuminance_lux=family.illuminance_lux, roles=family.roles
        )
    coloured = any(lamp.spectrum for lamp in list_lamps(schedule, tuple(schedule)))
    return PlannedSequence(
        id=name,
        split=split,
        scene=scene,
        member=member,
        params=_draw_params(recipe, split, scene=scene, family=family, member=member),
        scene_motion=scene_motion,
        light=light,
        repeat=repeat,
        seed=seeds.derive_seed(*stream, "camera"),
        schedule=schedule,
        motion=components.draw_component("motions", recipe.focus.motion, name=under_any_light, purpose=("motion",)),
        mean_rate=draw_range(
            exposure.spikes_per_depth if exposure.mean_rate is None else exposure.mean_rate,
            seeds.make_generator(*stream, "recipe", "mean_rate"),
        ),
        axial_colour=dict(family.axial_colour) if coloured and family.axial_colour else None,
        actuator=actuator,
        actuator_seed=0 if actuator is None else seeds.derive_seed(*under_any_light, "actuator"),
        is_scene=settings.members is not None,
    )


def _draw_params(recipe: Recipe, split: str, *, scene: str, family: SceneFamily, member: int) -> dict[str, Any]:
    """Return the parameters of one member of a scene's family, which are the same under every light."""
    chosen = {**recipe.scene_params.get(scene, {}), **recipe.splits[split].scene_params.get(scene, {})}
    for key in chosen:
        if key not in family.params:
            raise unknown(f"parameter of scene {scene!r}:", key, allowed=family.params)
        _check_fits(chosen[key], family.params[key], what=f"scene_params.{scene}.{key}")
    return {
        key: draw_range(value, seeds.make_generator(recipe.seed, split, scene, member, "param", key))
        for key, value in {**family.params, **chosen}.items()
    }


def _check_fits(value: Any, card: Any, *, what: str) -> None:
    """Raise BadInput if a recipe's value, or one end of its range, does not fit the value on the scene card.

    A choice on the card lists all allowed values; with another value, the scene would fail to build, or be the same as
    with one of these. A number may be outside the range on the card, which the author merely draws from and has
    checked; the scene's ``build`` refuses numbers that it cannot build.
    """
    if is_range(card) and "choice" in card:
        # Values are compared as text, because Python takes true for 1 and 3.0 for 3, but a scene's script may not.
        known = [json.dumps(one, ensure_ascii=False) for one in card["choice"]]
        between = is_range(value) and "choice" not in value
        for one in range_extremes(value):
            text = json.dumps(one, ensure_ascii=False)
            if between or text not in known:
                raise BadInput(
                    f"{what} is {value!r}",
                    allowed=f"{some_of(known, text)}, as on the scene's card, or a choice among them",
                    nearest=closest(text, known).strip('"'),
                )
    elif is_range(card) or is_number(card):
        for one in range_extremes(value):
            if not is_number(one):
                raise BadInput(f"{what} is {one!r}", allowed="a number, as on the scene's card, or a range")
