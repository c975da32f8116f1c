"""A travel poster as a printed card: sun, peaks, a viaduct with a train, and lettering."""

from __future__ import annotations

import numpy as np
from broad_pen import stamp, word
from patterns import cloudy, noise

WIDTH_MM, HEIGHT_MM = 60.0, 76.0
PAPER, INK = 0.82, 0.05
PANEL_MM = 18.0  # height of the lettering's field
NAMES = ("SUMMIT LINE", "LAKE EXPRESS", "NORTH PASS", "HIGH VALLEY", "GLACIER WAY", "RIVER ROUTE")


def poster(texel_mm: float, random: np.random.Generator) -> np.ndarray:
    """Reflectance of the card's face, float32 (row, col); the top row first."""
    shape = round(HEIGHT_MM / texel_mm), round(WIDTH_MM / texel_mm)
    up = HEIGHT_MM - (np.arange(shape[0], dtype=np.float32)[:, None] + 0.5) * texel_mm
    x = (np.arange(shape[1], dtype=np.float32) + 0.5) * texel_mm
    grey = _sky(x, up, random)
    for base, rough, tone, snow in ((48, 12, 0.46, True), (40, 8, 0.27, False), (31, 5, 0.15, False)):
        _ridge(grey, x, up, base, rough, tone, snow, random)
    _viaduct(grey, x, up, random)
    _firs(grey, x, up, random)
    _lettering(grey, up, texel_mm, random)
    margin = (np.minimum(x, WIDTH_MM - x) < 2.4) | (np.minimum(up, HEIGHT_MM - up) < 2.4)
    grey = np.where(margin, np.float32(PAPER), grey)
    # Lithographic crayon: a coarse tooth that shows in the half tones, and foxed paper.
    tooth = noise(shape, (HEIGHT_MM / 0.45, WIDTH_MM / 0.45), random)
    grey = grey + 0.5 * tooth * np.clip(grey - INK, 0, 1) * np.clip(PAPER - grey, 0, 1)
    return np.clip(grey * (1 + 0.05 * cloudy(shape, 5, 3, random)), 0.03, 0.9).astype(np.float32)


def _sky(x: np.ndarray, up: np.ndarray, random: np.random.Generator) -> np.ndarray:
    at = (random.uniform(16, 44), random.uniform(50, 55))
    angle, away = np.arctan2(up - at[1], x - at[0]), np.hypot(x - at[0], up - at[1])
    rays = np.clip(np.sin(angle * int(random.integers(11, 17))) * away * 0.7 + 0.5, 0, 1)
    grey = 0.50 + 0.22 * rays - 0.0025 * (up - 40)
    return np.where(away < 7.5, np.float32(0.85), np.where(away < 8.2, np.float32(0.2), grey))


def _profile(x: np.ndarray, step_mm: float, random: np.random.Generator) -> np.ndarray:
    """A broken mountain line, about -1..1: midpoints between random heights, coarse to fine."""
    line, size = np.zeros_like(x), 1.0
    while step_mm > 0.6:
        knots = np.arange(0, WIDTH_MM + 2 * step_mm, step_mm) - random.uniform(0, step_mm)
        line += size * np.interp(x, knots, random.uniform(-1, 1, len(knots))).astype(np.float32)
        step_mm, size = step_mm / 2, size / 2
    return line


def _ridge(grey, x, up, base, rough, tone, snow, random) -> None:
    line = base + rough * 0.6 * _profile(x, 15.0, random)
    below = up < line
    # Light from one side: gullies run down from the crest, broken by rough ground.
    slope = np.sin(1.5 * x + 0.9 * (line - up)) + 1.4 * noise(grey.shape, (26, 20), random)
    grey[below] = (tone * (1 + 0.22 * np.sign(slope)))[below]
    if snow:
        cap = below & (up > 50 + 4 * _profile(x, 6.0, random))
        grey[cap] = 0.80
        grey[cap & (slope > 0.9)] = 0.55
    grey[np.abs(up - line) < 0.22] = 0.07


def _viaduct(grey, x, up, random) -> None:
    deck = 29.0
    pier = np.abs((x + random.uniform(0, 9)) % 9.0 - 4.5)
    arch = (pier < 3.4) & (up < deck - 5.5 + np.sqrt(np.clip(3.4**2 - pier**2, 0, None)))
    wall = (up < deck) & (up > 12)
    grey[wall & ~arch] = 0.62
    stones = ((up % 1.3) < 0.16) | (((x + 1.1 * (np.floor(up / 1.3) % 2)) % 2.2) < 0.16)
    grey[wall & ~arch & stones] = 0.28
    grey[(np.abs(up - deck) < 0.5) & (x > 0)] = 0.10
    first = random.uniform(6, 24)
    for car in range(4):
        left = first + 8.6 * car
        body = (x > left) & (x < left + 8.0) & (up > deck + 0.9) & (up < deck + 4.6)
        grey[body] = 0.78 if car else 0.10
        window = ((x - left) % 1.9 > 0.6) & (up > deck + 2.4) & (up < deck + 3.8) & (x < left + 7.6)
        grey[body & window] = 0.06 if car else 0.7
        grey[(car == 0) & (np.abs(x - left - 1.6) < 0.7) & (np.abs(up - deck - 5.2) < 1.1)] = 0.08
        for wheel in (1.5, 6.5):
            grey[np.hypot(x - left - wheel, up - deck - 0.9) < 0.62] = 0.05


def _firs(grey, x, up, random) -> None:
    for left in np.arange(-1.0, WIDTH_MM, 2.3):
        foot, height = 16 + random.uniform(-2, 1), random.uniform(4, 11)
        share = np.clip((up - foot) / height, 0, 1)
        half = (1 - share) * height * 0.24 * (0.6 + 0.4 * np.mod(-share * 5, 1))
        grey[(np.abs(x - left - random.uniform(-0.8, 0.8)) < half) & (up > foot - 3)] = 0.06


def _lettering(grey, up, texel_mm, random) -> None:
    grey[(up < PANEL_MM)[:, 0]] = 0.10
    grey[(np.abs(up - PANEL_MM + 1.0) < 0.18)[:, 0]] = 0.75

    def line(text, height_mm, up_mm, tone, **face):
        ink = word(text, height_mm / texel_mm, **face)
        fit = (WIDTH_MM - 8) / texel_mm / ink.shape[1]
        if fit < 1:
            ink = word(text, height_mm / texel_mm * fit, **face)
        stamp(grey, ink, (HEIGHT_MM - up_mm) / texel_mm, WIDTH_MM / 2 / texel_mm, tone)

    line(NAMES[int(random.integers(len(NAMES)))], 6.0, 12.2, 0.82, pen=0.2, contrast=2.2)
    hour, minute = random.integers(6, 22), random.integers(0, 60)
    line(f"DAILY AT {hour}.{minute:02d} - ALL STATIONS", 1.9, 7.2, 0.74)
    line(f"TICKETS AT COUNTER {random.integers(1, 30)} - No {random.integers(10000, 99999)}".upper(), 1.3, 4.6, 0.62)
