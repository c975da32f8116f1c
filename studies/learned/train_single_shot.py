"""Train the network of single_shot.py, which estimates the signed distance to the focus from two windows.

    saf-gen generate recipes/learned.yaml
    python studies/learned/train_single_shot.py datasets/learned

One network per seed is trained on the split ``train``, on pairs of windows of the same recording. The seed with the
most successes on ``validation`` in the closed loop is kept. The script writes single_shot.onnx, .csv and .png, and the
figures of the card single_shot.md, to ``--out``. It needs ``pip install 'saf-gen[train]'``.
"""

from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import single_shot as method
from training import (
    PROTOCOL,
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

from saf_gen.core import seeds
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.stream_file import SpikeStream, open_stream

NAME = "single_shot"
RIVALS = "sd+golden_section", "sd+hill_climb", "structure_calibrated+photon_aware"
WINDOWS, HALVES = 24, (40, 60, 80)
"""Number of windows that are cut from a recording, and the possible numbers of frames in each half of a window."""
OCTAVES, FILTERS, WIDTH, HIDDEN = 5, 4, 32, 64
BATCH, PAIRS = 256, 128
"""Pairs in a batch, and pairs drawn from each recording in an epoch."""
SHARPNESS = 12.0
"""Rate at which soft labels fall with the squared distance of a bin; the bins next to the true one have half of its
label."""

Example = dict[str, np.ndarray]
"""For WINDOWS windows: ``position``, ``away`` (distance to the focus, in depths of focus), and the energies that
``measure_windows`` returns."""


def make_bank() -> np.ndarray:
    """Return six filters of unit norm, (6, 1, 3, 3).

    They are differences over two pixels along rows and along columns, a diagonal difference, a Laplacian, and
    differences over one pixel along rows and along columns. AVERAGED combines their energies into FILTERS values that
    treat both directions equally.
    """
    bank = np.zeros((6, 3, 3), np.float32)
    bank[0, 1] = bank[1, :, 1] = -1, 0, 1
    bank[2] = [[1, 0, -1], [0, 0, 0], [-1, 0, 1]]
    bank[3] = [[0, -1, 0], [-1, 4, -1], [0, -1, 0]]
    bank[4, 1, 1:] = bank[5, 1:, 1] = -1, 1
    return (bank / np.sqrt((bank**2).sum(axis=(1, 2), keepdims=True)))[:, None]


AVERAGED = np.array([[1, 1, 0, 0, 0, 0], [0, 0, 2, 0, 0, 0], [0, 0, 0, 2, 0, 0], [0, 0, 0, 0, 1, 1]], np.float32) / 2


def filter_octaves(windows: Any) -> list[Any]:
    """Return the filtered crops of windows (n, CROPS, 2, CROP, CROP) at each octave, of shape (n, 2, 6, pixels).

    An octave is the mean of the previous one over 2 x 2 pixels.
    """
    import torch

    n, crops = windows.shape[:2]
    pictures = windows.reshape(n * crops * 2, 1, method.CROP, method.CROP)
    bank, found = torch.from_numpy(make_bank()), []
    for octave in range(OCTAVES):
        if octave:
            pictures = torch.nn.functional.avg_pool2d(pictures, 2)
        filtered = torch.nn.functional.conv2d(pictures, bank).reshape(n, crops, 2, 6, -1)
        found.append(filtered.permute(0, 2, 3, 1, 4).reshape(n, 2, 6, -1))
    return found


def measure_windows(windows: np.ndarray) -> Example:
    """Return the energies of windows (n, CROPS, 2, CROP, CROP) at each octave, for single windows and for pairs.

    ``alone`` (n, OCTAVES, FILTERS) is the mean product of the two halves, which independent noise does not bias.
    ``noise``, of the same shape, is half the mean square of their difference. ``both`` (n, n, OCTAVES, FILTERS) is the
    mean product of two windows.
    """
    import torch

    energies: dict[str, list[Any]] = {"alone": [], "noise": [], "both": []}
    mix = torch.from_numpy(AVERAGED.T)
    with torch.inference_mode():
        for filtered in filter_octaves(torch.from_numpy(windows)):
            a, b = filtered[:, 0], filtered[:, 1]
            whole = (a + b) / 2
            energies["alone"].append((a * b).mean(2) @ mix)
            energies["noise"].append(((a - b) ** 2).mean(2) / 2 @ mix)
            energies["both"].append(torch.einsum("ifp,jfp->ijf", whole, whole) / whole.shape[2] @ mix)
    return {name: torch.stack(found, -2).numpy() for name, found in energies.items()}


def cut_windows(stream: SpikeStream) -> Example:
    """Return an example of a recording: WINDOWS windows at random times, one in each of as many equal parts."""
    random = seeds.make_generator(NAME, stream.content_sha256)
    region, truth = choose_region(stream, "target")[0], stream.truth
    part, seen, position, away = stream.shape[0] // WINDOWS, [], [], []
    for number in range(WINDOWS):
        half = min(int(random.choice(HALVES)), part // 2)
        first = number * part + int(random.integers(part - 2 * half + 1))
        middle, stop = first + half, first + 2 * half
        ends = (first, middle), (middle, stop)
        first_half, second_half = (stream.counts(*each, region=region) for each in ends)
        seen.append(method.describe_window((first_half, second_half)))
        position.append(float(stream.focus_position[first:stop].mean()))
        best = float(truth.position if truth.track is None else truth.track[middle])
        away.append((best - position[-1]) / depth_of_focus(stream))
    return {"position": np.array(position), "away": np.array(away), **measure_windows(np.stack(seen))}


def read_examples(dataset: Path, split: str, *, keep: Path) -> list[Example]:
    """Return an example of each recording of a split; it is stored in a file for later trainings."""
    examples = []
    for _, path in open_split(dataset, split):
        with open_stream(path) as stream:
            kept = keep / f"{stream.content_sha256[:16]}.npz"
            if not kept.exists():
                keep.mkdir(parents=True, exist_ok=True)
                part = kept.with_suffix(".part.npz")
                np.savez(part, **cut_windows(stream))
                part.replace(kept)
            with np.load(kept) as found:
                examples.append(dict(found))
    return examples


def draw_pair(example: Example, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the energies (5, OCTAVES, FILTERS) of two windows, their distance, and the distance of each to the focus.

    The first window is the one at the smaller lens position. Half of the pairs are mirrored, as if the lens moved in
    the other direction, so that only the pictures show on which side the focus is.
    """
    pair = random.choice(WINDOWS, 2, replace=False)
    near, far = sorted(map(int, pair), key=lambda n: float(example["position"][n]))
    apart = method.describe_distance(float(example["position"][far] - example["position"][near]))
    sign = 1
    if random.random() < 0.5:
        near, far, sign = far, near, -1
    energies = [example["alone"][near], example["alone"][far], example["both"][near, far]]
    energies += [example["noise"][near], example["noise"][far]]
    return np.stack(energies), np.array([apart], np.float32), sign * example["away"][[near, far]].astype(np.float32)


def label(away: Any) -> Any:
    """Return soft ordinal labels (n, bins) of distances in depths of focus (n,).

    They are the softmax of the negative squared distance of each bin (Diaz and Marathe, CVPR 2019,
    doi:10.1109/CVPR.2019.00487).
    """
    import torch

    centres = torch.from_numpy(method.CENTRES.astype(np.float32))
    return torch.softmax(-SHARPNESS * (torch.asinh(away)[:, None] - centres) ** 2, 1)


def make_network() -> Any:
    """Return a network from crops of two windows and their distance to the bin probabilities of both, (n, bins)."""
    import torch
    from torch import nn

    class TwoWindows(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.first = nn.Conv1d(5 * FILTERS + 1, WIDTH, 3, padding=1)
            self.second = nn.Conv1d(WIDTH, WIDTH, 3, padding=1)
            bins = 2 * len(method.CENTRES)
            self.last = nn.Sequential(
                nn.Dropout(0.2), nn.Linear(WIDTH * OCTAVES, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, bins)
            )

        def score(self, energies: Any, apart: Any) -> Any:
            """Return the logits (n, 2, bins) for energies (n, 5, OCTAVES, FILTERS)."""
            size = energies[:, :2].clamp(min=0).mean((1, 2, 3), keepdim=True) + 1e-6
            curves = torch.asinh(30 * energies / size) / 3
            curves = curves.transpose(2, 3).reshape(-1, 5 * FILTERS, OCTAVES)
            x = torch.relu(self.first(torch.cat([curves, apart[:, :, None].expand(-1, 1, OCTAVES)], 1)))
            x = x + torch.relu(self.second(x))
            return self.last(x.flatten(1)).reshape(-1, 2, len(method.CENTRES))

        def forward(self, windows: Any, apart: Any) -> Any:
            mix, rows = torch.from_numpy(AVERAGED.T), []
            for one, two in zip(filter_octaves(windows[:, :, :2]), filter_octaves(windows[:, :, 2:]), strict=True):
                (a, b), (c, d) = one.unbind(1), two.unbind(1)
                products = [a * b, c * d, (a + b) * (c + d) / 4, (a - b) ** 2 / 2, (c - d) ** 2 / 2]
                rows.append(torch.stack([each.mean(2) @ mix for each in products], 1))
            near, far = torch.softmax(self.score(torch.stack(rows, 2), apart), 2).unbind(1)
            return near, far

    return TwoWindows()


def stack_pairs(drawn: list[tuple[np.ndarray, ...]]) -> list[Any]:
    """Return the energies, the distances and the targets of many pairs as tensors."""
    import torch

    return [torch.from_numpy(np.stack(each)) for each in zip(*drawn, strict=True)]


def train(examples: dict[str, list[Example]], *, seed: int, epochs: int) -> Trained:
    """Return a network trained on examples["train"], with its losses on both splits after each epoch."""
    import torch

    torch.manual_seed(seed)
    network, random = make_network(), seeds.make_generator(NAME, seed)
    fixed = seeds.make_generator(NAME, "validation")
    judged = stack_pairs([draw_pair(each, fixed) for each in examples["validation"] for _ in range(PAIRS)])
    batches = -(-len(examples["train"]) * PAIRS // BATCH)
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=epochs * batches)

    def measure(energies: Any, apart: Any, away: Any) -> Any:
        meant = label(away.flatten()).reshape(len(away), 2, -1)
        return -(meant * torch.log_softmax(network.score(energies, apart), 2)).sum(2).mean()

    rows = []
    keeper = Keeper()
    for epoch in range(1, epochs + 1):
        order = random.permutation(np.repeat(np.arange(len(examples["train"])), PAIRS))
        losses = []
        network.train()
        for some in np.array_split(order, batches):
            loss = measure(*stack_pairs([draw_pair(examples["train"][int(number)], random) for number in some]))
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            losses.append(float(loss.detach()))
        network.eval()
        with torch.inference_mode():
            judgement = float(measure(*judged))
        rows.append({"epoch": epoch, "train": float(np.mean(losses)), "validation": judgement})
        keeper.look(network, judgement)
        print(f"seed {seed}  epoch {epoch}  train {rows[-1]['train']:.4f}  validation {judgement:.4f}", flush=True)
    return Trained(seed, keeper.network, rows)


def main() -> None:
    options = parse_options(__doc__, epochs=8)
    check_options(options, "torch", "onnxscript")
    import torch

    torch.set_num_threads(1)
    begin = process_time()
    keep = options.dataset / "windows"
    examples = {split: read_examples(options.dataset, split, keep=keep) for split in ("train", "validation")}
    read_s = process_time() - begin
    trained = [train(examples, seed=seed, epochs=options.epochs) for seed in options.seeds]
    train_s = process_time() - begin - read_s
    write_curves(options.out, NAME, trained, what="cross-entropy", splits=("train", "validation"))
    keep_best(
        options,
        trained,
        method=f"sd+{Path(method.__file__).resolve()}:SingleShot",
        inputs={"windows": (method.CROPS, 4, method.CROP, method.CROP), "apart": (1,)},
        outputs=["near", "far"],
        rivals=RIVALS,
        protocol=PROTOCOL,
        read_s=read_s,
        train_s=train_s,
    )


if __name__ == "__main__":
    run(main, f"train_{NAME}")
