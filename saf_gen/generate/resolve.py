"""Resolution of a recipe: the scenes, the sensor and the focal stacks of its sequences, which :mod:`draw` draws.

Everything is decided and checked here; :mod:`saf_gen.generate.plan` then finds out what is left to make.
"""

import hashlib
import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from saf_gen.camera import Sensor, get_sensor
from saf_gen.core.config.frozen_benchmarks import read_frozen_digests
from saf_gen.core.config.presets import is_preset_file
from saf_gen.errors import BadInput, located, unknown
from saf_gen.generate.colours import axial_colour, check_colours, find_margin
from saf_gen.generate.draw import PlannedSequence, SceneFamily, draw_sequences
from saf_gen.generate.light_roles import missing_roles
from saf_gen.generate.recipe import Recipe, find_recipe, read_recipe
from saf_gen.optics.actuators import Actuator, get_actuator
from saf_gen.plugins.lights import group_gains, list_lamps, states_spectrum
from saf_gen.plugins.motions import lens_positions
from saf_gen.scene.picture_card import PictureScene
from saf_gen.scene.scene_folder import Scene, find_any_scene
from saf_gen.stack.all_in_focus import sharp_stack
from saf_gen.stack.focal_stack import PICTURES, StackSpec
from saf_gen.stack.picture_stack import PictureStack, read_picture_stack
from saf_gen.stack.recapture import Recapture
from saf_gen.stack.time_resolved import TimeResolvedStack, slice_moments, slice_starts, slice_windows


def recipe_fingerprint(recipe: Recipe) -> str:
    """Return the SHA-256 of the values of a recipe, regardless of comments, file name and the order of keys."""
    values = recipe.model_dump(mode="json")
    for split in values["splits"].values():
        if not split["at_rest"]:
            del split["at_rest"]  # recipes without this key keep their fingerprint from before it existed
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


MODEL = 4
"""Version of the models, raised whenever the same stack, recipe and seed would give different spikes; files of an older
version are made again. If a change reaches only some recordings, see
:func:`saf_gen.generate.record.fingerprint_generated_recording`."""


@dataclass(frozen=True)
class ResolvedSequence:
    """One planned sequence, its scene, and its focal stacks.

    Attributes
    ----------
    planned : PlannedSequence
        The sequence.
    scene : Scene or PictureStack
        The member of the scene's family that is recorded, or the stack that was photographed.
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
    sharp_stack : TimeResolvedStack or None
        Stacks of its all-in-focus pictures (:mod:`saf_gen.stack.all_in_focus`); None if the recipe asks for none.
    """

    planned: PlannedSequence
    scene: Scene | PictureStack
    time_stack: TimeResolvedStack
    closed_loop_stack: TimeResolvedStack | None
    sensor: Sensor
    frames: int
    recipe_seed: int
    sharp_stack: TimeResolvedStack | None = None

    @property
    def stacks(self) -> tuple[TimeResolvedStack, ...]:
        """All its stacks, each once: of the recording, of its all-in-focus pictures, and of the closed loop."""
        found = (self.time_stack, self.sharp_stack, self.closed_loop_slices)
        return tuple(dict.fromkeys(stack for stack in found if stack is not None))

    @property
    def closed_loop_slices(self) -> TimeResolvedStack | None:
        """The time slices that a closed-loop run needs; None if nothing moves or no slice holds all positions."""
        if self.time_stack.is_moving and self.time_stack.holds_full_travel:
            return self.time_stack
        return self.closed_loop_stack

    def stack_label(self, stack: TimeResolvedStack) -> str:
        """Return the name of a stack of this sequence in progress bars and listings."""
        if stack == self.sharp_stack:
            return f"{self.planned.label}, all in focus"
        has_full_travel = stack.is_moving and stack.holds_full_travel
        return f"{self.planned.label}{', all positions' if has_full_travel else ''}"

    @property
    def pixel_frames(self) -> int:
        """Pixels times readouts of the recording."""
        return self.frames * self.sensor.rows * self.sensor.columns

    def fingerprint(self, stack_digest: str) -> str:
        """Return the SHA-256 of all that determines the content; a file with another fingerprint is made again."""
        stack, sensor = self.time_stack, self.sensor.as_dict()
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
    all_sequences : tuple of ResolvedSequence
        All sequences of the recipe.
    sequences : tuple of ResolvedSequence
        Sequences of the requested split.
    scenes : dict of str to Scene or PictureStack
        Scenes of the recipe, or stacks that were photographed, by name.
    sensor : Sensor
        Sensor of the recipe.
    benchmark : str, default ""
        Name and digest of the recipe's frozen benchmark, as streams store them; "" if it has none.
    part : tuple of int, default (1, 1)
        Shard (I, N) of these sequences that is requested, with I from 1 (:mod:`saf_gen.generate.shards`).
    others : tuple of Recapture, default ()
        Cameras that record every sequence again.
    """

    recipe: Recipe
    all_sequences: tuple[ResolvedSequence, ...]
    sequences: tuple[ResolvedSequence, ...]
    scenes: dict[str, Scene | PictureStack]
    sensor: Sensor
    benchmark: str = ""
    part: tuple[int, int] = (1, 1)
    others: tuple[Recapture, ...] = ()

    @property
    def pixel_frames(self) -> int:
        """Pixels times readouts of a recording."""
        return self.recipe.camera.frames * self.sensor.rows * self.sensor.columns

    def without_diffraction(self) -> "ResolvedRecipe":
        """Return the recipe with ``diffraction: false``, which is of no frozen benchmark."""

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
            all_sequences=tuple(map(geometric, self.all_sequences)),
            sequences=tuple(map(geometric, self.sequences)),
            benchmark="",
        )


def resolve_recipe(
    recipe_path: str | Path, *, part: tuple[int, int] = (1, 1), split: str | None = None
) -> ResolvedRecipe:
    """Read a recipe, find its scenes and sensor, draw its sequences, and check that they fit together.

    Nothing is rendered or written.

    Parameters
    ----------
    recipe_path : str or Path
        YAML file of the recipe, or the name of a recipe that comes with saf_gen.
    part : tuple of int, default (1, 1)
        Shard (I, N) that is made, with I from 1.
    split : str, optional
        Use only the sequences of this split.

    Returns
    -------
    ResolvedRecipe
        The recipe with its scenes, its sensor and its sequences.

    Raises
    ------
    BadInput
        If the recipe, a scene or the sensor is missing or invalid, if they do not fit together, or if the recipe has
        the name of a frozen benchmark but would give different spikes; the error names the recipe and, if the recipe
        itself is wrong, the line.
    """
    recipe_path = find_recipe(recipe_path)
    recipe, where = read_recipe(recipe_path), str(recipe_path)
    sensor = _read_sensor(recipe, Path(recipe_path).parent)
    with located(where):
        others = tuple(
            Recapture.by(str(recipe_path.parent / name) if is_preset_file(name) else name)
            for name in recipe.camera.other_cameras
        )
        actuator = _read_actuator(recipe, Path(recipe_path).parent)
    scenes: dict[str, Scene | PictureStack] = {}
    for name in (name for settings in recipe.splits.values() for name in settings.scenes):
        with located(where):
            found = find_any_scene(name)
            if isinstance(found, PictureScene):
                _check_given_lens(recipe, name)
                scenes[name] = read_picture_stack(found, (sensor.rows, sensor.columns))
            else:
                scenes[name] = found
                _check_drive(recipe, found)
    if split is not None and split not in recipe.splits:
        raise unknown("split", split, allowed=recipe.splits, where=where)
    with located(where):
        families = {
            name: SceneFamily(
                scene.card.params,
                scene.card.slices_per_s is not None,
                scene.card.illuminance_lux,
                scene.card.light_roles,
                _axial_colour(recipe, scene),
            )
            for name, scene in scenes.items()
        }
        planned = draw_sequences(recipe, families, actuator=actuator)
        _check_samples(planned, recipe, scenes=scenes)
    # This takes milliseconds, and finds errors before hours of rendering.
    frames, hz = recipe.camera.frames, sensor.readout_hz
    for s in _distinct(planned, lambda s: [s.schedule, s.scene]):
        with located(where, prefix=f"light {s.light!r} on {s.scene}: "):
            if isinstance(scenes[s.scene], PictureStack) and any(map(states_spectrum, s.schedule.values())):
                raise BadInput("it has a spectrum", allowed="lights without one: pictures hold light of one kind")
            group_gains(s.schedule, tuple(scenes[s.scene].card.lights), frames=frames, readout_hz=hz)
    for s in _distinct(planned, lambda s: s.motion):
        with located(where, prefix=f"the lens motion of {s.id}: "):
            lens_positions(s.motion, frames, readout_hz=hz)
    with located(where):
        resolved = tuple(_resolve_sequences(planned, recipe, scenes=scenes, sensor=sensor))
        check_colours(resolved, recipe)
    wanted = tuple(sequence for sequence in resolved if split in (None, sequence.planned.split))
    whole = ResolvedRecipe(recipe, resolved, wanted, scenes, sensor, part=part, others=others)
    return replace(whole, benchmark=_benchmark(whole))


def _axial_colour(recipe: Recipe, scene: Scene | PictureStack) -> dict[str, Any] | None:
    colour = axial_colour(recipe, scene) if isinstance(scene, Scene) else None
    return colour.model_dump(mode="json", exclude_none=True) if colour else None


def _check_samples(
    planned: Iterable[PlannedSequence], recipe: Recipe, *, scenes: Mapping[str, Scene | PictureStack]
) -> None:
    """Raise BadInput if a scene's own number of samples would change none of its pictures."""
    motions = defaultdict[str, set[str]](set)
    for sequence in planned:
        motions[sequence.scene].add(sequence.scene_motion)
    for name, own in recipe.render.per_scene.items():
        key = f"render.per_scene.{name}"
        scene = scenes[name]
        if isinstance(scene, PictureStack) or scene.card.section is not None:
            what = "given pictures are" if isinstance(scene, PictureStack) else "a thin section is drawn by waves,"
            raise BadInput(f"{key}: {what} without samples", hint=f"leave {name} out")
        if own.slice_samples is not None and "dynamic" not in motions[name]:
            raise BadInput(
                f"{key}.slice_samples is {own.slice_samples}, but {name} is recorded only at rest",
                allowed="samples",
                hint="or add dynamic to scene_motion of its split, if the scene moves",
            )
        if own.samples is not None and "static" not in motions[name]:
            slice_samples = recipe.render.of_scene(name).slice_samples
            if slice_samples is not None:
                raise BadInput(
                    f"{key}.samples is {own.samples}, but {name} is recorded only moving, with {slice_samples} "
                    "slice_samples",
                    allowed="slice_samples",
                    hint="or add static to scene_motion of its split",
                )


def _distinct(sequences: list[PlannedSequence], key: Callable[[PlannedSequence], Any]) -> list[PlannedSequence]:
    """Return the first sequence for each key; many sequences share a key, such as constant light."""
    first: dict[str, PlannedSequence] = {}
    for sequence in sequences:
        first.setdefault(json.dumps(key(sequence), sort_keys=True), sequence)
    return list(first.values())


def _resolve_sequences(
    planned: list[PlannedSequence], recipe: Recipe, *, scenes: dict[str, Scene | PictureStack], sensor: Sensor
) -> Iterable[ResolvedSequence]:
    stacks: dict[str, tuple[Scene | PictureStack, TimeResolvedStack, TimeResolvedStack | None]] = {}  # shared by lights
    of_point: dict[str, TimeResolvedStack] = {}
    for sequence in planned:
        lens = [sequence.motion, sequence.actuator_seed]
        key = json.dumps([sequence.scene, sequence.params, sequence.scene_motion, lens])
        if key not in stacks:
            scene = scenes[sequence.scene].with_params(sequence.params)
            stacks[key] = (scene, *_resolve_stacks(sequence, recipe, scene=scene, sensor=sensor))
        if recipe.truth.sharp:
            with located("", prefix=f"truth.sharp: {sequence.id}: "):
                time_stack = stacks[key][1]
                _check_lamps(sequence, time_stack.specs[0].groups)
                if key not in of_point:
                    position, _ = sequence.lens_course(recipe.camera.frames, readout_hz=sensor.readout_hz)
                    of_point[key] = sharp_stack(time_stack, position)
        with located("", prefix=f"camera.exposure: {sequence.id}: "):
            sequence = _expose(sequence, recipe, spec=stacks[key][1].specs[0])
        yield ResolvedSequence(sequence, *stacks[key], sensor, recipe.camera.frames, recipe.seed, of_point.get(key))


def _expose(sequence: PlannedSequence, recipe: Recipe, *, spec: StackSpec) -> PlannedSequence:
    """Return a sequence with the spikes per readout that ``spikes_per_depth`` means behind its lens.

    Raises BadInput if these are one or more.
    """
    per_depth = sequence.mean_rate
    if recipe.camera.exposure.spikes_per_depth is None or per_depth is None:
        return sequence
    low, high = spec.drive.depth_of_focus(0.5, spec.pitch_m, wavelength_m=spec.wavelength_m)
    readouts = (high - low) * recipe.camera.frames
    if not per_depth < readouts:
        raise BadInput(
            f"spikes_per_depth is {per_depth:g}, and a depth of focus passes in {readouts:.4g} readouts",
            allowed=f"less than {readouts:.4g}, as a pixel spikes once in a readout",
            hint="lower it, or record more frames",
        )
    return replace(sequence, mean_rate=per_depth / readouts)


def _check_lamps(sequence: PlannedSequence, groups: tuple[str, ...]) -> None:
    """Raise BadInput unless each light group is one lamp in light of one wavelength, which a picture can stand for."""
    lamps = list(list_lamps(sequence.schedule, groups))
    if len(lamps) != len(groups) or any(lamp.spectrum for lamp in lamps):
        what = "its lamps have spectra" if len(lamps) == len(groups) else "several lamps share a light group"
        raise BadInput(what, allowed="one lamp for each light group, in light of one wavelength")


def _resolve_stacks(
    sequence: PlannedSequence, recipe: Recipe, *, scene: Scene | PictureStack, sensor: Sensor
) -> tuple[TimeResolvedStack, TimeResolvedStack | None]:
    """Return the stack of the recording, and a separate stack for closed-loop runs, or None if they need none."""
    if isinstance(scene, PictureStack):
        return TimeResolvedStack((0,), (scene.spec(sensor),)), None
    card, frames, hz = scene.card, recipe.camera.frames, sensor.readout_hz
    render = recipe.render.of_scene(scene.id)
    with located("", prefix=f"scene {scene.id}: "):
        spec = StackSpec.from_scene(
            scene,
            sensor,
            positions=recipe.splits[sequence.split].positions or recipe.focus.positions,
            samples=render.samples,
            max_depth=render.max_depth,
            f_number=recipe.camera.exposure.f_number,
            aberrations=recipe.focus.aberrations,
            wavelength_m=0.0 if render.diffraction is False else sensor.wavelength_m,
            estimator=render.estimator,
            time_s=card.still_s if card.slices_per_s is not None else 0.0,
        )
        spec = replace(spec, margin=find_margin(spec, recipe, scene=scene, sensor=sensor))
    if sequence.scene_motion == "static":
        return TimeResolvedStack((0,), (spec.over_travel() if render.half_floats else spec,)), None
    slices_per_s = render.slices_per_s or card.slices_per_s or 0.0
    position = sequence.lens_course(frames, readout_hz=hz)[0]
    starts = slice_starts(frames, readout_hz=hz, slices_per_s=slices_per_s)
    before, after = spec.margin
    windows = [
        (first - before, last + after) for first, last in slice_windows(position, starts, positions=spec.positions)
    ]
    times = [start / hz for start in starts]
    filtered = render.estimator == "filtered"
    moments = slice_moments(times) if filtered else [()] * len(times)
    slices = (
        replace(spec, samples=render.samples_per_slice, time_s=time_s, window=window, moments_s=shading_moments)
        for time_s, window, shading_moments in zip(times, windows, moments, strict=True)
    )
    stack = TimeResolvedStack(starts, tuple(slices))
    full_travel_frames = render.all_positions_s * hz
    if full_travel_frames >= frames:
        return stack.with_full_travel(), None
    # The recording does not use the slices at all positions, because paths that are spread over all positions leave
    # more noise, and focus measures would see an edge where the noise changes.
    return stack, stack.truncated_to(full_travel_frames).with_full_travel() if full_travel_frames else None


def _read_sensor(recipe: Recipe, folder: Path) -> Sensor:
    """Return the recipe's sensor, given by name or by the path of a file relative to the recipe's folder."""
    camera = recipe.camera
    named = folder / camera.spike_sensor if is_preset_file(camera.spike_sensor) else camera.spike_sensor
    stated = {"reset": camera.reset, "saturation": camera.saturation, "filter": camera.filter}
    changes: dict[str, Any] = {key: value for key, value in stated.items() if value is not None}
    return get_sensor(named, **changes, noise=camera.noise.model_dump(exclude_none=True))


def _read_actuator(recipe: Recipe, folder: Path) -> Actuator | None:
    """Return the recipe's actuator, given by name or by the path of a file relative to the recipe's folder, if any."""
    name = recipe.focus.actuator
    if name is None:
        return None
    return get_actuator(folder / name if is_preset_file(name) else name)


def _check_given_lens(recipe: Recipe, name: str) -> None:
    """Raise BadInput if a recipe states what only a scene with a known lens and light can have."""
    exposure, focus = recipe.camera.exposure, recipe.focus
    stated = {
        "camera.exposure.absolute": exposure.absolute, "camera.exposure.f_number": exposure.f_number,
        "camera.exposure.spikes_per_depth": exposure.spikes_per_depth,
        "focus.drive": focus.drive, "focus.aberrations": focus.aberrations, "focus.axial_colour": focus.axial_colour,
    }  # fmt: skip
    for key, value in stated.items():
        if value:
            raise BadInput(
                f"{key} is given, and scene {name!r} was photographed, by a lens and in light that nobody knows",
                allowed=f"recipes without {key}, with a mean_rate", hint=f"or leave {name} out",
            )  # fmt: skip


def _check_drive(recipe: Recipe, scene: Scene) -> None:
    drives = sorted({lens.drive for lens in scene.card.lenses.values()} or {scene.card.lens.drive})
    if recipe.focus.drive is not None and drives != [recipe.focus.drive]:
        raise BadInput(
            f"the recipe asks for the drive {recipe.focus.drive!r}; scene {scene.id!r} has another",
            allowed=", ".join(drives),
            hint="or leave focus.drive out: each scene then has its own",
        )


def recipe_digest(resolved: ResolvedRecipe) -> str:
    """Return the SHA-256 of everything that determines the spikes of a recipe, in every split.

    It covers the recipe, the members and files of its scenes, the sensor, and the versions of the models of lens, light
    and sensor. It does not cover the renderer, because LLVM and CUDA differ in the last digits of a picture
    (docs/renderer.md#grain).
    """
    decisive = [
        (s.fingerprint(""), [spec.key for spec in s.closed_loop_stack.specs] if s.closed_loop_stack else [])
        for s in resolved.all_sequences
    ]
    return hashlib.sha256(json.dumps([resolved.recipe.name, decisive]).encode()).hexdigest()


def _benchmark(resolved: ResolvedRecipe) -> str:
    """Return the name and digest of a recipe's frozen benchmark, as streams store them; '' if it has no such benchmark.

    Raises BadInput if the recipe has the name of a frozen benchmark but would give different spikes.
    """
    name = resolved.recipe.name
    frozen = read_frozen_digests().get(name)
    if frozen is None:
        return ""
    digest = recipe_digest(resolved)
    if digest != frozen.digest:
        raise BadInput(
            f"the benchmark {name!r} is frozen, but this recipe would give different spikes: digest {digest:.12}…",
            allowed=f"{frozen.digest:.12}…, as on {frozen.since}",
            hint="give the recipe another name, or use the recipe and the scenes that come with saf_gen",
        )
    return f"{name} {digest}"


MIN_POSITIONS = 2.0
"""Minimum number of focus positions per depth of focus; with two, there is always one within a quarter of the depth of
focus. Recipes that come with saf_gen have 2.4 to 10.5."""


def coarse_sampling(resolved: ResolvedRecipe) -> list[str]:
    """Return a line for each scene with too few focus positions or fewer time slices than its card states, and for each
    role that a light means and scenes lack; of stacks that were photographed, what is known of them.
    """
    roles = missing_roles(resolved.sequences, resolved.recipe.lights)
    given = [scene.remark for scene in resolved.scenes.values() if isinstance(scene, PictureStack)]
    return [*given, *_find_coarse_positions(resolved), *_find_coarse_slices(resolved), *roles]


def _find_coarse_positions(resolved: ResolvedRecipe) -> list[str]:
    """Return a line for each scene with too few positions in the depth of focus at the middle of the travel.

    Of the lenses of a family, that with the fewest counts.
    """
    fewest: dict[str, tuple[float, float, int]] = {}
    for sequence in resolved.sequences:
        spec = sequence.time_stack.specs[0]
        if spec.estimator == PICTURES:
            continue
        low, high = spec.drive.depth_of_focus(0.5, spec.pitch_m, wavelength_m=spec.wavelength_m)
        found = ((high - low) * (spec.positions - 1), high - low, spec.positions)
        fewest[spec.scene] = min(fewest.get(spec.scene, found), found)
    lines = []
    for name, (count, width, positions) in fewest.items():
        if count < MIN_POSITIONS:
            enough = math.ceil(MIN_POSITIONS / width) + 1
            lines.append(
                f"focus.positions is {positions}: the depth of focus of {name} contains only {count:.1f} of them, "
                f"so focus curves show steps; use {enough} or more"
            )
    return lines


def _find_coarse_slices(resolved: ResolvedRecipe) -> list[str]:
    """Return a line for each moving scene with fewer time slices per second in the recipe than on its card."""
    rate = resolved.recipe.render.slices_per_s
    moving = {s.scene.id: s.scene.card for s in resolved.sequences if s.time_stack.is_moving}
    lines = []
    for name, card in moving.items():
        if rate is None or card.slices_per_s is None or rate >= card.slices_per_s:
            continue
        error = card.estimate_interpolation_error(rate)
        lines.append(
            f"render.slices_per_s is {rate:g}: half way between two time slices {name} is shown as a mixture of both"
            + ("" if error is None else f", with an error of about {error:.2g} of the mean brightness")
            + f"; its card states {card.slices_per_s:g}"
            + ("" if error is None else f", for an error of {card.interpolation_error:g}")
        )
    return lines
