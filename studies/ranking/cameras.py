"""One scene, several cameras: compare evaluations of the same sequences, recorded by different cameras.

    python -m studies.ranking.cameras spikes=EVALUATION photons=EVALUATION …
    python -m studies.ranking.cameras studies/results/cameras-tuned-records.xz

Each evaluation is a folder, or its ``records.jsonl``, of the same sequences by another camera (``saf-gen recapture``);
in one packed file, the sensors of its records tell cameras apart, in the order in which they come. The others are
compared with the first. Printed are, for each camera and method, the share of the answers within one and within half a
depth of focus; how often it answers where no answer is right; its worth, which tuning maximises: right answers minus
these false ones, over all recordings; how many bits per pixel leave the chip until the answer; and the difference of
the best method of each camera from the best of the first. Only recordings that have an answer with every camera count
for the shares. Intervals are of 95 %: members are drawn again.
"""

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from saf_gen.benchmark.records import Record, read_records
from saf_gen.camera import get_sensor, sensor_names
from saf_gen.errors import BadInput
from studies.ranking.packed_records import read_packed_records

DRAWS, SEED = 10_000, 1
EVENT_BITS = 64  # address and time of an event as cameras send them: AEDAT 2, 32 bits each

Answers = Mapping[str, Mapping[str, Record]]
"""Records by method and sequence."""


def read_answers(evaluation: Path) -> Answers:
    """Return the records of an evaluation; raise BadInput if it cannot be read."""
    return _by_method(read_records(evaluation))


def read_cameras(packed: Path) -> dict[str, Answers]:
    """Return packed records by the name of their sensor; raise BadInput if they cannot be read."""
    by_sensor: dict[str, list[Record]] = defaultdict(list)
    for record in read_packed_records(packed):
        by_sensor[record.what.sensor or "unknown"].append(record)
    return {sensor: _by_method(of_sensor) for sensor, of_sensor in by_sensor.items()}


def _by_method(records: Iterable[Record]) -> Answers:
    answers: dict[str, dict[str, Record]] = defaultdict(dict)
    for record in records:
        answers[record.who.method][record.what.sequence] = record
    return answers


def has_answer(record: Record) -> bool:
    """Return whether an answer to the recording can be right, and judged."""
    return record.what.obstacle is None and record.success() is not None


def interval(values: np.ndarray, members: Sequence[str]) -> tuple[float, float, float]:
    """Return the mean of values, (n,), and the ends of its 95 % interval if members, (n,), are drawn again."""
    names, index = np.unique(members, return_inverse=True)
    sums, counts = np.bincount(index, values), np.bincount(index)
    drawn = np.random.default_rng(SEED).integers(0, len(names), (DRAWS, len(names)))
    low, high = np.quantile(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1), (0.025, 0.975))
    return float(values.mean()), float(low), float(high)


def bits_per_pixel(record: Record) -> float:
    """Return the bits per pixel that leave the chip in the frames that a method saw; a name of a sensor tells its kind.

    One per readout of a spike or photon, the bits of a number per frame, and with events their mean rate over the
    recording. NaN if the record does not name its sensor.
    """
    if record.what.sensor is None:
        return np.nan
    name = record.what.sensor.partition("#")[0]  # of a preset that was changed
    if name in sensor_names("frames"):
        return float(record.judgement.frames_seen * get_sensor(name, kind="frames").bits)
    if name in sensor_names("events"):
        return (
            np.nan
            if record.what.mean_rate is None
            else record.what.mean_rate * record.judgement.frames_seen * EVENT_BITS
        )
    return float(record.judgement.frames_seen)


def compare(cameras: Mapping[str, Answers]) -> list[str]:
    """Return the lines of both tables.

    Raises BadInput if there are fewer than two cameras, or no recording has an answer with all of them.
    """
    if len(cameras) < 2:
        raise BadInput(f"{len(cameras)} camera is given", allowed="at least two, as NAME=EVALUATION")
    seen = set[str].intersection(*(set[str]().union(*answers.values()) for answers in cameras.values()))
    judged = (
        {name for records in answers.values() for name, record in records.items() if has_answer(record)}
        for answers in cameras.values()
    )
    shared = sorted(set[str].intersection(*judged))
    if not shared:
        raise BadInput("no recording has an answer in all evaluations", allowed="evaluations of the same sequences")
    members = [name.rpartition("-")[0] for name in shared]
    lines = [f"{len(shared)} recordings of {len(set(members))} members have an answer with every camera.", ""]
    columns = "≤½ DoF", "≤1 DoF", "95 %", "median error, DoF", "false answers", "worth", "bits per pixel"
    lines += [f"| camera | method | {' | '.join(columns)} |", "|---" * (2 + len(columns)) + "|"]
    best: dict[str, np.ndarray] = {}
    heads: dict[str, str] = {}
    for camera, answers in cameras.items():
        rows = []
        for method, found in answers.items():
            held = [found.get(name) for name in shared]
            one = np.array([record is not None and bool(record.success()) for record in held], float)
            half = np.array([record is not None and bool(record.success(0.5)) for record in held], float)
            errors = [
                abs(record.judgement.error_dof)
                for record in held
                if record is not None and record.judgement.error_dof is not None
            ]
            bits = float(np.median([bits_per_pixel(record) for record in held if record is not None]))
            without = [found[name] for name in seen & found.keys() if found[name].what.obstacle is not None]
            false = sum(record.judgement.status == "answered" for record in without)
            worth = (one.sum() - false) / (len(shared) + len(without))
            said = f"{false} of {len(without)} | {worth:.2f} | {bits:,.0f}"
            rows.append((one, half, method, float(np.median(errors)) if errors else np.nan, said))
        rows.sort(key=lambda row: (row[0].mean(), row[1].mean()), reverse=True)
        best[camera], heads[camera] = rows[0][0], rows[0][2]
        for one, half, method, error, said in rows:
            mean, low, high = interval(one, members)
            ends = f"{100 * low:.0f}–{100 * high:.0f}"
            cells = f"{half.mean():.0%} | {mean:.0%} | {ends} | {error:.2f} | {said}"
            lines.append(f"| {camera} | `{method}` | {cells} |")
    first, *others = cameras
    lines += ["", f"| best method of | points that `{heads[first]}` with {first} is ahead | 95 % |", "|---|---|---|"]
    for camera in others:
        mean, low, high = interval(100 * (best[first] - best[camera]), members)
        lines.append(f"| {camera}: `{heads[camera]}` | {mean:+.0f} | {low:+.0f} to {high:+.0f} |")
    return lines


def _read(texts: Sequence[str]) -> dict[str, Answers]:
    if len(texts) == 1 and texts[0].endswith(".xz"):
        return read_cameras(Path(texts[0]))
    for text in texts:
        if "=" not in text:
            raise BadInput(
                f"the evaluation is {text!r}",
                allowed="NAME=EVALUATION, such as photons=out, or one file of records, .xz",
            )
    named = (text.partition("=") for text in texts)
    return {name: read_answers(Path(folder)) for name, _, folder in named}


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "evaluations",
        nargs="+",
        metavar="NAME=EVALUATION",
        help="camera and its evaluation, or one file of records, .xz",
    )
    given = parser.parse_args(argv)
    try:
        print("\n".join(compare(_read(given.evaluations))))
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
