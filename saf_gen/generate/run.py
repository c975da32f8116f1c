"""Generation of a dataset: renders missing stacks, records missing sequences, and lists finished sequences."""

import json
import platform
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

import yaml

import saf_gen
from saf_gen.core import seeds
from saf_gen.core.config.frozen_benchmarks import BENCHMARK_KEY
from saf_gen.core.execution import Cluster, ReportProgress, SchedulerLost, run_jobs
from saf_gen.core.extras import RESULT_PACKAGES, installed_version
from saf_gen.core.files import check_file_system, check_folder_writable, free_disk_bytes, remove_leftover_files
from saf_gen.core.object_store import AnyPath
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.generate.benchmark_digest import name_generated_benchmark
from saf_gen.generate.dataset_card import write_generated_dataset_card
from saf_gen.generate.finished_recordings import has_generated_fingerprint
from saf_gen.generate.job_order import JobOrder, find_stacks_to_generate, validate_generated_slices_kept
from saf_gen.generate.jobs import ChooseBackendJob, RecordJob, RenderJob
from saf_gen.generate.plan import recipe_fingerprint
from saf_gen.generate.recorder import Recorder
from saf_gen.generate.resolve import ResolvedRecipe, ResolvedSequence
from saf_gen.stack.focal_stack import StackStore
from saf_gen.stack.time_resolved import TimeResolvedStack
from saf_gen.stream.manifest import Manifest, SequenceEntry, read_manifest, write_manifest
from saf_gen.stream.stream_file import open_stream

BACKENDS = ("auto", "cuda", "llvm", "scalar")


@dataclass(frozen=True)
class GenerationResult:
    """The result of one run of :func:`generate`.

    Attributes
    ----------
    folder : Path or StorePath
        Folder of the dataset.
    manifest : Manifest
        Manifest of the dataset after the run.
    rendered : list of str
        Names of the pieces of stacks that this run rendered.
    recorded, kept : list of str
        Ids of the sequences that this run recorded, and of those that an earlier run had made.
    failed : dict of str to SafGenError
        Errors of the jobs that failed, by the name of the job.
    without_diffraction : bool, default False
        Whether the renderer left waves out although the recipe does not ask for that.
    freed_bytes : int, default 0
        Bytes of disk that deleting time slices freed.
    """

    folder: AnyPath
    manifest: Manifest
    rendered: list[str]
    recorded: list[str]
    kept: list[str]
    failed: dict[str, SafGenError]
    without_diffraction: bool = False
    freed_bytes: int = 0

    @property
    def exit_code(self) -> int:
        """0 if nothing failed; 2 if no sequence exists and all failures are bad input; 1 after any other failure."""
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
    keep_slices: str = "all",
    report: ReportProgress = lambda name, done: None,
    tell: Callable[[str], None] = lambda line: None,
) -> GenerationResult:
    """Make a dataset, or the parts of it that are missing.

    A run may be stopped at any moment and started again: finished stacks and sequences are verified and kept, and
    unfinished files never get their final names. Failures of single jobs are part of the result.

    Parameters
    ----------
    resolved : ResolvedRecipe
        Result of :func:`saf_gen.generate.resolve.resolve_recipe`.
    folder : str or Path, optional
        Folder of the dataset; by default ``datasets/NAME``, with the name of the recipe.
    workers : int, default 1
        Number of sequences recorded at a time, each on an equal part of the cores.
    variant : str, default "auto"
        Rendering backend: "auto", "cuda", "llvm" or "scalar".
    cluster : str, optional
        Address of a Dask scheduler whose workers run the jobs instead of this machine's cores; they must see the folder
        under the same path and have the same versions.
    keep_slices : str, default "all"
        Time slices of moving scenes to keep once everything that is recorded from them is made and verified: "all";
        "closed-loop", those that a closed-loop run needs; or "none", in which case none are rendered for it.
    report : callable, optional
        Called with the name of a job and the fraction of it that is done, 0 to 1.
    tell : callable, optional
        Called with a line for the user if a job is run again because its process died, or if a cluster has no workers.

    Returns
    -------
    GenerationResult
        Manifest of the dataset, what was rendered, recorded and kept, and the errors of jobs that failed.

    Raises
    ------
    BadInput
        If the backend or the choice of slices is unknown, if the backend cannot run here, if the folder cannot be used,
        here or on a worker, or if the recipe has the name of a frozen benchmark but would give different spikes. It is
        raised before anything is made.
    SafGenError
        If the scheduler of the cluster is lost; the manifest lists what was finished before.
    """
    if variant not in BACKENDS:
        raise unknown("variant", variant, allowed=BACKENDS)
    validate_generated_slices_kept(keep_slices)
    folder = (Path(folder) if folder is not None else Path("datasets") / resolved.recipe.name).resolve()
    to_render = find_stacks_to_generate(resolved, folder, keep_slices=keep_slices)
    machines = None if cluster is None else Cluster(cluster, folder, writes=True)
    benchmark = name_generated_benchmark(resolved)

    def choose_backend() -> tuple[str, bool]:
        return choose_recipe_renderer(variant, cluster=machines, notify=tell)

    backend_name, renders_waves = choose_backend() if to_render else (variant, True)
    leave_out = not renders_waves and resolved.recipe.render.diffraction is not False
    if leave_out:
        if resolved.recipe.render.diffraction:
            raise _no_waves_error(backend_name, "the recipe asks for")
        resolved, benchmark = resolved.without_diffraction(), ""
        to_render = find_stacks_to_generate(resolved, folder, keep_slices=keep_slices)
    _check_folder(resolved, folder, keep_slices=keep_slices)
    remove_leftover_files(folder, recursive=True)
    recorder = Recorder(
        sensor=resolved.sensor,
        frames=resolved.recipe.camera.frames,
        device_seed=seeds.derive_seed(resolved.recipe.seed, "device"),
        provenance=_provenance(resolved, benchmark),
    )
    order = JobOrder(
        resolved,
        folder,
        to_render=to_render,
        recorder=recorder,
        keep_slices=keep_slices,
        workers=workers,
        choose_backend=lambda: _check_waves(resolved, choose_backend()),
    )
    rendered: list[str] = []
    recordings: dict[str, bool] = {}  # by id, whether an earlier run had made it
    failed: dict[str, SafGenError] = {}
    freed = 0
    ended = run_jobs(
        order.first_jobs(), workers=workers, report=report, follow_up=order.jobs_after, cluster=machines, notify=tell
    )
    try:
        with closing(ended):
            for job, result, error in ended:
                if error is not None:
                    failed[job.name] = error
                elif isinstance(job, RenderJob):
                    rendered += [f"{job.label} · {piece}" for piece in result]
                elif not isinstance(job, RecordJob):
                    freed += result
                elif not result.lacks_slices:
                    recordings[job.sequence.id] = result.kept
    except KeyboardInterrupt:
        _write_manifest(resolved, folder)
        raise
    except SchedulerLost as lost:
        listed = len(_write_manifest(resolved, folder).sequences)
        raise SafGenError(
            f"{lost}; {listed} of {len(resolved.plan)} sequences are complete and listed; start a scheduler and run "
            "the same command again to continue"
        ) from lost
    recorded, kept = ([name for name, was_kept in recordings.items() if was_kept == one] for one in (False, True))
    manifest = _write_manifest(resolved, folder)
    _write_previews(resolved, folder)
    return GenerationResult(folder, manifest, rendered, recorded, kept, failed, leave_out, freed)


def choose_recipe_renderer(
    requested: str, *, cluster: Cluster | None, notify: Callable[[str], None]
) -> tuple[str, bool]:
    """Return the backend to render with, here or on a worker of the cluster, and whether it renders diffraction."""
    job = ChooseBackendJob(requested)
    if cluster is None:
        return job.run(lambda name, done: None)
    (_, result, error), *_ = run_jobs([job], workers=1, report=lambda name, done: None, cluster=cluster, notify=notify)
    if error is not None:
        raise error
    return result


def _check_waves(resolved: ResolvedRecipe, backend: tuple[str, bool]) -> str:
    """Return the name of the backend; raise BadInput if stacks have diffraction that it cannot render."""
    chosen, renders_waves = backend
    if not renders_waves and resolved.recipe.render.diffraction is not False:
        raise _no_waves_error(chosen, "the deleted time slices had")
    return chosen


def _no_waves_error(backend_name: str, which: str) -> BadInput:
    return BadInput(
        f"variant {backend_name} cannot render diffraction, which {which}",
        allowed="llvm, cuda",
        hint="or leave waves out with render: {diffraction: false}",
    )


def _provenance(resolved: ResolvedRecipe, benchmark: str) -> dict[str, str]:
    versions = {"saf_gen": saf_gen.__version__, "python": platform.python_version()}
    versions |= {name: installed_version(name) for name in RESULT_PACKAGES}
    return {
        "recipe": yaml.safe_dump(resolved.recipe.model_dump(mode="json"), sort_keys=False),
        "recipe_fingerprint": recipe_fingerprint(resolved.recipe),
        "sensor": yaml.safe_dump(asdict(resolved.sensor), sort_keys=False),
        "versions": json.dumps(versions, indent=1),
        **({BENCHMARK_KEY: benchmark} if benchmark else {}),
    }


def check_same_recipe_dataset(resolved: ResolvedRecipe, folder: AnyPath) -> Manifest | None:
    """Return the manifest in a folder, or None if it is missing; raise BadInput if it describes another dataset."""
    if not (folder / "manifest.json").exists():
        return None
    manifest = read_manifest(folder)
    if manifest.name != resolved.recipe.name:
        raise BadInput(
            f"{folder} holds the dataset {manifest.name!r}, but the recipe makes {resolved.recipe.name!r}",
            hint="give another folder with --out",
        )
    return manifest


def _check_folder(resolved: ResolvedRecipe, folder: Path, *, keep_slices: str) -> None:
    check_same_recipe_dataset(resolved, folder)
    check_folder_writable(folder)
    needed, free = resolved.estimate_bytes(folder, keep_slices), free_disk_bytes(folder)
    if needed > free:
        raise BadInput(
            f"the dataset needs about {needed / 1e6:,.0f} MB in {folder}, but only {free / 1e6:,.0f} MB are free",
            hint="free disk space, or give another folder with --out",
        )
    folder.mkdir(parents=True, exist_ok=True)
    check_file_system(folder)


def _write_previews(resolved: ResolvedRecipe, folder: Path) -> None:
    """Write the missing contact sheets of still scenes whose focal stacks are complete."""
    from saf_gen.authoring.preview import write_scene_preview  # loads matplotlib, which a dry run does not need

    for stack in resolved.sequences_by_stack():
        spec = stack.specs[0]
        sheet = folder / "preview" / f"{spec.key}.png"
        store = StackStore(folder / "stacks", spec)
        if not (stack.is_moving or sheet.exists() or store.missing_pieces()):
            write_scene_preview(store.load(), resolved.sensor, path=sheet)


def _write_manifest(resolved: ResolvedRecipe, folder: Path) -> Manifest:
    """Write manifest.json and README.md for the finished sequences of the recipe, including those of other shards.

    The stream files themselves are read, so that nothing is listed that this recipe would make differently, and shards
    that end at the same time cannot lose each other's sequences.
    """
    stacks = folder / "stacks"
    digests: dict[TimeResolvedStack, str | None] = {}
    entries = []
    for sequence in resolved.plan:
        stack = sequence.time_stack
        if stack not in digests:
            digests[stack] = None if stack.find_missing(stacks) else stack.digest(stacks)
        entries.append(find_generated_entry(sequence, folder, stack_digest=digests[stack]))
    return write_generated_manifest(resolved, folder, entries=[e for e in entries if e is not None], stacks=stacks)


def write_generated_manifest(
    resolved: ResolvedRecipe, folder: Path, *, entries: list[SequenceEntry], stacks: Path
) -> Manifest:
    """Write manifest.json, README.md and croissant.json for these sequences; notes in ``stacks`` name the renderer."""
    specs = (spec for stack in resolved.sequences_by_stack() for spec in stack.specs)
    backends: set[str] = set().union(*(StackStore(stacks, spec).backends() for spec in specs))
    manifest = Manifest(
        name=resolved.recipe.name,
        recipe_fingerprint=recipe_fingerprint(resolved.recipe),
        variant=", ".join(sorted(backends)),
        sequences=tuple(entries),
    )
    write_manifest(folder, manifest)
    write_generated_dataset_card(
        folder, resolved.recipe, manifest=manifest, scenes=[s.card for s in resolved.scenes.values()]
    )
    return manifest


def find_generated_entry(
    sequence: ResolvedSequence, folder: AnyPath, *, stack_digest: str | None
) -> SequenceEntry | None:
    """Return the entry of a sequence for the manifest; None if its file is missing, truncated, or of another recipe.

    ``stack_digest`` is None if the stacks have been deleted; the digest that the file stores is used then.
    """
    planned = sequence.planned
    try:
        with open_stream(folder / planned.file) as stream:
            provenance, content = stream.metadata.provenance, stream.content_sha256
            if stack_digest is None:
                stack_digest = provenance.get("stack_digest", "")
            if not has_generated_fingerprint(stream, sequence.fingerprint(stack_digest)):
                return None
    except BadInput:
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
        fingerprint=provenance["fingerprint"],
        content_sha256=content,
    )
