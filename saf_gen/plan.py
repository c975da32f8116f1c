"""From a recipe to its sequences: every open number drawn, every random stream named."""

import hashlib
import json
from dataclasses import dataclass
from typing import Any

from saf_gen import seeds
from saf_gen.ranges import draw
from saf_gen.recipe import Recipe, by_group

__all__ = ["Sequence", "make_plan", "recipe_fingerprint", "shard"]


@dataclass(frozen=True)
class Sequence:
    """One recording to make.

    ``schedule`` maps a light group ('' stands for all) to its part, ``{kind: ..., ...}``, numbers drawn.
    ``seed`` names the random streams of this recording alone.
    """

    id: str
    split: str
    scene: str
    light: str
    repeat: int
    seed: int
    schedule: dict[str, dict[str, Any]]
    mean_rate: float | None

    @property
    def file(self) -> str:
        """Path within the dataset."""
        return f"{self.split}/{self.id}.h5"


def make_plan(recipe: Recipe) -> list[Sequence]:
    """The recipe's sequences in the order of splits, scenes, lights, repeats."""
    sequences = []
    for split_name, split in recipe.splits.items():
        for scene in split.scenes:
            for light in split.lights:
                for repeat in range(split.repeats):
                    sequences.append(_sequence(recipe, split_name, scene, light, repeat))
    return sequences


def _sequence(recipe: Recipe, split: str, scene: str, light: str, repeat: int) -> Sequence:
    name = f"{scene}-{light}-{repeat:02d}"

    def drawn(value: Any, *key: str) -> Any:
        return draw(value, seeds.generator(recipe.seed, split, name, "recipe", *key))

    return Sequence(
        id=name,
        split=split,
        scene=scene,
        light=light,
        repeat=repeat,
        seed=seeds.integer(recipe.seed, split, name, "camera"),
        schedule={
            group: {key: drawn(value, "lights", group, key) for key, value in part.items()}
            for group, part in by_group(recipe.lights[light]).items()
        },
        mean_rate=drawn(recipe.camera.exposure.mean_rate, "mean_rate"),
    )


def recipe_fingerprint(recipe: Recipe) -> str:
    """SHA-256 of what the recipe says, whatever its order of keys, comments or file name."""
    return hashlib.sha256(json.dumps(recipe.model_dump(mode="json"), sort_keys=True).encode()).hexdigest()


def shard(sequences: list[Sequence], index: int, count: int) -> list[Sequence]:
    """The sequences that shard ``index`` of ``count`` (1-based) makes: every count-th one."""
    return sequences[index - 1 :: count]
