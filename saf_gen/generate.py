"""Recipe to dataset: plan, render what is missing, record what is missing, list what is there."""

import hashlib
import json
import os
import platform
import shutil
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import yaml

import saf_gen
from saf_gen import seeds
from saf_gen.camera import Sensor, get_sensor
from saf_gen.card import write_card
from saf_gen.cluster import Tell, run_jobs
from saf_gen.dataset import Manifest, SequenceEntry, read_manifest, write_manifest
from saf_gen.errors import BadInput, unknown
from saf_gen.files import clear_abandoned
from saf_gen.focal_stack import StackSpec, StackStore
from saf_gen.host import cores
from saf_gen.jobs import RecordJob, RenderJob
from saf_gen.plan import Sequence, make_plan, recipe_fingerprint, shard
from saf_gen.preview import write_preview
from saf_gen.recipe import Recipe, read_recipe
from saf_gen.record import MODEL, Recorder, group_gains
from saf_gen.scene import Scene, find_scene
from saf_gen.stream import open_stream

__all__ = ["Outcome", "Work", "generate", "prepare"]

VARIANTS = ("auto", "cuda", "llvm", "scalar")
PACKAGES = ("mitsuba", "drjit", "numpy", "numba", "h5py", "isal", "OpenEXR")
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


@dataclass(frozen=True)
class Outcome:
    """What a run did: pieces of stacks rendered, sequences recorded and kept, failures by name."""

    folder: Path
    manifest: Manifest
    rendered: list[str]
    recorded: list[str]
    kept: list[str]
    failed: dict[str, str]


def prepare(recipe_path: str | Path, *, part: tuple[int, int] = (1, 1)) -> Work:
    """Read a recipe, find its scenes and sensor, draw its sequences, and check that they fit together.

    ``part`` is (I, N): only every N-th sequence from the I-th on.

    Raises BadInput for whatever does not fit; nothing has been written then.
    """
    recipe = read_recipe(recipe_path)
    sensor = _sensor(recipe)
    scenes = {name: find_scene(name) for split in recipe.splits.values() for name in split.scenes}
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


def generate(
    work: Work,
    folder: str | Path | None = None,
    *,
    workers: int = 1,
    variant: str = "auto",
    cluster: str | None = None,
    tell: Tell = lambda name, done: None,
) -> Outcome:
    """Make the dataset, or what of it is missing, in ``folder`` (default: datasets/ and the recipe's name).

    Stopped at any moment and started again, it goes on: finished stacks and sequences are verified and
    kept, half-finished ones were never given their names.

    Raises BadInput before anything is made; what fails on the way is in the outcome.
    """
    if variant not in VARIANTS:
        raise unknown("variant", variant, VARIANTS)
    folder = (Path(folder) if folder is not None else Path("datasets") / work.recipe.name).resolve()
    stacks = folder / "stacks"
    to_render = work.stacks_missing(folder)
    chosen = _variant(variant) if to_render else variant
    _check_folder(work, folder)
    if cluster is None and len(work.sequences) == len(make_plan(work.recipe)):
        clear_abandoned(folder)  # a shard or a cluster has neighbours at work in the folder
    render_jobs = [RenderJob(work.scenes[s], work.specs[s], stacks, chosen, cores()) for s in to_render]
    rendered: list[str] = []
    failed: dict[str, str] = {}
    # One scene at a time: a render takes every core by itself.
    for job, pieces, error in run_jobs(render_jobs, workers=1, tell=tell, address=cluster):
        if error:
            failed[job.name] = error
        else:
            rendered += [f"{job.scene.id} · {piece}" for piece in pieces]
    prints = _fingerprints(work, stacks)
    recorder = Recorder(
        sensor=work.sensor,
        frames=work.recipe.camera.frames,
        device_seed=seeds.integer(work.recipe.seed, "device"),
        provenance=_provenance(work.recipe),
    )
    threads = max(1, cores() // workers)
    record_jobs = [
        RecordJob(recorder, s, work.specs[s.scene], stacks, folder / s.file, prints[s.id], threads)
        for s in work.sequences
        if s.id in prints
    ]
    recorded: list[str] = []
    kept: list[str] = []
    for job, result, error in run_jobs(record_jobs, workers=workers, tell=tell, address=cluster):
        if error:
            failed[job.name] = error
        else:
            (kept if result.kept else recorded).append(job.sequence.id)
    manifest = _list(work, folder)
    _preview(work, folder)
    return Outcome(folder, manifest, rendered, recorded, kept, failed)


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


def _variant(requested: str) -> str:
    from saf_gen.render import variant  # loads Mitsuba: only where something must be rendered

    return variant.choose(requested, variant.probe())


def _fingerprints(work: Work, stacks: Path) -> dict[str, str]:
    """The fingerprint of every sequence of the recipe whose focal stack is whole, by id."""
    stores = {name: StackStore(stacks, spec) for name, spec in work.specs.items()}
    digests = {name: store.digest() for name, store in stores.items() if not store.missing()}
    planned = (s for s in make_plan(work.recipe) if s.scene in digests)
    return {s.id: _fingerprint(work, s, digests[s.scene]) for s in planned}


def _fingerprint(work: Work, sequence: Sequence, stack_digest: str) -> str:
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


def _provenance(recipe: Recipe) -> dict[str, str]:
    versions = {"saf_gen": saf_gen.__version__, "python": platform.python_version()}
    versions |= {name: version(name) for name in PACKAGES}
    return {
        "recipe": yaml.safe_dump(recipe.model_dump(mode="json"), sort_keys=False),
        "recipe_fingerprint": recipe_fingerprint(recipe),
        "versions": json.dumps(versions, indent=1),
    }


def _check_folder(work: Work, folder: Path) -> None:
    if (folder / "manifest.json").exists():
        there = read_manifest(folder).name
        if there != work.recipe.name:
            raise BadInput(
                f"{folder} holds the dataset {there!r}, the recipe makes {work.recipe.name!r}",
                hint="give another folder with --out",
            )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".writable.{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise BadInput(
            f"{folder} cannot be written: {error.strerror}", hint="give another folder with --out"
        ) from error
    needed, free = work.bytes_expected(folder), shutil.disk_usage(folder).free
    if needed > free:
        raise BadInput(
            f"the dataset needs about {needed / 1e9:.1f} GB in {folder}, {free / 1e9:.1f} GB are free",
            hint="free some, or give another folder with --out",
        )


def _preview(work: Work, folder: Path) -> None:
    """A contact sheet of every focal stack that is whole and has none yet."""
    for spec in {s.scene: work.specs[s.scene] for s in work.sequences}.values():
        sheet = folder / "preview" / f"{spec.key}.png"
        store = StackStore(folder / "stacks", spec)
        if not sheet.exists() and not store.missing():
            write_preview(store.load(), sheet)


def _list(work: Work, folder: Path) -> Manifest:
    """Write manifest.json and README.md over the finished sequences of the recipe, other shards' too.

    Read from the files themselves: nothing is listed that this recipe would make otherwise, and shards that
    end at the same time cannot lose each other's.
    """
    prints = _fingerprints(work, folder / "stacks")
    entries = (_entry(work, folder, s, prints[s.id]) for s in make_plan(work.recipe) if s.id in prints)
    variants = set().union(*(StackStore(folder / "stacks", spec).variants() for spec in work.specs.values()))
    manifest = Manifest(
        name=work.recipe.name,
        recipe_fingerprint=recipe_fingerprint(work.recipe),
        variant=", ".join(sorted(variants)),
        sequences=tuple(entry for entry in entries if entry is not None),
    )
    write_manifest(folder, manifest)
    write_card(folder, work.recipe, manifest, [s.card for s in work.scenes.values()])
    return manifest


def _entry(work: Work, folder: Path, sequence: Sequence, fingerprint: str) -> SequenceEntry | None:
    """The sequence's line in the manifest; None where its file is missing, cut, or of another recipe."""
    try:
        with open_stream(folder / sequence.file) as stream:
            if stream.metadata.provenance.get("fingerprint") != fingerprint:
                return None
            digest = stream.content_sha256
    except BadInput:
        return None
    return SequenceEntry(
        id=sequence.id,
        split=sequence.split,
        scene=sequence.scene,
        light=sequence.light,
        repeat=sequence.repeat,
        seed=sequence.seed,
        file=sequence.file,
        frames=work.recipe.camera.frames,
        fingerprint=fingerprint,
        content_sha256=digest,
    )
