"""A recipe with everything found and checked: its scenes, their stacks, the sensor, the sequences to make.

What stands here decides; :mod:`saf_gen.generate.run` does it.
"""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from saf_gen.camera import Sensor, get_sensor, is_sensor_file
from saf_gen.errors import BadInput, unknown
from saf_gen.generate.plan import PlannedSequence, SceneFamily, make_plan, select_shard
from saf_gen.generate.recipe import Recipe, read_recipe
from saf_gen.generate.recorder import MODEL, group_gains
from saf_gen.motions import readout_positions
from saf_gen.scene.scene_folder import Scene, find_scene
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import TimeResolvedStack, needed_focus_windows, time_slice_frames

__all__ = ["ResolvedRecipe", "resolve_recipe", "sequence_fingerprint", "stack_digests"]

STREAM_BITS_PER_PIXEL_FRAME = 0.4  # a pixel and frame of a stream, on the safe side
# Two cores of 2.8 GHz with LLVM: paths traced and splatted; pixel·frames encoded, stored and verified;
# seconds to load a scene, each light group of each stack; to sum and store a pixel at a position.
PATHS_PER_S, PIXEL_FRAMES_PER_S, LOAD_S, PLANE_S_PER_PIXEL = 2.5e6, 0.7e9, 0.3, 8e-8


@dataclass(frozen=True)
class ResolvedRecipe:
    """A recipe with everything found and checked, before anything is made."""

    recipe: Recipe
    sequences: list[PlannedSequence]
    scenes: dict[str, Scene]
    sensor: Sensor

    @property
    def plan(self) -> list[PlannedSequence]:
        """All sequences of the recipe, those of other shards too."""
        return _plan(self.recipe, self.scenes)

    def member(self, sequence: PlannedSequence) -> Scene:
        """The member of its scene's family that a sequence films."""
        return self.scenes[sequence.scene].with_params(sequence.params)

    def time_stack(self, sequence: PlannedSequence) -> TimeResolvedStack:
        """The focal stacks that a sequence films."""
        spec = _spec(self.recipe, self.member(sequence), self.sensor)
        if sequence.scene_motion == "static":
            return TimeResolvedStack((0,), (spec,))
        card, hz = self.scenes[sequence.scene].card, self.sensor.readout_hz
        a_second = self.recipe.render.slices_per_s or card.slices_per_s or 0.0
        position = readout_positions(sequence.motion, self.recipe.camera.frames, hz)
        at = time_slice_frames(position.size, readout_hz=hz, slices_per_s=a_second)
        slices = (
            replace(spec, samples=self.recipe.render.samples_per_slice, time_s=frame / hz, window=window)
            for frame, window in zip(
                at, needed_focus_windows(position, at, positions=spec.positions), strict=True
            )
        )
        time_stack = TimeResolvedStack(at, tuple(slices))
        return (
            time_stack.with_full_travel()
            if self.recipe.render.all_positions_s * hz >= position.size
            else time_stack
        )

    def closed_loop_stack_of(self, sequence: PlannedSequence) -> TimeResolvedStack | None:
        """The focal stacks that the closed loop films, where the recording is not made of them.

        Not one time_stack for both, whole in the beginning and not after it: of paths that are spread over
        all positions more noise is left, and where it changes focus measures see an edge.
        """
        time_stack, frames = (
            self.time_stack(sequence),
            self.recipe.render.all_positions_s * self.sensor.readout_hz,
        )
        if not time_stack.is_moving or frames == 0 or frames >= self.recipe.camera.frames:
            return None
        return time_stack.truncated_to(frames).with_full_travel()

    def sequences_by_stack(self) -> dict[TimeResolvedStack, list[PlannedSequence]]:
        """Every time_stack that the sequences film, each once, with those that film it."""
        found: dict[TimeResolvedStack, list[PlannedSequence]] = {}
        for sequence in self.sequences:
            found.setdefault(self.time_stack(sequence), []).append(sequence)
        return found

    def stacks_to_render(self, folder: Path) -> dict[TimeResolvedStack, list[PlannedSequence]]:
        """The reels of which something is still to be rendered in this dataset folder; the recorded first."""
        reels = self.sequences_by_stack()
        for sequence in self.sequences:
            if (live := self.closed_loop_stack_of(sequence)) is not None:
                reels.setdefault(live, []).append(sequence)
        return {
            time_stack: sequences
            for time_stack, sequences in reels.items()
            if time_stack.find_missing(folder / "stacks")
        }

    def stack_label(self, time_stack: TimeResolvedStack, sequences: list[PlannedSequence]) -> str:
        """What people call the stacks of a time_stack."""
        every = time_stack.is_moving and time_stack == time_stack.with_full_travel()
        return f"{sequences[0].label}{', all positions' if every else ''}"

    def estimate_bytes(self, folder: Path) -> int:
        """Disk that the work still to do will take, about, a little on the safe side."""
        pixels = self.sensor.rows * self.sensor.columns
        missing = self._missing(folder)
        rendered = sum(len(s.groups) * s.rendered_count * pixels * (2 if s.window else 4) for s in missing)
        to_record = sum(not (folder / s.file).exists() for s in self.sequences)
        return rendered + int(
            to_record * pixels * self.recipe.camera.frames * STREAM_BITS_PER_PIXEL_FRAME / 8
        )

    def estimate_seconds(self, folder: Path) -> float:
        """Time that the work still to do will take, roughly, on two cores with LLVM."""
        pixels = self.sensor.rows * self.sensor.columns
        specs = self._missing(folder)
        rendering = sum(
            len(s.groups)
            * (LOAD_S + pixels * (s.samples / PATHS_PER_S + s.rendered_count * PLANE_S_PER_PIXEL))
            for s in specs
        )
        to_record = sum(not (folder / s.file).exists() for s in self.sequences)
        return rendering + to_record * pixels * self.recipe.camera.frames / PIXEL_FRAMES_PER_S

    def _missing(self, folder: Path) -> set[StackSpec]:
        return {
            spec
            for time_stack in self.stacks_to_render(folder)
            for spec in time_stack.find_missing(folder / "stacks")
        }


def resolve_recipe(
    recipe_path: str | Path, *, part: tuple[int, int] = (1, 1), split: str | None = None
) -> ResolvedRecipe:
    """Read a recipe, find its scenes and sensor, draw its sequences, and check that they fit together.

    ``split``: its sequences alone. ``part`` is (I, N): of these every N-th from the I-th on.

    Raises BadInput for whatever does not fit; nothing has been written then.
    """
    recipe = read_recipe(recipe_path)
    sensor = _sensor(recipe, Path(recipe_path).parent)
    scenes = {}
    for name in (name for split in recipe.splits.values() for name in split.scenes):
        try:
            scenes[name] = find_scene(name)
        except BadInput as error:
            raise BadInput(str(error), where=str(recipe_path)) from error
        _check_drive(recipe, scenes[name])
    try:
        sequences = _plan(recipe, scenes)
    except BadInput as error:
        raise BadInput(str(error), where=str(recipe_path)) from error
    schedules: dict[str, PlannedSequence] = {}  # drawn once for many: constant light is the same everywhere
    for sequence in sequences:
        schedules.setdefault(json.dumps([sequence.schedule, sequence.scene], sort_keys=True), sequence)
    for sequence in schedules.values():
        # A millisecond, and it finds a group or a gain that does not fit now rather than after the rendering.
        groups = tuple(scenes[sequence.scene].card.lights)
        try:
            group_gains(sequence.schedule, groups, recipe.camera.frames, sensor.readout_hz)
        except BadInput as error:
            raise BadInput(
                f"light {sequence.light!r} on {sequence.scene}: {error}", where=str(recipe_path)
            ) from error
    motions: dict[str, PlannedSequence] = {}  # most often all move alike
    for sequence in sequences:
        motions.setdefault(json.dumps(sequence.motion, sort_keys=True), sequence)
    for sequence in motions.values():
        try:
            readout_positions(sequence.motion, recipe.camera.frames, sensor.readout_hz)
        except BadInput as error:
            raise BadInput(f"the lens motion of {sequence.id}: {error}", where=str(recipe_path)) from error
    if split is not None and split not in recipe.splits:
        raise unknown("split", split, recipe.splits, where=str(recipe_path))
    wanted = [sequence for sequence in sequences if split in (None, sequence.split)]
    return ResolvedRecipe(recipe, select_shard(wanted, *part), scenes, sensor)


def _plan(recipe: Recipe, scenes: dict[str, Scene]) -> list[PlannedSequence]:
    families = {
        name: SceneFamily(scene.card.params, scene.card.slices_per_s is not None, scene.card.illuminance_lux)
        for name, scene in scenes.items()
    }
    return make_plan(recipe, families)


def _sensor(recipe: Recipe, folder: Path) -> Sensor:
    """The recipe's sensor: by name, or by the path of a file, which starts in the recipe's folder."""
    camera = recipe.camera
    named = folder / camera.sensor if is_sensor_file(camera.sensor) else camera.sensor
    laws = {"reset": camera.reset, "saturation": camera.saturation}
    switches = camera.noise.model_dump(exclude_none=True)
    sensor = get_sensor(named, **{k: v for k, v in laws.items() if v is not None})
    return sensor.with_noise(**switches)


def _check_drive(recipe: Recipe, scene: Scene) -> None:
    if recipe.focus.drive not in (None, scene.card.lens.drive):
        raise BadInput(
            f"the recipe asks for the drive {recipe.focus.drive!r}; scene {scene.id!r} has another",
            allowed=scene.card.lens.drive,
            hint="or leave focus.drive out: each scene then has its own",
        )


def _spec(recipe: Recipe, scene: Scene, sensor: Sensor) -> StackSpec:
    return StackSpec(
        scene=scene.id,
        scene_digest=scene.digest,
        groups=tuple(scene.card.lights),
        drive=scene.build_drive(recipe.camera.exposure.f_number),
        rows=sensor.rows,
        columns=sensor.columns,
        pitch_m=sensor.pitch_m,
        positions=recipe.focus.positions,
        samples=recipe.render.samples,
        max_depth=recipe.render.max_depth,
        params=json.dumps(dict(scene.params), sort_keys=True),
        time_s=scene.card.still_s if scene.card.slices_per_s is not None else 0.0,
    )


def stack_digests(work: ResolvedRecipe, sequences: Iterable[PlannedSequence], stacks: Path) -> dict[str, str]:
    """By sequence, the digest of the stacks that it films, where they are whole."""
    made: dict[TimeResolvedStack, str] = {}
    out = {}
    for sequence in sequences:
        time_stack = work.time_stack(sequence)
        if time_stack not in made:
            made[time_stack] = "" if time_stack.find_missing(stacks) else time_stack.digest(stacks)
        if made[time_stack]:
            out[sequence.id] = made[time_stack]
    return out


def sequence_fingerprint(work: ResolvedRecipe, sequence: PlannedSequence, stack_digest: str) -> str:
    """Digest of everything that decides a sequence's numbers: an old file is never taken for it."""
    time_stack, sensor = work.time_stack(sequence), asdict(work.sensor)
    del sensor["name"], sensor["sources"]  # words, not numbers
    decisive = {
        "model": MODEL,
        "sequence": asdict(sequence),
        "stack": [[spec.key for spec in time_stack.specs], time_stack.slice_frames, stack_digest],
        "sensor": sensor,
        "frames": work.recipe.camera.frames,
        "seed": work.recipe.seed,
    }
    return hashlib.sha256(json.dumps(decisive, sort_keys=True).encode()).hexdigest()
