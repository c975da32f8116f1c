"""How near measures could come to the truth without noise: the peaks of their noise-free curves, over a dataset.

    python -m studies.ranking.ceilings DATASET [--split test] [--region inside]

A measure that weighs the contrast of a target differs from the truth, which weighs its pixels or a stated texture,
wherever depth and contrast go together. No search can do better than the peak of its measure's curve, unless by luck.
Recordings state the peak that is nearest to the truth; a higher one elsewhere, as of a wall behind the target, is not
seen here, but that of ``sd`` is the highest of the whole travel. Each member of a family of scenes counts once. A
second table says on how many members of a stratum all these peaks are right: there, the question has one answer.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saf_gen.benchmark.judgement import judged_dof
from saf_gen.benchmark.strata import stratum_in
from saf_gen.errors import BadInput
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.optima import curve_peak, optima_of_stream
from saf_gen.stream.stream_file import open_stream

LIMITS_DOF = (0.5, 1.0)


@dataclass(frozen=True)
class Ceiling:
    """Distances of the noise-free peaks of a measure from the truth, in depths of focus, float64 (member,)."""

    measure: str
    errors_dof: np.ndarray

    def within(self, limit_dof: float) -> float:
        """Return the fraction of members whose peak is within a distance of the truth."""
        return float((np.abs(self.errors_dof) <= limit_dof).mean())


@dataclass(frozen=True)
class Member:
    """The noise-free peaks of a member by measure, as distances from the truth in depths of focus, and its stratum."""

    stratum: str
    peaks_dof: dict[str, float]


def find_peaks(dataset: Path, *, split: str = "test", region: str = "target") -> list[Member]:
    """Return what the recordings of a split state of the region ``target`` or ``inside``, for each member that has it.

    Raises BadInput if the dataset or a stream cannot be read, or if the split states no peaks.
    """
    members = []
    met = set()
    for entry in read_manifest(dataset).sequences:
        member = entry.scene, entry.variant, entry.scene_motion
        if entry.split != split or member in met:
            continue
        met.add(member)
        with open_stream(dataset / entry.file) as stream:
            truth, optima = stream.truth, optima_of_stream(stream.metadata.provenance, region)
            if truth is None or (dof := judged_dof(truth.depth_of_focus)) is None:
                continue
            curve = truth.sharpness if region == "target" else truth.sharpness_inside
            if truth.track is None and (peak := curve_peak(curve, dof=dof)) is not None:
                optima = {**optima, "sd": peak - truth.position}
            stratum = stratum_in(stream, region) or "–"
        if optima:
            members.append(Member(stratum, {name: apart / dof for name, apart in optima.items()}))
    if not members:
        raise BadInput(f"no recording of the split {split!r} states where curves peak", where=str(dataset))
    return members


def find_ceilings(members: Sequence[Member]) -> list[Ceiling]:
    """Return the ceiling of each measure, the best first."""
    errors: dict[str, list[float]] = {}
    for member in members:
        for measure, apart in member.peaks_dof.items():
            errors.setdefault(measure, []).append(apart)
    found = [Ceiling(measure, np.array(values)) for measure, values in errors.items()]
    return sorted(found, key=lambda one: (-one.within(1.0), -one.within(0.5), float(np.median(np.abs(one.errors_dof)))))


def table(ceilings: Sequence[Ceiling]) -> str:
    """Return a Markdown table of ceilings."""
    lines = ["| measure | members | within ½ DoF | within 1 DoF | median, DoF | largest, DoF |", "|---" * 6 + "|"]
    for one in ceilings:
        size = np.abs(one.errors_dof)
        rates = " | ".join(f"{one.within(limit):.1%}" for limit in LIMITS_DOF)
        lines.append(f"| `{one.measure}` | {size.size} | {rates} | {np.median(size):.3f} | {size.max():.2f} |")
    return "\n".join(lines)


def strata_table(members: Sequence[Member]) -> str:
    """Return a Markdown table of the strata: on how many members the peaks of all measures lie near the truth."""
    lines = ["| stratum | members | all within ½ DoF | all within 1 DoF |", "|---" * 4 + "|"]
    for name in sorted({member.stratum for member in members}):
        farthest = np.array([max(map(abs, one.peaks_dof.values())) for one in members if one.stratum == name])
        counts = " | ".join(str(np.count_nonzero(farthest <= limit)) for limit in LIMITS_DOF)
        lines.append(f"| {name} | {farthest.size} | {counts} |")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--split", default="test")
    parser.add_argument("--region", choices=("target", "inside"), default="target")
    given = parser.parse_args(argv)
    try:
        members = find_peaks(given.dataset, split=given.split, region=given.region)
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    print(table(find_ceilings(members)), strata_table(members), sep="\n\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
