"""Single photons: how the bits of an array saturate, with a clocked recharge and with a dead time, and afterpulses.

The array is exposed to constant, even light directly, without a rendered scene: what is checked are its pixels.
"""

from dataclasses import replace

import numpy as np

from saf_gen.camera import get_sensor
from saf_gen.camera.photons import SpadCamera, SpadSensor
from saf_gen.camera.photons.sensor import detection_rate
from studies.laws.law import FALSE_ALARM, Curve, Finding, Law, Plot, compare_mean
from studies.laws.workload import DatasetMaker

PHOTONS = (0.01, 0.1, 0.3, 0.7, 1.5, 3.0, 6.0)
DEAD_FRAMES = (0.05, 0.5, 2.0)
AFTERPULSE = 0.1
FRAMES, FRAMES_OF_RENEWALS = 20_000, 2000  # the latter because avalanche by avalanche costs fifty times as much
BLOCK_FRAMES = 1000
QUIET = {"dark": False, "response": False, "dead_time": False, "afterpulsing": False}
BEGIN = 40  # frames after which a pixel has forgotten that it began alive


def _rates(sensor: SpadSensor, photons: float, *, frames: int, quick: bool, seed: int) -> np.ndarray:
    """Return the share of the frames in which each pixel detects a photon, (P,)."""
    frames, shape = (1000, (40, 64)) if quick else (frames, (250, 400))
    camera = SpadCamera(sensor, shape, seed=seed)
    light = np.full((1, 1, *shape), photons / sensor.gate, np.float32)
    seen = np.zeros(shape)
    for begin in range(0, frames, BLOCK_FRAMES):
        count = min(BLOCK_FRAMES, frames - begin)
        still = np.zeros(count)
        packed = camera.encode(light, index=still.astype(int), fraction=still, gain=np.ones((count, 1)))
        packed = packed[..., BEGIN // 8 :] if begin == 0 else packed
        seen += np.bitwise_count(packed).sum(axis=-1)
    return (seen / (frames - BEGIN)).ravel()


def _compare(sensors: dict[str, SpadSensor], *, frames: int, quick: bool) -> Finding:
    """Compare the mean bit of each array in each light with :func:`detection_rate`."""
    comparisons, curves = [], []
    figures = len(sensors) * len(PHOTONS)
    for seed, (name, sensor) in enumerate(sensors.items(), start=1):
        found = [
            compare_mean(
                f"{name}, {photons:g} photons",
                _rates(sensor, photons, frames=frames, quick=quick, seed=seed),
                expected=float(detection_rate(photons, sensor)),
                figures=figures,
            )
            for photons in PHOTONS
        ]
        comparisons += found
        x = np.geomspace(PHOTONS[0], PHOTONS[-1], 60)
        curves.append(Curve(name, tuple(x), tuple(detection_rate(x, sensor))))
        error = tuple(one.high - one.measured for one in found)
        curves.append(Curve("", PHOTONS, tuple(one.measured for one in found), "points", error))
    plot = Plot("photons per open gate", "share of the frames with a photon", tuple(curves), log_x=True)
    return Finding(tuple(comparisons), plot)


def _clocked(*, afterpulse: float = 0.0) -> SpadSensor:
    sensor = get_sensor("swissspad3", kind="photons", afterpulse=afterpulse, noise=QUIET)
    return sensor.with_noise(afterpulsing=afterpulse > 0)


def _passive(dead_frames: float) -> SpadSensor:
    sensor = _clocked(afterpulse=AFTERPULSE)
    frame = 1 / sensor.readout_hz
    passive = replace(sensor, recharge="passive", dead_time_s=dead_frames * frame, exposure_s=frame)
    return passive.with_noise(dead_time=True)


def _check_saturation(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare arrays that the clock recharges, without afterpulses and with them."""
    sensors = {"clocked": _clocked(), "clocked, afterpulses": _clocked(afterpulse=AFTERPULSE)}
    return _compare(sensors, frames=FRAMES, quick=quick)


def _check_dead_time(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare arrays that recharge themselves, with several dead times and afterpulses."""
    sensors = {f"dead for {dead:g} frames": _passive(dead) for dead in DEAD_FRAMES}
    return _compare(sensors, frames=FRAMES_OF_RENEWALS, quick=quick)


_COX = "D. R. Cox, Renewal Theory, 1962, section 5.2"
_BY_CHANCE = (
    f"Only the scatter between pixels: all figures together fail correct code once in {1 / FALSE_ALARM:,.0f} runs."
)
_EVEN = f"Even light of {', '.join(map(str, PHOTONS))} photons per open gate; 100,000 pixels"
LAWS = (
    Law(
        "photons_saturation",
        "A bit of an array that the clock recharges says whether one or more photons came; an afterpulse may follow in "
        "the next frame.",
        "rate = p/(1 − q·(1 − p)), p = 1 − exp(−H)",
        "S. Burri et al., Optics Express 22, 2014, doi:10.1364/OE.22.017573 (pixels of one bit); a chain of two states",
        f"{_EVEN} for {FRAMES:,} frames, without afterpulses and with q = {AFTERPULSE:g}.",
        _BY_CHANCE,
        _check_saturation,
    ),
    Law(
        "photons_dead_time",
        "A pixel that recharges itself fires as a renewal process: its dead time, and then at once or after a wait.",
        "P(no avalanche in a frame) = ∫₁^∞ P(X > x) dx / E[X]; X = τ + (0 with q, else a wait of mean 1/H)",
        _COX,
        f"{_EVEN} for {FRAMES_OF_RENEWALS:,} frames, dead for {', '.join(map(str, DEAD_FRAMES))} frames, q = "
        f"{AFTERPULSE:g}.",
        _BY_CHANCE,
        _check_dead_time,
    ),
)
