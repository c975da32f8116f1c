"""A recipe with everything found and checked: its scenes, their stacks, the sensor, the sequences to make.

What stands here decides; :mod:`saf_gen.generate` does it.
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from saf_gen.camera import Sensor, get_sensor
from saf_gen.errors import BadInput
from saf_gen.focal_stack import StackSpec, StackStore
from saf_gen.plan import Sequence, make_plan, shard
from saf_gen.recipe import Recipe, read_recipe
from saf_gen.record import MODEL, group_gains
from saf_gen.scene import Scene, find_scene

__all__ = ["Work", "fingerprint", "prepare", "stack_digests"]

STACK_BYTES, STREAM_BITS = 4, 0.4  # a value of a stack; a pixel and frame of a stream, on the safe side
# Two cores of 2.8 GHz with LLVM: paths traced and splatted, pixel·frames encoded, stored and verified.
PATHS_A_SECOND, SPIKES_A_SECOND = 3e6, 0.7e9


@dataclass(frozen=True)
class Work:
    """A recipe with everything found and checked, before anything is made."""

    recipe: Recipe
    sequences: list[Sequence]
    scenes: dict[str, Scene]
    specs: dict[str, StackSpec]
    sensor: Sensor

    def stacks_missing(self, folder: Path) -> list[str]:
        """Scenes whose focal stack is not whole in this dataset folder."""
        wanted = dict.fromkeys(s.scene for s in self.sequences)
        return [s for s in wanted if StackStore(folder / "stacks", self.specs[s]).missing()]

    def bytes_expected(self, folder: Path) -> int:
        """Disk that the work still to do will take, about, a little on the safe side."""
        pixels = self.sensor.rows * self.sensor.columns
        stacks = (self.specs[s] for s in self.stacks_missing(folder))
        rendered = sum(len(s.groups) * s.positions * pixels * STACK_BYTES for s in stacks)
        to_record = sum(not (folder / s.file).exists() for s in self.sequences)
        return rendered + int(to_record * pixels * self.recipe.camera.frames * STREAM_BITS / 8)

    def seconds_expected(self, folder: Path) -> float:
        """Time that the work still to do will take, roughly, on two cores with LLVM."""
        pixels = self.sensor.rows * self.sensor.columns
        stacks = (self.specs[s] for s in self.stacks_missing(folder))
        rendering = sum(len(s.groups) * s.samples * pixels for s in stacks) / PATHS_A_SECOND
        to_record = sum(not (folder / s.file).exists() for s in self.sequences)
        return rendering + to_record * pixels * self.recipe.camera.frames / SPIKES_A_SECOND


def prepare(recipe_path: str | Path, *, part: tuple[int, int] = (1, 1)) -> Work:
    """Read a recipe, find its scenes and sensor, draw its sequences, and check that they fit together.

    ``part`` is (I, N): only every N-th sequence from the I-th on.

    Raises BadInput for whatever does not fit; nothing has been written then.
    """
    recipe = read_recipe(recipe_path)
    sensor = _sensor(recipe)
    scenes = {}
    for name in (name for split in recipe.splits.values() for name in split.scenes):
        try:
            scenes[name] = find_scene(name)
        except BadInput as error:
            raise BadInput(str(error), where=str(recipe_path)) from error
    specs = {name: _spec(recipe, scene, sensor) for name, scene in scenes.items()}
    sequences = make_plan(recipe)
    for sequence in sequences:
        # Cheap, and it finds a group or a negative gain now rather than after the rendering.
        try:
            group_gains(sequence.schedule, specs[sequence.scene].groups, 16, sensor.readout_hz)
        except BadInput as error:
            raise BadInput(
                f"light {sequence.light!r} on {sequence.scene}: {error}", where=str(recipe_path)
            ) from error
    return Work(recipe, shard(sequences, *part), scenes, specs, sensor)


def _sensor(recipe: Recipe) -> Sensor:
    camera = recipe.camera
    laws = {"reset": camera.reset, "saturation": camera.saturation}
    switches = camera.noise.model_dump(exclude_none=True)
    sensor = get_sensor(camera.sensor, **{k: v for k, v in laws.items() if v is not None})
    return sensor.with_noise(**switches)


def _spec(recipe: Recipe, scene: Scene, sensor: Sensor) -> StackSpec:
    if scene.card.lens.drive != recipe.focus.drive:
        raise BadInput(
            f"the recipe asks for the drive {recipe.focus.drive!r}; scene {scene.id!r} has another",
            allowed=scene.card.lens.drive,
        )
    return StackSpec(
        scene=scene.id,
        scene_digest=scene.digest,
        groups=tuple(scene.card.lights),
        drive=scene.drive(recipe.camera.exposure.f_number),
        rows=sensor.rows,
        columns=sensor.columns,
        pitch_m=sensor.pitch_m,
        positions=recipe.focus.positions,
        samples=recipe.render.samples,
        max_depth=recipe.render.max_depth,
    )


def stack_digests(work: Work, stacks: Path) -> dict[str, str]:
    """The digest of every focal stack of the recipe that is whole, by scene."""
    stores = {name: StackStore(stacks, spec) for name, spec in work.specs.items()}
    return {name: store.digest() for name, store in stores.items() if not store.missing()}


def fingerprint(work: Work, sequence: Sequence, stack_digest: str) -> str:
    """Digest of everything that decides a sequence's numbers: an old file is never taken for it."""
    sensor = asdict(work.sensor)
    del sensor["name"], sensor["sources"]  # words, not numbers
    decisive = {
        "model": MODEL,
        "sequence": asdict(sequence),
        "stack": [work.specs[sequence.scene].key, stack_digest],
        "sensor": sensor,
        "frames": work.recipe.camera.frames,
        "seed": work.recipe.seed,
    }
    return hashlib.sha256(json.dumps(decisive, sort_keys=True).encode()).hexdigest()
