"""Recipes whose focus positions are too far apart for the lens: focus curves would show the steps between them."""

import math

import numpy as np

from saf_gen.generate.resolve import ResolvedRecipe

FEWEST = 2.0
"""Positions within a depth of focus. Between two of them pictures are mixed: with two in a depth of focus, one of both
is always within a quarter of it. Recipes that come with saf_gen have 3.6 to 10.5."""


def find_coarse_positions(resolved: ResolvedRecipe) -> list[str]:
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
