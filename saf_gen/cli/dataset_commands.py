"""The commands ``generate`` and ``verify``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import TaskID

from saf_gen.cli._tables import print_table
from saf_gen.cli._terminal import ClusterAddress, RecipeName, err, out, print_error, progress_bars
from saf_gen.core.cores import defer_interrupts
from saf_gen.core.object_store import AnyPath, StorePath, find_path
from saf_gen.core.table import Column, Table
from saf_gen.errors import BadInput

if TYPE_CHECKING:
    from saf_gen.generate.plan import PlannedSequence
    from saf_gen.generate.resolve import ResolvedRecipe
    from saf_gen.generate.to_store import StorePlan


def generate_command(
    recipe: RecipeName,
    *,
    folder: Annotated[
        Path | None, typer.Option("--out", help="Folder to write to, or s3://BUCKET/FOLDER in an object store.")
    ] = None,
    workers: Annotated[int, typer.Option(min=1, max=256, help="Number of sequences to record at the same time.")] = 1,
    cluster: ClusterAddress = None,
    split: Annotated[str | None, typer.Option(help="Generate only this split.")] = None,
    shard: Annotated[str, typer.Option(help="I/N: generate every N-th sequence, starting with the I-th.")] = "1/1",
    variant: Annotated[str, typer.Option(help="Renderer: auto, cuda, llvm or scalar.")] = "auto",
    keep_slices: Annotated[
        str, typer.Option(help="Time slices of moving scenes to keep at the end: all, closed-loop or none.")
    ] = "all",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print what would be made, with its time and disk, and make nothing.")
    ] = False,
    machines: Annotated[
        int, typer.Option(min=1, max=10_000, help="With --dry-run: machines that share the work, as with --cluster.")
    ] = 1,
) -> None:
    """Generate a dataset from a recipe, or resume one that was stopped."""
    if machines > 1 and not dry_run:
        raise BadInput(f"--machines is {machines}", allowed="with --dry-run alone", hint="start machines: --cluster")
    with defer_interrupts():
        from saf_gen.generate.benchmark_digest import benchmark_name
        from saf_gen.generate.coarse_sampling import coarse_sampling
        from saf_gen.generate.job_order import validate_keep_slices
        from saf_gen.generate.resolve import resolve_recipe
        from saf_gen.generate.run import generate as make
        from saf_gen.generate.to_store import generate_to_store, plan_for_store

    validate_keep_slices(keep_slices)
    work = resolve_recipe(recipe, part=_parse_shard(shard), split=split)
    benchmark_name(work)
    target = find_path(folder or Path("datasets") / work.recipe.name)
    store_plan = plan_for_store(work, target) if isinstance(target, StorePath) else None
    to_render = store_plan.stacks if store_plan else work.stacks_to_render(Path(str(target)), keep_slices)
    if to_render and not cluster:
        _warn_if_slow_renderer(variant, dry_run=dry_run)
    for line in coarse_sampling(work):
        err.print(f"warning: {line}")
    if store_plan and store_plan.upload_bytes:
        size = store_plan.scratch_bytes
        err.print(
            f"scratch: at most about {_gigabytes(size)} in {store_plan.scratch}, deleted once the store has everything"
        )
    if dry_run:
        _print_plan(work, target, keep_slices=keep_slices, store_plan=store_plan, workers=workers, machines=machines)
        return
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
                err.print(f"done: {name}")

        result = (generate_to_store if store_plan else make)(
            work,
            target,  # type: ignore[arg-type]  # each takes its own kind of path
            workers=workers,
            variant=variant,
            cluster=cluster,
            keep_slices=keep_slices,
            report=report,
            tell=err.print,
        )
    out.print(
        f"{len(result.recorded)} sequences recorded, {len(result.kept)} kept from before, "
        f"{len(result.rendered)} pieces of focal stacks rendered"
    )
    if result.freed_bytes:
        out.print(f"{result.freed_bytes / 1e6:,.0f} MB of time slices deleted (--keep-slices {keep_slices})")
    out.print(f"dataset: {target}   (next: {result.manifest.next_command(target)})", soft_wrap=True)
    if result.without_diffraction:
        out.print("rendered without diffraction: only the variants llvm and cuda support it")
    for name, problem in result.failed.items():
        print_error(f"{name} failed: {problem}", result.exit_code)
    if result.failed:
        raise typer.Exit(result.exit_code)


def _warn_if_slow_renderer(variant: str, *, dry_run: bool) -> None:
    """Warn on stderr if scenes will be rendered slowly and the user did not choose the slow renderer.

    If there is no renderer, a dry run prints the problem, and any other run raises BadInput.
    """
    try:
        from saf_gen.render import backend
    except BadInput as missing:
        if not dry_run:
            raise
        err.print(f"scenes cannot be rendered here: {missing}")
        return
    if variant == "auto" and backend.choose_backend() == "scalar":
        err.print(f"scenes are rendered by variant scalar here, slowly and without diffraction; {backend.ADVICE}")


def _parse_shard(text: str) -> tuple[int, int]:
    """Return (I, N) of the text "I/N"; raise BadInput if the text has another form."""
    index, _, count = text.partition("/")
    if not (index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        raise BadInput(f"--shard is {text!r}", allowed="I/N with I from 1 to N, such as 2/8")
    return int(index), int(count)


def _gigabytes(size: float) -> str:
    return f"{size / 1e9:.2f} GB"


def _print_plan(
    work: "ResolvedRecipe",
    target: AnyPath,
    *,
    keep_slices: str,
    store_plan: "StorePlan | None" = None,
    workers: int,
    machines: int,
) -> None:
    from saf_gen.generate.job_order import KEEP_SLICES

    def exists(sequence: "PlannedSequence") -> str:
        made = sequence.id in store_plan.in_store if store_plan else (target / sequence.file).exists()
        return "yes" if made else "no"

    frames = work.recipe.camera.frames
    columns = [
        Column("sequence", "id"),
        Column("split", "split"),
        Column("frames", lambda _: frames, ",", detail=1),
        Column("seed", "seed", detail=2),
        Column("exists", exists),
    ]
    planned = [sequence.planned for sequence in work.sequences]
    title = f"{work.recipe.name}: {len(planned)} sequences in {target}"
    print_table(Table(columns, planned, title), where_to_find="a wider terminal or a pipe shows them")
    here = Path(str(target))
    if store_plan:
        work, here = store_plan.missing, store_plan.scratch
        missing = store_plan.stacks
    else:
        missing = [users[0].stack_label(stack) for stack, users in work.stacks_to_render(here, keep_slices).items()]
    out.print(f"focal stacks to render: {'; '.join(missing) or 'none, all exist'}")
    left = work.estimate_work(here, keep_slices, workers=workers, machines=machines)
    needed = work.estimate_bytes(here, keep_slices)
    sizes = {choice: work.kept_slice_bytes(choice) for choice in KEEP_SLICES}
    if sizes["all"]:
        listed = ", ".join(f"{choice} {_gigabytes(size)}" for choice, size in sizes.items())
        out.print(f"time slices kept at the end: {listed}; chosen: --keep-slices {keep_slices}")
    if store_plan:
        out.print(f"to upload to {target}: about {_gigabytes(store_plan.upload_bytes)}")
        needed = store_plan.scratch_bytes
    out.print(
        f"jobs: {left.stacks:,} to render, about {_time(left.render_s)} on one machine; "
        f"{left.recordings:,} to record, about {_time(left.record_s)}"
    )
    who = "two cores with LLVM" if machines == 1 else f"{machines} machines of two cores with LLVM"
    out.print(f"disk still needed: about {_gigabytes(needed)}; time: about {_time(left.seconds)} on {who}")


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:,.1f} h"


def verify_command(dataset: Annotated[Path, typer.Argument(help="Dataset folder, or s3://BUCKET/FOLDER.")]) -> None:
    """Check every file of a dataset against the digest in its manifest."""
    from saf_gen.stream.dataset import verify_dataset

    count, problems = verify_dataset(dataset)
    for name, problem in problems.items():
        print_error(f"{name}: {problem}", 1)
    out.print(f"{count - len(problems)} of {count} sequences are intact")
    if problems:
        raise typer.Exit(1)
