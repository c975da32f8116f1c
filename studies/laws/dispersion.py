"""Spike dispersion: noise at few counts, offset by dark charge, and the part of a sweep that golden search excludes."""

from contextlib import ExitStack
from pathlib import Path

import numpy as np

import saf_gen
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.camera.counting_law import noise_per_spike
from studies.laws.law import (
    FALSE_ALARM,
    Comparison,
    Curve,
    Finding,
    Law,
    Plot,
    compare_estimate,
    compare_mean,
    deviations,
)
from studies.laws.scenes import even_panel, gain_of_rate, lit_chequers
from studies.laws.theory import count_variance
from studies.laws.workload import DatasetMaker, Workload, sensor_with_noise

WINDOW = 100
FEW_COUNT_RATES = (0.003, 0.006, 0.0125, 0.025, 0.05, 0.08, 0.15, 0.3)
"""Rates (spikes per readout) at which a window of 100 frames has 0.3 to 30 counts per pixel on average."""


def _check_dark_end(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the SD of an even field at few counts with the exact law."""
    size = {"rows": 100, "columns": 160} if quick else {"rows": 250, "columns": 400}
    sensor = sensor_with_noise("shot", "threshold_noise", rows=size["rows"], columns=size["columns"])
    lights = {
        f"rate_{n}": {"kind": "constant", "level": gain_of_rate(rate, sensor)} for n, rate in enumerate(FEW_COUNT_RATES)
    }
    dataset = maker.make(Workload((even_panel(),), sensor, 2 * WINDOW, lights))
    measure, per_spike = saf_gen.get_measure("sd"), noise_per_spike(sensor)
    comparisons = []
    for name, rate in zip(lights, FEW_COUNT_RATES, strict=True):
        with dataset.open(light=name) as stream:
            counts = stream.counts(WINDOW, 2 * WINDOW)
        mean = rate * WINDOW
        off, found = counts - counts.mean(), counts.mean()
        # First-order influence of each pixel on SD; its scatter gives the standard error of SD.
        influence = (off**2 - off.var()) / found**2 - 2 * off.var() * off / found**3
        comparisons.append(
            compare_estimate(
                f"SD at {mean:g} counts",
                float(measure(counts)),
                standard_error=float(influence.std() / np.sqrt(counts.size)),
                expected=float(count_variance(mean, mean * per_spike)) / mean**2,
                figures=len(FEW_COUNT_RATES),
            )
        )
    x = np.geomspace(0.2, 40, 400)
    average = x * per_spike + 1 / 6
    curves = (
        Curve("exact law", tuple(x.tolist()), tuple((count_variance(x, x * per_spike) / x**2).tolist())),
        Curve(
            "SD of streams",
            tuple(rate * WINDOW for rate in FEW_COUNT_RATES),
            tuple(one.measured for one in comparisons),
            "points",
            tuple(one.high - one.measured for one in comparisons),
        ),
        Curve("average law, F/m + 1/(6·m²)", tuple(x.tolist()), tuple((average / x**2).tolist())),
    )
    return Finding(tuple(comparisons), Plot("mean count", "SD of an even field", curves, log_x=True, log_y=True))


def _check_dark_offset(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the SD of an even field over dark charge to the prediction from a dark recording of the same device."""
    rows, columns = (100, 160) if quick else (250, 400)
    sensor = sensor_with_noise("shot", "threshold_noise", "dark", rows=rows, columns=columns)
    frames, rates = 2000, (0.002, 0.005, 0.01, 0.03, 0.1)
    lights = {"dark": {"kind": "constant", "level": 0.0}}
    lights |= {f"rate_{n}": {"kind": "constant", "level": gain_of_rate(rate, sensor)} for n, rate in enumerate(rates)}
    dataset = maker.make(Workload((even_panel(),), sensor, frames, lights))
    per_spike, n = noise_per_spike(sensor), 1000
    with dataset.open(light="dark") as stream:
        dark = stream.counts(0, frames).astype(float) / frames  # each count is within half a spike of the truth
    comparisons, means, seen, law = [], [], [], []
    for name in list(lights)[1:]:
        with dataset.open(light=name) as stream:
            counts = stream.counts(frames - n, frames).astype(float)
        mean = float(counts.mean())
        # Expected count of each pixel: from the even light and its dark charge, reduced by the loss at a spike.
        light = mean / n - float(dark.mean())
        expected_counts = n * (light + dark * (1 - 2 * sensor.reset_loss * light))
        expected_counts += mean - float(expected_counts.mean())
        noise = float(
            np.mean(count_variance(np.quantile(expected_counts, (np.arange(300) + 0.5) / 300), mean * per_spike))
        )
        rounding = float(np.mean(count_variance(frames * np.quantile(dark, (np.arange(300) + 0.5) / 300), 1e-3)))
        spread = float(expected_counts.var()) - rounding * (n / frames) ** 2
        # (count − mean)² minus the prediction from the pixel's dark recording: the spread over pixels cancels.
        samples = ((counts - mean) ** 2 - (expected_counts - mean) ** 2) / mean**2
        comparisons.append(
            compare_mean(
                f"{mean / n:.3g} spikes per readout: SD minus the dark recording's",
                samples,
                expected=(noise - rounding * (n / frames) ** 2) / mean**2,
                figures=len(rates),
                model_error=2 * np.sqrt(spread * rounding) * (n / frames) / mean**2 / np.sqrt(counts.size) * 4,
            )
        )
        means.append(mean / n)
        seen.append(float(counts.var()) / mean**2)
        law.append((spread + noise) / mean**2)
    curves = (
        Curve("dark recording's spread, and counting", tuple(means), tuple(law)),
        Curve("SD", tuple(means), tuple(seen), "points"),
    )
    return Finding(
        tuple(comparisons), Plot("spikes per readout", "SD of an even field", curves, log_x=True, log_y=True)
    )


GOLDEN = (np.sqrt(5) - 1) / 2
DEAD = (1 - GOLDEN) / 4
"""0.0955: the search stops the sweep at a quarter at the earliest, and then keeps the last 0.618 of that quarter."""
THRESHOLD = 10.0
"""Width (frames) of the interval at which golden search as released ends."""


def _check_dead_zone(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the answers of golden fast search with the law, for a focus before and after 9.55 % of the sweep."""
    sensor = sensor_with_noise("shot", "threshold_noise", rows=48, columns=64)
    frames, focal, travel = 4000, 0.025, 0.001
    focus_positions, repeats = ((0.04, 0.4), 6) if quick else ((0.02, 0.04, 0.06, 0.08, 0.2, 0.3, 0.4, 0.5), 12)
    in_focus = focal * 0.5 / (0.5 - focal)
    scenes = []
    for focus_position in focus_positions:
        first = in_focus - focus_position * travel
        ends = [focal * v / (v - focal) for v in (first, first + travel)]
        lens = {"focal_length_mm": 25.0, "f_number": 2.0, "focus_range_m": ends}
        lights = {"lamp": ["lamp"], "room": ["room"]}
        scenes.append(lit_chequers(f"focus_{round(1000 * focus_position):03d}", lights=lights, lens=lens, chequers=230))
    workload = Workload(
        tuple(scenes),
        sensor,
        frames,
        exposure={"mean_rate": 0.3},
        focus={"positions": 33, "motion": {"kind": "sweep"}},
        render={"samples": 32, "max_depth": 3},
        split={"repeats": repeats},
    )
    dataset = maker.make(workload)
    found = {r.what.sequence: r for r in evaluate(dataset.folder, methods=["sd+sgfs_code"], region="frame").records}
    comparisons, seen = [], []
    for focus_position, scene in zip(focus_positions, scenes, strict=True):
        recordings = [dataset.find(scene=scene.id, repeat=n) for n in range(repeats)]
        records = [found[recording.id] for recording in recordings]
        answers = [
            float("nan") if record.judgement.position is None else float(record.judgement.position)
            for record in records
        ]
        with dataset.open(scene=scene.id, repeat=0) as stream:
            low, high = stream.truth.depth_of_focus
        depth = (high - low) / 2
        expected, at_least, at_most = focus_position, focus_position - depth, focus_position + depth
        if focus_position < DEAD:
            undecided = _find_undecided_width([dataset.folder / one.file for one in recordings], frames)
            expected, at_least, at_most = DEAD, DEAD - 1 / frames, DEAD + min(undecided / frames, depth)
        for end, answer in (("earliest", min(answers)), ("latest", max(answers))):
            name = f"focus at {focus_position:g}: {end} of {repeats} answers"
            comparisons.append(Comparison(name, answer, expected, at_least, at_most))
        seen.append(float(np.mean(answers)))
    x = np.linspace(0, max(focus_positions), 200)
    curves = (
        Curve("max(focus, 0.0955)", tuple(x.tolist()), tuple(np.maximum(x, DEAD).tolist())),
        Curve("mean answer", tuple(focus_positions), tuple(seen), "points"),
    )
    return Finding(tuple(comparisons), Plot("true focus, fraction of the sweep", "answer", curves))


def _find_undecided_width(streams: list[Path], frames: int) -> float:
    """Return the width (frames) of the widest interval at which noise may change the choice of golden search.

    If the focus is before the interval, golden search should always choose the earlier part. A choice is certain if the
    scores of its two windows, in recordings with different noise, predict (by Student's t distribution) that less than
    one in 10,000 other recordings changes it. The answer cannot leave the widest interval whose choice is not certain.
    If all choices are certain, the width is THRESHOLD, the width of the last interval.
    """
    measure, n = saf_gen.get_measure("sd"), len(streams)
    sure = deviations(FALSE_ALARM, freedom=n - 1) * np.sqrt(1 + 1 / n)
    first, width = round(DEAD * frames), GOLDEN * frames / 4
    with ExitStack() as opened:
        recordings = [opened.enter_context(saf_gen.open_stream(path)) for path in streams]
        while width > THRESHOLD:
            kept, differences = round(GOLDEN * width), []
            for stream in recordings:
                earlier, later = (stream.counts(a, a + kept) for a in (first, first + round(width) - kept))
                differences.append(measure(earlier) - measure(later))
            if np.mean(differences) < sure * np.std(differences, ddof=1):
                return width
            width *= GOLDEN
    return THRESHOLD


_SCATTER = "The scatter between pixels (one false alarm in 10,000 runs)"
LAWS = (
    Law(
        "dispersion_dark_end",
        "The SD of an even field is not 0 but the noise of counting: 1/m − 1 at few counts, then the exact law, and "
        "F/m + 1/(6·m²) only at many counts.",
        "E[SD] = V(m)/m², V = s² + 1/6 − π⁻² Σₖ cos(2πkm)·exp(−2π²k²s²)/k²",
        "SD: Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363; the law: https://dlmf.nist.gov/24.8.E1",
        "Even light of 0.3 to 30 counts per window of 100 frames, 100,000 pixels; the measure sd.",
        f"{_SCATTER}.",
        _check_dark_end,
    ),
    Law(
        "dispersion_dark_offset",
        "Dark charge adds its spread to SD; this part falls with the square of the light.",
        "E[SD] = (Var over pixels of n·d + V)/m², m = n·(q + d)/θ",
        "The variance of a sum (docs/spike-camera.md)",
        "Even light at five levels over dark charge, windows of 1,000 frames, and a dark recording of the same device.",
        f"{_SCATTER}, with each pixel compared with itself in the dark; and the rounding of the dark recording to "
        "whole spikes.",
        _check_dark_offset,
    ),
    Law(
        "dispersion_dead_zone",
        "Golden fast search as released cannot answer in the first 9.55 % of a sweep: it stops the sweep at a quarter "
        "at the earliest, and keeps the last 0.618 of that quarter.",
        "earliest answer = (1 − 0.618)/4 = 0.0955 of the sweep",
        "Released code of Su et al., CVPR 2024, doi:10.1109/CVPR52733.2024.02363",
        "Sweeps of 4,000 frames over a chequered plane whose focus is before or after that border, each recorded with "
        "twelve draws of noise; `evaluate` runs sd+sgfs_code.",
        "For a focus before the border, answers may be one frame before the border, and after it by the widest "
        "interval in which noise may change a choice (predicted from recordings with other noise, once in 10,000), at "
        "most half a depth of focus. For a focus after the border, they may differ from it by half a depth of focus.",
        _check_dead_zone,
    ),
)
