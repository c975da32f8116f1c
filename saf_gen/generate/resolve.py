"""Resolution of a recipe: finds its scenes and sensor, draws its sequences, and names their focal stacks.

Everything is decided and checked here; :mod:`saf_gen.generate.run` then renders and records.
"""

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from saf_gen.camera import Sensor, get_sensor
from saf_gen.core.config.presets import is_preset_file
from saf_gen.errors import BadInput, located, unknown
from saf_gen.generate.cost import MachineRates, plan_stack_bytes, plan_stream_bytes
from saf_gen.generate.finished_recordings import has_generated_recording
from saf_gen.generate.plan import PlannedSequence, SceneFamily, make_recipe_plan
from saf_gen.generate.recipe import Recipe, read_recipe
from saf_gen.generate.shipped_recipes import find_recipe
from saf_gen.plugins.lights import light_group_gains
from saf_gen.plugins.motions import motion_positions_at_readouts
from saf_gen.scene.scene_folder import Scene, find_scene
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import (
    TimeResolvedStack,
    focus_windows_of_stack_slices,
    frames_of_stack_slices,
    shading_moments_of_stack_slices,
)

MODEL = 4
"""Version of the models, raised whenever the same stack, recipe and seed would give different spikes; files of an older
version are made again. If a change reaches only some recordings, see
:func:`saf_gen.generate.finished_recordings.fingerprint_generated_recording`."""


@dataclass(frozen=True)
class ResolvedSequence:
    """One planned sequence, its scene, and its focal stacks.

    Attributes
    ----------
    planned : PlannedSequence
        The sequence.
    scene : Scene
        The member of the scene's family that is recorded.
    time_stack : TimeResolvedStack
        Focal stacks of the recording.
    closed_loop_stack : TimeResolvedStack or None
        Focal stacks of a closed-loop run; None if it needs none, or uses ``time_stack``.
    sensor : Sensor
        Sensor of the recipe.
    frames : int
        Readouts of each sequence of the recipe.
    recipe_seed : int
        Seed of the recipe.
    """

    planned: PlannedSequence
    scene: Scene
    time_stack: TimeResolvedStack
    closed_loop_stack: TimeResolvedStack | None
    sensor: Sensor
    frames: int
    recipe_seed: int

    @property
    def closed_loop_slices(self) -> TimeResolvedStack | None:
        """The time slices that a closed-loop run needs; None if nothing moves or no slice holds all positions."""
        if self.time_stack.is_moving and self.time_stack.holds_full_travel:
            return self.time_stack
        return self.closed_loop_stack

    def stack_label(self, stack: TimeResolvedStack) -> str:
        """Return the name of a stack of this sequence in progress bars and listings."""
        has_full_travel = stack.is_moving and stack.holds_full_travel
        return f"{self.planned.label}{', all positions' if has_full_travel else ''}"

    def fingerprint(self, stack_digest: str) -> str:
        """Return the SHA-256 of all that determines the spikes; a file with another fingerprint is made again."""
        stack, sensor = self.time_stack, asdict(self.sensor)
        del sensor["name"], sensor["sources"]  # texts do not change the spikes
        decisive = {
            "model": MODEL,
            "sequence": self.planned.as_dict(),
            "stack": [[spec.key for spec in stack.specs], stack.slice_frames, stack_digest],
            "sensor": sensor,
            "frames": self.frames,
            "seed": self.recipe_seed,
        }
        return hashlib.sha256(json.dumps(decisive, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class ResolvedRecipe:
    """A recipe with everything that it names found and checked, before anything is made.

    Attributes
    ----------
    recipe : Recipe
        The recipe.
    plan : tuple of ResolvedSequence
        All sequences of the recipe.
    sequences : tuple of ResolvedSequence
        Sequences of the requested split and shard.
    scenes : dict of str to Scene
        Scenes of the recipe, by name.
    sensor : Sensor
        Sensor of the recipe.
    """

    recipe: Recipe
    plan: tuple[ResolvedSequence, ...]
    sequences: tuple[ResolvedSequence, ...]
    scenes: dict[str, Scene]
    sensor: Sensor

    def sequences_by_stack(self) -> dict[TimeResolvedStack, list[ResolvedSequence]]:
        """Return every time-resolved stack once, with the sequences that are recorded from it."""
        found: dict[TimeResolvedStack, list[ResolvedSequence]] = {}
        for sequence in self.sequences:
            found.setdefault(sequence.time_stack, []).append(sequence)
        return found

    def without_diffraction(self) -> "ResolvedRecipe":
        """Return the recipe with ``diffraction: false``."""

        def geometric(sequence: ResolvedSequence) -> ResolvedSequence:
            slices = sequence.closed_loop_stack
            return replace(
                sequence,
                time_stack=sequence.time_stack.without_diffraction(),
                closed_loop_stack=slices.without_diffraction() if slices else None,
            )

        render = self.recipe.render.model_copy(update={"diffraction": False})
        return replace(
            self,
            recipe=self.recipe.model_copy(update={"render": render}),
            plan=tuple(map(geometric, self.plan)),
            sequences=tuple(map(geometric, self.sequences)),
        )

    def stacks_to_render(
        self, folder: Path, keep_slices: str = "all"
    ) -> dict[TimeResolvedStack, list[ResolvedSequence]]:
        """Return the stacks that are incomplete in this dataset folder; stacks of recordings come first.

        Time slices that were deleted after all their recordings had been made are left out, unless the closed loop
        needs them and ``keep_slices`` is not "none".
        """
        stacks = folder / "stacks"
        found = {
            stack: users
            for stack, users in self.sequences_by_stack().items()
            if stack.find_missing(stacks) and not self._is_recorded(stack, users, folder=folder)
        }
        for_closed_loop: dict[TimeResolvedStack, list[ResolvedSequence]] = {}
        for sequence in self.sequences:
            slices = sequence.closed_loop_slices
            if keep_slices != "none" and slices is not None and slices not in found:
                for_closed_loop.setdefault(slices, []).append(sequence)
        return found | {stack: users for stack, users in for_closed_loop.items() if stack.find_missing(stacks)}

    def _is_recorded(self, stack: TimeResolvedStack, users: list[ResolvedSequence], *, folder: Path) -> bool:
        """Return whether all time slices have notes and all recordings are made; spikes are not read."""
        if not (stack.is_moving and stack.has_all_notes(folder / "stacks")):
            return False
        digest = stack.digest(folder / "stacks")
        return all(has_generated_recording(folder / s.planned.file, s.fingerprint(digest)) for s in users)

    def kept_slice_bytes(self, keep_slices: str) -> int:
        """Return the approximate size of the time slices that ``keep_slices`` keeps in the end, in bytes."""
        kept: set[StackSpec] = set()
        for sequence in self.sequences:
            if keep_slices == "all" and sequence.time_stack.is_moving:
                kept |= set(sequence.time_stack.specs)
            if keep_slices != "none" and sequence.closed_loop_slices is not None:
                kept |= set(sequence.closed_loop_slices.specs)
        return plan_stack_bytes(kept)

    def estimate_bytes(self, folder: Path, keep_slices: str = "all") -> int:
        """Return the approximate disk space that the remaining work takes while it runs, in bytes, rounded up."""
        missing = self._missing_stacks(folder, keep_slices)
        return plan_stack_bytes(missing) + plan_stream_bytes(self._missing_pixel_frames(folder))

    def estimate_seconds(self, folder: Path, keep_slices: str = "all") -> float:
        """Return the approximate time of the remaining work on two cores with LLVM, in seconds."""
        rates = MachineRates()
        rendering = sum(map(rates.render_seconds, self._missing_stacks(folder, keep_slices)))
        working = rendering + self._missing_pixel_frames(folder) / rates.recorded_per_s(1)
        return rates.start_s + working if working else 0.0

    def _missing_stacks(self, folder: Path, keep_slices: str) -> set[StackSpec]:
        stacks = folder / "stacks"
        return {spec for stack in self.stacks_to_render(folder, keep_slices) for spec in stack.find_missing(stacks)}

    def _missing_pixel_frames(self, folder: Path) -> int:
        missing = sum(not (folder / sequence.planned.file).exists() for sequence in self.sequences)
        return missing * self.sensor.rows * self.sensor.columns * self.recipe.camera.frames


def resolve_recipe(
    recipe_path: str | Path,
    *,
    part: tuple[int, int] = (1, 1),
    split: str | None = None,
    most_repeats: int | None = None,
) -> ResolvedRecipe:
    """Read a recipe, find its scenes and sensor, draw its sequences, and check that they fit together.

    Nothing is rendered or written.

    Parameters
    ----------
    recipe_path : str or Path
        YAML file of the recipe, or the name of a recipe that comes with saf_gen.
    part : tuple of int, default (1, 1)
        Shard (I, N), with I from 1: the I-th sequence and every N-th one after it.
    split : str, optional
        Use only the sequences of this split.
    most_repeats : int, optional
        Largest number of repeats to use from each split, for plans of large recipes.

    Returns
    -------
    ResolvedRecipe
        The recipe with its scenes, its sensor and its sequences.

    Raises
    ------
    BadInput
        If the recipe, a scene or the sensor is missing or invalid, or if they do not fit together; the error names the
        recipe and, if the recipe itself is wrong, the line.
    """
    recipe_path = find_recipe(recipe_path)
    recipe, where = read_recipe(recipe_path), str(recipe_path)
    if most_repeats is not None:
        recipe = recipe.with_fewer_repeats(most_repeats)
    sensor = _read_sensor(recipe, Path(recipe_path).parent)
    scenes = {}
    for name in (name for settings in recipe.splits.values() for name in settings.scenes):
        with located(where):
            scenes[name] = find_scene(name)
        _check_drive(recipe, scenes[name])
    if split is not None and split not in recipe.splits:
        raise unknown("split", split, allowed=recipe.splits, where=where)
    families = {
        name: SceneFamily(scene.card.params, scene.card.slices_per_s is not None, scene.card.illuminance_lux)
        for name, scene in scenes.items()
    }
    with located(where):
        planned = make_recipe_plan(recipe, families)
    # This takes milliseconds, and finds errors before hours of rendering.
    frames, hz = recipe.camera.frames, sensor.readout_hz
    for s in _distinct(planned, lambda s: [s.schedule, s.scene]):
        with located(where, prefix=f"light {s.light!r} on {s.scene}: "):
            light_group_gains(s.schedule, tuple(scenes[s.scene].card.lights), frames=frames, readout_hz=hz)
    for s in _distinct(planned, lambda s: s.motion):
        with located(where, prefix=f"the lens motion of {s.id}: "):
            motion_positions_at_readouts(s.motion, frames, readout_hz=hz)
    with located(where):
        resolved = tuple(_resolve_sequences(planned, recipe, scenes=scenes, sensor=sensor))
    wanted = [sequence for sequence in resolved if split in (None, sequence.planned.split)]
    index, count = part
    return ResolvedRecipe(recipe, resolved, tuple(wanted[index - 1 :: count]), scenes, sensor)


def _distinct(sequences: list[PlannedSequence], key: Callable[[PlannedSequence], Any]) -> list[PlannedSequence]:
    """Return the first sequence for each key; many sequences share a key, such as constant light."""
    first: dict[str, PlannedSequence] = {}
    for sequence in sequences:
        first.setdefault(json.dumps(key(sequence), sort_keys=True), sequence)
    return list(first.values())


def _resolve_sequences(
    planned: list[PlannedSequence], recipe: Recipe, *, scenes: dict[str, Scene], sensor: Sensor
) -> Iterable[ResolvedSequence]:
    stacks: dict[str, tuple[Scene, TimeResolvedStack, TimeResolvedStack | None]] = {}  # shared by lights
    for sequence in planned:
        key = json.dumps([sequence.scene, sequence.params, sequence.scene_motion, sequence.motion])
        if key not in stacks:
            scene = scenes[sequence.scene].with_params(sequence.params)
            stacks[key] = (scene, *_resolve_stacks(sequence, recipe, scene=scene, sensor=sensor))
        yield ResolvedSequence(sequence, *stacks[key], sensor, recipe.camera.frames, recipe.seed)


def _resolve_stacks(
    sequence: PlannedSequence, recipe: Recipe, *, scene: Scene, sensor: Sensor
) -> tuple[TimeResolvedStack, TimeResolvedStack | None]:
    """Return the stack of the recording, and a separate stack for closed-loop runs, or None if they need none."""
    card, frames, hz = scene.card, recipe.camera.frames, sensor.readout_hz
    with located("", prefix=f"scene {scene.id}: "):
        spec = StackSpec.from_scene(
            scene,
            sensor,
            positions=recipe.focus.positions,
            samples=recipe.render.samples,
            max_depth=recipe.render.max_depth,
            f_number=recipe.camera.exposure.f_number,
            wavelength_m=0.0 if recipe.render.diffraction is False else sensor.wavelength_m,
            estimator=recipe.render.estimator,
            time_s=card.still_s if card.slices_per_s is not None else 0.0,
        )
    if sequence.scene_motion == "static":
        return TimeResolvedStack((0,), (spec,)), None
    slices_per_s = recipe.render.slices_per_s or card.slices_per_s or 0.0
    position = motion_positions_at_readouts(sequence.motion, frames, readout_hz=hz)
    starts = frames_of_stack_slices(frames, readout_hz=hz, slices_per_s=slices_per_s)
    windows = focus_windows_of_stack_slices(position, starts, positions=spec.positions)
    times = [start / hz for start in starts]
    filtered = recipe.render.estimator == "filtered"
    moments = shading_moments_of_stack_slices(times) if filtered else [()] * len(times)
    slices = (
        replace(spec, samples=recipe.render.samples_per_slice, time_s=time_s, window=window, moments_s=shading_moments)
        for time_s, window, shading_moments in zip(times, windows, moments, strict=True)
    )
    stack = TimeResolvedStack(starts, tuple(slices))
    full_travel_frames = recipe.render.all_positions_s * hz
    if full_travel_frames >= frames:
        return stack.with_full_travel(), None
    # The recording does not use the slices at all positions, because paths that are spread over all positions leave
    # more noise, and focus measures would see an edge where the noise changes.
    return stack, stack.truncated_to(full_travel_frames).with_full_travel() if full_travel_frames else None


def _read_sensor(recipe: Recipe, folder: Path) -> Sensor:
    """Return the recipe's sensor, given by name or by the path of a file relative to the recipe's folder."""
    camera = recipe.camera
    named = folder / camera.sensor if is_preset_file(camera.sensor) else camera.sensor
    changes = {"reset": camera.reset, "saturation": camera.saturation}
    changes = {key: value for key, value in changes.items() if value is not None}
    return get_sensor(named, **changes, noise=camera.noise.model_dump(exclude_none=True))


def _check_drive(recipe: Recipe, scene: Scene) -> None:
    if recipe.focus.drive not in (None, scene.card.lens.drive):
        raise BadInput(
            f"the recipe asks for the drive {recipe.focus.drive!r}; scene {scene.id!r} has another",
            allowed=scene.card.lens.drive,
            hint="or leave focus.drive out: each scene then has its own",
        )
