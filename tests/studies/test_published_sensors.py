"""Statistics beside published ones, compared with planted profiles, spectra, tails and slow references."""

from itertools import pairwise

import numpy as np
import pytest
from refusals import assert_says, refusal
from scipy import stats
from small_dataset import HERE

from saf_gen import write_stream
from saf_gen.addons.calibrate.flat_checks import split_pattern
from saf_gen.addons.calibrate.recordings import open_recording
from saf_gen.addons.calibrate.spike_statistics import measure_spikes
from saf_gen.camera import get_sensor
from saf_gen.core.seeds import make_generator
from studies.published_sensors import (
    BANDS,
    as_published,
    band_statistics,
    dark_figures,
    legendre_fractions,
    main,
    mean_light,
    pattern_figures,
    published_statistics,
    rms_between_halves,
    stream_figures,
)


def test_profiles_and_rest_add_up_to_the_map_and_are_orthogonal():
    map_ = 3 + make_generator("pattern").standard_normal((40, 60))
    columns, rows, white = split_pattern(map_)
    assert columns + rows[:, None] + white == pytest.approx(map_ / map_.mean() - 1)
    assert np.abs([columns.sum(), rows.sum(), *white.sum(axis=0), *white.sum(axis=1)]).max() < 1e-10
    parts = pattern_figures(map_)
    assert parts["rms"] ** 2 == pytest.approx(
        parts["column_rms"] ** 2 + parts["row_rms"] ** 2 + parts["white_rms"] ** 2
    )


def test_planted_profiles_are_found():
    """Columns are a cosine of 4 % rms and rows a slope of 2 % rms, whose statistics have closed forms."""
    columns = 0.04 * np.sqrt(2) * np.cos(2 * np.pi * np.arange(128) / 16)
    rows = 0.02 * np.sqrt(3) * np.linspace(-1, 1, 1001)
    found = pattern_figures(5.0 * (1 + columns + rows[:, None]))
    assert found["column_rms"] == pytest.approx(0.04)
    assert found["row_rms"] == pytest.approx(0.02, rel=2e-3)
    assert found["white_rms"] < 1e-12
    assert found["column_bands"] == pytest.approx((0, 0, 0, 0, 1, 0, 0), abs=1e-12)  # 1/16 is above 0.05, below 0.1
    assert found["row_degrees"] == pytest.approx((1, 1, 1))


def test_bands_hold_all_of_the_variance_and_each_wave_is_in_its_own():
    assert sum(band_statistics(make_generator("bands").standard_normal(400))) == pytest.approx(1)
    for length in (400, 401):
        for at, band in enumerate(BANDS):
            wave = np.cos(2 * np.pi * np.floor(band * length) / length * np.arange(length))
            assert band_statistics(wave)[at] == pytest.approx(1)


def test_white_noise_is_spread_over_bands_by_their_width():
    """Mean of 400 profiles of 400 white numbers; each fraction to 4 standard errors (1e-4 two-sided; seed 1)."""
    random = make_generator("white bands", 1)
    found = np.array([band_statistics(random.standard_normal(400)) for _ in range(400)])
    number = np.diff([0, *(np.floor(np.array(BANDS) * 400 + 1e-9))])
    number[-1] -= 0.5  # the highest frequency is in the spectrum once, all others twice
    error = found.std(axis=0) / np.sqrt(len(found))
    assert (np.abs(found.mean(axis=0) - number / number.sum()) < 4 * error).all()


def test_legendre_fits_hold_the_polynomials_they_are_made_for():
    place = np.linspace(-1, 1, 500)
    assert legendre_fractions(3 * place) == pytest.approx((1, 1, 1))
    assert legendre_fractions(place**2) == pytest.approx((0, 1, 1), abs=1e-10)
    quartic = np.polynomial.legendre.Legendre([0, 0, 0, 0, 1])(place)
    assert legendre_fractions(quartic) == pytest.approx((0, 0, 1), abs=0.01)


def test_tails_and_neighbours_of_a_white_rest_are_found():
    """250 × 400 normal numbers have kurtosis 3, robust rms = rms, and no correlation, to 4 standard errors (seed 3).

    Then 50 pixels are set to 7 rms and 20 to 30 rms, and each pixel is mixed with its neighbour.
    """
    random = make_generator("white rest", 3)
    noise = 0.02 * random.standard_normal((250, 400))
    found = pattern_figures(1 + noise)
    assert found["white_kurtosis"] == pytest.approx(3, abs=4 * np.sqrt(24 / noise.size))
    assert found["white_robust_rms"] == pytest.approx(0.02, rel=4 * 1.17 / np.sqrt(noise.size))
    assert abs(found["neighbour_correlation"]) < 4 / np.sqrt(noise.size)
    assert found["beyond_10"] == 0
    assert found["beyond_5"] < 1e-4
    chosen = random.permutation(noise.size)
    noise.ravel()[chosen[:50]] = 0.14
    noise.ravel()[chosen[50:70]] = -0.6
    found = pattern_figures(1 + noise)
    assert (found["beyond_5"], found["beyond_10"]) == (70 / noise.size, 20 / noise.size)
    mixed = random.standard_normal((250, 401))
    mixed = mixed[:, 1:] + 0.3 * mixed[:, :-1]
    expected = 0.3 / (1 + 0.3**2)
    assert pattern_figures(1 + 0.02 * mixed)["neighbour_correlation"] == pytest.approx(expected, abs=4 / np.sqrt(1e5))


def test_the_dark_is_that_of_a_log_normal_with_hot_pixels():
    """250 × 400 rates; sd of ln and hot fraction to 4 standard errors (seed 2)."""
    rates = 0.004 * np.exp(0.4 * make_generator("dark", 2).standard_normal((250, 400)))
    tail = stats.norm.sf(np.log(4) / 0.4)
    found = dark_figures(rates)
    assert found["mean"] == pytest.approx(rates.mean())
    assert found["log_sd"] == pytest.approx(0.4, rel=4 / np.sqrt(2e5))
    assert found["hot_fraction"] == pytest.approx(tail, abs=4 * np.sqrt(tail / 1e5))


@pytest.fixture
def recorded(tmp_path):
    """Write spikes as a stream, and return what is measured of it."""

    def measure(spikes):
        write_stream(tmp_path / "spikes.h5", spikes)
        with open_recording(tmp_path / "spikes.h5") as recording:
            return measure_spikes(recording)

    return measure


def test_figures_of_a_stream_are_those_of_a_slow_reference(recorded):
    """Independent spikes whose rate rises from pixel to pixel; the first pixel never fires."""
    frames, shape = 4517, (6, 9)
    random = make_generator("spike statistics").random((frames, *shape))
    spikes = (random < 0.06 * np.arange(54).reshape(shape) / 20).astype(np.uint8)
    found, trains = stream_figures(spikes, recorded(spikes)), spikes.reshape(frames, -1)
    cv2, change = [], []
    for train in trains.T:
        for first, second in pairwise(np.diff(np.flatnonzero(train)).tolist()):
            cv2.append(2 * abs(second - first) / (first + second))
            if 20 <= first <= 30 and 20 <= second <= 30:
                change.append(abs(second - first))
    assert found["rate"] == pytest.approx(spikes.mean())
    assert found["cv2"] == pytest.approx(np.mean(cv2))
    assert found["interval_change"] == pytest.approx(np.mean(change))
    for window in (10, 20, 50):
        whole = trains[: frames // window * window].reshape(-1, window, 54).sum(axis=1)
        assert found[f"fano_{window}"] == pytest.approx(whole.var(axis=0, ddof=1).mean() / whole.mean())


@pytest.mark.slow
def test_a_spread_that_is_planted_between_halves_is_found(recorded):
    """Rates of 10,000 pixels differ between halves by 5 % rms of the mean: 3.54 % per half, to 3 %, four sd (seed 5).

    Trains are regular with 1/rate readouts; discrete readouts add about 1/(2·interval·number), or 0.1 %.
    """
    random = make_generator("halves", 5)
    shape, half = (80, 125), 500
    second = 0.1 * (1 + 0.05 * random.standard_normal(shape))
    phase = random.random(shape)
    t = np.arange(2 * half + 1)[:, None, None]
    grown = 0.1 * t + (second - 0.1) * np.maximum(t - half, 0)
    found = rms_between_halves(recorded(np.diff(np.floor(grown + phase), axis=0).astype(np.uint8)))
    assert found == pytest.approx(0.05 / np.sqrt(2), rel=0.03)


@pytest.mark.slow
def test_published_figures_stand_beside_those_of_a_sensor(monkeypatch, capsys):
    """The array is small, so only the kinds of figures and the rate of the stream are compared."""
    monkeypatch.setattr("studies.published_sensors.DARK_FRAMES", 4000)
    small = str(HERE / "small_sensor.yaml")
    real, ours = published_statistics()[0], as_published(get_sensor(small))
    assert list(ours) == list(real)
    assert ours["stream.rate"] == pytest.approx(real["stream.rate"], rel=0.03)
    monkeypatch.setattr("sys.argv", ["published_sensors", small])
    main()
    head, _, *rows = capsys.readouterr().out.splitlines()
    assert small in head
    assert rows[0].startswith("| flat: rms of the response | 5.64 % | ")
    assert len(rows) == len(real) + 3
    assert "SpikeNeRF" in rows[-3]


def test_a_rate_that_a_sensor_cannot_reach_is_refused():
    vidar = get_sensor("vidar_400x250")
    for rate in (0.95, 0.004):
        assert_says(refusal(mean_light, vidar, rate), f"the rate is {rate} | above the dark rate 0.0045")
