"""The complete pipeline: the dataset of Su et al. (CVPR 2024) from recipe to leaderboard, then under another light."""

import json
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from saf_gen.acceptance.speed.bench_figure import BenchFigure, BenchSize
from saf_gen.acceptance.speed.fresh_process import time_benched_call
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.core.execution.job import ReportProgress
from saf_gen.errors import SafGenError
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import GenerationResult, generate
from saf_gen.generate.shipped_recipes import find_recipe
from saf_gen.leaderboard import rank_methods, write_leaderboard
from saf_gen.leaderboard.report import write_report
from saf_gen.stream.manifest import ALL_SPLITS

MAX_S = 120.0
PAPER_RECIPE = "sad_core"
OTHER_LIGHT: dict[str, Any] = {"kind": "ramp", "from": 2.0, "to": 0.5}


def run_bench(size: BenchSize, report: ReportProgress) -> Iterator[BenchFigure]:
    """Yield the time from recipe to leaderboard, and the time to record again under another light schedule."""
    recipe = find_recipe(size.recipe or PAPER_RECIPE)
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) / "dataset"
        _, generating = time_benched_call(_generate, recipe, folder, report=report)
        report("leaderboard", 0.0)
        _, ranking = time_benched_call(_rank, folder)
        report("leaderboard", 1.0)
        work = resolve_recipe(recipe)
        what = f"{recipe.stem}, {len(work.sequences)} sequences of {work.recipe.camera.frames:,} frames"
        yield BenchFigure("job", f"{what}: recipe to streams", generating, "s")
        yield BenchFigure("job", f"{what}: streams to leaderboard", ranking, "s")
        yield BenchFigure("job", f"{what}: recipe to leaderboard", generating + ranking, "s", MAX_S, at_most=True)
        again = _write_other_recipe(recipe, Path(temporary))
        result, seconds = time_benched_call(_generate, again, folder, report=report)
        what = f"under a new light, stacks there, {len(result.recorded)} recorded"
        yield BenchFigure("job", what, seconds, "s")
        yield BenchFigure(
            "job", "pieces of stacks rendered for them", len(result.rendered), "pieces", 0.0, at_most=True
        )


def _generate(recipe: Path, folder: Path, *, report: ReportProgress) -> GenerationResult:
    result = generate(resolve_recipe(recipe), folder, report=report)
    for error in result.failed.values():
        raise error
    return result


def _rank(folder: Path) -> None:
    """Evaluate all splits of a dataset, and write its leaderboard and page, as ``saf-gen evaluate`` does."""
    result, target = evaluate(folder, split=ALL_SPLITS), folder / "evaluation"
    for failure in result.failures:
        raise SafGenError(f"{failure.sequence} could not be evaluated: {failure.problem}")
    rows = rank_methods(result.records)
    write_leaderboard(target, rows=rows, records=result.records, failures=result.failures)
    write_report(target, rows=rows, evaluation=result, title=folder.name)


def _write_other_recipe(recipe: Path, folder: Path) -> Path:
    """Write the recipe with OTHER_LIGHT as its only light schedule, in JSON, which is also YAML; return the path."""
    data = read_recipe(recipe).model_dump(mode="json")
    data["lights"] = {"other": OTHER_LIGHT}
    for split in data["splits"].values():
        split["lights"] = ["other"]
    path = folder / "other.yaml"
    path.write_text(json.dumps(data, indent=1))
    return path
