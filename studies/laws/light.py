"""Light over time: flicker, ramps, and sums of light groups."""

from typing import Any

import numpy as np

from studies.laws.law import Curve, Finding, Law, Plot, compare_mean
from studies.laws.radiometry import SETTLED, UNEVEN, rounding_error
from studies.laws.scenes import even_panel, gain_of_rate, lit_chequers
from studies.laws.theory import charge_of_rate, firing_rate
from studies.laws.workload import DatasetMaker, MadeDataset, Workload, sensor_with_noise

DEPTH = 0.8


def _check_flicker(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the amplitude of a lamp's flicker in windows of several lengths with sinc (0 for whole periods)."""
    size: dict[str, Any] = {"rows": 50, "columns": 80} if quick else {"rows": 125, "columns": 200}
    sensor, frames, rate = sensor_with_noise("shot", "threshold_noise", **size), 1600, 0.2
    level = gain_of_rate(rate, sensor)
    lights = {f"mains_{hz}": {"kind": "flicker", "hz": hz, "depth": DEPTH, "level": level} for hz in (100, 120)}
    dataset = maker.make(Workload((even_panel(),), sensor, frames, lights))
    windows = {100: (50, 100, 150, 200, 250, 400, 600), 120: (50, 150, 250, 350, 500, 750, 1000)}
    figures = sum(map(len, windows.values()))
    comparisons, curves = [], []
    for hz, sizes in windows.items():
        span = 200 if hz == 100 else 500  # whole periods and whole readouts
        starts = np.arange(0, span, 20)
        seen = []
        with dataset.open(light=f"mains_{hz}") as stream:
            for n in sizes:
                # The amplitude is twice the mean, over whole periods, of the counts times the cosine.
                wave = np.cos(2 * np.pi * hz * (starts + n / 2) / sensor.readout_hz)
                images = [stream.counts(SETTLED + int(s), SETTLED + int(s) + n).astype(float) for s in starts]
                phase = 2 * np.pi * hz * SETTLED / sensor.readout_hz
                quadrature = np.sin(2 * np.pi * hz * (starts + n / 2) / sensor.readout_hz)
                turned = np.cos(phase) * wave - np.sin(phase) * quadrature
                amplitude = 2 * np.mean([image * w for image, w in zip(images, turned, strict=True)], axis=0)
                law = _flicker_amplitude(n, hz=hz, readout_hz=sensor.readout_hz)
                found = compare_mean(
                    f"{hz} Hz in windows of {n} frames: amplitude / mean",
                    amplitude / (n * rate),
                    expected=law,
                    figures=figures,
                    # The loss at a spike makes the rate nonlinear by ℓ·rate: that adds second harmonics, which are not
                    # measured here, and changes the depth by 2·ℓ·rate.
                    model_error=2 * sensor.reset_loss * rate * abs(law) + UNEVEN,
                )
                comparisons.append(found)
                seen.append(found.measured)
        fine = np.arange(20, 1001, 5)
        shown = [abs(_flicker_amplitude(int(n), hz=hz, readout_hz=sensor.readout_hz)) for n in fine]
        curves += [
            Curve(f"law, {hz} Hz", tuple(fine.tolist()), tuple(shown)),
            Curve(f"stream, {hz} Hz", tuple(map(float, sizes)), tuple(map(abs, seen)), "points"),
        ]
    return Finding(tuple(comparisons), Plot("frames of a window", "amplitude / mean", tuple(curves)))


def _flicker_amplitude(frames: int, *, hz: float, readout_hz: float) -> float:
    """Return the amplitude of the flicker in a window of ``frames`` by its law, divided by the mean."""
    return float(DEPTH * np.sinc(hz * frames / readout_hz))


def _check_ramp(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare counts along a linear ramp of light with the law, which has no steps where θ/q passes whole numbers."""
    size: dict[str, Any] = {"rows": 50, "columns": 80} if quick else {"rows": 125, "columns": 200}
    sensor, frames = sensor_with_noise("shot", "threshold_noise", **size), 1000 if quick else 4000
    ends = (0.05, 0.8)
    gains = [gain_of_rate(rate, sensor) for rate in ends]
    lights = {"ramp": {"kind": "ramp", "from": gains[0], "to": gains[1]}}
    dataset = maker.make(Workload((even_panel(),), sensor, frames, lights))
    first, last = (float(charge_of_rate(rate, sensor)) for rate in ends)
    charge = np.linspace(first, last, 2 * frames + 1)[1::2]
    rates = firing_rate(charge, sensor)
    step = frames // 40
    starts = range(step, frames, step)
    comparisons, middles, seen = [], [], []
    with dataset.open() as stream:
        for start in starts:
            law = float(rates[start : start + step].sum())
            counts = stream.counts(start, start + step)
            found = compare_mean(
                f"frames {start:,} to {start + step:,}: count / law",
                counts / law,
                expected=1.0,
                figures=len(starts),
                # A spike loses light of the next readout, which is a bit brighter: ℓ times the change in an interval.
                model_error=UNEVEN
                + rounding_error(0.05)
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
    return Finding(tuple(comparisons), Plot("rate", "count / law", curves))


def _check_additivity(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare a stream of two light groups with the sum of a stream of each, and with one render of all lamps."""
    size: dict[str, Any] = (
        {"rows": 50, "columns": 80, "pitch_m": 1e-4} if quick else {"rows": 125, "columns": 200, "pitch_m": 4e-5}
    )
    sensor, frames = sensor_with_noise("shot", "threshold_noise", **size), 2000
    separate_scene = lit_chequers("two_groups", lights={"lamp": ["lamp"], "room": ["room"]})
    joint_scene = lit_chequers("one_group", lights={"both": ["lamp", "room"]})
    off, on = {"kind": "constant", "level": 0.0}, {"kind": "constant", "level": 0.2}
    lights = {"lamp_alone": {"lamp": on, "room": off}, "room_alone": {"lamp": off, "room": on}, "all": on}
    render = {"samples": 16 if quick else 64, "max_depth": 3, "estimator": "plain"}
    separate_groups = maker.make(Workload((separate_scene,), sensor, frames, lights, render=render))
    joint_group = maker.make(Workload((joint_scene,), sensor, frames, {"all": on}, render=render))

    def charge(dataset: MadeDataset, light: str) -> np.ndarray:
        with dataset.open(light=light) as stream:
            rate = stream.counts(SETTLED, frames) / (frames - SETTLED)
        return np.asarray(charge_of_rate(rate, sensor))

    lamp, room, both = (charge(separate_groups, light) for light in lights)
    one_render = charge(joint_group, "all")
    mean = float(both.mean())
    comparisons = (
        compare_mean("relative difference, pixel by pixel", (lamp + room - both) / mean, expected=0.0, figures=2),
        compare_mean(
            "relative difference from one render, in blocks",
            _blocks((both - one_render) / mean),
            expected=0.0,
            figures=2,
        ),
    )
    row = both.shape[0] // 2
    x = tuple(map(float, range(both.shape[1])))
    curves = (
        Curve("lamp + room", x, tuple((lamp + room)[row].tolist())),
        Curve("both", x, tuple(both[row].tolist()), "points"),
    )
    return Finding(comparisons, Plot("column of the middle row", "charge, e⁻ per readout", curves))


def _blocks(image: np.ndarray) -> np.ndarray:
    """Return the means of blocks of 10 × 10 pixels; neighbouring blocks share few light paths."""
    rows, columns = (size // 10 * 10 for size in image.shape)
    return image[:rows, :columns].reshape(rows // 10, 10, columns // 10, 10).mean(axis=(1, 3))


LAWS = (
    Law(
        "light_flicker",
        "A lamp's flicker vanishes in windows of whole periods, and follows sinc in all others.",
        "amplitude(n) = depth·sinc(f·n/F); 100 Hz: 0 for n = 200, 400, …; 120 Hz: 0 for n = 500, 1,000, …",
        "R. N. Bracewell, The Fourier Transform and Its Applications (the mean over a window is a convolution "
        "with a box)",
        "Even light with a modulation depth of 0.8 at 100 and 120 Hz; windows of 50 to 1,000 frames that start "
        "throughout a period.",
        "The scatter between pixels (one false alarm in 10,000 runs), and 2·ℓ·rate of the amplitude, because the loss "
        "at a spike makes the rate nonlinear.",
        _check_flicker,
    ),
    Law(
        "light_ramp",
        "Under a linear ramp of light, counts follow the light, without a staircase of whole intervals.",
        "E[count] = Σ q(t)/(θ + ℓ·q(t))",
        "The law of rates (docs/spike-camera.md); a hard reset would give 1/⌈θ/q⌉",
        "Even light that rises from a rate of 0.05 to 0.8; 39 windows.",
        "The scatter between pixels (one false alarm in 10,000 runs), and the change of light within an interval times "
        "the loss at a spike.",
        _check_ramp,
    ),
    Law(
        "light_additivity",
        "Light adds up: groups recorded alone, groups together in one stream, and one render of all lamps agree.",
        "q(lamp) + q(room) = q(lamp and room)",
        "Linearity of the light transport equation: J. T. Kajiya, The rendering equation, 1986, "
        "doi:10.1145/15922.15902",
        "A chequered plane lit by a lamp and a room, as two light groups and as one, by the plain estimator; 2,000 "
        "frames.",
        "The scatter between pixels, and between blocks of 10 × 10 pixels for two renders (one false alarm in 10,000 "
        "runs).",
        _check_additivity,
    ),
)
