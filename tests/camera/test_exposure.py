"""Charge from light, and the scale of exposure, compared with closed forms and with the encoder."""

from dataclasses import dataclass
from math import atan, cos, hypot, pi

import numpy as np
import pytest
from refusals import refusal

from saf_gen.camera import Encoder, charge_of_images, encode, exposure_scale, get_sensor
from saf_gen.camera.exposure import electrons_per_irradiance, firing_rate, irradiance_ratio

VIDAR = get_sensor("vidar_400x250")
IDEAL = get_sensor("ideal")
V, R = 0.052, 0.009


@dataclass
class Lens:
    """A lens at ``distances`` (m) from the sensor at any position."""

    distances: np.ndarray
    aperture_radius_m: float = R
    transmission: float = 1.0
    veiling_glare: float = 0.0

    def image_distance(self, position):
        return self.distances


def test_irradiance_falls_with_the_fourth_power_of_the_cosine():
    factor = irradiance_ratio((250, 400), np.array([V]), pitch_m=2e-5, aperture_radius_m=R)[0]
    for row, column in [(0, 0), (124, 200), (249, 17)]:
        angle = atan(hypot((row - 124.5) * 2e-5, (column - 199.5) * 2e-5) / V)
        assert factor[row, column] == pytest.approx(pi * R**2 / V**2 * cos(angle) ** 4, rel=1e-12)
    assert factor[0, 0] < 0.99 * factor[124, 199]  # the effect is large in the corner
    near, far = irradiance_ratio((1, 1), np.array([V, 2 * V]), pitch_m=2e-5, aperture_radius_m=R, transmission=0.8)
    assert near / far == pytest.approx(4)
    assert near == pytest.approx(0.8 * pi * R**2 / V**2)


def test_electrons_are_photons_times_quantum_efficiency_and_fill_factor():
    photon = 6.62607015e-34 * 299_792_458 / 5.55e-7
    photons = 3.0 * (2e-5) ** 2 / 20_000 / photon
    assert 3.0 * electrons_per_irradiance(VIDAR) == pytest.approx(photons * 0.5 * 0.43)


def test_a_uniform_scene_gives_a_rate_of_charge_over_threshold_with_cos4_and_bellows():
    """Four quarters of the field at two image distances agree with the closed form within 0.5 %; seed 1."""
    radiance = np.full((2, 2, 60, 80), 0.5 * 0.1, np.float32)  # two groups share the light
    sensor = get_sensor("ideal", pitch_m=2e-4)  # wide angles
    distances = np.array([V, 1.3 * V])
    stack = charge_of_images(radiance, sensor, lens=Lens(distances), position=np.array([0, 1]))
    assert stack.dtype == np.float32
    for k, v in enumerate(distances):
        n = 2_000
        spikes = Encoder(sensor, (60, 80), seed=1).encode(
            stack, index=np.full(n, k), fraction=np.zeros(n), gain=np.ones((n, 2))
        )
        rate = np.bitwise_count(spikes).sum(axis=-1) / n
        r2 = ((np.arange(60)[:, None] - 29.5) ** 2 + (np.arange(80) - 39.5) ** 2) * (2e-4) ** 2
        irradiance = pi * R**2 / v**2 * (1 + r2 / v**2) ** -2 * 0.1
        expected = irradiance * electrons_per_irradiance(sensor) / sensor.threshold_e
        assert 0.05 < expected.min() < 0.97 * expected.max() < 0.97
        for part in (np.s_[:30, :40], np.s_[:30, 40:], np.s_[30:, :40], np.s_[30:, 40:]):
            assert rate[part].mean() == pytest.approx(expected[part].mean(), rel=0.005)


def test_glare_is_a_share_of_the_frames_light_that_is_spread_evenly_and_none_of_it_is_lost():
    """The dark half of the field gets the share times the mean; the sum of all charge stays."""
    radiance = np.zeros((2, 2, 30, 40), np.float32)
    radiance[0, :, :, 20:], radiance[1, :, :10] = 0.3, 0.1
    distances = np.array([V, 1.3 * V])
    plain, veiled = (
        charge_of_images(radiance, IDEAL, lens=Lens(distances, veiling_glare=share), position=np.array([0, 1]))
        for share in (0.0, 0.05)
    )
    mean = plain.mean(axis=(2, 3), dtype=np.float64)
    assert veiled.mean(axis=(2, 3), dtype=np.float64) == pytest.approx(mean, rel=2e-6)
    assert veiled[0, :, :, :20] == pytest.approx(np.broadcast_to(0.05 * mean[0, :, None, None], (2, 30, 20)), rel=2e-6)
    assert veiled == pytest.approx(0.95 * plain + 0.05 * mean[:, :, None, None], rel=2e-6)


def test_glare_is_seen_in_the_spikes_of_a_black_field():
    """20,000 readouts of a sensor without noise: a black half fires at the share of the mean, to a spike."""
    radiance = np.zeros((1, 1, 8, 16), np.float32)
    radiance[..., 8:] = 0.4
    lens = Lens(np.array([V]), veiling_glare=0.1)
    charge = charge_of_images(radiance, IDEAL, lens=lens, position=np.array([0]))[0, 0]
    spikes = encode(charge[None], IDEAL.with_noise(shot=False), frames=20_000, seed=1)
    counts = np.bitwise_count(spikes).sum(axis=-1)
    white = charge_of_images(radiance, IDEAL, lens=Lens(np.array([V])), position=np.array([0]))
    assert np.abs(counts[:, :8] - 20_000 * 0.1 * white.mean() / IDEAL.threshold_e).max() <= 1


@pytest.mark.parametrize(
    ("saturation", "mean_rate"), [("subtract", 0.02), ("subtract", 0.2), ("subtract", 0.9), ("dead_readout", 0.6)]
)
def test_the_scale_makes_the_encoder_fire_at_the_mean_rate(saturation, mean_rate):
    """A textured target of 1,500 pixels without fixed response, whose mean there is not 1; 1 % allowed; seed 3."""
    random = np.random.default_rng(3)
    charge = random.uniform(20, 2_000, (60, 80)).astype(np.float32)
    target = np.zeros((60, 80), bool)
    target[5:35, 20:70] = True
    sensor = get_sensor("vidar_400x250", saturation=saturation, dark_hot_fraction=0, noise={"response": False})
    scale = exposure_scale(charge, target, sensor=sensor, mean_rate=mean_rate)
    spikes = encode((scale * charge)[None].astype(np.float32), sensor, frames=1_600, seed=3)
    assert np.bitwise_count(spikes).sum(axis=-1)[target].mean() / 1_600 == pytest.approx(mean_rate, rel=0.01)


def test_a_warm_sensor_with_uncertain_resets_fires_at_the_mean_rate_too():
    """Dark current is 8 times that at 25 °C, 0.036 of the rate of 0.2; 4,800 pixels, 0.5 % allowed; seed 3."""
    sensor = get_sensor(
        "vidar_400x250", temperature_c=49, dark_hot_fraction=0, reset_jitter=0.1, row_skew=1,
        noise={"response": False, "dust": False, "reset_jitter": True},
    )  # fmt: skip
    charge = np.random.default_rng(3).uniform(20, 2_000, (60, 80)).astype(np.float32)
    scale = exposure_scale(charge, np.ones((60, 80), bool), sensor=sensor, mean_rate=0.2)
    spikes = encode((scale * charge)[None].astype(np.float32), sensor, frames=1_600, seed=3)
    assert np.bitwise_count(spikes).sum(axis=-1).mean() / 1_600 == pytest.approx(0.2, rel=0.005)
    cold = exposure_scale(charge, np.ones((60, 80), bool), sensor=VIDAR, mean_rate=0.2)
    assert scale / cold == pytest.approx((0.2 - 8 * 0.0045) / (0.2 - 0.0045), rel=0.02)


def test_the_scale_hides_the_order_of_summation():
    """The scale is rounded to 20 bits, which removes differences in the last bits of a mean."""
    charge = np.random.default_rng(1).uniform(1, 1e3, (50, 50))
    everywhere = np.ones((50, 50), bool)
    scale = exposure_scale(charge, everywhere, sensor=VIDAR, mean_rate=0.2)
    assert scale == exposure_scale(charge[::-1].copy(), everywhere, sensor=VIDAR, mean_rate=0.2)
    assert (scale * 2.0 ** (20 - np.frexp(scale)[1])).is_integer()


@pytest.mark.parametrize(
    ("mean_rate", "saturation", "allowed"),
    [
        (0.004, "subtract", "above the dark rate 0.0045 and below 1 spikes"),
        (1.0, "subtract", "below 1"),
        (0.95, "dead_readout", "below 0.941"),
        (float("nan"), "subtract", "below 1"),
        (0.6, "subtract", "below 0.502"),
    ],
)
def test_a_mean_rate_out_of_reach_is_refused(mean_rate, saturation, allowed):
    sensor = get_sensor("vidar_400x250", saturation=saturation)
    charge, target = np.array([[0.0, 5.0]]), np.ones((1, 2), bool)
    error = refusal(exposure_scale, charge, target, sensor=sensor, mean_rate=mean_rate)
    assert error.problem.startswith(f"mean_rate is {mean_rate:g}")
    assert allowed in error.allowed
    assert "no pixel" in str(refusal(exposure_scale, charge, ~target, sensor=sensor, mean_rate=0.2))


def test_the_law_of_rates_is_capped():
    assert firing_rate(np.array([0.0, 0.25, 9.0]) * IDEAL.threshold_e, IDEAL) == pytest.approx([0, 0.25, 1])
    dead = get_sensor("ideal", saturation="dead_readout")
    rates = firing_rate(np.array([1.0, 1e9]) * dead.threshold_e, dead)
    assert rates == pytest.approx([0.5, 16 / 17])
    spikes = encode(np.full((1, 8, 8), 1e9, np.float32), dead, frames=1_700, seed=1)
    assert np.bitwise_count(spikes).sum(axis=-1).mean() / 1_700 == pytest.approx(16 / 17, rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"distances": np.array([V])}, "image_distance (1,)"),
        ({"distances": np.array([V, -1])}, "is -1 m"),
        ({"aperture_radius_m": 0.0}, "radius is 0 m"),
        ({"transmission": 1.2}, "is 1.2; allowed: above 0, at most 1"),
        ({"veiling_glare": 1.0}, "is 1; allowed: at least 0, below 1"),
        ({"veiling_glare": -0.1}, "is -0.1; allowed: at least 0, below 1"),
    ],
)
def test_lenses_that_cannot_be_are_refused(changes, message):
    lens = Lens(**{"distances": np.array([V, V]), **changes})
    radiance, position = np.ones((1, 2, 3, 4)), np.array([0, 1])
    assert message in str(refusal(charge_of_images, radiance, VIDAR, lens=lens, position=position))
