"""Convergence: at the defaults, what samples, positions and slices leave out lies below the sensor's own noise."""

from typing import Any

import numpy as np

import saf_gen
from saf_gen.acceptance.validation.check import Check, Comparison, Curve, Finding, Plot
from saf_gen.acceptance.validation.optics import DRIVES, F_NUMBER
from saf_gen.acceptance.validation.workload import DatasetMaker, Made, Workload, workload_sensor_with_noise
from saf_gen.acceptance.validation.written_scenes import lit_chequers_of_workload
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.camera import Sensor, get_sensor
from saf_gen.camera.counting_law import pixel_noise_per_spike
from saf_gen.generate.coarse_sampling import find_coarse_recipe_sampling
from saf_gen.leaderboard.grain_tables import compose_leaderboard_grain_notes
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stream.recorded_grain import read_grain_of_stream

SAMPLES, SLICE_SAMPLES, POSITIONS, RATE, BLOCK = 64, 16, 129, 0.2, 100
"""What our recipes use for scenes at rest and in time slices, and the block of frames in which measures look."""


def _check_samples(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare grain at the samples of our recipes with the noise of the sensor, and too few samples with a warning."""
    scenes = ("usaf_target",) if quick else ("usaf_target", "low_texture", "bookshelf", "camel", "two_planes")
    size: dict[str, Any] = {"rows": 50, "columns": 80, "pitch_m": 1e-4}
    sensor = get_sensor("vidar_400x250", **(size if quick else {"rows": 125, "columns": 200, "pitch_m": 4e-5}))
    comparisons, shown = [], []
    noise = _noise_of_block(sensor)

    def make(samples: int) -> Workload:
        return Workload(
            (),
            sensor,
            400,
            exposure={"mean_rate": RATE},
            focus={"positions": 9 if quick else 33, "motion": {"kind": "sweep"}},
            render={"samples": samples, "max_depth": 3},
            shipped=scenes,
        )

    made = maker.make(make(SAMPLES))
    for scene in scenes:
        with made.open(scene=scene) as stream:
            grain = read_grain_of_stream(stream.metadata.provenance)
        rms = float("nan") if grain is None else grain.rms_in_focus
        comparisons.append(Comparison(f"{scene}: grain in focus over the mean", rms, at_least=0.0, at_most=noise))
        shown.append(rms)
    enough = compose_leaderboard_grain_notes(evaluate(made.folder, methods=["sd+argmax"]).records)
    comparisons.append(Comparison("warnings of evaluate at the default", float(len(enough)), 0.0, 0.0, 0.0))
    few = maker.make(make(1))
    warned = compose_leaderboard_grain_notes(evaluate(few.folder, methods=["energy_of_laplacian+argmax"]).records)
    comparisons.append(
        Comparison("warnings of evaluate at one sample, by the Laplacian", float(len(warned)), at_least=1.0)
    )
    x = tuple(map(float, range(len(scenes))))
    curves = (Curve("sensor", x, tuple(noise for _ in x)), Curve("grain", x, tuple(shown), "points"))
    return Finding(tuple(comparisons), Plot(f"scene: {', '.join(scenes)}", "rms over the mean", curves))


def _check_positions(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare SD along a sweep of the positions of our recipes with that of four times as many."""
    repeats, frames, samples = (4, 2000, 32) if quick else (12, 4000, 256)
    sensor = workload_sensor_with_noise("shot", "threshold_noise", rows=48, columns=64)
    lens = {"drive": "image_distance", "f_number": F_NUMBER, **DRIVES["image_distance"]}
    scene = lit_chequers_of_workload("chequers", lights={"lamp": ["lamp"], "room": ["room"]}, lens=lens, chequers=230)
    measure, curves_of = saf_gen.get_measure("sd"), {}
    for positions in (POSITIONS, 4 * (POSITIONS - 1) + 1):
        workload = Workload(
            (scene,),
            sensor,
            frames,
            exposure={"mean_rate": RATE},
            focus={"positions": positions, "motion": {"kind": "sweep"}},
            render={"samples": samples, "max_depth": 3},
            split={"repeats": repeats},
        )
        made = maker.make(workload)
        found = []
        for repeat in range(repeats):
            with made.open(repeat=repeat) as stream:
                found.append([measure(stream.counts(k, k + BLOCK)) for k in range(0, frames, BLOCK)])
        curves_of[positions] = np.array(found)
    coarse, fine = curves_of.values()
    scatter = np.sqrt((coarse.var(axis=0, ddof=1) + fine.var(axis=0, ddof=1)) / 2)
    # A window's bias over the scatter of one recording: at most 1, that is below the sensor's own noise.
    off = (coarse - fine.mean(axis=0)) / np.sqrt(np.mean(scatter**2))
    comparisons = (
        Comparison(
            "rms difference of the curves over the scatter of one recording",
            float(np.sqrt(max(np.mean(off.mean(axis=0) ** 2) - 2 / repeats, 0.0))),
            at_least=0.0,
            at_most=1.0,
        ),
    )
    x = tuple(((np.arange(coarse.shape[1]) + 0.5) * BLOCK / frames).tolist())
    error = tuple((1.96 * scatter).tolist())
    curves = (
        Curve("513 positions", x, tuple(fine.mean(axis=0).tolist())),
        Curve("129 positions, scatter of one recording", x, tuple(coarse.mean(axis=0).tolist()), "points", error),
    )
    return Finding(comparisons, Plot("position", "SD", curves))


def _check_slices(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare counts recorded with the time slices of a scene's card with those of four times as many and as clean."""
    scenes = ("foliage", "bottle")
    sensor = workload_sensor_with_noise("shot", "threshold_noise", rows=100, columns=160)
    noise = _noise_of_block(get_sensor("vidar_400x250"))
    comparisons, shown = [], []
    for scene in scenes:
        per_s = find_scene(scene).card.slices_per_s or 0.0

        def make(times: float, scene: str = scene, per_s: float = per_s) -> Workload:
            render = {
                "samples": SAMPLES,
                "slice_samples": round(SLICE_SAMPLES * max(times, 1)),
                "slices_per_s": times * per_s,
            }
            return Workload(
                (),
                sensor,
                800,
                lights={"one": {"kind": "constant"}, "another": {"kind": "constant"}},
                exposure={"mean_rate": RATE},
                focus={"positions": POSITIONS, "motion": {"kind": "sweep"}},
                render=render,
                split={"scene_motion": ["dynamic"]},
                shipped=(scene,),
            )

        for times, told in ((1, 0), (0.25, 1)):
            lines = find_coarse_recipe_sampling(maker.resolve(make(times)))
            what = f"{scene}: warnings of recipes check at {times:g} times the slices of its card"
            comparisons.append(Comparison(what, float(len(lines)), told, told, told))
        if quick:  # light between two slices is held to its law by `crossfade_dip`
            continue
        made = (maker.make(make(times)) for times in (1, 4))
        mine, finer = ([_read_blocks(one, light=light) for light in ("one", "another")] for one in made)
        # The product of differences with other noise has no noise in the mean; grain of both renders stays in it.
        first, second = (a - b for a, b in zip(mine, finer, strict=True))
        error = float(np.sqrt(max(np.mean(first * second), 0.0)) / np.mean(finer))
        what = f"{scene}: error over the mean at {per_s:g} slices per second"
        comparisons.append(Comparison(what, error, 0.0, 0.0, noise))
        shown.append(error)
    x = tuple(map(float, range(len(shown))))
    curves = (Curve("sensor", x, tuple(noise for _ in x)), Curve("slices", x, tuple(shown), "points"))
    return Finding(tuple(comparisons), Plot(f"scene: {', '.join(scenes)}", "rms over the mean", curves))


def _noise_of_block(sensor: Sensor) -> float:
    """Return the rms of a block's counts over their mean: fixed pattern, and counting, 1/6 on average."""
    pattern = float(
        np.linalg.norm(
            (
                sensor.response_column_rms,
                sensor.response_row_rms,
                sensor.response_white_rms,
                sensor.threshold_spread_rms,
            )
        )
    )
    counting = float(np.sqrt(1 / 6 + RATE * BLOCK * pixel_noise_per_spike(sensor)) / (RATE * BLOCK))
    return float(np.hypot(pattern, counting))


def _read_blocks(made: Made, *, light: str) -> np.ndarray:
    """Return the counts of each block of a recording, (block, row, col)."""
    with made.open(light=light) as stream:
        return np.array([stream.counts(k, k + BLOCK) for k in range(0, stream.shape[0], BLOCK)], dtype=float)


CHECKS = (
    Check(
        "convergence_samples",
        "At the samples of our recipes grain lies below the noise of the sensor; a dataset with far too few is "
        "warned of.",
        "grain rms ≤ √(fixed pattern² + (1/6 + F·m)/m²), m = rate × 100 frames",
        "Grain: docs/explanation/grain.md; fixed pattern: BIT-Vision/SpikeNeRF calibration maps",
        "Scenes at rest with 64 samples as stored beside each recording, and again with one; evaluate's warning.",
        "The sensor's own noise in a block of 100 frames at a rate of 0.2.",
        _check_samples,
    ),
    Check(
        "convergence_positions",
        "At the 129 positions of our recipes the focus curve differs from that of 513 by less than one recording "
        "scatters.",
        "|mean SD(129) − mean SD(513)| ≤ sd of SD in one recording",
        "Linear interpolation between positions (docs/explanation/physics.md, *Radiometry and exposure*)",
        "A chequered plane swept by a lens at f/1.4, several seeds, with 129 and with 513 positions.",
        "One standard deviation of a recording's SD; the noise of the means is taken off.",
        _check_positions,
    ),
    Check(
        "convergence_slices",
        "At the time slices of their cards, mixing two of them changes pictures of moving scenes by less than the "
        "sensor's noise; a recipe with fewer is warned of.",
        "rms(counts at the card's slices − at four times as many) / mean ≤ √(fixed pattern² + (1/6 + F·m)/m²)",
        "Linear interpolation between slices (docs/explanation/physics.md, *What is not modelled*)",
        "The middle of the picture of two moving scenes, swept, at 16 samples per slice as in our recipes, against "
        "four times as many slices of 64 samples, two recordings of each; their grain counts as error. The warning "
        "of recipes check.",
        "The sensor's own noise in a block of 100 frames at a rate of 0.2.",
        _check_slices,
    ),
)
