"""From a recipe to its planned sequences: every open number drawn, every random stream named."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any

from saf_gen.core import seeds
from saf_gen.core.config import components
from saf_gen.core.config.ranges import config_range_extremes, draw_config_range, is_config_range, is_number
from saf_gen.errors import BadInput, closest, unknown
from saf_gen.generate.recipe import Recipe
from saf_gen.plugins.lights import draw_light_schedule


@dataclass(frozen=True)
class SceneFamily:
    """What a plan must know of a scene, from its card.

    ``params`` are its parameters and their ranges, ``moves`` tells whether anything in it moves, and
    ``illuminance_lux`` is the target's illuminance at gain 1 by light group.
    """

    params: Mapping[str, Any] = field(default_factory=dict)
    moves: bool = False
    illuminance_lux: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class PlannedSequence:
    """One recording to make, with all numbers drawn.

    Parameters
    ----------
    id : name within the dataset.
    split, scene, light : names, as in the recipe.
    member : number of the member of the scene's family within the split, from 0.
    params : that member's parameters.
    scene_motion : "static" or "dynamic".
    repeat : number of the repeat, from 0.
    seed : names the random streams of this recording alone.
    schedule : ``{kind: ..., ...}`` by light group; '' stands for all groups.
    motion : ``{kind: ..., ...}`` of the lens.
    mean_rate : spikes per readout of the target at best focus and gain 1; None for the absolute exposure.
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
        """Return the sequence as plain data under the keys of files, where ``member`` is "variant"."""
        return {"variant" if key == "member" else key: value for key, value in asdict(self).items()}

    @property
    def file(self) -> str:
        """Path within the dataset."""
        return f"{self.split}/{self.id}.h5"

    @property
    def label(self) -> str:
        """What people call the captured scene: its name, the member, and whether it moves."""
        member = f"{self.scene} {self.member}" if self.params else self.scene
        return f"{member}, {self.scene_motion}" if self.scene_motion == "dynamic" else member


def make_recipe_plan(recipe: Recipe, families: Mapping[str, SceneFamily] | None = None) -> list[PlannedSequence]:
    """Return the recipe's sequences in the order of splits, scenes, static and dynamic, lights, repeats.

    ``families`` are by scene; a scene without one has no parameters, does not move, and has no illuminance.

    Raises BadInput for a parameter that a scene does not have or that does not fit its card, for motion where
    nothing moves, and where two sequences would have one id.
    """
    families = families or {}
    sequences = []
    for split_name, split in recipe.splits.items():
        moving = [s for s in split.scenes if s not in split.at_rest and families.get(s, SceneFamily()).moves]
        if "dynamic" in split.scene_motion and not moving:
            raise BadInput(
                f"split {split_name!r} asks for dynamic, and nothing moves in {', '.join(split.scenes)}",
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
    """Raise BadInput for an id that stands twice: a manifest that lists it cannot be read again."""
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
    # One lens motion for all lights, so that they compare and share the stacks of a moving scene.
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
        schedule=draw_light_schedule(recipe.lights[light], stream, illuminance_lux=family.illuminance_lux),
        motion=components.draw_config_component(
            "motions", recipe.focus.motion, name=under_any_light, purpose=("motion",)
        ),
        mean_rate=draw_config_range(
            recipe.camera.exposure.mean_rate, seeds.make_generator(*stream, "recipe", "mean_rate")
        ),
    )


def _draw_params(recipe: Recipe, split: str, *, scene: str, family: SceneFamily, member: int) -> dict[str, Any]:
    """Return the parameters of one member of a scene's family: the same under every light."""
    chosen = recipe.scene_params.get(scene, {})
    for key in chosen:
        if key not in family.params:
            raise unknown(f"parameter of scene {scene!r}:", key, allowed=family.params)
        _check_fits(chosen[key], family.params[key], what=f"scene_params.{scene}.{key}")
    return {
        key: draw_config_range(value, seeds.make_generator(recipe.seed, split, scene, member, "param", key))
        for key, value in {**family.params, **chosen}.items()
    }


def _check_fits(value: Any, card: Any, *, what: str) -> None:
    """Raise BadInput where a recipe's value, or one end of its range, does not fit the card's.

    A choice on the card lists all values: a scene would build another one as one of these, or fail. A number
    may lie outside the card's range, which is only what the author draws from and has checked; the scene's
    own ``build`` refuses what it cannot build.
    """
    if is_config_range(card) and "choice" in card:
        # Compared as text: to a script true is not 1, and 3.0 is not a count.
        known = [json.dumps(one, ensure_ascii=False) for one in card["choice"]]
        between = is_config_range(value) and "choice" not in value
        for one in config_range_extremes(value):
            text = json.dumps(one, ensure_ascii=False)
            if between or text not in known:
                raise BadInput(
                    f"{what} is {value!r}",
                    allowed=f"{', '.join(known)}, as on the scene's card, or a choice among them",
                    nearest=closest(text, known).strip('"'),
                )
    elif is_config_range(card) or is_number(card):
        for one in config_range_extremes(value):
            if not is_number(one):
                raise BadInput(f"{what} is {one!r}", allowed="a number, as on the scene's card, or a range")


def recipe_fingerprint(recipe: Recipe) -> str:
    """Return the SHA-256 of a recipe's values; its order of keys, comments and file name do not enter."""
    values = recipe.model_dump(mode="json")
    for split in values["splits"].values():
        if not split["at_rest"]:
            del split["at_rest"]  # a recipe without it has the fingerprint that it had before there was such a key
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
