"""The complete pipeline: the dataset of Su et al. (CVPR 2024) from recipe to leaderboard, then under another light."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.errors import SafGenError
from saf_gen.generate.recipe import find_recipe, read_recipe
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import GenerationResult, generate
from saf_gen.leaderboard import Leaderboard
from saf_gen.leaderboard.report import write_evaluation
from saf_gen.stream.manifest import ALL_SPLITS
from studies.speed.bench import Figure, Size, main, timed

MAX_S = 120.0
OTHER_LIGHT: dict[str, Any] = {"kind": "ramp", "from": 2.0, "to": 0.5}


def run(size: Size) -> Iterator[Figure]:
    """Yield the time from recipe to leaderboard, and the time to record again under another light schedule."""
    recipe = find_recipe(size.recipe)
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) / "dataset"
        _, generating = timed(_generate, recipe, folder)
        _, ranking = timed(_rank, folder)
        work = resolve_recipe(recipe)
        what = f"{recipe.stem}, {len(work.sequences)} sequences of {work.recipe.camera.frames:,} frames"
        yield Figure(f"{what}: recipe to streams", generating, "s")
        yield Figure(f"{what}: streams to leaderboard", ranking, "s")
        yield Figure(f"{what}: recipe to leaderboard", generating + ranking, "s", MAX_S, at_most=True)
        again = _write_other_recipe(recipe, Path(temporary))
        result, seconds = timed(_generate, again, folder)
        what = f"under a new light, stacks there, {len(result.recorded)} recorded"
        yield Figure(what, seconds, "s")
        yield Figure("pieces of stacks rendered for them", len(result.rendered), "pieces", 0.0, at_most=True)


def _generate(recipe: Path, folder: Path) -> GenerationResult:
    result = generate(resolve_recipe(recipe), folder)
    for error in result.failed.values():
        raise error
    return result


def _rank(folder: Path) -> None:
    """Evaluate all splits of a dataset, and write its leaderboard and page, as ``saf-gen evaluate`` does."""
    result, target = evaluate(folder, split=ALL_SPLITS), folder / "evaluation"
    for failure in result.failures:
        raise SafGenError(f"{failure.sequence} could not be evaluated: {failure.problem}")
    write_evaluation(target, Leaderboard.of(result), title=folder.name)


def _write_other_recipe(recipe: Path, folder: Path) -> Path:
    """Write the recipe with OTHER_LIGHT as its only light schedule, in JSON, which is also YAML; return the path."""
    data = read_recipe(recipe).model_dump(mode="json")
    data["lights"] = {"other": OTHER_LIGHT}
    for split in data["splits"].values():
        split["lights"] = ["other"]
    path = folder / "other.yaml"
    path.write_text(json.dumps(data, indent=1))
    return path


if __name__ == "__main__":
    sys.exit(main(run))
