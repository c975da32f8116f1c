"""Generation of a dataset: renders missing stacks, records missing sequences, and lists finished sequences."""

import json
import platform
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from string import Template
from typing import Any

import yaml

import saf_gen
from saf_gen.core import seeds
from saf_gen.core.config.frozen_benchmarks import BENCHMARK_KEY
from saf_gen.core.config.ranges import is_range, range_extremes
from saf_gen.core.execution import Cluster, ReportProgress, SchedulerLost, run_jobs
from saf_gen.core.extras import RESULT_PACKAGES, installed_version
from saf_gen.core.files import (
    DiskFull,
    check_file_system,
    check_ours,
    check_writable,
    free_disk_bytes,
    read_start,
    refuse_link,
    remove_leftovers,
    write_text,
)
from saf_gen.core.plain_text import escape_markdown, plural
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.generate.pieces import Deletion, Pictures, Recording, Renderer, Schedule, Site, Work, pieces_of
from saf_gen.generate.plan import Plan, check_same_dataset, make_plan
from saf_gen.generate.recipe import Recipe, RenderSettings
from saf_gen.generate.record import Recorder, has_generated_fingerprint
from saf_gen.generate.resolve import ResolvedRecipe, ResolvedSequence, recipe_fingerprint
from saf_gen.scene.picture_card import PictureCard
from saf_gen.scene.scene_folder import SceneCard
from saf_gen.stack.focal_stack import PICTURES, WAVES, StackStore
from saf_gen.stack.time_resolved import TimeResolvedStack
from saf_gen.stream.manifest import FORMAT as MANIFEST_FORMAT
from saf_gen.stream.manifest import (
    MANIFEST_NAME,
    TABLE_MARK,
    TABLE_NAME,
    Manifest,
    SequenceEntry,
    read_manifest,
    write_manifest,
)
from saf_gen.stream.sharing.croissant import (
    CARD_NAME,
    PHOTOGRAPHS,
    SYNTHETIC,
    DatasetFacts,
    front_matter,
    read_licences,
    write_croissant,
)
from saf_gen.stream.stream_file import open_stream

BACKENDS = ("auto", "cuda", "llvm", "scalar")
MARKS = {
    MANIFEST_NAME: MANIFEST_FORMAT,
    "README.md": "Made by saf_gen",
    CARD_NAME: MANIFEST_NAME,
    TABLE_NAME: TABLE_MARK,
}
"""Files of a dataset, with words by which they are known as such."""


@dataclass(frozen=True)
class GenerationResult:
    """The result of one run of :func:`generate`.

    Attributes
    ----------
    folder : Path
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

    folder: Path
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
    DiskFull
        If no disk space is left; the manifest lists what was finished before.
    SafGenError
        If the scheduler of the cluster is lost; the manifest lists what was finished before.
    """
    plan = make_plan(resolved, Path(folder or Path("datasets") / resolved.recipe.name), keep_slices=keep_slices)
    return run_plan(plan, workers=workers, variant=variant, cluster=cluster, report=report, tell=tell)


def run_plan(
    plan: Plan,
    *,
    workers: int = 1,
    variant: str = "auto",
    cluster: str | None = None,
    report: ReportProgress = lambda name, done: None,
    tell: Callable[[str], None] = lambda line: None,
) -> GenerationResult:
    """Make what a dataset folder lacks; see :func:`generate` for the parameters and the errors."""
    if variant not in BACKENDS:
        raise unknown("variant", variant, allowed=BACKENDS)
    machines = None if cluster is None else Cluster(cluster, plan.folder, writes=True)

    @cache
    def choose_backend() -> tuple[str, bool]:
        site = Site(plan.folder, _recorder(plan.resolved), backend=variant)
        name, renders_waves = _choose_renderer(Work(Renderer(variant), site), cluster=machines, notify=tell)
        by_waves = all(spec.estimator == WAVES for stack in plan.users for spec in stack.specs)
        return name, renders_waves or by_waves

    backend_name, renders_waves = choose_backend() if plan.renders else (variant, True)
    diffraction = plan.resolved.recipe.render.diffraction
    leave_out = not renders_waves and diffraction is not False
    if leave_out:
        if diffraction:
            raise _no_waves_error(backend_name, "the recipe asks for")
        plan = make_plan(plan.resolved.without_diffraction(), plan.folder, keep_slices=plan.keep_slices)
    resolved, folder = plan.resolved, plan.folder
    _check_folder(plan)
    remove_leftovers(folder, recursive=True)
    if plan.shard is not None:
        _claim_folder(resolved, folder)
    site = Site(folder, _recorder(resolved), side_by_side=workers)
    schedule = Schedule(pieces_of(plan), site, choose_backend=lambda: _check_waves(resolved, choose_backend()))
    rendered: list[str] = []
    recordings: dict[str, bool] = {}  # by id, whether an earlier run had made it
    failed: dict[str, SafGenError] = {}
    freed = 0
    ended = run_jobs(
        schedule.first(), workers=workers, report=report, follow_up=schedule.after, cluster=machines, notify=tell
    )
    try:
        with closing(ended):
            for work, result, error in ended:
                piece = work.piece
                if isinstance(error, DiskFull):
                    raise error  # as every other job would
                if error is not None:
                    failed[piece.name] = error
                elif isinstance(piece, Pictures):
                    rendered += [f"{piece.label} · {part}" for part in result]
                elif isinstance(piece, Deletion):
                    freed += result
                elif isinstance(piece, Recording) and not result.lacks_slices:
                    recordings[piece.sequence.planned.id] = result.kept
    except (KeyboardInterrupt, DiskFull):
        remove_leftovers(folder, recursive=True)  # of workers that were stopped
        _list_finished(plan)
        raise
    except SchedulerLost as lost:
        if plan.shard is not None:
            raise SafGenError(f"{lost}; start a scheduler and run the same command again to continue") from lost
        listed = len(_list_finished(plan).sequences)
        raise SafGenError(
            f"{lost}; {listed} of {plural(len(resolved.all_sequences), 'sequence')} complete and listed; "
            "start a scheduler and run the same command again to continue"
        ) from lost
    recorded, kept = ([name for name, was_kept in recordings.items() if was_kept == one] for one in (False, True))
    manifest = _list_finished(plan)
    _write_previews(plan)
    return GenerationResult(folder, manifest, rendered, recorded, kept, failed, leave_out, freed)


def _choose_renderer(choice: Work, *, cluster: Cluster | None, notify: Callable[[str], None]) -> tuple[str, bool]:
    """Return the backend to render with, here or on a worker of the cluster, and whether it renders diffraction."""
    if cluster is None:
        name, renders_waves = choice.run(lambda name, done: None)
        return name, renders_waves
    (_, result, error), *_ = run_jobs(
        [choice], workers=1, report=lambda name, done: None, cluster=cluster, notify=notify
    )
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


def _recorder(resolved: ResolvedRecipe) -> Recorder:
    """Return what records the sequences of a recipe."""
    device_seed = seeds.derive_seed(resolved.recipe.seed, "device")
    return Recorder(resolved.sensor, resolved.recipe.camera.frames, device_seed, _provenance(resolved))


def _provenance(resolved: ResolvedRecipe) -> dict[str, str]:
    versions = {"saf_gen": saf_gen.__version__, "python": platform.python_version()}
    versions |= {name: installed_version(name) for name in RESULT_PACKAGES}
    actuator = resolved.all_sequences[0].planned.actuator
    return {
        "recipe": yaml.safe_dump(resolved.recipe.model_dump(mode="json"), sort_keys=False),
        "recipe_fingerprint": recipe_fingerprint(resolved.recipe),
        "sensor": yaml.safe_dump(resolved.sensor.as_dict(), sort_keys=False),
        **({} if actuator is None else {"actuator": yaml.safe_dump(asdict(actuator), sort_keys=False)}),
        "versions": json.dumps(versions, indent=1),
        **({BENCHMARK_KEY: resolved.benchmark} if resolved.benchmark else {}),
    }


def _check_folder(plan: Plan) -> None:
    folder = plan.folder
    refuse_link(plan.target)
    check_writable(folder)
    if MANIFEST_FORMAT not in read_start(folder / MANIFEST_NAME):  # there is none before the first run has ended
        for name, mark in MARKS.items():
            check_ours(folder / name, mark)
    needed, free = plan.disk_bytes, free_disk_bytes(folder)
    if needed > free:
        raise BadInput(
            f"the dataset needs about {needed / 1e6:,.0f} MB in {folder}, but only {free / 1e6:,.0f} MB are free",
            hint="free disk space, or give another folder with --out",
        )
    folder.mkdir(parents=True, exist_ok=True)
    check_file_system(folder)


def _write_previews(plan: Plan) -> None:
    """Write the missing contact sheets of still scenes whose focal stacks are complete."""
    from saf_gen.authoring.contact_sheet import write_preview  # loads matplotlib, which a dry run does not need

    for stack in plan.by_stack:
        spec = stack.specs[0]
        sheet = plan.folder / "preview" / f"{spec.key}.png"
        store = StackStore(plan.folder / "stacks", spec)
        if not (stack.is_moving or spec.estimator == PICTURES or sheet.exists() or store.missing_pieces()):
            write_preview(store.load().without_margin(), plan.resolved.sensor, path=sheet)


def _claim_folder(resolved: ResolvedRecipe, folder: Path) -> None:
    """Write a manifest that lists nothing, if there is none of this recipe, so that no shard of another joins in.

    Only the run that closes the job array lists sequences; a dataset that is half made cannot be mistaken for a whole.
    """
    found, fingerprint = check_same_dataset(resolved, folder), recipe_fingerprint(resolved.recipe)
    if found is None or found.recipe_fingerprint != fingerprint:
        write_manifest(folder, Manifest(resolved.recipe.name, fingerprint, "", ()))


def _list_finished(plan: Plan) -> Manifest:
    """Write manifest.json, README.md and croissant.json for the finished sequences of the recipe; a shard leaves them.

    The stream files themselves are read, so that nothing is listed that this recipe would make differently. Notes of
    the stacks name the renderer.
    """
    resolved, folder = plan.resolved, plan.folder
    if plan.shard is not None:
        return read_manifest(folder)
    stacks = folder / "stacks"
    digests: dict[TimeResolvedStack, str | None] = {}
    entries = []
    for sequence in resolved.all_sequences:
        stack = sequence.time_stack
        if stack not in digests:
            digests[stack] = None if stack.find_missing(stacks) else stack.digest(stacks)
        entries.append(find_entry(sequence, folder, stack_digest=digests[stack]))
    specs = {spec for s in resolved.sequences for spec in s.time_stack.specs}
    backends: set[str] = set().union(*(StackStore(stacks, spec).backends() for spec in specs))
    manifest = Manifest(
        name=resolved.recipe.name,
        recipe_fingerprint=recipe_fingerprint(resolved.recipe),
        variant=", ".join(sorted(backends)),
        sequences=tuple(entry for entry in entries if entry is not None),
        planned=dict(Counter(sequence.planned.split for sequence in resolved.all_sequences)),
    )
    write_manifest(folder, manifest)
    write_dataset_card(folder, resolved.recipe, manifest=manifest, scenes=[s.card for s in resolved.scenes.values()])
    return manifest


def find_entry(sequence: ResolvedSequence, folder: Path, *, stack_digest: str | None) -> SequenceEntry | None:
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
        scene=planned.counted_as,
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


ORIGINS = {
    "rendered": "scenes rendered by Mitsuba through a thin lens",
    "photographed": "focal stacks photographed by other cameras",
}
PAGE = Template("""# $name: spike-camera autofocus data

Made by saf_gen from a recipe: $origin, seen by a model of the spike
camera `$sensor`. Every sequence holds its true focus and the lens position at every frame.

| | |
|---|---|
| sequences | $count ($splits) |
| frames per sequence | $frames |
| focus positions $positions |
| lens motion | $motion |
| light schedules | $lights |
| recipe fingerprint | `$fingerprint` |

## Scenes

$scenes

## Files

- `croissant.json`: this card for programs ([Croissant](https://mlcommons.org/croissant)).
- `manifest.json`: every sequence with split, scene, light, seed, file and `content_sha256`; the digest of every file.
- `sequences.csv`: the same sequences as a table.
- `<split>/<id>.h5`: a spike stream with its truth, and in `/provenance/recipe` the recipe that makes it again.
- `stacks/`: the focal stacks (OpenEXR), shared by the sequences; needed only to record more$more.

```python
import saf_gen
with saf_gen.open_stream("$example") as stream:   # from this folder
    print(stream.shape, stream.truth.position)
    image = stream.counts(0, 200)
```

To evaluate focus methods on it, from this folder: `$next_command`; to publish it: put this folder on a server.
""")


def _describe_motion(motion: dict[str, Any]) -> str:
    """Return a lens motion as Markdown, such as `hand` (bandwidth_hz 10, seed 3)."""
    if is_range(motion):
        return " or ".join(_describe_motion(one) for one in range_extremes(motion))
    options = ", ".join(f"{key} {_describe_value(value)}" for key, value in motion.items() if key != "kind")
    return f"`{motion['kind']}`" + (f" ({escape_markdown(options)})" if options else "")


def _describe_value(value: Any) -> str:
    if is_range(value):
        ((form, among),) = value.items()
        return f"{form} {', '.join(_describe_value(one) for one in among)}"
    return value["path"] if isinstance(value, dict) else str(value)


def _describe_actuator(name: str | None) -> str:
    if name is None:
        return ""
    return f", told to the actuator {escape_markdown(name)}: /focus is its log, /truth/lens is where the lens was"


def _describe_positions(recipe: Recipe) -> str:
    own = [f"{split.positions} in {name}" for name, split in recipe.splits.items() if split.positions]
    return ", ".join([str(recipe.focus.positions), *own])


def _describe_samples(render: RenderSettings) -> str:
    own = {name: render.of_scene(name).samples for name in render.per_scene}
    others = ", ".join(f"{name}: {samples}" for name, samples in own.items() if samples != render.samples)
    return f"{render.samples} samples per pixel{f' ({others})' if others else ''}"


def _describe_scene(card: SceneCard | PictureCard) -> str:
    licence = card.licence or "not stated"
    return f"- `{card.id}`: {escape_markdown(f'{card.title}. Licence {licence}.')}"


def write_dataset_card(
    folder: Path, recipe: Recipe, *, manifest: Manifest, scenes: Iterable[SceneCard | PictureCard]
) -> None:
    """Write README.md and croissant.json to a dataset folder that has its manifest, each completely or not at all."""
    cards = list(scenes)
    given = [isinstance(card, PictureCard) for card in cards]
    kinds = [kind for kind, there in (("rendered", not all(given)), ("photographed", any(given))) if there]
    licences = read_licences(card.licence for card in cards)
    splits = Counter(entry.split for entry in manifest.sequences)
    text = PAGE.substitute(
        name=recipe.name,
        sensor=recipe.camera.spike_sensor,
        count=len(manifest.sequences),
        splits=", ".join(f"{split} {count}" for split, count in splits.items()) or "none finished yet",
        frames=recipe.camera.frames,
        origin=" and ".join(ORIGINS[kind] for kind in kinds),
        positions="| one per picture; their steps, and the rule of the true focus, are in /provenance/photographed"
        if all(given)
        else f"rendered | {_describe_positions(recipe)}, {_describe_samples(recipe.render)}",
        motion=_describe_motion(recipe.focus.motion) + _describe_actuator(recipe.focus.actuator),
        lights=escape_markdown(", ".join(recipe.lights)),
        fingerprint=manifest.recipe_fingerprint,
        scenes="\n".join(map(_describe_scene, cards)),
        more=", and to read all-in-focus pictures" if recipe.truth.sharp else "",
        next_command=manifest.next_command("."),
        example=manifest.sequences[0].file if manifest.sequences else "SPLIT/ID.h5",
    )
    matter = front_matter(manifest, licences)
    write_text(folder / "README.md", matter + text)
    described = (
        f"Spike-camera autofocus data, {' and '.join(kinds)} and simulated: "
        f"{plural(len(manifest.sequences), 'sequence')} of {recipe.camera.frames} frames, "
        f"sensor {recipe.camera.spike_sensor}, light {', '.join(recipe.lights)}. "
        f"Scenes: {'; '.join(f'{card.id}, {card.title}' for card in cards)}. "
        f"Each sequence holds its true focus and the lens position at every frame."
    )
    responsible = PHOTOGRAPHS if any(given) else SYNTHETIC
    write_croissant(folder, manifest, facts=DatasetFacts(described, licences, responsible=responsible))
