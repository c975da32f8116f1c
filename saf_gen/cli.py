"""The command line: parses, calls, prints. The one place that prints, and the one door to typer."""

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

import saf_gen
from saf_gen.errors import BadInput, SafGenError
from saf_gen.host import uninterrupted

if TYPE_CHECKING:
    from saf_gen.work import Work

app = typer.Typer(
    help="Spike-camera autofocus data from physics, and the benchmark that ranks autofocus methods on it.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
scenes_app = typer.Typer(help="Scenes that recipes can name.", no_args_is_help=True)
recipes_app = typer.Typer(help="Recipes of datasets.", no_args_is_help=True)
app.add_typer(scenes_app, name="scenes")
app.add_typer(recipes_app, name="recipes")

# Names are printed as they are: brackets in a path are no markup.
out = Console(width=None if sys.stdout.isatty() else 160, markup=False, highlight=False)
err = Console(stderr=True, soft_wrap=True, markup=False, highlight=False)

STOPPED = 130
OutFolder = Annotated[Path | None, typer.Option("--out", help="Folder to write to.")]


def main(argv: list[str] | None = None) -> NoReturn:
    """Run a command; every error a user can cause ends in one line and exit code 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without θ or ┃ gets a question mark
    try:
        code = app(args=argv, standalone_mode=False)
        if code == STOPPED:  # what typer makes of Ctrl-C
            _fail("stopped; what was done is kept: run the same command again to go on", STOPPED)
    except SafGenError as error:
        code = _fail(str(error), error.exit_code)
    except typer.TyperException as error:
        message = error.format_message()  # empty where the help was shown in its place
        code = _fail(f"{message}; see: saf-gen --help", 2) if message else 2
    except (SystemExit, BrokenPipeError):  # so typer leaves when a pipe closes: `| head` has its lines
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # python flushes while it exits
        code = 0
    except OSError as error:  # a disk or a terminal that went away
        code = _fail(f"{error.filename or 'the output'}: {error.strerror or error}", 1)
    sys.exit(code or 0)


def _fail(line: str, code: int) -> int:
    err.print(Text.assemble(("saf-gen:", "bold red"), " ", " ".join(line.split())))
    return code


@contextmanager
def _bars() -> Iterator[Progress]:
    """Progress bars with the time left, on stderr so that stdout stays clean for pipes."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=err, disable=not err.is_terminal) as progress:
        yield progress


@app.command()
def generate(
    recipe: Annotated[Path, typer.Argument(help="A recipe, such as recipes/quickstart.yaml.")],
    folder: OutFolder = None,
    workers: Annotated[int, typer.Option(min=1, max=256, help="Sequences recorded at a time.")] = 1,
    cluster: Annotated[str | None, typer.Option(help="Address of a Dask scheduler to run on.")] = None,
    shard: Annotated[str, typer.Option(help="I/N: make every N-th sequence from the I-th on.")] = "1/1",
    variant: Annotated[str, typer.Option(help="auto, llvm, cuda or scalar.")] = "auto",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would be made.")] = False,
) -> None:
    """Make a dataset from a recipe, or go on with one that was stopped."""
    with uninterrupted():
        from saf_gen.generate import generate as make
        from saf_gen.work import prepare

    work = prepare(recipe, part=_shard(shard))
    target = folder or Path("datasets") / work.recipe.name
    if dry_run:
        _print_plan(work, target)
        return
    with _bars() as bars:
        tasks: dict[str, TaskID] = {}
        told: set[str] = set()

        def tell(name: str, done: float) -> None:
            if name not in tasks:
                tasks[name] = bars.add_task(name, total=1.0)
            bars.update(tasks[name], completed=done)
            if done >= 1 and not err.is_terminal and name not in told:
                told.add(name)  # a log file has no bars: a line for each piece that is done
                err.print(f"done: {name}")

        outcome = make(work, target, workers=workers, variant=variant, cluster=cluster, tell=tell)
    out.print(
        f"{len(outcome.recorded)} sequences recorded, {len(outcome.kept)} kept from before, "
        f"{len(outcome.rendered)} pieces of focal stacks rendered"
    )
    out.print(f"dataset: {target}   (next: saf-gen evaluate {target})")
    for name, problem in outcome.failed.items():
        _fail(f"{name} failed: {problem}", outcome.exit_code)
    if outcome.failed:
        raise typer.Exit(outcome.exit_code)


def _shard(text: str) -> tuple[int, int]:
    index, _, count = text.partition("/")
    if not (index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        raise BadInput(f"--shard is {text!r}", allowed="I/N with I from 1 to N, such as 2/8")
    return int(index), int(count)


def _print_plan(work: "Work", target: Path) -> None:
    table = Table(title=f"{work.recipe.name}: {len(work.sequences)} sequences in {target}")
    for column in ("sequence", "split", "frames", "seed", "already there"):
        table.add_column(column)
    for s in work.sequences:
        there = "yes" if (target / s.file).exists() else "no"
        table.add_row(s.id, s.split, str(work.recipe.camera.frames), str(s.seed), there)
    out.print(table)
    missing = work.stacks_missing(target)
    out.print(f"focal stacks to render: {', '.join(missing) or 'none, all are there'}")
    seconds, needed = work.seconds_expected(target), work.bytes_expected(target)
    out.print(
        f"disk still needed: about {needed / 1e9:.2f} GB; time: about {seconds:.0f} s on two cores with LLVM"
    )


@app.command()
def evaluate(
    source: Annotated[Path, typer.Argument(help="A dataset folder or a stream file.")],
    split: Annotated[str | None, typer.Option(help="Only this split.")] = None,
    method: Annotated[
        list[str] | None, typer.Option(help="MEASURE+SEARCH, options after a colon; may be given again.")
    ] = None,
    folder: OutFolder = None,
    track: Annotated[str, typer.Option(help="recorded: all methods see the same sweep.")] = "recorded",
    region: Annotated[str, typer.Option(help="target (box round the target) or frame.")] = "target",
) -> None:
    """Run focus methods over recordings, rank them, draw their curves."""
    from saf_gen.evaluate import evaluate as run
    from saf_gen.files import check_writable
    from saf_gen.leaderboard import columns, table, write_files
    from saf_gen.report import write_report

    if track != "recorded":
        raise BadInput(f"unknown track {track!r}", allowed="recorded")
    target = folder or _beside(source)
    check_writable(target)
    with _bars() as bars:
        task = bars.add_task("evaluate", total=1)

        def step(done: int, total: int, what: str) -> None:
            bars.update(task, completed=done, total=total, description=f"evaluate {what}")

        result = run(source, methods=method, split=split, region=region, progress=step)
    rows = table(result.records)
    # A narrow terminal gets the columns that rank; the files have them all.
    shown = [column for column in columns(rows) if out.width >= 150 or not column.minor]
    if out.width < 75:
        shown = [c for c in shown if c.name in ("rank", "method", "success_1dof", "median_error_dof")]
    board = Table(title=f"{source}: {len(result.sweeps)} sequences, region {region}")
    for column in shown:
        board.add_column(column.header, justify=column.justify, no_wrap=column.name == "method")
    for row in rows:
        board.add_row(*(column.text(row) for column in shown))
    out.print(board)
    tables = write_files(target, rows=rows, records=result.records, failures=result.failures)
    pictures = write_report(target, rows=rows, evaluation=result, title=source.resolve().name)
    for path in (*tables, *pictures):
        out.print(str(path), soft_wrap=True)
    for failure in result.failures:
        _fail(f"{failure.sequence} could not be evaluated: {failure.problem}", 1)
    if result.failures:
        raise typer.Exit(1)


def _beside(source: Path) -> Path:
    """Where results go unless told: in the dataset's folder, or beside a stream."""
    return source / "evaluation" if source.is_dir() else source.with_name(f"{source.stem}-evaluation")


@app.command()
def score(
    stream: Annotated[Path, typer.Argument(help="A stream file.")],
    measure: Annotated[str, typer.Option(help="A focus measure; see: saf-gen methods.")],
    window: Annotated[int, typer.Option(min=1, help="Frames a block.")],
    csv: Annotated[Path | None, typer.Option("--out", help="Write here rather than to the terminal.")] = None,
    region: Annotated[str, typer.Option(help="frame, or target (box round the target).")] = "frame",
) -> None:
    """Score consecutive blocks of a stream: columns `frame` (first of the block, from 0) and `score`."""
    from saf_gen.dataset import write_text
    from saf_gen.evaluate import score_curve
    from saf_gen.stream import open_stream

    with open_stream(stream) as opened:
        frames, scores = score_curve(opened, measure, window=window, region=region)
    text = "frame,score\n" + "".join(
        f"{f},{s!r}\n" for f, s in zip(frames.tolist(), scores.tolist(), strict=True)
    )
    if csv is None:
        out.file.write(text)
        return
    write_text(csv, text)
    out.print(f"{len(frames)} blocks in {csv}")


@app.command(name="import")
def import_(
    file: Annotated[Path, typer.Argument(help="A file of another camera or project.")],
    target: Annotated[Path, typer.Option("--out", help="The stream to write.")],
    layout: Annotated[str, typer.Option(help="416, dense or sps1000.")] = "416",
    frames: Annotated[int | None, typer.Option(min=1, help="Only so many frames.")] = None,
    rate: Annotated[float, typer.Option(help="Readouts a second; no such file records it.")] = 20_000.0,
    flip: Annotated[bool | None, typer.Option(help="Bottom row first (default: as the layout is).")] = None,
) -> None:
    """Turn somebody else's spike file into a stream."""
    from saf_gen.interop import import_file
    from saf_gen.stream import open_stream

    digest = import_file(file, target, layout=layout, frames=frames, readout_hz=rate, flip=flip)
    with open_stream(target) as stream:
        count, rows, columns = stream.shape
    out.print(f"{count} frames of {columns}×{rows} in {target}, sha256 {digest[:16]}…")


@app.command()
def export(
    stream: Annotated[Path, typer.Argument(help="A stream file.")],
    target: Annotated[Path, typer.Option("--out", help="The file to write.")],
    layout: Annotated[str, typer.Option(help="416, dense or sps1000.")] = "416",
) -> None:
    """Write a stream in somebody else's layout."""
    from saf_gen.interop import export_file

    out.print(f"{export_file(stream, target, layout=layout)} bytes in {target}")


@app.command()
def inspect(stream: Annotated[Path, typer.Argument(help="A stream file.")]) -> None:
    """Say what is in a stream: size, light, truth, how it was made."""
    from saf_gen.inspection import describe
    from saf_gen.stream import open_stream

    with open_stream(stream) as opened:
        facts = describe(opened)
    table = Table(show_header=False, title=str(stream))
    for name, value in facts.items():
        table.add_row(name, value)
    out.print(table)


@app.command()
def verify(dataset: Annotated[Path, typer.Argument(help="A dataset folder.")]) -> None:
    """Check every sequence of a dataset against its manifest, bit by bit."""
    from saf_gen.inspection import check_dataset

    count, problems = check_dataset(dataset)
    for name, problem in problems.items():
        _fail(f"{name}: {problem}", 1)
    out.print(f"{count - len(problems)} of {count} sequences are whole")
    if problems:
        raise typer.Exit(1)


@app.command()
def methods() -> None:
    """List focus measures and searches, each with what it does."""
    from saf_gen import registry

    for room in ("measures", "searches"):
        table = Table(title=room)
        table.add_column("name", no_wrap=True)
        table.add_column("what it is")
        for name in registry.names(room):
            doc = registry.part_class(room, name).__doc__ or ""
            table.add_row(name, " ".join(doc.split("\n\n")[0].split()))
        out.print(table)
    out.print(
        "A method is MEASURE+SEARCH, such as sd_code+sgfs_code:dt=50. NAME_n divides a measure by brightness."
    )


@scenes_app.command("list")
def scenes_list() -> None:
    """List the scenes that can be found."""
    from saf_gen.scene import find_scene, scene_names

    table = Table("scene", "title", "light groups", "lens", "licence")
    for name in scene_names():
        card = find_scene(name).card
        lens = f"{card.lens.focal_length_mm:g} mm f/{card.lens.f_number:g}"
        table.add_row(name, card.title, ", ".join(card.lights), lens, card.licence)
    out.print(table)


@recipes_app.command("check")
def recipes_check(recipe: Annotated[Path, typer.Argument(help="A recipe.")]) -> None:
    """Check a recipe and all that it names, without making anything."""
    from saf_gen.work import prepare

    work = prepare(recipe)
    out.print(f"{recipe} is fine: {len(work.sequences)} sequences of {', '.join(work.scenes)}")


@app.command()
def bench(
    names: Annotated[list[str] | None, typer.Argument(help="stream, stack; all where none is named.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Figures as JSON.")] = False,
) -> None:
    """Measure speed, size and memory at full size, each figure with its target (a few minutes)."""
    from saf_gen.bench import Size, run

    figures = run(names or [], Size(), progress=lambda name: err.print(f"bench {name}"))
    if as_json:
        out.file.write(
            json.dumps([asdict(figure) for figure in figures], indent=1, ensure_ascii=False) + "\n"
        )
        return
    table = Table("bench", "what", "measured", "unit", "target", "met")
    marks = {True: "yes", False: "no", None: ""}
    for f in figures:
        target = "" if f.target is None else f"{'≤' if f.at_most else '≥'} {f.target:g}"
        table.add_row(f.bench, f.what, f"{f.value:.3g}", f.unit, target, marks[f.met])
    out.print(table)


@app.command()
def doctor() -> None:
    """Say what this machine can do, and what would make it faster."""
    from saf_gen.machine import facts

    described, advice = facts()
    table = Table(show_header=False, title=f"saf-gen {saf_gen.__version__}")
    for name, value in described.items():
        table.add_row(name, value)
    out.print(table)
    for line in advice:
        out.print(f"to be faster: {line}")
