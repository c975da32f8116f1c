"""Blur and focus breathing of an edge that each drive sweeps through focus, compared with the thin lens."""

from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from saf_gen.acceptance.validation.check import Curve, Finding, Plot
from saf_gen.acceptance.validation.inference import compare_mean_with_law
from saf_gen.acceptance.validation.workload import DatasetMaker, MadeDataset, Workload, workload_sensor_with_noise
from saf_gen.acceptance.validation.written_scenes import glowing_edge_of_workload

DEPTH_M, EDGE_M, F_NUMBER = 0.5, 0.006, 1.4
DRIVES: dict[str, dict[str, Any]] = {
    "image_distance": {"focal_length_mm": 25.0, "focus_range_m": [0.7, 0.39]},
    "focal_length": {"image_distance_mm": 26.316, "focus_range_m": [0.7, 0.39]},
    "stage": {"focal_length_mm": 25.0, "magnification": 1 / 19, "travel_m": [-0.1, 0.1]},
}
"""Lens keys by drive; every lens can focus at 0.5 m (the stage has its fixed plane of focus there)."""
STOPS = (0.04, 0.15, 0.25, 0.8, 0.88, 0.96)
POSITIONS, FRAMES = 65, 8000


def lens_by_law(drive: str, position: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return image distance v, object distance u and stage motion z at each position, and aperture radius R, in metres.

    z is the distance by which the stage has moved the scene towards the lens. docs/explanation/physics.md has the
    formulas.
    """
    keys, p = DRIVES[drive], np.asarray(position, np.float64)
    if drive == "image_distance":
        focal = keys["focal_length_mm"] / 1000
        ends = [focal * u / (u - focal) for u in keys["focus_range_m"]]
        v = ends[0] + (ends[1] - ends[0]) * p
        return v, focal * v / (v - focal), np.zeros_like(p), focal / (2 * F_NUMBER)
    if drive == "focal_length":
        v = np.full_like(p, keys["image_distance_mm"] / 1000)
        near, far = (1 / u for u in keys["focus_range_m"])
        return v, 1 / (near + (far - near) * p), np.zeros_like(p), float(v.flat[0]) / (2 * F_NUMBER)
    focal, scale = keys["focal_length_mm"] / 1000, keys["magnification"]
    first, last = keys["travel_m"]
    v, u = np.full_like(p, focal * (1 + scale)), np.full_like(p, focal * (1 + 1 / scale))
    return v, u, first + (last - first) * p, focal / (2 * F_NUMBER)


def _edge_workload(quick: bool) -> Workload:
    rows = 24 if quick else 96
    sensor = workload_sensor_with_noise("shot", "threshold_noise", rows=rows, columns=128)
    scenes = tuple(
        glowing_edge_of_workload(
            f"edge_{drive}", depth_m=DEPTH_M, edge_m=EDGE_M, lens={"drive": drive, "f_number": F_NUMBER, **keys}
        )
        for drive, keys in DRIVES.items()
    )
    focus = {"positions": POSITIONS, "motion": {"kind": "sweep"}}
    render = {"samples": 32 if quick else 256, "max_depth": 2, "diffraction": False}
    return Workload(scenes, sensor, FRAMES, exposure={"mean_rate": 0.5}, focus=focus, render=render)


@lru_cache(maxsize=1)
def _fit_edges(dataset: MadeDataset, *, groups: int) -> dict[tuple[str, float], tuple[np.ndarray, np.ndarray, range]]:
    """Return blur and offset of the edge in each group of rows, and the frames used, by drive and stop.

    Blur and offset from the middle are in pixels, (group,). The result is cached, because two checks use the same fits,
    which take longer than making the streams.
    """
    found = {}
    for drive in DRIVES:
        with dataset.open(scene=f"edge_{drive}") as stream:
            rows, columns = stream.shape[1:]
            for stop in STOPS:
                window = range(int(stop * FRAMES) - 40, int(stop * FRAMES) + 40)
                counts = stream.counts(window.start, window.stop).astype(np.float64)
                profiles = counts.reshape(groups, rows // groups, columns).mean(axis=1)
                blur, offset = np.array([_fit_edge(profile) for profile in profiles]).T
                found[drive, stop] = blur, offset, window
    return found


def _fit_edge(profile: np.ndarray) -> tuple[float, float]:
    """Return the diameter of the disc that blurred a straight edge, and the edge's offset from the middle, in pixels.

    The profile of a step blurred by a disc of diameter c is 1/2 + (asin t + t·√(1 − t²))/π with t = 2x/c. A pixel sees
    the mean of the profile over its width, which follows from the integral t·asin t + √(1 − t²) + … of the profile.
    """
    x = np.arange(profile.size) - (profile.size - 1) / 2
    rising = profile[-8:].mean() > profile[:8].mean()
    y = profile if rising else profile[::-1]
    high = float(np.max(y[-8:].mean()))

    def integral(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the integral of the profile of the blurred step, and the profile."""
        s = np.clip(t, -1, 1)
        root, angle = np.sqrt(1 - s**2), np.arcsin(s)
        inside = s / 2 + (s * angle + root - root**3 / 3) / np.pi
        return inside + np.maximum(t - 1, 0), 1 / 2 + (angle + s * root) / np.pi

    def misfit(parameters: np.ndarray) -> np.ndarray:
        c, offset, level = parameters
        (upper, _), (lower, _) = (integral((2 * (x - offset) + side) / c) for side in (1, -1))
        return level * c / 2 * (upper - lower) - y

    def slope(parameters: np.ndarray) -> np.ndarray:
        c, offset, level = parameters
        right, left = ((2 * (x - offset) + side) / c for side in (1, -1))
        (upper, high), (lower, low) = integral(right), integral(left)
        by_c = level / 2 * (upper - lower - right * high + left * low)
        return np.column_stack([by_c, level * (low - high), c / 2 * (upper - lower)])

    start = x[np.argmin(np.abs(y - high / 2))]
    found = least_squares(misfit, [6.0, float(start), high], slope, bounds=([0.2, x[0], 0], [60, x[-1], 10 * high]))
    return float(found.x[0]), float(found.x[1]) * (1 if rising else -1)


def _law_of_edge(drive: str, window: range, *, frames: int, pitch_m: float) -> tuple[float, float]:
    """Return the rms blur, and the edge's mean distance from the axis, over a window, in pixels.

    Charge is interpolated linearly between positions, and so are the squared blur and the distance.
    """
    at = (np.arange(window.start, window.stop) + 0.5) / frames * (POSITIONS - 1)
    knots = np.arange(POSITIONS) / (POSITIONS - 1)
    v, u, z, radius = lens_by_law(drive, knots)
    blur = 2 * radius * v * np.abs(1 / (DEPTH_M - z) - 1 / u) / pitch_m
    offset = v * EDGE_M / (DEPTH_M - z) / pitch_m
    square = np.interp(at, np.arange(POSITIONS), blur**2)
    return float(np.sqrt(square.mean())), float(np.interp(at, np.arange(POSITIONS), offset).mean())


def compare_edges_with_law(maker: DatasetMaker, quick: bool, *, breathing: bool) -> Finding:
    """Compare the blur of an edge, or with ``breathing`` its distance from the axis, with the law for each drive."""
    workload = _edge_workload(quick)
    fits, pitch_m = _fit_edges(maker.make(workload), groups=12), workload.sensor.pitch_m
    comparisons, curves = [], []
    for drive in DRIVES:
        seen, law = [], []
        for stop in STOPS:
            blur, offset, window = fits[drive, stop]
            expected = _law_of_edge(drive, window, frames=workload.frames, pitch_m=pitch_m)
            samples, right = (np.abs(offset), expected[1]) if breathing else (blur, expected[0])
            found = compare_mean_with_law(
                f"{drive} at {stop:g}",
                samples,
                expected=right,
                figures=len(fits),
                model_error=_mixing_error(drive, breathing=breathing, pitch_m=pitch_m),
                unit="pixels",
            )
            comparisons.append(found)
            seen.append(found.measured)
            law.append(right)
        curves += [Curve(f"law, {drive}", STOPS, tuple(law)), Curve(f"stream, {drive}", STOPS, tuple(seen), "points")]
    what = "edge off the axis, pixels" if breathing else "blur, pixels"
    return Finding(tuple(comparisons), Plot("position", what, tuple(curves)))


def _mixing_error(drive: str, *, breathing: bool, pitch_m: float) -> float:
    """Return the error of fitting one disc to a mixture of the discs of two neighbouring positions, in pixels.

    It is at most a tenth of the difference between the two: the mixture has the second moment of the law, and its shape
    differs by the square of the difference, divided by the diameter c.
    """
    v, u, z, radius = lens_by_law(drive, np.arange(POSITIONS) / (POSITIONS - 1))
    blur = 2 * radius * v * (1 / (DEPTH_M - z) - 1 / u) / pitch_m
    offset = v * EDGE_M / (DEPTH_M - z) / pitch_m
    return float(np.abs(np.diff(offset if breathing else blur)).max()) / 10
