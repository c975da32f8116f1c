"""Schedules in recipes: files, seeds and lux are filled in, and errors name the line."""

import pytest
from refusals import assert_says, refusal
from small_dataset import SMALL_RECIPE

from saf_gen.generate.draw import SceneFamily, draw_sequences
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.plugins.lights import group_gains
from saf_gen.scene.scene_folder import find_scene

TABLE = "time_s,gain\n0,1\n0.01,0.5\n"


@pytest.fixture
def recipe_of(tmp_path, test_scenes):
    """Write the small recipe with this text as its only light, in a new folder, and return its path."""
    folder = tmp_path / "recipes"
    folder.mkdir()
    (folder / "lamp.csv").write_text(TABLE)

    def write(light, repeats=1):
        head, rest = SMALL_RECIPE.split("lights:\n")
        path = folder / "small.yaml"
        path.write_text(
            f"{head}lights:\n  it: {light}\nsplits:\n  test: {{scenes: [plane], lights: [it], repeats: {repeats}}}\n"
        )
        assert "splits:" in rest
        return path

    return write


def fingerprints(path):
    work = resolve_recipe(path)
    return [s.fingerprint("a stack") for s in work.sequences]


def gains_of(sequence, frames=20):
    return group_gains(sequence.schedule, ("lamp", "room"), frames=frames, readout_hz=20_000)


def test_a_table_is_read_with_the_recipe_from_the_recipe_s_folder(recipe_of, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a path is relative to the recipe, not to the working directory
    (tmp_path / "lamp.csv").write_text("time_s,gain\n0,9\n")
    recipe = read_recipe(recipe_of("{kind: from_csv, file: lamp.csv}"))
    assert recipe.lights["it"] == {"kind": "from_csv", "file": {"path": "lamp.csv", "text": TABLE}}


def test_an_edited_table_is_another_sequence(recipe_of):
    path = recipe_of("{lamp: {kind: from_csv, file: lamp.csv}}")
    before = fingerprints(path)
    assert fingerprints(path) == before
    table = path.with_name("lamp.csv")
    table.write_text(TABLE.replace("0.5", "0.6"))
    assert fingerprints(path) != before
    table.write_text(TABLE)
    assert fingerprints(path) == before


def test_a_choice_of_tables_is_drawn(recipe_of):
    path = recipe_of("{kind: from_csv, file: {choice: [lamp.csv, other.csv]}}", repeats=12)
    path.with_name("other.csv").write_text("time_s,gain\n0,3\n")
    drawn = [s.schedule[""]["file"]["path"] for s in draw_sequences(read_recipe(path))]
    assert set(drawn) == {"lamp.csv", "other.csv"}


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ("{kind: from_csv, file: lampp.csv}", "small.yaml:7 | 'lampp.csv' | mean 'lamp.csv"),
        ("{kind: from_csv, file: ../lamp.csv}", "small.yaml:7 | '../lamp.csv' | outside"),
        ("{kind: from_csv, file: {choice: [lamp.csv, no.csv]}}", "small.yaml:7 | 'no.csv'"),
        ("{kind: from_csv, file: {choice: lamp.csv}}", "choice is 'lamp.csv' | a list"),
        ("{kind: from_csv, file: 3}", "small.yaml:7 | file is 3 | CSV file"),
        ("{kind: from_csv}", "small.yaml:7 | light schedule 'from_csv' | missing | 'file'"),
        ("{kind: from_csv, file: negative.csv}", "small.yaml:7 | negative.csv: gain is -1 at 2 s"),
        ("{kind: from_csv, file: nan.csv}", "small.yaml:7 | nan.csv:2 | gain is 'nan'"),
    ],
)
def test_a_table_that_does_not_fit_is_refused_in_one_line(recipe_of, light, message):
    path = recipe_of(light)
    path.with_name("negative.csv").write_text("time_s,gain\n0,1\n2,-1\n")
    path.with_name("nan.csv").write_text("time_s,gain\n0,nan\n")
    assert_says(refusal(resolve_recipe, path), message)


@pytest.mark.parametrize("group", ["", "lamp"])
def test_the_kind_itself_may_be_open(recipe_of, group):
    part = "{choice: [{kind: constant}, {kind: flicker, depth: {uniform: [0.1, 0.2]}}]}"
    plan = draw_sequences(read_recipe(recipe_of(f"{{{group}: {part}}}" if group else part, repeats=12)))
    drawn = [s.schedule[group] for s in plan]
    assert {part["kind"] for part in drawn} == {"constant", "flicker"}
    assert all(0.1 <= part["depth"] <= 0.2 for part in drawn if part["kind"] == "flicker")


def test_every_sequence_walks_its_own_way_and_every_group_too_by_its_name_alone(recipe_of):
    light = "{lamp: {kind: random_walk, sd: 0.5}, room: {kind: random_walk, sd: 0.5}}"
    alone = draw_sequences(read_recipe(recipe_of(light)))
    plan = draw_sequences(read_recipe(recipe_of(light, repeats=3)))
    assert plan[:1] == alone
    seeds = [part["seed"] for s in plan for part in s.schedule.values()]
    assert len(set(seeds)) == 6
    assert len({column.tobytes() for s in plan for column in gains_of(s, 400).T}) == 6


def test_an_offset_may_be_open_and_belongs_to_any_kind(recipe_of):
    path = recipe_of("{lamp: {kind: pwm, hz: 400, duty: 0, offset: {uniform: [0.2, 0.3]}}}")
    (sequence,) = draw_sequences(read_recipe(path))
    offset = sequence.schedule["lamp"]["offset"]
    gains = gains_of(sequence)
    assert 0.2 <= offset <= 0.3
    assert gains[:, 0] == pytest.approx(offset, abs=1e-6)
    assert (gains[:, 1] == 1).all()


LUX = {"plane": SceneFamily(illuminance_lux={"lamp": 300.0, "room": 100.0})}


@pytest.mark.parametrize(("light", "gain"), [("lamp", 0.5), ("room", 1.5), ("", 0.375)])
def test_levels_in_lux_are_divided_by_the_lux_that_the_scene_has_at_gain_1(recipe_of, light, gain):
    """150 lux are half the lamp's 300, one and a half times the room's 100, and 3/8 of both."""
    part = "{kind: constant, level: 100, offset: 50, unit: lux}"
    recipe = read_recipe(recipe_of(f"{{{light}: {part}}}" if light else part))
    (sequence,) = draw_sequences(recipe, LUX)
    gains = gains_of(sequence)
    lit = {"lamp": [0], "room": [1], "": [0, 1]}[light]
    assert gains[:, lit] == pytest.approx(gain, abs=1e-6)
    assert sequence.schedule[light]["lux_at_gain_1"] == {"lamp": 300, "room": 100, "": 400}[light]


def test_lux_of_a_scene_that_states_none_is_refused_before_anything_is_made(recipe_of):
    path = recipe_of("{lamp: {kind: constant, level: 100, unit: lux}}")
    assert_says(refusal(resolve_recipe, path), "light 'it' on plane: the schedule is in lux")


def test_the_card_s_illuminance_reaches_the_sequence(recipe_of, tmp_path, test_scenes, monkeypatch):
    folder = tmp_path / "scenes" / "plane"
    folder.mkdir(parents=True)
    for name in ("scene.py", "scene.yaml"):
        (folder / name).write_text((test_scenes / "plane" / name).read_text())
    with (folder / "scene.yaml").open("a") as card:
        card.write("illuminance_lux: {lamp: 300, room: 100}\n")
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path / "scenes"))
    work = resolve_recipe(recipe_of("{lamp: {kind: constant, level: 150, unit: lux}}"))
    assert work.all_sequences == work.sequences
    assert gains_of(work.sequences[0].planned)[0].tolist() == [0.5, 1]


@pytest.mark.parametrize("lux", ["{lamp: 300}", "{lamp: 300, room: 0}"])
def test_a_card_states_the_illuminance_of_all_groups_or_of_none(tmp_path, test_scenes, monkeypatch, lux):
    folder = tmp_path / "plane"
    folder.mkdir()
    (folder / "scene.py").write_text("")
    card = (test_scenes / "plane" / "scene.yaml").read_text()
    (folder / "scene.yaml").write_text(card + f"illuminance_lux: {lux}\n")
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path))
    assert_says(refusal(find_scene, "plane"), "illuminance_lux above 0 for each of lamp, room, or for none")


@pytest.mark.parametrize(
    ("light", "message"),
    [
        ("{kind: constant, ofset: 1}", "small.yaml:7 | 'constant' | 'ofset' | 'offset'"),
        ("{choice: [{kind: constant}, {kind: flickr}]}", "small.yaml:7 | 'flickr'"),
        ("{lamp: {choice: [{kind: constant}, 3]}}", "small.yaml:7 | lamp is 3 | {kind: ..., ...}"),
        ("{kind: constant, offset: -1}", "small.yaml:7 | offset is -1 | 0 or more"),
        ("{kind: random_walk, sd: 0.5, seed: x}", "seed is 'x' | a whole number"),
        ("{kind: flicker, depth: {uniform: [0.5, 1.5]}}", "depth is 1.5 | 0 to 1"),
    ],
)
def test_a_key_that_does_not_fit_is_refused_with_its_line(recipe_of, light, message):
    assert_says(refusal(resolve_recipe, recipe_of(light)), message)
