"""Convergence: with our recipes' settings, errors from samples, positions and slices are below the sensor's noise.

Between two time slices, pictures are mixed: fine texture that moves loses contrast half way.
"""

from typing import Any

import numpy as np

import saf_gen
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.camera import Sensor, get_sensor
from saf_gen.camera.counting_law import noise_per_spike
from saf_gen.generate.resolve import coarse_sampling
from saf_gen.leaderboard.results import grain_warning
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stream.recorded_grain import grain_of_stream
from saf_gen.stream.stream_file import SpikeStream
from studies.laws.law import Comparison, Curve, Finding, Law, Plot, compare_mean
from studies.laws.optics import DRIVES, F_NUMBER
from studies.laws.scenes import STILL_LENS, lit_chequers, striped_card
from studies.laws.workload import DatasetMaker, MadeDataset, Workload, sensor_with_noise

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
    enough = grain_warning(evaluate(dataset.folder, methods=["sd+argmax"]).records)
    comparisons.append(Comparison("warnings of evaluate at the default", float(len(enough)), 0.0, 0.0, 0.0))
    few = maker.make(make(1))
    warned = grain_warning(evaluate(few.folder, methods=["energy_of_laplacian+argmax"]).records)
    comparisons.append(
        Comparison("warnings of evaluate at one sample, by the Laplacian", float(len(warned)), at_least=1.0)
    )
    x = tuple(map(float, range(len(scenes))))
    curves = (Curve("sensor", x, tuple(noise for _ in x), "marks"), Curve("grain", x, tuple(shown), "points"))
    return Finding(tuple(comparisons), Plot("scene", "relative rms", curves, names=scenes))


def _check_positions(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the SD along a sweep rendered at our recipes' number of positions with the SD at four times as many."""
    repeats, frames, samples = (4, 2000, 32) if quick else (12, 4000, 256)
    sensor = sensor_with_noise("shot", "threshold_noise", rows=48, columns=64)
    lens = {"drive": "image_distance", "f_number": F_NUMBER, **DRIVES["image_distance"]}
    scene = lit_chequers("chequers", lights={"lamp": ["lamp"], "room": ["room"]}, lens=lens, chequers=230)
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
    sensor = sensor_with_noise("shot", "threshold_noise", rows=100, columns=160)
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
    curves = (Curve("sensor", x, tuple(noise for _ in x), "marks"), Curve("slices", x, tuple(shown), "points"))
    return Finding(tuple(comparisons), Plot("scene", "relative rms", curves, names=tuple(scenes)))


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


PERIOD, STEPS = 12, (1.0, 2.0, 3.0, 4.5)
"""Period of the stripes, and motion of the card from one slice to the next, in pixels."""
SLICE_FRAMES, FRAMES = 200, 1000


def _check_dip(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the contrast at points between two slices with the contrast at a slice."""
    steps = STEPS[1::2] if quick else STEPS
    sensor = sensor_with_noise("shot", "threshold_noise", rows=24 if quick else 96, columns=5 * PERIOD)
    focal = STILL_LENS["focal_length_mm"] / 1000
    v = float(np.mean([focal * u / (u - focal) for u in STILL_LENS["focus_range_m"]]))
    pixel_m = sensor.pitch_m * 0.5 / v
    slices_per_s = sensor.readout_hz / SLICE_FRAMES
    scenes = tuple(
        striped_card(
            f"stripes_{round(10 * d):02d}", period_m=PERIOD * pixel_m, speed_m_per_s=d * pixel_m * slices_per_s
        )
        for d in steps
    )
    workload = Workload(
        scenes,
        sensor,
        FRAMES,
        exposure={"mean_rate": 0.5},
        focus={"positions": 3, "motion": {"kind": "hold", "position": 0.5}},
        render={
            "samples": 256,
            "slice_samples": 64 if quick else 256,
            "max_depth": 2,
            "estimator": "plain",
            "slices_per_s": slices_per_s,
        },
        split={"scene_motion": ["dynamic"]},
    )
    dataset = maker.make(workload)
    wave = np.exp(-2j * np.pi * (np.arange(5 * PERIOD) + 0.5) / PERIOD)
    parts = (0.0, 0.25, 0.5, 0.75)
    comparisons: list[Comparison] = []
    curves = []
    figures = len(steps) * (len(parts) - 1)
    half = 10
    for d, scene in zip(steps, scenes, strict=True):
        turn = 2 * np.pi * d / PERIOD
        with dataset.open(scene=scene.id) as stream:

            def rows_at(frame: float, stream: SpikeStream = stream) -> np.ndarray:
                middle = round(frame)
                counts = stream.counts(middle - half, middle + half)
                return np.asarray(counts @ wave)

            # Slices are at the beginnings of frames 0, 200, …; only those with a neighbour on both sides are used.
            slices = range(SLICE_FRAMES, FRAMES - SLICE_FRAMES, SLICE_FRAMES)
            found = {part: [rows_at(k + part * SLICE_FRAMES) for k in slices] for part in parts}
        slice_means = [np.mean(rows) for rows in found[0.0]]
        moved = slice_means[1] / slice_means[0]
        sign = 1.0 if abs(np.angle(moved * np.exp(-1j * turn))) < abs(np.angle(moved * np.exp(1j * turn))) else -1.0
        at_slice = _mixed(0.0, turn, half=half)
        seen = []
        for part in parts[1:]:
            law = _mixed(part, turn, half=half) / at_slice
            # Rotated back by the phase that the law predicts, the amplitude is real.
            back = np.exp(-1j * (sign * np.angle(law)))
            ratios = [rows / mean * back for rows, mean in zip(found[part], slice_means, strict=True)]
            samples = np.mean([ratio.real for ratio in ratios], axis=0)
            error = float(
                np.mean(
                    [rows.std() / np.sqrt(rows.size) / abs(m) for rows, m in zip(found[0.0], slice_means, strict=True)]
                )
            )
            one = compare_mean(
                f"{d:g} pixels per slice, {part:g} of the way: amplitude relative to a slice",
                samples,
                expected=float(abs(law)),
                figures=figures,
                model_error=4 * error,
            )
            comparisons.append(one)
            seen.append(one.measured)
        x = np.linspace(0, 1, 60)
        shown = [abs(_mixed(float(part), turn, half=half) / at_slice) ** 2 for part in x]
        curves += [
            Curve(f"law, {d:g} pixels", tuple(x.tolist()), tuple(shown)),
            Curve(f"stream, {d:g} pixels", tuple(parts[1:]), tuple(one**2 for one in seen), "points"),
        ]
    return Finding(tuple(comparisons), Plot("between two slices", "contrast, squared", tuple(curves)))


def _mixed(part: float, turn: float, *, half: int) -> complex:
    """Return the complex amplitude of a cross-faded pattern, as the mean over 2·``half`` frames.

    The middle of the frames is ``part`` of the way from one slice to the next; ``turn`` is the phase (radians) by which
    the pattern moves per slice.
    """
    at = part + (np.arange(-half, half) + 0.5) / SLICE_FRAMES
    before, weight = np.floor(at), at - np.floor(at)
    mixed = (1 - weight) * np.exp(1j * turn * before) + weight * np.exp(1j * turn * (before + 1))
    return complex(mixed.mean())


LAWS = (
    Law(
        "convergence_samples",
        "At the samples per pixel of our recipes, grain is below the noise of the sensor; `evaluate` warns of a "
        "dataset with far too few samples.",
        "grain rms ≤ √(fixed pattern² + (1/6 + F·m)/m²), m = rate × 100 frames",
        "Grain: docs/renderer.md#grain; fixed pattern: BIT-Vision/SpikeNeRF calibration maps",
        "Scenes at rest with 64 samples per pixel, whose grain is read from each recording, and again with one "
        "sample; the warnings of `evaluate`.",
        "The noise of the sensor in a block of 100 frames at a rate of 0.2.",
        _check_samples,
    ),
    Law(
        "convergence_positions",
        "At the 129 positions of our recipes, the focus curve differs from the curve at 513 positions by less than "
        "the scatter of one recording.",
        "|mean SD(129) − mean SD(513)| ≤ sd of SD in one recording",
        "Linear interpolation between positions (docs/physics.md, *Radiometry and exposure*)",
        "A chequered plane swept by a lens at f/1.4, with several seeds, at 129 and at 513 positions.",
        "One standard deviation of the SD of one recording; the noise of the means is subtracted.",
        _check_positions,
    ),
    Law(
        "convergence_slices",
        "At the time slices per second that their cards state, mixing two slices changes the pictures of moving scenes "
        "by less than the noise of the sensor; `recipes check` warns of a recipe with fewer slices.",
        "rms(counts at the card's slices − at four times as many) / mean ≤ √(fixed pattern² + (1/6 + F·m)/m²)",
        "Linear interpolation between slices (docs/physics.md, *What is not modelled*)",
        "The middle of the picture of two moving scenes, swept, at 16 samples per pixel as in our recipes, compared "
        "with four times as many slices at 64 samples; two recordings of each, whose grain counts as error. The "
        "warnings of `recipes check`.",
        "The noise of the sensor in a block of 100 frames at a rate of 0.2.",
        _check_slices,
    ),
    Law(
        "crossfade_dip",
        "Half way between two slices, cross-fading has reduced the contrast of texture with f cycles per pixel that "
        "moves by d pixels per slice.",
        "dip of C² = (1 − cos 2πfd)/2; between: |1 − w + w·e^(2πifd)|²",
        "The sum of two sines with different phases (docs/physics.md, *What is not modelled*)",
        "Stripes with a period of 12 pixels that move by 1 to 4.5 pixels per slice of 200 frames; the first harmonic "
        "of the counts of 20 frames.",
        "The scatter between rows, at the slices and between them (one false alarm in 10,000 runs).",
        _check_dip,
    ),
)
