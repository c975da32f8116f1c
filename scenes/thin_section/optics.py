"""Light through a crystal plate between crossed polarisers, as the eye weighs it."""

from __future__ import annotations

import numpy as np

POLARISERS = 0.36  # of unpolarised light through two parallel ones
LEAK = 0.002  # of what stays dark
LAMP_K = 5000.0  # halogen behind a blue filter
STEP_NM, LARGEST_NM = 2.0, 7000.0


def shares() -> np.ndarray:
    """The mean of sin²(π Γ/λ) over the visible band, for retardations Γ of 0, 2, 4, … nm.

    The weights are a Gaussian near the CIE's photopic luminosity (555 nm, standard deviation 42 nm) times a
    black body of 5000 K.
    """
    wave = np.arange(420.0, 700.0, 4.0)
    planck = wave**-5 / np.expm1(1.4388e7 / (wave * LAMP_K))
    weight = planck * np.exp(-0.5 * ((wave - 555.0) / 42.0) ** 2)
    gamma = np.arange(0.0, LARGEST_NM, STEP_NM)
    return np.sin(np.pi * gamma[:, None] / wave) ** 2 @ (weight / weight.sum())


def transmittance(retardation_nm: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Share of unpolarised light that passes polariser, plate and analyser.

    ``turn`` (rad) is the angle from the polariser to a direction of vibration in the plate.
    """
    table = shares()
    at = np.minimum((retardation_nm / STEP_NM + 0.5).astype(np.int32), table.size - 1)
    return LEAK + POLARISERS * np.sin(2 * turn) ** 2 * table[at]
