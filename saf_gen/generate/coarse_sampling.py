"""Recipes that sample focus or time more coarsely than their scenes need: pictures between two samples are mixed."""

import math

import numpy as np

from saf_gen.generate.resolve import ResolvedRecipe

FEWEST = 2.0
"""Positions within a depth of focus. Between two of them pictures are mixed: with two in a depth of focus, one of both
is always within a quarter of it. Recipes that come with saf_gen have 3.6 to 10.5."""


def find_coarse_recipe_sampling(resolved: ResolvedRecipe) -> list[str]:
    """Return a line for each scene with too few focus positions, and for each with fewer time slices than its card."""
    return [*_find_coarse_positions(resolved), *_find_coarse_slices(resolved)]


def _find_coarse_positions(resolved: ResolvedRecipe) -> list[str]:
    """Return a line for each scene whose depth of focus, in the middle of the travel, holds too few positions."""
    lines = []
    scenes = {sequence.scene.id: sequence.time_stack.specs[0] for sequence in resolved.sequences}
    for name, spec in scenes.items():
        depth = np.array([float(spec.drive.focus_depth(0.5))])
        low, high = spec.drive.depth_of_focus(depth, spec.pitch_m, wavelength_m=spec.wavelength_m)
        held = (high - low) * (spec.positions - 1)
        if held < FEWEST:
            enough = math.ceil(FEWEST / (high - low)) + 1
            lines.append(
                f"focus.positions is {spec.positions}: the depth of focus of {name} holds {held:.1f} of them, "
                f"and focus curves show the steps between; {enough} would do"
            )
    return lines


def _find_coarse_slices(resolved: ResolvedRecipe) -> list[str]:
    """Return a line for each moving scene that the recipe gives fewer time slices per second than its card does."""
    given = resolved.recipe.render.slices_per_s
    moving = {s.scene.id: s.scene.card for s in resolved.sequences if s.time_stack.is_moving}
    lines = []
    for name, card in moving.items():
        if given is None or card.slices_per_s is None or given >= card.slices_per_s:
            continue
        error = card.estimate_interpolation_error(given)
        lines.append(
            f"render.slices_per_s is {given:g}: half way between two slices {name} shows both of them"
            + ("" if error is None else f", with an error of about {error:.2g} of the mean brightness")
            + f"; its card has {card.slices_per_s:g}"
            + ("" if error is None else f", for an error of {card.interpolation_error:g}")
        )
    return lines
