"""Conversion of linear light to grey values for a screen."""

import numpy as np

WHITE_QUANTILE = 0.995
"""Fraction of the pixels below the white level, so that a glint does not darken the rest of the image."""
GAMMA = 2.2


def white_level(*images: np.ndarray, quantile: float = WHITE_QUANTILE) -> float:
    """Return the amount of light to show as white in all of these images, above 0; 1 if all of them are dark."""
    brightest = max(float(np.quantile(image, quantile)) for image in images)
    return brightest if brightest > 0 else 1.0


def display_gamma(image: np.ndarray, white: float) -> np.ndarray:
    """Return linear light as grey values, 0 to 1, encoded with a gamma of 2.2; light above ``white`` is clipped."""
    shown: np.ndarray = np.clip(image / white, 0, 1) ** (1 / GAMMA)
    return shown
