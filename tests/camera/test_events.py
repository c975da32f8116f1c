"""The event camera, compared with closed forms, with a solver of differential equations, and with its own laws."""

import hashlib
import heapq
from itertools import pairwise

import numpy as np
import pytest
from refusals import refusal
from scipy import stats
from scipy.integrate import solve_ivp

from saf_gen.camera import get_sensor, sensor_names
from saf_gen.camera.course import LightCourse
from saf_gen.camera.events import EventCamera, encode_events
from saf_gen.camera.events.camera import Events
from saf_gen.plugins.lights import get_light

QUIET = dict.fromkeys(("mismatch", "bandwidth", "refractory", "leak", "shot", "hot", "readout"), False)
THETA = 0.2
NO_DARK = 1e-3  # electrons per second
SHAPE = (2, 3)


def davis(*on, **changes):
    """Return the davis346 with only these imperfections, and no dark current."""
    return get_sensor(
        "davis346", kind="events", **{"dark_e_per_s": NO_DARK, **changes}, noise=QUIET | dict.fromkeys(on, True)
    )


def course(light, seconds):
    """Return the course of one light group with this schedule, before a lens that stands."""
    return LightCourse.follow(lambda t: 0 * t, [lambda t: light.integral(t, seconds)], span_s=(0.0, seconds), knots=1)


def record(sensor, light, *, seconds, level, shape=SHAPE, seed=1):
    """Return the events of even light of so many electrons per second at gain 1."""
    stack = np.full((1, 1, *shape), level, np.float32)
    return EventCamera(sensor, shape, seed=seed).record(stack, course(light, seconds))


def of_pixel(events, x=0, y=0):
    here = (events.x == x) & (events.y == y)
    return events.t[here], events.p[here]


# --- the instants, with everything switched off -------------------------------------------------------


def test_a_ramp_has_events_where_its_logarithm_passes_a_threshold():
    begin, end, seconds = 1e5, 6e5, 0.4
    light = np.linspace([[begin]], [[end]], 2, dtype=np.float32) * np.ones((1, 2, 3), np.float32)
    t, p = of_pixel(encode_events(light, davis(), seconds=seconds, seed=1))
    expected = begin * np.expm1(THETA * np.arange(1, 9)) / (end - begin) * seconds
    assert p.all()
    np.testing.assert_allclose(t, expected[expected < seconds] * 1e6, atol=1.0)


def test_a_ramp_by_a_schedule_has_the_same_events():
    light = get_light("ramp", **{"from": 1.0, "to": 0.1})
    t, p = of_pixel(record(davis(), light, seconds=0.3, level=3e5))
    expected = -np.expm1(-THETA * np.arange(1, 12)) / 0.9 * 0.3
    assert not p.any()
    np.testing.assert_allclose(t, expected * 1e6, atol=1.0)


def test_a_sine_has_events_up_and_down():
    hz, swing = 10.0, 0.8
    light = get_light("sine", hz=hz, swing=swing)
    t, p = of_pixel(record(davis(), light, seconds=0.1, level=1e5))
    level, instants, rises = 0.0, [], []
    dense = np.linspace(0, 0.1, 400_001)
    for at, value in zip(dense, np.log1p(swing * np.sin(2 * np.pi * hz * dense)), strict=True):
        if abs(value - level) >= THETA:
            level += np.copysign(THETA, value - level)
            instants.append(at)
            rises.append(value > level - THETA / 2 and value >= level)
    assert len(instants) > 10
    np.testing.assert_allclose(t, np.array(instants) * 1e6, atol=1.3)  # the twin's own step is 0.25 µs
    assert p.tolist() == rises


@pytest.mark.parametrize("at_s", [0.01, 0.010123456, 0.0150000004])
@pytest.mark.parametrize("level", [0.3, 2.5])
def test_a_step_has_all_its_events_when_it_happens(at_s, level):
    light = get_light("steps", every_s=at_s, levels=[1.0, level])
    t, p = of_pixel(record(davis(), light, seconds=1.9 * at_s, level=1e5))
    assert len(t) == int(abs(np.log(level)) / THETA)
    assert (p == (level > 1)).all()
    np.testing.assert_allclose(t, at_s * 1e6, atol=1.0)


def test_even_progress_of_the_logarithm_has_even_intervals():
    """A focal sweep, or frames between which one interpolates, must not beat."""
    knots = np.exp(np.linspace(0, 6, 1001)).astype(np.float32)
    light = 1e4 * knots[:, None, None] * np.ones((1, 1, 2), np.float32)
    t, _ = of_pixel(encode_events(light, davis(), seconds=1.0, seed=1))
    assert len(t) in (29, 30)
    assert np.ptp(np.diff(t)) <= 2  # microseconds; each instant is rounded down to one


# --- the photoreceptor ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("level", [5.0, 0.2])
@pytest.mark.parametrize("electrons", [1e4, 1e5, 1e6])
def test_a_step_is_followed_as_the_closed_form_says(level, electrons):
    at, charge = 0.01, 80.0
    light = get_light("steps", every_s=at, levels=[1.0, level])
    t, p = of_pixel(
        record(davis("bandwidth", receptor_s=0), light, seconds=0.0195 if electrons > 1e4 else 0.0199, level=electrons)
    )
    before, after = electrons, level * electrons
    u = np.exp(-np.copysign(THETA, np.log(level)) * np.arange(1, 9)) / before
    share = (u - 1 / after) / (1 / before - 1 / after)
    expected = at - charge / after * np.log(share[share > 0])
    expected = expected[expected < (0.0195 if electrons > 1e4 else 0.0199)]
    assert (p == (level > 1)).all()
    assert len(expected) >= 3
    np.testing.assert_allclose(t, expected * 1e6, atol=1.0)


@pytest.mark.parametrize("kind", ["sine", "ramp"])
@pytest.mark.parametrize("electrons", [1e4, 3e5])
@pytest.mark.parametrize("dark", [NO_DARK, 3000.0])
def test_smooth_light_is_followed_as_a_solver_says(kind, electrons, dark):
    seconds = 0.05
    light = get_light("sine", hz=60.0, swing=0.7) if kind == "sine" else get_light("ramp", **{"from": 1.0, "to": 4.0})
    sensor = davis("bandwidth", dark_e_per_s=dark)

    def intensity(t):
        gain = 1 + 0.7 * np.sin(2 * np.pi * 60.0 * t) if kind == "sine" else 1 + 3.0 * t / seconds
        return dark + electrons * gain

    def rate(t, u):
        return (1 / intensity(t) - u) / (sensor.receptor_s + sensor.receptor_e / intensity(t))

    solved = solve_ivp(rate, (0, seconds), [1 / intensity(0)], rtol=1e-10, atol=1e-18, max_step=5e-5, dense_output=True)
    dense = np.arange(0, seconds, 2e-7)
    level, expected = -np.log(solved.sol(0.0)[0]), []
    for at, value in zip(dense, -np.log(solved.sol(dense)[0]), strict=True):
        if abs(value - level) >= THETA:
            level += np.copysign(THETA, value - level)
            expected.append(at * 1e6)
    t, _ = of_pixel(record(sensor, light, seconds=seconds, level=electrons))
    assert len(expected) >= 3
    np.testing.assert_allclose(t, expected, atol=3.5)


# --- after an event ---------------------------------------------------------------------------------------


def test_in_reset_a_pixel_sees_nothing_and_then_stores_the_level_that_it_has():
    seconds, refractory = 0.2, 0.013
    light = get_light("ramp", **{"from": 1.0, "to": 5.0})
    t, _ = of_pixel(record(davis("refractory", refractory_s=refractory), light, seconds=seconds, level=1e5))
    expected, stored = [], 1.0
    while True:
        at = (stored * np.exp(THETA) - 1) / 4 * seconds
        if at >= seconds:
            break
        expected.append(at * 1e6)
        stored = 1 + 4 * (at + refractory) / seconds
    assert len(expected) > 4
    np.testing.assert_allclose(t, expected, atol=1.0)


def test_a_step_within_the_reset_is_lost():
    light = get_light("steps", every_s=0.01, levels=[1.0, 10.0])
    t, _ = of_pixel(record(davis("refractory", refractory_s=1e-3), light, seconds=0.0199, level=1e5))
    assert len(t) == 1  # of eleven thresholds: afterwards the pixel stores the new light


# --- noise ----------------------------------------------------------------------------------------------


def constant(sensor, seconds, *, level=1e5, shape=(40, 50), seed=1):
    return record(sensor, get_light("constant"), seconds=seconds, level=level, shape=shape, seed=seed)


def test_leaks_make_rises_at_their_rate():
    events = constant(davis("leak", leak_hz=2.0), 3.0)
    assert events.p.all()
    assert len(events.t) == pytest.approx(2000 * 2.0 * 3.0, rel=0.02)  # phases are drawn: ± 0.4 %
    intervals = np.diff(of_pixel(events, 5, 7)[0])
    np.testing.assert_allclose(intervals, 5e5, rtol=1e-3)


def test_hot_pixels_leak_faster_than_the_others():
    events = constant(davis("leak", "hot", hot_fraction=0.1, hot_hz=200.0, leak_hz=0.1), 0.5)
    pixels = np.bincount(events.y.astype(int) * 50 + events.x, minlength=2000)
    hot = pixels > 20
    assert stats.binomtest(int(hot.sum()), 2000, 0.1).pvalue > 1e-3
    assert np.mean(pixels[hot]) == pytest.approx(100, rel=0.02)


@pytest.mark.parametrize(("level", "rate"), [(1.0, 5.0), (3e5, 2.5), (3e6, 5 / 11)])
def test_random_events_are_poisson_and_rarer_in_bright_light(level, rate):
    """2,000 pixels for 2 s: the count by a Poisson test, and its variance over pixels, each at 0.1 %."""
    events = constant(davis("shot", shot_hz=5.0), 2.0, level=level)
    expected = 2000 * rate * 2.0
    assert abs(len(events.t) - expected) < 3.3 * np.sqrt(expected)
    assert stats.binomtest(int(events.p.sum()), len(events.p)).pvalue > 1e-3
    per_pixel = np.bincount(events.y.astype(int) * 50 + events.x, minlength=2000)
    spread = 1999 * per_pixel.var(ddof=1) / per_pixel.mean()
    assert stats.chi2.cdf(spread, 1999) == pytest.approx(0.5, abs=0.4995)
    assert stats.kstest(events.t / 2e6, "uniform").pvalue > 1e-3


def test_thresholds_differ_between_pixels_and_not_in_time():
    """Steps of the logarithm by 6 in 3,000 pixels: the mean number of events, and its spread."""
    knots = np.exp(np.linspace(0, 6, 201)).astype(np.float32)
    light = 1e3 * knots[:, None, None] * np.ones((1, 50, 60), np.float32)
    events = encode_events(light, davis("mismatch", threshold_rms=0.02), seconds=1.0, seed=4)
    first = np.full(3000, np.nan)
    pixel = events.y.astype(int) * 60 + events.x
    seen, at = np.unique(pixel, return_index=True)
    first[seen] = events.t[at] * 6e-6  # the logarithm reached at the first event
    assert np.mean(first) == pytest.approx(THETA, abs=4 * 0.02 / np.sqrt(3000) + 1e-4)
    assert np.std(first) == pytest.approx(0.02, rel=4 / np.sqrt(6000))
    one = np.diff(events.t[pixel == 17])
    assert np.ptp(one) <= 60  # of 33,000 µs, from the knots


def first_levels(sensor, *, rising, pixels=3000, seed=6):
    """Return by how much the logarithm of the light has changed at the first event of each pixel."""
    change = 2.0 if rising else -2.0
    knots = np.exp(np.linspace(0, change, 201)).astype(np.float32)
    light = 1e5 * knots[:, None, None] * np.ones((1, 1, pixels), np.float32)
    events = encode_events(light, sensor, seconds=1.0, seed=seed)
    seen, at = np.unique(events.x, return_index=True)
    assert len(seen) == pixels
    assert (events.p == rising).all()
    return events.t[at] * 2e-6


@pytest.mark.parametrize("rising", [True, False])
def test_thresholds_of_either_polarity_are_normal_over_the_pixels(rising):
    """Mean and spread of 3,000 thresholds, each at 4.4 standard deviations (1 in 100,000); seed 6.

    Light is straight between knots of 1 % and instants are rounded to a microsecond, which is 1e-4.
    """
    wanted = {"threshold_on": 0.2, "threshold_off": 0.26}["threshold_on" if rising else "threshold_off"]
    levels = first_levels(davis("mismatch", threshold_off=0.26, threshold_rms=0.03), rising=rising)
    assert abs(levels.mean() - wanted) < 4.4 * 0.03 / np.sqrt(3000) + 1e-4
    assert abs(levels.std() / 0.03 - 1) < 4.4 / np.sqrt(6000)
    assert stats.kstest((levels - wanted) / 0.03, "norm").pvalue > 1e-5


def test_the_two_thresholds_of_a_pixel_are_independent():
    """Their correlation over 3,000 pixels, and the spread of their sum, at 4.4 standard deviations; seed 8."""
    sensor = davis("mismatch", threshold_rms=0.03)
    on, off = (first_levels(sensor, rising=rising, seed=8) for rising in (True, False))
    assert abs(np.corrcoef(on, off)[0, 1]) < 4.4 / np.sqrt(3000)
    assert abs((on + off).std() / (0.03 * np.sqrt(2)) - 1) < 4.4 / np.sqrt(6000)


@pytest.mark.parametrize("log_sd", [0.3, 0.8])
def test_the_mean_of_the_leaks_is_the_stated_rate_however_much_pixels_differ(log_sd):
    """Events of 8,000 pixels in 1 s: r·T with a spread of r·T·√((exp(s²) - 1)/n), at 4.4 of them; seed 12.

    Phases are drawn evenly, so that the number of events of a pixel is its rate times T on average.
    """
    sensor = davis("leak", "mismatch", leak_hz=10.0, leak_log_sd=log_sd)
    events = constant(sensor, 1.0, shape=(80, 100), seed=12)
    spread = np.sqrt((np.expm1(log_sd**2) + 0.25 / 10.0**2) / 8000)
    assert abs(len(events.t) / (8000 * 10.0) - 1) < 4.4 * spread


@pytest.mark.parametrize("log_sd", [0.3, 0.6])
def test_leaks_are_log_normal_over_the_pixels(log_sd):
    """Mean of the logarithms of 2,000 rates, ln r - s²/2, and their spread s, at 4.4 standard deviations; seed 14."""
    sensor = davis("leak", "mismatch", leak_hz=60.0, leak_log_sd=log_sd)
    events = constant(sensor, 1.0, seed=14)
    pixel = events.y.astype(int) * 50 + events.x
    order = np.lexsort((events.t, pixel))
    first, number = np.unique(pixel[order], return_index=True, return_counts=True)[1:]
    assert len(first) == 2000
    assert number.min() >= 2
    t = events.t[order]
    logs = np.log((number - 1) / (t[first + number - 1] - t[first]) * 1e6)
    assert abs(logs.mean() - (np.log(60.0) - log_sd**2 / 2)) < 4.4 * log_sd / np.sqrt(2000)
    assert abs(logs.std() / log_sd - 1) < 4.4 / np.sqrt(4000)


@pytest.mark.slow
def test_events_wait_for_the_readout():
    light = get_light("steps", every_s=0.01, levels=[1.0, 1.3])
    events = record(davis("readout", readout_events_per_s=1e5), light, seconds=0.0199, level=1e5, shape=(20, 10))
    np.testing.assert_allclose(np.diff(events.t), 10, atol=1)
    assert len(events.t) == 200
    assert abs(events.t[0] - 10_000) <= 1
    assert (np.diff(events.y.astype(int) * 10 + events.x) > 0).all()  # in the order of the pixels


# --- the queue: one request per pixel -------------------------------------------------------------------

CROWD = (5, 8)
RISE = 400.0  # of the logarithm of the light, per second: a threshold in half a millisecond


def crowd(rate, refractory_s, *, seconds=0.02, cuts=(), threads=2, seed=7):
    """Return the events of pixels whose logarithm rises evenly, in pieces, and for how long the bus was full."""
    knots = np.exp(RISE * np.linspace(0, seconds, 801)).astype(np.float32)
    stack = 10.0 * knots[None, :, None, None] * np.ones((1, 1, *CROWD), np.float32)
    sensor = davis("mismatch", "refractory", "readout", readout_events_per_s=rate, refractory_s=refractory_s)
    whole = LightCourse.follow(lambda at: at / seconds, [lambda at: at], span_s=(0.0, seconds), knots=801, parts=800)
    camera = EventCamera(sensor, CROWD, seed=seed, threads=threads)
    edges = [0, *cuts, len(whole.seconds) - 1]
    parts = [camera.record(stack, whole.block(a, b)) for a, b in pairwise(edges)]
    return Events(*(np.concatenate(columns) for columns in zip(*parts, strict=True))), camera.bus_full_s


def thresholds(seed=7):
    """Return the ON threshold of each pixel of the crowd: its first event, with a bus that keeps no pixel waiting."""
    free, _ = crowd(1e12, 1.0, seed=seed)
    first = np.zeros(CROWD)
    first[free.y, free.x] = free.t * 1e-6 * RISE
    return first.ravel()


def twin(rate, refractory_s, seconds=0.02):
    """Return times and pixels of the events of the crowd, and how long the bus is full, as one would write it down."""
    theta = thresholds()
    queue, free, events, full_s = [(t / RISE, pixel) for pixel, t in enumerate(theta)], 0.0, [], 0.0
    heapq.heapify(queue)
    while queue:
        asked, pixel = heapq.heappop(queue)
        read = max(asked, free)
        free = read + 1 / rate
        if read < seconds:
            events.append((read, pixel))
            full_s += min(read - asked, 1 / rate) * (read - asked > 1e-6)
            heapq.heappush(queue, (read + refractory_s + theta[pixel] / RISE, pixel))
    return np.array(events), full_s


@pytest.mark.parametrize("refractory_s", [1e-5, 2e-4, 3e-3])
@pytest.mark.parametrize("rate", [5e3, 3e4, 9e4, 1e6, 1e12])
def test_events_wait_as_the_queue_says(rate, refractory_s):
    """From a bus that is always full to one that is never: counts of each pixel, and how they share the bus."""
    events, full_s = crowd(rate, refractory_s)
    wanted, wanted_full_s = twin(rate, refractory_s)
    pixels = events.y.astype(int) * CROWD[1] + events.x
    assert abs(len(events.t) - len(wanted)) <= 2 + 0.01 * len(wanted)  # thresholds are known to a microsecond
    counts = [np.bincount(of, minlength=40) for of in (pixels, wanted[:, 1].astype(int))]
    assert np.abs(counts[0] - counts[1]).max() <= 1
    same = min(len(wanted), 60)
    np.testing.assert_allclose(events.t[:same], wanted[:same, 0] * 1e6, atol=8)
    assert full_s == pytest.approx(wanted_full_s, rel=0.05, abs=2e-5)
    assert rate != 5e3 or full_s > 0.019


@pytest.mark.parametrize("refractory_s", [1e-5, 2e-4, 3e-3])
@pytest.mark.parametrize("rate", [5e3, 3e4, 9e4, 1e6])
@pytest.mark.parametrize("cuts", [(), (1, 7, 200, 201, 500)])
def test_no_pixel_fires_in_its_reset_and_none_after_the_end(rate, refractory_s, cuts):
    """The reset counts from when an event was read; whatever waits at the end is not read."""
    events, _ = crowd(rate, refractory_s, cuts=cuts)
    assert events.t[-1] < 20_000
    assert (np.diff(events.t) >= 0).all()
    paced = events.t[10:] - events.t[:-10]  # ten events later
    assert paced.min() >= 1e7 / rate - 1
    pixels = events.y.astype(int) * CROWD[1] + events.x
    gaps = np.concatenate([np.diff(events.t[pixels == n]) for n in range(40)])
    assert gaps.min() >= refractory_s * 1e6 - 1


@pytest.mark.slow
@pytest.mark.parametrize("rate", [5e3, 3e4, 9e4, 1e6, 1e12])
def test_the_queue_goes_on_from_one_piece_of_time_to_the_next(rate):
    whole, full_s = crowd(rate, 2e-4)
    for cuts, threads in (((400,), 1), ((1, 7, 200, 201, 500), 2), (range(1, 800), 3)):
        pieces, full_in_pieces_s = crowd(rate, 2e-4, cuts=cuts, threads=threads)
        for a, b in zip(whole, pieces, strict=True):
            np.testing.assert_array_equal(a, b)
        assert full_in_pieces_s == pytest.approx(full_s, abs=1e-9)


@pytest.mark.parametrize("switches", [(), ("refractory",), ("bandwidth", "shot"), tuple(QUIET)])
def test_a_bus_that_is_full_for_a_moment_changes_nothing_before_it(switches):
    """Pixels are advanced by another loop while the bus is full; both have the same events where it is not."""
    light = get_light("steps", every_s=0.03, levels=[1.0, 0.4])
    level, shape = 1e5, (20, 30)
    stack = np.random.default_rng(5).uniform(0.2, 1, (1, 2, *shape)).astype(np.float32) * np.float32(level)

    def events(*cuts, seconds=0.05):
        sensor = davis(*switches, "readout", readout_events_per_s=1.2e6)
        whole = LightCourse.follow(lambda t: t / 0.05, [lambda t: light.integral(t, 0.05)], span_s=(0.0, 0.05), knots=2)
        camera, n = EventCamera(sensor, shape, seed=2), len(whole.seconds) - 1
        edges = [0, *(round(cut * n) for cut in cuts), n]
        parts = [camera.record(stack, whole.block(a, b)) for a, b in pairwise(edges)]
        assert 2e-5 < camera.bus_full_s < 2e-3
        return [np.concatenate(columns) for columns in zip(*parts, strict=True)]

    whole = events()
    assert (whole[0] < 29_000).sum() > 500
    for a, b in zip(whole, events(0.1, 0.3, 0.5, 0.95), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("rate", "full"), [(1e5, (0.9, 1.0)), (4e5, (0.1, 0.9)), (1e7, (0.0, 0.001))])
def test_flicker_that_is_too_fast_for_the_bus_gives_no_event_after_the_end(rate, full):
    """100 Hz at a depth of 0.9: the queue fills and empties, and pixels that waited go on as the others do."""
    sensor, seconds = get_sensor("davis346", kind="events", readout_events_per_s=rate), 0.05
    flicker = get_light("flicker", hz=100.0, depth=0.9)
    camera = EventCamera(sensor, (20, 30), seed=3)
    stack = np.random.default_rng(2).uniform(2e4, 4e5, (1, 1, 20, 30)).astype(np.float32)
    events = camera.record(stack, course(flicker, seconds))
    assert 4_000 < len(events.t) <= seconds * rate + 1
    assert events.t[-1] < seconds * 1e6
    pixels = events.y.astype(int) * 30 + events.x
    gaps = np.concatenate([np.diff(events.t[pixels == n]) for n in range(600)])
    assert gaps.min() >= 499  # 500 µs of reset
    assert full[0] <= camera.bus_full_s / seconds <= full[1]


# --- pictures that follow each other fast ---------------------------------------------------------------


def flashes(pictures):
    """Return pictures of which every fifth is three times as bright, and how many of them are."""
    bright = (np.arange(pictures) % 5 == 2) & (np.arange(pictures) < pictures - 1)
    levels = np.where(bright, 3e5, 1e5).astype(np.float32)
    levels[0] = 1.02e5  # so that no level lies on a threshold
    return levels[:, None, None] * np.ones((1, 1, 2), np.float32), bright.sum()


@pytest.mark.parametrize("pictures", [201, 1001, 3001, 3998, 4001, 4002, 6001, 20_001])
def test_no_picture_is_dropped(pictures):
    """In a second: five thresholds up to each bright picture, and five down from it."""
    light, bright = flashes(pictures)
    t, p = of_pixel(encode_events(light, davis(), seconds=1.0, seed=1))
    assert len(t) == 10 * bright
    assert p.sum() == 5 * bright
    up = (1 + (1.02 * np.exp(THETA * np.arange(1, 6)) - 1) / 2) / (pictures - 1)  # to the first bright one
    np.testing.assert_allclose(t[:5], up * 1e6, atol=1.0)


@pytest.mark.parametrize("pictures", [4202, 6001, 20_001, 30_000])
def test_a_lens_that_passes_many_knots_in_a_cell_sees_each_of_them(pictures):
    light, bright = flashes(pictures)
    followed = LightCourse.follow(lambda at: at / 0.5 % 1.0, [lambda at: at], span_s=(0.0, 0.4999), knots=pictures)
    events = EventCamera(davis(), (1, 2), seed=1).record(light[None], followed)
    assert len(of_pixel(events)[0]) == pytest.approx(10 * bright, rel=0.003)


def test_a_lens_that_jumps_sees_no_knot_on_its_way():
    light, _ = flashes(1001)
    followed = LightCourse.follow(
        lambda at: np.where(at < 0.0501234, 0.0, 1.0), [lambda at: at], span_s=(0.0, 0.1), knots=1001
    )
    assert len(EventCamera(davis(), (1, 2), seed=1).record(light[None], followed).t) == 0


# --- what must not matter ------------------------------------------------------------------------------


def busy(threads=2, cuts=(), seed=3, name="davis346"):
    """Return the events of a textured sweep with all imperfections, recorded in pieces."""
    random = np.random.default_rng(2)
    stack = random.uniform(2e4, 4e5, (2, 5, 30, 40)).astype(np.float32)
    lights = [get_light("flicker", hz=100.0, depth=0.4), get_light("steps", every_s=0.017, levels=[1.0, 0.4])]
    seconds = 0.06
    whole = LightCourse.follow(
        lambda t: t / seconds,
        [lambda t, one=one: one.integral(t, seconds) for one in lights],
        span_s=(0.0, seconds),
        knots=5,
    )
    camera = EventCamera(get_sensor(name, kind="events"), (30, 40), seed=seed, threads=threads)
    edges = [0, *cuts, len(whole.seconds) - 1]
    parts = [camera.record(stack, whole.block(a, b)) for a, b in pairwise(edges)]
    return [np.concatenate(columns) for columns in zip(*parts, strict=True)]


@pytest.mark.slow
def test_threads_and_pieces_of_time_do_not_matter():
    whole = busy()
    assert len(whole[0]) > 2000
    for other in (busy(threads=1), busy(threads=3, cuts=(1, 40, 41, 200))):
        for a, b in zip(whole, other, strict=True):
            np.testing.assert_array_equal(a, b)
    assert not np.array_equal(whole[0][:2000], busy(seed=4)[0][:2000])


def test_the_events_are_the_same_on_every_machine():
    digest = hashlib.sha256(b"".join(column.tobytes() for column in busy())).hexdigest()
    assert digest[:16] == "86875773e42c5c5c"


def test_more_events_than_there_is_room_for(monkeypatch):
    monkeypatch.setattr("saf_gen.camera.events.camera.ROOM", 7)
    few = busy()
    monkeypatch.undo()
    for a, b in zip(few, busy(), strict=True):
        np.testing.assert_array_equal(a, b)


# --- the course -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("ramp", {"from": 1.0, "to": 3.0}),
        ("flicker", {"hz": 100.0, "depth": 0.9}),
        ("pwm", {"hz": 1000.0, "duty": 0.3}),
        ("steps", {"every_s": 0.005, "levels": [1.0, 0.2, 2.0]}),
        ("flash", {"at_s": 0.0103, "peak": 20.0}),
        ("random_walk", {"sd": 0.5, "return_s": 0.2, "seed": 3}),
    ],
)
def test_a_course_has_the_light_of_its_schedule(kind, options):
    light = get_light(kind, **options)
    followed = course(light, 0.05)
    span = np.diff(followed.seconds)
    collected = (followed.gain.mean(axis=1)[:, 0] * span).cumsum()
    exact = light.integral(followed.seconds, 0.05)[1:]
    np.testing.assert_allclose(collected, exact, atol=2e-4 * 0.05 * followed.gain.max())
    assert span.max() <= 2.5e-4 + 1e-12
    assert len(span) < 12_000


# --- the sensors, and what is refused ----------------------------------------------------------------


def test_every_event_camera_states_its_sources():
    assert sensor_names("events") == ["davis346", "evk4"]
    for name in sensor_names("events"):
        assert get_sensor(name, kind="events").name == name
        assert any("doi:" in source for source in get_sensor(name, kind="events").sources)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: get_sensor("davis364", kind="events"), "unknown sensor 'davis364'"),
        (lambda: get_sensor("davis346", kind="events", threshold_on=20), "threshold_on"),
        (lambda: get_sensor("davis346", kind="events").with_noise(shots=True), "shots"),
        (lambda: encode_events(np.ones((2, 2), np.float32), "davis346", seconds=1, seed=1), "shape"),
        (lambda: encode_events(-np.ones((1, 2, 2), np.float32), "davis346", seconds=1, seed=1), "negative"),
        (lambda: encode_events(np.ones((1, 2, 2), np.float32), "davis346", seconds=0, seed=1), "0"),
        (lambda: EventCamera(davis(), (0, 3), seed=1), "shape"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(call, words):
    assert words in str(refusal(call))
