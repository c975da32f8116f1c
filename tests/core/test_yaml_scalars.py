"""Numbers and booleans of YAML are what both of its versions say, or they are refused with what to write."""

import math

import pytest
from refusals import refusal

from saf_gen.core.config.yaml_document import parse_yaml

READ = {
    "1": 1, "-3": -3, "+7": 7, "0": 0, "1_000": 1000, "0x1F": 31, "0o17": 15, "1.5": 1.5, "1e2": 100.0, "1E-3": 0.001,
    "-.5e1": -5.0, "2.": 2.0, "1e+300": 1e300, ".inf": math.inf, "-.inf": -math.inf, "true": True, "FALSE": False,
    "null": None, "~": None, "": None, "2024-01-01": "2024-01-01", "1.2.3": "1.2.3", "camel": "camel", "'yes'": "yes",
    '"010"': "010", "'12:30'": "12:30", "a:b": "a:b", "y": "y", "0.10": 0.1, "00.5": 0.5, "=": "=",
}  # fmt: skip
REFUSED = {
    **dict.fromkeys(("yes", "No", "ON", "off"), "write true or false"),
    "010": "without the leading 0", "-007": "without the leading 0", "089": "without the leading 0",
    "12:30": "write seconds", "1:30:00": "write seconds", "1:30.5": "write seconds",
}  # fmt: skip


@pytest.mark.parametrize(("text", "value"), READ.items(), ids=[text or "nothing" for text in READ])
def test_a_value_is_read_by_the_rules_of_yaml_1_2(text, value):
    for document in (f"a: {text}", f"a: [{text}]" if text else "a: [~]"):
        found = parse_yaml(document, "x.yaml").data["a"]
        found = found[0] if isinstance(found, list) else found
        assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(("text", "hint"), REFUSED.items(), ids=REFUSED)
def test_a_value_that_two_versions_of_yaml_read_otherwise_is_refused(text, hint):
    for document in (f"b: 1\na: {text}", f"b: 1\na: [1, {text}]"):
        error = refusal(parse_yaml, document, "x.yaml")
        assert error.where == "x.yaml:2"
        assert hint in error.hint


def test_a_merge_key_is_refused_as_such():
    error = refusal(parse_yaml, "a: &x {b: 1}\nc:\n  <<: *x\n", "x.yaml")
    assert (error.problem, error.where) == ("the merge key << is not read", "x.yaml:3")
    assert parse_yaml("'<<': 1", "x.yaml").data == {"<<": 1}


RECIPE = """\
name: t
seed: 7
camera: {sensor: vidar_400x250, frames: 400, exposure: {mean_rate: 0.2}}
focus: {drive: image_distance, positions: 65, motion: {kind: sweep}}
render: {samples: 16}
lights:
  a: {kind: sine, hz: 100}
  b: {kind: steps, every_s: 0.01, levels: [1.0, 2.0]}
splits:
  test: {scenes: [usaf_target], lights: [a], repeats: 1}
"""
CHANGES = {
    "number as text": ("hz: 100", 'hz: "100"', "7: light schedule 'sine': hz is '100' | a number | without quotes"),
    "number as flag": ("hz: 100", "hz: true", "7: light schedule 'sine': hz is True | a number"),
    "list with a flag": ("[1.0, 2.0]", "[1.0, true]", "8: light schedule 'steps': levels is [1.0, True] | numbers"),
    "list with text": ("[1.0, 2.0]", "[1.0, two]", "8: light schedule 'steps': levels is [1.0, 'two'] | numbers"),
    "seed as flag": ("seed: 7", "seed: true", "2: seed is True | not true or false"),
    "samples as flag": ("samples: 16", "samples: false", "5: render.samples is False | not true or false"),
    "range with text": ("0.2}", "{uniform: [0.5, a]}}", "3: camera.exposure is | [low, high] with low < high"),
    "range upside down": ("0.2}", "{uniform: [0.5, 0.2]}}", "3: camera.exposure is | [low, high] with low < high"),
    "range of one": ("hz: 100", "hz: {uniform: [1]}", "7: uniform is [1] | [low, high]"),
    "list for a number": ("repeats: 1", "repeats: [1]", "10: splits.test.repeats is [1]"),
}


@pytest.mark.parametrize(("old", "new", "message"), CHANGES.values(), ids=CHANGES)
def test_a_recipe_with_another_kind_of_value_is_refused_at_its_line(tmp_path, call, old, new, message):
    assert old in RECIPE
    (tmp_path / "r.yaml").write_text(RECIPE.replace(old, new))
    code, _, err = call("recipes", "check", tmp_path / "r.yaml")
    assert code == 2, err
    line, *words = message.split(" | ")
    assert f"r.yaml:{line}" in err
    assert all(word in err for word in words), err


def test_a_number_with_an_exponent_is_a_number(tmp_path, call):
    (tmp_path / "r.yaml").write_text(RECIPE.replace("hz: 100", "hz: 1e2").replace("frames: 400", "frames: 4e2"))
    (tmp_path / "plain.yaml").write_text(RECIPE.replace("hz: 100", "hz: 100.0"))
    digests = {call("recipes", "check", tmp_path / name)[1].split("digest")[1] for name in ("r.yaml", "plain.yaml")}
    assert len(digests) == 1
