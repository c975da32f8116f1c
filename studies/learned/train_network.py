"""Train small networks that estimate the blur of a window of spikes, and write their answers as predictions.

    saf-gen generate recipes/learn.yaml
    python -m studies.learned.train_network datasets/learn --out datasets/learn/network
    saf-gen evaluate datasets/learn --split test --predictions datasets/learn/network/predictions.jsonl

The script trains on the split ``train`` only, reports each epoch on ``validation``, and answers on ``test``. It trains
one network per seed; the same seed on the same machine gives the same answers. It writes ``predictions.jsonl``,
``curve.csv``, ``curve.png`` and the weights, ``blur_net_SEED.pt``. It needs ``pip install 'saf-gen[torch]'``;
docs/how-to/train.md explains it.
"""

import argparse
import csv
import json
import sys
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import saf_gen
from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import SequenceEntry, read_manifest
from saf_gen.stream.stream_file import SpikeStream
from studies.drawing import BLUE, ORANGE, panels, save

WINDOW, STRIDE, BOX = 100, 50, 64
MAX_BLUR, WORKERS = 16, 2


def log_blur(stream: SpikeStream, first: int, stop: int) -> np.float32:
    """Return log(1 + blur) in the middle of a window, with the blur in pixels.

    The blur is proportional to the distance from the focus. It is limited to MAX_BLUR, because larger blurs look the
    same in a small box.
    """
    near, far = stream.truth.depth_of_focus
    away = stream.metadata.lens_position[(first + stop) // 2] - stream.truth.position
    return np.float32(np.log1p(min(abs(away) / ((far - near) / 2), MAX_BLUR)))


def find_focus(positions: np.ndarray, blurs: np.ndarray) -> float:
    """Return the position about which the smallest quarter of the blurs rises most linearly on both sides.

    The model blur = least + slope·|position − place| is fitted for each of 1,001 places; the focus is the place with
    the best fit.
    """
    least = np.argsort(blurs, kind="stable")[: max(4, len(blurs) // 4)]
    positions, rise = positions[least], blurs[least] - blurs[least].mean()
    places = np.linspace(positions.min(), positions.max(), 1_001)
    away = np.abs(positions[:, None] - places)
    away -= away.mean(axis=0)
    return float(places[np.argmax(np.maximum(rise @ away, 0) ** 2 / (away**2).sum(axis=0))])


def normalise(counts: Any) -> Any:
    """Return counts (n, 1, h, w) over their mean, minus 1, so that the amount of light does not matter."""
    return counts / counts.mean(axis=(1, 2, 3))[:, None, None, None].clip(0.01) - 1


def predict_sequence(
    entry: SequenceEntry, windows: "saf_gen.SpikeWindows", *, tell: Any, method: str
) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """Return a line for ``--predictions``, and the positions and predicted blurs of the windows of a sequence.

    ``tell`` returns the blur of each picture of normalised counts (n, 1, h, w). The truth is not used.
    """
    begin = process_time()
    numbers = [number for number, window in enumerate(windows.windows) if window.sequence.id == entry.id]
    blurs = tell(normalise(np.stack([windows[number][0] for number in numbers])))
    middles = np.array([windows.windows[number].first + WINDOW // 2 for number in numbers])
    with saf_gen.open_stream(windows.dataset / entry.file) as stream:
        lens, data = stream.focus_position, stream.content_sha256
    focus = find_focus(lens[middles], blurs)
    line = {
        "method": method,
        "sequence": entry.id,
        "frame": float(np.abs(lens - focus).argmin()),
        "frames_seen": entry.frames,
        "seconds": process_time() - begin,
        "data": data,
    }
    return line, lens[middles], blurs


def make_network() -> Any:
    """Return a network with 7,105 weights that maps counts (n, 1, h, w) to log(1 + blur), (n,)."""
    from torch import nn

    return nn.Sequential(
        *(nn.Conv2d(1, 8, 5, stride=2, padding=2), nn.ReLU()),
        *(nn.Conv2d(8, 16, 3, stride=2, padding=1), nn.ReLU()),
        *(nn.Conv2d(16, 32, 3, stride=2, padding=1), nn.ReLU()),
        *(nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(32, 32), nn.ReLU(), nn.Linear(32, 1), nn.Flatten(0)),
    )


def train(dataset: Path, *, seed: int, epochs: int) -> tuple[Any, list[dict[str, float]]]:
    """Return a trained network, and for each epoch a row with its loss on the splits train and validation."""
    import torch
    from torch.utils.data import DataLoader

    from saf_gen.torch import SpikeWindows

    torch.manual_seed(seed)
    split = {"window": WINDOW, "stride": STRIDE, "target": log_blur}
    batches = DataLoader(
        SpikeWindows(dataset, "train", crop=(BOX + 16, BOX + 16), **split),
        batch_size=32, shuffle=True, num_workers=WORKERS, persistent_workers=WORKERS > 0,
    )  # fmt: skip
    judged = SpikeWindows(dataset, "validation", crop=(BOX, BOX), **split)
    images, blurs = next(iter(DataLoader(judged, batch_size=len(judged))))
    network, measure = make_network(), torch.nn.SmoothL1Loss(beta=0.2)
    optimizer = torch.optim.AdamW(network.parameters(), lr=2e-3, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 4e-3, total_steps=epochs * len(batches))
    rows = []
    for epoch in range(epochs):
        losses = []
        for counts, targets in batches:
            top, left = torch.randint(17, (2,)).tolist()
            picture = normalise(counts[:, :, top : top + BOX, left : left + BOX])
            turned = torch.rot90(picture, int(torch.randint(4, ())), (2, 3))
            loss = measure(network(turned.flip(3) if torch.rand(()) < 0.5 else turned), targets)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            losses.append(float(loss.detach()))
        with torch.inference_mode():
            judgement = float(measure(network(normalise(images)), blurs))
        rows.append({"seed": seed, "epoch": epoch + 1, "train": float(np.mean(losses)), "validation": judgement})
        line = "seed {seed}  epoch {epoch:2}  train {train:.4f}  validation {validation:.4f}"
        print(line.format(**rows[-1]), flush=True)
    return network.eval(), rows


def tell_with(network: Any) -> Any:
    """Return the function that ``predict_sequence`` calls for the blur of pictures."""
    import torch

    def tell(pictures: np.ndarray) -> np.ndarray:
        with torch.inference_mode():
            return np.expm1(np.maximum(network(torch.from_numpy(pictures)).numpy(), 0)).astype(float)

    return tell


def predict_split(
    dataset: Path, split: str, *, tell: Any, method: str
) -> list[tuple[dict[str, Any], np.ndarray, np.ndarray]]:
    """Return the result of :func:`predict_sequence` for each sequence of a split."""
    windows = saf_gen.SpikeWindows(
        dataset, split, window=WINDOW, stride=STRIDE, crop=(BOX, BOX), target=lambda stream, first, stop: None
    )
    entries = {window.sequence.id: window.sequence for window in windows.windows}
    return [predict_sequence(entry, windows, tell=tell, method=method) for entry in entries.values()]


def judge(dataset: Path, found: list[tuple[dict[str, Any], np.ndarray, np.ndarray]], split: str) -> np.ndarray:
    """Return the errors of answers in depths of focus, as the leaderboard computes them."""
    errors = []
    for line, _, _ in found:
        with saf_gen.open_stream(dataset / split / f"{line['sequence']}.h5") as stream:
            near, far = stream.truth.depth_of_focus
            errors.append((stream.metadata.lens_position[round(line["frame"])] - stream.truth.position) / (far - near))
    return np.array(errors)


def draw(out: Path, rows: list[dict[str, float]], *, shown: tuple[str, np.ndarray, np.ndarray]) -> None:
    """Draw the learning curves, and the blurs that the last network predicted for one sequence."""
    name, positions, blurs = shown
    figure, ((left, right),) = panels(1, 2, width=7, height=2.8)
    for seed in sorted({row["seed"] for row in rows}):
        mine = [row for row in rows if row["seed"] == seed]
        for key, colour in (("train", BLUE), ("validation", ORANGE)):
            label = key if seed == rows[0]["seed"] else None
            left.plot([row["epoch"] for row in mine], [row[key] for row in mine], color=colour, label=label)
    left.set(xlabel="epoch", ylabel="loss", title="learning, one line a seed", ylim=(0, None))
    left.legend(frameon=False)
    right.plot(positions, blurs, ".", color=BLUE, label="network")
    right.axvline(find_focus(positions, blurs), color=ORANGE, label="answer")
    right.set(xlabel="position of the lens", ylabel="blur, pixels", title=name, ylim=(0, max(1, 1.4 * blurs.max())))
    right.legend(frameon=False, loc="upper center", ncols=2)
    save(figure, out / "curve.png")


def train_and_predict(dataset: Path, out: Path, *, seeds: list[int], epochs: int) -> None:
    """Train a network per seed, print its errors on the split validation, and write all files to ``out``."""
    require_extra("torch", "torch", of="train_network")
    missing = {"train", "validation", "test"} - set(read_manifest(dataset).splits)
    if missing:
        raise BadInput(f"has no split {' and '.join(sorted(missing))}", where=str(dataset), hint="recipes/learn.yaml")
    import torch

    out.mkdir(parents=True, exist_ok=True)
    rows, lines = [], []
    for seed in seeds:
        network, more = train(dataset, seed=seed, epochs=epochs)
        torch.save(network.state_dict(), out / f"blur_net_{seed}.pt")
        rows += more
        found = {
            split: predict_split(dataset, split, tell=tell_with(network), method=f"blur_net_{seed}")
            for split in ("validation", "test")
        }
        errors = judge(dataset, found["validation"], "validation").round(2)
        print(f"seed {seed}: errors on validation, in depths of focus:", *errors)
        lines += [line for line, _, _ in found["test"]]
    with (out / "curve.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    (out / "predictions.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    last, positions, blurs = found["test"][0]
    draw(out, rows, shown=(last["sequence"], positions, blurs))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--epochs", type=int, default=10)
    options = parser.parse_args()
    try:
        train_and_predict(options.dataset, options.out, seeds=options.seeds, epochs=options.epochs)
    except BadInput as error:
        print(f"train_network: {error}", file=sys.stderr)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
