"""The hard scenes: exact blur, patterns of the stated period, known focus, and the boxes of a real stack."""

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from saf_gen.core.seeds import make_generator
from studies.ranking import adversarial
from studies.ranking.adversarial import SCENES, SIZE, blurred, disc, halftone, make, real_sweeps, run, skew


def test_a_disc_has_its_first_zero_where_theory_puts_it_and_keeps_the_light():
    """A disc 16 px wide has no contrast at 1.2197/16 cycles per pixel; the sign turns there."""
    along = disc(16.0)[0]
    before = int(np.floor(1.2197 / 16 * SIZE))
    assert along[0] == 1.0
    assert along[before] > 0 > along[before + 1]
    assert np.array_equal(disc(-16.0), disc(16.0))
    assert (skew(8.0) != skew(-8.0)).any()


def test_pictures_keep_their_light_and_are_sharp_at_the_focus():
    texture = halftone(make_generator("test_adversarial"), 4)
    pictures = blurred(texture, 0.5)
    assert pictures.mean(axis=(1, 2)) == pytest.approx(np.full(len(pictures), texture.mean()), rel=1e-2)
    assert pictures[48] == pytest.approx(texture, abs=1e-9)
    assert pictures.var(axis=(1, 2)).argmax() == 48


@pytest.mark.parametrize("period", [4, 8])
def test_a_halftone_has_the_stated_period(period):
    spectrum = np.abs(np.fft.rfft2(halftone(make_generator("test_adversarial", period), period)))
    spectrum[:4, :4] = spectrum[-3:, :4] = 0  # the tone
    assert {SIZE // period, 0} == set(np.unravel_index(spectrum.argmax(), spectrum.shape))


@pytest.mark.slow
def test_every_scene_states_its_focus_and_one_is_found():
    for name in SCENES:
        sweep = make(name, 0)
        assert 0 < sweep.truth < 1, name
        assert sweep.pictures.min() >= 0, name
    [error] = run(make("short (300 frames)", 0), ["sd_code+egs_code"])
    assert abs(error) < 1


def test_boxes_of_a_stack_state_the_picture_that_is_sharpest(tmp_path):
    """Pictures of 16 bits by Pillow: a texture under Gaussian blur that is least in picture 5 of 0 to 11."""
    texture = make_generator("test_adversarial", "stack").uniform(0, 1, (SIZE, 2 * SIZE))
    for k in range(12):
        picture = 20_000 * (0.5 + gaussian_filter(texture, 0.8 + 0.4 * abs(k - 5), mode="wrap"))
        Image.fromarray(picture.astype(np.uint16)).save(tmp_path / f"{k:02d}.png")
    found = real_sweeps(tmp_path)
    assert [sweep.pictures.shape for sweep in found] == [(12, SIZE, SIZE)] * 2
    assert [sweep.truth * 11 for sweep in found] == pytest.approx([5, 5], abs=0.1)
    assert len(adversarial.table({"a": [[0.2, np.nan]] * 2}, ["m", "n"]).splitlines()) == 3
