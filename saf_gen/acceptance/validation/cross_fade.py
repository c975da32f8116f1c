"""Motion between two time slices: their pictures are mixed, so that fine texture loses contrast half way."""

import numpy as np

from saf_gen.acceptance.validation.check import Check, Comparison, Curve, Finding, Plot
from saf_gen.acceptance.validation.inference import compare_mean_with_law
from saf_gen.acceptance.validation.workload import DatasetMaker, Workload, workload_sensor_with_noise
from saf_gen.acceptance.validation.written_scenes import STILL_LENS, striped_card_of_workload
from saf_gen.stream.stream_file import SpikeStream

PERIOD, STEPS = 12, (1.0, 2.0, 3.0, 4.5)
"""Period of the stripes, and motion of the card from one slice to the next, in pixels."""
SLICE_FRAMES, FRAMES = 200, 1000


def _check_dip(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the contrast at points between two slices with the contrast at a slice."""
    steps = STEPS[1::2] if quick else STEPS
    sensor = workload_sensor_with_noise("shot", "threshold_noise", rows=24 if quick else 96, columns=5 * PERIOD)
    focal = STILL_LENS["focal_length_mm"] / 1000
    v = float(np.mean([focal * u / (u - focal) for u in STILL_LENS["focus_range_m"]]))
    pixel_m = sensor.pitch_m * 0.5 / v
    slices_per_s = sensor.readout_hz / SLICE_FRAMES
    scenes = tuple(
        striped_card_of_workload(
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
            one = compare_mean_with_law(
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


CHECKS = (
    Check(
        "crossfade_dip",
        "Half way between two slices, cross-fading has reduced the contrast of texture with f cycles per pixel that "
        "moves by d pixels per slice.",
        "dip of C² = (1 − cos 2πfd)/2; between: |1 − w + w·e^(2πifd)|²",
        "The sum of two sines with different phases (docs/explanation/physics.md, *What is not modelled*)",
        "Stripes with a period of 12 pixels that move by 1 to 4.5 pixels per slice of 200 frames; the first harmonic "
        "of the counts of 20 frames.",
        "The scatter between rows, at the slices and between them (one false alarm in 10,000 runs).",
        _check_dip,
    ),
)
