"""Recordings of other programs, with content that is known: none may be read wrongly.

``python tests/robustness/foreign_files.py --count 600 --seed 1`` draws sizes, layouts, orders of bits and of axes,
containers, brightness and texture, writes each with numpy or scipy, and imports it three times: without an option, with
some of those that say how it is stored, and with all. It prints how many were read and refused, and ends with 1 if one
was read wrongly, or refused with all options.
"""

import argparse
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.io import savemat

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "helpers"))
from planted_recordings import fire, make_picture, write_416, write_dense, write_sps1000

from saf_gen.errors import BadInput
from saf_gen.stream.interop import SpikeArray, import_raw_frames, state_layout
from saf_gen.stream.stream_file import open_stream

SIZES = [(250, 400), (400, 600), (256, 448), (128, 128), (200, 500), (500, 200), (240, 320), (100, 125), (36, 64)]
CONTENTS = ("texture", "fine", "coarse", "bright", "moving light", "dim", "flat", "random", "dark")


@dataclass(frozen=True)
class Foreign:
    """A file that was written, and the options that say how."""

    path: Path
    spikes: np.ndarray
    content: str
    stored: str
    options: dict[str, object]


def draw_spikes(random: np.random.Generator, size: tuple[int, int], frames: int, content: str) -> np.ndarray:
    """Return spikes (frames, H, W) of a content of CONTENTS."""
    seed = int(random.integers(1 << 30))
    if content == "random":
        return (random.random((frames, *size)) < random.uniform(0.05, 0.5)).astype(np.uint8)
    if content == "dark":
        return np.zeros((frames, *size), np.uint8)
    if content == "flat":
        return fire(np.full(size, random.uniform(0.05, 0.6)), frames, seed=seed)
    smooth = {"fine": 1.0, "coarse": 12.0}.get(content, random.uniform(2, 6))
    low, high = {"bright": (0.2, 0.95), "dim": (0.001, 0.004)}.get(content, (0.04, random.uniform(0.25, 0.5)))
    picture = make_picture(*size, low=low, high=high, smooth=smooth, seed=seed)
    if content != "moving light":
        return fire(picture, frames, seed=seed)
    parts = [fire(picture * gain, frames // 4, seed=seed + n) for n, gain in enumerate((1.0, 0.4, 0.7, 1.0))]
    return np.concatenate(parts)


def write_foreign(random: np.random.Generator, folder: Path) -> Foreign:
    """Draw and write one file."""
    content = str(random.choice(CONTENTS, p=[0.2, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1]))
    container = str(
        random.choice(["dense", "416", "sps1000", "npy", "npz", "mat"], p=[0.35, 0.12, 0.03, 0.2, 0.15, 0.15])
    )
    bits = str(random.choice(["lsb", "msb"]))
    order = "little" if bits == "lsb" else "big"
    frames = 8 * int(random.integers(9, 16))
    if container in ("416", "sps1000"):
        size = (250, 400) if container == "416" else (1000, 1000)
        spikes = draw_spikes(random, size, frames if container == "416" else 32, content)
        path = folder / "a.dat"
        {"416": write_416, "sps1000": write_sps1000}[container](path, spikes, bitorder=order)
        return Foreign(path, spikes, content, f"{container} {bits}", {"layout": container, "order": bits})
    size = SIZES[0] if container == "dense" and random.random() < 0.4 else SIZES[random.integers(len(SIZES))]
    if size[0] * size[1] < 30_000:
        frames *= 4
    spikes = draw_spikes(random, size, frames, content)
    if container == "dense":
        path = folder / f"a{random.choice(['.dat', '.raw', '.bin'])}"
        size = spikes.shape[1:]
        if size[0] * size[1] % 8:
            spikes = spikes[:, :, : size[1] // 8 * 8]
        write_dense(path, spikes, bitorder=order)
        return Foreign(path, spikes, content, f"dense {size} {bits}", {"size": spikes.shape[1:], "order": bits})
    return write_array(random, folder / f"a.{container}", spikes, content, bits=bits)


def write_array(random: np.random.Generator, path: Path, spikes: np.ndarray, content: str, *, bits: str) -> Foreign:
    """Write spikes as an array of a drawn packing, order of axes and dtype."""
    array, options = spikes, dict[str, object]()
    kind = str(random.choice(["uint8", "bool", "float32", "int64", "packed"], p=[0.2, 0.1, 0.1, 0.1, 0.5]))
    if kind == "packed":
        array, options["order"] = np.packbits(spikes, axis=0, bitorder="little" if bits == "lsb" else "big"), bits
    else:
        # zeros of bytes may be packed, so that they have to be stored as bool
        array = spikes.astype(bool if kind == "uint8" and not spikes.any() else kind)
    options["axes"] = str(random.choice(["TYX", "YXT", "XYT", "YTX"], p=[0.4, 0.4, 0.1, 0.1]))
    array = np.transpose(array, ["TYX".index(letter) for letter in str(options["axes"])])
    if path.suffix == ".mat":
        savemat(path, {"spikes": array}, do_compression=bool(random.integers(2)))
    elif path.suffix == ".npz":
        (np.savez if random.integers(2) else np.savez_compressed)(path, spikes=np.ascontiguousarray(array))
    else:
        np.save(path, np.asfortranarray(array) if random.integers(2) else array)
    return Foreign(path, spikes, content, f"{path.suffix} {kind} {options}", options)


def read(file: Foreign, options: dict[str, object]) -> np.ndarray:
    """Return the spikes that an import with these options gives; raise BadInput if it is refused."""
    out = file.path.with_name("out.h5")
    if file.path.suffix in (".npy", ".npz", ".mat"):
        SpikeArray(file.path, **{"axes": None, **options}).write(out, readout_hz=20_000)  # type: ignore[arg-type]
    else:
        layout, order = state_layout(file.path, **{"layout": None, "size": None, "order": None, **options})  # type: ignore[arg-type]
        size = (layout.rows, layout.columns)
        import_raw_frames(file.path, out, layout=layout.name, size=size, order=order, flip=False)
    with open_stream(out) as stream:
        return stream.frames(0, stream.shape[0])


def judge(file: Foreign, options: dict[str, object]) -> str:
    """Return ``read``, ``refused`` or ``wrong``."""
    try:
        found = read(file, options)
    except BadInput:
        return "refused"
    same = found.shape == file.spikes.shape and np.array_equal(found, file.spikes)
    return "read" if same else "wrong"


WAYS = ("without an option", "with some", "with all")


def some_of(options: dict[str, object], random: np.random.Generator) -> dict[str, object]:
    """Return all options but one; not without the order of bits of a named layout, which states the usual one."""
    named = {"order"} if "layout" in options and options["order"] == "msb" else set()
    left_out = str(random.choice([name for name in options if name not in named]))
    return {name: value for name, value in options.items() if name != left_out}


def run(count: int, seed: int) -> tuple[Counter[tuple[str, str, str]], list[str]]:
    """Return how many files of each content were read, refused or wrong in each of WAYS, and the faults."""
    found: Counter[tuple[str, str, str]] = Counter()
    faults = []
    for number in range(count):
        if number and number % 100 == 0:
            print(f"{number} of {count}: {len(faults)} faults", file=sys.stderr)
        random = np.random.default_rng([seed, number])
        with TemporaryDirectory(prefix="foreign-") as folder:
            file = write_foreign(random, Path(folder))
            for way, options in zip(WAYS, ({}, some_of(file.options, random), file.options), strict=True):
                verdict = judge(file, options)
                found[file.content, way, verdict] += 1
                if (
                    verdict == "wrong"
                    or (verdict != "read" and way == WAYS[2])
                    or (verdict == "read" and way == WAYS[0])
                ):
                    faults.append(f"--seed {seed} number {number}: {file.content}, {file.stored}, {way}: {verdict}")
    return found, faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    found, faults = run(asked.count, asked.seed)
    for way in WAYS:
        for content in CONTENTS:
            counts = {verdict: found[content, way, verdict] for verdict in ("read", "refused", "wrong")}
            print(f"{way:17} {content:13} " + "  ".join(f"{name} {n}" for name, n in counts.items()))
    for way in WAYS:
        counts = {v: sum(found[content, way, v] for content in CONTENTS) for v in ("read", "refused", "wrong")}
        print(f"{way}: " + ", ".join(f"{n} {name}" for name, n in counts.items()))
    print("\n".join(faults) or "none was read wrongly")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
