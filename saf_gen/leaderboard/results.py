"""What records say beside the ranking: results by condition, grain, notes for readers, and words for short names.

The bin of a sequence depends only on the sequence, so all methods have the same sequences in a bin. Grain is the noise
that the renderer left. The words for a measure or search are the beginning of the first line of its module, up to its
colon or comma: ``sd`` is spike dispersion.
"""

import sys
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

from saf_gen.benchmark.method_spec import measure_and_search, split_options, split_region
from saf_gen.benchmark.records import NO_INSIDE, STRATA, SUCCESS_LIMITS_DOF, Record
from saf_gen.core.config.frozen_benchmarks import read_frozen_digests
from saf_gen.core.config.registry import is_builtin_name, plugin_class
from saf_gen.core.plain_text import plural
from saf_gen.core.table import percent
from saf_gen.errors import BadInput, some_of
from saf_gen.leaderboard.agreement import MIN_SHARE, MIN_VOTES, Agreement, follows_light
from saf_gen.leaderboard.intervals import MIN_SCENES
from saf_gen.leaderboard.ranking import LeaderboardRow, group_by, mean_over_scenes, median_magnitude, right_within

MAX_SHOWN_BINS = 40
"""Largest number of bins of an axis, such as scenes, in tables for readers."""
MIN_MEMBERS = 30
"""Smallest number of scenes in a stratum whose methods are ranked."""
BLOCK_READOUTS = 100
"""Number of readouts over which the photon budget is counted: the default window of argmax."""


@dataclass(frozen=True)
class Axis:
    """A property that sorts sequences into bins; ``bin_of`` returns the bin of a record, None if unknown."""

    name: str
    title: str
    meaning: str
    bin_of: Callable[[Record], str | None]
    order: tuple[str, ...] = ()
    """Names of the bins in order; if empty, bins are sorted by name."""
    min_scenes: int = 0
    """Smallest number of scenes of a bin whose methods are ranked; the sequences of smaller bins are only counted."""


@dataclass(frozen=True)
class BinSummary:
    """Result of one method in one bin; None means unknown."""

    answerable_1dof: float | None
    median_error_dof: float | None
    false_answers: int
    false_abstentions: int
    failed: int


@dataclass(frozen=True)
class Bin:
    """A bin: its name, its numbers of scenes, sequences and those without an answer, and the result of each method.

    In a bin that has too few scenes to rank methods, ``too_few`` says so, and success and errors are unknown.
    """

    name: str
    scenes: int
    sequences: int
    without: int
    results: Mapping[str, BinSummary]
    too_few: str = ""


@dataclass(frozen=True)
class AxisResults:
    """Results in the bins of an axis."""

    axis: Axis
    bins: tuple[Bin, ...]


def by_axis(records: Sequence[Record], methods: Sequence[str]) -> tuple[AxisResults, ...]:
    """Return the results along each axis for which the bin of at least one sequence is known; methods keep order."""
    found = []
    for axis in AXES:
        bins = (
            _summarise(name, members, methods=methods, min_scenes=axis.min_scenes)
            for name, members in group_by_bin(records, axis).items()
        )
        found.append(AxisResults(axis, tuple(bins)))
    return tuple(one for one in found if one.bins)


def largest_bins(sizes: Mapping[str, int], limit: int = MAX_SHOWN_BINS) -> list[str]:
    """Return the ``limit`` bins with the most sequences, in their original order; ``sizes`` are their numbers."""
    largest = sorted(sizes, key=lambda name: -sizes[name])[:limit]
    return [name for name in sizes if name in largest]


def keep_largest(results: AxisResults) -> AxisResults:
    """Return the results in the largest_bins; the meaning of the axis says if bins are left out."""
    shown = largest_bins({one.name: one.sequences for one in results.bins})
    if len(shown) == len(results.bins):
        return results
    note = f"Shown: the {len(shown)} of {len(results.bins):,} bins with the most sequences; axes.csv has all."
    axis = replace(results.axis, meaning=f"{results.axis.meaning} {note}")
    return AxisResults(axis, tuple(one for one in results.bins if one.name in set(shown)))


def group_by_bin(records: Sequence[Record], axis: Axis) -> dict[str, list[Record]]:
    """Return the records of each bin, in the order of the axis; records whose bin is unknown are left out."""
    members: dict[str, list[Record]] = {}
    for record in records:
        if (name := axis.bin_of(record)) is not None:
            members.setdefault(name, []).append(record)
    return {name: members[name] for name in axis.order or sorted(members) if name in members}


def _summarise(name: str, members: Sequence[Record], *, methods: Sequence[str], min_scenes: int) -> Bin:
    by_method = group_by(members, "who.method")
    results = {method: _average(by_method.get(method, [])) for method in methods}
    without = len({r.what.sequence for r in members if r.answerable is False})
    scenes, too_few = len({r.what.scene for r in members}), ""
    if scenes < min_scenes:
        results = {m: replace(one, answerable_1dof=None, median_error_dof=None) for m, one in results.items()}
        too_few = f"fewer than {min_scenes} scenes: counted, not ranked"
    return Bin(name, scenes, len({r.what.sequence for r in members}), without, results, too_few)


def _average(records: Sequence[Record]) -> BinSummary:
    return BinSummary(
        mean_over_scenes(records, right_within()),
        median_magnitude(r.judgement.error_dof for r in records if r.answerable is not False),
        false_answers=sum(r.answerable is False and r.judgement.status == "answered" for r in records),
        false_abstentions=sum(r.answerable is True and r.judgement.status == "abstained" for r in records),
        failed=sum(r.judgement.status == "failed" for r in records),
    )


def _bin_between(
    edges: Sequence[float], names: Sequence[str], *, value: Callable[[Record], float | None]
) -> Callable[[Record], str | None]:
    """Return a function that names the bin of a record's value; a value on an edge belongs to the bin above."""

    def name_bin(record: Record) -> str | None:
        number = value(record)
        return None if number is None else names[bisect_right(edges, number)]

    return name_bin


def _photon_budget(record: Record) -> float | None:
    return None if record.what.mean_rate is None else BLOCK_READOUTS * record.what.mean_rate


def _focus_position(record: Record) -> str | None:
    position, distance = record.what.focus_place, record.what.focus_off_dof
    if distance is not None and distance > SUCCESS_LIMITS_DOF[1]:
        return _POSITIONS[3]
    if position is None:
        return None
    return _POSITIONS[0] if position < 0.1 else _POSITIONS[2] if position > 0.9 else _POSITIONS[1]


_BUDGETS = ("below 1", "1 to 3", "3 to 10", "10 to 30", "30 and more")
_RATIOS = ("up to 1.1", "1.1 to 2", "2 to 5", "5 and more")
_POSITIONS = ("first 10 %", "middle", "last 10 %", "outside")
_GRAINS = ("below 1 %", "1 to 2 %", "2 to 4 %", "4 % and more")
AXES = (
    Axis("light", "Light schedule", "Name of the light schedule in the recipe.", lambda r: r.what.light),
    Axis(
        "light_ratio",
        "Light ratio",
        "Brightest light of the recording divided by its darkest.",
        _bin_between((1.1, 2, 5), _RATIOS, value=lambda r: r.what.light_ratio),
        _RATIOS,
    ),
    Axis("scene_motion", "Scene motion", "Whether anything in the scene moves.", lambda r: r.what.scene_motion),
    Axis("lens_motion", "Lens motion", "Motion of the lens in the recording.", lambda r: r.what.lens_motion),
    Axis(
        "photon_budget",
        "Photon budget",
        f"Mean counts per pixel in a block of {BLOCK_READOUTS} readouts, in the region where measures look.",
        _bin_between((1, 3, 10, 30), _BUDGETS, value=_photon_budget),
        _BUDGETS,
    ),
    Axis(
        "focus_position",
        "Focus position",
        "Part of the recording (closed loop: of the travel) in which the lens first meets the true focus, or "
        "comes nearest to it; outside: the lens never comes within 1 DoF.",
        _focus_position,
        _POSITIONS,
    ),
    Axis(
        "grain",
        "Grain",
        "Noise of the renderer in the pictures: rms divided by the mean, in the box around the target, at best focus.",
        _bin_between((0.01, 0.02, 0.04), _GRAINS, value=lambda r: r.what.grain_rms),
        _GRAINS,
    ),
    Axis(
        "stratum",
        "Stratum",
        "Geometry of the region of the evaluation. Inside the target: one depth if 95 % of its pixels come into focus "
        "within ½ DoF of the truth, else relief. In the target's box: how much of it the target fills. "
        f"A stratum of fewer than {MIN_MEMBERS} scenes is counted, not ranked.",
        lambda r: r.what.stratum,
        STRATA,
        min_scenes=MIN_MEMBERS,
    ),
    Axis(
        "sensor",
        "Sensor",
        "Name of the sensor, followed by # and six digits if its parameters were changed.",
        lambda r: r.what.sensor,
    ),
    Axis("scene", "Scene", "Name of the scene.", lambda r: r.what.scene),
)
"""The conditions of the leaderboard, in the order of its tables."""


MAX_GRAIN_OF_CURVE = 0.1
"""Fraction of the range of a focus curve above which grain may shift its peak."""
MIN_RANKED = 10
"""Smallest number of photographed objects that could rank methods."""
NAMED_MEASURES = 4
NAMED_SEQUENCES = 3
NAMED_METHODS = 3


def notes_on(records: Sequence[Record]) -> list[str]:
    """Return the notes that a reader needs to interpret the numbers, one or two sentences each."""
    found = _name_benchmark(records)
    found += rule_of(records)
    found += ["Success and cost are averaged over each scene's lights, then over scenes; errors are medians."]
    scenes = len({r.what.scene for r in records if r.answerable})
    if scenes >= MIN_SCENES:
        found.append(
            f"Each 95 % interval over {scenes} scenes holds alone; rank intervals hold for all rivals of a row at once."
        )
    return found


def verdict_on(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> tuple[str, str]:
    """Return who wins or, if other methods cannot be told apart from the first, how little the scenes can say.

    The first of the two texts may be empty.
    """
    leaders = [row for row in rows if row.rank == 1]
    if not leaders and any(record.judgement.error is not None for record in records):
        return (
            "The true focus is known, but not its depth: nothing is right or wrong.",
            "State it to saf-gen import: --depth-of-focus NEAR FAR.",
        )
    if not leaders:
        why = "No sequence has a known truth within reach of its lens, so methods are not ranked"
        return "", f"{why} and the table shows only their cost."
    best, others = leaders[0], len(rows) - len(leaders)
    level = sum(row.level_with_best is not False for row in rows if row.rank != 1)  # None: too few scenes to test
    names = ", ".join(row.method for row in leaders[:NAMED_METHODS])
    names += f" and {len(leaders) - NAMED_METHODS} more" if len(leaders) > NAMED_METHODS else ""
    answerable = plural(best.answerable or 0, "sequence")
    right = f"right on {percent(best.answerable_1dof or 0.0)} of {answerable}, averaged over scenes"
    scenes = len({record.what.scene for record in records if record.answerable})
    if len({record.what.sequence for record in records}) == 1:
        near = [row.method for row in leaders if best.answerable_1dof]
        named = f"{some_of(near)}." if near else ""
        return f"Right within 1 DoF: {len(near)} of {plural(len(rows), 'method')}.", named
    if len(rows) == 1:
        return "", f"{names}: {right}."
    if level == others and (others or len(leaders) > 1):
        some = plural(scenes, "scene") + (f" (intervals need {MIN_SCENES})" if scenes < MIN_SCENES else "")
        return (
            f"Undecided: {some} cannot tell these {plural(len(rows), 'method')} apart.",
            f"{names} {'is' if len(leaders) == 1 else 'are'} {right}; no other method is right more often.",
        )
    if level or len(leaders) > 1:
        rest = "every other method can be told apart"
        if level:
            them = "it" if len(leaders) == 1 else "them"
            rest = f"{level} of {plural(others, 'other method')} cannot be told apart from {them}"
        return f"{names} {'leads' if len(leaders) == 1 else 'lead together'}:", f"{right}; {rest}."
    return f"{names} wins:", f"{right}, and every other method can be told apart from it."


def warnings_on(rows: Sequence[LeaderboardRow], records: Sequence[Record]) -> list[str]:
    """Return what is wrong with methods, recordings or machines, one or two sentences each."""
    found = []
    scenes = {r.what.scene for r in records if r.answerable}
    unranked = {r.what.scene for r in records if r.judgement.error is not None}
    if not scenes and unranked:
        few = "; and no rank comes from fewer than ten objects" if len(unranked) < MIN_RANKED else ""
        found.append(
            f"No ranks: no depth of focus is known of {plural(len(unranked), 'object')}, so that errors are fractions "
            f"of the travel{few}."
        )
    if failing := [f"{row.method} ({row.failed_check})" for row in rows if row.failed_check]:
        found.append(f"! marks what fails methods check, which says why: {', '.join(failing)}.")
    found += _name_obstacles(records)
    found += _name_least_blur(records)
    found += grain_warning(records)
    machines = sorted({r.who.machine for r in records if r.who.machine})
    if len(machines) > 1:
        found.append(f"Seconds cannot be compared: they come from {len(machines)} machines: {'; '.join(machines)}.")
    return found


def lead_without_truth(agreements: Sequence[Agreement]) -> list[str]:
    """Return what the measures agree on: a sentence on a single recording, the numbers of several."""
    if not agreements:
        return [
            f"No answer of all: that takes {MIN_VOTES} measures of saf_gen that do not follow the light. "
            "Add -m baselines."
        ]
    if len(agreements) == 1:
        return [agreements[0].describe()]
    agreed = sum(one.agrees for one in agreements)
    return [f"At least {percent(MIN_SHARE)} of the measures agree on {agreed} of {len(agreements)} recordings."]


def notes_without_truth(records: Sequence[Record], agreements: Sequence[Agreement]) -> list[str]:
    """Return the notes that a reader of answers that nobody judged needs."""
    followers = sorted({measure for measure in map(_measure, records) if follows_light(measure)})
    found = [f"Not asked, because their scores grow with the light: {some_of(followers)}."] if followers else []
    if any(agreement.places for agreement in agreements):
        found.append("To see the answer: saf-gen view RECORDING --at answer --out answer.png.")
    return [
        *found,
        *_name_obstacles(records),
        "To judge methods, state the true focus to saf-gen import: --truth POSITION, or --truth frame:NUMBER.",
    ]


def rule_of(records: Iterable[Record]) -> list[str]:
    """Return a sentence, in a list, that says by what methods are ranked, and on how many sequences; [] if on none."""
    known = {r.what.sequence: r.answerable for r in records}
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
    named = {r.what.benchmark for r in records}
    label = named.pop() if len(named) == 1 else None
    if label is None:
        return []
    frozen = read_frozen_digests().get(label.partition(" ")[0])
    frozen_sequences = frozen.sequences if frozen is not None else {}
    judged: dict[str, set[str]] = {}
    for record in records:
        judged.setdefault(record.what.split or "", set()).add(record.what.sequence)
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
    """Return sentences that count and name the sequences that cannot be focused, and those without a region inside."""
    records = list(records)
    obstacles = {r.what.sequence: r.what.obstacle for r in records if r.what.obstacle != NO_INSIDE}
    named = []
    for obstacle, what in OBSTACLES.items():
        if found := sorted(sequence for sequence, its in obstacles.items() if its == obstacle):
            named.append(f"{len(found)} with {what} ({_name_some(found)})")
    total = sum(obstacle is not None for obstacle in obstacles.values())
    count = plural(len({r.what.sequence for r in records}), "sequence")
    notes = [f"{total} of {count} cannot be focused: {'; '.join(named)}."] if named else []
    if without := sorted({r.what.sequence for r in records if r.what.obstacle == NO_INSIDE}):
        notes.append(
            f"{len(without)} of {count} have no rectangle inside the target, and count for no method that looks there: "
            f"{_name_some(without)}."
        )
    return notes


def _name_some(sequences: Sequence[str]) -> str:
    more = f" and {len(sequences) - NAMED_SEQUENCES} more" if len(sequences) > NAMED_SEQUENCES else ""
    return ", ".join(sequences[:NAMED_SEQUENCES]) + more


def _name_least_blur(records: Iterable[Record]) -> list[str]:
    """Return a sentence, in a list, that counts the sequences whose least blur is far from the truth; [] if none is."""
    blurs = {r.what.sequence: r.success_least_blur is not None for r in records}
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
    for (scene, motion), group in group_by(records, "what.scene", "what.scene_motion").items():
        rms = {r.what.sequence: r.what.grain_rms for r in group if r.what.grain_rms is not None}
        of_curve: dict[str, float] = {}
        for record in group:
            if record.judgement.grain_of_curve is not None:
                measure = _measure(record)
                of_curve[measure] = max(of_curve.get(measure, 0.0), record.judgement.grain_of_curve)
        counts = len({r.what.sequence for r in group}), len(rms)
        figures = (median(rms.values()), max(rms.values())) if rms else None
        found.append(SceneGrain(scene, motion, counts, figures, of_curve))
    return found if any(one.rms for one in found) else []


def grain_warning(records: Iterable[Record]) -> list[str]:
    """Return a warning if grain exceeds MAX_GRAIN_OF_CURVE on the focus curves of some measures, else []."""
    known = sorted(
        (
            (r.judgement.grain_of_curve, _measure(r), r.what.sequence)
            for r in records
            if r.judgement.grain_of_curve is not None
        ),
        reverse=True,
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
    return measure_and_search(record.who.method)[0]


KINDS = ("measures", "searches")
FORMS = {"_tfi": "on intervals between spikes", "_n": "divided by brightness"}
"""What the endings of measures mean, the last ending first."""
PEOPLE = ("Brenner", "Fibonacci", "Vollath")
"""Names that keep their capital letter within a sentence."""


def spell_out_names(methods: Iterable[str]) -> dict[str, str]:
    """Return the words for each short name in these names of methods: first the measures, then the searches.

    Options and regions of methods are ignored. Measures and searches that are not part of saf_gen are left out, and so
    are those whose name already consists of the same words, such as ``squared_gradient``.
    """
    halves = [measure_and_search(_without_region(method)) for method in methods]
    words: dict[str, str] = {}
    for number, kind in enumerate(KINDS):
        for name in dict.fromkeys(split_options(pair[number])[0] for pair in halves):
            spelled = _spell_out(name, kind)
            if spelled and spelled.casefold() != name.replace("_", " "):
                words.setdefault(name, spelled)
    return words


def list_names(words: Mapping[str, str]) -> str:
    """Return what the short names of spell_out_names stand for as one line of text."""
    return f"Names: {'; '.join(f'{name}: {spelled}' for name, spelled in words.items())}."


def _without_region(method: str) -> str:
    try:
        return split_region(method)[0]
    except BadInput:  # the name of somebody's predictions
        return method


def _spell_out(name: str, kind: str) -> str:
    """Return the words for one name; '' if it is not part of saf_gen."""
    forms: list[str] = []
    bare = name
    while not is_builtin_name(kind, bare):
        form = next((ending for ending in FORMS if kind == "measures" and bare.endswith(ending)), None)
        if form is None:
            return ""
        forms.insert(0, FORMS[form])
        bare = bare.removesuffix(form)
    module = sys.modules[plugin_class(kind, bare).__module__]
    first = (module.__doc__ or "").split("\n")[0]
    title, colon, _ = first.partition(": ")
    title = title if colon else first.partition(",")[0].rstrip(".")
    if not title.startswith(PEOPLE):
        title = title[:1].lower() + title[1:]
    return ", ".join([title, *forms])


def describe_records(records: Sequence[Record]) -> dict[str, Any]:
    """Return the keys of leaderboard.json that state of which data and code the records are."""
    return {
        "benchmark": sorted({r.what.benchmark or "" for r in records}),
        "track": sorted({r.what.track for r in records}),
        "rig": sorted({r.what.rig for r in records}),
        "data": {r.what.sequence: r.what.data for r in records},
        "code": {r.who.method: r.who.code for r in records},
        "tuning": {r.who.method: r.who.tuning for r in records if r.who.tuning},
        "parameters": {r.who.method: r.who.parameters for r in records},
    }
