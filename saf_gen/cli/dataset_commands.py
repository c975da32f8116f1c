"""The commands ``generate`` and ``verify``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import TaskID

from saf_gen.cli._tables import TableColumn, print_table
from saf_gen.cli._terminal import ClusterAddress, OutFolder, RecipeName, err, out, print_error, print_progress_bars
from saf_gen.core.cores import defer_interrupts
from saf_gen.errors import BadInput

if TYPE_CHECKING:
    from saf_gen.generate.resolve import ResolvedRecipe


def generate_command(
    recipe: RecipeName,
    *,
    folder: OutFolder = None,
    workers: Annotated[int, typer.Option(min=1, max=256, help="Number of sequences to record at the same time.")] = 1,
    cluster: ClusterAddress = None,
    split: Annotated[str | None, typer.Option(help="Generate only this split.")] = None,
    shard: Annotated[str, typer.Option(help="I/N: generate every N-th sequence, starting with the I-th.")] = "1/1",
    variant: Annotated[str, typer.Option(help="Renderer: auto, cuda, llvm or scalar.")] = "auto",
    keep_slices: Annotated[
        str, typer.Option(help="Time slices of moving scenes to keep in the end: all, closed-loop or none.")
    ] = "all",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print what would be made, and make nothing.")] = False,
) -> None:
    """Generate a dataset from a recipe, or resume one that was stopped."""
    with defer_interrupts():
        from saf_gen.generate.coarse_sampling import find_coarse_recipe_sampling
        from saf_gen.generate.job_order import validate_generated_slices_kept
        from saf_gen.generate.resolve import resolve_recipe
        from saf_gen.generate.run import generate as make

    validate_generated_slices_kept(keep_slices)
    work = resolve_recipe(recipe, part=parse_shard_of_command(shard), split=split)
    target = folder or Path("datasets") / work.recipe.name
    if work.stacks_to_render(target, keep_slices) and not cluster:
        _look_for_renderer(variant, dry_run=dry_run)
    for line in find_coarse_recipe_sampling(work):
        err.print(f"warning: {line}")
    if dry_run:
        _print_plan(work, target, keep_slices=keep_slices)
        return
    with print_progress_bars() as bars:
        tasks: dict[str, TaskID] = {}
        finished: set[str] = set()

        def report(name: str, done: float) -> None:
            if name in finished:
                return
            if name not in tasks:
                tasks[name] = bars.add_task(name, total=1.0)
            bars.update(tasks[name], completed=done)
            if done >= 1:  # a bar for each of thousands would hide those that move, and slow the run down
                finished.add(name)
                bars.remove_task(tasks.pop(name))
                err.print(f"done: {name}")

        result = make(
            work,
            target,
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
    out.print(f"dataset: {target}   (next: saf-gen evaluate {target})")
    if result.without_diffraction:
        out.print("rendered without diffraction: only the variants llvm and cuda have it")
    for name, problem in result.failed.items():
        print_error(f"{name} failed: {problem}", result.exit_code)
    if result.failed:
        raise typer.Exit(result.exit_code)


def _look_for_renderer(variant: str, *, dry_run: bool) -> None:
    """Say on stderr that scenes will be rendered slowly, where nobody asked for that.

    Without any renderer a dry run says so, and all else raises BadInput.
    """
    try:
        from saf_gen.render import backend
    except BadInput as missing:
        if not dry_run:
            raise
        err.print(f"scenes cannot be rendered here: {missing}")
        return
    if variant == "auto" and backend.choose_render_backend() == "scalar":
        err.print(f"scenes are rendered by variant scalar here, slowly and without diffraction; {backend.ADVICE}")


def parse_shard_of_command(text: str) -> tuple[int, int]:
    """Return (I, N) of "I/N"; raise BadInput where it is not that."""
    index, _, count = text.partition("/")
    if not (index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        raise BadInput(f"--shard is {text!r}", allowed="I/N with I from 1 to N, such as 2/8")
    return int(index), int(count)


def _print_plan(work: "ResolvedRecipe", target: Path, *, keep_slices: str) -> None:
    from saf_gen.generate.job_order import KEEP_SLICES

    planned, frames = [sequence.planned for sequence in work.sequences], f"{work.recipe.camera.frames:,}"
    columns = TableColumn("sequence"), TableColumn("split"), TableColumn("frames", detail=1)
    print_table(
        [*columns, TableColumn("seed", detail=2), TableColumn("there already")],
        [(s.id, s.split, frames, str(s.seed), "yes" if (target / s.file).exists() else "no") for s in planned],
        title=f"{work.recipe.name}: {len(planned)} sequences in {target}",
        elsewhere="in a wider terminal or a pipe",
    )
    missing = [users[0].stack_label(stack) for stack, users in work.stacks_to_render(target, keep_slices).items()]
    out.print(f"focal stacks to render: {'; '.join(missing) or 'none, all are there'}")
    seconds, needed = work.estimate_seconds(target, keep_slices), work.estimate_bytes(target, keep_slices)
    sizes = {choice: work.kept_slice_bytes(choice) for choice in KEEP_SLICES}
    if sizes["all"]:
        listed = ", ".join(f"{choice} {size / 1e9:.2f} GB" for choice, size in sizes.items())
        out.print(f"time slices kept in the end: {listed}; chosen: --keep-slices {keep_slices}")
    out.print(f"disk still needed: about {needed / 1e9:.2f} GB; time: about {seconds:.0f} s on two cores with LLVM")


def verify_command(dataset: Annotated[Path, typer.Argument(help="Dataset folder.")]) -> None:
    """Check every file of a dataset against the digest in its manifest."""
    from saf_gen.stream.inspection import verify_streams_of_dataset

    count, problems = verify_streams_of_dataset(dataset)
    for name, problem in problems.items():
        print_error(f"{name}: {problem}", 1)
    out.print(f"{count - len(problems)} of {count} sequences are whole")
    if problems:
        raise typer.Exit(1)
