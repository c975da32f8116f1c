"""Lenses that are not perfect: aberrations, distortion, a ring that vignettes, veiling glare, and a real lens."""

from typing import Any

import numpy as np
from scipy.optimize import brentq

import saf_gen
from studies.laws.law import Comparison, Curve, Finding, Law, Plot, compare_mean
from studies.laws.optics import ANGLE_DEG, edge_transfer
from studies.laws.pupils import FINEST, find_peak, pupil_transfer, seidel, texture_dispersion
from studies.laws.radiometry import SETTLED, UNEVEN, rounding_error
from studies.laws.scenes import FAR_M, FLAT_LENS, glowing_edge, glowing_panel, glowing_stripes, glowing_texture
from studies.laws.theory import charge_of_rate, charge_per_radiance, off_axis, off_axis_columns, sweep_mean
from studies.laws.tracing import DoubleGauss
from studies.laws.workload import DatasetMaker, Workload, sensor_with_noise

DEPTH_M, IMAGE_M, F_NUMBER = 0.5, 0.055, 2.0
RADIUS_M = IMAGE_M / (2 * F_NUMBER)
WAVE_M = 555e-9
HEIGHT_M = 4e-3
"""Where the aberrations off the axis are stated, and where the edge is."""
MODEL_OF_RAYS = 0.03
"""Largest error of the transfer of turned and bent rays up to Nyquist (docs/physics.md)."""


def liquid_lens(waves: float, **keys: Any) -> dict[str, Any]:
    """Return a lens of 55 mm at f/2 whose travel spans this many waves of defocus on either side of 0.5 m."""
    edge = 2 * waves * WAVE_M / RADIUS_M**2
    ends = [1 / (1 / DEPTH_M + edge), 1 / (1 / DEPTH_M - edge)]
    lens = {"drive": "focal_length", "image_distance_mm": 1e3 * IMAGE_M, "f_number": F_NUMBER, "focus_range_m": ends}
    return lens | keys


ABERRATIONS = {"spherical 2": {"spherical": 2.0}, "spherical 1, astigmatism 1": {"spherical": 1.0, "astigmatism": 1.0}}
TRAVEL_WAVES, KNOTS = 3.6, 25
TEXTURE_WAVES, TEXTURE_KNOTS = 7.0, 37


def _check_aberrations(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the transfer of an edge, and the focus of a texture, behind lenses with aberrations with pupil sums."""
    transfers, curves = _aberrated_edges(maker, quick)
    return Finding((*transfers, *_aberrated_foci(maker, quick)), Plot("waves of defocus", "transfer", tuple(curves)))


def _aberrated_edges(maker: DatasetMaker, quick: bool) -> tuple[list[Comparison], list[Curve]]:
    rows, columns, groups, frames = 96, 480, 8, 10_000
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=columns)
    edge_m = HEIGHT_M * DEPTH_M / IMAGE_M
    scenes = {
        name: glowing_edge(
            f"edge_{n}",
            depth_m=DEPTH_M,
            edge_m=edge_m,
            turn_deg=ANGLE_DEG,
            lens=liquid_lens(TRAVEL_WAVES, aberrations={**waves, "wave_nm": 1e9 * WAVE_M, "height_mm": 1e3 * HEIGHT_M}),
        )
        for n, (name, waves) in enumerate(ABERRATIONS.items())
    }
    focus = {"positions": KNOTS, "motion": {"kind": "sweep"}}
    render = {"samples": 48 if quick else 192, "max_depth": 2}
    dataset = maker.make(
        Workload(tuple(scenes.values()), sensor, frames, exposure={"mean_rate": 0.5}, focus=focus, render=render)
    )
    cycles = np.array([0.1, 0.2, 0.3, 0.4])
    fractions = cycles / sensor.pitch_m * WAVE_M * IMAGE_M / (2 * RADIUS_M)
    turn = np.radians(ANGLE_DEG)
    box = np.sinc(cycles * np.cos(turn)) * np.sinc(cycles * np.sin(turn))
    stops = (-3.0, -1.5, 0.0, 1.5, 3.0)
    knots = np.linspace(-TRAVEL_WAVES, TRAVEL_WAVES, KNOTS)
    middles = ((np.arange(groups) + 0.5) / groups - 0.5) * rows * sensor.pitch_m  # of the groups of rows
    comparisons, curves = [], []
    for name, waves in ABERRATIONS.items():
        # Across the edge the point is HEIGHT_M from the middle; along it, as far as its row says.
        along = [(1.0, (HEIGHT_M * np.sin(turn) + y) / np.cos(turn) / HEIGHT_M) for y in middles]
        by_knot = np.array(
            [
                [pupil_transfer(seidel(**waves, defocus=w, eta=eta), fractions=fractions).real for eta in along]
                for w in knots
            ]
        )
        seen, law = [], []
        with dataset.open(scene=scenes[name].id) as stream:
            for stop in stops:
                middle = round((stop / TRAVEL_WAVES + 1) / 2 * frames)
                window = range(middle - 150, middle + 150)
                counts = stream.counts(window.start, window.stop).astype(np.float64)
                found = np.array([edge_transfer(part, cycles) for part in _near_edge(counts, groups)])
                expected = sweep_mean(by_knot, window, frames=frames) * box
                mean = expected.mean(axis=0)
                for n, frequency in enumerate(cycles):
                    comparisons.append(
                        compare_mean(
                            f"{name}: {stop:g} waves of defocus, {frequency:g} cycles per pixel",
                            found[:, n] - expected[:, n] + mean[n],
                            expected=float(mean[n]),
                            figures=len(ABERRATIONS) * len(stops) * len(cycles),
                            model_error=MODEL_OF_RAYS * float(box[n]),
                        )
                    )
                seen.append(found.mean(axis=0))
                law.append(mean)
        for n in (1, 3):
            label = f"{name}, {cycles[n]:g}/pixel"
            shown = by_knot.mean(axis=1)[:, n] * box[n]
            curves += [
                Curve(f"law: {label}", tuple(knots.tolist()), tuple(shown.tolist())),
                Curve(f"stream: {label}", stops, tuple(float(one[n]) for one in seen), "points"),
            ]
    return comparisons, curves


def _near_edge(counts: np.ndarray, groups: int) -> np.ndarray:
    """Return the columns about the edge in groups of rows, float64 (group, row, column)."""
    middle = int(np.abs(np.diff(counts.mean(axis=0))).argmax()) + 1
    near = counts[:, middle - 34 : middle + 34]
    return near.reshape(groups, -1, near.shape[1])


def _aberrated_foci(maker: DatasetMaker, quick: bool) -> list[Comparison]:
    rows, columns, frames, repeats = 64, 96, 7200, 4 if quick else 8
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=columns)
    spherical = (0.0, 2.0) if quick else (0.0, 1.0, 2.0)
    field_m = (columns * sensor.pitch_m * DEPTH_M / IMAGE_M, rows * sensor.pitch_m * DEPTH_M / IMAGE_M)
    scenes = []
    for n, waves in enumerate(spherical):
        aberrations = {"aberrations": {"spherical": waves, "wave_nm": 1e9 * WAVE_M}} if waves else {}
        lens = liquid_lens(TEXTURE_WAVES, **aberrations)
        scenes.append(
            glowing_texture(f"texture_{n}", rows=rows, columns=columns, field_m=field_m, depth_m=DEPTH_M, lens=lens)
        )
    focus = {"positions": TEXTURE_KNOTS, "motion": {"kind": "sweep"}}
    render = {"samples": 64 if quick else 256, "max_depth": 2}
    dataset = maker.make(
        Workload(
            tuple(scenes),
            sensor,
            frames,
            exposure={"mean_rate": 0.5},
            focus=focus,
            render=render,
            split={"repeats": repeats},
        )
    )
    known = np.linspace(0, FINEST, 46)
    fractions = known / sensor.pitch_m * WAVE_M * IMAGE_M / (2 * RADIUS_M)
    step = 2 * TEXTURE_WAVES / (TEXTURE_KNOTS - 1)
    width = np.hypot(sensor.pitch_m, WAVE_M * IMAGE_M / RADIUS_M)
    half_depth = width / (2 * RADIUS_M * IMAGE_M) * RADIUS_M**2 / 2 / WAVE_M  # waves
    windows = stop_windows(TEXTURE_KNOTS, frames)
    measure, comparisons = saf_gen.get_measure("sd"), []
    for waves, scene in zip(spherical, scenes, strict=True):
        by_knot = np.array(
            [
                pupil_transfer(seidel(spherical=waves, defocus=w), fractions=fractions)
                for w in np.linspace(-TEXTURE_WAVES, TEXTURE_WAVES, TEXTURE_KNOTS)
            ]
        )
        mixed = np.array([sweep_mean(by_knot, window, frames=frames) for window in windows])
        own = find_peak(texture_dispersion(rows, columns, cycles=known, transfers=mixed))
        peaks = []
        for repeat in range(repeats):
            with dataset.open(scene=scene.id, repeat=repeat) as stream:
                peaks.append(find_peak(np.array([measure(stream.counts(w.start, w.stop)) for w in windows])))
        zero = (TEXTURE_KNOTS - 1) / 2 - 1  # the first window is at the second position
        comparisons.append(
            compare_mean(
                f"{waves:g} waves of spherical aberration: SD peaks at",
                (np.array(peaks) - zero) * step / half_depth,
                expected=(own - zero) * step / half_depth,
                figures=len(spherical),
                model_error=0.02,
                unit="half depths",
            )
        )
    return comparisons


def stop_windows(knots: int, frames: int) -> list[range]:
    """Return a window of a sweep about each rendered position but the first and the last, half a step wide."""
    step = frames // (knots - 1)
    return [range(n * step - step // 4, n * step + step // 4) for n in range(1, knots - 1)]


DISTORTION_HEIGHT_M = 7e-3
PLACES_M = (-0.058, -0.03, 0.012, 0.05)
SIMPLE_DRIVES: dict[str, dict[str, Any]] = {
    "image_distance": {"drive": "image_distance", "focal_length_mm": 50.0, "focus_range_m": [0.52, 0.48]},
    "focal_length": {"drive": "focal_length", "image_distance_mm": 55.0, "focus_range_m": [0.52, 0.48]},
}


def image_distances(drive: str) -> tuple[np.ndarray, float]:
    """Return the image distances (m) of a drive of SIMPLE_DRIVES at positions 0, 1/2 and 1, and 2·R·N (m)."""
    keys = SIMPLE_DRIVES[drive]
    if drive == "focal_length":
        v = keys["image_distance_mm"] / 1000
        return np.full(3, v), v
    focal = keys["focal_length_mm"] / 1000
    ends = [focal * u / (u - focal) for u in keys["focus_range_m"]]
    return np.array([ends[0], sum(ends) / 2, ends[1]]), focal


def _check_distortion(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare where stripes are seen with the closed form of third-order distortion, row by row."""
    rows, columns, frames, half_m = 24, 240, 6000, 0.0011
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=columns, pitch_m=60e-6)
    percents = (6.0, -4.0)
    scenes, cases = [], []
    for drive, keys in SIMPLE_DRIVES.items():
        v, _ = image_distances(drive)
        depth = _focused(drive, float(v[1]))
        for percent in percents:
            aberrations = {"distortion": percent, "height_mm": 1e3 * DISTORTION_HEIGHT_M}
            lens = {**keys, "f_number": 4.0, "aberrations": aberrations}
            name = f"stripes_{drive}_{'in' if percent < 0 else 'out'}"
            scenes.append(glowing_stripes(name, places_m=PLACES_M, half_m=half_m, depth_m=depth, lens=lens))
            cases.append((drive, percent, v, depth))
    focus = {"positions": 3, "motion": {"kind": "sweep"}}
    render = {"samples": 64 if quick else 512, "max_depth": 2, "diffraction": False}
    dataset = maker.make(
        Workload(tuple(scenes), sensor, frames, exposure={"mean_rate": 0.5}, focus=focus, render=render)
    )
    windows = (range(0, 200), range(frames // 2 - 100, frames // 2 + 100), range(frames - 200, frames))
    figures = len(cases) * len(windows) * len(PLACES_M)
    heights = (np.arange(rows) - (rows - 1) / 2) * sensor.pitch_m
    column = np.arange(columns)
    comparisons, curves = [], []

    def sides(place: float) -> tuple[float, float]:
        return place - half_m, place + half_m

    for scene, (drive, percent, v, depth) in zip(scenes, cases, strict=True):
        bent = percent / 100 * (float(v[1]) / DISTORTION_HEIGHT_M) ** 2
        focused = np.array([_object_distance(drive, n / 2) for n in range(3)])
        blurs = image_distances(drive)[1] / 4.0 * v * np.abs(1 / depth - 1 / focused) / sensor.pitch_m
        seen = []
        with dataset.open(scene=scene.id) as stream:
            for at, window in zip(("the beginning", "the middle", "the end"), windows, strict=True):
                counts = stream.counts(window.start, window.stop).astype(np.float64)
                for place in PLACES_M:
                    edges = np.array(
                        [
                            [[_seen_at(x / depth, y / one, bent) * one for x in sides(place)] for y in heights]
                            for one in v
                        ]
                    )
                    middle = sweep_mean(_centres(edges / sensor.pitch_m, blurs), window, frames=frames)
                    # The camera's right is on the left of the scene.
                    expected = (columns - 1) / 2 - middle
                    near = np.abs(column - expected.mean()) < 12
                    found = counts[:, near] @ column[near] / counts[:, near].sum(axis=1)
                    comparisons.append(
                        compare_mean(
                            f"{drive}, {percent:+g} %, {at}: stripe at {1e3 * place:g} mm",
                            found - expected + expected.mean(),
                            expected=float(expected.mean()),
                            figures=figures,
                            unit="pixels",
                        )
                    )
                    if window is windows[1]:
                        straight = (columns - 1) / 2 - float(v[1]) * place / depth / sensor.pitch_m
                        seen.append(float(found.mean()) - straight)
        fine = np.linspace(PLACES_M[0], PLACES_M[-1], 60)
        law = [(x / depth - _seen_at(x / depth, 0.0, bent)) * float(v[1]) / sensor.pitch_m for x in fine]
        curves += [
            Curve(f"law, {drive}, {percent:+g} %", tuple((1e3 * fine).tolist()), tuple(law)),
            Curve(f"stream, {drive}, {percent:+g} %", tuple(1e3 * one for one in PLACES_M), tuple(seen), "points"),
        ]
    return Finding(tuple(comparisons), Plot("stripe in the scene, mm", "displaced by, pixels", tuple(curves)))


def _centres(edges: np.ndarray, blurs: np.ndarray) -> np.ndarray:
    """Return the centre of gravity that whole pixels see of a stripe, pixels from the middle of the sensor.

    ``edges``, (position, row, 2), are those of the sharp stripe; ``blurs``, (position,), the diameter of the disc that
    blurs it. A pixel counts at its middle, wherever in it the light is: up to 0.03 pixels beside the stripe's centre.
    """
    n = np.arange(400) + 0.5
    across = np.sqrt(n / n.size) * np.cos(n * np.pi * (3 - np.sqrt(5))) / 2  # of a disc of diameter 1
    found = np.empty(edges.shape[:2])
    for at, (rows, blur) in enumerate(zip(edges, blurs, strict=True)):
        left, right = np.sort(rows, axis=1).T[..., None, None] + blur * across[:, None]
        middle = np.round(left.mean() - 0.5) + 0.5 + np.arange(-12, 17)  # of pixels: there is none at the middle
        covered = np.minimum(right, middle + 0.5) - np.maximum(left, middle - 0.5)
        light = np.maximum(covered, 0).mean(axis=1)
        found[at] = light @ middle / light.sum(axis=1)
    return found


def _focused(drive: str, v: float) -> float:
    """Return the distance (m) that a drive of SIMPLE_DRIVES focuses halfway."""
    if drive == "focal_length":
        return float(2 / sum(1 / u for u in SIMPLE_DRIVES[drive]["focus_range_m"]))
    focal = SIMPLE_DRIVES[drive]["focal_length_mm"] / 1000
    return float(focal * v / (v - focal))


def _seen_at(slope: float, across: float, bent: float) -> float:
    """Return the slope s of the sensor's side for which s·(1 − b·(s² + t²)) is that in the scene; t is ``across``."""
    return float(brentq(lambda s: s * (1 - bent * (s * s + across * across)) - slope, -0.3, 0.3, xtol=1e-12))


RING = {"radius_mm": 13.0, "distance_mm": 50.0}


def _check_vignetting(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the light of an even field behind a ring with a sum of straight lines over the aperture."""
    rows, columns, block, frames = 8 if quick else 24, 240, 8, 4000
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=columns, pitch_m=60e-6)
    scenes = {
        drive: glowing_panel(
            f"panel_{drive}",
            radiance=1.0,
            depth_m=DEPTH_M,
            half_m=0.4,
            lens={**keys, "f_number": F_NUMBER, "vignetting": RING},
        )
        for drive, keys in SIMPLE_DRIVES.items()
    }
    axis = charge_per_radiance(sensor, f_number=F_NUMBER, focal_length_m=0.05, image_distance_m=0.055, off_axis_m=0.0)
    level = float(charge_of_rate(0.5, sensor) / axis)
    focus = {"positions": 3, "motion": {"kind": "sweep"}}
    render = {"samples": 128 if quick else 512, "max_depth": 2, "diffraction": False}
    lights = {"constant": {"kind": "constant", "level": level}}
    dataset = maker.make(Workload(tuple(scenes.values()), sensor, frames, lights, focus=focus, render=render))
    windows = (range(0, 400), range(frames // 2 - 200, frames // 2 + 200), range(frames - 400, frames))
    heights, blocks = off_axis((rows, columns), sensor.pitch_m), columns // block
    figures = len(scenes) * len(windows) * blocks
    comparisons, curves = [], []
    for drive, scene in scenes.items():
        v, focal = image_distances(drive)
        u = [_object_distance(drive, n / 2) for n in range(3)]
        lit = level * np.array(
            [
                charge_per_radiance(
                    sensor, f_number=F_NUMBER, focal_length_m=focal, image_distance_m=one, off_axis_m=heights
                )
                for one in v
            ]
        )
        shares = np.array(
            [_through_ring(heights, focal / (2 * F_NUMBER), image_m=a, object_m=b) for a, b in zip(v, u, strict=True)]
        )
        with dataset.open(scene=scene.id) as stream:
            for at, window in zip(("the beginning", "the middle", "the end"), windows, strict=True):
                rate = stream.counts(window.start, window.stop) / len(window)
                open_charge = sweep_mean(lit, window, frames=frames)
                share = sweep_mean(lit * shares, window, frames=frames) / open_charge
                found = charge_of_rate(rate, sensor) / open_charge
                seen, law = [], []
                for n in range(blocks):
                    part = slice(n * block, (n + 1) * block)
                    expected = float(share[:, part].mean())
                    one = compare_mean(
                        f"{drive}, {at}: share of the light in columns {part.start} to {part.stop - 1}",
                        found[:, part] - share[:, part] + expected,
                        expected=expected,
                        figures=figures,
                        model_error=UNEVEN + rounding_error(0.3),
                    )
                    comparisons.append(one)
                    seen.append(one.measured)
                    law.append(expected)
                if window is windows[0]:
                    x = tuple(float(n * block + (block - 1) / 2) for n in range(blocks))
                    curves += [
                        Curve(f"law, {drive}", x, tuple(law)),
                        Curve(f"stream, {drive}", x, tuple(seen), "points"),
                    ]
    return Finding(tuple(comparisons), Plot("column", "share of the light", tuple(curves)))


def _object_distance(drive: str, position: float) -> float:
    """Return the distance (m) that a drive of SIMPLE_DRIVES focuses at a position."""
    keys = SIMPLE_DRIVES[drive]
    if drive == "focal_length":
        near, far = (1 / u for u in keys["focus_range_m"])
        return float(1 / (near + (far - near) * position))
    v = float(image_distances(drive)[0][round(2 * position)])
    focal = keys["focal_length_mm"] / 1000
    return float(focal * v / (v - focal))


def _through_ring(heights: np.ndarray, radius_m: float, *, image_m: float, object_m: float) -> np.ndarray:
    """Return the share of the lines from points of the sensor through the aperture that pass RING as well.

    A line that meets the lens at a, d in front of the ring, has the slope −(x/v + a/u) there.
    """
    side = radius_m * ((np.arange(400) + 0.5) / 200 - 1)
    across, along = np.meshgrid(side, side)
    within = np.hypot(across, along) <= radius_m
    a, d = np.stack([across[within], along[within]]), RING["distance_mm"] / 1e3
    known = np.linspace(0, heights.max(), 60)
    shares = [
        np.mean(
            np.hypot(a[0] - d * (x / image_m + a[0] / object_m), a[1] * (1 - d / object_m)) <= RING["radius_mm"] / 1e3
        )
        for x in known
    ]
    return np.asarray(np.interp(heights, known, shares))


def _check_glare(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the charge of a frame that is half black with and without veiling glare."""
    rows, columns, frames = (24, 64, 20_000) if quick else (48, 128, 20_000)
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=columns)
    shares = (0.0, 0.02, 0.1)
    scenes = {
        share: glowing_edge(f"glare_{n}", depth_m=10.0, edge_m=0.0, lens={**FLAT_LENS, "veiling_glare": share})
        for n, share in enumerate(shares)
    }
    v = 2.0 * FAR_M / (FAR_M - 2.0)
    axis = float(charge_per_radiance(sensor, f_number=2.8, focal_length_m=2.0, image_distance_m=v, off_axis_m=0.0))
    full = float(charge_of_rate(0.4, sensor))
    lights = {"constant": {"kind": "constant", "level": full / axis}}
    dataset = maker.make(Workload(tuple(scenes.values()), sensor, frames, lights))
    comparisons, curves = [], []
    x = off_axis_columns((rows, columns), sensor.pitch_m) / sensor.pitch_m
    charges = {}
    for share, scene in scenes.items():
        with dataset.open(scene=scene.id) as stream:
            charges[share] = charge_of_rate(stream.counts(SETTLED, frames) / (frames - SETTLED), sensor)
    # The camera's right is on the left of the scene: columns on the left are lit.
    lit = charges[0.0].mean(axis=0) > full / 2
    dark, bright = (x > 4, x < -4) if lit[0] else (x < -4, x > 4)
    parts = {
        "dark half": dark & (np.abs(x) < columns / 4),
        "dark half, at the border": dark & (np.abs(x) >= columns / 4),
    }
    figures = len(shares) * (len(parts) + 2) - len(parts)
    for share in shares:
        charge = charges[share]
        model_error = full * (UNEVEN + rounding_error(0.002))
        for name, part in parts.items() if share else ():
            comparisons.append(
                compare_mean(
                    f"glare {share:g}: charge of the {name}",
                    charge[:, part],
                    expected=share * full / 2,
                    figures=figures,
                    model_error=model_error,
                    unit="e⁻",
                )
            )
        comparisons += [
            compare_mean(
                f"glare {share:g}: charge of the lit half",
                charge[:, bright],
                expected=(1 - share) * full + share * full / 2,
                figures=figures,
                model_error=model_error,
                unit="e⁻",
            ),
            compare_mean(
                f"glare {share:g}: mean charge of the frame",
                charge.mean(axis=1),
                expected=full / 2,
                figures=figures,
                model_error=model_error,
                unit="e⁻",
            ),
        ]
        if share:
            law = np.where(lit, (1 - share) * full, 0) + share * full / 2
            curves += [
                Curve(f"law, glare {share:g}", tuple(x.tolist()), tuple(law.tolist())),
                Curve(f"stream, glare {share:g}", tuple(x.tolist()), tuple(charge.mean(axis=0).tolist()), "points"),
            ]
    return Finding(
        tuple(comparisons), Plot("columns from the edge", "charge, e⁻ per readout", tuple(curves), log_y=True)
    )


EDGE_M, OBJECT_M = 0.0805, 1.0
"""Where the edge is, which the double Gauss shows about 4.4 mm from the middle of the sensor."""
FIT_ERROR_PX = 0.04
"""Largest distance between fitted rays and traced ones on the sensor, pixels (docs/lenses.md)."""


def _check_double_gauss(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the picture of an edge through the shipped double Gauss with rays through its surfaces, by column."""
    rows, columns, frames, knots = 8 if quick else 24, 640, 8000, 5
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=columns)
    ends = (1.1, 0.91)
    card = {"file": "double_gauss", "f_number": 2.0, "focus_range_m": list(ends)}
    scene = glowing_edge("edge_double_gauss", depth_m=OBJECT_M, edge_m=EDGE_M, lens=card)
    focus = {"positions": knots, "motion": {"kind": "sweep"}}
    render = {"samples": 256 if quick else 1024, "max_depth": 2, "diffraction": False}
    dataset = maker.make(Workload((scene,), sensor, frames, exposure={"mean_rate": 0.5}, focus=focus, render=render))
    lens = DoubleGauss(2.0)
    first, last = (lens.sensor_distance(u) for u in ends)
    behind = first + (last - first) * np.linspace(0, 1, knots)
    stops = (0.025, 0.25, 0.5, 0.75, 0.975)
    windows = [range(round(stop * frames) - 200, round(stop * frames) + 200) for stop in stops]
    found, law, full, near = [], [], [], slice(0, 0)
    with dataset.open() as stream:
        for window in windows:
            counts = stream.counts(window.start, window.stop).astype(np.float64)
            middle = int(np.abs(np.diff(counts.mean(axis=0))).argmax()) + 1
            near = slice(middle - 12, middle + 13)
            by_knot = np.array([_edge_by_surfaces(lens, near, columns, sensor.pitch_m, behind_m=d) for d in behind])
            level = (1 + ((np.arange(columns) + 0.5 - columns / 2) * sensor.pitch_m / behind[2]) ** 2) ** -2  # cos⁴
            full.append((counts / level)[:, middle - 80 : middle - 14].mean())
            found.append(counts[:, near] / level[near] / full[-1])
            law.append(sweep_mean(by_knot, window, frames=frames))
    comparisons, curves = [], []
    x = tuple(float(n) for n in range(-12, 13))
    for stop, seen, expected, spikes in zip(stops, found, law, full, strict=True):
        slope = np.abs(np.gradient(expected))
        for n, column in enumerate(x):
            comparisons.append(
                compare_mean(
                    f"position {stop:g}, column {column:+g} from the edge",
                    seen[:, n],
                    expected=float(expected[n]),
                    figures=len(stops) * len(x),
                    model_error=FIT_ERROR_PX * float(slope[n]) + 5e-4,
                    least_scatter=6**-0.5 / spikes,  # of counts of whole spikes, as noise_photon_transfer has it
                )
            )
        curves += [
            Curve(f"surfaces, position {stop:g}", x, tuple(expected.tolist())),
            Curve(f"stream, position {stop:g}", x, tuple(seen.mean(axis=0).tolist()), "points"),
        ]
    return Finding(tuple(comparisons), Plot("column from the edge", "light", tuple(curves)))


def _edge_by_surfaces(
    lens: DoubleGauss, near: slice, columns: int, pitch_m: float, *, behind_m: float, parts: int = 8
) -> np.ndarray:
    """Return the light in columns of the picture of the edge, 0 to 1: the share of their rays that meet the lamp.

    Rays come from ``parts`` places of each column, and from points spread evenly over the exit pupil.
    """
    n = np.arange(1500) + 0.5
    r, angle = lens.radius_m * lens.pupils[3] * np.sqrt(n / n.size), n * np.pi * (3 - np.sqrt(5))
    pupil = np.stack([r * np.cos(angle), r * np.sin(angle)])
    at = np.arange(near.start * parts, near.stop * parts) + 0.5
    x = (at / parts - columns / 2) * pitch_m
    place = np.stack([np.repeat(x, n.size), np.zeros(x.size * n.size)])
    met = lens.seen_from(place, np.tile(pupil, x.size), behind_m=behind_m, object_m=OBJECT_M)[0]
    return np.asarray((met > EDGE_M).reshape(-1, parts * n.size).mean(axis=1))


_ROWS = "The scatter between rows (one false alarm in 10,000 runs)"
LAWS = (
    Law(
        "lens_aberrations",
        "Behind a lens with aberrations an edge has the transfer of its pupil, and SD of a texture peaks where a sum "
        "over the pupil says.",
        "T(ν) = mean of exp(2πi·(W(a + s) − W(a − s))), W = W040·ρ⁴ + W222·(η·ρ)² + W020·ρ²; SD = Σ P(f)·|T(f)|²",
        "H. H. Hopkins, 1955, doi:10.1098/rspa.1955.0158; Seidel's sum: W. T. Welford, Aberrations of Optical Systems, "
        "1986",
        "A slanted edge 4 mm off the axis at f/2, swept from −3.6 to 3.6 waves of defocus, with 2 waves of spherical "
        "aberration and with one of it and one of astigmatism; a texture of power 1/f² swept over ±7 waves with 0, 1 "
        "and 2 waves of spherical aberration, each recorded with eight draws of noise.",
        "The scatter between groups of rows, or between recordings (one false alarm in 10,000 runs), and the stated "
        "errors of rays: 0.03 in the transfer of the lens, 0.02 half depths of focus.",
        _check_aberrations,
    ),
    Law(
        "lens_distortion",
        "Third-order distortion moves what is seen by a share of its height that grows as the square of the height.",
        "x·(1 − D·(r·v₀/(v·h))²) = v·X/d, r² = x² + y²",
        "W. T. Welford, Aberrations of Optical Systems, 1986, chapter 7 (Seidel's fifth sum)",
        "Four glowing stripes at 0.5 m behind lenses of +6 and −4 % at 7 mm, swept by two drives; the centre of each "
        "stripe in each row at three positions.",
        f"{_ROWS}; the law has no error of its own.",
        _check_distortion,
    ),
    Law(
        "lens_vignetting",
        "A ring in front of the lens takes from each point of the picture the light of the lines that it stops.",
        "share(x) = mean over the aperture of [|a − d·(x/v + a/u)| ≤ r]",
        "W. J. Smith, Modern Optical Engineering, 2008, section 9.3",
        "Even light through a lens at f/2 and a ring of 13 mm, 50 mm in front of it, swept by two drives; charge over "
        "that of the open lens in blocks of eight columns at three positions.",
        "The scatter between pixels (one false alarm in 10,000 runs), the unevenness of even light, and single "
        "precision.",
        _check_vignetting,
    ),
    Law(
        "lens_glare",
        "Veiling glare takes a share of the light of every pixel and spreads it evenly over the frame; none is lost.",
        "q → (1 − g)·q + g·mean(q)",
        "ISO 9358, veiling glare of image forming systems; conservation of energy",
        "A frame of which one half is black and the other glows, with glare of 0, 0.02 and 0.1; 20,000 frames.",
        "The scatter between pixels, or between rows (one false alarm in 10,000 runs), the unevenness of even light, "
        "and single precision.",
        _check_glare,
    ),
    Law(
        "lens_double_gauss",
        "The shipped double Gauss draws an edge as its twelve surfaces do.",
        "light(x) = share of the rays from x through the exit pupil that meet the lamp, by n·sin ϑ = n′·sin ϑ′",
        "Snell's law, traced by own code; surfaces: JP S62-87922 A, 1987, example 1",
        "A half plane at 1 m, seen 4.4 mm off the axis at f/2, swept from 1.1 to 0.91 m; 25 columns about the edge at "
        "five positions.",
        f"{_ROWS}; 0.04 pixels, the stated error of the fitted rays, times the slope of the law; and 0.0005 for sums.",
        _check_double_gauss,
    ),
)
