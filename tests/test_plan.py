"""Recipes become sequences; what is drawn depends on names alone."""

from saf_gen.plan import make_plan, recipe_fingerprint, shard
from saf_gen.recipe import Recipe

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
