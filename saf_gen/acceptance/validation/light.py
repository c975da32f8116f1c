"""Light over time: flicker, ramps, and the sum of light groups."""

from typing import Any

import numpy as np

from saf_gen.acceptance.validation.check import Check, Curve, Finding, Plot
from saf_gen.acceptance.validation.inference import compare_mean_with_law
from saf_gen.acceptance.validation.radiometry import SETTLED, UNEVEN, rounding_error_of_law
from saf_gen.acceptance.validation.theory import charge_of_rate_by_law, firing_rate_by_law
from saf_gen.acceptance.validation.workload import DatasetMaker, Made, Workload, workload_sensor_with_noise
from saf_gen.acceptance.validation.written_scenes import (
    even_panel_of_workload,
    gain_of_rate_by_law,
    lit_chequers_of_workload,
)

DEPTH = 0.8


def _check_flicker(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare how strongly windows follow a lamp's flicker with sinc: not at all over whole periods."""
    size: dict[str, Any] = {"rows": 50, "columns": 80} if quick else {"rows": 125, "columns": 200}
    sensor, frames, rate = workload_sensor_with_noise("shot", "threshold_noise", **size), 1600, 0.2
    level = gain_of_rate_by_law(rate, sensor)
    lights = {f"mains_{hz}": {"kind": "flicker", "hz": hz, "depth": DEPTH, "level": level} for hz in (100, 120)}
    made = maker.make(Workload((even_panel_of_workload(),), sensor, frames, lights))
    windows = {100: (50, 100, 150, 200, 250, 400, 600), 120: (50, 150, 250, 350, 500, 750, 1000)}
    figures = sum(map(len, windows.values()))
    comparisons, curves = [], []
    for hz, sizes in windows.items():
        span = 200 if hz == 100 else 500  # whole periods and whole readouts
        starts = np.arange(0, span, 20)
        seen = []
        with made.open(light=f"mains_{hz}") as stream:
            for n in sizes:
                # Twice the mean of counts times the cosine over whole periods is the amplitude.
                wave = np.cos(2 * np.pi * hz * (starts + n / 2) / sensor.readout_hz)
                images = [stream.counts(SETTLED + int(s), SETTLED + int(s) + n).astype(float) for s in starts]
                phase = 2 * np.pi * hz * SETTLED / sensor.readout_hz
                quadrature = np.sin(2 * np.pi * hz * (starts + n / 2) / sensor.readout_hz)
                turned = np.cos(phase) * wave - np.sin(phase) * quadrature
                amplitude = 2 * np.mean([image * w for image, w in zip(images, turned, strict=True)], axis=0)
                law = _flicker_amplitude(n, hz=hz, rate=rate, readout_hz=sensor.readout_hz)
                found = compare_mean_with_law(
                    f"{hz} Hz in windows of {n} frames: amplitude over mean",
                    amplitude / (n * rate),
                    expected=law,
                    figures=figures,
                    # Loss at a spike bends the rate by ℓ·rate: second harmonics, not these, but the depth by 2·ℓ·rate.
                    model_error=2 * sensor.reset_loss * rate * abs(law) + UNEVEN,
                )
                comparisons.append(found)
                seen.append(found.measured)
        fine = np.arange(20, 1001, 5)
        shown = [abs(_flicker_amplitude(int(n), hz=hz, rate=rate, readout_hz=sensor.readout_hz)) for n in fine]
        curves += [
            Curve(f"law, {hz} Hz", tuple(fine.tolist()), tuple(shown)),
            Curve(f"stream, {hz} Hz", tuple(map(float, sizes)), tuple(map(abs, seen)), "points"),
        ]
    return Finding(tuple(comparisons), Plot("frames of a window", "amplitude over mean", tuple(curves)))


def _flicker_amplitude(frames: int, *, hz: float, rate: float, readout_hz: float) -> float:
    return float(DEPTH * np.sinc(hz * frames / readout_hz))


def _check_ramp(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare spikes along an even ramp of light with the law: no staircase where θ/q passes whole numbers."""
    size: dict[str, Any] = {"rows": 50, "columns": 80} if quick else {"rows": 125, "columns": 200}
    sensor, frames = workload_sensor_with_noise("shot", "threshold_noise", **size), 1000 if quick else 4000
    ends = (0.05, 0.8)
    gains = [gain_of_rate_by_law(rate, sensor) for rate in ends]
    lights = {"ramp": {"kind": "ramp", "from": gains[0], "to": gains[1]}}
    made = maker.make(Workload((even_panel_of_workload(),), sensor, frames, lights))
    first, last = (float(charge_of_rate_by_law(rate, sensor)) for rate in ends)
    charge = np.linspace(first, last, 2 * frames + 1)[1::2]
    rates = firing_rate_by_law(charge, sensor)
    step = frames // 40
    starts = range(step, frames, step)
    comparisons, middles, seen = [], [], []
    with made.open() as stream:
        for start in starts:
            law = float(rates[start : start + step].sum())
            counts = stream.counts(start, start + step)
            found = compare_mean_with_law(
                f"frames {start:,} to {start + step:,}: count over law",
                counts / law,
                expected=1.0,
                figures=len(starts),
                # A spike loses light of the readout after it, a little brighter: ℓ times the change in an interval.
                model_error=UNEVEN
                + rounding_error_of_law(0.05)
                + sensor.reset_loss * (charge[1] - charge[0]) / charge[0] * 20,
            )
            comparisons.append(found)
            middles.append(float(rates[start : start + step].mean()))
            seen.append(found)
    curves = (
        Curve("law", tuple(middles), tuple(1.0 for _ in middles)),
        Curve(
            "stream",
            tuple(middles),
            tuple(one.measured for one in seen),
            "points",
            tuple(one.high - one.measured for one in seen),
        ),
    )
    return Finding(tuple(comparisons), Plot("rate", "count over law", curves))


def _check_additivity(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the sum of two light groups, each alone, with both in one stream, and with one render of both lamps."""
    size: dict[str, Any] = (
        {"rows": 50, "columns": 80, "pitch_m": 1e-4} if quick else {"rows": 125, "columns": 200, "pitch_m": 4e-5}
    )
    sensor, frames = workload_sensor_with_noise("shot", "threshold_noise", **size), 2000
    apart = lit_chequers_of_workload("two_groups", lights={"lamp": ["lamp"], "room": ["room"]})
    together = lit_chequers_of_workload("one_group", lights={"both": ["lamp", "room"]})
    off, on = {"kind": "constant", "level": 0.0}, {"kind": "constant", "level": 0.2}
    lights = {"lamp_alone": {"lamp": on, "room": off}, "room_alone": {"lamp": off, "room": on}, "all": on}
    render = {"samples": 16 if quick else 64, "max_depth": 3, "estimator": "plain"}
    alone = maker.make(Workload((apart,), sensor, frames, lights, render=render))
    whole = maker.make(Workload((together,), sensor, frames, {"all": on}, render=render))

    def charge(made: Made, light: str) -> np.ndarray:
        with made.open(light=light) as stream:
            rate = stream.counts(SETTLED, frames) / (frames - SETTLED)
        return np.asarray(charge_of_rate_by_law(rate, sensor))

    lamp, room, both = (charge(alone, light) for light in lights)
    one_render = charge(whole, "all")
    mean = float(both.mean())
    comparisons = (
        compare_mean_with_law(
            "difference, pixel by pixel, over the mean", (lamp + room - both) / mean, expected=0.0, figures=2
        ),
        compare_mean_with_law("to one render, in blocks", _blocks((both - one_render) / mean), expected=0.0, figures=2),
    )
    row = both.shape[0] // 2
    x = tuple(map(float, range(both.shape[1])))
    curves = (
        Curve("lamp + room", x, tuple((lamp + room)[row].tolist())),
        Curve("both", x, tuple(both[row].tolist()), "points"),
    )
    return Finding(
        comparisons[:2] + comparisons[3:], Plot("column of the middle row", "charge, e⁻ per readout", curves)
    )


def _blocks(image: np.ndarray) -> np.ndarray:
    """Return the means of blocks of 10 × 10 pixels, which share hardly any light path."""
    rows, columns = (size // 10 * 10 for size in image.shape)
    return image[:rows, :columns].reshape(rows // 10, 10, columns // 10, 10).mean(axis=(1, 3))


CHECKS = (
    Check(
        "light_flicker",
        "A lamp's flicker is gone from windows of whole periods, and is there by sinc in all others.",
        "amplitude(n) = depth·sinc(f·n/F); 100 Hz: 0 for n = 200, 400, …; 120 Hz: 0 for n = 500, 1,000, …",
        "R. N. Bracewell, The Fourier Transform and Its Applications (the mean over a window is a convolution "
        "with a box)",
        "Even light with a modulation depth of 0.8 at 100 and 120 Hz; windows of 50 to 1,000 frames, started all "
        "over a period.",
        "The scatter of pixels (once in 10,000 runs by chance), and 2·ℓ·rate of the amplitude: the loss at a "
        "spike bends the rate.",
        _check_flicker,
    ),
    Check(
        "light_ramp",
        "Under an even ramp spikes follow the light evenly: no staircase of whole intervals.",
        "E[count] = Σ q(t)/(θ + ℓ·q(t))",
        "The law of rates (docs/explanation/spike-camera.md); a hard reset would give 1/⌈θ/q⌉",
        "Even light that rises from a rate of 0.05 to 0.8; 39 windows.",
        "The scatter of pixels (once in 10,000 runs by chance), and the change of light within an interval times "
        "the loss at a spike.",
        _check_ramp,
    ),
    Check(
        "light_additivity",
        "Light adds up: groups alone, groups together in a stream, and one render of all lamps agree.",
        "q(lamp) + q(room) = q(lamp and room)",
        "Linearity of the light transport equation: J. T. Kajiya, The rendering equation, 1986, "
        "doi:10.1145/15922.15902",
        "A chequered plane under a lamp and a room, as two groups and as one; plain light paths, 2,000 frames.",
        "The scatter of pixels, and of blocks of 10 × 10 pixels between two renders (once in 10,000 runs by chance).",
        _check_additivity,
    ),
)
