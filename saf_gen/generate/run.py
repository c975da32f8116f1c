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
from saf_gen.authoring.preview import write_preview
from saf_gen.core import seeds
from saf_gen.core.cores import defer_interrupts, usable_cores
from saf_gen.core.files import remove_stale_temporaries
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.generate.dataset_card import write_dataset_card
from saf_gen.generate.executor import Job, ReportProgress, run_jobs
from saf_gen.generate.jobs import RecordJob, RenderJob
from saf_gen.generate.plan import PlannedSequence, recipe_fingerprint
from saf_gen.generate.recorder import Recorder
from saf_gen.generate.resolve import ResolvedRecipe, sequence_fingerprint, stack_digests
from saf_gen.stack.focal_stack import StackStore
from saf_gen.stack.time_resolved import TimeResolvedStack
from saf_gen.stream.manifest import Manifest, SequenceEntry, read_manifest, write_manifest
from saf_gen.stream.stream_file import open_stream

__all__ = ["GenerationResult", "generate"]

BACKENDS = ("auto", "cuda", "llvm", "scalar")
PACKAGES = ("mitsuba", "drjit", "numpy", "numba", "h5py", "isal", "OpenEXR")


@dataclass(frozen=True)
class GenerationResult:
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
    work: ResolvedRecipe,
    folder: str | Path | None = None,
    *,
    workers: int = 1,
    variant: str = "auto",
    cluster: str | None = None,
    report: ReportProgress = lambda name, done: None,
) -> GenerationResult:
    """Make the dataset, or what of it is missing, in ``folder`` (default: datasets/ and the recipe's name).

    Stopped at any moment and started again, it goes on: finished stacks and sequences are verified and
    kept, half-finished ones were never given their names.

    Raises BadInput before anything is made; what fails on the way is in the outcome.
    """
    if variant not in BACKENDS:
        raise unknown("variant", variant, BACKENDS)
    folder = (Path(folder) if folder is not None else Path("datasets") / work.recipe.name).resolve()
    stacks = folder / "stacks"
    to_render = work.stacks_to_render(folder)
    chosen = _choose_backend(variant) if to_render else variant
    _check_folder(work, folder)
    if cluster is None and len(work.sequences) == len(work.plan):
        remove_stale_temporaries(folder)  # a shard or a cluster has neighbours at work in the folder
    recorder = Recorder(
        sensor=work.sensor,
        frames=work.recipe.camera.frames,
        device_seed=seeds.derive_seed(work.recipe.seed, "device"),
        provenance=_provenance(work),
    )
    threads = max(1, usable_cores() // workers)

    def record_jobs(time_stack: TimeResolvedStack, sequences: list[PlannedSequence]) -> Iterator[RecordJob]:
        digest = time_stack.digest(stacks)
        for s in sequences:
            yield RecordJob(
                recorder,
                s,
                time_stack,
                stacks,
                folder / s.file,
                sequence_fingerprint(work, s, digest),
                threads,
            )

    recordings = work.sequences_by_stack()

    def follow_up(job: Job, result: Any) -> Iterable[Job]:
        return (
            record_jobs(job.time_stack, recordings.get(job.time_stack, []))
            if isinstance(job, RenderJob)
            else ()
        )

    at_once: list[Job] = [
        RenderJob(
            work.stack_label(time_stack, sequences),
            work.member(sequences[0]),
            time_stack,
            stacks,
            chosen,
            usable_cores(),
        )
        for time_stack, sequences in to_render.items()
    ]
    for time_stack, sequences in recordings.items():
        if time_stack not in to_render:
            at_once += record_jobs(time_stack, sequences)
    rendered: list[str] = []
    recorded: list[str] = []
    kept: list[str] = []
    failed: dict[str, SafGenError] = {}
    for job, result, error in run_jobs(
        at_once, workers=workers, report=report, follow_up=follow_up, address=cluster
    ):
        if error is not None:
            failed[job.name] = error
        elif isinstance(job, RenderJob):
            rendered += [f"{job.label} · {piece}" for piece in result]
        else:
            (kept if result.kept else recorded).append(job.sequence.id)
    manifest = _write_manifest_of(work, folder)
    _preview(work, folder)
    return GenerationResult(folder, manifest, rendered, recorded, kept, failed)


def _choose_backend(requested: str) -> str:
    with defer_interrupts():
        from saf_gen.render import backend  # loads Mitsuba: only where something must be rendered

    return backend.choose_backend(requested, backend.probe_backends())


def _provenance(work: ResolvedRecipe) -> dict[str, str]:
    versions = {"saf_gen": saf_gen.__version__, "python": platform.python_version()}
    versions |= {name: version(name) for name in PACKAGES}
    return {
        "recipe": yaml.safe_dump(work.recipe.model_dump(mode="json"), sort_keys=False),
        "recipe_fingerprint": recipe_fingerprint(work.recipe),
        "sensor": yaml.safe_dump(asdict(work.sensor), sort_keys=False),
        "versions": json.dumps(versions, indent=1),
    }


def _check_folder(work: ResolvedRecipe, folder: Path) -> None:
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
    needed, free = work.estimate_bytes(folder), shutil.disk_usage(folder).free
    if needed > free:
        raise BadInput(
            f"the dataset needs about {needed / 1e6:,.0f} MB in {folder}, {free / 1e6:,.0f} MB are free",
            hint="free some, or give another folder with --out",
        )


def _preview(work: ResolvedRecipe, folder: Path) -> None:
    """A contact sheet of every scene at rest whose focal stack is whole and has none yet."""
    for time_stack in work.sequences_by_stack():
        spec = time_stack.specs[0]
        sheet = folder / "preview" / f"{spec.key}.png"
        store = StackStore(folder / "stacks", spec)
        if not (time_stack.is_moving or sheet.exists() or store.missing_pieces()):
            write_preview(store.load(), work.sensor, sheet)


def _write_manifest_of(work: ResolvedRecipe, folder: Path) -> Manifest:
    """Write manifest.json and README.md over the finished sequences of the recipe, other shards' too.

    Read from the files themselves: nothing is listed that this recipe would make otherwise, and shards that
    end at the same time cannot lose each other's.
    """
    stacks = folder / "stacks"
    digests = stack_digests(work, work.plan, stacks)
    entries = (_entry(work, folder, s, digests.get(s.id)) for s in work.plan)
    specs = (spec for time_stack in work.sequences_by_stack() for spec in time_stack.specs)
    variants = set().union(*(StackStore(stacks, spec).backends() for spec in specs))
    manifest = Manifest(
        name=work.recipe.name,
        recipe_fingerprint=recipe_fingerprint(work.recipe),
        variant=", ".join(sorted(variants)),
        sequences=tuple(entry for entry in entries if entry is not None),
    )
    write_manifest(folder, manifest)
    write_dataset_card(folder, work.recipe, manifest, [s.card for s in work.scenes.values()])
    return manifest


def _entry(
    work: ResolvedRecipe, folder: Path, sequence: PlannedSequence, stack: str | None
) -> SequenceEntry | None:
    """The sequence's line in the manifest; None where its file is missing, cut, or of another recipe.

    ``stack`` is the digest of what it films; where that has been deleted (None) the file's own word counts.
    """
    try:
        with open_stream(folder / sequence.file) as stream:
            said, content = stream.metadata.provenance, stream.content_sha256
    except BadInput:
        return None
    wanted = sequence_fingerprint(work, sequence, said.get("stack_digest", "") if stack is None else stack)
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
