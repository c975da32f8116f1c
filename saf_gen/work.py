"""A recipe with everything found and checked: its scenes, their stacks, the sensor, the sequences to make.

What stands here decides; :mod:`saf_gen.generate` does it.
"""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from saf_gen.camera import Sensor, get_sensor, is_sensor_file
from saf_gen.errors import BadInput, unknown
from saf_gen.focal_stack import StackSpec
from saf_gen.motions import readout_positions
from saf_gen.plan import Family, Sequence, make_plan, shard
from saf_gen.recipe import Recipe, read_recipe
from saf_gen.record import MODEL, group_gains
from saf_gen.reel import Reel, moments, windows
from saf_gen.scene import Scene, find_scene

__all__ = ["Work", "fingerprint", "prepare", "reel_digests"]

STREAM_BITS = 0.4  # a pixel and frame of a stream, on the safe side
# Two cores of 2.8 GHz with LLVM: paths traced and splatted; pixel·frames encoded, stored and verified;
# seconds to load a scene, each light group of each stack; to sum and store a pixel at a position.
PATHS_A_SECOND, SPIKES_A_SECOND, LOAD_SECONDS, PLANE_SECONDS = 2.5e6, 0.7e9, 0.3, 8e-8


@dataclass(frozen=True)
class Work:
    """A recipe with everything found and checked, before anything is made."""

    recipe: Recipe
    sequences: list[Sequence]
    scenes: dict[str, Scene]
    sensor: Sensor

    @property
    def plan(self) -> list[Sequence]:
        """All sequences of the recipe, those of other shards too."""
        return _plan(self.recipe, self.scenes)

    def member(self, sequence: Sequence) -> Scene:
        """The member of its scene's family that a sequence films."""
        return self.scenes[sequence.scene].with_params(sequence.params)

    def reel(self, sequence: Sequence) -> Reel:
        """The focal stacks that a sequence films."""
        spec = _spec(self.recipe, self.member(sequence), self.sensor)
        if sequence.scene_motion == "static":
            return Reel((0,), (spec,))
        card, hz = self.scenes[sequence.scene].card, self.sensor.readout_hz
        a_second = self.recipe.render.slices_per_s or card.slices_per_s or 0.0
        position = readout_positions(sequence.motion, self.recipe.camera.frames, hz)
        at = moments(position.size, hz, a_second)
        slices = (
            replace(spec, samples=self.recipe.render.samples_a_slice, time_s=frame / hz, window=window)
            for frame, window in zip(at, windows(position, at, spec.positions), strict=True)
        )
        reel = Reel(at, tuple(slices))
        return reel.whole() if self.recipe.render.whole_s * hz >= position.size else reel

    def live_reel(self, sequence: Sequence) -> Reel | None:
        """The focal stacks that the closed loop films, where the recording is not made of them.

        Not one reel for both, whole in the beginning and not after it: of paths that are spread over all
        positions more noise is left, and where it changes focus measures see an edge.
        """
        reel, frames = self.reel(sequence), self.recipe.render.whole_s * self.sensor.readout_hz
        if not reel.moves or frames == 0 or frames >= self.recipe.camera.frames:
            return None
        return reel.until(frames).whole()

    def reels(self) -> dict[Reel, list[Sequence]]:
        """Every reel that the sequences film, each once, with those that film it."""
        found: dict[Reel, list[Sequence]] = {}
        for sequence in self.sequences:
            found.setdefault(self.reel(sequence), []).append(sequence)
        return found

    def to_render(self, folder: Path) -> dict[Reel, list[Sequence]]:
        """The reels of which something is still to be rendered in this dataset folder; the recorded first."""
        reels = self.reels()
        for sequence in self.sequences:
            if (live := self.live_reel(sequence)) is not None:
                reels.setdefault(live, []).append(sequence)
        return {reel: films for reel, films in reels.items() if reel.missing(folder / "stacks")}

    def name_of(self, reel: Reel, films: list[Sequence]) -> str:
        """What people call the stacks of a reel."""
        every = reel.moves and reel == reel.whole()
        return f"{films[0].take}{', all positions' if every else ''}"

    def bytes_expected(self, folder: Path) -> int:
        """Disk that the work still to do will take, about, a little on the safe side."""
        pixels = self.sensor.rows * self.sensor.columns
        missing = self._missing(folder)
        rendered = sum(len(s.groups) * s.rendered * pixels * (2 if s.window else 4) for s in missing)
        to_record = sum(not (folder / s.file).exists() for s in self.sequences)
        return rendered + int(to_record * pixels * self.recipe.camera.frames * STREAM_BITS / 8)

    def seconds_expected(self, folder: Path) -> float:
        """Time that the work still to do will take, roughly, on two cores with LLVM."""
        pixels = self.sensor.rows * self.sensor.columns
        specs = self._missing(folder)
        rendering = sum(
            len(s.groups)
            * (LOAD_SECONDS + pixels * (s.samples / PATHS_A_SECOND + s.rendered * PLANE_SECONDS))
            for s in specs
        )
        to_record = sum(not (folder / s.file).exists() for s in self.sequences)
        return rendering + to_record * pixels * self.recipe.camera.frames / SPIKES_A_SECOND

    def _missing(self, folder: Path) -> set[StackSpec]:
        return {spec for reel in self.to_render(folder) for spec in reel.missing(folder / "stacks")}


def prepare(recipe_path: str | Path, *, part: tuple[int, int] = (1, 1), split: str | None = None) -> Work:
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
    schedules: dict[str, Sequence] = {}  # drawn once for many: constant light is the same everywhere
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
    motions: dict[str, Sequence] = {}  # most often all move alike
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
    return Work(recipe, shard(wanted, *part), scenes, sensor)


def _plan(recipe: Recipe, scenes: dict[str, Scene]) -> list[Sequence]:
    families = {
        name: Family(scene.card.params, scene.card.slices_per_s is not None, scene.card.illuminance_lux)
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
        drive=scene.drive(recipe.camera.exposure.f_number),
        rows=sensor.rows,
        columns=sensor.columns,
        pitch_m=sensor.pitch_m,
        positions=recipe.focus.positions,
        samples=recipe.render.samples,
        max_depth=recipe.render.max_depth,
        params=json.dumps(dict(scene.params), sort_keys=True),
        time_s=scene.card.still_s if scene.card.slices_per_s is not None else 0.0,
    )


def reel_digests(work: Work, sequences: Iterable[Sequence], stacks: Path) -> dict[str, str]:
    """By sequence, the digest of the stacks that it films, where they are whole."""
    made: dict[Reel, str] = {}
    out = {}
    for sequence in sequences:
        reel = work.reel(sequence)
        if reel not in made:
            made[reel] = "" if reel.missing(stacks) else reel.digest(stacks)
        if made[reel]:
            out[sequence.id] = made[reel]
    return out


def fingerprint(work: Work, sequence: Sequence, stack_digest: str) -> str:
    """Digest of everything that decides a sequence's numbers: an old file is never taken for it."""
    reel, sensor = work.reel(sequence), asdict(work.sensor)
    del sensor["name"], sensor["sources"]  # words, not numbers
    decisive = {
        "model": MODEL,
        "sequence": asdict(sequence),
        "stack": [[spec.key for spec in reel.specs], reel.frames, stack_digest],
        "sensor": sensor,
        "frames": work.recipe.camera.frames,
        "seed": work.recipe.seed,
    }
    return hashlib.sha256(json.dumps(decisive, sort_keys=True).encode()).hexdigest()
