"""Recipes become sequences; what is drawn depends on names alone."""

import yaml

from saf_gen.plan import make_plan, recipe_fingerprint, shard
from saf_gen.recipe import Recipe, read_recipe

BASE = {
    "name": "tiny",
    "seed": 1,
    "camera": {"sensor": "vidar_400x250", "frames": 100, "exposure": {"mean_rate": {"uniform": [0.1, 0.3]}}},
    "focus": {"positions": 5},
    "render": {"samples": 4},
    "lights": {
        "fixed": {"kind": "constant"},
        "open": {"kind": "ramp", "from": 0.5, "to": {"uniform": [1, 2]}},
    },
    "splits": {
        "train": {"scenes": ["camel"], "lights": ["open"], "repeats": 2},
        "test": {"scenes": ["usaf_target"], "lights": ["fixed", "open"]},
    },
}


def plan(**changes):
    return make_plan(Recipe.model_validate(BASE | changes))


def test_sequences_are_the_product_of_scenes_lights_and_repeats():
    files = [s.file for s in plan()]
    assert files == [
        "train/camel-open-00.h5",
        "train/camel-open-01.h5",
        "test/usaf_target-fixed-00.h5",
        "test/usaf_target-open-00.h5",
    ]


def test_open_numbers_are_drawn_within_their_range_and_differ_between_repeats():
    first, second = plan()[:2]
    assert 1 <= first.schedule[""]["to"] <= 2
    assert first.schedule[""]["to"] != second.schedule[""]["to"]
    assert 0.1 <= first.mean_rate <= 0.3
    assert first.seed != second.seed


def moved(motion, **changes):
    return [s.motion for s in plan(focus={"positions": 5, "motion": motion}, **changes)]


def test_a_lens_sweeps_unless_told_otherwise():
    assert [s.motion for s in plan()] == [{"kind": "sweep"}] * 4


def test_open_numbers_of_a_motion_are_drawn_for_each_repeat_and_are_the_same_under_every_light():
    drawn = moved({"kind": "sweep", "from": {"uniform": [0.0, 0.2]}, "to": 0.9})
    assert all(0 <= m["from"] <= 0.2 and m["to"] == 0.9 for m in drawn)
    films = {}
    for sequence, motion in zip(plan(), drawn, strict=True):
        films.setdefault((sequence.scene, sequence.repeat), set()).add(motion["from"])
    assert {len(ways) for ways in films.values()} == {1}
    assert len(set.union(*films.values())) == len(films) == 3


def test_a_motion_may_be_drawn_among_several():
    among = [{"kind": "sweep"}, {"kind": "hold", "position": {"uniform": [0.2, 0.4]}}]
    drawn = moved({"choice": among}, splits={"test": BASE["splits"]["test"] | {"repeats": 20}})
    assert {m["kind"] for m in drawn} == {"sweep", "hold"}
    held = [m["position"] for m in drawn if m["kind"] == "hold"]
    assert len(set(held)) > 5


def test_a_hand_is_another_in_each_repeat_unless_the_recipe_names_its_seed():
    assert len({m["seed"] for m in moved({"kind": "hand"})}) == 3
    assert {m["seed"] for m in moved({"kind": "hand", "seed": 5})} == {5}


def test_a_motion_moves_nothing_else_of_a_sequence():
    for one, other in zip(plan(), plan(focus={"positions": 5, "motion": {"kind": "hand"}}), strict=True):
        assert (one.seed, one.schedule, one.mean_rate) == (other.seed, other.schedule, other.mean_rate)


def test_an_edited_table_of_a_motion_makes_other_sequences(tmp_path):
    recipe = BASE | {"focus": {"positions": 5, "motion": {"kind": "from_csv", "file": "lens.csv"}}}
    (tmp_path / "r.yaml").write_text(yaml.safe_dump(recipe))
    plans = []
    for end in ("0.9", "0.8"):
        (tmp_path / "lens.csv").write_text(f"time_s,position\n0,0.1\n1,{end}\n")
        plans.append(make_plan(read_recipe(tmp_path / "r.yaml")))
    assert plans[0][0].motion["file"] == {"path": "lens.csv", "text": "time_s,position\n0,0.1\n1,0.9\n"}
    assert plans[0] != plans[1]


def test_a_sequence_does_not_depend_on_its_neighbours():
    alone = {"test": BASE["splits"]["test"]}
    assert plan(splits=alone) == plan()[2:]


def test_another_seed_draws_other_numbers():
    assert plan(seed=2)[0].seed != plan()[0].seed


def test_the_fingerprint_sees_values_and_not_the_order_of_keys():
    recipe = Recipe.model_validate(BASE)
    turned = Recipe.model_validate(dict(reversed(BASE.items())))
    assert recipe_fingerprint(recipe) == recipe_fingerprint(turned)
    assert recipe_fingerprint(recipe) != recipe_fingerprint(Recipe.model_validate(BASE | {"seed": 2}))


def test_shards_share_the_work_without_overlap():
    parts = [shard(plan(), i, 3) for i in (1, 2, 3)]
    assert sorted(s.id for part in parts for s in part) == sorted(s.id for s in plan())
