from dataclasses import replace

import pytest
from handmade_records import record

from saf_gen.errors import BadInput
from saf_gen.leaderboard import merge_records, rank_methods

ONE = [record("a+s", "x", 0.1), record("a+s", "y", 0.2), record("b+s", "x", 0.3), record("b+s", "y", 3.0)]
LATER = [record("c+s", "x", 0.1), record("c+s", "y", 9.0)]


def test_a_method_that_ran_later_joins_the_others():
    both = merge_records({"monday": ONE, "tuesday": LATER})
    assert [(r.sequence, r.method) for r in both] == [(s, m + "+s") for s in "xy" for m in "abc"]
    assert [(r.rank, r.method) for r in rank_methods(both)] == [(1, "a+s"), (2, "b+s"), (2, "c+s")]


def test_merging_is_as_good_as_running_together():
    assert rank_methods(merge_records({"monday": ONE, "tuesday": LATER})) == rank_methods([*ONE, *LATER])


def test_a_stream_on_its_own_does_not_join_its_dataset():
    """It knows neither scene nor light: it would weigh by sequence what the dataset weighs by scene."""
    alone = [replace(r, scene=r.sequence, light=None, split=None) for r in LATER]
    with pytest.raises(BadInput) as caught:
        merge_records({"runs/dataset": ONE, "runs/streams": alone})
    assert str(caught.value) == (
        "the scene of x differs: camel in runs/dataset, x in runs/streams; allowed: one scene a sequence; "
        "run saf-gen evaluate again, on the dataset, not on its streams one by one"
    )


@pytest.mark.parametrize(
    ("known", "message"),
    [
        (
            {"scene": "fan"},
            "the scene of y differs: camel in runs/a, fan in runs/b; allowed: one scene a seq",
        ),
        ({"light": None}, "the light of y differs: constant in runs/a, no light in runs/b; allowed: one lig"),
        ({"split": None}, "the split of y differs: test in runs/a, no split in runs/b"),
        ({"variant": 0}, "the variant of y differs: no variant in runs/a, 0 in runs/b"),
        ({"scene_motion": "static"}, "the scene motion of y differs: no scene motion in runs/a, static in"),
        ({"lens_motion": "sweep"}, "the lens motion of y differs: no lens motion in runs/a, sweep in runs/b"),
        (
            {"truth_first": 0.5},
            r"the truth of y differs: no truth in runs/a, 0\.5 in runs/b; allowed: one tr",
        ),
        (
            {"focus_place": 0.5},
            r"the place of the focus of y differs: no place of the focus in runs/a, 0\.5 in runs/b; allowed",
        ),
        ({"mean_rate": 0.25}, r"the photon budget of y differs: no photon budget in runs/a, 0\.25 in runs/b"),
        (
            {"focus_off_dof": 3.0},
            r"the way to the focus of y differs: no way to the focus in runs/a, 3\.0 in runs/b; allowed",
        ),
    ],
)
def test_what_is_known_of_a_sequence_must_agree(known, message):
    with pytest.raises(BadInput, match=message):
        merge_records({"runs/a": ONE, "runs/b": [LATER[0], replace(LATER[1], **known)]})


def test_a_method_that_names_its_region_may_look_elsewhere():
    elsewhere = [record(f"{m}@frame", s, 0, region="frame") for m in ("a+s", "b+s") for s in ("x", "y")]
    assert len(merge_records({"target": ONE, "frame": elsewhere})) == 8


def test_what_two_runs_share_is_kept_once_the_first():
    slower = [replace(r, seconds=9.0, machine="another") for r in ONE]
    both = merge_records({"monday": ONE, "tuesday": [*slower, *LATER]})
    assert len(both) == 6
    assert {r.seconds for r in both} == {0.25}


@pytest.mark.parametrize(
    ("records", "message"),
    [
        ([*ONE, ONE[0]], r"two records of a\+s on x; allowed: one a sequence"),
        (ONE[:3], r"b\+s has no record of y; allowed: the same sequences for every method"),
        ([ONE[0], record("b+s", "x", 0, data="other")], r"data of x differs: sha-x in a\+s, other in b\+s"),
        ([ONE[0], record("b+s", "x", 0, region="frame")], r"region of x differs: target in a\+s, frame in b"),
        (
            [ONE[0], record("b+s", "x", 0, track="closed_loop")],
            r"the track differs: recorded in a\+s, closed_",
        ),
        (
            [ONE[0], record("b+s", "x", 0, rig="other")],
            r"the rig differs: r0 in a\+s, other in b\+s; allowed: one version of the evaluator in a table",
        ),
        (
            [ONE[0], record("b+s", "x", 0, terms="stepper")],
            r"terms of x differ: no terms in a\+s, stepper in",
        ),
        ([ONE[0], record("a+s", "y", 0, code="other")], r"code of a\+s differs: code-a\+s in x, other in y"),
    ],
)
def test_records_that_cannot_be_compared_are_refused(records, message):
    with pytest.raises(BadInput, match=message):
        rank_methods(records)


@pytest.mark.parametrize(
    ("later", "message"),
    [
        ([replace(r, data="other") for r in LATER], "data of x differs: sha-x in runs/a, other in runs/b"),
        (
            [replace(r, region="frame") for r in LATER],
            "region of x differs: target in runs/a, frame in runs/b",
        ),
        (
            [replace(r, track="closed_loop") for r in LATER],
            "track differs: recorded in runs/a, closed_loop in",
        ),
        (
            [replace(r, rig="new") for r in LATER],
            r"^the rig differs: r0 in runs/a, new in runs/b; allowed: one version of the evaluator in a table"
            r"; run saf-gen evaluate again$",
        ),
        ([replace(r, rig="new") for r in ONE], "the rig differs: r0 in runs/a, new in runs/b"),
        ([replace(ONE[0], code="new")], r"code of a\+s differs: code-a\+s in runs/a, new in runs/b"),
        (LATER[:1], r"c\+s of runs/b has no record of y"),
        (
            [replace(r, frame=1.0) for r in ONE],
            r"a\+s answers x otherwise in runs/a than in runs/b, with the same",
        ),
    ],
)
def test_runs_that_cannot_be_compared_are_refused_by_name(later, message):
    with pytest.raises(BadInput, match=message) as caught:
        merge_records({"runs/a": ONE, "runs/b": later})
    assert "\n" not in str(caught.value)
