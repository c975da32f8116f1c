"""Recipes with too few focus positions, or time slices, are warned of; those that come along are not."""

import re

import capture_dataset
import pytest

from saf_gen.generate.coarse_sampling import FEWEST, find_coarse_recipe_sampling
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.shipped_recipes import find_recipe, recipe_names


@pytest.mark.parametrize("name", recipe_names())
def test_no_recipe_that_comes_along_is_warned_of(name):
    assert find_coarse_recipe_sampling(resolve_recipe(find_recipe(name))) == []


@pytest.mark.usefixtures("test_scenes")
def test_the_number_that_would_do_does(small_recipe, call):
    """With the number of the line there is no warning; with one fewer there is one still."""
    text = small_recipe.read_text()
    small_recipe.write_text(text.replace("positions: 9", "positions: 2"))
    code, shown, _ = call("recipes", "check", small_recipe)
    assert code == 0
    (line,) = find_coarse_recipe_sampling(resolve_recipe(small_recipe))
    assert f"warning: {line}" in " ".join(shown.split())
    enough = int(re.search(r"(\d+) would do", line)[1])
    assert float(re.search(r"holds ([\d.]+) of them", line)[1]) < FEWEST
    small_recipe.write_text(text.replace("positions: 9", f"positions: {enough}"))
    assert find_coarse_recipe_sampling(resolve_recipe(small_recipe)) == []
    small_recipe.write_text(text.replace("positions: 9", f"positions: {enough - 1}"))
    assert len(find_coarse_recipe_sampling(resolve_recipe(small_recipe))) == 1


def test_fewer_time_slices_than_the_card_has_are_warned_of_with_the_error_to_expect(tmp_path, monkeypatch, call):
    """Where slices are four times as far apart an edge's error is eight times as large; a scene at rest needs none."""
    card = capture_dataset.write_moving_plane(tmp_path, monkeypatch) / "scene.yaml"
    card.write_text(card.read_text() + "interpolation_error: 0.02\n")
    recipe = tmp_path / "takes.yaml"

    def lines(slices_per_s, moves="static, dynamic"):
        text = capture_dataset.RECIPE.replace("whole_slices: true", f"slices_per_s: {slices_per_s}")
        recipe.write_text(text.replace("static, dynamic", moves))
        return find_coarse_recipe_sampling(resolve_recipe(recipe))

    assert lines(250) == lines(1000) == lines(62.5, moves="static") == []
    (line,) = lines(62.5)
    assert line == (
        "render.slices_per_s is 62.5: half way between two slices plane shows both of them, with an error of about "
        "0.16 of the mean brightness; its card has 250, for an error of 0.02"
    )
    code, _, told = call("generate", recipe, "--dry-run")
    assert code == 0
    assert f"warning: {line}" in " ".join(told.split())
    card.write_text(card.read_text().replace("interpolation_error: 0.02\n", ""))
    assert lines(62.5) == [
        "render.slices_per_s is 62.5: half way between two slices plane shows both of them; its card has 250"
    ]
