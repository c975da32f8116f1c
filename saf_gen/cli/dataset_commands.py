"""The commands ``generate``, ``verify`` and ``fetch``."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import TaskID

from saf_gen.cli._tables import print_table
from saf_gen.cli._terminal import ClusterAddress, OutFolder, RecipeName, err, out, print_error, progress_bars
from saf_gen.cli.command import FINISHED_WORK_IS_KEPT, Command, Panel
from saf_gen.cli.recapture_command import record_with
from saf_gen.core.cores import defer_interrupts, usable_cores
from saf_gen.core.plain_text import plural
from saf_gen.core.table import Column, Table
from saf_gen.errors import BadInput, escape_controls

if TYPE_CHECKING:
    from saf_gen.generate.plan import Plan
    from saf_gen.generate.shards import Shard

MOST_NAMED = 24
"""Number of stacks that a dry run names; its table has all sequences."""
Workers = Annotated[int, typer.Option(min=1, max=256, help="Number of sequences to record at the same time.")]
Variant = Annotated[str, typer.Option(help="Renderer: auto, cuda, llvm or scalar.")]
KeepSlices = Annotated[
    str, typer.Option(help="Time slices of moving scenes to keep at the end: all, closed-loop or none.")
]


def generate_command(
    recipe: RecipeName,
    *,
    folder: OutFolder = None,
    workers: Workers = 1,
    cluster: ClusterAddress = None,
    split: Annotated[str | None, typer.Option(help="Generate only this split.")] = None,
    shard: Annotated[str, typer.Option(help="I/N: generate the I-th of N equal parts of the work.")] = "1/1",
    sources: Annotated[
        list[Path] | None,
        typer.Option("--from", help="Folder of a shard, which is copied first; may be repeated, to merge shards."),
    ] = None,
    variant: Variant = "auto",
    keep_slices: KeepSlices = "all",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print what would be made, with its time and disk, and make nothing.")
    ] = False,
    machines: Annotated[
        int, typer.Option(min=1, max=10_000, help="With --dry-run: machines that share the work, as with --cluster.")
    ] = 1,
) -> None:
    """Make a dataset from a recipe, or go on where a run was stopped.

    Shards that ran without a common disk are merged by --from; what none of them could make is made then.
    """
    if machines > 1 and not dry_run:
        raise BadInput(f"--machines is {machines}", allowed="with --dry-run alone", hint="start machines: --cluster")
    if sources and (dry_run or shard != "1/1" or split):
        raise BadInput("--from is given", allowed="without --dry-run, --shard and --split")
    with defer_interrupts():
        from saf_gen.generate.plan import make_plan
        from saf_gen.generate.resolve import coarse_sampling, resolve_recipe

    resolved = resolve_recipe(recipe, part=_parse_shard(shard), split=split)
    target = folder or Path("datasets") / resolved.recipe.name
    if sources:
        from saf_gen.generate.merging import gather_shards

        copied = gather_shards(resolved, sources, target=target, tell=err.print)
        out.print(f"{copied / 1e6:,.0f} MB copied from {plural(len(sources), 'folder')}")
    plan = make_plan(resolved, target, keep_slices=keep_slices)
    if sources and any(plan.to_render.values()):
        err.print(f"these stacks lack pictures, which are rendered here: {'; '.join(plan.labels)}", soft_wrap=True)
    if plan.renders and not cluster:
        _warn_of_renderer(variant, dry_run=dry_run)
    for line in coarse_sampling(resolved):
        err.print(f"warning: {line}")
    if dry_run:
        _print_plan(plan, workers=workers, machines=machines, variant=variant, cluster=cluster)
        return
    options = {"--out": str(target), "--split": split, "--keep-slices": keep_slices if keep_slices != "all" else None}
    given = [word for option, value in options.items() if value for word in (option, value)]
    closing = shlex.join(["saf-gen", "generate", recipe, *given])
    _make(plan, workers=workers, variant=variant, cluster=cluster, closing=closing)


def _make(plan: "Plan", *, workers: int, variant: str, cluster: str | None, closing: str) -> None:
    """Make what a plan lacks, with progress bars, and print what was made; ``closing`` ends a job array."""
    from saf_gen.generate.run import run_plan

    target = plan.target
    with progress_bars() as bars:
        tasks: dict[str, TaskID] = {}
        finished: set[str] = set()

        def report(name: str, done: float) -> None:
            if name in finished:
                return
            if name not in tasks:
                tasks[name] = bars.add_task(name, total=1.0)
            bars.update(tasks[name], completed=done)
            if done >= 1:  # thousands of finished bars would hide the moving ones and slow the run down
                finished.add(name)
                bars.remove_task(tasks.pop(name))
                err.print(escape_controls(f"done: {name}"))

        result = run_plan(plan, workers=workers, variant=variant, cluster=cluster, report=report, tell=err.print)
    out.print(
        f"{plural(len(result.recorded), 'sequence')} recorded, {len(result.kept)} kept from before, "
        f"{plural(len(result.rendered), 'piece')} of focal stacks rendered"
    )
    if result.freed_bytes:
        out.print(f"{result.freed_bytes / 1e6:,.0f} MB of time slices deleted (--keep-slices {plan.keep_slices})")
    if plan.shard is None:
        out.print(f"dataset: {target}   (next: {result.manifest.next_command(target)})", soft_wrap=True)
    else:
        _print_shard(plan.shard)
        shards = plan.shard.part[1]
        all_ended = "the shard has ended" if shards == 1 else f"all {shards} shards have ended"
        out.print(f"next, once {all_ended}: {closing}", soft_wrap=True)
    _record_again(plan)
    if result.without_diffraction:
        out.print("rendered without diffraction: only the variants llvm and cuda support it")
    for name, problem in result.failed.items():
        print_error(f"{name} failed: {problem}", result.exit_code)
    if result.failed:
        raise typer.Exit(result.exit_code)


def _record_again(plan: "Plan") -> None:
    """Record the dataset with the other cameras of its recipe, or say how that is done where it is not complete."""
    from saf_gen.stack.recapture import CAMERAS
    from saf_gen.stream.manifest import read_manifest

    for camera in plan.resolved.others:
        if plan.shard is not None:
            out.print(
                f"not recorded with {camera.name}, because this is a shard: saf-gen recapture does it", soft_wrap=True
            )
            continue
        manifest = read_manifest(plan.folder)
        target = plan.folder / CAMERAS / camera.name
        record_with(camera, plan.folder, manifest=manifest, entries=list(manifest.sequences), target=target)


def _warn_of_renderer(variant: str, *, dry_run: bool) -> None:
    """Warn on stderr if the renderer that will be chosen is slow, or leaves a card of this machine unused.

    If there is no renderer, a dry run prints the problem, and any other run raises BadInput.
    """
    try:
        from saf_gen.render import backend
    except BadInput as missing:
        if not dry_run:
            raise
        err.print(f"scenes cannot be rendered here: {missing}")
        return
    if variant != "auto":
        return
    machine = backend.probe_backends()
    if machine.card_problem:
        err.print(f"the NVIDIA card is left out, because it traces nothing: {machine.card_problem}")
    if backend.choose_backend(variant, machine) == "scalar":
        err.print(f"scenes are rendered by variant scalar here, slowly and without diffraction; {backend.ADVICE}")


def _parse_shard(text: str) -> tuple[int, int]:
    """Return (I, N) of the text "I/N"; raise BadInput if the text has another form."""
    index, _, count = text.partition("/")
    if not (index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        raise BadInput(f"--shard is {text!r}", allowed="I/N with I from 1 to N, such as 2/8")
    return int(index), int(count)


def _print_shard(shard: "Shard") -> None:
    index, count = shard.part
    if not shard.specs:
        out.print(f"shard {index}/{count} has nothing to make: there is less to share out than there are shards")
        return
    out.print(
        f"shard {index}/{count}: {len(shard.specs):,} of {shard.all_specs:,} stacks and time slices, "
        f"about {_time(shard.seconds)} of {_time(shard.all_seconds)} ({shard.seconds / shard.all_seconds:.1%})"
    )


def _gigabytes(size: float) -> str:
    return f"{size / 1e9:.2f} GB"


def _print_plan(plan: "Plan", *, workers: int, machines: int, variant: str, cluster: str | None) -> None:
    from saf_gen.generate.plan import KEEP_SLICES

    makes = plan.resolved.sequences if plan.shard is None else plan.sequences
    recipe, planned = plan.resolved.recipe, [sequence.planned for sequence in makes]
    frames = recipe.camera.frames
    columns = [
        Column("sequence", "id"),
        Column("split", "split"),
        Column("frames", lambda _: frames, ",", detail=1),
        Column("seed", "seed", detail=2),
        Column("exists", lambda sequence: "yes" if sequence.id in plan.made else "no"),
    ]
    title = f"{recipe.name}: {plural(len(planned), 'sequence')} in {plan.target}"
    print_table(Table(columns, planned, title), where_to_find="a wider terminal or a pipe shows them")
    if plan.shard is not None:
        _print_shard(plan.shard)
        if plan.by_cut_stack:
            cut = sum(map(len, plan.by_cut_stack.values()))
            by = "the shard that sees all time slices, or the closing run"
            out.print(f"left to {by}: {plural(cut, 'sequence')}")
    out.print(f"focal stacks to render: {_name_some(plan.labels) or 'none, all exist'}")
    if plan.kept_bytes("all"):
        listed = ", ".join(f"{choice} {_gigabytes(plan.kept_bytes(choice))}" for choice in KEEP_SLICES)
        out.print(f"time slices kept at the end: {listed}; chosen: --keep-slices {plan.keep_slices}")
    left = plan.estimate(workers=workers, machines=machines)
    out.print(
        f"jobs: {len(plan.to_render):,} to render, about {_time(left.render_s)} on one machine; "
        f"{len(plan.unrecorded):,} to record, about {_time(left.record_s)}"
    )
    if plan.resolved.others:
        names = ", ".join(camera.name for camera in plan.resolved.others)
        out.print(f"then recorded again, which is not in these figures, with: {names}", soft_wrap=True)
    who = "two cores with LLVM" if machines == 1 else f"{machines} machines of two cores with LLVM"
    out.print(f"disk still needed: about {_gigabytes(plan.disk_bytes)}; time: about {_time(left.seconds)} on {who}")
    if machines == 1 and cluster is None:
        out.print(f"here: {_describe_here(plan, variant)}", soft_wrap=True)


def _describe_here(plan: "Plan", variant: str) -> str:
    """Return the cores that a run would use here and, if it renders, the renderer or why there is none."""
    cores = plural(usable_cores(), "core")
    if not plan.renders:
        return cores
    try:
        from saf_gen.render import backend

        name = backend.choose_backend(variant)
    except BadInput as missing:
        return f"{cores}, but {missing.problem}"
    return f"{cores}, variant {name}{', which is many times slower' if name == 'scalar' else ''}"


def _name_some(labels: Sequence[str]) -> str:
    """Return a list of names as text; of a long one the first, and how many more there are."""
    shown = labels if len(labels) <= MOST_NAMED + 1 else labels[:MOST_NAMED]
    return "; ".join([*shown, *([f"and {len(labels) - MOST_NAMED} more"] if len(shown) < len(labels) else [])])


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:,.1f} h"


def verify_command(dataset: Annotated[Path, typer.Argument(help="Dataset folder, or its name.")]) -> None:
    """Check every file of a dataset against its digest."""
    from saf_gen.stream.dataset import verify_dataset
    from saf_gen.stream.description import describe_flaws
    from saf_gen.stream.manifest import read_manifest
    from saf_gen.stream.sample_dataset import find_data
    from saf_gen.stream.sharing.fetching import check_published

    dataset = find_data(dataset)
    flaws: dict[str, dict[str, str]] = {}
    count, problems = verify_dataset(dataset, report=lambda name, held: flaws.update({name: describe_flaws(held)}))
    if not count:
        raise BadInput("lists no sequence", where=str(dataset), hint="make some with saf-gen generate")
    for name, found in flaws.items():
        for what, words in found.items():
            out.print(escape_controls(f"{name}: {what}: {words}"), soft_wrap=True, markup=False)
    for name, problem in problems.items():
        print_error(f"{name}: {problem}", 1)
    out.print(f"{count - len(problems)} of {plural(count, 'sequence')} {'is' if count == 1 else 'are'} intact")
    if problems:
        raise typer.Exit(1)
    try:
        check_published(dataset, read_manifest(dataset))
    except BadInput as problem:
        err.print(escape_controls(f"warning: others could not fetch it: {problem}"), soft_wrap=True, markup=False)


def fetch_command(
    source: Annotated[str, typer.Argument(help="Address (http or https) of a dataset folder.")],
    *,
    folder: OutFolder = None,
    sha256: Annotated[str, typer.Option(help="SHA-256 of manifest.json, as stated by its publisher.")] = "",
) -> None:
    """Fetch and check a published dataset, or resume a fetch."""
    from saf_gen.stream.sharing import fetch_dataset

    with progress_bars() as bars:
        task = bars.add_task("fetch", total=1.0)
        target, manifest = fetch_dataset(
            source,
            folder,
            manifest_sha256=sha256,
            report=lambda done, total: bars.update(task, completed=done, total=total),
            tell=err.print,
        )
    size = sum(one.bytes for one in manifest.files) / 1e6
    out.print(f"{plural(len(manifest.files), 'file')}, {size:,.1f} MB, every digest correct")
    out.print(f"dataset: {target}   (next: {manifest.next_command(target)})", soft_wrap=True)


COMMANDS = {
    "generate": Command(
        generate_command,
        (
            "generate quickstart",
            "generate recipes/paper.yaml --dry-run --machines 8",
            "generate my_recipe.yaml --out datasets/mine --workers 2",
            "generate quickstart --shard 2/3 --out shard2",
            "generate quickstart --from shard1 --from shard2 --from shard3",
        ),
        Panel.GENERATE,
        FINISHED_WORK_IS_KEPT,
    ),
    "verify": Command(verify_command, ("verify datasets/quickstart",), Panel.SHARE),
    "fetch": Command(fetch_command, ("fetch https://example.org/quickstart",), Panel.SHARE, FINISHED_WORK_IS_KEPT),
}
"""The commands of this file, by the words that call them."""
