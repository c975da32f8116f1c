import pytest
from handmade_records import change, record
from refusals import refusal

from saf_gen.leaderboard import rank_methods
from saf_gen.leaderboard.merging import merge_records
from saf_gen.leaderboard.results import by_axis

ONE = [record("a+s", "x", 0.1), record("a+s", "y", 0.2), record("b+s", "x", 0.3), record("b+s", "y", 3.0)]
LATER = [record("c+s", "x", 0.1), record("c+s", "y", 9.0)]


def test_a_method_that_ran_later_joins_the_others():
    both = merge_records({"monday": ONE, "tuesday": LATER})
    assert [(r.what.sequence, r.who.method) for r in both] == [(s, m + "+s") for s in "xy" for m in "abc"]
    assert [(r.rank, r.method) for r in rank_methods(both)] == [(1, "a+s"), (2, "b+s"), (2, "c+s")]


def test_merging_is_as_good_as_running_together():
    assert rank_methods(merge_records({"monday": ONE, "tuesday": LATER})) == rank_methods([*ONE, *LATER])


def test_a_stream_on_its_own_does_not_join_its_dataset():
    """It knows neither scene nor light: it would be weighted by sequence, and the dataset by scene."""
    alone = [change(r, scene=r.what.sequence, light=None, split=None) for r in LATER]
    error = refusal(merge_records, {"runs/dataset": ONE, "runs/streams": alone})
    assert error.problem == "the scene of x differs: camel in runs/dataset, x in runs/streams"
    assert error.hint.startswith("run saf-gen evaluate again, on the dataset")


@pytest.mark.parametrize(
    ("key", "value", "name", "sides"),
    [
        ("scene", "fan", "scene", "camel in runs/a, fan in runs/b"),
        ("light", None, "light", "constant in runs/a, no light in runs/b"),
        ("split", None, "split", "test in runs/a, no split in runs/b"),
        ("scene_motion", "static", "scene motion", "no scene motion in runs/a, static in runs/b"),
        ("lens_motion", "sweep", "lens motion", "no lens motion in runs/a, sweep in runs/b"),
        ("focus_place", 0.5, "focus position", "no focus position in runs/a, 0.5 in runs/b"),
        ("mean_rate", 0.25, "photon budget", "no photon budget in runs/a, 0.25 in runs/b"),
        ("focus_off_dof", 3.0, "distance to the focus", "0.0 in runs/a, 3.0 in runs/b"),
    ],
)
def test_what_is_known_of_a_sequence_must_agree(key, value, name, sides):
    error = refusal(merge_records, {"runs/a": ONE, "runs/b": [LATER[0], change(LATER[1], **{key: value})]})
    assert error.problem == f"the {name} of y differs: {sides}"
    assert error.allowed == f"one {name} per sequence"


def test_a_method_that_names_its_region_may_look_elsewhere():
    elsewhere = [record(f"{m}@frame", s, 0, region="frame") for m in ("a+s", "b+s") for s in ("x", "y")]
    assert len(merge_records({"target": ONE, "frame": elsewhere})) == 8


def test_what_two_runs_share_is_kept_once_the_first():
    slower = [change(r, seconds=9.0, machine="another") for r in ONE]
    both = merge_records({"monday": ONE, "tuesday": [*slower, *LATER]})
    assert len(both) == 6
    assert {r.judgement.seconds for r in both} == {0.25}


@pytest.mark.parametrize(
    ("records", "fragments"),
    [
        ([*ONE, ONE[0]], ("two records of a+s on x",)),
        (ONE[:3], ("b+s has no record of y",)),
        ([ONE[0], record("b+s", "x", 0, data="other")], ("data digest of x", "sha-x in a+s, other in b+s")),
        ([ONE[0], record("b+s", "x", 0, region="frame")], ("region of x", "target in a+s, frame in b+s")),
        ([ONE[0], record("b+s", "x", 0, track="closed_loop")], ("track", "recorded in a+s, closed_loop in b+s")),
        ([ONE[0], record("b+s", "x", 0, rig="other")], ("evaluator version", "r0 in a+s, other in b+s")),
        ([ONE[0], record("b+s", "x", 0, terms="stepper")], ("protocol of x", "no protocol in a+s, stepper in b+s")),
        ([ONE[0], record("a+s", "y", 0, code="other")], ("code digest of a+s", "code-a+s in x, other in y")),
    ],
)
def test_records_that_cannot_be_compared_are_refused(records, fragments):
    problem = refusal(rank_methods, records).problem
    assert all(fragment in problem for fragment in fragments), problem


@pytest.mark.parametrize(
    ("later", "fragments"),
    [
        ([change(r, data="other") for r in LATER], ("data digest of x", "sha-x in runs/a, other in runs/b")),
        ([change(r, region="frame") for r in LATER], ("region of x", "target in runs/a, frame in runs/b")),
        ([change(r, track="closed_loop") for r in LATER], ("recorded in runs/a, closed_loop in runs/b",)),
        ([change(r, rig="new") for r in LATER], ("evaluator version differs: r0 in runs/a, new in runs/b",)),
        ([change(r, rig="new") for r in ONE], ("evaluator version differs: r0 in runs/a, new in runs/b",)),
        ([change(ONE[0], code="new")], ("code digest of a+s", "code-a+s in runs/a, new in runs/b")),
        (LATER[:1], ("c+s of runs/b has no record of y",)),
        ([change(r, frame=1.0) for r in ONE], ("a+s on x differs between runs/a and runs/b",)),
    ],
)
def test_runs_that_cannot_be_compared_are_refused_by_name(later, fragments):
    problem = refusal(merge_records, {"runs/a": ONE, "runs/b": later}).problem
    assert all(fragment in problem for fragment in fragments), problem


SENSORS = ("vidar_400x250", "vidar_400x250_noisy")


def two_sensors():
    """Records of eight methods on four sequences of each of twelve scenes, by two sensors."""
    own = [
        record(
            f"m{m}+s",
            f"s{s}-{i}",
            0.5 if (7 * m + 5 * s + 3 * i) % 16 > m else 5.0,
            scene=f"scene{s:02d}",
            sensor=SENSORS[0],
        )
        for m in range(8)
        for s in range(12)
        for i in range(4)
    ]
    return own, [change(r, data=f"noisy-{r.what.data}", sensor=SENSORS[1]) for r in own]


def test_datasets_that_differ_in_the_sensor_alone_stand_in_one_table_with_an_axis():
    nominal, noisy = two_sensors()
    both = merge_records({"nominal": nominal, "noisy": noisy})
    assert len({r.what.sequence for r in both}) == 2 * len({r.what.sequence for r in nominal})
    assert {r.what.sequence.partition("@")[2] for r in both} == set(SENSORS)
    (table,) = (t for t in by_axis(both, ["m0+s"]) if t.axis.name == "sensor")
    assert [(one.name, one.scenes, one.sequences) for one in table.bins] == [(name, 12, 48) for name in SENSORS]
    again = merge_records({"both": both, "nominal": nominal})
    assert [r.what.sequence for r in again] == [r.what.sequence for r in both]
    assert [row.answerable_1dof for row in rank_methods(both)] == pytest.approx(
        [row.answerable_1dof for row in rank_methods(nominal)]
    )


def test_a_record_that_does_not_state_its_sensor_has_that_of_the_same_data():
    nominal, noisy = two_sensors()
    earlier = [change(r, method=f"early-{r.who.method}", sensor=None) for r in nominal]
    assert {r.what.sensor for r in merge_records({"now": nominal, "earlier": earlier})} == {SENSORS[0]}
    assert len({r.what.sequence for r in merge_records({"now": nominal, "earlier": earlier})}) == 48
    both = merge_records({"a": nominal, "b": noisy, "c": [change(r, sensor=None) for r in nominal]})
    assert len({r.what.sequence for r in both}) == 96


def test_other_data_of_one_sensor_is_refused_as_before():
    nominal, _ = two_sensors()
    other = [change(r, data="other") for r in nominal]
    assert "data digest" in str(refusal(merge_records, {"a": nominal, "b": other}))
