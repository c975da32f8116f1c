"""The whole line: the paper's synthetic set from its recipe to the leaderboard, then under another light."""

import json
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import saf_gen
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.errors import SafGenError
from saf_gen.generate.executor import ReportProgress
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import GenerationResult, generate
from saf_gen.leaderboard import rank_methods, write_leaderboard
from saf_gen.leaderboard.report import write_report
from saf_gen.speed.bench_figure import BenchFigure, BenchSize
from saf_gen.speed.fresh_process import time_call

__all__ = ["run_bench"]

MAX_S = 120.0
PAPERS_SET = Path(saf_gen.__file__).resolve().parent.parent / "recipes" / "sad_core.yaml"
OTHER: dict[str, Any] = {"kind": "ramp", "from": 2.0, "to": 0.5}


def run_bench(size: BenchSize, report: ReportProgress) -> Iterator[BenchFigure | str]:
    """Recipe to leaderboard in a fresh folder; then its scenes under a schedule that it does not have."""
    recipe = Path(size.recipe) if size.recipe else PAPERS_SET
    if not (size.recipe or recipe.is_file()):
        yield "job: left out: recipes/ is not beside the package"
        return
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) / "dataset"
        _, made = time_call(_generated, recipe, folder, report)
        report("leaderboard", 0.0)
        _, ranked = time_call(_ranked, folder)
        report("leaderboard", 1.0)
        work = resolve_recipe(recipe)
        what = f"{recipe.stem}, {len(work.sequences)} sequences of {work.recipe.camera.frames:,} frames"
        yield BenchFigure("job", f"{what}: recipe to streams", made, "s")
        yield BenchFigure("job", f"{what}: streams to leaderboard", ranked, "s")
        yield BenchFigure("job", f"{what}: recipe to leaderboard", made + ranked, "s", MAX_S, at_most=True)
        again = _under_another_light(recipe, Path(temporary))
        outcome, took = time_call(_generated, again, folder, report)
        what = f"under a new light, stacks there, {len(outcome.recorded)} recorded"
        yield BenchFigure("job", what, took, "s")
        yield BenchFigure(
            "job", "pieces of stacks rendered for them", len(outcome.rendered), "pieces", 0.0, at_most=True
        )


def _generated(recipe: Path, folder: Path, report: ReportProgress) -> GenerationResult:
    outcome = generate(resolve_recipe(recipe), folder, report=report)
    for error in outcome.failed.values():
        raise error
    return outcome


def _ranked(folder: Path) -> None:
    """What ``saf-gen evaluate`` does, but for the printing."""
    result, target = evaluate(folder), folder / "evaluation"
    for failure in result.failures:
        raise SafGenError(f"{failure.sequence} could not be evaluated: {failure.problem}")
    rows = rank_methods(result.records)
    write_leaderboard(target, rows=rows, records=result.records, failures=result.failures)
    write_report(target, rows=rows, evaluation=result, title=folder.name)


def _under_another_light(recipe: Path, folder: Path) -> Path:
    """The same recipe with one schedule, not among its own; JSON is YAML."""
    data = read_recipe(recipe).model_dump(mode="json")
    data["lights"] = {"other": OTHER}
    for split in data["splits"].values():
        split["lights"] = ["other"]
    path = folder / "other.yaml"
    path.write_text(json.dumps(data, indent=1))
    return path
