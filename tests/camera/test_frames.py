"""Frame cameras: photon transfer, saturation, quantisation, and what must not change a frame."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal
from scipy import stats

from saf_gen.camera import get_sensor, sensor_names
from saf_gen.camera.frames import FrameCamera, FrameSensor

SHAPE = (60, 80)
QUIET = {"shot": False, "read": False, "dark": False, "response": False}
LIMIT = 4.4  # standard deviations: one in 100,000 of a normal law; all seeds are stated


def sensor_of(**changes) -> FrameSensor:
    return get_sensor("imx273", kind="frames", noise=QUIET | changes.pop("noise", {}), **changes)


def frames(sensor, charge, *, count=40, seed=1):
    camera = FrameCamera(sensor, SHAPE, seed=seed)
    return np.stack([camera.read(np.full(SHAPE, float(charge)), frame=n) for n in range(count)]).astype(np.float64)


@pytest.mark.parametrize("charge", [0.0, 10.0, 500.0, 7000.0])
def test_photon_transfer_is_that_of_shot_read_and_quantisation_noise(charge):
    """Mean = black + charge/K and Var = (charge + read²)/K² + 1/12, K electrons per level (EMVA 1288, 2.2)."""
    sensor = sensor_of(noise={"shot": True, "read": True}, read_noise_e=30.0)
    seen = frames(sensor, charge)
    k = sensor.electrons_per_level
    mean = sensor.black_level_dn + charge / k
    assert abs(seen.mean() - mean) < LIMIT * np.sqrt(charge + 900) / k / np.sqrt(seen.size)
    variance = (charge + 30.0**2) / k**2 + 1 / 12
    assert abs(seen.var() / variance - 1) < LIMIT * np.sqrt(2 / seen.size) + 2e-3


@pytest.mark.parametrize(("black", "read_e"), [(240, 2.8), (240, 12.0), (64, 2.8), (32, 9.0)])
def test_noise_in_the_dark_is_about_the_black_level_and_not_cut_off(black, read_e):
    """Mean and variance of 480,000 numbers, black and read²/K² + 1/12, each at 1 in 100,000; the seed is 23."""
    sensor = sensor_of(noise={"read": True}, read_noise_e=read_e, black_level_dn=black)
    seen = frames(sensor, 0.0, count=100, seed=23)
    variance = (read_e / sensor.electrons_per_level) ** 2 + 1 / 12
    assert abs(seen.mean() - black) < LIMIT * np.sqrt(variance / seen.size)
    assert abs(seen.var() / variance - 1) < LIMIT * np.sqrt(2 / seen.size)
    assert (seen == 0).mean() < 0.005  # as EMVA 1288 asks of an offset


ELECTRONS = {"full_well_e": 65_535.0, "bits": 16, "black_level_dn": 0}  # a number for each electron
SIGNIFICANCE = 1e-4  # of each χ² test; 480,000 numbers, whose seeds are stated


@pytest.mark.parametrize("mean", [0.1, 5.0, 9.9, 10.0, 12.5, 100.0, 5000.0, 30_000.0])
def test_electrons_obey_poissons_law(mean):
    """χ² of at most 200 classes, none of which is expected less than five times."""
    seen = frames(sensor_of(noise={"shot": True}, **ELECTRONS), mean, count=100, seed=11).ravel()
    law = stats.poisson(mean)
    edges = np.unique(law.ppf(np.linspace(0, 1, 201)[1:-1]) if mean > 40 else np.arange(0.0, law.isf(2e-5)))
    edges = edges[(law.cdf(edges) * seen.size > 5) & (law.sf(edges) * seen.size > 5)]
    expected = np.diff(np.r_[0, law.cdf(edges), 1]) * seen.size
    found = np.bincount(np.searchsorted(edges, seen), minlength=len(expected))
    assert expected.min() > 5
    assert stats.chisquare(found, expected).pvalue > SIGNIFICANCE
    assert abs(seen.mean() - mean) < LIMIT * np.sqrt(mean / seen.size)


def test_readings_are_off_by_the_normal_law():
    """χ² of 300 classes of equal probability, and the tails beyond three and four standard deviations."""
    sensor = sensor_of(noise={"read": True}, read_noise_e=2000.0, **ELECTRONS)
    off = (frames(sensor, 30_000.0, count=100, seed=13).ravel() - 30_000) / 2000
    inner = np.rint(stats.norm.ppf(np.linspace(0, 1, 301)[1:-1]) * 2000) / 2000 + 0.25 / 1000  # between two numbers
    expected = np.diff(np.r_[0, stats.norm.cdf(inner), 1]) * off.size
    found = np.bincount(np.searchsorted(inner, off), minlength=len(expected))
    assert stats.chisquare(found, expected).pvalue > SIGNIFICANCE
    for limit in (3.0, 3.7, 4.0):
        for tail in (off > limit, off < -limit):
            rare = stats.norm.sf(limit) * off.size
            assert abs(tail.sum() - rare) < LIMIT * np.sqrt(rare) + 1


def test_few_electrons_and_many_join():
    """Means on both sides of the one at which the method changes have the same law, to the noise of a million."""
    sensor = sensor_of(noise={"shot": True}, **ELECTRONS)
    below, above = (frames(sensor, mean, count=200, seed=17).ravel() for mean in (np.nextafter(10.0, 0), 10.0))
    table = [np.bincount(seen.astype(int), minlength=40)[2:22] for seen in (below, above)]
    assert stats.chi2_contingency(table).pvalue > SIGNIFICANCE


def test_pixels_and_frames_are_independent():
    seen = frames(sensor_of(noise={"shot": True, "read": True}), 2000.0, seed=3)
    off = seen - seen.mean()
    for a, b in ((off[1:], off[:-1]), (off[:, 1:], off[:, :-1]), (off[:, :, 1:], off[:, :, :-1])):
        assert abs((a * b).mean() / off.var()) * np.sqrt(a.size) < LIMIT


@pytest.mark.parametrize(("charge", "level"), [(0.0, 240), (10_500.0, 4095), (1e6, 4095), (5250.0, 2168)])
def test_a_well_is_full_at_the_largest_number(charge, level):
    assert (frames(sensor_of(), charge, count=1) == level).all()


def test_every_number_of_bits_has_its_levels():
    for bits in (1, 8, 12, 16):
        seen = frames(sensor_of(bits=bits, black_level_dn=0), 10_500.0, count=1)
        assert (seen == 2**bits - 1).all()


def test_dark_current_and_response_differ_between_pixels_and_stay():
    dark = sensor_of(dark_e_per_s=1e6, dark_hot_fraction=0.0, noise={"dark": True})
    seen = (frames(dark, 0.0, count=2) - dark.black_level_dn) * dark.electrons_per_level
    np.testing.assert_array_equal(seen[0], seen[1])
    assert seen[0].mean() == pytest.approx(1e6 * dark.exposure_s, rel=0.05)
    assert np.log(seen[0]).std() == pytest.approx(0.5, rel=0.1)
    lit = frames(sensor_of(response_rms=0.05, noise={"response": True}), 5000.0, count=2) - dark.black_level_dn
    np.testing.assert_array_equal(lit[0], lit[1])
    assert lit[0].std() / lit[0].mean() == pytest.approx(0.05, rel=0.1)


def test_a_frame_is_the_same_whatever_was_exposed_before():
    noisy = sensor_of(noise=dict.fromkeys(QUIET, True))
    first, second = FrameCamera(noisy, SHAPE, seed=5, device_seed=7), FrameCamera(noisy, SHAPE, seed=5, device_seed=7)
    charge = np.full(SHAPE, 900.0)
    first.read(charge, frame=0)
    np.testing.assert_array_equal(first.read(charge, frame=1), second.read(charge, frame=1))
    other = FrameCamera(noisy, SHAPE, seed=6, device_seed=7).read(charge, frame=1)
    assert (other != second.read(charge, frame=1)).mean() > 0.5


def test_an_exposure_is_chosen_for_the_light():
    sensor = sensor_of()
    assert sensor.exposed_for(np.array([5e6, 15e6])).exposure_s == pytest.approx(0.5 * 10_500 / 1e7)
    assert sensor.exposed_for(np.array([1.0])).exposure_s == pytest.approx(1 / sensor.readout_hz)
    assert sensor.exposed_for(np.array([0.0])).exposure_s == pytest.approx(1 / sensor.readout_hz)
    assert sensor.exposed_for(np.array([1e15])).exposure_s == sensor.shortest_exposure_s


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"exposure_s": 0.002}, "exposure_s is 0.002"),
        ({"exposure_s": 1e-7}, "exposure_s is 1e-07"),
        ({"shutter": "rolling"}, "above 0 with rolling"),
        ({"row_s": 1e-5}, "0 with global"),
        ({"shutter": "mechanical"}, "'mechanical'"),
        ({"bits": 17}, "1 to 16"),
        ({"bits": 7}, "0 to 126, below the largest number"),
        ({"black_level_dn": -1}, "black_level_dn"),
        ({"black_level_dn": 0.5}, "whole number"),
        ({"bits": 8.5}, "whole number"),
        ({"full_well_e": 0}, "10 to 1e+07"),
        ({"noise": {"dust": True}}, "dust"),
    ],
)
def test_what_no_frame_camera_can_be_is_refused(changes, words):
    assert words in str(refusal(get_sensor, "imx273", kind="frames", **changes))


def test_unknown_cameras_and_wrong_light_are_refused():
    assert "did you mean 'imx273'?" in str(refusal(get_sensor, "imx237", kind="frames"))
    camera = FrameCamera(sensor_of(), SHAPE, seed=1)
    assert "shape" in str(refusal(camera.read, np.zeros((3, 3)), frame=0))
    for wrong in (-1.0, np.nan, np.inf):
        assert "negative or not finite" in str(refusal(camera.read, np.full(SHAPE, wrong), frame=0))
    assert "the array's shape" in str(refusal(FrameCamera, sensor_of(), (0, 5), seed=1))
    assert sensor_names("frames") == ["imx273"]
    assert replace(sensor_of(), bits=8, black_level_dn=15).levels == 255
