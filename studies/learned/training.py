"""Parts of a training script that no network decides: options, loss curves, ONNX files and model cards."""

import argparse
import copy
import csv
import math
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import Record
from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput
from saf_gen.leaderboard.ranking import rank_methods
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.stream_file import SpikeStream

HERE = Path(__file__).parent
MAX_WEIGHTS_BYTES = 300_000


@dataclass(frozen=True)
class Trained:
    """The network of the epoch with the least loss, its seed, and a row for each epoch."""

    seed: int
    network: Any
    rows: list[dict[str, float]]


class Keeper:
    """Keeps the network of the epoch with the least loss on validation."""

    def __init__(self) -> None:
        self.least, self.network = math.inf, None

    def look(self, network: Any, loss: float) -> None:
        """Keep a copy of the network if its loss is the least so far."""
        if loss < self.least:
            self.least, self.network = loss, copy.deepcopy(network)


def kept_loss(trained: Trained) -> float:
    """Return the validation loss of the network that is kept."""
    return min(row["validation"] for row in trained.rows)


def parse_options(about: str, *, epochs: int) -> argparse.Namespace:
    """Return the options dataset, out, seeds and epochs of the command line."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, help="dataset that saf-gen generate made from recipes/learned.yaml")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for weights, curves and card")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--epochs", type=int, default=epochs)
    return parser.parse_args()


def check_options(options: argparse.Namespace, *packages: str) -> None:
    """Check packages and dataset before a training begins, and create its output folder.

    Raises BadInput if a package is missing, the dataset lacks the split train or validation, or the folder cannot be
    created.
    """
    for package in packages:
        require_extra("train", package, of="training")
    missing = {"train", "validation"} - set(read_manifest(options.dataset).splits)
    if missing:
        where = str(options.dataset)
        raise BadInput(f"has no split {' and '.join(sorted(missing))}", where=where, hint="recipes/learned.yaml")
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"--out: {error}", hint="name a folder that can be created") from None


def open_split(dataset: Path, split: str) -> list[tuple[str, Path]]:
    """Return the scene and the file of each sequence of a split."""
    entries = [entry for entry in read_manifest(dataset).sequences if entry.split == split]
    return [(entry.scene, dataset / entry.file) for entry in entries]


def depth_of_focus(stream: SpikeStream) -> float:
    """Return the depth of focus of a stream's target as a fraction of the travel."""
    near, far = stream.truth.depth_of_focus
    return abs(far - near)


def export(network: Any, path: Path, *, inputs: dict[str, tuple[int, ...]], outputs: Sequence[str]) -> None:
    """Write a network with its weights to an ONNX file; raise BadInput if the file exceeds MAX_WEIGHTS_BYTES."""
    import torch

    examples = tuple(torch.zeros(1, *shape) for shape in inputs.values())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PyTorch warns about calls that it makes itself
        program = torch.onnx.export(
            network.eval(), examples, dynamo=True, input_names=list(inputs), output_names=list(outputs), verbose=False
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".onnx.part")
    program.save(part, external_data=False)
    if (size := part.stat().st_size) > MAX_WEIGHTS_BYTES:
        raise BadInput(f"{part} has {size:,} bytes", allowed=f"{MAX_WEIGHTS_BYTES:,}", hint="train a smaller network")
    part.replace(path)


def write_curves(out: Path, name: str, trained: Sequence[Trained], *, what: str, splits: Sequence[str]) -> None:
    """Write the rows of all seeds to NAME.csv, and plot a line for each seed and split to NAME.png."""
    sys.path.append(str(HERE.parents[1]))
    from studies.drawing import BLUE, ORANGE, panels, save

    rows = [{"seed": each.seed, **row} for each in trained for row in each.rows]
    with (out / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows({key: f"{x:.5g}" if isinstance(x, float) else x for key, x in row.items()} for row in rows)
    figure, ((axes,),) = panels(1, 1, width=4.5, height=2.8)
    for each in trained:
        for split, colour in zip(splits, (BLUE, ORANGE), strict=False):
            label = split if each is trained[0] else None
            axes.plot([r["epoch"] for r in each.rows], [r[split] for r in each.rows], color=colour, label=label)
    axes.set(xlabel="epoch", ylabel=what, title=f"{name}, one line a seed")
    axes.legend()
    save(figure, out / f"{name}.png")


def judge(dataset: Path, methods: Sequence[str]) -> dict[str, tuple[Any, list[Record]]]:
    """Return the leaderboard row and the records of each method on the split validation."""
    records = evaluate(dataset, methods=methods, split="validation").records
    rows = {row.method: row for row in rank_methods(records)}
    return {name: (rows[name], [r for r in records if r.who.method == name]) for name in rows}


def choose(judged: dict[str, tuple[Any, list[Record]]], trained: dict[str, Trained]) -> tuple[str, Trained]:
    """Return the method with the most successes on validation, and its network; the smaller loss breaks ties."""
    best = max(trained, key=lambda spec: (judged[spec][0].answerable_1dof or 0.0, -kept_loss(trained[spec])))
    return best, trained[best]


def format_table(judged: dict[str, tuple[Any, list[Record]]], names: dict[str, str]) -> str:
    """Return a Markdown table of the results on validation; ``names`` replaces specifications of methods."""
    lines = [
        "| method | within 1 DoF | 95 % interval | median error, DoF | frames seen | time, s | hunting |",
        "|---|---|---|---|---|---|---|",
    ]
    for method, (row, _) in judged.items():
        ends = (row.answerable_1dof_low, row.answerable_1dof_high)
        interval = "–" if None in ends else f"{ends[0]:.0%} to {ends[1]:.0%}"
        cells = [
            names.get(method, f"`{method}`"),
            f"{row.answerable_1dof:.0%}",
            interval,
            "–" if row.median_error_dof is None else f"{row.median_error_dof:.2f}",
            f"{row.frames_seen:.0%}",
            "–" if row.time_to_focus_s is None else f"{row.time_to_focus_s:.3f}",
            "–" if row.hunting is None else f"{row.hunting:.0%}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def describe_splits(dataset: Path) -> str:
    """Return a sentence on the numbers of sequences and the scenes of the splits train and validation."""
    found = {split: [scene for scene, _ in open_split(dataset, split)] for split in ("train", "validation")}
    words = (f"{split}: {len(own):,} sequences of {', '.join(sorted(set(own)))}" for split, own in found.items())
    return f"{'; '.join(words)}."


def describe_training(
    options: argparse.Namespace, chosen: Trained, *, weights: int, read_s: float, train_s: float
) -> str:
    """Return sentences on the settings and duration of the training, and on the seed that is kept."""
    return (
        f"Seeds {', '.join(map(str, options.seeds))}, {options.epochs} epochs each; {weights:,} weights. "
        f"Processor time: {read_s / 60:.1f} min to see the data (once), {train_s / 60:.1f} min to train all "
        f"seeds. Seed {chosen.seed} has the most successes on validation, and is kept (loss {kept_loss(chosen):.3f})."
    )


def fill_card(path: Path, **figures: str) -> None:
    """Write each text between the marks ``<!-- KEY -->`` and ``<!-- end -->`` of a card, and change nothing else.

    If the card does not exist, it is first copied from HERE. Raises BadInput if the marks of a key are missing.
    """
    text = (path if path.exists() else HERE / path.name).read_text(encoding="utf-8")
    for key, value in figures.items():
        head, mark, rest = text.partition(f"<!-- {key} -->\n")
        _, end, tail = rest.partition("<!-- end -->")
        if not (mark and end):
            raise BadInput(f"{path} has no marks for {key!r}", allowed=f"<!-- {key} --> … <!-- end -->")
        text = f"{head}{mark}{value}\n{end}{tail}"
    path.write_text(text, encoding="utf-8")


def keep_best(
    options: argparse.Namespace,
    trained: Sequence[Trained],
    *,
    method: str,
    inputs: dict[str, tuple[int, ...]],
    outputs: Sequence[str],
    rivals: Sequence[str],
    read_s: float = 0.0,
    train_s: float,
) -> None:
    """Export the network of each seed, evaluate them and their rivals, keep the best weights, and fill in the card.

    ``method`` is MEASURE+FILE.py:CLASS; the weights and the card are named after that file.
    """
    name = Path(method.partition("+")[2].rpartition(":")[0]).stem
    files, networks = {}, {}
    for each in trained:
        file = options.out.resolve() / f"{name}-{each.seed}.onnx"
        export(each.network, file, inputs=inputs, outputs=outputs)
        spec = f"{method}:weights={file}"
        files[spec], networks[spec] = file, each
    found = judge(options.dataset, [*files, *rivals])
    best, chosen = choose(found, networks)
    files.pop(best).replace(options.out / f"{name}.onnx")
    for file in files.values():
        file.unlink()
    weights = sum(parameter.numel() for parameter in chosen.network.parameters())
    fill_card(
        options.out / f"{name}.md",
        data=describe_splits(options.dataset),
        training=describe_training(options, chosen, weights=weights, read_s=read_s, train_s=train_s),
        figures=format_table(found, {spec: f"seed {each.seed}" for spec, each in networks.items()}),
    )


def run(main: Callable[[], None], name: str) -> None:
    """Call ``main``; if it raises BadInput, print one line and exit with code 2."""
    try:
        main()
    except BadInput as error:
        print(f"{name}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
