"""The Wiener filter of a known blur, how its number is learned, and the command that prints its PSNR."""

import shutil

import numpy as np
import pytest
from scipy.special import j1

from studies.learned import deblur

FREQUENCY = 1 / 8


def wave(phase=0.0):
    return 1 + 0.5 * np.cos(2 * np.pi * FREQUENCY * np.arange(64) + phase)[None].repeat(48, axis=0)


def disc_transfer(blur_px):
    argument = np.pi * blur_px * FREQUENCY
    return 2 * j1(argument) / argument


def test_a_wave_that_a_disc_blurred_gets_its_contrast_back_where_there_is_no_noise():
    blurred = 1 + (wave() - 1) * disc_transfer(4.0)
    found = deblur.sharpened(blurred, 4.0, ratio=1e-2)
    inner = slice(16, -16), slice(20, -20)
    assert np.ptp(found[inner]) == pytest.approx(1, abs=0.06)
    assert found[inner] == pytest.approx(wave()[inner], abs=0.06)


def test_with_all_noise_it_is_the_matched_filter_and_the_mean_stays():
    found = deblur.sharpened(wave(), 4.0, ratio=1e9)
    inner = slice(12, -12), slice(16, -16)
    assert found[inner].mean() == pytest.approx(1, abs=0.01)
    assert np.ptp(found[inner]) == pytest.approx(abs(disc_transfer(4.0)), abs=0.02)


def test_psnr_is_that_of_a_known_error_and_does_not_see_the_exposure():
    box = slice(0, 48), slice(0, 64)
    noise = np.random.default_rng(3).normal(0, 0.01, (48, 64))
    window = deblur.Window(wave(), wave(), box, 4.0)
    assert deblur.psnr(7 * (wave() + noise), window) == pytest.approx(20 * np.log10(1.5 / 0.01), abs=0.3)


def test_the_number_that_is_learned_grows_with_the_noise():
    random, box = np.random.default_rng(5), (slice(0, 48), slice(0, 64))
    sharp = np.repeat(np.repeat(random.random((6, 8)), 8, axis=0), 8, axis=1) + 0.5

    def learned(noise):
        spread = np.fft.irfft2(np.fft.rfft2(sharp) * _transfer(sharp.shape, 4.0), sharp.shape) + random.normal(
            0, noise, sharp.shape
        )
        return deblur.learn_ratio([deblur.Window(spread, sharp, box, 4.0)])

    assert learned(0.002) < learned(0.1)


def _transfer(shape, blur_px):
    along = np.pi * blur_px * np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    return np.where(along > 0, 2 * j1(along) / np.where(along > 0, along, 1), 1.0)


@pytest.mark.slow
def test_the_command_prints_the_psnr_of_both_pictures(captured_dataset, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SAF_GEN_SCENES", str(captured_dataset.parent / "scenes"))
    dataset = tmp_path / "takes"
    shutil.copytree(captured_dataset, dataset)
    assert deblur.main([str(dataset), "--train", "test"]) == 0
    head, _, _, *rows = capsys.readouterr().out.strip().splitlines()
    assert head.startswith("ratio of noise to picture, learned on test: ")
    _, count, before, after = (cell.strip() for cell in rows[-1].strip("|").split("|"))
    assert int(count) > 0
    assert float(after) >= float(before) - 0.1


@pytest.mark.slow
def test_what_is_not_there_is_refused_in_one_line(captured_dataset, tmp_path, capsys):
    for dataset, says in ((captured_dataset, "unknown split 'train'"), (tmp_path, "manifest.json")):
        assert deblur.main([str(dataset)]) == 2
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        assert says in err
