"""Resolves a recipe: finds its scenes and sensor, draws its sequences, and names the focal stacks of each.

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
from saf_gen.generate.plan import PlannedSequence, SceneFamily, make_recipe_plan
from saf_gen.generate.recipe import Recipe, read_recipe
from saf_gen.generate.recordings import has_generated_recording
from saf_gen.generate.shipped_recipes import find_recipe
from saf_gen.plugins.lights import light_group_gains
from saf_gen.plugins.motions import motion_positions_at_readouts
from saf_gen.scene.scene_folder import Scene, find_scene
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import (
    TimeResolvedStack,
    focus_windows_of_stack_slices,
    frames_of_stack_slices,
    moments_that_shade_stack_slices,
)

MODEL = 4
"""Raised whenever the same stack, recipe and seed would give other spikes: old files are then made anew."""


@dataclass(frozen=True)
class ResolvedSequence:
    """One planned sequence, the member of the scene's family before its lens, and its focal stacks.

    ``closed_loop_stack`` holds those of a closed-loop run, where ``time_stack`` does not serve it too. All sequences of
    a recipe share ``sensor``, ``frames`` and ``recipe_seed``.
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
        """The time slices that a closed-loop run needs; None where nothing moves or no slice holds all positions."""
        if self.time_stack.is_moving and self.time_stack.holds_full_travel:
            return self.time_stack
        return self.closed_loop_stack

    def stack_label(self, stack: TimeResolvedStack) -> str:
        """Return what progress bars and listings call a stack of this sequence."""
        is_whole = stack.is_moving and stack.holds_full_travel
        return f"{self.planned.label}{', all positions' if is_whole else ''}"

    def fingerprint(self, stack_digest: str) -> str:
        """Return the SHA-256 of everything that decides the spikes: a file with another fingerprint is made again."""
        stack, sensor = self.time_stack, asdict(self.sensor)
        del sensor["name"], sensor["sources"]  # words, not numbers
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
    """A recipe with everything found and checked, before anything is made.

    ``plan`` holds all sequences of the recipe, ``sequences`` those of the split and shard asked for.
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
            whole = sequence.closed_loop_stack
            return replace(
                sequence,
                time_stack=sequence.time_stack.without_diffraction(),
                closed_loop_stack=whole.without_diffraction() if whole else None,
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
        """Return the stacks that are not whole in this dataset folder; those of recordings come first.

        Time slices that were deleted after all their recordings had been made are not among them, unless the closed
        loop needs them and ``keep_slices`` is not "none".
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
        """Whether all recordings from time slices whose notes are still there are made; their content is not read."""
        if not (stack.is_moving and stack.has_all_notes(folder / "stacks")):
            return False
        digest = stack.digest(folder / "stacks")
        return all(has_generated_recording(folder / s.planned.file, s.fingerprint(digest)) for s in users)

    def kept_slice_bytes(self, keep_slices: str) -> int:
        """Return about how many bytes the time slices of these sequences take that ``keep_slices`` keeps in the end."""
        kept: set[StackSpec] = set()
        for sequence in self.sequences:
            if keep_slices == "all" and sequence.time_stack.is_moving:
                kept |= set(sequence.time_stack.specs)
            if keep_slices != "none" and sequence.closed_loop_slices is not None:
                kept |= set(sequence.closed_loop_slices.specs)
        return plan_stack_bytes(kept)

    def estimate_bytes(self, folder: Path, keep_slices: str = "all") -> int:
        """Return about how many bytes of disk the work still to do takes while it is done, rounded up."""
        missing = self._missing_stacks(folder, keep_slices)
        return plan_stack_bytes(missing) + plan_stream_bytes(self._missing_pixel_frames(folder))

    def estimate_seconds(self, folder: Path, keep_slices: str = "all") -> float:
        """Return roughly how many seconds the work still to do takes on two cores with LLVM."""
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
    recipe_path : the recipe's YAML file, or the name of a recipe that comes with saf_gen.
    part : (I, N), 1-based: take every N-th sequence from the I-th on.
    split : take the sequences of this split alone.
    most_repeats : take no more repeats of each split than so many, as a plan of a large recipe does.

    Raises
    ------
    BadInput : for whatever does not fit, with the recipe's path and, where the recipe itself is wrong, the line.
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
    # This takes milliseconds, and finds what does not fit before hours of rendering.
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
    """Return the first sequence of each key; constant light, for one, is the same for many."""
    first: dict[str, PlannedSequence] = {}
    for sequence in sequences:
        first.setdefault(json.dumps(key(sequence), sort_keys=True), sequence)
    return list(first.values())


def _resolve_sequences(
    planned: list[PlannedSequence], recipe: Recipe, *, scenes: dict[str, Scene], sensor: Sensor
) -> Iterable[ResolvedSequence]:
    stacks: dict[str, tuple[Scene, TimeResolvedStack, TimeResolvedStack | None]] = {}  # one for many lights
    for sequence in planned:
        key = json.dumps([sequence.scene, sequence.params, sequence.scene_motion, sequence.motion])
        if key not in stacks:
            scene = scenes[sequence.scene].with_params(sequence.params)
            stacks[key] = (scene, *_resolve_stacks(sequence, recipe, scene=scene, sensor=sensor))
        yield ResolvedSequence(sequence, *stacks[key], sensor, recipe.camera.frames, recipe.seed)


def _resolve_stacks(
    sequence: PlannedSequence, recipe: Recipe, *, scene: Scene, sensor: Sensor
) -> tuple[TimeResolvedStack, TimeResolvedStack | None]:
    """Return the stack of the recording, and that of a closed-loop run where it is another one."""
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
    moments = moments_that_shade_stack_slices(times) if filtered else [()] * len(times)
    slices = (
        replace(spec, samples=recipe.render.samples_per_slice, time_s=time_s, window=window, moments_s=told)
        for time_s, window, told in zip(times, windows, moments, strict=True)
    )
    stack = TimeResolvedStack(starts, tuple(slices))
    whole_frames = recipe.render.all_positions_s * hz
    if whole_frames >= frames:
        return stack.with_full_travel(), None
    # The recording does not use the slices at all positions: paths spread over all positions leave more
    # noise, and focus measures would see an edge where the noise changes.
    return stack, stack.truncated_to(whole_frames).with_full_travel() if whole_frames else None


def _read_sensor(recipe: Recipe, folder: Path) -> Sensor:
    """Return the recipe's sensor, by name or by the path of a file relative to the recipe's folder."""
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
