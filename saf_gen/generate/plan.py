"""From a recipe to its sequences: every open number drawn, every random stream named."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from saf_gen.core import seeds
from saf_gen.core.config import components
from saf_gen.core.config.ranges import draw_value, extreme_values, is_number, is_range
from saf_gen.errors import BadInput, closest, unknown
from saf_gen.generate.recipe import Recipe
from saf_gen.lights import _schedule

__all__ = ["PlannedSequence", "SceneFamily", "make_plan", "recipe_fingerprint", "select_shard"]


@dataclass(frozen=True)
class SceneFamily:
    """What a plan must know of a scene: its open parameters, whether anything in it moves, its light."""

    params: Mapping[str, Any] = field(default_factory=dict)
    moves: bool = False
    illuminance_lux: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class PlannedSequence:
    """One recording to make.

    ``variant`` counts the members of the scene's family within the split, ``params`` are that member's.
    ``scene_motion`` is ``static`` or ``dynamic``.
    ``schedule`` maps a light group ('' stands for all) to its part, ``{kind: ..., ...}``, numbers drawn.
    ``motion`` is that of the lens, written alike. ``seed`` names the random streams of this recording alone.
    """

    id: str
    split: str
    scene: str
    variant: int
    params: dict[str, Any]
    scene_motion: str
    light: str
    repeat: int
    seed: int
    schedule: dict[str, dict[str, Any]]
    motion: dict[str, Any]
    mean_rate: float | None

    @property
    def file(self) -> str:
        """Path within the dataset."""
        return f"{self.split}/{self.id}.h5"

    @property
    def label(self) -> str:
        """Which scene is filmed: the scene, its member, and whether it moves."""
        member = f"{self.scene} {self.variant}" if self.params else self.scene
        return f"{member}, {self.scene_motion}" if self.scene_motion == "dynamic" else member


def make_plan(recipe: Recipe, families: Mapping[str, SceneFamily] | None = None) -> list[PlannedSequence]:
    """The recipe's sequences in the order of splits, scenes, static and dynamic, lights, repeats.

    ``families``: by scene; what is not there has no parameters, does not move, and knows no lux.

    Raises BadInput for a parameter that a scene does not have or that does not fit its card, for motion where
    nothing moves, and where two sequences would have one name.
    """
    families = families or {}
    sequences = []
    for split_name, split in recipe.splits.items():
        moving = [scene for scene in split.scenes if families.get(scene, SceneFamily()).moves]
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
                sequences.append(_sequence(recipe, split_name, scene, family, motion, light, repeat))
    _check_ids(sequences)
    return sequences


def _check_ids(sequences: list[PlannedSequence]) -> None:
    """No id twice: a manifest that lists one so cannot be read again."""
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


def _sequence(
    recipe: Recipe, split: str, scene: str, family: SceneFamily, scene_motion: str, light: str, repeat: int
) -> PlannedSequence:
    words = [scene, *(["dynamic"] if scene_motion == "dynamic" else []), light, f"{repeat:02d}"]
    name = "-".join(words)
    stream = (recipe.seed, split, name)
    # The lens moves alike under every light: one film of a moving scene serves them all, and lights compare.
    filmed = (recipe.seed, split, "-".join([scene, scene_motion, f"{repeat:02d}"]))
    variant = repeat % recipe.splits[split].variants
    return PlannedSequence(
        id=name,
        split=split,
        scene=scene,
        variant=variant,
        params=_params(recipe, split, scene, family, variant),
        scene_motion=scene_motion,
        light=light,
        repeat=repeat,
        seed=seeds.derive_seed(*stream, "camera"),
        schedule=_schedule.draw_schedule(recipe.lights[light], stream, family.illuminance_lux),
        motion=components.draw_component("motions", recipe.focus.motion, filmed, ("motion",)),
        mean_rate=draw_value(
            recipe.camera.exposure.mean_rate, seeds.make_generator(*stream, "recipe", "mean_rate")
        ),
    )


def _params(recipe: Recipe, split: str, scene: str, family: SceneFamily, variant: int) -> dict[str, Any]:
    """The parameters of one member of a scene's family: the same under every light."""
    chosen = recipe.scene_params.get(scene, {})
    for key in chosen:
        if key not in family.params:
            raise unknown(f"parameter of scene {scene!r}:", key, family.params)
        _check_fits(f"scene_params.{scene}.{key}", chosen[key], family.params[key])
    return {
        key: draw_value(value, seeds.make_generator(recipe.seed, split, scene, variant, "param", key))
        for key, value in {**family.params, **chosen}.items()
    }


def _check_fits(what: str, value: Any, card: Any) -> None:
    """Raise BadInput where a recipe's value, or one end of its range, is none that the card's could be.

    A choice on the card lists all there is: anything else would be built as one of its values, or fail. A
    number may lie outside the card's range: that is what the author draws from and has checked, no bound, and
    what cannot be built the scene's own ``build`` refuses.
    """
    if is_range(card) and "choice" in card:
        # As text, since true is no 1 to a script, and 3.0 is no count.
        known = [json.dumps(one, ensure_ascii=False) for one in card["choice"]]
        between = is_range(value) and "choice" not in value
        for one in extreme_values(value):
            text = json.dumps(one, ensure_ascii=False)
            if between or text not in known:
                raise BadInput(
                    f"{what} is {value!r}",
                    allowed=f"{', '.join(known)}, as on the scene's card, or a choice among them",
                    nearest=closest(text, known).strip('"'),
                )
    elif is_range(card) or is_number(card):
        for one in extreme_values(value):
            if not is_number(one):
                raise BadInput(f"{what} is {one!r}", allowed="a number, as on the scene's card, or a range")


def recipe_fingerprint(recipe: Recipe) -> str:
    """SHA-256 of what the recipe says, whatever its order of keys, comments or file name."""
    return hashlib.sha256(json.dumps(recipe.model_dump(mode="json"), sort_keys=True).encode()).hexdigest()


def select_shard(sequences: list[PlannedSequence], index: int, count: int) -> list[PlannedSequence]:
    """The sequences that shard ``index`` of ``count`` (1-based) makes: every count-th one."""
    return sequences[index - 1 :: count]
