"""An interval of the leaderboard contains the value that it is of, or is missing, whatever the records hold.

Designs are drawn at random from named seeds; each test states how many. They include those that once gave an interval
upside down, or beside its value: half of the values of every scene below the median, scenes that are all right, scenes
of very different sizes, and methods of which the success is unknown on different sequences.
"""

import numpy as np
import pytest
from handmade_evaluations import board_of
from handmade_records import failed, record

from saf_gen.benchmark.records import MAX_POSITION_OR_ERROR, read_records, write_records
from saf_gen.core.seeds import make_generator
from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.intervals import COARSE, MIN_SCENES, median_interval, rate_intervals
from saf_gen.leaderboard.ranking import MethodComparison
from saf_gen.leaderboard.tables import ranking

LAST_BIT = 1e-9
VALUES = {
    "any": lambda random, scenes: random.random(len(scenes)),
    "ties": lambda random, scenes: random.integers(0, 4, len(scenes)) / 2,
    "all equal": lambda random, scenes: np.full(len(scenes), 0.5),
    "infinities": lambda random, scenes: np.where(random.random(len(scenes)) < 0.3, np.inf, random.random(len(scenes))),
    "halves below": lambda random, scenes: random.random(len(scenes)) + 2 * (np.arange(len(scenes)) % 2),
}


def contains(low, value, high, *, tolerance=LAST_BIT):
    return low - tolerance <= value <= high + tolerance


def draw_scenes(random, *, scenes, sequences):
    sizes = random.integers(1, sequences + 1, random.integers(1, scenes + 1))
    sizes = sizes if random.random() < 0.5 else 2 * ((sizes + 1) // 2)  # even numbers can be halved
    return np.repeat(np.arange(len(sizes)), sizes)


@pytest.mark.parametrize("kind", VALUES)
@pytest.mark.parametrize(("scenes", "sequences", "designs"), [(6, 6, 600), (25, 12, 120)])
def test_the_interval_of_a_median_contains_it_or_is_missing(kind, scenes, sequences, designs):
    """3,600 designs; the last bit is not needed, because the ends are values."""
    random = make_generator("test_intervals", kind, scenes)
    known = 0
    for _ in range(designs):
        of_value = draw_scenes(random, scenes=scenes, sequences=sequences)
        values = VALUES[kind](random, of_value)
        found = median_interval(values, of_value)
        known += found is not None
        assert found is None or contains(found[0], np.median(values), found[1], tolerance=0)
    assert known > designs / 20 or scenes == 6


def test_a_median_with_half_of_each_scene_below_is_not_bounded_by_six_scenes():
    """The interval was (4, 3): no spread over scenes was taken for no uncertainty, and its ranks crossed."""
    assert median_interval(np.arange(1.0, 7), np.array([0, 1, 2, 2, 1, 0])) is None
    for scenes in range(MIN_SCENES, 7):
        values = np.arange(2.0 * scenes)
        assert median_interval(values, np.tile(np.arange(scenes), 2)) is None


def test_a_median_with_half_of_each_scene_below_is_bounded_where_scenes_would_not_all_agree_by_luck():
    """Twenty scenes, each with one value below 1 and one above.

    Beyond j values more, j scenes deviate by 1, and t is √(j·19/20). It is below the limit, 2.09, up to j = 4.
    """
    below = np.arange(20) / 100
    values, scenes = np.r_[below, 1 + below], np.tile(np.arange(20), 2)
    assert median_interval(values, scenes) == (0.15, 1.04)
    equal = np.where(values < 1, 0.2, 0.3)
    assert median_interval(equal, scenes) == (0.2, 0.3)


def test_the_interval_of_a_median_with_half_of_each_scene_below_holds_the_truth():
    """200 benchmarks of eight scenes with two values, in which every scene has one value below the sample median."""
    random, scenes, found = make_generator("test_intervals", "halves"), np.tile(np.arange(8), 2), []
    while len(found) < 200:
        values = random.random(16)
        if not np.bincount(scenes, (values <= np.median(values)) - 0.5).any():
            found.append(median_interval(values, scenes))
    assert sum(low <= 0.5 <= high for low, high in found) >= 190


def test_the_interval_of_a_rate_contains_the_mean_over_scenes_of_any_sizes():
    """40 designs of five rates, in up to 20 scenes of 1 to 40 sequences; large ones are harder, or easier."""
    random = make_generator("test_intervals", "rates")
    for _ in range(40):
        counts = random.integers(1, 41, random.integers(1, 21))
        rates = np.clip(random.random((5, 1)) + random.normal(0, 1.5, (5, 1)) * (counts / 40 - 0.5), 0, 1)
        fractions = random.binomial(counts, rates) / counts
        ends = rate_intervals(fractions, counts, cells=COARSE)
        assert all(contains(low, mean, high) for mean, (low, high) in zip(fractions.mean(axis=1), ends, strict=True))


def draw_answer(random, method, sequence, *, kind, **more):
    chance = random.random()
    if chance < 0.15:
        return failed(method, sequence, "failed" if chance < 0.1 else "abstained", **more)
    error = {
        "any": 3 * random.random(),
        "ties": random.integers(0, 4) / 2,
        "all right": 0.5,
        "hard light": (0.3 if more["light"] == "a" else 3) + random.random() / 10,
        "huge": float(random.choice([0.2, 3, MAX_POSITION_OR_ERROR / 100])),
    }[kind]
    return record(method, sequence, float(error), time_to_focus_s=float(random.choice([0.1, 0.2])), **more)


def draw_records(random, kind, *, agree=True):
    """Records of 1 to 5 methods on 1 to 6 scenes with 1 to 6 sequences each.

    The success of a sequence in ten is unknown, for all methods if they ``agree``, otherwise for each by chance.
    """
    scenes = draw_scenes(random, scenes=6, sequences=6)
    lights = np.arange(len(scenes)) % 2 if kind == "hard light" else random.integers(0, 2, len(scenes))
    unknown, made = random.random(len(scenes)) < 0.1, []
    for method in [f"m{m}+s" for m in range(random.integers(1, 6))]:
        unknown = unknown if agree else random.random(len(scenes)) < 0.1
        for i, scene in enumerate(scenes):
            more = {"scene": f"scene{scene}", "light": "ab"[lights[i]]}
            if unknown[i]:
                made.append(record(method, f"q{i}", None, **more))
            elif kind == "all right":
                made.append(record(method, f"q{i}", 0.5, **more))
            else:
                made.append(draw_answer(random, method, f"q{i}", kind=kind, **more))
    return made


def list_intervals(row, columns, *, best):
    """Return the value, both ends and the text of every interval of a row, by the name of the column."""
    behind = None if row.answerable_1dof is None else best - row.answerable_1dof
    of = {
        "rank_best": (row.rank, "rank_worst"),
        "behind_best_low": (behind, "behind_best_high"),
        "answerable_1dof_low": (row.answerable_1dof, "answerable_1dof_high"),
        "median_error_dof_low": (row.median_error_dof, "median_error_dof_high"),
        "time_to_focus_low_s": (row.time_to_focus_s, "time_to_focus_high_s"),
    }
    shown = {c.name: c for c in columns}
    assert {name for name in shown if name.endswith(("_low", "_low_s", "_best")) and "level" not in name} == set(of)
    return {n: (value, getattr(row, n), getattr(row, high), shown[n].text(row)) for n, (value, high) in of.items()}


def check_rows(rows):
    """Check every interval of the rows and return the names of those that are known, row by row."""
    best = max((row.answerable_1dof for row in rows if row.answerable_1dof is not None), default=None)
    known = []
    for row in rows:
        found = list_intervals(row, ranking(rows).columns, best=best)
        known.append({name for name, (_, low, _, _) in found.items() if low is not None})
        for name, (value, low, high, text) in found.items():
            assert (low is None) == (high is None) == (text == "–"), name
            assert low is None or (low <= high and contains(low, value, high)), (name, low, value, high)
    return known


def check_comparison(records):
    found = board_of(records).comparison
    for profile in found.profiles:
        ends = zip(profile.low or (), profile.fractions, profile.high or (), strict=profile.low is not None)
        assert all(contains(*one) for one in ends)
    for pair in found.neighbours:
        if pair.difference_low is not None:
            assert contains(pair.difference_low, pair.difference, pair.difference_high)
            assert contains(pair.improvement_low, pair.improvement, pair.improvement_high)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "agree"),
    [("any", True), ("any", False), ("ties", False), ("all right", True), ("hard light", False), ("huge", True)],
)
def test_every_interval_of_the_leaderboard_contains_its_value_or_is_missing(kind, agree, tmp_path):
    """12 designs each, written and read as records; where methods agree on what is known, few intervals are missing."""
    random = make_generator("test_intervals", "rows", kind, agree)
    for _ in range(12):
        write_records(tmp_path / "records.jsonl", draw_records(random, kind, agree=agree))
        records = read_records(tmp_path)
        rows = rank_methods(records)
        known = check_rows(rows)
        check_comparison(records)
        if agree and len({r.what.scene for r in records if r.success() is not None}) >= MIN_SCENES:
            assert all({"rank_best", "behind_best_low", "answerable_1dof_low"} <= names for names in known)


def test_an_interval_of_other_sequences_than_its_value_is_missing():
    """The first method wins on the sequences known for both, so its rank there is 1, and fails on the others."""
    records = []
    for scene in range(12):
        for i in range(4):
            own = f"{scene}-{i}", {"scene": f"scene{scene:02d}"}
            second = 0.2 if scene < 6 or (scene, i) == (6, 0) else 5.0
            records.append(record("first", own[0], 0.2 if i < 2 else 5.0, **own[1]))
            records.append(record("second", own[0], second if i < 2 else None, **own[1]))
    rows = rank_methods(records)
    check_rows(rows)
    assert [(row.method, row.rank, row.rank_best, row.level_with_best) for row in rows] == [
        ("second", 1, None, None),
        ("first", 2, None, None),
    ]


def test_methods_without_a_common_sequence_have_no_comparison():
    records = [
        record(method, sequence, 0.2 if sequence == own else None, scene=sequence, region=region)
        for method, own, region in (("a@target", "x", "target"), ("b@frame", "y", "frame"))
        for sequence in "xy"
    ]
    assert board_of(records).comparison == MethodComparison()
