"""Events: how many a change of the light makes, how many come in light that does not change, and how many are read.

A second camera, written independently, has as many of them, also where a lens passes its focus.

The camera is exposed to even light directly, without a rendered scene: what is checked are its pixels.
"""

import math

import numpy as np
from scipy.special import ndtr
from scipy.stats import binom

from saf_gen.camera import LightCourse, get_sensor
from saf_gen.camera.events import EventCamera, EventSensor, encode_events
from saf_gen.camera.events.camera import Events
from studies.laws.event_twin import TwinEvents, make_events
from studies.laws.law import FALSE_ALARM, Comparison, Curve, Finding, Law, Plot, compare_mean
from studies.laws.workload import DatasetMaker

CONTRASTS = (0.21, 0.24, 0.3, 0.45, 0.7, 1.1, 1.6)
RELATIVE_LIGHT = (0.0, 0.3, 1.0, 3.0, 10.0)
RANDOM_HZ, RESET_S, LEAK_HZ = 100.0, 5e-3, 5.0
SMALLEST_THRESHOLD = 0.01
LIGHT = 1e5  # electrons per second
LOADS = (0.2, 0.5, 0.8, 1.0, 1.3, 2.0)
SHARED_BUS = (4, 6)  # pixels
BLOCK_CELLS = 100  # courses of 25 ms
TWINS = ("davis346", "evk4")
PLACES = (-2.5, -1.0, 0.0, 1.0, 2.5)  # defocus, in half depths of focus
FARTHEST, BIN, SPEED = 5.0, 0.5, 20.0  # half depths of focus; the last per second
PICTURES = 20  # per half depth of focus
FINE = 4  # samples of a picture across a pixel
DISC_RMS = 0.25  # pixels, per axis, of a disc of the diameter of a pixel: the blur a half depth from the focus
QUIET = dict.fromkeys(("mismatch", "bandwidth", "refractory", "leak", "shot", "hot", "readout"), False)


def _shape(*, quick: bool) -> tuple[int, int]:
    return (40, 64) if quick else (250, 400)


def _counts(
    sensor: EventSensor, light: tuple[float, ...], *, seconds: float, seed: int, quick: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return how often each pixel reports a fall, and a rise, (P,) each, in even light with these knots."""
    shape = _shape(quick=quick)
    knots = np.broadcast_to(np.array(light, np.float32)[:, None, None], (len(light), *shape))
    seen = encode_events(np.ascontiguousarray(knots), sensor, seconds=seconds, seed=seed)
    pixel = seen.y.astype(int) * shape[1] + seen.x
    falls, rises = (np.bincount(pixel[seen.p == rise], minlength=shape[0] * shape[1]) for rise in (False, True))
    return falls, rises


def events_of_contrast(contrast: np.ndarray, threshold: float, *, rms: float) -> np.ndarray:
    """Return the mean number of events of pixels with normal thresholds if the logarithm of the light changes so far.

    A pixel reports the whole number of its thresholds in the change, so the mean is Σ P(k thresholds fit in it).
    """
    steps = np.arange(1, int(np.max(contrast) / SMALLEST_THRESHOLD) + 1)
    return np.asarray(ndtr((np.asarray(contrast)[..., None] / steps - threshold) / rms).sum(axis=-1))


def _check_contrast(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the events of light that rises, and of light that falls, with the law, by contrast."""
    sensor = get_sensor("evk4", kind="events", dark_e_per_s=1e-3, noise=QUIET | {"mismatch": True})
    comparisons, curves, figures = [], [], 2 * len(CONTRASTS)
    x = np.linspace(CONTRASTS[0], CONTRASTS[-1], 200)
    for name, sign, threshold in (("falls", -1, sensor.threshold_off), ("rises", 1, sensor.threshold_on)):
        found: list[Comparison] = []
        for seed, contrast in enumerate(CONTRASTS, start=1):
            light = LIGHT, LIGHT * float(np.exp(sign * contrast))
            events = _counts(sensor, light, seconds=0.02, seed=seed, quick=quick)
            found.append(
                compare_mean(
                    f"{name}, contrast {contrast:g}",
                    events[sign > 0],
                    expected=float(events_of_contrast(np.array(contrast), threshold, rms=sensor.threshold_rms)),
                    figures=figures,
                )
            )
        comparisons += found
        curves.append(Curve(name, tuple(x), tuple(events_of_contrast(x, threshold, rms=sensor.threshold_rms))))
        error = tuple(one.high - one.measured for one in found)
        curves.append(Curve("", CONTRASTS, tuple(one.measured for one in found), "points", error))
    return Finding(tuple(comparisons), Plot("contrast, of the natural logarithm", "events", tuple(curves)))


def renewals(rate_hz: float, *, reset_s: float, seconds: float) -> float:
    """Return the mean number of events in so many seconds if waits of mean 1/rate alternate with resets.

    It is T/μ + τ²/(2·μ²), μ = τ + 1/rate, for a pixel that begins awake, and many μ.
    """
    mean = reset_s + 1 / rate_hz
    return seconds / mean + reset_s**2 / (2 * mean**2)


def _check_constant(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare random events, by the light, and leaks with their laws."""
    sensor = get_sensor(
        "davis346",
        kind="events",
        dark_e_per_s=1e-3,
        shot_hz=RANDOM_HZ,
        refractory_s=RESET_S,
        leak_hz=LEAK_HZ,
        noise=QUIET | {"shot": True, "refractory": True},
    )
    seconds, figures = 1.0, 2 * len(RELATIVE_LIGHT) + 2
    comparisons = []
    for seed, ratio in enumerate(RELATIVE_LIGHT, start=1):
        falls, rises = _counts(sensor, (ratio * sensor.shot_half_e_per_s,), seconds=seconds, seed=seed, quick=quick)
        expected = renewals(RANDOM_HZ / (1 + ratio), reset_s=RESET_S, seconds=seconds)
        what = f"in {ratio:g} of the light that halves them"
        comparisons += [
            compare_mean(f"random events {what}", falls + rises, expected=expected, figures=figures),
            compare_mean(f"rises among them {what}", rises, expected=expected / 2, figures=figures),
        ]
    leaking = sensor.with_noise(shot=False, refractory=False, leak=True, mismatch=True)
    falls, rises = _counts(leaking, (LIGHT,), seconds=seconds, seed=len(RELATIVE_LIGHT) + 1, quick=quick)
    comparisons += [
        compare_mean("leaks, rises", rises, expected=LEAK_HZ * seconds, figures=figures),
        Comparison("leaks, falls", float(falls.mean()), 0.0, 0.0, 0.0),
    ]
    seen = comparisons[: 2 * len(RELATIVE_LIGHT) : 2]
    x = np.linspace(RELATIVE_LIGHT[0], RELATIVE_LIGHT[-1], 60)
    law = tuple(renewals(RANDOM_HZ / (1 + ratio), reset_s=RESET_S, seconds=seconds) for ratio in x)
    error = tuple(one.high - one.measured for one in seen)
    curves = (
        Curve("law", tuple(x), law),
        Curve("camera", RELATIVE_LIGHT, tuple(one.measured for one in seen), "points", error),
    )
    return Finding(tuple(comparisons), Plot("light, relative to that which halves them", "events per second", curves))


def reading_rate(pixels: int, rate_hz: float, *, service_s: float) -> float:
    """Return the events a second that a bus reads if each pixel asks at a rate while it does not wait (M/D/1//N).

    At the end of a reading k events wait, or else the next one to come is read. Its pixel is free as soon as reading
    begins; during it, each pixel that does not wait asks with probability 1 - exp(-rate·service). The shares of k are
    those that a reading leaves as they are.
    """
    change = np.zeros((pixels + 1, pixels + 1))
    for waiting in range(pixels + 1):
        left = max(waiting - 1, 0)
        new = np.arange(pixels - left + 1)
        change[waiting, left + new] = binom.pmf(new, pixels - left, -np.expm1(-rate_hz * service_s))
    shares = np.linalg.lstsq(
        np.vstack([change.T - np.eye(pixels + 1), np.ones(pixels + 1)]),
        np.append(np.zeros(pixels + 1), 1.0),
        rcond=None,
    )[0]
    return float(1 / (service_s + shares[0] / (pixels * rate_hz)))


def _check_queue(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the events that a bus reads, by its load, with a queue in which each pixel has one request at most."""
    pixels, begin_s, seconds = math.prod(SHARED_BUS), 0.1, 1.1 if quick else 4.1
    course = LightCourse.follow(lambda at: 0 * at, [lambda at: at], span_s=(0.0, seconds), knots=1)
    cells = len(course.seconds) - 1
    comparisons = []
    for load in LOADS:
        sensor = get_sensor(
            "davis346",
            kind="events",
            dark_e_per_s=1e-3,
            shot_hz=RANDOM_HZ,
            readout_events_per_s=pixels * RANDOM_HZ / load,
            noise=QUIET | {"shot": True, "readout": True},
        )
        counts = []
        for seed in range(1, 21 if quick else 61):
            camera, dark = EventCamera(sensor, SHARED_BUS, seed=seed, threads=1), np.zeros((1, 1, *SHARED_BUS), "f4")
            blocks = [course.block(a, min(a + BLOCK_CELLS, cells)) for a in range(0, cells, BLOCK_CELLS)]
            times = np.concatenate([camera.record(dark, block).t for block in blocks])
            counts.append((times >= begin_s * 1e6).sum())
        expected = reading_rate(pixels, RANDOM_HZ, service_s=load / (pixels * RANDOM_HZ)) * (seconds - begin_s)
        comparisons.append(
            compare_mean(
                f"events read, load {load:g}",
                np.array(counts),
                expected=expected,
                figures=len(LOADS),
                least_scatter=0.5,
            )
        )
    x, lasting = np.linspace(LOADS[0], LOADS[-1], 60), seconds - begin_s
    law = tuple(reading_rate(pixels, RANDOM_HZ, service_s=load / (pixels * RANDOM_HZ)) for load in x)
    curves = (
        Curve("law", tuple(x), law),
        Curve("camera", LOADS, tuple(one.measured / lasting for one in comparisons), "points"),
    )
    return Finding(
        tuple(comparisons), Plot("requests of idle pixels, relative to the bus", "events per second", curves)
    )


def _texture(*, quick: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the spectrum of a picture of black and white patches, sampled finely, and its squared wave numbers.

    Wave numbers are in radians per pixel; black has a tenth of the light of white.
    """
    shape = [FINE * size for size in ((32, 48) if quick else (64, 96))]
    down, across = (2 * np.pi * FINE * np.fft.fftfreq(size) for size in shape)
    squared = down[:, None] ** 2 + across[: shape[1] // 2 + 1] ** 2
    rough = np.fft.rfft2(np.random.default_rng(1).standard_normal(shape))
    patches = np.fft.irfft2(rough * np.exp(-0.5 * squared * 1.5**2), s=shape) > 0
    return np.fft.rfft2(np.where(patches, 1.0, 0.1)), squared


def _blur(spectrum: np.ndarray, squared: np.ndarray, *, rms_px: float) -> np.ndarray:
    """Return a picture with Gaussian blur of so many pixels rms per axis, collected by pixels, (H, W)."""
    fine = np.fft.irfft2(spectrum * np.exp(-0.5 * squared * rms_px**2))
    return np.asarray(fine.reshape(fine.shape[0] // FINE, FINE, -1, FINE).mean(axis=(1, 3)))


def _record_both(light: np.ndarray, name: str, *, seconds: float, step_s: float) -> tuple[Events, TwinEvents]:
    """Return what the camera and its twin report for light without dark current, electrons per second, (K, H, W)."""
    sensor = get_sensor(name, kind="events", noise=QUIET | {"bandwidth": True, "refractory": True})
    twin = make_events(
        light.astype(np.float64) + sensor.dark_e_per_s,
        seconds=seconds,
        on=sensor.threshold_on,
        off=sensor.threshold_off,
        charge_e=sensor.receptor_e,
        receptor_s=sensor.receptor_s,
        refractory_s=sensor.refractory_s,
        step_s=step_s,
    )
    return encode_events(light, sensor, seconds=seconds, seed=1), twin


def _near(what: str, measured: float, *, expected: float, within: float, unit: str = "") -> Comparison:
    """Return the comparison of a figure with that of the twin, from which it may differ by a fraction."""
    return Comparison(what, float(measured), expected, (1 - within) * expected, (1 + within) * expected, unit=unit)


def _check_twin(maker: DatasetMaker, quick: bool) -> Finding:
    """Compare the camera with its twin: numbers of events as contrast comes and goes, and rates around the focus."""
    spectrum, squared = _texture(quick=quick)
    step_s = 1e-4 if quick else 4e-5
    picture, at = _blur(spectrum, squared, rms_px=1.0), np.linspace(0, 1, 101)[:, None, None]  # of many shades
    contrast = np.sin(2 * np.pi * (at + 0.1)) ** 2  # comes and goes twice; it begins with some, so that pixels differ
    light = LIGHT * 5 ** (at - 1) * (1 + contrast * (picture / picture.mean() - 1))
    comparisons = []
    for name in TWINS:
        events, twin = _record_both(light.astype(np.float32), name, seconds=0.25, step_s=step_s)
        for what, rise in (("falls", False), ("rises", True)):
            number, expected = (events.p == rise).sum(), float((twin.rise == rise).sum())
            comparisons.append(_near(f"{what}, {name}", number, expected=expected, within=0.005))

    x = np.linspace(-FARTHEST, FARTHEST, round(2 * FARTHEST * PICTURES) + 1)
    light = LIGHT * np.stack([_blur(spectrum, squared, rms_px=DISC_RMS * abs(defocus)) for defocus in x])
    events, twin = _record_both(light.astype(np.float32), TWINS[0], seconds=2 * FARTHEST / SPEED, step_s=step_s)
    middles = np.arange(-FARTHEST + BIN, FARTHEST, BIN)
    edges = np.append(middles, FARTHEST) - BIN / 2
    pixel_seconds = light[0].size * BIN / SPEED
    seen, wanted = (np.histogram(SPEED * t - FARTHEST, edges)[0] / pixel_seconds for t in (1e-6 * events.t, twin.t))
    at_places = np.searchsorted(middles, PLACES)
    for place, rate, expected in zip(PLACES, seen[at_places], wanted[at_places].tolist(), strict=True):
        comparisons.append(_near(f"rate at a defocus of {place:g}", rate, expected=expected, within=0.05, unit="Hz"))
    ratio, of_twin = (valley_ratio(rates[at_places]) for rates in (seen, wanted))
    comparisons.append(Comparison("rate in focus over that of the lower lobe", ratio, at_most=0.5))
    least = middles[at_places[0] + np.argmin(seen[at_places[0] : at_places[-1]])]
    remarks = (
        f"The rate in focus is {ratio:.3f} of that of the lower lobe; {of_twin:.3f} with the twin. It is least "
        f"{least:g} half depths after the focus, because light that turns back must first pass the level that a pixel "
        "stored, and a threshold more.",
    )
    curves = (Curve("twin", tuple(middles), tuple(wanted)), Curve("camera", tuple(middles), tuple(seen), "points"))
    plot = Plot("defocus, half depths of focus, growing with time", "events per pixel and second", curves)
    return Finding(tuple(comparisons), plot, remarks)


def valley_ratio(rates: np.ndarray) -> float:
    """Return the rate of events in focus over that of the lower lobe, from the rates at ``PLACES``."""
    before, focus, after = rates[:2].max(), rates[2], rates[3:].max()
    return float(focus / min(before, after))


_BY_CHANCE = (
    f"Only the scatter between pixels: all figures together fail correct code once in {1 / FALSE_ALARM:,.0f} runs."
)
LAWS = (
    Law(
        "events_contrast",
        "A change of the light makes as many events as thresholds fit into the change of its logarithm; thresholds are "
        "normal over the pixels.",
        "mean = Σ P(θ ≤ contrast/k), k = 1, 2, …",
        "P. Lichtsteiner et al., IEEE J. Solid-State Circuits 43, 2008, doi:10.1109/JSSC.2007.914337",
        f"Light that rises, or falls, in 20 ms by {', '.join(map(str, CONTRASTS))}; 100,000 pixels of evk4, of whose "
        "imperfections only the mismatch is on.",
        _BY_CHANCE,
        _check_contrast,
    ),
    Law(
        "events_constant_light",
        "In constant light a pixel reports random changes, of either polarity alike and more rarely in brighter light; "
        "after each it is in reset. Leaks make rises at their own rate.",
        "mean = T/μ + τ²/(2·μ²), μ = τ + (1 + I/I½)/R; leaks T·rate",
        "Y. Hu et al., CVPR Workshops 2021, doi:10.1109/CVPRW53098.2021.00144 (rates); D. R. Cox, Renewal Theory, 1962",
        f"1 s of 100,000 pixels, R = {RANDOM_HZ:g} Hz, τ = {1e3 * RESET_S:g} ms, light of "
        f"{', '.join(map(str, RELATIVE_LIGHT))} times I½; leaks of {LEAK_HZ:g} Hz, log-normal over the pixels, "
        "without resets.",
        _BY_CHANCE,
        _check_constant,
    ),
    Law(
        "events_queue",
        "Pixels share a bus: an event is read when those before it have been read, and until then its pixel has no "
        "other.",
        "X = 1/(D + π₀/(N·R)), π₀ the share of readings after which none of N pixels waits (M/D/1//N)",
        "L. Takács, Introduction to the Theory of Queues, 1962, ch. 5",
        f"Random events of R = {RANDOM_HZ:g} Hz in the dark; 60 arrays of N = {math.prod(SHARED_BUS)} pixels for "
        f"4 s each, in courses of 25 ms, on buses of which N·R is {', '.join(map(str, LOADS))} times what they read.",
        _BY_CHANCE,
        _check_queue,
    ),
    Law(
        "events_twin",
        "A camera written independently, which steps the photoreceptor through time, has as many events, and at the "
        "same rates where a lens passes its focus: there they are few, because the picture hardly changes.",
        "dV/dt = (I − exp V)/(Q + s·I); an event where V leaves stored ± θ, then a reset",
        "T. Delbruck and C. A. Mead, ISCAS 1994, doi:10.1109/ISCAS.1994.409266 (the photoreceptor)",
        f"A picture of 6,144 pixels whose contrast comes and goes twice in light that grows fivefold, "
        f"{' and '.join(TWINS)}; its blur in front of a lens that moves by {SPEED:g} half depths of focus per second, "
        f"{TWINS[0]}. Photoreceptor and reset are on, noise is off.",
        "0.5 % of the numbers, 5 % of the rates, which is left for the twin's steps of time; in focus at most half of "
        "the rate beside it.",
        _check_twin,
    ),
)
