"""The commands ``init``, ``bench`` and ``doctor``."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import TaskID

import saf_gen
from saf_gen.cli._bench_table import print_figures, print_scene_grain
from saf_gen.cli._tables import TableColumn, finite_value, print_json, print_table
from saf_gen.cli._terminal import AsJson, err, out, print_error, progress_bars
from saf_gen.errors import BadInput


def init_command(
    folder: Annotated[Path, typer.Argument(help="Folder to work in, which is created if it is missing.")] = Path(),
    *,
    forget: Annotated[bool, typer.Option("--forget", help="Stop trusting the folder; no file is removed.")] = False,
) -> None:
    """Register a folder to work in: its scenes are found by name there, and their code is trusted.

    A scene of the folder then replaces one of the same name that comes with saf_gen. Until the folder is registered,
    no script in its scenes/ runs, so read scripts that others sent you first.
    """
    from saf_gen.core.files import unwritable
    from saf_gen.scene.scene_folder import CARD_FILE
    from saf_gen.scene.trusted_folders import forget_folder, register_folder

    scenes = folder / "scenes"
    shown = scenes.resolve()
    if forget:
        was_registered = forget_folder(scenes)
        out.print(
            f"{shown} is {'no longer' if was_registered else 'not'} registered; its files are unchanged", soft_wrap=True
        )
        return
    try:
        scenes.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(scenes, error) from error
    is_new = register_folder(scenes)
    out.print(f"{shown} {'is' if is_new else 'was'} registered{'' if is_new else ' already'}", soft_wrap=True)
    if scene_names := sorted(card.parent.name for card in scenes.glob(f"*/{CARD_FILE}")):
        out.print(f"scenes found by name in {folder.resolve()}: {', '.join(scene_names)}", soft_wrap=True)
    out.print("next: saf-gen scenes new my_scene; saf-gen generate quickstart")


def bench_command(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Benches: stack, grain, encode, stream, windows, score, rates, job (default: all)."),
    ] = None,
    *,
    scenes: Annotated[
        list[str] | None, typer.Option("--scene", help="Scene for the bench grain; repeatable (default: all).")
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option("--out", help="Folder that keeps the grain of each scene, so that the same command can resume."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure speed, file size and memory at full size, and compare them with their targets (about twenty minutes)."""
    if names and "grain" not in names and (scenes or folder):
        option = "--scene" if scenes else "--out"
        raise BadInput(f"{option} is for the bench grain, which is not among {', '.join(names)}", hint="leave it out")
    from saf_gen.acceptance.speed import BenchFigure, BenchSize, SceneResult, run_benches
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

        def show(scene: SceneResult) -> None:
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
        values = [{**asdict(figure), "met": figure.met} for figure in results.figures]
        finite = [{k: finite_value(v) if isinstance(v, float) else v for k, v in one.items()} for one in values]
        print_json(finite)
    elif results.figures:
        print_figures(f for f in results.figures if f not in shown)
    for remark in results.remarks:
        err.print(remark)
    for name, problem in results.failed.items():
        print_error(f"bench {name} failed: {problem}", problem.exit_code)
    if results.failed:
        raise typer.Exit(1 if results.figures else max(e.exit_code for e in results.failed.values()))


def doctor_command(*, as_json: AsJson = False) -> None:
    """Show the renderer, hardware and versions of this machine, and what would make it faster."""
    from saf_gen.acceptance.speed.machine_check import describe_machine_to_bench

    described, advice = describe_machine_to_bench()
    print_table(
        [TableColumn(""), TableColumn("", folds=True)],
        described.items(),
        title=f"saf-gen {saf_gen.__version__}",
        as_json=as_json,
    )
    for line in () if as_json else advice:
        out.print(line)
