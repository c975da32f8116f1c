"""Single-photon arrays: the laws of their bits, a slow twin, and what must not change them."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal

from saf_gen.camera import get_sensor, sensor_names
from saf_gen.camera.photons import SpadCamera, SpadSensor
from saf_gen.camera.photons.camera import _random_words
from saf_gen.camera.photons.sensor import detection_rate

SHAPE = (16, 64)
QUIET = {"dark": False, "response": False, "dead_time": False, "afterpulsing": False}
FRAMES = 2000
LIMIT = 4.4  # standard deviations: one in 100,000 of a normal law; two million bits per test, all seeds stated


def clocked(**changes) -> SpadSensor:
    return get_sensor("swissspad3", kind="photons", noise=QUIET | changes.pop("noise", {}), **changes)


def passive(dead_frames, **changes) -> SpadSensor:
    hz = get_sensor("swissspad3", kind="photons").readout_hz
    on = {"dead_time": True, "afterpulsing": True}
    return clocked(recharge="passive", dead_time_s=dead_frames / hz, exposure_s=1 / hz, noise=on, **changes)


def bits(sensor, photons, *, frames=FRAMES, seed=1, shape=SHAPE, **options):
    """Return the bits in constant light of so many photons per open gate, bool (H, W, T)."""
    camera = SpadCamera(sensor, shape, seed=seed, **options)
    packed = expose(camera, np.full((1, 1, *camera.shape), photons / sensor.gate, np.float32), frames)
    return np.unpackbits(packed, axis=-1, bitorder="little")[..., :frames].astype(bool)


def expose(camera, stack, frames, *, gain=None):
    still = np.zeros(frames)
    gain = np.ones((frames, len(stack))) if gain is None else gain
    return camera.encode(stack, index=still.astype(int), fraction=still, gain=gain)


def deviations(seen, rate):
    """Return by how many standard deviations the mean of independent bits is off."""
    return (seen.mean() - rate) / np.sqrt(rate * (1 - rate) / seen.size)


@pytest.mark.parametrize("photons", [1e-3, 0.05, 0.7, 2.0, 5.0])
def test_a_bit_has_the_probability_of_at_least_one_photon(photons):
    seen = bits(clocked(), photons)
    assert abs(deviations(seen, -np.expm1(-photons))) < LIMIT
    assert detection_rate(photons, clocked()) == pytest.approx(-np.expm1(-photons))


def test_no_light_gives_no_bit_and_much_light_gives_all():
    assert not bits(clocked(), 0.0).any()
    assert bits(clocked(), 1e6).all()


def test_a_shorter_gate_detects_as_many_fewer():
    """A camera meets the same light with a gate of a quarter of a frame."""
    sensor = clocked(exposure_s=0.25 / 97_700)
    packed = expose(SpadCamera(sensor, SHAPE, seed=3), np.full((1, 1, *SHAPE), 2.0, np.float32), FRAMES)
    assert abs(deviations(np.unpackbits(packed), -np.expm1(-0.5))) < LIMIT


EVEN_DARK = {"dark_log_sd": 0.0, "dark_hot_fraction": 0.0, "noise": {"dark": True}}  # alike in all pixels


@pytest.mark.parametrize("recharge", ["clocked", "passive"])
@pytest.mark.parametrize("gate", [1.0, 0.25, 0.01])
def test_dark_counts_come_only_while_the_gate_is_open(gate, recharge):
    """Without light, 1 - exp(-D·gate) of two million bits, D = 0.6 in a whole frame: at 1 in 100,000; seed 41."""
    hz = 97_700
    sensor = clocked(recharge=recharge, dark_hz=0.6 * hz, exposure_s=gate / hz, **EVEN_DARK)
    assert abs(deviations(bits(sensor, 0.0, seed=41), -np.expm1(-0.6 * gate))) < LIMIT


def test_dark_counts_add_to_the_photons_of_the_open_gate():
    """1 - exp(-H - D·gate) of two million bits, H = 0.3 and D·gate = 0.1: at 1 in 100,000; seed 43."""
    sensor = clocked(dark_hz=0.4 * 97_700, exposure_s=0.25 / 97_700, **EVEN_DARK)
    assert abs(deviations(bits(sensor, 0.3, seed=43), -np.expm1(-0.4))) < LIMIT


def test_counts_are_binomial_and_pixels_and_frames_independent():
    seen = bits(clocked(), 0.7, seed=5)
    p, n = -np.expm1(-0.7), 100
    counts = seen.reshape(*SHAPE, -1, n).sum(-1)
    variance = n * p * (1 - p)
    spread = np.sqrt(2 / counts.size)
    assert abs(counts.var() / variance - 1) < LIMIT * spread
    off = seen - p
    for a, b in (
        (off[:, 1:], off[:, :-1]),
        (off[1:], off[:-1]),
        (off[..., 1:], off[..., :-1]),
        (off[..., 64:], off[..., :-64]),
    ):
        correlation = (a * b).mean() / (p * (1 - p))
        assert abs(correlation) * np.sqrt(a.size) < LIMIT


@pytest.mark.parametrize("photons", [0.1, 0.7, 2.0])
def test_an_afterpulse_follows_in_the_next_frame(photons):
    sensor = clocked(afterpulse=0.2, noise={"afterpulsing": True})
    seen, p = bits(sensor, photons, seed=7), -np.expm1(-photons)
    lone, after = seen[..., 1:][~seen[..., :-1]], seen[..., 1:][seen[..., :-1]]
    assert abs(deviations(lone, p)) < LIMIT
    assert abs(deviations(after, 1 - (1 - p) * 0.8)) < LIMIT
    assert detection_rate(photons, sensor) == pytest.approx(p / (1 - 0.2 * (1 - p)))


@pytest.mark.parametrize("dead", [0.05, 0.6, 1.7])
@pytest.mark.parametrize("photons", [0.1, 0.7, 3.0])
def test_dead_time_empties_frames_as_a_renewal_process_does(photons, dead):
    """The frames of a pixel are dependent, so that the spread is that of the means of 1,024 pixels."""
    sensor = passive(dead, afterpulse=0.1)
    means = bits(sensor, photons, seed=11)[..., 50:].mean(-1)
    off = means.mean() - detection_rate(photons, sensor)
    assert abs(off) < LIMIT * means.std() / np.sqrt(means.size)


def test_dead_time_is_stated_in_frames():
    assert passive(0.6).dead_frames == pytest.approx(0.6)
    assert replace(passive(0.6), noise=clocked().noise).dead_frames == 0
    seen, without = (bits(passive(dead, afterpulse=0.0), 3.0, seed=31).mean() for dead in (0.6, 0.0))
    assert seen < without - 0.05


def test_in_the_brightest_light_a_pixel_fires_once_per_dead_time():
    sensor = passive(2.5, afterpulse=0.0)
    assert bits(sensor, 1000.0, frames=20_000, shape=(1, 64)).mean() == pytest.approx(1 / 2.5, rel=2e-3)


def test_without_dead_time_a_passive_pixel_obeys_the_law_of_the_clock():
    sensor = passive(0.0, afterpulse=0.0)
    assert abs(deviations(bits(sensor, 0.7, seed=13), -np.expm1(-0.7))) < LIMIT


def test_a_switched_off_imperfection_does_nothing():
    off = replace(passive(0.6, afterpulse=0.3), noise=clocked().noise)
    assert abs(deviations(bits(off, 0.7, seed=17), -np.expm1(-0.7))) < LIMIT
    same = clocked(afterpulse=0.3, dark_hz=1e5, response_rms=0.2)
    np.testing.assert_array_equal(bits(same, 0.7), bits(clocked(), 0.7))


def test_dark_counts_and_response_differ_between_pixels_as_stated():
    sensor = clocked(dark_hz=5e3, dark_hot_fraction=0.0, response_rms=0.05, noise={"dark": True, "response": True})
    dark = -np.log1p(-bits(sensor, 0.0, frames=20_000, seed=19).mean(-1))
    assert dark.mean() == pytest.approx(5e3 / 97_700, rel=0.06)  # 1,024 pixels of a log-normal law of 0.5
    assert np.log(dark).std() == pytest.approx(0.5, rel=0.1)
    lit = -np.log1p(
        -bits(replace(sensor, noise=replace(sensor.noise, dark=False)), 0.7, frames=20_000, seed=19).mean(-1)
    )
    assert lit.std() / lit.mean() == pytest.approx(0.05, rel=0.12)


def mixed(word):
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        word = (word ^ (word >> shift)) * factor % 2**64
    return word ^ (word >> 31)


def drawn_plane(pixel, moment):
    word = int(pixel[0]) ^ int(moment[0])
    for shift, factor, other in ((16, 0x7FEB352D, int(pixel[1]) ^ int(moment[1])), (15, 0x846CA68B, 0)):
        word = ((word ^ (word >> shift)) * factor) % 2**32 ^ other
    word = ((word ^ (word >> 16)) * 0x9E3779B1) % 2**32
    return word ^ (word >> 15)


def twin_draw(pixel, moments, frame):
    """Return the number of a pixel and a frame that is compared with p, 0 to 1."""
    half, golden = frame // 32, 0x9E3779B97F4A7C15
    number = 0
    for bit in range(8):
        number |= (drawn_plane(pixel, moments[:, 8 * half + bit]) >> frame % 32 & 1) << (24 + bit)
    key = (int(pixel[0]) << 32) | int(pixel[1])
    return (number | mixed(((key ^ 0xD1B54A32D192ED03) + frame * golden) % 2**64) >> 40) / 2**32


@pytest.mark.slow
@pytest.mark.parametrize("flicker", [0.0, 0.9])
def test_a_slow_twin_makes_the_same_bits(flicker):
    """The law in plain steps: each bit of each number is taken from its word, and the number is below p or not.

    In light that flickers, bounds are those of eight frames and in steady light those of 64.
    """
    sensor, shape, frames = clocked(), (3, 50), 150
    light = np.random.default_rng(0).random((1, 1, *shape), np.float32) * 3
    gain = 1 + flicker * np.sin(np.arange(frames))[:, None]
    packed = expose(SpadCamera(sensor, shape, seed=23), light, frames, gain=gain)
    seen = np.unpackbits(packed, axis=-1, bitorder="little")[..., :frames].reshape(150, frames)
    pixels, moments = _random_words("pixels", range(150), seed=23), _random_words("frames", range(48), seed=23)
    p = -np.expm1(-light.reshape(150, 1) * sensor.gate * gain[:, 0])
    drawn = np.array([[twin_draw(pixels[:, i], moments, t) for t in range(frames)] for i in range(150)])
    clear = np.abs(drawn - p) > 2e-6  # the kernel's exponential is good to 5e-7
    assert clear.mean() > 0.999
    np.testing.assert_array_equal(seen[clear], (drawn < p)[clear])


def test_afterpulses_are_carried_on_as_a_slow_twin_does():
    """A bit is 1 of itself, or because its pulse is and the bit before is 1, across words and calls, frame by frame."""
    quiet = clocked()
    loud = clocked(afterpulse=0.4, noise={"afterpulsing": True})
    alone, followed = bits(quiet, 0.3, frames=400, seed=43), bits(loud, 0.3, frames=400, seed=43)
    assert not (alone & ~followed).any()  # the photons are the same
    added = followed & ~alone
    assert not added[..., 0].any()
    assert not (added[..., 1:] & ~followed[..., :-1]).any()  # nothing follows a 0
    could = followed[..., :-1] & ~alone[..., 1:]
    assert abs(deviations(added[..., 1:][could], 0.4)) < LIMIT
    for frame in (32, 64, 128, 200):  # also over the edges of words
        assert abs(deviations(added[..., frame][could[..., frame - 1]], 0.4)) < LIMIT


def test_strong_changes_of_light_do_not_change_the_law():
    """Rates in each of sixteen phases of light that flickers from 0 to twice its mean."""
    camera, frames = SpadCamera(clocked(), SHAPE, seed=47), 1600
    gain = (1 + np.sin(np.arange(frames) * np.pi / 8))[:, None]
    packed = expose(camera, np.full((1, 1, *SHAPE), 0.7 / clocked().gate, np.float32), frames, gain=gain)
    seen = np.unpackbits(packed, axis=-1, bitorder="little").reshape(*SHAPE, -1, 16)
    for phase in range(16):
        p = -np.expm1(-0.7 * gain[phase, 0])
        if p > 1e-6:
            assert abs(deviations(seen[..., phase], p)) < LIMIT
        else:
            assert not seen[..., phase].any()


@pytest.mark.parametrize(
    "sensor", [clocked(afterpulse=0.1, noise={"afterpulsing": True}), passive(0.7, afterpulse=0.1)]
)
def test_bits_depend_on_neither_blocks_nor_threads_nor_rows(sensor):
    light = np.random.default_rng(1).random((2, 1, *SHAPE), np.float32)
    gain = np.random.default_rng(2).random((296, 2))
    whole = expose(SpadCamera(sensor, SHAPE, seed=29, threads=1), light, 296, gain=gain)
    camera = SpadCamera(sensor, SHAPE, seed=29, threads=3)
    parts = [
        expose(camera, light, stop - start, gain=gain[start:stop])
        for start, stop in ((0, 8), (8, 40), (40, 72), (72, 296))
    ]
    np.testing.assert_array_equal(np.concatenate(parts, axis=-1), whole)
    some = SpadCamera(sensor, SHAPE, seed=29, rows=slice(5, 9))
    np.testing.assert_array_equal(expose(some, light[:, :, 5:9], 296, gain=gain), whole[5:9])


@pytest.mark.parametrize(
    ("sensor", "digest"),
    [
        (get_sensor("swissspad3", kind="photons"), "444baad832d0a8ee"),
        (passive(0.7, afterpulse=0.1), "7c995db38a4b6bd2"),
    ],
)
def test_bits_are_the_same_on_any_machine(sensor, digest):
    packed = np.packbits(bits(sensor, 0.7, frames=400))
    assert hashlib.sha256(packed.tobytes()).hexdigest()[:16] == digest


def test_an_exposure_is_chosen_for_the_light():
    sensor = clocked()
    assert sensor.exposed_for(np.array([np.log(2) / 2e-6])).exposure_s == pytest.approx(2e-6, rel=1e-5)
    two = np.array([1e5, 4e6])
    chosen = sensor.exposed_for(two).exposure_s
    assert -np.expm1(-two * chosen).mean() == pytest.approx(0.5, rel=1e-4)
    for dim in (1.0, 0.0):  # no longer than a frame
        assert sensor.exposed_for(np.array([dim])).exposure_s == pytest.approx(1 / sensor.readout_hz)
    assert sensor.exposed_for(np.array([1e12])).exposure_s == sensor.shortest_exposure_s


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"exposure_s": 1e-4}, "exposure_s is 0.0001; allowed: 1e-09"),
        ({"exposure_s": 5e-10}, "exposure_s is 5e-10"),
        ({"dead_time_s": 1e-7}, "with recharge: clocked"),
        ({"recharge": "active"}, "'active'"),
        ({"afterpulse": 0.9}, "0 to 0.5"),
        ({"dark_hz": -1}, "0 to 1e+06 hertz"),
        ({"exposure_us": 1}, "exposure_s"),
        ({"noise": {"shot": True}}, "shot"),
    ],
)
def test_what_no_array_can_be_is_refused(changes, words):
    assert words in str(refusal(get_sensor, "swissspad3", kind="photons", **changes))


def test_unknown_arrays_and_wrong_calls_are_refused():
    assert "did you mean 'swissspad3'?" in str(refusal(get_sensor, "swisspad3", kind="photons"))
    assert "the array's shape" in str(refusal(SpadCamera, clocked(), (0, 5), seed=1))
    assert "multiple of 16" in str(refusal(SpadCamera, clocked(), (64, 20), seed=1, rows=slice(3, 5)))
    camera = SpadCamera(clocked(), SHAPE, seed=1)
    assert "float32" in str(refusal(expose, camera, np.zeros((1, 1, *SHAPE)), 8))
    assert "negative" in str(refusal(expose, camera, np.full((1, 1, *SHAPE), -1, np.float32), 8))
    expose(camera, np.ones((1, 1, *SHAPE), np.float32), 9)
    assert "multiple of 8" in str(refusal(expose, camera, np.ones((1, 1, *SHAPE), np.float32), 8))
    assert "whole frame" in str(refusal(detection_rate, 1.0, replace(passive(0.5), exposure_s=1e-6)))


def test_every_shipped_array_cites_its_numbers():
    for name in sensor_names("photons"):
        assert any("doi:" in source for source in get_sensor(name, kind="photons").sources)
