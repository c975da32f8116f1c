"""Train the network of running_curves.py, which estimates in which window of a sweep so far the focus was passed.

    saf-gen generate recipes/learned.yaml
    python studies/learned/train_running_curves.py datasets/learned

The network gives the probability that the focus is in each window, and that it has not been passed yet. One network per
seed is trained on the split ``train``. The seed with the most successes on ``validation`` is kept. The script writes
running_curves.onnx, .csv and .png, and the figures of the card running_curves.md, to ``--out``. It needs
``pip install 'saf-gen[train]'``.
"""

from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import running_curves as method
from training import (
    Keeper,
    Trained,
    check_options,
    depth_of_focus,
    keep_best,
    open_split,
    parse_options,
    run,
    write_curves,
)

from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.core import seeds
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.stream_file import open_stream

NAME = "running_curves"
MEASURE = "structure_calibrated"
CHANNELS, WIDTH, DILATIONS = 13, 32, (1, 2, 4, 8, 1)
BATCH, PREFIXES = 64, 8
"""Prefixes in a batch, and prefixes drawn from each recording in an epoch."""

Example = tuple[np.ndarray, float, float]
"""Rows of a complete recording (n, 9), the true focus position, and the depth of focus, as fractions of the travel."""


def read_examples(dataset: Path, split: str, *, keep: Path) -> list[Example]:
    """Return an example of each recording of a split; its rows are stored in a file for later trainings."""
    examples = []
    for _, path in open_split(dataset, split):
        with open_stream(path) as stream:
            kept = keep / f"{stream.content_sha256[:16]}.npy"
            if not kept.exists():
                counts = WindowCounts(stream, choose_region(stream, "target")[0])
                *_, rows = np.zeros((0, 9)), *method.follow_sweep(RecordingView(counts, get_measure(MEASURE)))
                keep.mkdir(parents=True, exist_ok=True)
                part = kept.with_suffix(".part.npy")
                np.save(part, rows)
                part.replace(kept)
            if len(rows := np.load(kept)):
                examples.append((rows, float(stream.truth.position), depth_of_focus(stream)))
    return examples


def label(rows: np.ndarray, truth: float, depth: float) -> np.ndarray:
    """Return the target probabilities, (STEPS + 1,): of the focus in each window of the rows (n, 9), and of not yet.

    The last probability is 1 until the lens has passed the focus, or been within half a depth of focus of it. From then
    on, the windows within about a quarter of a depth of focus share the probability, and at least two windows.
    """
    away = rows[:, method.POSITION] - truth
    target = np.zeros(method.STEPS + 1, np.float32)
    if away.min() * away.max() > 0 and abs(away).min() > depth / 2:
        target[-1] = 1
        return target
    steps = np.abs(np.diff(away)) if len(away) > 1 else np.array([depth])
    spread = max(depth / 4, float(np.median(steps)) / 2, 1e-4)
    weights = np.exp(-((away / spread) ** 2) / 2 + ((abs(away).min() / spread) ** 2) / 2)
    target[: len(rows)] = weights / weights.sum()
    return target


def draw_prefix(example: Example, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the input and target of the network for a random part of a recording, which may be reversed.

    Curves are raised to a random power and their ranges are scaled, because peaks have other shapes in new scenes.
    """
    rows, truth, depth = example
    if random.random() < 0.5:
        rows = rows[::-1]
    first = int(random.integers(len(rows)))  # otherwise the duration of a sweep would reveal the focus position
    stop = len(rows) if random.random() < 0.2 else int(random.integers(first + 1, len(rows) + 1))
    rows = rows[first:stop]
    if random.random() < 0.3:
        rows = rows[len(rows) % 2 :: 2]
    if not len(rows):
        rows = example[0][:1]
    seen, n = method.describe_curves(rows), len(rows)
    seen[0:4, :n] **= np.exp(random.normal(0, 0.4, (4, 1)))
    seen[4:8, :n] *= np.exp(random.normal(0, 0.3, (4, 1)))
    return seen, label(rows, truth, depth)


def make_network() -> Any:
    """Return a network from curves (n, 13, STEPS) to probabilities of the windows, and of none yet, (n, STEPS + 1)."""
    import torch
    from torch import nn

    class Curves(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.first = nn.Conv1d(CHANNELS, WIDTH, 5, padding=2)
            self.blocks = nn.ModuleList(nn.Conv1d(WIDTH, WIDTH, 3, padding=d, dilation=d) for d in DILATIONS)
            self.drop = nn.Dropout(0.1)
            self.each = nn.Conv1d(WIDTH, 1, 1)
            self.none = nn.Sequential(nn.Linear(2 * WIDTH, WIDTH), nn.ReLU(), nn.Linear(WIDTH, 1))

        def score(self, curves: Any) -> Any:
            there = curves[:, -1:]
            x = self.drop(torch.relu(self.first(curves))) * there
            for block in self.blocks:
                x = x + torch.relu(block(x)) * there
            mean = x.sum(2) / there.sum(2).clamp(min=1)
            none = self.none(torch.cat([mean, x.amax(2)], 1))
            return torch.cat([self.each(x)[:, 0] + 30 * (there[:, 0] - 1), none], 1)

        def forward(self, curves: Any) -> Any:
            return torch.softmax(self.score(curves), 1)

    return Curves()


def train(examples: dict[str, list[Example]], *, seed: int, epochs: int) -> Trained:
    """Return a network trained on examples["train"], with its losses on both splits after each epoch."""
    import torch

    torch.manual_seed(seed)
    network, random = make_network(), seeds.make_generator(NAME, seed)
    fixed = seeds.make_generator(NAME, "validation")
    judged = [draw_prefix(each, fixed) for each in examples["validation"] for _ in range(PREFIXES)]
    seen, meant = (torch.from_numpy(np.stack(each)) for each in zip(*judged, strict=True))
    batches = -(-len(examples["train"]) * PREFIXES // BATCH)
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 4e-3, total_steps=epochs * batches)
    measure = torch.nn.CrossEntropyLoss()
    rows = []
    keeper = Keeper()
    for epoch in range(1, epochs + 1):
        order = random.permutation(np.repeat(np.arange(len(examples["train"])), PREFIXES))
        losses = []
        network.train()
        for some in np.array_split(order, batches):
            drawn = [draw_prefix(examples["train"][int(number)], random) for number in some]
            given, told = (torch.from_numpy(np.stack(each)) for each in zip(*drawn, strict=True))
            loss = measure(network.score(given), told)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            losses.append(float(loss.detach()))
        with torch.inference_mode():
            judgement = float(measure(network.eval().score(seen), meant))
        rows.append({"epoch": epoch, "train": float(np.mean(losses)), "validation": judgement})
        keeper.look(network, judgement)
        if epoch % 5 == 0:
            print(f"seed {seed}  epoch {epoch}  train {rows[-1]['train']:.4f}  validation {judgement:.4f}", flush=True)
    return Trained(seed, keeper.network, rows)


def main() -> None:
    options = parse_options(__doc__, epochs=15)
    check_options(options, "torch", "onnxscript")
    import torch

    torch.set_num_threads(1)
    begin = process_time()
    examples = {s: read_examples(options.dataset, s, keep=options.dataset / "curves") for s in ("train", "validation")}
    read_s = process_time() - begin
    trained = [train(examples, seed=seed, epochs=options.epochs) for seed in options.seeds]
    train_s = process_time() - begin - read_s
    write_curves(options.out, NAME, trained, what="cross-entropy", splits=("train", "validation"))
    keep_best(
        options,
        trained,
        method=f"{MEASURE}+{Path(method.__file__).resolve()}:RunningCurves",
        inputs={"curves": (CHANNELS, method.STEPS)},
        outputs=["likely"],
        rivals=[f"{MEASURE}+photon_aware", f"{MEASURE}+argmax"],
        read_s=read_s,
        train_s=train_s,
    )


if __name__ == "__main__":
    run(main, f"train_{NAME}")
