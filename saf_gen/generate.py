"""Recipe to dataset: plan, render what is missing, record what is missing, list what is there."""

import json
import os
import platform
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

import saf_gen
from saf_gen import seeds
from saf_gen.card import write_card
from saf_gen.cluster import Job, Tell, run_jobs
from saf_gen.dataset import Manifest, SequenceEntry, read_manifest, write_manifest
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.files import clear_abandoned
from saf_gen.focal_stack import StackStore
from saf_gen.host import cores, uninterrupted
from saf_gen.jobs import RecordJob, RenderJob
from saf_gen.plan import Sequence, recipe_fingerprint
from saf_gen.preview import write_preview
from saf_gen.record import Recorder
from saf_gen.reel import Reel
from saf_gen.stream import open_stream
from saf_gen.work import Work, fingerprint, reel_digests

__all__ = ["Outcome", "generate"]

VARIANTS = ("auto", "cuda", "llvm", "scalar")
PACKAGES = ("mitsuba", "drjit", "numpy", "numba", "h5py", "isal", "OpenEXR")


@dataclass(frozen=True)
class Outcome:
    """What a run did: pieces of stacks rendered, sequences recorded and kept, failures by name."""

    folder: Path
    manifest: Manifest
    rendered: list[str]
    recorded: list[str]
    kept: list[str]
    failed: dict[str, SafGenError]

    @property
    def exit_code(self) -> int:
        """0 all well; 1 some sequences failed; 2 nothing could be made, for bad input alone."""
        if not self.failed:
            return 0
        bad_input = all(isinstance(error, BadInput) for error in self.failed.values())
        return 2 if bad_input and not (self.recorded or self.kept) else 1


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
    to_render = work.to_render(folder)
    chosen = _variant(variant) if to_render else variant
    _check_folder(work, folder)
    if cluster is None and len(work.sequences) == len(work.plan):
        clear_abandoned(folder)  # a shard or a cluster has neighbours at work in the folder
    recorder = Recorder(
        sensor=work.sensor,
        frames=work.recipe.camera.frames,
        device_seed=seeds.integer(work.recipe.seed, "device"),
        provenance=_provenance(work),
    )
    threads = max(1, cores() // workers)

    def record_jobs(reel: Reel, films: list[Sequence]) -> Iterator[RecordJob]:
        digest = reel.digest(stacks)
        for s in films:
            yield RecordJob(recorder, s, reel, stacks, folder / s.file, fingerprint(work, s, digest), threads)

    recordings = work.reels()

    def then(job: Job, result: Any) -> Iterable[Job]:
        return record_jobs(job.reel, recordings.get(job.reel, [])) if isinstance(job, RenderJob) else ()

    at_once: list[Job] = [
        RenderJob(work.name_of(reel, films), work.member(films[0]), reel, stacks, chosen, cores())
        for reel, films in to_render.items()
    ]
    for reel, films in recordings.items():
        if reel not in to_render:
            at_once += record_jobs(reel, films)
    rendered: list[str] = []
    recorded: list[str] = []
    kept: list[str] = []
    failed: dict[str, SafGenError] = {}
    for job, result, error in run_jobs(at_once, workers=workers, tell=tell, then=then, address=cluster):
        if error is not None:
            failed[job.name] = error
        elif isinstance(job, RenderJob):
            rendered += [f"{job.take} · {piece}" for piece in result]
        else:
            (kept if result.kept else recorded).append(job.sequence.id)
    manifest = _list(work, folder)
    _preview(work, folder)
    return Outcome(folder, manifest, rendered, recorded, kept, failed)


def _variant(requested: str) -> str:
    with uninterrupted():
        from saf_gen.render import variant  # loads Mitsuba: only where something must be rendered

    return variant.choose(requested, variant.probe())


def _provenance(work: Work) -> dict[str, str]:
    versions = {"saf_gen": saf_gen.__version__, "python": platform.python_version()}
    versions |= {name: version(name) for name in PACKAGES}
    return {
        "recipe": yaml.safe_dump(work.recipe.model_dump(mode="json"), sort_keys=False),
        "recipe_fingerprint": recipe_fingerprint(work.recipe),
        "sensor": yaml.safe_dump(asdict(work.sensor), sort_keys=False),
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
            f"the dataset needs about {needed / 1e6:,.0f} MB in {folder}, {free / 1e6:,.0f} MB are free",
            hint="free some, or give another folder with --out",
        )


def _preview(work: Work, folder: Path) -> None:
    """A contact sheet of every scene at rest whose focal stack is whole and has none yet."""
    for reel in work.reels():
        spec = reel.specs[0]
        sheet = folder / "preview" / f"{spec.key}.png"
        store = StackStore(folder / "stacks", spec)
        if not (reel.moves or sheet.exists() or store.missing()):
            write_preview(store.load(), work.sensor, sheet)


def _list(work: Work, folder: Path) -> Manifest:
    """Write manifest.json and README.md over the finished sequences of the recipe, other shards' too.

    Read from the files themselves: nothing is listed that this recipe would make otherwise, and shards that
    end at the same time cannot lose each other's.
    """
    stacks = folder / "stacks"
    digests = reel_digests(work, work.plan, stacks)
    entries = (_entry(work, folder, s, digests.get(s.id)) for s in work.plan)
    specs = (spec for reel in work.reels() for spec in reel.specs)
    variants = set().union(*(StackStore(stacks, spec).variants() for spec in specs))
    manifest = Manifest(
        name=work.recipe.name,
        recipe_fingerprint=recipe_fingerprint(work.recipe),
        variant=", ".join(sorted(variants)),
        sequences=tuple(entry for entry in entries if entry is not None),
    )
    write_manifest(folder, manifest)
    write_card(folder, work.recipe, manifest, [s.card for s in work.scenes.values()])
    return manifest


def _entry(work: Work, folder: Path, sequence: Sequence, stack: str | None) -> SequenceEntry | None:
    """The sequence's line in the manifest; None where its file is missing, cut, or of another recipe.

    ``stack`` is the digest of what it films; where that has been deleted (None) the file's own word counts.
    """
    try:
        with open_stream(folder / sequence.file) as stream:
            said, content = stream.metadata.provenance, stream.content_sha256
    except BadInput:
        return None
    wanted = fingerprint(work, sequence, said.get("stack_digest", "") if stack is None else stack)
    if said.get("fingerprint") != wanted:
        return None
    return SequenceEntry(
        id=sequence.id,
        split=sequence.split,
        scene=sequence.scene,
        variant=sequence.variant,
        scene_motion=sequence.scene_motion,
        lens_motion=sequence.motion["kind"],
        light=sequence.light,
        repeat=sequence.repeat,
        seed=sequence.seed,
        file=sequence.file,
        frames=work.recipe.camera.frames,
        fingerprint=wanted,
        content_sha256=content,
    )
