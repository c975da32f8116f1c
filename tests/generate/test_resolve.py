"""Recipes become sequences; drawn numbers depend on names only."""

import os
import socket
from pathlib import Path

import numpy as np
import pytest
import yaml
from refusals import assert_says, refusal

from saf_gen.core.files import temporary_name
from saf_gen.generate.draw import SceneFamily, draw_sequences
from saf_gen.generate.recipe import Recipe, read_recipe
from saf_gen.generate.resolve import recipe_fingerprint, resolve_recipe

BASE = {
    "name": "tiny",
    "seed": 1,
    "camera": {"sensor": "vidar_400x250", "frames": 100, "exposure": {"mean_rate": {"uniform": [0.1, 0.3]}}},
    "focus": {"positions": 5},
    "render": {"samples": 4},
    "lights": {"fixed": {"kind": "constant"}, "open": {"kind": "ramp", "from": 0.5, "to": {"uniform": [1, 2]}}},
    "splits": {
        "train": {"scenes": ["camel"], "lights": ["open"], "repeats": 2},
        "test": {"scenes": ["usaf_target"], "lights": ["fixed", "open"]},
    },
}


def plan(**changes):
    return draw_sequences(Recipe.model_validate(BASE | changes))


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
    assert [s.motion for s in plan()] == [{"kind": "sweep"}] * 4


def plan_named(light="fixed", split="test", scene="camel", name="tiny"):
    splits = {split: {"scenes": [scene], "lights": [light]}}
    return plan(name=name, lights={light: {"kind": "constant"}}, splits=splits)


LONGEST_LIGHT = "a" * (150 - len("camel--00"))


@pytest.mark.parametrize(
    "names",
    [
        {"light": LONGEST_LIGHT},
        {"light": "-rf"},  # the id begins with the scene
        {"light": "con"},
        {"scene": "con"},
        {"split": "s" * 150},
        {"split": "ä" * 75},
        {"split": "console"},
        {"split": "com"},
        {"split": "com10"},
        {"split": "r-f"},
        {"split": "2"},
        {"name": "n" * 150},
    ],
)
def test_names_of_files_may_be_long_and_begin_and_end_as_they_like(names):
    (sequence,) = plan_named(**names)
    assert len(sequence.file.rpartition("/")[2].encode()) <= 153


@pytest.mark.parametrize(
    ("names", "fragments"),
    [
        ({"light": "a" * 200}, f"the sequence 'camel-{'a' * 200}-00' | 209 bytes | at most 150 | shorten the name of"),
        ({"light": LONGEST_LIGHT + "a"}, "151 bytes | at most 150"),
        ({"light": "ä" * 71}, "151 bytes | at most 150"),
        ({"scene": "a" * 200}, "209 bytes | at most 150"),
        ({"split": "s" * 151}, "the split 'sss | 151 bytes | at most 150"),
        ({"split": "ä" * 76}, "152 bytes | at most 150"),
        ({"name": "n" * 151}, "the recipe 'nnn | 151 bytes | at most 150"),
        *(
            (
                {key: name},
                f"the {what} {name!r} cannot name files | allowed: names without - at the beginning | Windows",
            )
            for key, what in (("split", "split"), ("name", "recipe"))
            for name in ("con", "aux", "nul", "prn", "com1", "lpt9", "com0")
        ),
        ({"split": "-rf"}, "the split '-rf' cannot name files | names without - at the beginning"),
        ({"split": "com¹"}, "the split 'com¹' cannot name files"),
    ],
)
def test_names_that_some_file_system_does_not_take_are_refused(names, fragments):
    assert_says(refusal(plan_named, **names), fragments)


def test_the_longest_names_fit_while_they_are_written():
    """File systems take 255 bytes. A machine's name has up to 40 here, and the id of a process up to 7."""
    written = temporary_name(Path(f"{'a' * 150}-0123456789ab.npy")).name
    assert len(written) - len(socket.gethostname()[:40]) - len(str(os.getpid())) + 40 + 7 <= 255


@pytest.mark.parametrize(
    ("old", "new"),
    [("constant", "c" * 200), ("  test:", "  con:"), ("  test:", "  -rf:"), ("name: small", "name: aux")],
)
def test_recipes_check_and_generate_refuse_such_names_before_anything_is_made(
    call, small_recipe, test_scenes, tmp_path, old, new
):
    small_recipe.write_text(small_recipe.read_text().replace(old, new).replace(f"kind: {new}", f"kind: {old}"))
    for command in ("recipes check", "generate"):
        options = ["--out", tmp_path / "made"] if command == "generate" else []
        code, out, err = call(*command.split(), small_recipe, *options)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert err.startswith(f"saf-gen: {small_recipe}: the ")
        assert "cannot name files" in err
    assert not (tmp_path / "made").exists()


def drawn_motions(motion, **changes):
    return [s.motion for s in plan(focus={"positions": 5, "motion": motion}, **changes)]


def test_open_numbers_of_a_motion_are_drawn_for_each_repeat_and_are_the_same_under_every_light():
    drawn = drawn_motions({"kind": "sweep", "from": {"uniform": [0.0, 0.2]}, "to": 0.9})
    assert all(0 <= m["from"] <= 0.2 and m["to"] == 0.9 for m in drawn)
    starts = {}
    for sequence, motion in zip(plan(), drawn, strict=True):
        starts.setdefault((sequence.scene, sequence.repeat), set()).add(motion["from"])
    assert {len(found) for found in starts.values()} == {1}
    assert len(set.union(*starts.values())) == len(starts) == 3


def test_a_hand_moves_differently_in_each_repeat_unless_the_recipe_names_its_seed():
    assert len({m["seed"] for m in drawn_motions({"kind": "hand"})}) == 3
    assert {m["seed"] for m in drawn_motions({"kind": "hand", "seed": 5})} == {5}


def test_a_motion_moves_nothing_else_of_a_sequence():
    for one, other in zip(plan(), plan(focus={"positions": 5, "motion": {"kind": "hand"}}), strict=True):
        assert (one.seed, one.schedule, one.mean_rate) == (other.seed, other.schedule, other.mean_rate)


def test_an_edited_table_of_a_motion_makes_other_sequences(tmp_path):
    recipe = BASE | {"focus": {"positions": 5, "motion": {"kind": "from_csv", "file": "lens.csv"}}}
    (tmp_path / "r.yaml").write_text(yaml.safe_dump(recipe))
    plans = []
    for end in ("0.9", "0.8"):
        (tmp_path / "lens.csv").write_text(f"time_s,position\n0,0.1\n1,{end}\n")
        plans.append(draw_sequences(read_recipe(tmp_path / "r.yaml")))
    assert plans[0][0].motion["file"] == {"path": "lens.csv", "text": "time_s,position\n0,0.1\n1,0.9\n"}
    assert plans[0] != plans[1]


def test_a_sequence_does_not_depend_on_its_neighbours():
    alone = {"test": BASE["splits"]["test"]}
    assert plan(splits=alone) == plan()[2:]


def test_the_fingerprint_sees_values_and_not_the_order_of_keys():
    recipe = Recipe.model_validate(BASE)
    turned = Recipe.model_validate(dict(reversed(BASE.items())))
    assert recipe_fingerprint(recipe) == recipe_fingerprint(turned)
    assert recipe_fingerprint(recipe) != recipe_fingerprint(Recipe.model_validate(BASE | {"seed": 2}))


def test_a_recipe_replaces_the_aberrations_of_every_lens(tmp_path):
    """Without the key, text and fingerprint are those from before it existed."""
    plain = Recipe.model_validate(BASE)
    assert "aberrations" not in plain.model_dump(mode="json")["focus"]
    found = {}
    for severity in (None, "none", "mild", "strong"):
        focus = BASE["focus"] | ({"aberrations": severity} if severity else {})
        path = tmp_path / "recipe.yaml"
        path.write_text(yaml.safe_dump(BASE | {"focus": focus}))
        resolved = resolve_recipe(path)
        drives = {s.scene.id: s.time_stack.specs[0].drive for s in resolved.sequences}
        found[severity] = [drive.wavefront and drive.wavefront.spherical_m for drive in drives.values()]
        assert (recipe_fingerprint(resolved.recipe) == recipe_fingerprint(plain)) == (severity is None)
    assert found[None] == found["none"] == [None, None]
    assert [strong / mild for strong, mild in zip(found["strong"], found["mild"], strict=True)] == pytest.approx([3, 3])


def test_a_scene_at_rest_is_static_alone_and_changes_nothing_of_the_others():
    families = {"camel": SceneFamily(moves=True), "bottle": SceneFamily(moves=True)}
    split = {"scenes": ["camel", "bottle"], "lights": ["fixed"], "scene_motion": ["static", "dynamic"]}
    plans = [
        draw_sequences(Recipe.model_validate(BASE | {"splits": {"test": split | at_rest}}), families)
        for at_rest in ({}, {"at_rest": ["camel"]})
    ]
    assert [s.id for s in plans[1]] == ["camel-fixed-00", "bottle-fixed-00", "bottle-dynamic-fixed-00"]
    assert plans[1] == [s for s in plans[0] if s.id != "camel-dynamic-fixed-00"]


# --- ids ----------------------------------------------------------------------------------------------


def test_two_sequences_of_one_id_are_refused_and_both_are_named():
    """A static scene under 'dynamic-fixed' and a moving one under 'fixed' would have the same id."""
    lights = {"fixed": {"kind": "constant"}, "dynamic-fixed": {"kind": "constant"}}
    split = {"scenes": ["camel"], "lights": list(lights), "scene_motion": ["static", "dynamic"]}
    recipe = Recipe.model_validate(BASE | {"lights": lights, "splits": {"test": split}})
    error = refusal(draw_sequences, recipe, {"camel": SceneFamily(moves=True)})
    assert_says(
        error, "'camel-dynamic-fixed-00' | camel, static, under 'dynamic-fixed' | camel, dynamic, under 'fixed'"
    )
    assert error.hint == "rename the light 'dynamic-fixed'"


# --- parameters ---------------------------------------------------------------------------------------

CARD = {
    "cup": {"choice": ["left", "right"]},
    "blades": {"choice": [3, 4, 5]},
    "shape": {"choice": [[1, 2], [3, 4]]},
    "distance_m": {"uniform": [0.4, 0.5]},
    "texels": 64,
    "word": "free",
}


def member(**chosen):
    split = {"test": {"scenes": ["camel"], "lights": ["fixed"]}}
    recipe = Recipe.model_validate(BASE | {"splits": split, "scene_params": {"camel": chosen}})
    (sequence,) = draw_sequences(recipe, {"camel": SceneFamily(CARD)})
    return sequence.params


def test_a_recipe_chooses_among_the_card_s_values_and_any_number_in_or_out_of_its_range():
    for chosen in ({"cup": "left"}, {"shape": [3, 4]}, {"distance_m": 0.45}, {"word": "another"}):
        assert chosen.items() <= member(**chosen).items()
    assert member(blades={"choice": [3, 5]})["blades"] in (3, 5)
    assert member(texels={"choice": [32, 128]})["texels"] in (32, 128)
    assert 0.1 <= member(distance_m={"log_uniform": [0.1, 9]})["distance_m"] <= 9


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"cup": "lfet"}, 'scene_params.camel.cup is \'lfet\' | "left", "right" | mean \'left'),
        ({"cup": {"choice": ["left", "rihgt"]}}, "'rihgt' | mean 'right"),
        ({"blades": True}, "blades is True | 3, 4, 5"),
        ({"blades": 3.0}, "blades is 3.0 | 3, 4, 5 | mean '3"),
        ({"blades": {"uniform": [3, 5]}}, "blades is {'uniform': [3, 5]} | 3, 4, 5"),
        ({"shape": [1, 4]}, "shape is [1, 4] | [1, 2], [3, 4]"),
        ({"distance_m": {"choice": [0.4, "far"]}}, "distance_m is 'far' | a number"),
        ({"texels": [64, 64]}, "texels is [64, 64] | a number"),
    ],
    ids=str,
)
def test_a_parameter_that_the_card_could_not_have_is_refused(chosen, message):
    assert_says(refusal(member, **chosen), message)


def exposed(tmp_path, **exposure):
    path = tmp_path / "r.yaml"
    path.write_text(yaml.safe_dump(BASE | {"camera": BASE["camera"] | {"frames": 20_000, "exposure": exposure}}))
    return path


def test_spikes_per_depth_are_as_many_behind_lenses_of_long_and_short_travels(tmp_path):
    path = exposed(tmp_path, spikes_per_depth={"uniform": [40, 80]})
    per_depth, rates = [], []
    for sequence, drawn in zip(resolve_recipe(path).sequences, draw_sequences(read_recipe(path)), strict=True):
        spec = sequence.time_stack.specs[0]
        frame = spec.in_focus.depth_of_focus(np.full((1, 1), spec.drive.focus_depth(0.5)), np.ones((1, 1), bool))
        rates.append(sequence.planned.mean_rate)
        per_depth.append(rates[-1] * 20_000 * abs(frame[1] - frame[0]))
        assert per_depth[-1] == pytest.approx(drawn.mean_rate, rel=0.02)  # as drawn, and by the truth's own rule
    assert all(39 < count < 82 for count in per_depth)


@pytest.mark.parametrize(
    ("exposure", "said"),
    [
        ({"spikes_per_depth": 5000}, "camera.exposure: usaf_target-fixed-00: | is 5000 | less than | more frames"),
        ({"spikes_per_depth": 0}, "a spikes_per_depth above 0"),
        ({"spikes_per_depth": {"uniform": [0, 5]}}, "a spikes_per_depth above 0"),
        ({"spikes_per_depth": 5, "mean_rate": 0.1}, "either mean_rate | or spikes_per_depth, or absolute: true"),
        ({"spikes_per_depth": 5, "absolute": True}, "either mean_rate | or spikes_per_depth, or absolute: true"),
    ],
)
def test_spikes_per_depth_that_no_pixel_gives_are_refused(tmp_path, exposure, said):
    assert_says(refusal(resolve_recipe, exposed(tmp_path, **exposure)), said)
