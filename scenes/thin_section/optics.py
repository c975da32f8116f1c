"""Light through a crystal plate behind a polariser, with or without an analyser, as the eye weighs it."""

from __future__ import annotations

import numpy as np

PARALLEL = 0.36  # of unpolarised light through two parallel polarisers
SINGLE = 0.42  # through one
LEAK = 0.002  # of what stays dark
LAMP_K = 5000.0  # halogen behind a blue filter
STEP_NM, LARGEST_NM = 4.0, 9000.0


def shares() -> np.ndarray:
    """The mean of sin²(π Γ/λ) over the visible band, for retardations Γ of 0, 4, 8, … nm.

    The weights are a Gaussian near the CIE's photopic luminosity (555 nm, standard deviation 42 nm) times a
    black body of 5000 K.
    """
    wave = np.arange(420.0, 700.0, 4.0)
    planck = wave**-5 / np.expm1(1.4388e7 / (wave * LAMP_K))
    weight = planck * np.exp(-0.5 * ((wave - 555.0) / 42.0) ** 2)
    gamma = np.arange(0.0, LARGEST_NM, STEP_NM)
    return np.sin(np.pi * gamma[:, None] / wave) ** 2 @ (weight / weight.sum())


def interference(retardation_nm: np.ndarray) -> np.ndarray:
    """The share of a crystal plate at 45 degrees between crossed polarisers, linear between values."""
    table = shares().astype(np.float32)
    at = np.clip(retardation_nm / np.float32(STEP_NM), 0, table.size - 1.001)
    low = at.astype(np.int32)
    share = table[low]
    return share + (at - low) * (table[low + 1] - share)
