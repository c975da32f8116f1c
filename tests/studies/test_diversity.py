"""The features by which members of a grammar are compared with scenes made by hand."""

import numpy as np
import pytest

from studies.ranking.diversity import FEATURES, Row, draw_sheet, report, spectral_slope

PICTURE = np.ones((8, 8), dtype=np.float32)


@pytest.mark.parametrize("exponent", [-1.0, -2.0, -3.0])
def test_the_slope_of_a_texture_of_known_power_is_found(exponent):
    random, n = np.random.default_rng(3), 128
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(n), np.fft.fftfreq(n)))
    frequency[0, 0] = 1 / n
    picture = np.fft.ifft2(np.fft.fft2(random.standard_normal((n, n))) * frequency ** (exponent / 2)).real
    assert spectral_slope(5 + picture) == pytest.approx(exponent, abs=0.3)


def test_a_scene_beyond_the_middle_of_the_members_is_named_with_the_feature(tmp_path):
    members = [Row(f"m{n}", dict.fromkeys(FEATURES, float(n)), 1.0, PICTURE) for n in range(101)]
    inside = Row("inside", dict.fromkeys(FEATURES, 50.0), 1.0, PICTURE)
    text = report(members, [inside, Row("beyond", inside.features | {"peak": 99.0}, 1.0, PICTURE)])
    assert "| `inside` | 50 | 50 | 50 | 50 | 50 | – |" in text
    assert "| `beyond` | 50 | 50 | 50 | 50 | 99 | peak |" in text
    draw_sheet(members[:3], tmp_path / "sheet.png", across=2)
    assert (tmp_path / "sheet.png").stat().st_size > 1000
