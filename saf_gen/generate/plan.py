"""The planned sequences of a recipe, with every open number drawn and every random stream named."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any

from saf_gen.core import seeds
from saf_gen.core.config import components
from saf_gen.core.config.ranges import draw_range, is_number, is_range, range_extremes
from saf_gen.errors import BadInput, closest, unknown
from saf_gen.generate.recipe import Recipe
from saf_gen.plugins.lights import draw_schedule


@dataclass(frozen=True)
class SceneFamily:
    """The facts about a scene that a plan needs, from its card.

    Attributes
    ----------
    params : mapping
        Parameters of the scene, with their values or ranges.
    moves : bool
        Whether anything in the scene moves.
    illuminance_lux : mapping of str to float
        Illuminance of the target at gain 1, by light group.
    """

    params: Mapping[str, Any] = field(default_factory=dict)
    moves: bool = False
    illuminance_lux: Mapping[str, float] = field(default_factory=dict)


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
        Light schedule, ``{kind: ..., ...}``, by light group; '' means all groups.
    motion : dict
        Lens motion, ``{kind: ..., ...}``.
    mean_rate : float or None
        Spikes per readout of the target at best focus and gain 1; None for the absolute exposure.
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
    schedule: dict[str, dict[str, Any]]
    motion: dict[str, Any]
    mean_rate: float | None

    def as_dict(self) -> dict[str, Any]:
        """Return the sequence as plain data under the keys that files use, in which ``member`` is "variant"."""
        return {"variant" if key == "member" else key: value for key, value in asdict(self).items()}

    @property
    def file(self) -> str:
        """Path of the stream file within the dataset."""
        return f"{self.split}/{self.id}.h5"

    @property
    def label(self) -> str:
        """Name of the captured scene in messages: its name, the member, and whether it moves."""
        member = f"{self.scene} (member {self.member})" if self.params else self.scene
        return f"{member}, {self.scene_motion}" if self.scene_motion == "dynamic" else member


def plan_sequences(recipe: Recipe, families: Mapping[str, SceneFamily] | None = None) -> list[PlannedSequence]:
    """Return the sequences of a recipe, in the order of splits, scenes, static and dynamic, lights, repeats.

    ``families`` holds the scene families by scene; a scene that it lacks has no parameters, no motion and no
    illuminance.

    Raises BadInput if the recipe sets a parameter that a scene does not have, or a value that its card does not allow,
    if a split asks for motion but nothing moves, or if two sequences would have the same id.
    """
    families = families or {}
    sequences = []
    for split_name, split in recipe.splits.items():
        moving = [s for s in split.scenes if s not in split.at_rest and families.get(s, SceneFamily()).moves]
        if "dynamic" in split.scene_motion and not moving:
            raise BadInput(
                f"split {split_name!r} asks for dynamic, but nothing moves in {', '.join(split.scenes)}",
                allowed="scene_motion: [static]",
                hint="or add a scene whose card has motion; see: saf-gen scenes list",
            )
        for scene in split.scenes:
            motions = [m for m in split.scene_motion if m == "static" or scene in moving]
            for motion, light, repeat in product(motions, split.lights, range(split.repeats)):
                family = families.get(scene, SceneFamily())
                sequences.append(
                    _plan_sequence(
                        recipe, split_name, scene=scene, family=family, scene_motion=motion, light=light, repeat=repeat
                    )
                )
    _check_ids(sequences)
    return sequences


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


def _plan_sequence(
    recipe: Recipe, split: str, *, scene: str, family: SceneFamily, scene_motion: str, light: str, repeat: int
) -> PlannedSequence:
    name = "-".join([scene, *(["dynamic"] if scene_motion == "dynamic" else []), light, f"{repeat:02d}"])
    stream = (recipe.seed, split, name)
    # All lights have the same lens motion, so that they can be compared and share the stacks of a moving scene.
    under_any_light = (recipe.seed, split, "-".join([scene, scene_motion, f"{repeat:02d}"]))
    member = repeat % recipe.splits[split].variants
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
        schedule=draw_schedule(recipe.lights[light], stream, illuminance_lux=family.illuminance_lux),
        motion=components.draw_component("motions", recipe.focus.motion, name=under_any_light, purpose=("motion",)),
        mean_rate=draw_range(recipe.camera.exposure.mean_rate, seeds.make_generator(*stream, "recipe", "mean_rate")),
    )


def _draw_params(recipe: Recipe, split: str, *, scene: str, family: SceneFamily, member: int) -> dict[str, Any]:
    """Return the parameters of one member of a scene's family, which are the same under every light."""
    chosen = recipe.scene_params.get(scene, {})
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
                    allowed=f"{', '.join(known)}, as on the scene's card, or a choice among them",
                    nearest=closest(text, known).strip('"'),
                )
    elif is_range(card) or is_number(card):
        for one in range_extremes(value):
            if not is_number(one):
                raise BadInput(f"{what} is {one!r}", allowed="a number, as on the scene's card, or a range")


def recipe_fingerprint(recipe: Recipe) -> str:
    """Return the SHA-256 of the values of a recipe, regardless of comments, file name and the order of keys."""
    values = recipe.model_dump(mode="json")
    for split in values["splits"].values():
        if not split["at_rest"]:
            del split["at_rest"]  # recipes without this key keep their fingerprint from before it existed
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
