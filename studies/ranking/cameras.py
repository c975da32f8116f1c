"""Several cameras behind one lens: how often the answers of each are near the focus, by the light on the sensor.

    python -m studies.ranking.cameras PICTURE.png FILE-records.xz ...

Each packed file holds the records of all cameras at one level of light and in one region, as ``studies.ranking.native``
made them and named them: ``test-5-lux-1-s-inside-records.xz``. The picture shows the best method of each camera: the
first one of its list there, chosen on training members. Errors of all cameras are in depths of focus of the spike
camera, so that finer pixels are not held to a smaller one. Only recordings count whose lens comes within one of the
focus; where a camera sees nothing at all, it is wrong. Intervals are of 95 %: members are drawn again.
"""

import argparse
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from saf_gen.benchmark.records import NO_INSIDE, Record
from saf_gen.camera import get_sensor, sensor_names
from saf_gen.camera.kinds import OURS
from saf_gen.core.files import check_writable
from saf_gen.errors import BadInput
from studies.drawing import GREY, panels, save
from studies.ranking.native import BASE, FIELD_M, METHODS, PIXELS
from studies.ranking.packed_records import read_packed_records

DRAWS, SEED = 10_000, 1
EVENT_BITS = 64  # address and time of an event as cameras send them: AEDAT 2, 32 bits each
UNANSWERABLE = ("lens at rest", "focus not reached", NO_INSIDE)
NAMED = re.compile(r"(\w+)-([\d.]+)-lux-([\d.]+)-s-(target|inside)-records\.xz")
LOOK = {  # colours of Okabe and Ito
    BASE: ("spikes", "#0072B2", "o"),
    "imx273": ("frames", "#D55E00", "s"),
    "qvga_spad": ("photons", "#009E73", "^"),
    "davis346": ("events", "#CC79A7", "D"),
}
PLACES = {"target": "in the target's box", "inside": "inside the target"}


class Level(NamedTuple):
    """Answers of cameras at one level of light, on recordings whose focus all can find.

    Attributes
    ----------
    members : list of str, length n
        Member of each recording.
    off : mapping of (str, str) to ndarray of float64, shape (n,)
        Distance of the answer from the focus in depths of focus of the spike camera, by camera and method; infinite
        without an answer.
    own : mapping of (str, str) to ndarray of float64, shape (n,)
        The same in depths of focus of the camera itself.
    megabits : mapping of (str, str) to float
        Median of the 10⁶ bits that left the chip until the answer.
    """

    members: list[str]
    off: Mapping[tuple[str, str], np.ndarray]
    own: Mapping[tuple[str, str], np.ndarray]
    megabits: Mapping[tuple[str, str], float]


def camera_of(record: Record) -> str:
    """Return the name of the camera that made a recording, without the digest of numbers that were changed."""
    return (record.what.sensor or "unknown").partition("#")[0].removesuffix(PIXELS)


def level_of(records: Iterable[Record]) -> Level:
    """Return the answers of several cameras; raise BadInput if no recording counts for all of them."""
    held: dict[tuple[str, str], dict[str, Record]] = {}
    for record in records:
        held.setdefault((camera_of(record), record.who.method), {})[record.what.sequence] = record
    base = {name: record for (camera, _), of in held.items() if camera == BASE for name, record in of.items()}
    bad = {name for of in held.values() for name, r in of.items() if r.what.obstacle == NO_INSIDE}
    depths = {
        name: record.judgement.depth_of_focus
        for name, record in base.items()
        if record.what.obstacle not in UNANSWERABLE and record.judgement.depth_of_focus and name not in bad
    }
    shared = sorted(depths.keys() & set.intersection(*(set(of) for of in held.values()))) if held else []
    if not shared:
        raise BadInput("no recording has an answer with every camera", allowed=f"records of {BASE} and of others")

    def errors(of: Mapping[str, Record], *, own: bool) -> np.ndarray:
        answers = {name: of[name].judgement for name in shared}
        sizes = {name: answer.depth_of_focus if own else depths[name] for name, answer in answers.items()}
        return np.array(
            [
                abs(answer.error) / size if answer.error is not None and (size := sizes[name]) else np.inf
                for name, answer in answers.items()
            ]
        )

    return Level(
        [name.rpartition("-")[0] for name in shared],
        {key: errors(of, own=False) for key, of in held.items()},
        {key: errors(of, own=True) for key, of in held.items()},
        {key: float(np.median([megabits(of[name]) for name in shared])) for key, of in held.items()},
    )


def interval(values: np.ndarray, members: Sequence[str]) -> tuple[float, float, float]:
    """Return the mean of values, (n,), and the ends of its 95 % interval if members, (n,), are drawn again."""
    names, index = np.unique(members, return_inverse=True)
    sums, counts = np.bincount(index, values), np.bincount(index)
    drawn = np.random.default_rng(SEED).integers(0, len(names), (DRAWS, len(names)))
    low, high = np.quantile(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1), (0.025, 0.975))
    return float(values.mean()), float(low), float(high)


def megabits(record: Record) -> float:
    """Return the 10⁶ bits of the field that leave the chip in the frames that a method saw.

    The name of the sensor tells its kind: one bit per readout of a spike or photon, those of a number for each pixel
    of a frame, also of pixels that are summed off the chip, and with events their mean rate over the recording. NaN if
    the record names no sensor or no rate.
    """
    name = camera_of(record)
    kind = next((kind for kind in OURS if name in sensor_names(kind)), None)
    if kind is None:
        return np.nan
    sensor, seen = get_sensor(name, kind=kind), record.judgement.frames_seen
    bits = {"frames": getattr(sensor, "bits", 1), "events": (record.what.mean_rate or np.nan) * EVENT_BITS}.get(kind, 1)
    return float(seen * bits * round(FIELD_M / sensor.pitch_m) ** 2 / 1e6)


def order(levels: Sequence[Level]) -> list[tuple[str, str]]:
    """Return cameras and methods that all levels have, in the order in which training members put them."""
    keys = set.intersection(*(set(level.off) for level in levels))
    known = [(camera, method) for camera in LOOK for method in METHODS[camera]]

    def place(key: tuple[str, str]) -> tuple[int, int, str]:
        camera = list(LOOK).index(key[0]) if key[0] in LOOK else len(LOOK)
        return camera, known.index(key) if key in known else len(known), key[1]

    return sorted(keys, key=place)


def success_cells(levels: Sequence[Level], key: tuple[str, str]) -> list[str]:
    """Return, for each level, the success of a camera's method within one depth with its interval, and within half."""
    cells = []
    for level in levels:
        mean, low, high = (100 * end for end in interval((level.off[key] <= 1).astype(float), level.members))
        cells.append(f"{mean:.0f} ({100 * (level.off[key] <= 0.5).mean():.0f}) [{low:.0f}–{high:.0f}]")
    return cells


def lead_cells(levels: Sequence[Level], camera: str) -> list[str]:
    """Return, for each level, by how many points the best method of a camera is ahead of that of the spike camera."""
    cells = []
    for level in levels:
        keys = [(name, METHODS[name][0]) for name in (camera, BASE)]
        if missing := [method for name, method in keys if (name, method) not in level.off]:
            raise BadInput(f"there are no records of {missing[0]}", allowed="records of the best method of each camera")
        own, spikes = (level.off[key] <= 1 for key in keys)
        mean, low, high = interval(100.0 * own - 100.0 * spikes, level.members)
        cells.append(f"{mean:+.0f} [{low:+.0f} to {high:+.0f}]")
    return cells


def cost_cells(level: Level, key: tuple[str, str]) -> list[str]:
    """Return the median error, the success within one depth of the camera's own, and the 10⁶ bits."""
    return [
        f"{np.median(level.off[key]):.2f}",
        f"{100 * (level.own[key] <= 1).mean():.0f}",
        f"{level.megabits[key]:,.3g}",
    ]


def draw(files: Sequence[Path], picture: Path) -> None:
    """Draw the success of the best method of each camera over the light; raise BadInput if a file cannot be used."""
    drawn: dict[tuple[str, float], dict[float, Level]] = {}
    splits = set()
    for file in files:
        named = NAMED.fullmatch(file.name)
        if named is None:
            raise BadInput(f"the file is named {file.name!r}", allowed="SPLIT-L-lux-S-s-REGION-records.xz")
        split, lux, seconds, region = named.groups()
        splits.add(split)
        drawn.setdefault((region, float(seconds)), {})[float(lux)] = level_of(read_packed_records(file))
    if len(splits) > 1:
        raise BadInput(f"the files are of {', '.join(sorted(splits))}", allowed="files of one split and condition")
    regions = [region for region in PLACES if any(place == region for place, _ in drawn)]
    figure, (axes,) = panels(1, len(regions), width=1 + 3.6 * len(regions), height=3.3)
    for axis, region in zip(axes, regions, strict=True):
        times = sorted(seconds for place, seconds in drawn if place == region)
        for camera, (word, colour, mark) in LOOK.items():
            key = camera, METHODS[camera][0]
            for seconds in times:
                levels = sorted((lux, of) for lux, of in drawn[region, seconds].items() if key in of.off)
                ends = [100 * np.array(interval((of.off[key] <= 1).astype(float), of.members)) for _, of in levels]
                if not ends:
                    continue
                lux, (mean, low, high) = [at for at, _ in levels], np.transpose(ends)
                first = seconds == times[0]
                axis.plot(
                    lux,
                    mean,
                    "-" if first else ":",
                    color=colour,
                    marker=mark,
                    markersize=4,
                    label=f"{word}: {key[1]}" if first else None,
                )
                if first:
                    axis.fill_between(lux, low, high, color=colour, alpha=0.15, linewidth=0)
        axis.set_xscale("log")
        axis.set_xticks(sorted({lux for time in times for lux in drawn[region, time]}))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.minorticks_off()
        axis.set(ylim=(0, 103), title=PLACES[region], xlabel="light on the sensor, lux")
        axis.grid(axis="y")
    for seconds in times[1:]:
        axes[0].plot([], [], ":", color=GREY, label=f"dotted: sweeps of {seconds:g} s")
    axes[0].set_ylabel("within one depth of focus, %")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8)
    save(figure, picture)


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the picture, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("picture", type=Path)
    parser.add_argument("files", type=Path, nargs="+", help="packed records of all cameras at a level of light")
    given = parser.parse_args(argv)
    try:
        check_writable(given.picture.parent)
        draw(given.files, given.picture)
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
