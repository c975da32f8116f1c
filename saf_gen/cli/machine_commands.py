"""The commands ``bench`` and ``doctor``."""

import json
from dataclasses import asdict
from typing import Annotated

import typer
from rich.progress import TaskID
from rich.table import Table

import saf_gen
from saf_gen.cli._terminal import err, out, print_error, progress_bars


def bench(
    names: Annotated[
        list[str] | None, typer.Argument(help="stack, encode, stream, score or job (default: all).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Measure speed, file size and memory at full size, each beside its target (about eight minutes)."""
    from saf_gen.speed import BenchSize, run_benches

    with progress_bars() as bars:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, done: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
                if not err.is_terminal:
                    err.print(stage)
            bars.update(tasks[stage], completed=done)

        results = run_benches(names or [], BenchSize(), report=report)
    if as_json:
        figures = [{**asdict(figure), "met": figure.met} for figure in results.figures]
        out.file.write(json.dumps(figures, indent=1, ensure_ascii=False) + "\n")
    else:
        table = Table("bench", "what", "measured", "unit", "target", "met")
        marks = {True: "yes", False: "no", None: ""}
        for f in results.figures:
            target = "" if f.target is None else f"{'≤' if f.at_most else '≥'} {f.target:g}"
            value = f"{f.value:,.0f}" if f.value >= 1000 else f"{f.value:.3g}"
            table.add_row(f.bench, f.what, value, f.unit, target, marks[f.met])
        out.print(table)
    for remark in results.remarks:
        err.print(remark)
    for name, problem in results.failed.items():
        print_error(f"bench {name} failed: {problem}", problem.exit_code)
    if results.failed:
        raise typer.Exit(1 if results.figures else max(e.exit_code for e in results.failed.values()))


def doctor() -> None:
    """Show what this machine renders with, and what would make it faster."""
    from saf_gen.speed.machine_check import describe_installation

    described, advice = describe_installation()
    table = Table(show_header=False, title=f"saf-gen {saf_gen.__version__}")
    for name, value in described.items():
        table.add_row(name, value)
    out.print(table)
    for line in advice:
        out.print(f"to be faster: {line}")
