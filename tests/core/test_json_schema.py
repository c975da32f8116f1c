"""JSON Schemas of recipes and scene cards accept and refuse the same documents as the models."""

from copy import deepcopy

import jsonschema
import pytest
import yaml
from small_dataset import HERE, SCENES

from saf_gen.core.config.field_docs import field_docs
from saf_gen.generate.recipe import Recipe, recipe_schema
from saf_gen.scene.card_schema import card_schema
from saf_gen.scene.scene_folder import SceneCard

ROOT = HERE.parent
RECIPES = sorted((ROOT / "recipes").glob("*.yaml"))
CARDS = sorted([*(ROOT / "scenes").glob("*/scene.yaml"), *SCENES.glob("*/scene.yaml")])
RECIPE = yaml.safe_load((ROOT / "recipes/quickstart.yaml").read_text())
CARD = yaml.safe_load((ROOT / "scenes/camel/scene.yaml").read_text())


@pytest.fixture(scope="module")
def validators():
    schemas = {"recipe": recipe_schema(), "card": card_schema()}
    for schema in schemas.values():
        jsonschema.Draft202012Validator.check_schema(schema)
    return {name: jsonschema.Draft202012Validator(schema) for name, schema in schemas.items()}


@pytest.mark.slow
def test_every_recipe_and_card_of_the_project_is_accepted(validators):
    for kind, paths in (("recipe", RECIPES), ("card", CARDS)):
        for path in paths:
            assert [e.message for e in validators[kind].iter_errors(yaml.safe_load(path.read_text()))] == [], path


def changed(document, keys, value):
    """Return the document with one value replaced or added."""
    copy = deepcopy(document)
    inner = copy
    for key in keys[:-1]:
        inner = inner.setdefault(key, {}) if isinstance(inner, dict) else inner[key]
    inner[keys[-1]] = value
    return copy


GIVEN = {"id": "weave", "title": "Cloth", "licence": "CC0-1.0", "source": "own", "pictures": {}}


@pytest.mark.parametrize(
    ("keys", "value", "accepted"),
    [
        (("title",), "A piece of cloth", True),
        (("pictures",), {"step_um": 2.5, "box": [80, 50, 160, 100]}, True),
        (("pictures", "step_mm"), 2.5, False),
        (("pictures", "step_um"), 0, False),
        (("pictures", "box"), [1, 2, 3], False),
        (("colour",), 1, False),
    ],
    ids=str,
)
def test_a_card_of_given_pictures_needs_neither_lens_nor_lights(keys, value, accepted, validators):
    assert validators["card"].is_valid(changed(GIVEN, keys, value)) == accepted


def test_a_card_of_what_is_rendered_needs_lens_camera_lights_and_target(validators):
    for key in ("lens", "camera", "lights", "target"):
        assert not validators["card"].is_valid({k: v for k, v in CARD.items() if k != key})


def test_a_recipe_of_scenes_needs_focus_and_render(validators):
    for key in ("focus", "render"):
        assert not validators["recipe"].is_valid({k: v for k, v in RECIPE.items() if k != key})


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("lights", "one"), {"kind": "flicker", "depth": {"uniform": [0.2, 0.9]}, "hz": 120, "offset": 0.1}),
        (("lights", "one"), {"lamp": {"kind": "ramp", "from": 0.5, "to": 2}, "room": {"kind": "constant"}}),
        (("lights", "one"), {"choice": [{"kind": "constant"}, {"kind": "pwm", "hz": 1000, "duty": 0.5}]}),
        (("lights", "one"), {"product": [{"kind": "constant"}, {"kind": "sine", "hz": 100}], "offset": 0.1}),
        (("lights", "one"), {"key": {"product": [{"kind": "constant"}, {"choice": [{"kind": "constant"}]}]}}),
        (("lights", "one"), {"choice": [{"product": [{"kind": "constant"}, {"kind": "constant"}]}]}),
        (("lights", "one"), [{"product": [{"kind": "constant"}, {"kind": "constant"}]}, {"kind": "constant"}]),
        (("focus", "motion"), {"kind": "hand", "reversals": True}),
        (("camera", "exposure"), {"absolute": True, "f_number": 2.8}),
        (("render", "whole_slices"), 0.25),
        (("scene_params",), {"usaf_target": {"tilt_deg": {"choice": [0, 1]}, "name": "a"}}),
    ],
    ids=str,
)
def test_what_a_recipe_may_say_is_accepted(keys, value, validators):
    assert [e.message for e in validators["recipe"].iter_errors(changed(RECIPE, keys, value))] == []


@pytest.mark.parametrize(
    ("kind", "keys", "value"),
    [
        ("recipe", ("colour",), 1),
        ("recipe", ("camera", "framse"), 100),
        ("recipe", ("camera", "frames"), 8),
        ("recipe", ("camera", "exposure", "mean_rate"), 1.5),
        ("recipe", ("focus", "drive"), "image"),
        ("recipe", ("focus", "motion"), {"kind": "hold"}),
        ("recipe", ("lights", "one"), {"kind": "ramp", "from": 1}),
        ("recipe", ("lights", "one"), {"kind": "constant", "levle": 1}),
        ("recipe", ("lights", "one"), {"kind": "sine", "hz": {"uniform": [1]}}),
        ("recipe", ("lights", "one"), {"product": [{"kind": "constant"}]}),
        ("recipe", ("lights", "one"), {"product": [{"kind": "constant"}, {"product": [{"kind": "constant"}] * 2}]}),
        ("recipe", ("lights", "one"), {"product": [{"kind": "constant"}] * 2, "ofset": 0.1}),
        ("recipe", ("lights", "one"), {"product": [{"kind": "constant"}] * 2, "kind": "constant"}),
        ("card", ("roles",), {"lamp": "keys"}),
        ("card", ("lens", "f_number"), 0.2),
        ("card", ("lens", "drive"), "stage"),
        ("card", ("camera", "origin_m"), [0, 1]),
        ("card", ("target",), []),
        ("card", ("motion",), {"camel": {"keyframes": [{"time_s": 0}]}}),
    ],
    ids=str,
)
def test_a_mistake_is_refused(kind, keys, value, validators):
    document = {"recipe": RECIPE, "card": CARD}[kind]
    assert validators[kind].is_valid(document)
    assert not validators[kind].is_valid(changed(document, keys, value))


def test_the_docstring_below_a_field_is_found_and_its_bases_come_first():
    class Base:
        one: int
        """What one is,
        over two lines."""
        two: int = 2

    class Derived(Base):
        three: str = "3"
        """What three is."""

    assert field_docs(Derived) == {"one": "What one is, over two lines.", "three": "What three is."}
    assert set(field_docs(Recipe)) <= set(Recipe.model_fields)
    assert set(field_docs(SceneCard)) <= set(SceneCard.model_fields)
