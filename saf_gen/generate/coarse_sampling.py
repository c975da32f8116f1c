"""Warnings about recipes that sample focus or time too coarsely; pictures between two samples are interpolated."""

import math

import numpy as np

from saf_gen.generate.resolve import ResolvedRecipe

MIN_POSITIONS = 2.0
"""Minimum number of focus positions per depth of focus; with two, there is always one within a quarter of the depth of
focus. Recipes that come with saf_gen have 3.6 to 10.5."""


def coarse_sampling(resolved: ResolvedRecipe) -> list[str]:
    """Return a line for each scene with too few focus positions, or with fewer time slices than its card states."""
    return [*_find_coarse_positions(resolved), *_find_coarse_slices(resolved)]


def _find_coarse_positions(resolved: ResolvedRecipe) -> list[str]:
    """Return a line for each scene with too few positions in the depth of focus at the middle of the travel."""
    lines = []
    scenes = {sequence.scene.id: sequence.time_stack.specs[0] for sequence in resolved.sequences}
    for name, spec in scenes.items():
        depth = np.array([float(spec.drive.focus_depth(0.5))])
        low, high = spec.drive.depth_of_focus(depth, spec.pitch_m, wavelength_m=spec.wavelength_m)
        count = (high - low) * (spec.positions - 1)
        if count < MIN_POSITIONS:
            enough = math.ceil(MIN_POSITIONS / (high - low)) + 1
            lines.append(
                f"focus.positions is {spec.positions}: the depth of focus of {name} contains only {count:.1f} of them, "
                f"so focus curves show steps; use {enough} or more"
            )
    return lines


def _find_coarse_slices(resolved: ResolvedRecipe) -> list[str]:
    """Return a line for each moving scene with fewer time slices per second in the recipe than on its card."""
    rate = resolved.recipe.render.slices_per_s
    moving = {s.scene.id: s.scene.card for s in resolved.sequences if s.time_stack.is_moving}
    lines = []
    for name, card in moving.items():
        if rate is None or card.slices_per_s is None or rate >= card.slices_per_s:
            continue
        error = card.estimate_interpolation_error(rate)
        lines.append(
            f"render.slices_per_s is {rate:g}: half way between two time slices {name} is shown as a mixture of both"
            + ("" if error is None else f", with an error of about {error:.2g} of the mean brightness")
            + f"; its card states {card.slices_per_s:g}"
            + ("" if error is None else f", for an error of {card.interpolation_error:g}")
        )
    return lines
