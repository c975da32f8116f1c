"""Compare rankings of methods under two sensors that record the same recipes.

    python -m studies.ranking.noisy_sensor --out FOLDER [--recipe sad_core ...] [--sensor NAME NAME]

Scenes, members, lights, lens motion and focal stacks are the same for both sensors; device and noise differ. For each
recipe the script prints a Markdown table with the success within one depth of focus and the median error of each method
under each sensor, Kendall's tau of the two rankings, and the number of answers that change sides of one depth of focus
or move by more than half of one. It keeps the records in FOLDER and continues there after an interruption.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from scipy.stats import kendalltau

from saf_gen.benchmark.admission import read_methods
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import Record, format_records, read_records
from saf_gen.core.files import write_text
from saf_gen.generate.recipe import find_recipe, read_recipe
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.leaderboard import rank_methods
from saf_gen.stream.manifest import ALL_SPLITS

SENSORS = "vidar_400x250", "vidar_400x250_noisy"
METHODS = {"sad_core": "recorded.txt", "claims": "claims.txt"}
METHOD_LISTS = Path(__file__).resolve().parents[1] / "results" / "method_lists"


def record_and_judge(recipe: str, sensor: str, *, folder: Path, methods: Sequence[str]) -> list[Record]:
    """Return the records of methods on a recipe with this sensor; the stacks in ``folder`` are reused."""
    kept = folder / f"{Path(sensor).stem}.jsonl"
    if not kept.exists():
        data = read_recipe(find_recipe(recipe)).model_dump(mode="json")
        data["camera"]["sensor"] = sensor
        written = folder / f"{Path(sensor).stem}.yaml"
        written.write_text(json.dumps(data, indent=1))
        generate(resolve_recipe(written), folder / "dataset")
        found = evaluate(folder / "dataset", methods=methods, split=ALL_SPLITS)
        write_text(kept, format_records(found.records))
    return read_records(kept)


def compare(found: Sequence[list[Record]], sensors: Sequence[str]) -> str:
    """Return the table of a recipe, followed by a sentence on ranks and single answers."""
    boards = [{row.method: row for row in rank_methods(records)} for records in found]
    lines = [
        "| method | " + " | ".join(f"success, `{sensor}` | error" for sensor in sensors) + " |",
        "|---" * (1 + 2 * len(sensors)) + "|",
    ]
    for method in boards[0]:
        rows = [board[method] for board in boards]
        cells = " | ".join(f"{row.answerable_1dof:.0%} | {row.median_error_dof:.2f}" for row in rows)
        lines.append(f"| `{method}` | {cells} |")
    success = [[board[method].answerable_1dof for method in boards[0]] for board in boards]
    errors = [[board[method].median_error_dof for method in boards[0]] for board in boards]
    first, second = ({(r.method, r.sequence): r for r in records} for records in found)
    pairs = [(first[key], second[key]) for key in first]
    sides = sum(a.success_1dof != b.success_1dof for a, b in pairs)
    moved = sum(abs((a.error_dof or 0) - (b.error_dof or 0)) > 0.5 for a, b in pairs)
    tau = [kendalltau(*columns).statistic for columns in (success, errors)]
    lines.append(
        f"\nKendall's tau: {tau[0]:.2f} by success, {tau[1]:.2f} by error. Of {len(pairs)} answers {sides} change "
        f"sides of one depth of focus, {moved} move by more than half of one."
    )
    return "\n".join(lines)


def main(given: Sequence[str] | None = None) -> None:
    """Compare two sensors on several recipes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--recipe", nargs="+", default=list(METHODS))
    parser.add_argument("--sensor", nargs=2, default=SENSORS)
    parser.add_argument("--methods", type=Path, help="use the methods in this file, one per line, for all recipes")
    asked = parser.parse_args(given)
    for recipe in asked.recipe:
        folder = asked.out / Path(recipe).stem
        folder.mkdir(parents=True, exist_ok=True)
        methods = read_methods(asked.methods or METHOD_LISTS / METHODS.get(recipe, "claims.txt"))
        found = [record_and_judge(recipe, sensor, folder=folder, methods=methods) for sensor in asked.sensor]
        print(f"{recipe}\n\n{compare(found, [Path(s).stem for s in asked.sensor])}\n")


if __name__ == "__main__":
    main()
