"""Recipes with too few focus positions for the lens are warned of; those that come along are not."""

import re

import pytest

from saf_gen.core.shipped import find_recipe, recipe_names
from saf_gen.generate.coarse_positions import FEWEST, find_coarse_positions
from saf_gen.generate.resolve import resolve_recipe


@pytest.mark.parametrize("name", recipe_names())
def test_no_recipe_that_comes_along_is_warned_of(name):
    assert find_coarse_positions(resolve_recipe(find_recipe(name))) == []


@pytest.mark.usefixtures("test_scenes")
def test_the_number_that_would_do_does(small_recipe, call):
    """With the number of the line there is no warning; with one fewer there is one still."""
    text = small_recipe.read_text()
    small_recipe.write_text(text.replace("positions: 9", "positions: 2"))
    code, shown, _ = call("recipes", "check", small_recipe)
    assert code == 0
    (line,) = find_coarse_positions(resolve_recipe(small_recipe))
    assert f"warning: {line}" in " ".join(shown.split())
    enough = int(re.search(r"(\d+) would do", line)[1])
    assert float(re.search(r"holds ([\d.]+) of them", line)[1]) < FEWEST
    small_recipe.write_text(text.replace("positions: 9", f"positions: {enough}"))
    assert find_coarse_positions(resolve_recipe(small_recipe)) == []
    small_recipe.write_text(text.replace("positions: 9", f"positions: {enough - 1}"))
    assert len(find_coarse_positions(resolve_recipe(small_recipe))) == 1
