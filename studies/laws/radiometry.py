"""Radiometry: firing rate against f-number, magnification, field angle and five decades of light.

The scene is an evenly glowing panel of known radiance in front of a lens; closed forms give the rate of each pixel in
absolute units. Shot and threshold noise are on; fixed pattern and dark signal are off.
"""

from itertools import pairwise
from typing import Any

import numpy as np

from saf_gen.camera.counting_law import noise_per_spike
from saf_gen.camera.sensor import Sensor
from studies.laws.law import Comparison, Curve, Finding, Law, Plot, compare_mean
from studies.laws.scenes import even_panel, gain_of_rate, glowing_panel
from studies.laws.theory import charge_of_rate, charge_per_radiance, firing_rate, off_axis
from studies.laws.workload import DatasetMaker, Workload, sensor_with_noise

F_NUMBERS = (1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0)
SETTLED = 100
"""Frames that are left out at the beginning of a recording."""
UNEVEN = 1e-5
"""Relative unevenness that bends by waves leave in even light (docs/renderer.md#waves)."""


def rounding_error(rate: float) -> float:
    """Return the relative error of a rate in single precision: half a unit in the last place of θ at each readout."""
    return 2.0**-25 / rate


def _sensor(quick: bool, **changes: Any) -> Sensor:
    """Return a sensor of 8 mm × 5 mm, with larger pixels at the small size."""
    size: dict[str, Any] = (
        {"rows": 50, "columns": 80, "pitch_m": 1e-4} if quick else {"rows": 125, "columns": 200, "pitch_m": 4e-5}
    )
    return sensor_with_noise("shot", "threshold_noise", **size, **changes)


def _check_f_number(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare firing rates at f-numbers N from 1.4 to 16 with a charge proportional to 1/N²."""
    numbers = F_NUMBERS[::3] if quick else F_NUMBERS
    sensor, frames = _sensor(quick), 1000 if quick else 4000
    focal, near, far = 0.2, 9.0, 12.0
    v = focal * far / (far - focal)
    x = off_axis((sensor.rows, sensor.columns), sensor.pitch_m)
    widest = charge_per_radiance(sensor, f_number=1.4, focal_length_m=focal, image_distance_m=v, off_axis_m=0.0)
    radiance = float(charge_of_rate(0.9, sensor) / widest)
    scenes = tuple(
        glowing_panel(
            f"panel_f{round(10 * n):03d}",
            radiance=radiance,
            depth_m=10.0,
            half_m=2.0,
            lens={"focal_length_mm": 1000 * focal, "f_number": n, "focus_range_m": [far, near]},
        )
        for n in numbers
    )
    dataset = maker.make(Workload(scenes, sensor, frames))
    comparisons, rates, law = [], [], []
    for n, scene in zip(numbers, scenes, strict=True):
        charge = radiance * charge_per_radiance(
            sensor, f_number=n, focal_length_m=focal, image_distance_m=v, off_axis_m=x
        )
        expected = firing_rate(charge, sensor)
        with dataset.open(scene=scene.id) as stream:
            seen = stream.counts(SETTLED, frames) / (frames - SETTLED)
        rate = float(expected.mean())
        comparisons.append(
            compare_mean(
                f"f/{n:g}: rate / law",
                seen / expected,
                expected=1.0,
                figures=len(numbers),
                model_error=UNEVEN + rounding_error(rate),
            )
        )
        rates.append(float(seen.mean()))
        law.append(rate)
    curves = (Curve("law", tuple(numbers), tuple(law)), Curve("stream", tuple(numbers), tuple(rates), "points"))
    return Finding(tuple(comparisons), Plot("f-number", "rate", curves, log_x=True, log_y=True))


def _check_bellows(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare firing rates along a sweep from magnification M = 0 to 1 with a charge proportional to 1/(1 + M)²."""
    sensor, frames, focal, positions = _sensor(quick), 2000 if quick else 8000, 0.025, 129
    ends = (1000.0, 2 * focal)
    nearest, farthest = (focal * u / (u - focal) for u in ends)
    axis = charge_per_radiance(sensor, f_number=4.0, focal_length_m=focal, image_distance_m=nearest, off_axis_m=0.0)
    radiance = float(charge_of_rate(0.8, sensor) / axis)
    lens = {"focal_length_mm": 1000 * focal, "f_number": 4.0, "focus_range_m": list(ends)}
    panel = glowing_panel("panel_bellows", radiance=radiance, depth_m=0.6, half_m=0.4, lens=lens)
    focus = {"positions": positions, "motion": {"kind": "sweep"}}
    dataset = maker.make(Workload((panel,), sensor, frames, focus=focus))
    x = off_axis((sensor.rows, sensor.columns), sensor.pitch_m)
    windows = [(start, start + frames // 20) for start in range(frames // 20, frames, frames // 20)]
    comparisons, magnifications, seen, law = [], [], [], []
    # Charge is interpolated linearly between positions; relative to 1/v², the chord is too high by ≤ 3/4·(step/v)².
    chord = 0.75 * ((farthest - nearest) / (positions - 1) / nearest) ** 2
    with dataset.open() as stream:
        for start, stop in windows:
            times = (start + (stop - start) * (np.arange(25) + 0.5) / 25) / frames  # middles of 25 equal parts
            v = nearest + (farthest - nearest) * times
            rates = np.mean(
                [
                    firing_rate(
                        radiance
                        * charge_per_radiance(
                            sensor, f_number=4.0, focal_length_m=focal, image_distance_m=one, off_axis_m=x
                        ),
                        sensor,
                    )
                    for one in v
                ],
                axis=0,
            )
            counts = stream.counts(start, stop) / (stop - start)
            magnification = float(v.mean()) / focal - 1
            found = compare_mean(
                f"M = {magnification:.2f}: rate / law",
                counts / rates,
                expected=1.0,
                figures=len(windows),
                model_error=UNEVEN + rounding_error(0.2) + chord,
            )
            comparisons.append(found)
            magnifications.append(magnification)
            seen.append(float(counts.mean()))
            law.append(float(rates.mean()))
    curves = (
        Curve("law", tuple(magnifications), tuple(law)),
        Curve("stream", tuple(magnifications), tuple(seen), "points"),
    )
    return Finding(tuple(comparisons), Plot("magnification", "rate", curves))


def _check_field_angle(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare firing rates in rings around the axis, out to 30 degrees, with a charge proportional to cos⁴."""
    sensor, frames, focal, far = _sensor(quick), 1000 if quick else 4000, 0.008, 0.6
    v = focal * far / (far - focal)
    x = off_axis((sensor.rows, sensor.columns), sensor.pitch_m)
    per_radiance = charge_per_radiance(sensor, f_number=2.8, focal_length_m=focal, image_distance_m=v, off_axis_m=x)
    radiance = float(charge_of_rate(0.6, sensor) / per_radiance.max())
    lens = {"focal_length_mm": 1000 * focal, "f_number": 2.8, "focus_range_m": [far, 0.4]}
    panel = glowing_panel("panel_wide", radiance=radiance, depth_m=0.5, half_m=0.6, lens=lens)
    dataset = maker.make(Workload((panel,), sensor, frames))
    expected = firing_rate(radiance * per_radiance, sensor)
    with dataset.open() as stream:
        seen = stream.counts(SETTLED, frames) / (frames - SETTLED)
    angle = np.degrees(np.arctan(x / v))
    rings = np.linspace(0, angle.max() + 1e-9, 4 if quick else 9)
    # saf_gen uses the angle at the centre of a pixel; the mean over the pixel differs by the curvature of cos⁴.
    curvature = 20 * (sensor.pitch_m / v) ** 2 / 24
    comparisons, middles, rates, law = [], [], [], []
    for first, last in pairwise(rings):
        ring = (angle >= first) & (angle < last)
        comparisons.append(
            compare_mean(
                f"{first:.1f} to {last:.1f} degrees: rate / law",
                seen[ring] / expected[ring],
                expected=1.0,
                figures=len(rings) - 1,
                model_error=UNEVEN + rounding_error(0.3) + curvature,
            )
        )
        middles.append(float(angle[ring].mean()))
        rates.append(float(seen[ring].mean()))
        law.append(float(expected[ring].mean()))
    curves = (Curve("law", tuple(middles), tuple(law)), Curve("stream", tuple(middles), tuple(rates), "points"))
    return Finding(tuple(comparisons), Plot("field angle, degrees", "rate", curves))


def _check_decades(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare firing rates over five decades of light with both laws of saturation."""
    frames = 2000 if quick else 20_000
    light = np.geomspace(1e-2, 3.16, 4) if quick else np.geomspace(1e-5, 3.16, 12)
    comparisons: list[Comparison] = []
    curves = []
    for saturation in ("subtract", "dead_readout"):
        size: dict[str, Any] = {"rows": 50, "columns": 80} if quick else {"rows": 100, "columns": 160}
        sensor = sensor_with_noise("shot", "threshold_noise", **size, saturation=saturation)
        per_threshold = gain_of_rate(0.5, sensor) / (float(charge_of_rate(0.5, sensor)) / sensor.threshold_e)
        lights = {f"light_{n:02d}": {"kind": "constant", "level": q * per_threshold} for n, q in enumerate(light)}
        dataset = maker.make(Workload((even_panel(),), sensor, frames, lights))
        rates, law = [], []
        for name, q in zip(lights, light, strict=True):
            expected = float(firing_rate(q * sensor.threshold_e, sensor))
            with dataset.open(light=name) as stream:
                seen = stream.counts(SETTLED, frames) / (frames - SETTLED)
            comparisons.append(
                compare_mean(
                    f"{saturation}, {q:.3g} thresholds per readout: rate / law",
                    seen / expected,
                    expected=1.0,
                    figures=2 * light.size,
                    model_error=UNEVEN
                    + rounding_error(float(q))
                    + _end_effect(float(q), saturation) / (frames - SETTLED) / expected
                    + _lost_at_the_cap(float(q), sensor),
                )
            )
            rates.append(float(seen.mean()))
            law.append(expected)
        x = tuple(light.tolist())
        curves += [
            Curve(f"law, {saturation}", x, tuple(law)),
            Curve(f"stream, {saturation}", x, tuple(rates), "points"),
        ]
    plot = Plot("charge per readout, in thresholds", "rate", tuple(curves), log_x=True, log_y=True)
    return Finding(tuple(comparisons), plot)


def _end_effect(charge: float, saturation: str) -> float:
    """Return the mean number of spikes per pixel that the ends of a window may add or remove.

    ``charge``, q, is in thresholds per readout. With ``subtract``, phases are uniformly distributed at the start and
    remain so. With ``dead_readout``, no pixel is dead at the start. For N spikes in W readouts, conservation of charge
    gives N·(1 + q) = q·W + q·(spikes in the last readout − spikes in the one before the first) − (charge held after −
    charge held before). A readout has at most min(q, 1) spikes per pixel. The charge held is uniform at the start; its
    later mean is within q/2 of the mean at the start, or within q beyond saturation.
    """
    if saturation == "subtract":
        return 0.0
    return (charge * charge + charge / 2 if charge < 1 else 2 * charge) / (1 + charge)


def _lost_at_the_cap(charge: float, sensor: Sensor) -> float:
    """Return the largest fraction of the rate that ``subtract`` loses by keeping at most one threshold of excess.

    Close to saturation, within the noise, a pixel that has just fired may hold more than that. Charge then diffuses
    over the cap, by at most σ²/2 per spike: half the variance of a threshold, for a uniform density.
    """
    return noise_per_spike(sensor) / 2 if sensor.saturation == "subtract" and charge > 0.9 else 0.0


_TOLERANCE = (
    "The scatter between pixels (one false alarm in 10,000 runs), 10⁻⁵ for the unevenness that waves leave, and half "
    "a unit in the last place of single precision per readout"
)
LAWS = (
    Law(
        "radiometry_f_number",
        "An evenly lit pixel collects charge in proportion to the area of the aperture.",
        "rate = q/(θ + ℓ·q), q = π·R²/v²·cos⁴ϑ·L·pitch²·FF·QE·λ/(h·c)/F, R = f/(2N)",
        "M. Born and E. Wolf, Principles of Optics, section 4.8, doi:10.1017/CBO9781139644181",
        "A panel of known radiance in front of 200 mm lenses from f/1.4 to f/16, in absolute units, at rates of 0.007 "
        "to 0.9.",
        f"{_TOLERANCE}.",
        _check_f_number,
    ),
    Law(
        "radiometry_bellows",
        "A lens that is moved out to magnification M loses light by the factor 1/(1 + M)².",
        "E = π·R²/v²·cos⁴ϑ·L, v = f·(1 + M)",
        "M. Born and E. Wolf, Principles of Optics, section 4.8, doi:10.1017/CBO9781139644181",
        "A sweep of a 25 mm lens from infinity to magnification 1, at 129 positions; 19 windows.",
        f"{_TOLERANCE}; 3/4·(step/v)² for linear interpolation between positions.",
        _check_bellows,
    ),
    Law(
        "radiometry_field_angle",
        "Off the axis, light falls with the fourth power of the cosine of the field angle.",
        "E(ϑ) = E(0)·cos⁴ϑ",
        "M. Born and E. Wolf, Principles of Optics, section 4.8, doi:10.1017/CBO9781139644181",
        "A panel in front of an 8 mm lens: rings around the axis, out to 30 degrees.",
        f"{_TOLERANCE}; the curvature of cos⁴ within a pixel.",
        _check_field_angle,
    ),
    Law(
        "radiometry_decades",
        "The firing rate follows the light over five decades, and saturates by the law of the sensor.",
        "subtract: min(1, q/(θ + ℓ·q)); dead_readout: 1/(1 + θ/q)",
        "Acnext/SCSim; BIT-Vision/RSIR and SpikeNeRF calibrations (docs/spike-camera.md, *Saturation*)",
        "Even light from 10⁻⁵ to 3.16 thresholds per readout, with both laws of saturation, in 20,000 frames of 16,000 "
        "pixels.",
        f"{_TOLERANCE}, which is 0.3 % at 10⁻⁵. For dead_readout, the effect of the ends of the window, because phases "
        "are not uniform at the start. For subtract near saturation, 3·10⁻⁵, half the variance of a threshold: a pixel "
        "keeps at most one threshold of excess charge, and loses what noise adds above that (measured: 1.5·10⁻⁵).",
        _check_decades,
    ),
)
