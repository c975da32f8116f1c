"""Commands that judge focus methods: ``evaluate``, ``score``, ``methods``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from saf_gen.cli._terminal import OutFolder, fail, out, progress_bars
from saf_gen.errors import BadInput

__all__ = ["evaluate", "methods", "score"]


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
    with progress_bars() as bars:
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
        fail(f"{failure.sequence} could not be evaluated: {failure.problem}", 1)
    if result.failures:
        raise typer.Exit(1)


def _beside(source: Path) -> Path:
    """Where results go unless told: in the dataset's folder, or beside a stream."""
    return source / "evaluation" if source.is_dir() else source.with_name(f"{source.stem}-evaluation")


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
