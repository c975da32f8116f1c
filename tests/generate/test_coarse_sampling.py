"""Warnings about recipes with too few focus positions or time slices; test_recipe.py: shipped ones cause none."""

import re

import capture_dataset
import pytest

from saf_gen.generate.resolve import MIN_POSITIONS, coarse_sampling, resolve_recipe


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
