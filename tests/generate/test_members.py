"""Members of a family that count as scenes of their own."""

import pytest
import yaml
from refusals import assert_says, refusal

from saf_gen.generate.draw import SceneFamily, draw_sequences
from saf_gen.generate.recipe import Recipe, read_recipe
from saf_gen.generate.resolve import recipe_fingerprint

LIGHTS = {name: {"kind": "constant"} for name in ("a", "b", "c")}
SPLIT = {"scenes": ["drawn"], "lights": ["a", "b", "c"]}
FAMILY = {"drawn": SceneFamily({"seed": {"uniform": [0, 1]}})}
BASE = {
    "name": "tiny",
    "seed": 1,
    "camera": {"sensor": "vidar_400x250", "frames": 100, "exposure": {"mean_rate": 0.1}},
    "focus": {"positions": 5, "motion": {"kind": "sweep", "from": {"uniform": [0.0, 0.5]}}},
    "render": {"samples": 4},
    "lights": LIGHTS,
}


def recipe(**splits):
    return Recipe.model_validate(BASE | {"splits": {name: SPLIT | split for name, split in splits.items()}})


def test_each_member_is_a_scene_with_its_own_parameters_and_motion_and_draws_its_lights():
    drawn = draw_sequences(recipe(test={"members": 12, "lights_each": 2}), FAMILY)
    assert len(drawn) == 24
    by_scene = {}
    for one in drawn:
        by_scene.setdefault(one.counted_as, []).append(one)
    assert next(iter(by_scene)).startswith("drawn-test-0")
    assert len(by_scene) == 12
    for mine in by_scene.values():
        assert len({s.light for s in mine}) == 2
        assert len({str(s.motion) + str(s.params) for s in mine}) == 1
    assert len({str(s.motion) for s in drawn}) == len({str(s.params) for s in drawn}) == 12
    assert len({tuple(sorted(s.light for s in mine)) for mine in by_scene.values()}) > 1
    assert drawn[0].id == f"{drawn[0].counted_as}-{drawn[0].light}"
    assert "is_scene" not in drawn[0].as_dict()


def test_splits_may_share_a_family_whose_members_count_and_none_is_in_two(tmp_path):
    drawn = draw_sequences(recipe(train={"members": 5}, test={"members": 5}), FAMILY)
    assert len({s.params["seed"] for s in drawn}) == 10
    assert len({s.id for s in drawn}) == len(drawn) == 30
    longer = draw_sequences(recipe(train={"members": 7}, test={"members": 5}), FAMILY)
    kept = {s.id: s for s in longer}
    assert all(kept[s.id] == s for s in drawn)  # more members change no other


def test_a_split_may_have_parameters_of_its_own_which_change_no_other_draw():
    far = recipe(
        test={"members": 20, "scene_params": {"drawn": {"travel": {"uniform": [40, 100]}}}}, train={"members": 5}
    )
    far = far.model_copy(update={"scene_params": {"drawn": {"travel": {"uniform": [10, 40]}}}})
    family = {"drawn": SceneFamily({**FAMILY["drawn"].params, "travel": {"uniform": [0, 1]}})}
    travels = {"test": [], "train": []}
    for s in draw_sequences(far, family):
        travels[s.split].append(s.params["travel"])
    assert min(travels["test"]) >= 40
    assert max(travels["train"]) <= 40
    alone = draw_sequences(recipe(test={"members": 20}, train={"members": 5}), FAMILY)
    assert [s.params["seed"] for s in alone] == [s.params["seed"] for s in draw_sequences(far, family)]


def test_parameters_of_a_split_are_of_its_scenes_and_a_split_without_them_has_no_such_key(tmp_path):
    path = tmp_path / "r.yaml"
    split = SPLIT | {"members": 2, "positions": 9, "scene_params": {"other": {"seed": 1}}}
    path.write_text(yaml.safe_dump(BASE | {"splits": {"test": split}}))
    assert_says(refusal(read_recipe, path), "r.yaml | scene of splits.test.scene_params | 'other' | drawn")
    assert {"positions", "scene_params"}.isdisjoint(recipe(test={}).model_dump(mode="json")["splits"]["test"])


def test_repeats_may_draw_lights_too():
    drawn = draw_sequences(recipe(test={"repeats": 8, "variants": 2, "lights_each": 1}), FAMILY)
    assert len(drawn) == 8
    assert {s.counted_as for s in drawn} == {"drawn"}
    assert len({s.light for s in drawn}) > 1


def test_recipes_without_the_keys_keep_text_and_fingerprint():
    plain = recipe(test={})
    assert not {"members", "lights_each"} & plain.model_dump(mode="json")["splits"]["test"].keys()
    assert recipe_fingerprint(plain) != recipe_fingerprint(recipe(test={"members": 1}))


def test_equal_members_are_refused():
    fixed = {"drawn": SceneFamily({"side": {"choice": ["left", "right"]}})}
    message = refusal(draw_sequences, recipe(test={"members": 9}), fixed)
    assert_says(message, "drawn-test-0 | are the same scene | uniform or log_uniform | repeats")


@pytest.mark.parametrize(
    ("splits", "says"),
    [
        ({"test": {"members": 0}}, "members is 0 | greater than or equal to 1"),
        ({"test": {"members": 2, "repeats": 2}}, "either members, or repeats and variants"),
        ({"test": {"members": 2, "repeats": 2, "variants": 2}}, "either members, or repeats and variants"),
        ({"test": {"members": "many"}}, "members is 'many'"),
        ({"test": {"membres": 3}}, "did you mean 'members'"),
        ({"test": {"lights_each": 4}}, "at most as many lights_each as lights, which are 3"),
        ({"test": {"lights_each": 0}}, "lights_each is 0"),
        ({"test": {"lights_each": 1.5}}, "lights_each is 1.5"),
        ({"train": {"members": 2}, "test": {}}, "scene 'drawn' is in test and in train | members of the family"),
        ({"train": {}, "test": {"members": 2}}, "scene 'drawn' is in test and in train"),
        ({"test": {"members": 2, "scenes": ["drawn", "drawn"]}}, "each name once"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_one_line(splits, says, tmp_path):
    written = BASE | {"splits": {name: SPLIT | split for name, split in splits.items()}}
    (tmp_path / "r.yaml").write_text(yaml.safe_dump(written))
    assert_says(refusal(read_recipe, tmp_path / "r.yaml"), says)
