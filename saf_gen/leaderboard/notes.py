"""Notes on how to interpret a leaderboard, and the grain of its scenes, the noise that the renderer left."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from saf_gen.benchmark.method_spec import measure_and_search
from saf_gen.benchmark.records import Record
from saf_gen.core.config.frozen_benchmarks import read_frozen_digests
from saf_gen.core.plain_text import plural
from saf_gen.leaderboard.intervals import MIN_SCENES
from saf_gen.leaderboard.outcomes import group_by
from saf_gen.leaderboard.ranking import LeaderboardRow

MAX_GRAIN_OF_CURVE = 0.1
"""Fraction of the range of a focus curve above which grain may shift its peak."""
MIN_RANKED = 10
"""Smallest number of photographed objects that could rank methods."""
NAMED_MEASURES = 4
NAMED_SEQUENCES = 3


def notes_on(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> list[str]:
    """Return the notes that a reader needs to interpret the numbers, one or two sentences each."""
    found = _name_benchmark(records)
    found += _say_rule(records)
    found += ["Success and cost are averaged over each scene's lights, then over scenes; errors are medians."]
    reason = next((row.missing_reason for row in rows if row.missing_reason), "")
    scenes = len({r.scene for r in records if r.answerable})
    if reason:
        found.append(f"There are no intervals: only {reason} have a known truth.")
    elif scenes:
        found.append(
            f"Each 95 % interval over {scenes} scenes holds alone; rank intervals hold for all rivals of a row at once"
            + ("; with so few scenes, almost no methods can be told apart." if scenes < 2 * MIN_SCENES else ".")
        )
    unranked = {r.scene for r in records if r.error is not None}
    if not scenes and unranked:
        few = "; and no rank comes from fewer than ten objects" if len(unranked) < MIN_RANKED else ""
        found.append(
            f"No ranks: no depth of focus is known of {plural(len(unranked), 'object')}, so that errors are fractions "
            f"of the travel{few}."
        )
    found += [
        f"{row.method} fails methods check: {row.failed_check} (saf-gen methods check says why)."
        for row in rows
        if row.failed_check
    ]
    found += _name_obstacles(records)
    found += _name_least_blur(records)
    found += grain_warning(records)
    machines = sorted({r.machine for r in records if r.machine})
    if len(machines) > 1:
        found.append(f"Seconds cannot be compared: they come from {len(machines)} machines: {'; '.join(machines)}.")
    return found


def _say_rule(records: Iterable[Record]) -> list[str]:
    """Return a sentence, in a list, that says by what methods are ranked, and on how many sequences; [] if on none."""
    known = {r.sequence: r.answerable for r in records}
    if not any(known.values()):
        return []
    without = sum(answerable is False for answerable in known.values())
    others = f"; on the {without} without, answers are false" if without else ""
    return [
        f"Ranked by answerable success: answers within 1 DoF (blur of 2 px) on the {sum(map(bool, known.values()))} of "
        f"{plural(len(known), 'sequence')} with an answer{others}."
    ]


def _name_benchmark(records: Sequence[Record]) -> list[str]:
    """Return a sentence, in a list, that names the benchmark and the number of its sequences that the records cover.

    The list is empty if the records do not all belong to the same frozen benchmark.
    """
    named = {r.benchmark for r in records}
    label = named.pop() if len(named) == 1 else None
    if label is None:
        return []
    frozen = read_frozen_digests().get(label.partition(" ")[0])
    frozen_sequences = frozen.sequences if frozen is not None else {}
    judged: dict[str, set[str]] = {}
    for record in records:
        judged.setdefault(record.split or "", set()).add(record.sequence)
    covered = [
        f"{len(names)}{f' of {frozen_sequences[split]}' if split in frozen_sequences else ''} sequences of "
        f"{split or 'no split'}"
        for split, names in sorted(judged.items())
    ]
    return [f"The benchmark is {label}: {', '.join(covered)}."]


OBSTACLES = {
    "no spikes": "no spikes, counted for no method",
    "all spikes": "a spike in every readout, counted for no method",
    "lens at rest": "a lens at rest, so that every frame is the same answer",
    "focus not reached": "a lens that never reaches the focus, so that no answer is right",
}


def _name_obstacles(records: Iterable[Record]) -> list[str]:
    """Return a sentence, in a list, that counts and names the sequences that cannot be focused; [] if all can."""
    obstacles = {r.sequence: r.obstacle for r in records}
    named = []
    for obstacle, what in OBSTACLES.items():
        if found := sorted(sequence for sequence, its in obstacles.items() if its == obstacle):
            more = f" and {len(found) - NAMED_SEQUENCES} more" if len(found) > NAMED_SEQUENCES else ""
            named.append(f"{len(found)} with {what} ({', '.join(found[:NAMED_SEQUENCES])}{more})")
    total = sum(obstacle is not None for obstacle in obstacles.values())
    return [f"{total} of {plural(len(obstacles), 'sequence')} cannot be focused: {'; '.join(named)}."] if named else []


def _name_least_blur(records: Iterable[Record]) -> list[str]:
    """Return a sentence, in a list, that counts the sequences whose least blur is far from the truth; [] if none is."""
    blurs = {r.sequence: r.success_least_blur is not None for r in records}
    if not any(blurs.values()):
        return []
    return [
        f"On {sum(blurs.values())} of {plural(len(blurs), 'sequence')} the lens has aberrations, and its least blur "
        "is far from its largest contrast, by which methods are ranked: see ≤1 DoF of least blur."
    ]


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


def grain_by_scene(records: Iterable[Record]) -> list[SceneGrain]:
    """Return the grain of each scene and scene motion, in order of appearance; [] if no grain is known."""
    found = []
    for (scene, motion), group in group_by(records, "scene", "scene_motion").items():
        rms = {r.sequence: r.grain_rms for r in group if r.grain_rms is not None}
        of_curve: dict[str, float] = {}
        for record in group:
            if record.grain_of_curve is not None:
                measure = _measure(record)
                of_curve[measure] = max(of_curve.get(measure, 0.0), record.grain_of_curve)
        counts = len({r.sequence for r in group}), len(rms)
        figures = (median(rms.values()), max(rms.values())) if rms else None
        found.append(SceneGrain(scene, motion, counts, figures, of_curve))
    return found if any(one.rms for one in found) else []


def grain_warning(records: Iterable[Record]) -> list[str]:
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
        f"{found} of {plural(all_known, 'sequence')} ({named}; at worst {of_curve:.2g} times the range, {measure} on "
        f"{sequence}): with more samples per pixel these answers may differ."
    ]


def _measure(record: Record) -> str:
    return measure_and_search(record.method)[0]
