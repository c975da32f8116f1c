"""The claims of the paper, each with our figure, its interval over scenes, a verdict, and the evidence for it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from saf_gen.addons.paper.conditions import EGS, LIGHTS, MEASURES, MOTIONS, SGFS, PaperRun, positions, stop_frame
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import SweepSummary
from saf_gen.core.table import Column, Table, percent
from saf_gen.leaderboard.intervals import mean_interval, rate_intervals
from saf_gen.leaderboard.ranking import mean_by_scene, median_magnitude, right_within

WORKS, BREAKS = 0.9, 0.5
"""A measure works if at least so many of its answers are within one depth of focus, and fails if at most so many are.
"""
HOLDS, PART, FAILS, UNKNOWN = "holds", "in part", "fails", "unknown"
RULE = (
    f"A measure works if {WORKS:.0%} of its answers or more are within one depth of focus of the truth, and fails if at"
    f" most {BREAKS:.0%} are. A claim about several measures holds if it holds for all of them, and fails if it holds"
    " for none. Claims are judged on all scenes, also those that the paper makes about USAF data. Intervals of 95% are"
    " over scenes; a mean over fewer than three scenes has none. Measures see the box about the target; the paper's see"
    " all pixels. The levels of the light are the recipe's, because the paper states none."
)
ALL = dict.fromkeys(MEASURES, True)
OTHERS = dict.fromkeys(("gradient_code", "mfdct_code", "er_sumsq"), False)
RateClaim = tuple[str, str, Sequence[str], Sequence[str], Mapping[str, bool]]
"""Claim, section, motions, lights, and whether each measure works or fails by the claim."""
RATES: tuple[RateClaim, ...] = (
    ("in static scenes under constant light, all measures work", "5.2", ("static",), ("constant",), ALL),
    ("in dynamic scenes under constant light, MF-DCT and ER fail", "5.2", ("dynamic",), ("constant",),
     {"mfdct_code": False, "er_sumsq": False}),
    ("under constant light, all measures work (USAF)", "5.3", MOTIONS, ("constant",), ALL),
    ("under continuous variations, SD stays functional", "5.2, 5.3", MOTIONS, ("continuous",), {"sd_code": True}),
    ("under continuous variations, all other measures follow the light", "5.2", MOTIONS, ("continuous",), OTHERS),
    ("under continuous variations, the gradient still works (USAF)", "5.3", MOTIONS, ("continuous",),
     {"gradient_code": True}),
    ("under sudden changes, only SD works", "5.2, 5.3", MOTIONS, ("sudden",), {"sd_code": True, **OTHERS}),
    ("SD with SGFS is accurate", "5.4", MOTIONS, LIGHTS, {SGFS: True}),
)  # fmt: skip


@dataclass(frozen=True)
class Claim:
    """A claim of the paper and what we find: our figure with its interval, the verdict, and why."""

    text: str
    section: str
    found: str
    verdict: str
    why: str


COLUMNS = (
    Column("claim of the paper", "text", folds=True),
    Column("section", "section", detail=1),
    Column("here", "found", folds=True),
    Column("verdict", "verdict"),
    Column("why", "why", folds=True, detail=2),
)


def judge_claims(run: PaperRun) -> Table:
    """Return the table of claims."""
    return Table(COLUMNS, [*(_judge_rates(run, claim) for claim in RATES), *_judge_search(run), _judge_windows(run)])


def _judge_rates(run: PaperRun, claim: RateClaim) -> Claim:
    text, section, motions, lights, expected = claim
    found, whys, marks = [], [], []
    for name, works in expected.items():
        method, label = (name, "SD with SGFS") if name == SGFS else (f"{name}+argmax", MEASURES[name])
        records = [
            r
            for r in run.records
            if r.who.method == method and r.what.scene_motion in motions and r.what.light in lights
        ]
        rate, rate_text = _rate(records)
        if not np.isfinite(rate):
            return Claim(text, section, "–", UNKNOWN, "the recordings state no depth of focus")
        found.append(f"{label} {rate_text}")
        marks.append(_mark(rate, (WORKS, BREAKS)) if works else _mark(-rate, (-BREAKS, -WORKS)))
        error = median_magnitude(r.judgement.error_dof for r in records)
        why = f"{label}: median error {error:.2g} depths of focus" if error is not None else f"{label}: no answer"
        if "constant" not in lights:
            follows = [_follow_light(run, r.what.sequence, measure=name) for r in records]
            why += f", correlation of curve and light {np.mean(follows):+.2f}"
        whys.append(why)
    verdict = HOLDS if min(marks) == 2 else FAILS if max(marks) == 0 else PART
    return Claim(text, section, "; ".join(found), verdict, "; ".join(whys))


def _rate(records: Sequence[Record]) -> tuple[float, str]:
    """Return the rate of answers within one depth of focus, and its text with the interval; NaN if it is unknown."""
    rates = mean_by_scene(records, right_within())
    if not rates:
        return float("nan"), "unknown"
    counts = np.array([sum(r.what.scene == scene for r in records) for scene in rates])
    low, high = rate_intervals(np.array([list(rates.values())]), counts)[0]
    rate = float(np.mean(list(rates.values())))
    return rate, f"{percent(rate)} ({percent(low)} to {percent(high)})"


def _mark(value: float, limits: tuple[float, float]) -> int:
    """Return 2 if a value reaches the first limit, 1 if it exceeds only the second, otherwise 0."""
    return 2 if value >= limits[0] else int(value > limits[1])


def _follow_light(run: PaperRun, sequence: str, *, measure: str) -> float:
    sweep = next(s for s in run.sweeps if s.sequence == sequence)
    curve = next(c for c in sweep.curves if c.measure == measure)
    light = np.interp(curve.frames, sweep.frames, sweep.rate)
    return float(np.corrcoef(curve.scores, light)[0, 1]) if np.ptp(curve.scores) and np.ptp(light) else 0.0


def _judge_search(run: PaperRun) -> list[Claim]:
    """Return the claims about where SGFS stops and how fast it is beside EGS."""
    numbers = {}
    for sweep in run.sweeps:
        pair = [run.record(sweep.sequence, method) for method in (EGS, SGFS)]
        stop = float(positions(sweep, [stop_frame(pair[1]) - 1])[0])
        ends = zip(pair, (1.0, stop), strict=True)
        travel = [end + abs(end - (end if (at := r.judgement.position) is None else at)) for r, end in ends]
        steps = [_count_steps(sweep, record) for record in pair]
        ratios = travel[0] / travel[1], steps[0] / steps[1]
        numbers[sweep.sequence] = (stop - (pair[1].judgement.truth or 0.0), 1 - stop, *ratios)
    records = [record for record in run.records if record.who.method == SGFS]
    (beyond, beyond_text), (unseen, unseen_text), (faster, faster_text), (_, steps_text) = (
        _average(records, {name: row[n] for name, row in numbers.items()}) for n in range(4)
    )
    verdicts = (FAILS, PART, HOLDS)
    return [
        Claim(
            "the sweep stops close to the focus", "5.4", f"{beyond_text} of the travel beyond the focus",
            verdicts[_mark(-abs(beyond), (-0.15, -0.3))],
            "holds up to 0.15 of the travel; the later half of the frames must come to hold more of the peak",
        ),
        Claim(
            "not all positions need to be traversed", "5.4", f"{unseen_text} of the travel never seen",
            verdicts[_mark(unseen, (0.1, 0.02))],
            "holds from 0.1; the released program finds the stop only after the complete sweep (sgfs_causal does not)",
        ),
        Claim(
            "SGFS is typically more than twice as fast as EGS", "5.4",
            f"lens travel {faster_text} times shorter; steps {steps_text} times fewer",
            verdicts[_mark(faster, (2.0, 1.2))],
            "twice is travel of the lens, there and back, with the focus half-way; a later focus saves less. Steps: "
            "until the middle stays within one depth of focus of the answer",
        ),
    ]  # fmt: skip


def _count_steps(sweep: SweepSummary, record: Record) -> int:
    """Return the number of steps after which the positions of a search stay within one depth of focus of its end."""
    lens = positions(sweep, np.array(record.judgement.trace) - 1)
    off = np.abs(lens - lens[-1:]) > (record.judgement.depth_of_focus or 0.0)
    return int(np.flatnonzero(off)[-1]) + 2 if off.any() else 1


def _average(records: Sequence[Record], numbers: Mapping[str, float]) -> tuple[float, str]:
    """Return the mean over scenes of the numbers of sequences, and its text with the interval, if there is one."""
    means = list(mean_by_scene(records, lambda record: numbers[record.what.sequence]).values())
    ends, mean = mean_interval(means), float(np.mean(means))
    return mean, f"{mean:.2f}" + (f" ({ends[0]:.2f} to {ends[1]:.2f})" if ends else "")


def success_by_window(run: PaperRun) -> dict[str, tuple[float, str]]:
    """Return the rate of right answers, 0 to 1, and its text, of the naive methods, EGS and SGFS, by name."""
    return {m: _rate([r for r in run.records if r.who.method == m]) for m in (*run.naive.values(), EGS, SGFS)}


def _judge_windows(run: PaperRun) -> Claim:
    rates = success_by_window(run)
    naive = {dt: rates[method][0] for dt, method in run.naive.items()}
    worst, best = min(naive, key=naive.__getitem__), max(naive, key=naive.__getitem__)
    marks = [naive[worst] <= rates[EGS][0] - 0.1, rates[EGS][0] >= naive[best] - 0.1]
    found = {f"Δt = {dt}": run.naive[dt] for dt in (best, worst)} | {"EGS": EGS, "SGFS": SGFS}
    return Claim(
        "naive SAF needs a chosen Δt, EGS and SGFS do not",
        "4.3",
        "; ".join(f"{name} {rates[method][1]}" for name, method in found.items()),
        HOLDS if all(marks) else PART if any(marks) else FAILS,
        "holds if EGS is at most 10 points below the best Δt, and the worst Δt at least 10 points below EGS",
    )
