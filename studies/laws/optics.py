"""Optics: blur, focus breathing, the transfer of a slanted edge with waves, and occlusion as in Mitsuba's thin lens."""

from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from saf_gen.camera.sensor import Sensor
from studies.laws.law import Comparison, Curve, Finding, Law, Plot, Skipped, compare_mean
from studies.laws.scenes import glowing_edge, strips_behind_bar
from studies.laws.theory import charge_of_rate, charge_per_radiance, exact_otf, off_axis
from studies.laws.workload import DatasetMaker, MadeDataset, Workload, WrittenScene, only_scenes, sensor_with_noise

DEPTH_M, EDGE_M, F_NUMBER = 0.5, 0.006, 1.4
DRIVES: dict[str, dict[str, Any]] = {
    "image_distance": {"focal_length_mm": 25.0, "focus_range_m": [0.7, 0.39]},
    "focal_length": {"image_distance_mm": 26.316, "focus_range_m": [0.7, 0.39]},
    "stage": {"focal_length_mm": 25.0, "magnification": 1 / 19, "travel_m": [-0.1, 0.1]},
}
"""Lens keys by drive; every lens can focus at 0.5 m (the stage has its fixed plane of focus there)."""
STOPS = (0.04, 0.15, 0.25, 0.8, 0.88, 0.96)
POSITIONS, FRAMES = 65, 8000


def lens_at(drive: str, position: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return image distance v, object distance u and stage motion z at each position, and aperture radius R, in metres.

    z is the distance by which the stage has moved the scene towards the lens. docs/physics.md has the
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
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=128)
    scenes = tuple(
        glowing_edge(
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
    v, u, z, radius = lens_at(drive, knots)
    blur = 2 * radius * v * np.abs(1 / (DEPTH_M - z) - 1 / u) / pitch_m
    offset = v * EDGE_M / (DEPTH_M - z) / pitch_m
    square = np.interp(at, np.arange(POSITIONS), blur**2)
    return float(np.sqrt(square.mean())), float(np.interp(at, np.arange(POSITIONS), offset).mean())


def _compare_edges(maker: DatasetMaker, quick: bool, *, breathing: bool) -> Finding:
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
            found = compare_mean(
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
        curves += [
            Curve(f"law, {drive}", STOPS, tuple(law), "marks"),  # between these stops the blur falls to 0
            Curve(f"stream, {drive}", STOPS, tuple(seen), "points"),
        ]
    what = "edge off the axis, pixels" if breathing else "blur, pixels"
    return Finding(tuple(comparisons), Plot("position", what, tuple(curves)))


def _mixing_error(drive: str, *, breathing: bool, pitch_m: float) -> float:
    """Return the error of fitting one disc to a mixture of the discs of two neighbouring positions, in pixels.

    It is at most a tenth of the difference between the two: the mixture has the second moment of the law, and its shape
    differs by the square of the difference, divided by the diameter c.
    """
    v, u, z, radius = lens_at(drive, np.arange(POSITIONS) / (POSITIONS - 1))
    blur = 2 * radius * v * (1 / (DEPTH_M - z) - 1 / u) / pitch_m
    offset = v * EDGE_M / (DEPTH_M - z) / pitch_m
    return float(np.abs(np.diff(offset if breathing else blur)).max()) / 10


def _check_blur(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the width of a blurred edge with the law of the thin lens, for each drive, on both sides of focus."""
    return _compare_edges(maker, quick, breathing=False)


def _check_breathing(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the offset of an off-axis edge in the picture with the law v/(d − z), for each drive."""
    return _compare_edges(maker, quick, breathing=True)


MODEL_OF_WAVES = 0.039
"""Largest error of the transfer computed by ray bending, below Nyquist, at R/v = 0.024 and 0 to 1.5 waves of defocus
(docs/renderer.md#waves)."""
WAVE_LENS = {"focal_length_mm": 50.0, "f_number": 15.63, "focus_range_m": [0.2313, 0.1777]}
ANGLE_DEG = 5.0


def _check_transfer(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the transfer of a slanted edge, in and out of focus, with the exact wave-optical law of a round lens."""
    rows, frames = 144, 5000 if quick else 20_000
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=64)
    depth = 2 / (1 / 0.2313 + 1 / 0.1777)
    scene = glowing_edge("edge_slanted", depth_m=depth, edge_m=0.0, turn_deg=ANGLE_DEG, lens=WAVE_LENS)
    focus = {"positions": 33, "motion": {"kind": "sweep"}}
    render = {"samples": 32 if quick else 512, "max_depth": 2}
    workload = Workload((scene,), sensor, frames, exposure={"mean_rate": 0.5}, focus=focus, render=render)
    dataset = maker.make(workload)
    focal, radius = 0.05, 0.05 / (2 * 15.63)
    first, last = (focal * u / (u - focal) for u in (0.2313, 0.1777))
    in_focus = focal * depth / (depth - focal)
    frequencies = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    defocus_waves = (0.5, 1.0, 1.5)
    figures = (len(defocus_waves) + 1) * frequencies.size
    comparisons, curves = [], []
    best = (in_focus - first) / (last - first)
    for waves in (0.0, *defocus_waves):
        # W waves of defocus at the aperture's edge: W·λ = R²·|1/d − 1/u|/2.
        defocus_per_m = 2 * waves * sensor.wavelength_m / radius**2
        u = 1 / (1 / depth + defocus_per_m)
        position = ((focal * u / (u - focal)) - first) / (last - first) if waves else best
        middle = int(position * frames)
        window = range(middle - frames // 50, min(middle + frames // 50, frames))
        with dataset.open() as stream:
            counts = stream.counts(window.start, window.stop).astype(np.float64)
        transfers = np.array([edge_transfer(part, frequencies) for part in counts.reshape(12, rows // 12, -1)])
        v = first + (last - first) * (np.array(window) + 0.5) / frames
        defocus = radius**2 * np.abs(1 / depth - (1 / focal - 1 / v)) / 2 / sensor.wavelength_m
        cut_off = 2 * radius / (sensor.wavelength_m * in_focus) * sensor.pitch_m
        law = np.mean([exact_otf(frequencies / cut_off, w, points=500) for w in defocus[:: len(defocus) // 20]], axis=0)
        box = np.sinc(frequencies * np.cos(np.radians(ANGLE_DEG))) * np.sinc(
            frequencies * np.sin(np.radians(ANGLE_DEG))
        )
        seen = []
        for n, frequency in enumerate(frequencies):
            found = compare_mean(
                f"{waves:g} waves, {frequency:g} cycles per pixel",
                transfers[:, n],
                expected=float(law[n] * box[n]),
                figures=figures,
                model_error=MODEL_OF_WAVES * float(box[n]),
            )
            comparisons.append(found)
            seen.append(found.measured)
        x = tuple(frequencies.tolist())
        curves += [
            Curve(f"exact, {waves:g} waves", x, tuple((law * box).tolist())),
            Curve(f"stream, {waves:g} waves", x, tuple(seen), "points"),
        ]
    return Finding(tuple(comparisons), Plot("cycles per pixel", "transfer", tuple(curves)))


def edge_transfer(image: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Return the transfer of a straight, slanted edge in a few rows, at frequencies in cycles per pixel across it.

    Rows are aligned by the known slant, in bins of a quarter of a pixel as in ISO 12233. The Fourier transform of the
    derivative about its centroid, divided by the height of the step, is real; it is negative if contrast is reversed.
    """
    rows, columns = np.indices(image.shape, dtype=np.float64)
    slant = np.radians(ANGLE_DEG)
    across = (columns - (image.shape[1] - 1) / 2) * np.cos(slant)
    tilt = rows * np.sin(slant)
    best = None
    for sign in (1, -1):
        order = np.argsort((across + sign * tilt).ravel())
        x, y = (across + sign * tilt).ravel()[order], image.ravel()[order]
        rough = float(np.abs(np.diff(y)).sum())
        best = (rough, x, y) if best is None or rough < best[0] else best
    _, x, y = best if best is not None else (0.0, across.ravel(), image.ravel())
    # Each bin, a quarter of a pixel wide, holds the mean of its pixels; its transfer, sinc(f/4), is divided out.
    width = 0.25
    cells = np.floor((x - x[0]) / width).astype(int)
    number = np.bincount(cells)
    profile = np.bincount(cells, y)[number > 0] / number[number > 0]
    centres = np.bincount(cells, x)[number > 0] / number[number > 0]
    keep = np.abs(centres - centres[np.argmax(np.abs(np.diff(profile)))]) < 24
    profile, centres = profile[keep], centres[keep]
    slope, at = np.diff(profile), (centres[1:] + centres[:-1]) / 2
    phases = np.exp(-2j * np.pi * frequencies[:, None] * at)
    spread = np.sinc(frequencies * width)  # of the difference between two bins
    centre = np.exp(2j * np.pi * frequencies * (slope @ at) / slope.sum())
    return np.asarray((phases @ slope * centre).real / slope.sum() / spread)


def _check_occlusion(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the picture of a bar in front of a striped wall with Mitsuba's thin lens, column by column."""
    rows, columns = (24, 48) if quick else (40, 64)
    reference_samples = 2048 if quick else 16_384
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=columns)
    scene = strips_behind_bar("bar", lens={"focal_length_mm": 25.0, "f_number": 1.4, "focus_range_m": [0.6, 0.4]})
    stops = (0.0, 1.0) if quick else (0.0, 0.5, 1.0)
    comparisons: list[Comparison] = []
    curves = []
    x = off_axis((rows, columns), sensor.pitch_m)
    for stop in stops:
        focus = {"positions": 3, "motion": {"kind": "hold", "position": stop}}
        render = {"samples": 128 if quick else 1024, "max_depth": 3, "diffraction": False, "estimator": "plain"}
        lights = {"constant": {"kind": "constant", "level": 1.0}}
        workload = Workload((scene,), sensor, 4000, lights, focus=focus, render=render)
        dataset = maker.make(workload)
        with dataset.open() as stream:
            rate = stream.counts(0, 4000) / 4000
            v = float(stream.metadata.image_distance[0])  # type: ignore[index]
        per_radiance = charge_per_radiance(sensor, f_number=1.4, focal_length_m=0.025, image_distance_m=v, off_axis_m=x)
        radiance = charge_of_rate(rate, sensor) / per_radiance
        maker.report(f"thin lens of {reference_samples} samples")
        reference = _render_reference(dataset, scene, sensor=sensor, position=stop, samples=reference_samples)
        mean = float(reference.mean())
        profile = []
        for column in range(columns):
            found = compare_mean(
                f"position {stop:g}, column {column}: relative difference",
                (radiance[:, column] - reference[:, column]) / mean,
                expected=0.0,
                figures=len(stops) * columns,
            )
            comparisons.append(found)
            profile.append(float(radiance[:, column].mean()))
        at = tuple(map(float, range(columns)))
        curves += [
            Curve(f"thin lens, {stop:g}", at, tuple(reference.mean(axis=0).tolist())),
            Curve(f"stream, {stop:g}", at, tuple(profile), "points"),
        ]
    return Finding(tuple(comparisons), Plot("column", "radiance, W m⁻² sr⁻¹", tuple(curves)))


def _render_reference(
    dataset: MadeDataset, scene: WrittenScene, *, sensor: Sensor, position: float, samples: int
) -> np.ndarray:
    """Return a workload's scene as rendered by Mitsuba's thin lens, float64 (row, col).

    Raises Skipped if neither LLVM nor CUDA is usable.
    """
    from saf_gen.render import backend, mitsuba_scene, thin_lens
    from saf_gen.render.render_setup import RenderSetup
    from saf_gen.scene.scene_folder import find_scene

    chosen = backend.choose_backend("auto")
    if chosen == "scalar":
        raise Skipped("the reference needs the variant llvm or cuda to finish within an hour")
    backend.activate_backend(chosen)
    with only_scenes(dataset.folder.parent / "scenes"):
        found = find_scene(scene.id)
    lamps = tuple(lamp for group in found.card.lights.values() for lamp in group)
    described = mitsuba_scene.scene_dict(found)
    loaded, integrator = mitsuba_scene.load_lit_scene(described, lamps, max_depth=3)
    setup = RenderSetup(
        loaded, integrator, mitsuba_scene.camera_to_world(found), found.build_drive(), sensor, found.card.unit_m
    )
    batch = 1024
    parts = [
        thin_lens.render_position(setup, position=position, samples=batch, seed=1000 + n).astype(np.float64)
        for n in range(samples // batch)
    ]
    return np.asarray(np.mean(parts, axis=0))


_SCATTER = "The scatter between groups of rows, which all see the same edge (one false alarm in 10,000 runs)"
LAWS = (
    Law(
        "optics_blur",
        "A point out of focus becomes a disc of the diameter that the thin lens predicts.",
        "c = 2R·v·|1/(d − z) − 1/u|",
        "The thin lens; S. F. Ray, Applied Photographic Optics, 2002 (circle of confusion)",
        "A bright half plane at 0.5 m, swept at f/1.4 by each drive, without waves; a disc is fitted to the edge in 80 "
        "frames at six positions.",
        f"{_SCATTER}, and a tenth of the difference between two rendered positions, whose pictures are mixed.",
        _check_blur,
    ),
    Law(
        "optics_breathing",
        "The scale of the picture follows the drive: it is proportional to v (image distance), constant (focal "
        "length), or proportional to 1/(d − z) (stage).",
        "x = v·X/(d − z)",
        "The thin lens: the ray through its centre is straight",
        "The streams of optics_blur; the edge is 6 mm off the axis.",
        f"{_SCATTER}, and a tenth of the difference between two rendered positions, whose pictures are mixed.",
        _check_breathing,
    ),
    Law(
        "optics_transfer",
        "With waves, a slanted edge has the transfer of a round lens times the transfer of the pixel, in and out of "
        "focus.",
        "transfer(ν) = OTF(ν·λv/(2R), W)·sinc(ν·cos α)·sinc(ν·sin α), W·λ = R²·|1/d − 1/u|/2",
        "H. H. Hopkins, 1955, doi:10.1098/rspa.1955.0158; slanted edge: ISO 12233",
        "A half plane, turned by 5 degrees, swept at f/15.6 with R/v = 0.024; windows at 0 to 1.5 waves of defocus, 12 "
        "groups of rows.",
        f"{_SCATTER}, and 0.039 in the transfer of the lens, the stated error of ray bending (geometry alone is off by "
        "0.36).",
        _check_transfer,
    ),
    Law(
        "optics_occlusion",
        "A bar hides the same parts of a wall behind it, and lets the same light past, as in Mitsuba's own thin lens.",
        "L(x) = ∫ L(ray from x through a) da/(πR²)",
        "Mitsuba 3.9.1, sensor thinlens, doi:10.1145/3528223.3530073; the integral: R. L. Cook et al., 1984, "
        "doi:10.1145/800031.808590",
        "Stripes at 0.55 m behind a bar at 0.45 m, at f/1.4 and three positions; the radiance from the spikes of 4,000 "
        "frames is compared with renders of 16,384 samples.",
        "The scatter between rows, which are all alike (one false alarm in 10,000 runs), column by column.",
        _check_occlusion,
    ),
)
