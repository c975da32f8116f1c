"""Measure the cost of many sequences: commands that process an entire dataset of tiny streams.

    python -m studies.speed.scale 2000 10000 [--scenes 10] [--out FOLDER] [--methods M...]

For each number of sequences the script prints the processor time and peak memory of each command, which runs in a
separate process, and the sizes of the files that it wrote. Spikes are drawn from the random streams ("scale", number)
of core/seeds.py. With --out, the datasets are kept for later runs.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from saf_gen.core import seeds
from saf_gen.stream.dataset import index_folder
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_writer import write_stream

FRAMES, HEIGHT, WIDTH = 400, 16, 16
LIGHTS = ("constant", "continuous", "sudden", "flicker", "off")
RECIPE = """\
name: many
seed: 7
camera: {{sensor: vidar_400x250, frames: 400, exposure: {{mean_rate: 0.2}}}}
focus: {{positions: 9}}
render: {{samples: 16}}
lights: {{constant: {{kind: constant}}, continuous: {{kind: ramp, from: {{uniform: [0.5, 1]}}, to: 2.0}}}}
splits:
  test: {{scenes: [camel, bottle, usaf_target, fan, speculars], lights: [constant, continuous], repeats: {repeats}}}
"""
WRITTEN = ("manifest.json", *(f"evaluation/{name}" for name in ("index.html", "records.jsonl", "leaderboard.json")))


def make_dataset(folder: Path, *, sequences: int, scenes: int) -> None:
    """Write streams of sweeps over a chequered board that comes into focus, cycling through scenes and lights."""
    board = np.where(np.add.outer(np.arange(HEIGHT) // 4, np.arange(WIDTH) // 4) % 2, 1.0, -1.0)
    lens = np.linspace(0, 1, FRAMES, dtype=np.float32)
    (folder / "test").mkdir(parents=True)
    for number in range(sequences):
        random = seeds.make_generator("scale", number)
        peak = random.uniform(0.2, 0.8)
        contrast = 0.05 + 0.9 * np.exp(-(((lens - peak) / 0.1) ** 2))
        spikes = random.random((FRAMES, HEIGHT, WIDTH)) < 0.25 * (1 + contrast[:, None, None] * board)
        name = f"scene_{number % scenes}-{LIGHTS[number // scenes % 5]}-{number // scenes // 5:04d}"
        truth = Truth(position=peak, depth_of_focus=(peak - 0.05, peak + 0.05), frame=peak * (FRAMES - 1))
        write_stream(folder / "test" / f"{name}.h5", spikes.astype(np.uint8), focus_position=lens, truth=truth)
    index_folder(folder)


def measure_command(*command: str) -> str:
    """Run a saf-gen command, and return its processor time, peak memory and duration as text."""
    began = time.monotonic()
    child = subprocess.Popen([sys.executable, "-m", "saf_gen", *command], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    failed = "" if status == 0 else f"   ended with {os.waitstatus_to_exitcode(status)}"
    processor = used.ru_utime + used.ru_stime
    return (
        f"{processor:8.1f} s of a processor, {used.ru_maxrss / 1024:6.0f} MB, {time.monotonic() - began:7.1f} s{failed}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sequences", type=int, nargs="+")
    parser.add_argument("--scenes", type=int, default=10)
    parser.add_argument("--methods", nargs="*", default=["sd+argmax", "brenner+argmax"])
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    out = given.out or Path(tempfile.mkdtemp())
    for count in given.sequences:
        folder, recipe = out / f"many-{count}-{given.scenes}", out / f"many-{count}.yaml"
        if not folder.exists():
            make_dataset(folder, sequences=count, scenes=given.scenes)
        recipe.write_text(RECIPE.format(repeats=max(1, count // 10)))
        for command in (
            ("generate", str(recipe), "--out", str(out / "none"), "--dry-run"),
            ("verify", str(folder)),
            ("evaluate", str(folder), *(f"--method={name}" for name in given.methods)),
            ("leaderboard", str(folder / "evaluation"), "--out", str(out / f"merged-{count}")),
        ):
            print(f"{count:7} {command[0]:12} {measure_command(*command)}", flush=True)
        for name in WRITTEN:
            if (folder / name).exists():
                print(f"{count:7} {name:26} {(folder / name).stat().st_size / 1e6:9.2f} MB", flush=True)


if __name__ == "__main__":
    main()
