"""Rank methods on photographed focal stacks: record boxes of them, run the methods, and judge by the rule of truth.

    python -m studies.real_stacks FOLDER --out OUT [--method METHOD ...] [--object NAME ...] [--sensor NAME]

FOLDER holds a folder of pictures for each object of ``sources.yaml``, which says where they come from. OUT becomes a
dataset that ``saf-gen evaluate`` and ``load_dataset`` take, with the classes of boxes as its splits; the results of the
methods are in ``OUT/evaluation``. They are judged by the truth without the families of their own measure and search,
which ``saf-gen evaluate`` does not do. An object counts once, and those of grade C are only in the table.
"""

import argparse
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import Evaluation
from saf_gen.errors import BadInput
from saf_gen.leaderboard import Leaderboard
from saf_gen.leaderboard.ranking import mean_over_scenes, median_magnitude, right_within
from saf_gen.leaderboard.report import write_evaluation
from saf_gen.stream.manifest import ALL_SPLITS, read_manifest
from saf_gen.stream.stream_file import open_stream
from studies.real_stacks.dataset import BOXES, CLASSES, SOURCES, UNRANKED, frame_of, make_dataset, read_sources
from studies.real_stacks.truth import BoxTruth, families_of

METHODS = (
    "fine_structure+bell_vote",
    "fine_structure+bell_vote:area=true",
    "octave_structure+argmax:window=300",
    "vollath_f4_n+argmax:window=300",
    "sd_code+egs_code",
)
"""Methods that run if none is named."""
HEAD = "| class | boxes (objects) | method | ≤ 1 unit | ≤ ½ | ≤ 1 picture | median error, pictures |"


def main(given: Sequence[str] | None = None) -> None:
    """Make the dataset, evaluate, and print both tables."""
    parser = argparse.ArgumentParser(
        prog="real_stacks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--method", "-m", action="append")
    parser.add_argument("--object", action="append", default=[])
    parser.add_argument("--sources", type=Path, default=SOURCES, help="another list of sources")
    parser.add_argument("--sensor", default="vidar_128x128")
    parser.add_argument("--boxes", type=int, default=BOXES, help="boxes of each object")
    asked = parser.parse_args(given)
    try:
        sources = read_sources(asked.sources, asked.object)
        listed = asked.sources.with_name("files.sha256")
        make_dataset(asked.folder, asked.out, sources=sources, listed=listed, sensor=asked.sensor, boxes=asked.boxes)
        found = evaluate(asked.out, methods=asked.method or METHODS, split=ALL_SPLITS, draw=False)
        facts = read_facts(asked.out)
        records = judge_again(found.records, facts)
        if ranked := tuple(record for record in records if record.what.split != UNRANKED):
            board = Leaderboard.of(Evaluation(ranked, (), found.failures, plugins=found.plugins))
            write_evaluation(asked.out / "evaluation", board, title="Real focal stacks")
            print(board)
        print(table(records, facts))
    except BadInput as error:
        parser.exit(2, f"{error}\n")


def read_facts(folder: Path) -> dict[str, dict[str, Any]]:
    """Return what the recordings of a dataset say of their box, by sequence."""
    facts = {}
    for entry in read_manifest(folder).sequences:
        with open_stream(folder / entry.file) as stream:
            facts[entry.id] = json.loads(stream.metadata.provenance["real_stack"])
    return facts


def judge_again(records: Iterable[Record], facts: Mapping[str, Mapping[str, Any]]) -> tuple[Record, ...]:
    """Return records whose truth leaves out the families of their method; without any left, they have no truth."""
    judged = []
    for record in records:
        of = facts[record.what.sequence]
        best, last = BoxTruth(**of["truth"]).without(families_of(record.who.method)), of["pictures"] - 1
        truth = (None, None) if best is None else (best / last, frame_of(best, last))
        judgement = replace(record.judgement, truth=truth[0], truth_frame=truth[1])
        judged.append(replace(record, judgement=judgement))
    return tuple(judged)


def table(records: Sequence[Record], facts: Mapping[str, Mapping[str, Any]]) -> str:
    """Return results by class as Markdown: success within a unit and within a picture, and errors in pictures."""
    lines = [HEAD, "|---" * HEAD[1:].count("|") + "|"]
    for split in (*CLASSES, UNRANKED):
        of_split = [record for record in records if record.what.split == split]
        boxes = {tuple([facts[r.what.sequence]["object"], *facts[r.what.sequence]["box"]]) for r in of_split}
        for method in dict.fromkeys(record.who.method for record in of_split):
            own = [record for record in of_split if record.who.method == method]

            def pictures(record: Record) -> float | None:
                error = record.judgement.error
                return None if error is None else abs(error) * (facts[record.what.sequence]["pictures"] - 1)

            def near(record: Record) -> float | None:
                error = pictures(record)
                return None if record.judgement.truth is None else float(error is not None and error <= 1)

            rates = [mean_over_scenes(own, value) for value in (right_within(), right_within(0.5), near)]
            cells = ["–" if rate is None else f"{100 * rate:.0f} %" for rate in rates]
            error = median_magnitude(map(pictures, own))
            count = f"{len(boxes)} ({len({name for name, *_ in boxes})})"
            cells.append("–" if error is None else f"{error:.2f}")
            lines.append(f"| {split} | {count} | `{method}` | {' | '.join(cells)} |")
    unsure = median_magnitude(of["truth"]["uncertainty"] for of in facts.values())
    lines += ["", f"The truth is uncertain by {unsure:.2f} pictures (median); no smaller difference counts."]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
