"""``sensors fit``: its files and output, bounds from one recording, and errors."""

import json
import math
import re

import numpy as np
import pytest
import synthetic_cameras as cameras

from saf_gen import write_stream
from saf_gen.addons.calibrate import fit_files
from saf_gen.addons.calibrate.bounds import noise_bounds
from saf_gen.addons.calibrate.estimates import Estimate
from saf_gen.addons.calibrate.fit_files import fitted_interval, fitted_number
from saf_gen.addons.calibrate.recordings import open_recording
from saf_gen.addons.calibrate.spike_statistics import measure_spikes
from saf_gen.camera import get_sensor
from saf_gen.cli import main
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import StreamWriter
from studies.published_sensors import EncodedRecording, mean_light, stream_figures

pytestmark = pytest.mark.usefixtures("readable_figures")

CAMERA = get_sensor("vidar_400x250", threshold_noise_rms=0.02, reset_loss=0.01)
SHAPE = (24, 40)


def write(path, recording):
    with StreamWriter(path, shape=recording.shape, readout_hz=recording.readout_hz) as stream:
        for block in recording.blocks():
            stream.write(block)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    for name, rate in (("dim", 0.1), ("bright", 0.4)):
        write(folder / f"{name}.h5", cameras.flat(CAMERA, rate, shape=SHAPE, frames=3000))
    write_stream(folder / "few.h5", np.zeros((100, 8, 8), np.uint8))
    write(folder / "dark.h5", cameras.dark(CAMERA, shape=SHAPE, frames=8000))
    return folder


@pytest.fixture(scope="module")
def without_theta(recordings, tmp_path_factory):
    """The folder of a fit of a sensor "free" without --threshold-e, whose page has plots."""
    folder = tmp_path_factory.mktemp("free")
    command = ["sensors", "fit", "dim.h5", "bright.h5", "--dark", "dark.h5", "--name", "free", "--out", folder]
    with pytest.raises(SystemExit) as ended:
        main([str(recordings / word) if str(word).endswith(".h5") else str(word) for word in command])
    assert ended.value.code == 0
    return folder


@pytest.fixture
def fit(recordings, call, tmp_path):
    def run(*names, **options):
        words = [word for key, value in options.items() for word in (f"--{key.replace('_', '-')}", value)]
        return call("sensors", "fit", *(recordings / n for n in names), "--out", tmp_path / "out", *words)

    return run


@pytest.mark.slow
def test_a_fit_writes_a_sensor_that_is_read_and_a_page(fit, recordings, tmp_path, monkeypatch):
    """The sensor file is valid, marks measured and assumed values, and agrees with the JSON file.

    The page is written without plots, which are slow and tested below.
    """
    monkeypatch.setattr(fit_files, "draw_fit", lambda found: [])
    code, shown, _ = fit("dim.h5", "bright.h5", dark=recordings / "dark.h5", name="mine", threshold_e=29900)
    assert code == 0
    sensor = get_sensor(tmp_path / "out/mine.yaml")
    text = (tmp_path / "out/mine.yaml").read_text()
    found = json.loads((tmp_path / "out/mine.json").read_text())["estimates"]
    for key in ("dark_rate", "threshold_noise_rms", "response_column_rms"):
        assert found[key]["low"] <= found[key]["value"] <= found[key]["high"]
        assert getattr(sensor, key) == pytest.approx(found[key]["value"], rel=0.01)
        assert re.search(rf"^{key}: \S+  # 95 % ", text, re.MULTILINE)
    assert found["threshold_noise_rms"]["low"] < 0.02 * 1.02
    assert re.search(r"^pitch_m: \S+  # assumed", text, re.MULTILINE)
    assert re.search(r"^threshold_e: 29900  # given", text, re.MULTILINE)
    assert re.search(r"^threshold_spread_rms: \S+  # not determined; at most ", text, re.MULTILINE)
    assert "rates cannot separate white response from threshold spread" in shown
    assert "dark_rate" in shown
    noise, dark, uneven, against, unknown = shown.splitlines()[:5]
    truth = 100 * math.sqrt(1 / CAMERA.threshold_e + CAMERA.threshold_noise_rms**2)
    value, low, high = map(float, re.findall(r"([\d.]+)%", noise))
    assert low <= truth * 1.02
    assert high >= truth * 0.98
    assert value == pytest.approx(truth, rel=0.1)
    rate, _ = re.findall(r"[\d.]+", dark)
    assert float(rate) == pytest.approx(found["dark_rate"]["value"] * 20_000, rel=0.01)
    assert 3 < float(re.search(r"([\d.]+)% rms", uneven)[1]) < 9  # 5.6 % by the card of the camera
    assert re.match(r"against vidar_400x250: 2\.[3-6] × its noise, (0\.9|1)\d* × its dark rate; \d", against)
    assert unknown.endswith("taken from vidar_400x250: pitch, quantum efficiency, fill factor, wavelength")
    assert "dark_rate" in (tmp_path / "out/mine.html").read_text()


@pytest.mark.slow
def test_the_page_stands_alone_and_has_a_plot_of_each_kind(without_theta):
    """It has no external address and no id twice, and as many drawings as captions."""
    page = (without_theta / "free.html").read_text()
    assert page.count("<svg") == page.count("<figcaption") == 7
    assert not re.search(r'(src|href)="https?://', page)
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    used = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', page))
    assert used <= set(ids)
    for word in ("<h2>Notes</h2>", "interval_noise", "Linearity", "dim.h5"):
        assert word in page


@pytest.mark.slow
def test_a_fitted_sensor_has_the_statistics_of_the_camera(without_theta, recordings):
    """The fitted sensor, in even light of the recording's rate, has its CV2 and Fano factor to 15 %."""
    fitted = get_sensor(without_theta / "free.yaml")
    with open_recording(recordings / "dim.h5") as real:
        measured = measure_spikes(real)
        light = np.full((1, *real.shape[1:]), mean_light(fitted, measured.mean_rate), np.float32)
        again = EncodedRecording("again", fitted, light, frames=real.shape[0], seed=1)
        there, here = (
            stream_figures(
                np.unpackbits(np.concatenate(list(one.blocks()), axis=2), axis=2, bitorder="little").transpose(2, 0, 1),
                measured,
            )
            for one in (real, again)
        )
    assert here["cv2"] == pytest.approx(there["cv2"], rel=0.15)
    assert here["fano_50"] == pytest.approx(there["fano_50"], rel=0.15)


def test_one_recording_gives_bounds_and_no_file(fit, tmp_path):
    code, shown, _ = fit("bright.h5")
    assert code == 0
    assert "threshold_noise_rms" in shown
    assert "at most" in shown
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize("name", ["mine.yaml", "mine-mask.npy"])
def test_a_file_of_the_user_is_not_replaced_by_a_fit(fit, recordings, tmp_path, name):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text("mine")
    code, _, err = fit("bright.h5", dark=recordings / "dark.h5", name="mine")
    assert (code, "saf-gen did not write it" in err) == (2, True)
    assert [path.name for path in (tmp_path / "out").iterdir()] == [name]
    assert (tmp_path / "out" / name).read_text() == "mine"


def test_a_fit_into_a_link_is_refused(fit, tmp_path):
    (tmp_path / "out").symlink_to(tmp_path / "target")
    code, _, err = fit("bright.h5", name="mine")
    assert (code, "is a symbolic link" in err) == (2, True)
    assert not (tmp_path / "target").exists()


@pytest.mark.slow
@pytest.mark.parametrize("moving", [False, True])
def test_bounds_hold_whatever_the_light_does(moving):
    """Bounds from a still and a flickering picture are above the true values of three cameras of 40 × 64 pixels."""
    for seed in range(3):
        camera = cameras.draw_camera(seed)
        ramp = np.broadcast_to(np.linspace(0.3, 1.7, 64), (40, 64))
        light = 1 + 0.1 * np.sin(np.arange(4000) / 300) if moving else np.ones(4000)
        shown = measure_spikes(cameras.flat(camera, 0.2, shape=(40, 64), frames=4000, picture=ramp, light=light))
        bounds, truth = noise_bounds(shown), cameras.true_numbers(camera)
        for key in ("interval_noise", "threshold_noise_rms", "white_and_threshold_rms", "dark_rate"):
            assert bounds[key].high > 0.97 * truth[key], (seed, key)
        if not moving:
            assert bounds["interval_noise"].high < 2 * truth["interval_noise"]


@pytest.mark.parametrize(
    ("names", "options", "words"),
    [
        (("dim.h5", "bright.h5"), {}, "no dark recording | --dark FILE | one recording alone gives bounds"),
        (("dim.h5",), {"dark": "missing.h5"}, "missing.h5"),
        (("dim.h5",), {"name": "a/b"}, "--name is 'a/b'"),
        (("dim.h5",), {"threshold_e": 3}, "--threshold-e is 3 | at least 25"),
        (("dim.h5",), {"base": "vidr"}, "unknown sensor 'vidr'"),
        (("few.h5",), {}, "fire 16 times or more"),
    ],
)
def test_what_cannot_be_fitted_is_refused_in_one_line(names, options, words, fit):
    code, _, err = fit(*names, **options)
    assert code == 2
    assert all(word in err.splitlines()[-1] for word in words.split(" | "))


@pytest.mark.parametrize(
    ("value", "width", "text"),
    [(0.0123456, 0.001, "0.0123"), (29_900.0, None, "29900"), (0.0, 1.0, "0"), (2.5e-5, 1e-6, "2.5e-05")],
)
def test_a_number_has_the_digits_that_its_interval_leaves(value, width, text):
    assert fitted_number(value, width) == text
    assert fitted_interval(Estimate(1.0, 0.5, np.inf, "")) == "at least 0.5"


@pytest.mark.slow
def test_a_fit_writes_a_mask_of_planted_pixels_that_import_takes(recordings, fit, call, tmp_path, monkeypatch):
    monkeypatch.setattr(fit_files, "draw_fit", lambda found: [])
    planted = np.zeros(SHAPE, bool)
    for name in ("dim", "bright", "dark"):
        with open_stream(recordings / f"{name}.h5") as stream:
            spikes = stream.frames(0, stream.shape[0])
        for (y, x), value in {(0, 0): 0, (5, 7): 0, (12, 30): 1, (23, 39): 1}.items():
            spikes[:, y, x] = value
            planted[y, x] = True
        write_stream(tmp_path / f"{name}.h5", spikes)
    mask = tmp_path / "out/mine-mask.npy"
    code, shown, _ = fit(
        *(tmp_path / f"{name}.h5" for name in ("dim", "bright")), dark=tmp_path / "dark.h5", name="mine"
    )
    assert code == 0
    assert "bad pixels: 2 never fire, 2 fire in the dark" in shown
    assert str(mask) in shown
    np.testing.assert_array_equal(np.load(mask), planted)
    np.save(tmp_path / "a.npy", spikes[:800])
    code, shown, _ = call("import", tmp_path / "a.npy", "--axes", "TYX", "--out", tmp_path / "a.h5", "--mask", mask)
    assert code == 0
    assert "mask: 4 bad pixels, filled in counts and pictures" in shown
    assert fit(*("dim.h5", "bright.h5"), dark=recordings / "dark.h5", name="mine")[0] == 0
    assert not mask.exists()
