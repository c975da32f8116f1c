"""From a recipe to a dataset: render what is missing, record what is missing, list what is there."""

import json
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
from saf_gen.core.files import check_writable, remove_stale_temporaries
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.generate.dataset_card import write_dataset_card
from saf_gen.generate.executor import Job, ReportProgress, run_generation_jobs
from saf_gen.generate.jobs import RecordJob, RenderJob
from saf_gen.generate.plan import recipe_fingerprint
from saf_gen.generate.recorder import Recorder
from saf_gen.generate.resolve import ResolvedRecipe, ResolvedSequence
from saf_gen.stack.focal_stack import StackStore
from saf_gen.stack.time_resolved import TimeResolvedStack
from saf_gen.stream.manifest import Manifest, SequenceEntry, read_manifest, write_manifest
from saf_gen.stream.stream_file import open_stream

BACKENDS = ("auto", "cuda", "llvm", "scalar")
PACKAGES = ("mitsuba", "drjit", "numpy", "numba", "h5py", "isal", "OpenEXR")


@dataclass(frozen=True)
class GenerationResult:
    """What one run made: pieces of stacks rendered, sequences recorded and kept, and failures by job name.

    ``without_diffraction`` says that the renderer left waves out although the recipe does not ask for that.
    """

    folder: Path
    manifest: Manifest
    rendered: list[str]
    recorded: list[str]
    kept: list[str]
    failed: dict[str, SafGenError]
    without_diffraction: bool = False

    @property
    def exit_code(self) -> int:
        """0: no failure; 1: some sequences failed; 2: nothing could be made, because of bad input alone."""
        if not self.failed:
            return 0
        bad_input = all(isinstance(error, BadInput) for error in self.failed.values())
        return 2 if bad_input and not (self.recorded or self.kept) else 1


def generate(
    resolved: ResolvedRecipe,
    folder: str | Path | None = None,
    *,
    workers: int = 1,
    variant: str = "auto",
    cluster: str | None = None,
    report: ReportProgress = lambda name, done: None,
) -> GenerationResult:
    """Make a dataset, or what is missing of it.

    A run may be stopped at any moment and started again: finished stacks and sequences are verified and kept,
    unfinished files never got their names. Failures of single jobs are in the result.

    Parameters
    ----------
    resolved : what :func:`saf_gen.generate.resolve.resolve_recipe` returns.
    folder : the dataset's folder; by default ``datasets`` and the recipe's name.
    workers : sequences recorded at a time.
    variant : the rendering backend: "auto", "cuda", "llvm" or "scalar".
    cluster : address of a Dask scheduler to run on, instead of this machine's cores.
    report : is called with the name of a job and the fraction of it that is done, 0...1.

    Raises
    ------
    BadInput : before anything is made: for a backend that cannot run here, and a folder that cannot be used.
    """
    if variant not in BACKENDS:
        raise unknown("variant", variant, allowed=BACKENDS)
    folder = (Path(folder) if folder is not None else Path("datasets") / resolved.recipe.name).resolve()
    stacks = folder / "stacks"
    to_render = _find_work(resolved, folder)
    backend_name, renders_waves = _choose_backend(variant) if to_render else (variant, True)
    leave_out = not renders_waves and resolved.recipe.render.diffraction is not False
    if leave_out:
        if resolved.recipe.render.diffraction:
            raise BadInput(
                f"variant {backend_name} cannot render diffraction, which the recipe asks for",
                allowed="llvm, cuda",
                hint="or leave waves out with render: {diffraction: false}",
            )
        resolved = resolved.without_diffraction()
        to_render = _find_work(resolved, folder)
    _check_folder(resolved, folder)
    if cluster is None and len(resolved.sequences) == len(resolved.plan):
        remove_stale_temporaries(folder)  # a shard or a cluster has neighbours at work in the folder
    recorder = Recorder(
        sensor=resolved.sensor,
        frames=resolved.recipe.camera.frames,
        device_seed=seeds.derive_seed(resolved.recipe.seed, "device"),
        provenance=_provenance(resolved),
    )
    threads = max(1, usable_cores() // workers)
    by_stack = resolved.sequences_by_stack()

    def record_jobs(stack: TimeResolvedStack) -> Iterator[RecordJob]:
        users = by_stack.get(stack, [])
        digest = stack.digest(stacks) if users else ""
        for s in users:
            path, fingerprint = folder / s.planned.file, s.fingerprint(digest)
            yield RecordJob(recorder, s.planned, stack, stacks, path, fingerprint, threads)

    def follow_up(job: Job, result: Any) -> Iterable[Job]:
        return record_jobs(job.time_stack) if isinstance(job, RenderJob) else ()

    jobs: list[Job] = []
    for stack, users in to_render.items():
        label, scene = users[0].stack_label(stack), users[0].scene
        jobs.append(RenderJob(label, scene, stack, stacks, backend_name, usable_cores(), stack in by_stack))
    for stack in by_stack:
        if stack not in to_render:
            jobs += record_jobs(stack)
    rendered: list[str] = []
    recorded: list[str] = []
    kept: list[str] = []
    failed: dict[str, SafGenError] = {}
    for job, result, error in run_generation_jobs(
        jobs, workers=workers, report=report, follow_up=follow_up, address=cluster
    ):
        if error is not None:
            failed[job.name] = error
        elif isinstance(job, RenderJob):
            rendered += [f"{job.label} · {piece}" for piece in result]
        else:
            (kept if result.kept else recorded).append(job.sequence.id)
    manifest = _write_manifest(resolved, folder)
    _write_previews(resolved, folder)
    return GenerationResult(folder, manifest, rendered, recorded, kept, failed, leave_out)


def _find_work(resolved: ResolvedRecipe, folder: Path) -> dict[TimeResolvedStack, list[ResolvedSequence]]:
    """Return the stacks that lack a piece, or their grain where they are to be recorded from, with their sequences."""
    found = resolved.stacks_to_render(folder)
    for stack, users in resolved.sequences_by_stack().items():
        if stack not in found and _lacks_grain(stack, users, folder=folder):
            found[stack] = users
    return found


def _lacks_grain(stack: TimeResolvedStack, users: list[ResolvedSequence], *, folder: Path) -> bool:
    """Return whether a stack that is to be recorded from has no grain measured, as after a run that was stopped."""
    missing = any(not (folder / sequence.planned.file).exists() for sequence in users)
    return missing and not stack.has_grain(folder / "stacks")


def _choose_backend(requested: str) -> tuple[str, bool]:
    """Return the backend to render with, and whether it renders diffraction."""
    with defer_interrupts():
        from saf_gen.render import backend  # loads Mitsuba: only where something must be rendered

    chosen = backend.choose_render_backend(requested)
    return chosen, backend.can_render_waves(chosen)


def _provenance(resolved: ResolvedRecipe) -> dict[str, str]:
    versions = {"saf_gen": saf_gen.__version__, "python": platform.python_version()}
    versions |= {name: version(name) for name in PACKAGES}
    return {
        "recipe": yaml.safe_dump(resolved.recipe.model_dump(mode="json"), sort_keys=False),
        "recipe_fingerprint": recipe_fingerprint(resolved.recipe),
        "sensor": yaml.safe_dump(asdict(resolved.sensor), sort_keys=False),
        "versions": json.dumps(versions, indent=1),
    }


def _check_folder(resolved: ResolvedRecipe, folder: Path) -> None:
    if (folder / "manifest.json").exists():
        name = read_manifest(folder).name
        if name != resolved.recipe.name:
            raise BadInput(
                f"{folder} holds the dataset {name!r}, the recipe makes {resolved.recipe.name!r}",
                hint="give another folder with --out",
            )
    check_writable(folder)
    folder.mkdir(parents=True, exist_ok=True)
    needed, free = resolved.estimate_bytes(folder), shutil.disk_usage(folder).free
    if needed > free:
        raise BadInput(
            f"the dataset needs about {needed / 1e6:,.0f} MB in {folder}, {free / 1e6:,.0f} MB are free",
            hint="free some, or give another folder with --out",
        )


def _write_previews(resolved: ResolvedRecipe, folder: Path) -> None:
    """Write a contact sheet of every still scene whose focal stack is whole and that has none yet."""
    for stack in resolved.sequences_by_stack():
        spec = stack.specs[0]
        sheet = folder / "preview" / f"{spec.key}.png"
        store = StackStore(folder / "stacks", spec)
        if not (stack.is_moving or sheet.exists() or store.missing_pieces()):
            write_preview(store.load(), resolved.sensor, path=sheet)


def _write_manifest(resolved: ResolvedRecipe, folder: Path) -> Manifest:
    """Write manifest.json and README.md over the finished sequences of the recipe, those of other shards too.

    The files themselves are read: nothing is listed that this recipe would make otherwise, and shards that
    end at the same time cannot lose each other's sequences.
    """
    stacks = folder / "stacks"
    digests: dict[TimeResolvedStack, str | None] = {}
    entries = []
    for sequence in resolved.plan:
        stack = sequence.time_stack
        if stack not in digests:
            digests[stack] = None if stack.find_missing(stacks) else stack.digest(stacks)
        entries.append(_entry(sequence, folder, stack_digest=digests[stack]))
    specs = (spec for stack in resolved.sequences_by_stack() for spec in stack.specs)
    backends: set[str] = set().union(*(StackStore(stacks, spec).backends() for spec in specs))
    manifest = Manifest(
        name=resolved.recipe.name,
        recipe_fingerprint=recipe_fingerprint(resolved.recipe),
        variant=", ".join(sorted(backends)),
        sequences=tuple(entry for entry in entries if entry is not None),
    )
    write_manifest(folder, manifest)
    write_dataset_card(folder, resolved.recipe, manifest=manifest, scenes=[s.card for s in resolved.scenes.values()])
    return manifest


def _entry(sequence: ResolvedSequence, folder: Path, *, stack_digest: str | None) -> SequenceEntry | None:
    """Return a sequence's line in the manifest; None where its file is missing, cut, or of another recipe.

    ``stack_digest`` is None where the stacks have been deleted; what the file says of them counts then.
    """
    planned = sequence.planned
    try:
        with open_stream(folder / planned.file) as stream:
            provenance, content = stream.metadata.provenance, stream.content_sha256
    except BadInput:
        return None
    if stack_digest is None:
        stack_digest = provenance.get("stack_digest", "")
    fingerprint = sequence.fingerprint(stack_digest)
    if provenance.get("fingerprint") != fingerprint:
        return None
    return SequenceEntry(
        id=planned.id,
        split=planned.split,
        scene=planned.scene,
        variant=planned.member,
        scene_motion=planned.scene_motion,
        lens_motion=planned.motion["kind"],
        light=planned.light,
        repeat=planned.repeat,
        seed=planned.seed,
        file=planned.file,
        frames=sequence.frames,
        fingerprint=fingerprint,
        content_sha256=content,
    )
