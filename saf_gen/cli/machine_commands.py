"""The commands ``bench`` and ``doctor``."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import TaskID

import saf_gen
from saf_gen.cli._bench_table import print_figures, print_scene_grain
from saf_gen.cli._tables import TableColumn, print_json, print_table
from saf_gen.cli._terminal import AsJson, err, out, print_error, progress_bars
from saf_gen.errors import BadInput


def bench(
    names: Annotated[
        list[str] | None, typer.Argument(help="stack, grain, encode, stream, score or job (default: all).")
    ] = None,
    *,
    scenes: Annotated[
        list[str] | None, typer.Option("--scene", help="Scene for the bench grain; repeat for more (default: all).")
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option("--out", help="Folder that keeps the grain of each scene: the same command then goes on there."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Measure speed, file size and memory at full size, each beside its target (about twenty minutes)."""
    if names and "grain" not in names and (scenes or folder):
        option = "--scene" if scenes else "--out"
        raise BadInput(f"{option} is for the bench grain, which is not among {', '.join(names)}", hint="leave it out")
    from saf_gen.acceptance.speed import BenchFigure, BenchSize, SceneFound, run_benches
    from saf_gen.scene.scene_folder import find_scene

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

        shown: list[BenchFigure] = []

        def show(scene: SceneFound) -> None:
            figures = [f for f in scene.found if isinstance(f, BenchFigure)]
            if figures and not as_json:
                shown.extend(figures)
                print_scene_grain(scene.scene, figures)
            seconds = scene.seconds_left
            left = f", about {seconds / 60:.0f} min left" if seconds else ""
            err.print(f"grain: {scene.scene} is done, {scene.number} of {scene.count}{left}")

        size = BenchSize(scenes=tuple(scenes or ()))
        results = run_benches(names or [], size, folder=folder, report=report, show=show)
    if as_json:
        figures = [_finite({**asdict(figure), "met": figure.met}) for figure in results.figures]
        print_json(figures)
    elif results.figures:
        print_figures(f for f in results.figures if f not in shown)
    for remark in results.remarks:
        err.print(remark)
    for name, problem in results.failed.items():
        print_error(f"bench {name} failed: {problem}", problem.exit_code)
    if results.failed:
        raise typer.Exit(1 if results.figures else max(e.exit_code for e in results.failed.values()))


def _finite(figure: dict[str, Any]) -> dict[str, Any]:
    """Return a figure for JSON, which has no word for what is infinite or no number."""
    return {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in figure.items()}


def doctor(*, as_json: AsJson = False) -> None:
    """Show what this machine renders with, and what would make it faster."""
    from saf_gen.acceptance.speed.machine_check import describe_installation

    described, advice = describe_installation()
    print_table(
        [TableColumn(""), TableColumn("", folds=True)],
        described.items(),
        title=f"saf-gen {saf_gen.__version__}",
        as_json=as_json,
    )
    for line in () if as_json else advice:
        out.print(line)
