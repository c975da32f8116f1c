"""Truth: the focus and depth that a file states, compared with closed forms and with the sharpest spikes."""

import math

import numpy as np
from scipy.optimize import brentq

import saf_gen
from studies.laws.law import Comparison, Curve, Finding, Law, Plot, compare_mean
from studies.laws.optics import DRIVES, F_NUMBER, lens_at
from studies.laws.scenes import grey_planes, lit_chequers
from studies.laws.theory import off_axis_columns
from studies.laws.workload import DatasetMaker, Workload, sensor_with_noise

SINGLE_PRECISION_M = 5e-7
"""Error (m) of a depth of half a metre in single precision: eight units in the last place, for a few operations."""
SHAPE = (32, 48)
TILT_DEG = 20.0
NEAR_M, FAR_M = 0.47, 0.53


def _best_focus(drive: str, depths: np.ndarray) -> float:
    """Return the position of least mean squared blur over these depths (m); see docs/physics.md."""
    first, last = (float(one) for one in lens_at(drive, np.array([0.0, 1.0]))[0])
    if drive == "image_distance":
        focal = DRIVES[drive]["focal_length_mm"] / 1000
        w = 1 / focal - 1 / depths
        return float((w.mean() / np.mean(w**2) - first) / (last - first))
    if drive == "focal_length":
        near, far = (1 / u for u in DRIVES[drive]["focus_range_m"])
        return float((np.mean(1 / depths) - near) / (far - near))
    u = float(lens_at(drive, np.zeros(1))[1][0])
    begin, end = DRIVES[drive]["travel_m"]
    z = brentq(lambda z: float(np.mean((depths - z - u) / (depths - z) ** 3)), depths.min() - u, depths.max() - u)
    return float((z - begin) / (end - begin))


def _depths(kind: str, drive: str, *, position: float, pitch_m: float) -> np.ndarray:
    """Return the depth (m) of every target pixel, seen through a pinhole at the centre of the lens at ``position``."""
    v, _, z, _ = lens_at(drive, np.array([position]))
    slope = off_axis_columns(SHAPE, pitch_m) / v[0]
    if kind == "two_depths":
        return np.broadcast_to(np.where(slope < 0, NEAR_M, FAR_M), SHAPE)[SHAPE[0] // 2 :]
    tangent = math.tan(math.radians(TILT_DEG))
    slope = np.abs(slope) if kind == "roof" else slope
    return np.broadcast_to((0.5 - tangent * slope * z[0]) / (1 - tangent * slope), SHAPE)


def _check_depths(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare truth and depth with closed forms, for a target at two depths, a slanted plane and a roof, by drive."""
    sensor = sensor_with_noise(rows=SHAPE[0], columns=SHAPE[1], pitch_m=6e-5)
    across, back = (f"rotate([0, 1, 0], {angle})" for angle in (TILT_DEG, -TILT_DEG))
    kinds: dict[str, dict[str, str]] = {
        "two_depths": {
            "near": f"t.translate([-0.5, -0.5, {NEAR_M}]).scale(0.5)",
            "far": f"t.translate([0.5, -0.5, {FAR_M}]).scale(0.5)",
            "wall": "t.translate([0, 0, 0.58])",
        },
        "slanted": {"slope": f"t.translate([0, 0, 0.5]).{across}"},
        "roof": {
            "left": f"t.translate([0, 0, 0.5]).{across}.translate([-0.5, 0, 0]).scale([0.5, 1, 1])",
            "right": f"t.translate([0, 0, 0.5]).{back}.translate([0.5, 0, 0]).scale([0.5, 1, 1])",
        },
    }
    scenes = [
        grey_planes(
            f"{kind}_{drive}",
            shapes=shapes,
            target=[name for name in shapes if name != "wall"],
            lens={"drive": drive, "f_number": F_NUMBER, **DRIVES[drive]},
        )
        for (kind, drive), shapes in _cases(kinds, quick).items()
    ]
    focus = {"positions": 5, "motion": {"kind": "sweep"}}
    dataset = maker.make(Workload(tuple(scenes), sensor, 400, exposure={"mean_rate": 0.2}, focus=focus))
    comparisons: list[Comparison] = []
    curves = []
    for kind, drive in _cases(kinds, quick):
        with dataset.open(scene=f"{kind}_{drive}") as stream:
            truth = stream.truth
        positions = [0.5]
        for _ in range(50):  # the depths depend on the lens position, which depends on the depths
            positions.append(
                _best_focus(drive, _depths(kind, drive, position=positions[-1], pitch_m=sensor.pitch_m).ravel())
            )
        position = positions[-1]
        law = _depths(kind, drive, position=position, pitch_m=sensor.pitch_m)
        target, depth = np.asarray(truth.target), np.asarray(truth.depth, np.float64)
        per_metre = abs(_best_focus(drive, law.ravel() + 1e-4) - position) / 1e-4
        # saf_gen traces depth twice only: from the middle of the travel, and from the best focus for those depths.
        unsettled = float(np.abs(_depths(kind, drive, position=positions[1], pitch_m=sensor.pitch_m) - law).max())
        allowed_m = SINGLE_PRECISION_M + unsettled
        allowed = per_metre * allowed_m
        name = f"{kind}, {drive}"
        comparisons.append(
            Comparison(f"{name}: position", truth.position, position, position - allowed, position + allowed)
        )
        inside = np.zeros(SHAPE, bool)
        inside[-law.shape[0] :] = True
        flipped = inside[::-1] if (target != inside).any() else inside
        missed = float((target != flipped).sum())
        comparisons.append(Comparison(f"{name}: wrong pixels of the target", missed, 0.0, 0.0, 0.0, unit="pixels"))
        seen = depth[flipped].reshape(law.shape)
        seen = min((seen, seen[:, ::-1]), key=lambda one: float(np.abs(one - law).max()))
        error = float(np.abs(seen - law).max())
        comparisons.append(Comparison(f"{name}: largest error of depth", error, 0.0, 0.0, allowed_m, unit="m"))
        if drive == "image_distance":
            x = tuple(map(float, range(SHAPE[1])))
            curves += [
                Curve(f"law, {kind}", x, tuple(law[0].tolist())),
                Curve(f"file, {kind}", x, tuple(seen[0].tolist()), "points"),
            ]
    return Finding(tuple(comparisons), Plot("column", "depth, m", tuple(curves)))


def _cases(kinds: dict[str, dict[str, str]], quick: bool) -> dict[tuple[str, str], dict[str, str]]:
    """Return the shapes by kind and drive; at the small size, each kind has a single drive."""
    chosen = {(kind, drive): shapes for kind, shapes in kinds.items() for drive in DRIVES}
    return {pair: chosen[pair] for pair in zip(kinds, DRIVES, strict=True)} if quick else chosen


def _check_moving(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the track of an approaching target, and the frame at which the sweep meets it, with closed forms."""
    drives = list(DRIVES)[:1] if quick else list(DRIVES)
    sensor = sensor_with_noise(rows=SHAPE[0], columns=SHAPE[1], pitch_m=6e-5)
    frames, slices_per_s, came_m = 2000, 50.0 if quick else 100.0, -0.06
    keyframes = [{"time_s": 0.0}, {"time_s": 0.1, "translate_m": [0.0, 0.0, came_m]}]
    scenes = tuple(
        grey_planes(
            f"coming_{drive}",
            shapes={"card": "t.translate([0, 0, 0.53])"},
            target=["card"],
            lens={"drive": drive, "f_number": F_NUMBER, **DRIVES[drive]},
            motion={"card": {"keyframes": keyframes}},
            slices_per_s=slices_per_s,
        )
        for drive in drives
    )
    workload = Workload(
        scenes,
        sensor,
        frames,
        exposure={"mean_rate": 0.2},
        focus={"positions": 17, "motion": {"kind": "sweep"}},
        split={"scene_motion": ["dynamic"]},
        render={"samples": 4, "slice_samples": 4, "max_depth": 2},
    )
    dataset = maker.make(workload)
    comparisons, curves = [], []
    # Times are the middles of frames, (t + ½)/F. Between two slices the track, like the pictures, is linear.
    times = (np.arange(frames) + 0.5) / sensor.readout_hz
    at = np.arange(0, 0.1 + 1e-9, 1 / slices_per_s)
    for drive in drives:
        best = np.array([_best_focus(drive, np.array([0.53 + came_m * t / 0.1])) for t in at])
        track = np.interp(times, at, best)
        with dataset.open(scene=f"coming_{drive}") as stream:
            truth, position = stream.truth, np.asarray(stream.focus_position, np.float64)
        per_metre = float(np.abs(np.diff(best)).max()) / (abs(came_m) * 0.1)
        allowed = per_metre * SINGLE_PRECISION_M + 2.0**-24  # plus the single precision of the file
        error = float(np.abs(np.asarray(truth.track) - track).max())
        comparisons.append(Comparison(f"{drive}: largest error of the track", error, 0.0, 0.0, allowed))
        ahead = position - track
        (crossing,) = np.flatnonzero(np.signbit(ahead[1:]) != np.signbit(ahead[:-1]))[:1]
        law = crossing + ahead[crossing] / (ahead[crossing] - ahead[crossing + 1])
        speed = abs(ahead[crossing + 1] - ahead[crossing])
        off = 2 * allowed / speed
        comparisons.append(
            Comparison(f"{drive}: frame of the truth", truth.frame, float(law), law - off, law + off, unit="frames")
        )
        curves += [
            Curve(f"law, {drive}", tuple(times[::40].tolist()), tuple(track[::40].tolist())),
            Curve(
                f"file, {drive}", tuple(times[::80].tolist()), tuple(np.asarray(truth.track)[::80].tolist()), "points"
            ),
        ]
    return Finding(tuple(comparisons), Plot("time, s", "position of best focus", tuple(curves)))


def _check_sharpest(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the position at which the spikes of a sweep are sharpest, by SD, with the truth in the file."""
    rows, columns = (48, 64) if quick else (96, 128)
    repeats, frames = (6, 2000) if quick else (12, 4000)
    drives = list(DRIVES)[:1] if quick else list(DRIVES)
    sensor = sensor_with_noise("shot", "threshold_noise", rows=rows, columns=columns)
    scenes = tuple(
        lit_chequers(
            f"chequers_{drive}",
            lights={"lamp": ["lamp"], "room": ["room"]},
            lens={"drive": drive, "f_number": F_NUMBER, **DRIVES[drive]},
            chequers=230,
        )
        for drive in drives
    )
    workload = Workload(
        scenes,
        sensor,
        frames,
        exposure={"mean_rate": 0.3},
        focus={"positions": 65, "motion": {"kind": "sweep"}},
        render={"samples": 64 if quick else 256, "max_depth": 3},
        split={"repeats": repeats},
    )
    dataset = maker.make(workload)
    measure, step = saf_gen.get_measure("sd"), frames // 100
    comparisons, curves = [], []
    for drive in drives:
        peaks: list[float] = []
        scale = 1.0
        for repeat in range(repeats):
            with dataset.open(scene=f"chequers_{drive}", repeat=repeat) as stream:
                scores = np.array([measure(stream.counts(k, k + step)) for k in range(0, frames, step)])
                low, high = stream.truth.depth_of_focus
                scale, middle = (high - low) / 2, stream.truth.position
            positions = (np.arange(scores.size) + 0.5) * step / frames
            top = int(scores.argmax())
            near = slice(max(top - 8, 0), top + 9)
            fitted = np.polynomial.Polynomial.fit(positions[near], scores[near], 2)
            peaks.append((float(fitted.deriv().roots()[0].real) - middle) / scale)
        comparisons.append(
            compare_mean(
                f"{drive}: peak of SD minus truth",
                np.array(peaks),
                expected=0.0,
                figures=len(drives),
                model_error=0.1,
                unit="half depths of focus",
            )
        )
        curves.append(Curve(drive, tuple(positions.tolist()), tuple((scores / scores.max()).tolist())))
    return Finding(tuple(comparisons), Plot("position", "SD / peak", tuple(curves)))


_EXACT = "Nothing is random: a few operations in single precision, 0.5 µm of depth, and its effect on the position"
LAWS = (
    Law(
        "truth_depths",
        "At the true focus, the mean of c² over the pixels of the target is smallest, and the depth of a pixel is the "
        "depth of the point that its ray meets.",
        "v = mean(w)/mean(w²), w = 1/f − 1/d; 1/u = mean(1/d); mean((y − u)/y³) = 0, y = d − z",
        "Least squares of c = 2R·v·|1/d − 1/u| (docs/physics.md, *The lens and its drive*)",
        "A target at two depths in front of a wall, a plane tilted by 20 degrees, and a roof, with each drive; the "
        "truth is read from the files.",
        f"{_EXACT}; and the error of tracing depth only twice, from the middle of the travel and from the best focus "
        "for those depths.",
        _check_depths,
    ),
    Law(
        "truth_moving",
        "The truth of a moving target follows the target at each time slice, and is interpolated linearly between "
        "slices.",
        "p(t) by the formulas of truth_depths, at the depth 0.53 m − 0.6 m/s·t",
        "Least squares of c, as in truth_depths",
        "A card that approaches by 6 cm in 0.1 s, at 100 time slices per second, swept by each drive.",
        f"{_EXACT}; for the frame, this divided by the speed of the lens relative to the target.",
        _check_moving,
    ),
    Law(
        "truth_sharpest",
        "The spikes are sharpest at the true focus that the file states.",
        "argmax SD(p) = truth",
        "SD: Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363",
        "A chequered plane swept by each drive, with several seeds; a parabola is fitted to the SD of 17 windows "
        "around the peak.",
        "The scatter over seeds (one false alarm in 10,000 runs), and 0.1 half depths of focus for the shape of the "
        "window and of the parabola.",
        _check_sharpest,
    ),
)
