"""The commands ``bench`` and ``doctor``."""

import json
import math
from dataclasses import asdict
from typing import Annotated, Any

import typer
from rich.progress import TaskID
from rich.table import Table

import saf_gen
from saf_gen.cli._terminal import err, out, print_error, progress_bars


def bench(
    names: Annotated[
        list[str] | None, typer.Argument(help="stack, grain, encode, stream, score or job (default: all).")
    ] = None,
    *,
    scenes: Annotated[
        list[str] | None, typer.Option("--scene", help="Scene for the bench grain; repeat for more (default: all).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Measure speed, file size and memory at full size, each beside its target (about twenty minutes)."""
    from saf_gen.scene.scene_folder import find_scene
    from saf_gen.speed import BenchSize, run_benches

    for scene in scenes or ():
        find_scene(scene)
    with progress_bars() as bars:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, done: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
                if not err.is_terminal:
                    err.print(stage)
            bars.update(tasks[stage], completed=done)

        results = run_benches(names or [], BenchSize(scenes=tuple(scenes or ())), report=report)
    if as_json:
        figures = [_finite({**asdict(figure), "met": figure.met}) for figure in results.figures]
        out.file.write(json.dumps(figures, indent=1, ensure_ascii=False) + "\n")
    else:
        table = Table("bench", "what", "measured", "unit", "target", "met")
        marks = {True: "yes", False: "no", None: ""}
        for f in results.figures:
            target = "" if f.target is None else f"{'≤' if f.at_most else '≥'} {f.target:g}"
            value = _number(f.value)
            if f.low is not None and f.high is not None:
                value += f" ({_number(f.low)} to {_number(f.high)})"
            table.add_row(f.bench, f.what, value, f.unit, target, marks[f.met])
        out.print(table)
    for remark in results.remarks:
        err.print(remark)
    for name, problem in results.failed.items():
        print_error(f"bench {name} failed: {problem}", problem.exit_code)
    if results.failed:
        raise typer.Exit(1 if results.figures else max(e.exit_code for e in results.failed.values()))


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


def _finite(figure: dict[str, Any]) -> dict[str, Any]:
    """Return a figure for JSON, which has no word for what is infinite or no number."""
    return {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in figure.items()}


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
