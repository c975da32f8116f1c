"""Roles of lights: one recipe's light fits every scene, and nothing of it is dropped without a line."""

import pytest
from refusals import assert_says, refusal
from small_dataset import HERE, SMALL_RECIPE

from saf_gen.core.shipped import shipped_folder
from saf_gen.generate.draw import SceneFamily, draw_sequences
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.resolve import coarse_sampling, resolve_recipe
from saf_gen.plugins.lights import ROLES, default_roles, group_gains
from saf_gen.scene.scene_folder import Scene, find_scene

SHIPPED = sorted(path.parent.name for path in shipped_folder("scenes").glob("*/scene.yaml"))
RAMP, STEPS, WALK = (
    "{kind: ramp, from: 1, to: 0.5}",
    "{kind: steps, every_s: 0.005, levels: [1, 0.4]}",
    "{kind: random_walk, sd: 0.3}",
)
THREE = {"lamp": "key", "window": "fill", "bulb": "fill", "room": "ambient"}


@pytest.fixture
def recipe_of(tmp_path, test_scenes):
    """Write the small recipe with this text as its only light, and return its path."""

    def write(light, scenes="plane"):
        head, _ = SMALL_RECIPE.split("lights:\n")
        head = head.replace("drive: image_distance, positions: 9", "positions: 65")
        path = tmp_path / "small.yaml"
        path.write_text(f"{head}lights:\n  it: {light}\nsplits:\n  test: {{scenes: [{scenes}], lights: [it]}}\n")
        return path

    return write


def schedule_of(recipe_of, light, roles, **family):
    (sequence,) = draw_sequences(read_recipe(recipe_of(light)), {"plane": SceneFamily(roles=roles, **family)})
    return sequence.schedule


# --- the scenes that come along --------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_every_scene_that_comes_along_states_the_role_of_each_light(name):
    card = find_scene(name).card
    assert set(card.roles) == set(card.lights), "the card states them, so that no one guesses"
    assert list(card.light_roles) == list(card.lights)
    assert "key" in card.light_roles.values()


def test_the_light_of_one_recipe_fits_every_scene_that_comes_along(recipe_of):
    light = f"{{key: {RAMP}, fill: {STEPS}, ambient: {WALK}}}"
    resolved = resolve_recipe(recipe_of(light, ", ".join(SHIPPED)))
    said = "\n".join(line for line in coarse_sampling(resolved) if line.startswith("light "))
    kinds = {"key": "ramp", "fill": "steps", "ambient": "random_walk"}
    for sequence in resolved.sequences:
        card, schedule = sequence.scene.card, sequence.planned.schedule
        assert {group: one["kind"] for group, one in schedule.items()} == {
            group: kinds[role] for group, role in card.light_roles.items()
        }
        for role in ROLES:
            line = next((line for line in said.splitlines() if f"with the role {role}," in line), "")
            named = card.id in line.replace(",", "").split()
            assert named == (role not in card.light_roles.values())


def test_roles_move_no_digest(tmp_path, test_scenes, monkeypatch):
    folder = tmp_path / "plane"
    folder.mkdir()
    for name in ("scene.py", "scene.yaml"):
        (folder / name).write_text((test_scenes / "plane" / name).read_text())
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path))
    before = find_scene("plane")
    with (folder / "scene.yaml").open("a") as card:
        card.write("roles: {lamp: fill, room: key}\n")
    after = find_scene("plane")
    assert isinstance(after, Scene)
    assert after.digest == before.digest
    assert before.card.light_roles == {"lamp": "key", "room": "ambient"}
    assert after.card.light_roles == {"lamp": "fill", "room": "key"}


# --- what a role means -------------------------------------------------------------------------------------


def test_all_groups_of_a_role_follow_one_schedule_and_groups_without_one_stay(recipe_of):
    schedule = schedule_of(recipe_of, f"{{fill: {WALK}, key: {RAMP}}}", THREE)
    assert set(schedule) == {"window", "bulb", "lamp"}
    assert schedule["window"] == schedule["bulb"]
    gains = group_gains(schedule, tuple(THREE), frames=400, readout_hz=20_000)
    assert (gains[:, 1] == gains[:, 2]).all()
    assert len(set(gains[:, 1])) > 10
    assert (gains[:, 3] == 1).all()


def test_a_role_draws_the_same_numbers_whatever_else_the_light_says(recipe_of):
    alone = schedule_of(recipe_of, f"{{fill: {WALK}}}", THREE)
    beside = schedule_of(recipe_of, f"{{ambient: {WALK}, fill: {WALK}}}", THREE)
    assert beside["window"] == alone["window"]
    assert beside["room"]["seed"] != beside["window"]["seed"]


def test_lux_of_a_role_are_those_of_its_groups_together(recipe_of):
    light = "{fill: {kind: constant, level: 150, unit: lux}, key: {kind: constant, level: 150, unit: lux}}"
    lux = {"lamp": 600.0, "window": 200.0, "bulb": 100.0, "room": 50.0}
    gains = group_gains(
        schedule_of(recipe_of, light, THREE, illuminance_lux=lux), tuple(THREE), frames=16, readout_hz=20_000
    )
    assert gains[0].tolist() == [0.25, 0.5, 0.5, 1.0]
    assert gains[0] @ [600, 200, 100, 0] == 300


def test_a_list_and_a_product_may_belong_to_a_role(recipe_of):
    light = f"{{key: [{RAMP}, {STEPS}], fill: {{product: [{RAMP}, {STEPS}]}}}}"
    schedule = schedule_of(recipe_of, light, THREE)
    assert [one["kind"] for one in schedule["lamp"]] == ["ramp", "steps"]
    assert [one["kind"] for one in schedule["bulb"]["product"]] == ["ramp", "steps"]


def test_the_name_of_a_group_comes_before_a_role(recipe_of):
    roles = {"key": "key", "sun": "key", "fill": "fill"}
    schedule = schedule_of(recipe_of, f"{{key: {RAMP}, fill: {STEPS}}}", roles)
    assert set(schedule) == {"key", "fill"}
    groups = tuple(find_scene("low_texture").card.lights)
    assert groups == ("key", "fill")


def test_names_of_groups_draw_what_they_drew_before_roles(recipe_of):
    """A scene whose roles are known, and one of which nothing is known, give the same numbers."""
    light = f"{{lamp: {WALK}, room: {{kind: sine, hz: {{uniform: [1, 9]}}}}}}"
    assert schedule_of(recipe_of, light, THREE) == schedule_of(recipe_of, light, {})


@pytest.mark.parametrize(
    ("groups", "roles"),
    [
        ("lamp", {"lamp": "key"}),
        ("lamp window room", {"lamp": "key", "window": "ambient", "room": "ambient"}),
        ("fill key", {"fill": "fill", "key": "key"}),
        ("fill lamp", {"fill": "fill", "lamp": "key"}),
        ("fill", {"fill": "key"}),
        ("ambient fill", {"ambient": "key", "fill": "fill"}),
    ],
)
def test_a_card_without_roles_has_a_key_all_the_same(groups, roles):
    assert default_roles(groups.split()) == roles


# --- nothing is dropped in silence ---------------------------------------------------------------------------


def test_a_role_that_a_scene_lacks_is_left_out_with_a_line(recipe_of):
    resolved = resolve_recipe(recipe_of(f"{{key: {RAMP}, fill: {STEPS}}}", "plane, camel, low_texture, usaf_target"))
    (line,) = [line for line in coarse_sampling(resolved) if line.startswith("light ")]
    assert line.startswith(
        "light 'it': plane, usaf_target have no light with the role fill, whose schedule is left out"
    )
    assert "saf-gen scenes list" in line
    by_scene = {s.scene.id: set(s.planned.schedule) for s in resolved.sequences}
    assert by_scene == {
        "plane": {"lamp"}, "camel": {"lamp", "window"}, "low_texture": {"key", "fill"}, "usaf_target": {"lamp"},
    }  # fmt: skip


@pytest.mark.parametrize("command", ["recipes check", "generate --dry-run"])
def test_the_line_is_printed_before_anything_is_made(recipe_of, command, call, tmp_path):
    path = recipe_of(f"{{key: {RAMP}, fill: {STEPS}}}")
    out = ["--out", str(tmp_path / "made")] if "generate" in command else []
    code, told, err = call(*command.split(), str(path), *out)
    assert code == 0
    assert "light 'it': plane has no light with the role fill" in " ".join((told + err).split())


@pytest.mark.parametrize(
    ("light", "message"),
    [
        (f"{{fill: {RAMP}}}", "'it' on plane | no light with the role fill, so nothing would change | key: {kind: con"),
        (f"{{lamp: {RAMP}, key: {STEPS}}}", "'lamp' has two schedules | that of lamp and that of key | remove one"),
        (f"{{key: {STEPS}, lamp: {RAMP}}}", "'lamp' has two schedules | that of key and that of lamp"),
        (f"{{room: {RAMP}, ambient: {STEPS}}}", "'room' has two schedules | that of room and that of ambient"),
        (f"{{kee: {RAMP}}}", "no light group 'kee' | lamp, room, or a role: key, fill, ambient | mean 'key'"),
        (f"{{Key: {RAMP}}}", "no light group 'Key' | mean 'key'"),
        (f"{{ambiant: {RAMP}, key: {RAMP}}}", "no light group 'ambiant' | mean 'ambient' | saf-gen scenes list"),
        (f"{{lamb: {RAMP}}}", "no light group 'lamb' | mean 'lamp'"),
        ("{key: ramp}", "light group 'key' has no kind"),
        ("{key: {level: 1}}", "light group 'key' has no kind"),
        ("{key: {kind: flickr}}", "small.yaml:7 | 'flickr' | mean 'flicker'"),
        ("{key: []}", "a list of schedules is []"),
    ],
)
def test_what_no_scene_can_follow_is_refused_in_one_line(recipe_of, light, message):
    assert_says(refusal(resolve_recipe, recipe_of(light)), message)


@pytest.mark.parametrize(
    ("roles", "message"),
    [
        ("{lamp: key}", "the light group 'room' has no role | a role for each of lamp, room | or no roles"),
        ("{lamp: fill, room: ambient}", "no light group has the role 'key' | main light"),
        ("{lamp: key, room: ambiant}", "ambient"),
        ("{lamp: Key, room: ambient}", "key"),
        ("{lamp: key, room: [fill, ambient]}", "roles"),
        ("{lamp: key, rom: ambient}", "group of roles: 'rom' | mean 'room'"),
        ("{lamp: key, room: ambient, sky: fill}", "group of roles: 'sky'"),
        ("[key, ambient]", "roles"),
        ("{key: lamp, ambient: room}", "roles"),
    ],
)
def test_roles_that_do_not_fit_the_groups_are_refused_in_one_line(tmp_path, monkeypatch, roles, message):
    folder = tmp_path / "plane"
    folder.mkdir()
    (folder / "scene.py").write_text("")
    card = (HERE / "scenes" / "plane" / "scene.yaml").read_text()
    (folder / "scene.yaml").write_text(card + f"roles: {roles}\n")
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path))
    error = refusal(find_scene, "plane")
    assert_says(error, message)
    assert "scene.yaml:" in str(error)


def test_a_group_that_is_called_like_a_role_has_it(tmp_path, monkeypatch):
    folder = tmp_path / "plane"
    folder.mkdir()
    (folder / "scene.py").write_text("")
    card = (HERE / "scenes" / "plane" / "scene.yaml").read_text().replace("  lamp:", "  fill:")
    (folder / "scene.yaml").write_text(card + "roles: {fill: key, room: ambient}\n")
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path))
    assert_says(refusal(find_scene, "plane"), "the light group 'fill' has the role 'key' | fill, as its name says")
