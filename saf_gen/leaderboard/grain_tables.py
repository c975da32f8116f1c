"""Grain, the noise that the renderer left in the pictures, by scene, and a warning if it may decide an answer."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from saf_gen.benchmark.records import Record

MAX_GRAIN_OF_CURVE = 0.1
"""Fraction of the range of a focus curve above which grain may shift its peak."""
NAMED_MEASURES = 4


@dataclass(frozen=True)
class SceneGrain:
    """The grain in the static or in the dynamic sequences of a scene.

    Attributes
    ----------
    scene : str
        Name of the scene.
    scene_motion : str or None
        Motion of the scene as the records state it; None if unknown.
    sequences : tuple of (int, int)
        Number of sequences, and number of those that state their grain.
    rms : tuple of (float, float) or None
        Median and largest rms of the grain at best focus, divided by the mean; None if no sequence states it.
    of_curve : dict of str to float
        Largest energy of the grain divided by the range of the focus curve, by measure.
    """

    scene: str
    scene_motion: str | None
    sequences: tuple[int, int]
    rms: tuple[float, float] | None
    of_curve: dict[str, float]


def tabulate_leaderboard_grain(records: Iterable[Record]) -> list[SceneGrain]:
    """Return the grain of each scene and scene motion, in order of appearance; [] if no grain is known."""
    groups: dict[tuple[str, str | None], list[Record]] = {}
    for record in records:
        groups.setdefault((record.scene, record.scene_motion), []).append(record)
    tables = []
    for (scene, motion), group in groups.items():
        rms = {r.sequence: r.grain_rms for r in group if r.grain_rms is not None}
        of_curve: dict[str, float] = {}
        for record in group:
            if record.grain_of_curve is not None:
                measure = _measure(record)
                of_curve[measure] = max(of_curve.get(measure, 0.0), record.grain_of_curve)
        counts = len({r.sequence for r in group}), len(rms)
        figures = (median(rms.values()), max(rms.values())) if rms else None
        tables.append(SceneGrain(scene, motion, counts, figures, of_curve))
    return tables if any(table.rms for table in tables) else []


def compose_leaderboard_grain_notes(records: Sequence[Record]) -> list[str]:
    """Return a warning if grain exceeds MAX_GRAIN_OF_CURVE on the focus curves of some measures, else []."""
    known = sorted(
        ((r.grain_of_curve, _measure(r), r.sequence) for r in records if r.grain_of_curve is not None), reverse=True
    )
    grainy = [one for one in known if one[0] > MAX_GRAIN_OF_CURVE]
    if not grainy:
        return []
    measures = list(dict.fromkeys(measure for _, measure, _ in grainy))
    named = ", ".join(measures[:NAMED_MEASURES])
    if len(measures) > NAMED_MEASURES:
        named += f" and {len(measures) - NAMED_MEASURES} more"
    of_curve, measure, sequence = grainy[0]
    found, all_known = (len({name for _, _, name in some}) for some in (grainy, known))
    return [
        f"Warning: noise of the renderer exceeds {MAX_GRAIN_OF_CURVE:.0%} of the range of a focus curve on "
        f"{found} of {all_known} sequences ({named}; at worst {of_curve:.2g} times the range, {measure} on "
        f"{sequence}): with more samples per pixel these answers may differ."
    ]


def _measure(record: Record) -> str:
    return record.method.split("+")[0]
