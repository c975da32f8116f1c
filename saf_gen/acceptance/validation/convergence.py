"""Convergence: with our recipes' settings, errors from samples, positions and slices are below the sensor's noise."""

from typing import Any

import numpy as np

import saf_gen
from saf_gen.acceptance.validation.check import Check, Comparison, Curve, Finding, Plot
from saf_gen.acceptance.validation.lens_edges import DRIVES, F_NUMBER
from saf_gen.acceptance.validation.workload import DatasetMaker, MadeDataset, Workload, workload_sensor_with_noise
from saf_gen.acceptance.validation.written_scenes import lit_chequers_of_workload
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.camera import Sensor, get_sensor
from saf_gen.camera.counting_law import noise_per_spike
from saf_gen.generate.coarse_sampling import coarse_sampling
from saf_gen.leaderboard.grain_tables import compose_leaderboard_grain_notes
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stream.recorded_grain import grain_of_stream

SAMPLES, SLICE_SAMPLES, POSITIONS, RATE, BLOCK = 64, 16, 129, 0.2, 100
"""Samples per pixel at rest and in time slices, positions and mean rate (spikes per readout) of our recipes, and the
number of frames of the blocks that focus measures look at."""


def _check_samples(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the grain at our recipes' number of samples with sensor noise; too few samples must cause a warning."""
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

    dataset = maker.make(make(SAMPLES))
    for scene in scenes:
        with dataset.open(scene=scene) as stream:
            grain = grain_of_stream(stream.metadata.provenance)
        rms = float("nan") if grain is None else grain.rms_in_focus
        comparisons.append(Comparison(f"{scene}: relative grain in focus", rms, at_least=0.0, at_most=noise))
        shown.append(rms)
    enough = compose_leaderboard_grain_notes(evaluate(dataset.folder, methods=["sd+argmax"]).records)
    comparisons.append(Comparison("warnings of evaluate at the default", float(len(enough)), 0.0, 0.0, 0.0))
    few = maker.make(make(1))
    warned = compose_leaderboard_grain_notes(evaluate(few.folder, methods=["energy_of_laplacian+argmax"]).records)
    comparisons.append(
        Comparison("warnings of evaluate at one sample, by the Laplacian", float(len(warned)), at_least=1.0)
    )
    x = tuple(map(float, range(len(scenes))))
    curves = (Curve("sensor", x, tuple(noise for _ in x)), Curve("grain", x, tuple(shown), "points"))
    return Finding(tuple(comparisons), Plot(f"scene: {', '.join(scenes)}", "relative rms", curves))


def _check_positions(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the SD along a sweep rendered at our recipes' number of positions with the SD at four times as many."""
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
        dataset = maker.make(workload)
        found = []
        for repeat in range(repeats):
            with dataset.open(repeat=repeat) as stream:
                found.append([measure(stream.counts(k, k + BLOCK)) for k in range(0, frames, BLOCK)])
        curves_of[positions] = np.array(found)
    coarse, fine = curves_of.values()
    scatter = np.sqrt((coarse.var(axis=0, ddof=1) + fine.var(axis=0, ddof=1)) / 2)
    # Bias of each window divided by the scatter of one recording; up to 1, the bias is below the sensor's noise.
    off = (coarse - fine.mean(axis=0)) / np.sqrt(np.mean(scatter**2))
    comparisons = (
        Comparison(
            "rms difference of the curves, divided by the scatter of one recording",
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
    """Compare counts from the time slices of a scene's card with counts from four times as many slices and samples."""
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

        for times, expected_warnings in ((1, 0), (0.25, 1)):
            lines = coarse_sampling(maker.resolve(make(times)))
            what = f"{scene}: warnings of recipes check at {times:g} times the slices of its card"
            comparisons.append(
                Comparison(what, float(len(lines)), expected_warnings, expected_warnings, expected_warnings)
            )
        if quick:  # crossfade_dip checks the interpolation between two slices
            continue
        dataset = (maker.make(make(times)) for times in (1, 4))
        by_card, finer = ([_read_blocks(one, light=light) for light in ("one", "another")] for one in dataset)
        # Sensor noise averages out of the product of two differences with independent noise; the grain of both renders
        # remains.
        first, second = (a - b for a, b in zip(by_card, finer, strict=True))
        error = float(np.sqrt(max(np.mean(first * second), 0.0)) / np.mean(finer))
        what = f"{scene}: relative error at {per_s:g} slices per second"
        comparisons.append(Comparison(what, error, 0.0, 0.0, noise))
        shown.append(error)
    x = tuple(map(float, range(len(shown))))
    curves = (Curve("sensor", x, tuple(noise for _ in x)), Curve("slices", x, tuple(shown), "points"))
    return Finding(tuple(comparisons), Plot(f"scene: {', '.join(scenes)}", "relative rms", curves))


def _noise_of_block(sensor: Sensor) -> float:
    """Return the rms noise of the counts in a block, divided by their mean.

    The noise is the fixed pattern, shot and threshold noise, and the variance of counting whole spikes, 1/6 on average.
    """
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
    counting = float(np.sqrt(1 / 6 + RATE * BLOCK * noise_per_spike(sensor)) / (RATE * BLOCK))
    return float(np.hypot(pattern, counting))


def _read_blocks(dataset: MadeDataset, *, light: str) -> np.ndarray:
    """Return the counts in each block of a recording, float64 (block, row, col)."""
    with dataset.open(light=light) as stream:
        return np.array([stream.counts(k, k + BLOCK) for k in range(0, stream.shape[0], BLOCK)], dtype=float)


CHECKS = (
    Check(
        "convergence_samples",
        "At the samples per pixel of our recipes, grain is below the noise of the sensor; `evaluate` warns of a "
        "dataset with far too few samples.",
        "grain rms ≤ √(fixed pattern² + (1/6 + F·m)/m²), m = rate × 100 frames",
        "Grain: docs/explanation/renderer.md#grain; fixed pattern: BIT-Vision/SpikeNeRF calibration maps",
        "Scenes at rest with 64 samples per pixel, whose grain is read from each recording, and again with one "
        "sample; the warnings of `evaluate`.",
        "The noise of the sensor in a block of 100 frames at a rate of 0.2.",
        _check_samples,
    ),
    Check(
        "convergence_positions",
        "At the 129 positions of our recipes, the focus curve differs from the curve at 513 positions by less than "
        "the scatter of one recording.",
        "|mean SD(129) − mean SD(513)| ≤ sd of SD in one recording",
        "Linear interpolation between positions (docs/explanation/physics.md, *Radiometry and exposure*)",
        "A chequered plane swept by a lens at f/1.4, with several seeds, at 129 and at 513 positions.",
        "One standard deviation of the SD of one recording; the noise of the means is subtracted.",
        _check_positions,
    ),
    Check(
        "convergence_slices",
        "At the time slices per second that their cards state, mixing two slices changes the pictures of moving scenes "
        "by less than the noise of the sensor; `recipes check` warns of a recipe with fewer slices.",
        "rms(counts at the card's slices − at four times as many) / mean ≤ √(fixed pattern² + (1/6 + F·m)/m²)",
        "Linear interpolation between slices (docs/explanation/physics.md, *What is not modelled*)",
        "The middle of the picture of two moving scenes, swept, at 16 samples per pixel as in our recipes, compared "
        "with four times as many slices at 64 samples; two recordings of each, whose grain counts as error. The "
        "warnings of `recipes check`.",
        "The noise of the sensor in a block of 100 frames at a rate of 0.2.",
        _check_slices,
    ),
)
