"""Flip bits in every kind of file that saf-gen writes and reads again, and report the flips that it does not detect.

    python tests/robustness/flips.py --flips 2000 --seed 99

A flip is "told" if it causes an error of one line; "harmless" if everything read from the file is as it was written,
because the bit is in unused space or in an order without meaning; and "unseen" if something else was read without an
error. Files that people write (recipes, scene cards, sensors, lists, logs
and answers) have no digest, and are not tested.
"""

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import fuzz_worker
import numpy as np

import saf_gen
from saf_gen.benchmark.method_spec import read_tuned
from saf_gen.benchmark.records import read_records
from saf_gen.errors import BadInput
from saf_gen.optics import ImageDistanceDrive
from saf_gen.stack.focal_stack import StackSpec, StackStore
from saf_gen.stream.manifest import read_manifest

DRIVE = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))
STACK = StackSpec("plane", "0" * 64, ("lamp",), DRIVE, 16, 24, 60e-6, 9, 16, 4)


@dataclass(frozen=True)
class Flipped:
    """A kind of file: its path among the samples, and a function that reads all of it."""

    name: str
    path: str
    read: Callable[[Path], Any]


def _read_stream(path: Path) -> Any:
    with saf_gen.open_stream(path) as stream:
        truth, held = stream.truth, stream.metadata
        arrays = stream.focus_position, stream.gain, truth.depth, truth.target, truth.sharpness
        facts = stream.readout_hz, stream.content_sha256, stream.light_names, dict(held.provenance)
        frames = stream.frames(0, stream.shape[0])
        return [facts, truth.position, truth.depth_of_focus, truth.frame, *(a.tobytes() for a in (*arrays, frames))]


def _read_stack(path: Path) -> Any:
    root = path.parents[1]
    stack = StackStore(root, StackSpec.read(root, STACK.key)).load()
    return stack.radiance.tobytes(), stack.depth.tobytes(), stack.target.tobytes(), stack.spec


def _write_stack(root: Path) -> None:
    rng, store = np.random.default_rng(3), StackStore(root, STACK)
    store.write_group("lamp", rng.random((9, 16, 24), np.float32), backend="llvm")
    store.write_geometry(rng.random((16, 24), np.float32), rng.random((16, 24)) < 0.5, backend="llvm")


KINDS = (
    Flipped("stream", "data/test/a.h5", _read_stream),
    Flipped("manifest", "data/manifest.json", lambda path: read_manifest(path.parent)),
    Flipped("records", "judged/records.jsonl", read_records),
    Flipped("tuned file", "tuned.json", lambda path: read_tuned(path)[0]),
    Flipped("focal stack", f"stacks/{STACK.key}/lamp.exr", _read_stack),
    Flipped("note of a focal stack", f"stacks/{STACK.key}/geometry.json", _read_stack),
)


def flip(kind: Flipped, root: Path, rng: Random, count: int) -> dict[str, Any]:
    """Flip ``count`` bits of a file, one at a time, and return which were told, harmless and unseen."""
    path = sorted(root.glob(kind.path))[0]
    whole, written = path.read_bytes(), kind.read(path)
    told, harmless, unseen, other = 0, [], [], []
    for _ in range(count):
        at, bit = rng.randrange(len(whole)), rng.randrange(8)
        damaged = bytearray(whole)
        damaged[at] ^= 1 << bit
        path.write_bytes(damaged)
        try:
            (harmless if kind.read(path) == written else unseen).append((at, bit))
        except BadInput as error:
            told += "\n" not in str(error)
        except Exception as error:  # noqa: BLE001 - a user would see any of them as a traceback
            other.append((at, bit, repr(error)[:200]))
    path.write_bytes(whole)
    places = sorted({at for at, _ in harmless})
    return {"kind": kind.name, "bytes": len(whole), "told": told, "harmless": len(harmless), "at": places,
            "unseen": unseen, "tracebacks": other}  # fmt: skip


def flip_kinds(flips: int, seed: int, kinds: Sequence[str] = ()) -> Iterator[dict[str, Any]]:
    """Yield what :func:`flip` returns for each kind of file, or for some by name; the working folder is changed."""
    root = Path(tempfile.mkdtemp(prefix="saf-gen-flips"))
    try:
        fuzz_worker.write_samples_in(root)
        _write_stack(root / "stacks")
        for kind in KINDS:
            if not kinds or kind.name in kinds:
                yield flip(kind, root, Random(f"{seed} {kind.name}"), flips)
    finally:
        shutil.rmtree(root)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flips", type=int, default=2000, help="number of flips in each kind of file")
    parser.add_argument("--seed", type=int, default=99)
    parser.add_argument("--kind", action="append", choices=[kind.name for kind in KINDS])
    given, bad = parser.parse_args(), 0
    for found in flip_kinds(given.flips, given.seed, given.kind or ()):
        bad += len(found["unseen"]) + len(found["tracebacks"])
        print(json.dumps(found), flush=True)
    print(f"{bad} unseen or not told in one line, seed {given.seed}")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
