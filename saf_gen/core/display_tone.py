"""Linear light as grey values for a screen."""

import numpy as np

WHITE_QUANTILE = 0.995
"""So many of the pixels are below white, so that a glint does not darken the rest."""
GAMMA = 2.2


def find_display_white_level(*images: np.ndarray, quantile: float = WHITE_QUANTILE) -> float:
    """Return the light to show as white in all of these images, above 0; 1 where all are dark."""
    brightest = max(float(np.quantile(image, quantile)) for image in images)
    return brightest if brightest > 0 else 1.0


def apply_display_gamma(image: np.ndarray, white: float) -> np.ndarray:
    """Return linear light as grey values 0...1, encoded with a gamma of 2.2; what is brighter than white is white."""
    shown: np.ndarray = np.clip(image / white, 0, 1) ** (1 / GAMMA)
    return shown
