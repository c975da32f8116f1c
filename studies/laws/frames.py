"""Frames: the photon transfer of a frame camera, from the dark to its fullest pixels.

The camera is exposed to constant, even light directly, without a rendered scene: what is checked are its pixels.
"""

from dataclasses import replace

import numpy as np

from saf_gen.camera import get_sensor
from saf_gen.camera.frames import FrameCamera, FrameSensor
from studies.laws.law import FALSE_ALARM, Curve, Finding, Law, Plot, compare_mean
from studies.laws.workload import DatasetMaker

CHARGES = (100.0, 300.0, 1000.0, 3000.0, 9000.0)
READ_NOISE_E = 12.0
DARK_NOISE_E = (2.8, READ_NOISE_E, 120.0)


def _sensor() -> FrameSensor:
    noise = {"shot": True, "read": True, "dark": False, "response": False}
    return get_sensor("imx273", kind="frames", read_noise_e=READ_NOISE_E, noise=noise)


def _check_photon_transfer(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare means, and variances from pairs of frames, with the law."""
    shape, pairs = ((100, 160), 4) if quick else ((250, 400), 20)
    sensor = _sensor()
    k = sensor.electrons_per_level
    comparisons = []
    for seed, charge in enumerate(CHARGES, start=1):
        camera = FrameCamera(sensor, shape, seed=seed)
        light = np.full(shape, charge)
        frames = np.stack([camera.read(light, frame=number) for number in range(2 * pairs)]).astype(np.float64)
        what = f"{charge:g} electrons"
        variance = (charge + READ_NOISE_E**2) / k**2 + 1 / 12
        halves = np.square(frames[::2] - frames[1::2]) / 2
        figures = 2 * len(CHARGES)
        mean = sensor.black_level_dn + charge / k
        comparisons.append(compare_mean(f"mean, {what}", frames, expected=mean, figures=figures))
        comparisons.append(compare_mean(f"variance, {what}", halves, expected=variance, figures=figures))
    seen = comparisons[1::2]
    x = np.geomspace(CHARGES[0], CHARGES[-1], 40)
    error = tuple(one.high - one.measured for one in seen)
    curves = (
        Curve("law", tuple(x / k), tuple((x + READ_NOISE_E**2) / k**2 + 1 / 12)),
        Curve("camera", tuple(charge / k for charge in CHARGES), tuple(one.measured for one in seen), "points", error),
    )
    axes = "mean above the black level, levels", "variance, levels²"
    return Finding(tuple(comparisons), Plot(*axes, curves, log_x=True, log_y=True))


def _check_dark(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare mean and variance of frames without light with the law, at the read noise of the camera and at others."""
    shape, pairs = ((100, 160), 4) if quick else ((250, 400), 20)
    light, comparisons = np.zeros(shape), []
    for seed, read_e in enumerate(DARK_NOISE_E, start=1):
        sensor = replace(_sensor(), read_noise_e=read_e)
        camera = FrameCamera(sensor, shape, seed=seed)
        frames = np.stack([camera.read(light, frame=number) for number in range(2 * pairs)]).astype(np.float64)
        variance = (read_e / sensor.electrons_per_level) ** 2 + 1 / 12
        halves, what = np.square(frames[::2] - frames[1::2]) / 2, f"read noise of {read_e:g} electrons"
        figures = 2 * len(DARK_NOISE_E)
        comparisons.append(compare_mean(f"mean, {what}", frames, expected=sensor.black_level_dn, figures=figures))
        comparisons.append(compare_mean(f"variance, {what}", halves, expected=variance, figures=figures))
    return Finding(tuple(comparisons))


LAWS = (
    Law(
        "frames_photon_transfer",
        "The variance of a frame camera's numbers is that of electrons, of the reading, and of rounding to levels.",
        "mean = black level + charge/K, Var = (charge + read²)/K² + 1/12, K electrons per level",
        "EMVA Standard 1288, release 4.0, 2021, section 2.2",
        f"Even light of {', '.join(f'{charge:g}' for charge in CHARGES)} electrons per exposure; 20 pairs of frames of "
        f"100,000 pixels, with a read noise of {READ_NOISE_E:g} electrons.",
        f"Only scatter: all figures together fail correct code once in {1 / FALSE_ALARM:,.0f} runs.",
        _check_photon_transfer,
    ),
    Law(
        "frames_dark",
        "Without light a frame camera's numbers lie about its black level, and their noise is not cut off at 0.",
        "mean = black level, Var = read²/K² + 1/12, K electrons per level",
        "EMVA Standard 1288, release 4.0, 2021, section 2.2",
        f"No light and no dark current, with a read noise of {', '.join(f'{read_e:g}' for read_e in DARK_NOISE_E)} "
        "electrons; 20 pairs of frames of 100,000 pixels each.",
        f"Only scatter: all figures together fail correct code once in {1 / FALSE_ALARM:,.0f} runs.",
        _check_dark,
    ),
)
