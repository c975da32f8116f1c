"""Recipes: correct ones are read, wrong ones are refused with the line number, coarse sampling is warned of."""

import math
import re
from pathlib import Path
from typing import get_args

import capture_dataset
import pytest
from refusals import assert_says, refusal

from saf_gen.core.config.frozen_benchmarks import read_frozen_digests
from saf_gen.generate.cost import render_seconds
from saf_gen.generate.recipe import FocusSettings, find_recipe, read_recipe
from saf_gen.generate.resolve import MIN_POSITIONS, coarse_sampling, recipe_digest, recipe_fingerprint, resolve_recipe
from saf_gen.optics import DRIVES


def test_of_a_folder_the_recipes_in_it_are_named(tmp_path):
    assert refusal(find_recipe, tmp_path).allowed == "a recipe file; there is none in it"
    (tmp_path / "mine.yaml").touch()
    assert refusal(find_recipe, tmp_path).allowed == str(tmp_path / "mine.yaml")


GOOD = """\
name: tiny
seed: 1
camera: {sensor: vidar_400x250, frames: 100, exposure: {mean_rate: 0.2}}
focus: {drive: image_distance, positions: 5}
render: {samples: 4}
lights:
  constant: {kind: constant}
  mixed: {lamp: {kind: ramp, from: 0.5, to: {uniform: [1, 2]}}}
splits:
  test: {scenes: [usaf_target], lights: [constant, mixed]}
"""


def read(tmp_path, text):
    path = tmp_path / "r.yaml"
    path.write_text(text)
    return read_recipe(path)


def test_a_recipe_can_ask_for_every_drive_there_is():
    choices, _none = get_args(FocusSettings.model_fields["drive"].annotation)
    # A lens that is read from a file moves as image_distance says; its drive has a name in streams alone.
    assert get_args(choices) == tuple(name for name in DRIVES if name != "lens_file")


def test_a_recipe_is_read(tmp_path):
    recipe = read(tmp_path, GOOD)
    assert recipe.camera.frames == 100
    assert recipe.splits["test"].lights == ("constant", "mixed")
    assert recipe.camera.noise.shot is None


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(Path("recipes").glob("*.yaml")), ids=lambda p: p.name)
def test_every_recipe_of_the_project_is_right(path):
    frozen = read_frozen_digests().get(path.stem)
    resolved = resolve_recipe(path)
    assert read_recipe(path).name == path.stem
    assert resolved.sequences
    assert coarse_sampling(resolved) == [], "no recipe that comes along is warned of"
    if frozen:
        assert recipe_digest(resolved) == frozen.digest, "a benchmark with other spikes needs another name"
        counted = [s.planned.split for s in resolved.all_sequences]
        assert {split: counted.count(split) for split in counted} == frozen.sequences


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("frames: 100", "frmes: 100", "r.yaml:3 | 'frmes' | mean 'frames"),
        ("seed: 1", "seed: -1", "r.yaml:2 | seed is -1 | greater than or equal to 0"),
        ("frames: 100", "frames: 3", "r.yaml:3 | camera.frames is 3 | greater than or equal to 16"),
        ("{mean_rate: 0.2}", "{mean_rate: 1.2}", "r.yaml:3 | camera.exposure is | above 0 and below 1"),
        ("{mean_rate: 0.2}", "{}", "either mean_rate | or absolute: true"),
        ("drive: image_distance", "drive: imagedistance", "r.yaml:4 | focus.drive is 'imagedistance'"),
        ("samples: 4", "samples: 4, whole_slices: 0", "render.whole_slices is | seconds above 0"),
        ("samples: 4", "samples: 4, whole_slices: .inf", "render.whole_slices is | seconds above 0"),
        ("samples: 4", "samples: 4, whole_slices: sometimes", "render.whole_slices is | seconds above 0"),
        ("kind: constant", "kind: constnt", "r.yaml:7 | 'constnt' | mean 'constant"),
        ("from: 0.5", "form: 0.5", "r.yaml:8 | 'ramp' | 'form' | mean 'from"),
        ("from: 0.5", "from: -0.5", "r.yaml:8 | from -0.5 to 1 | 0 or more"),
        ("[1, 2]", "[2, 1]", "r.yaml:8 | uniform is [2, 1] | [low, high] with low < high"),
        ("{lamp: {kind", "{lamp: {kin", "r.yaml:8 | light group 'lamp' has no kind"),
        ("[constant, mixed]", "[constant, mixd]", "r.yaml:10 | 'mixd' | mean 'mixed"),
        ("[constant, mixed]", "[constant, constant]", "r.yaml:10 | splits.test.lights is | each name once"),
        ("[usaf_target]", "[camel, camel]", "r.yaml:10 | splits.test.scenes is | each name once"),
        ("mixed]}", "mixed], scene_motion: [static, static]}", "r.yaml:10 | scene_motion is | each name once"),
        ("mixed]}", "mixed], at_rest: [fan]}", "r.yaml:10 | unknown scene of test in at_rest: 'fan' | usaf_target"),
        (
            "mixed]}",
            "mixed], scene_motion: [dynamic], at_rest: [usaf_target]}",
            "r.yaml:10 | splits.test is | scene_motion: [static, dynamic] if scenes are at_rest",
        ),
        ("splits:", "splits:\n  a: {scenes: [usaf_target], lights: [mixed]}", "r.yaml:11: scene 'usaf_target'"),
        (
            "{kind: constant}",
            "{choice: [{kind: constant}, {choice: [{kind: constant}]}]}",
            "r.yaml:7 | a choice holds the range",
        ),
        ("name: tiny", "name: Tiny set", "r.yaml:1 | name is 'Tiny set'"),
        ("  mixed:", "  Mixed/up:", "'Mixed/up'"),
        (
            "lights:\n",
            "scene_params: {usaf_target: {made: !!timestamp 2024-05-01}}\nlights:\n",
            "r.yaml:6 | scene_params.usaf_target.made is the date 2024-05-01",
        ),
    ],
)
def test_a_wrong_recipe_is_refused_in_one_line(tmp_path, old, new, message):
    assert old in GOOD
    assert_says(refusal(read, tmp_path, GOOD.replace(old, new)), message)


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        ("sweep", "r.yaml:4 | focus.motion is 'sweep' | a lens motion | such as {kind: sweep}"),
        ("{from: 0.1}", "r.yaml:4 | motion has no kind | from_csv, hand, hold, steps, sweep, sweep_"),
        ("{kind: swep}", "r.yaml:4 | 'swep' | mean 'sweep"),
        ("{kind: sweep, form: 0.1}", "r.yaml:4 | 'sweep' | 'form' | mean 'from"),
        ("{kind: sweep, to: 1.5}", "r.yaml:4 | to is 1.5 | 0 to 1"),
        ("{choice: [{kind: sweep}, {kind: hold}]}", "r.yaml:4 | lens motion 'hold' | missing"),
        ("{choice: [sweep]}", "r.yaml:4 | motion is 'sweep' | {kind: ...,"),
        ("{kind: from_csv, file: lns.csv}", "r.yaml:4 | 'lns.csv' | mean 'lens.csv"),
        ("{kind: from_csv, file: lens.csv}", "lens.csv:3 | time_s goes from 0 to 0 | a column that rises"),
    ],
)
def test_a_wrong_lens_motion_is_refused_in_one_line(tmp_path, motion, message):
    (tmp_path / "lens.csv").write_text("time_s,position\n0,0\n0,1\n")
    assert_says(refusal(read, tmp_path, GOOD.replace("positions: 5", f"positions: 5, motion: {motion}")), message)


LIGHT = "{kind: constant}"
LATE = "{kind: steps, every_s: 0.001, levels: [1, 1, 1, 1.0e+39, 1]}"
"""The fourth of five steps has a gain beyond float32; the first sixteen readouts are all in the first step."""


def with_params(params):
    return "[usaf_target]", f"[two_planes], lights: [constant]}}\nscene_params: {params} #"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "positions: 5",
            "positions: 5, motion: {kind: steps, count: {uniform: [2, 9]}, natural_hz: 900, damping: 1}",
            "r.yaml | the lens motion of usaf_target-constant-00 | count is | a whole number",
        ),
        ("[usaf_target]", "[usaf_targt]", "'usaf_targt' | mean 'usaf_target"),
        ("{lamp: {kind", "{lmap: {kind", "light 'mixed' on usaf_target | 'lmap'"),
        (LIGHT, "{kind: constant, offset: 1.0e+300}", "light 'constant' on usaf_target: the gain of | is too large"),
        (LIGHT, LATE, "light 'constant' on usaf_target: | too large"),
        ("mixed]}", "mixed], scene_motion: [dynamic]}", "split 'test' asks for dynamic |  usaf_target"),
        ("mixed]}", "mixed], variants: 2}", "repeats, which are 1"),
        (*with_params("{two_planes: {target: naer}}"), 'target is \'naer\' | "near", "far" | mean \'near'),
        (*with_params("{two_planes: {near_sid: 1}}"), "'near_sid' | 'near_side'"),
        (*with_params("{two_plane: {near_side: 1}}"), "unknown scene of scene_params 'two_plane' | 'two_planes'"),
        (
            "{mean_rate: 0.2}",
            "{mean_rate: 0.2, f_number: 64}",
            "r.yaml | scene usaf_target: | 555 nm | 0.547 mm | 7.48 times the travel | diffraction: false",
        ),
    ],
)
def test_what_does_not_fit_its_scenes_is_refused_before_anything_is_made(tmp_path, old, new, message):
    path = tmp_path / "r.yaml"
    path.write_text(GOOD.replace(old, new))
    assert_says(refusal(resolve_recipe, path), message)


def with_own(own, *, of="usaf_target", render="samples: 4"):
    return "render: {samples: 4}", f"render: {{{render}, per_scene: {{{of}: {own}}}}}"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            *with_own("{samples: 9}", of="usaf_targt"),
            "r.yaml:5 | unknown scene of render.per_scene | mean 'usaf_target",
        ),
        (*with_own("{samples: 9}", of="camel"), "r.yaml:5 | unknown scene of render.per_scene 'camel' | usaf_target"),
        (*with_own("{sample: 9}"), "r.yaml:5 | 'sample' | mean 'samples"),
        (*with_own("{max_depth: 9}"), "r.yaml:5 | 'max_depth' | samples"),
        (*with_own("{}"), "r.yaml:5 | samples, slice_samples, or both"),
        (*with_own("9"), "r.yaml:5 | per_scene.usaf_target is 9"),
        (*with_own("{samples: 0}"), "r.yaml:5 | samples is 0 | 1"),
        (*with_own("{samples: 4.5}"), "r.yaml:5 | samples is 4.5 | integer"),
        (*with_own("{samples: {choice: [4, 9]}}"), "r.yaml:5 | samples is | integer"),
        (*with_own("{slice_samples: 9}"), "r.yaml | slice_samples is 9, but usaf_target is recorded only at rest"),
    ],
)
def test_samples_of_one_scene_that_have_wrong_names_or_values_are_refused_in_one_line(tmp_path, old, new, message):
    path = tmp_path / "r.yaml"
    path.write_text(GOOD.replace(old, new))
    assert_says(refusal(resolve_recipe, path), message)


@pytest.mark.parametrize(
    ("scene", "render", "own", "motion", "message"),
    [
        ("cheek_cells", "samples: 4", "{samples: 9}", "static", "by waves, without samples | leave cheek_cells out"),
        ("fan", "samples: 4, slice_samples: 2", "{samples: 9}", "dynamic", "only moving, with 2 | slice_samples"),
        ("fan", "samples: 4", "{samples: 9, slice_samples: 3}", "dynamic", "only moving, with 3 | slice_samples"),
    ],
)
def test_samples_that_no_picture_of_a_scene_uses_are_refused(tmp_path, scene, render, own, motion, message):
    path = tmp_path / "r.yaml"
    old, new = with_own(own, of=scene, render=render)
    text = GOOD.replace("[constant, mixed]", f"[constant], scene_motion: [{motion}]").replace("usaf_target", scene)
    path.write_text(text.replace("drive: image_distance, ", "").replace(old, new))
    assert_says(refusal(resolve_recipe, path), message)


def test_a_scene_has_its_own_samples_and_no_other_stack_nor_a_recipe_without_them_changes(tmp_path):
    path = tmp_path / "r.yaml"

    def resolved(render):
        text = GOOD.replace("[usaf_target], lights: [constant, mixed]", "[usaf_target, fan], lights: [constant]")
        path.write_text(
            text.replace("constant]}", "constant], scene_motion: [static, dynamic]}").replace("samples: 4", render)
        )
        found = resolve_recipe(path)
        specs = {s.planned.id: s.time_stack.specs[-1] for s in found.sequences}
        return found, {name.removesuffix("-constant-00"): spec for name, spec in specs.items()}

    before, plain = resolved("samples: 4")
    assert "per_scene" not in before.recipe.model_dump(mode="json")["render"]
    for own, samples in (
        ("{samples: 64}", (64, 16)),
        ("{slice_samples: 5}", (4, 5)),
        ("{samples: 9, slice_samples: 7}", (9, 7)),
    ):
        after, specs = resolved(f"samples: 4, per_scene: {{fan: {own}}}")
        assert (specs["fan"].samples, specs["fan-dynamic"].samples) == samples
        assert specs["usaf_target"].key == plain["usaf_target"].key
        assert (specs["fan"].key == plain["fan"].key) is (samples[0] == 4)
        assert recipe_fingerprint(after.recipe) != recipe_fingerprint(before.recipe)
    _, specs = resolved("samples: 4, slice_samples: 2, per_scene: {fan: {samples: 64}}")
    assert (specs["fan"].samples, specs["fan-dynamic"].samples) == (64, 2)
    heavy, light = (render_seconds(found["fan"]) for found in (specs, plain))
    assert heavy > 4 * light


@pytest.mark.parametrize(("value", "seconds"), [("false", 0), ("true", math.inf), ("0.3", 0.3), ("1", 1), ("1.0", 1)])
def test_whole_slices_cover_the_stated_seconds(tmp_path, value, seconds):
    text = GOOD.replace("render: {samples: 4}", f"render: {{samples: 4, whole_slices: {value}}}")
    assert read(tmp_path, text).render.all_positions_s == seconds


@pytest.mark.parametrize(
    ("key", "wavelength_m"), [("", 555e-9), (", diffraction: true", 555e-9), (", diffraction: false", 0)]
)
def test_stacks_have_the_sensors_waves_unless_they_are_switched_off(tmp_path, key, wavelength_m):
    path = tmp_path / "r.yaml"
    path.write_text(GOOD.replace("samples: 4", f"samples: 4{key}"))
    resolved = resolve_recipe(path)
    specs = {spec for sequence in resolved.sequences for spec in sequence.time_stack.specs}
    assert {spec.wavelength_m for spec in specs} == {wavelength_m}
    geometric = resolved.without_diffraction()
    assert {s.time_stack.specs[0].wavelength_m for s in geometric.sequences + geometric.all_sequences} == {0.0}
    assert geometric.recipe.render.diffraction is False


# --- too few focus positions or time slices -----------------------------------------------------------


@pytest.mark.usefixtures("test_scenes")
def test_the_suggested_number_of_positions_is_the_smallest_without_a_warning(small_recipe, call):
    text = small_recipe.read_text()
    small_recipe.write_text(text.replace("positions: 9", "positions: 2"))
    code, shown, _ = call("recipes", "check", small_recipe)
    assert code == 0
    (line,) = coarse_sampling(resolve_recipe(small_recipe))
    assert f"warning: {line}" in " ".join(shown.split())
    enough = int(re.search(r"use (\d+) or more", line)[1])
    assert float(re.search(r"only ([\d.]+) of them", line)[1]) < MIN_POSITIONS
    small_recipe.write_text(text.replace("positions: 9", f"positions: {enough}"))
    assert coarse_sampling(resolve_recipe(small_recipe)) == []
    small_recipe.write_text(text.replace("positions: 9", f"positions: {enough - 1}"))
    assert len(coarse_sampling(resolve_recipe(small_recipe))) == 1


def test_fewer_time_slices_than_the_card_has_are_warned_of_with_the_error_to_expect(tmp_path, monkeypatch, call):
    """With slices four times as far apart, the error of an edge is eight times as large; a static scene needs none."""
    card = capture_dataset.write_moving_plane(tmp_path, monkeypatch) / "scene.yaml"
    card.write_text(card.read_text() + "interpolation_error: 0.02\n")
    recipe = tmp_path / "takes.yaml"

    def lines(slices_per_s, moves="static, dynamic"):
        text = capture_dataset.RECIPE.replace("whole_slices: true", f"slices_per_s: {slices_per_s}")
        recipe.write_text(text.replace("static, dynamic", moves))
        return coarse_sampling(resolve_recipe(recipe))

    assert lines(250) == lines(1000) == lines(62.5, moves="static") == []
    (line,) = lines(62.5)
    assert line == (
        "render.slices_per_s is 62.5: half way between two time slices plane is shown as a mixture of both, with an "
        "error of about 0.16 of the mean brightness; its card states 250, for an error of 0.02"
    )
    code, _, err = call("generate", recipe, "--dry-run")
    assert code == 0
    assert f"warning: {line}" in " ".join(err.split())
    card.write_text(card.read_text().replace("interpolation_error: 0.02\n", ""))
    assert lines(62.5) == [
        "render.slices_per_s is 62.5: half way between two time slices plane is shown as a mixture of both; "
        "its card states 250"
    ]
