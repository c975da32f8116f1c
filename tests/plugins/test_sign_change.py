"""ELP as a search: Laplacian times change is the growth of a squared gradient, whose sign stops a sweep."""

from collections import deque

import numpy as np
import pytest
from lit_sweep import Sweep
from scipy.ndimage import correlate

from saf_gen import get_measure, get_search
from saf_gen.core.seeds import make_generator

SOBEL = np.outer([1, 2, 1], [-1, 0, 1])


def bell(focus, *, frames=4000, width=300.0):
    return np.exp(-((np.arange(frames) - focus) ** 2) / (2 * width**2))


def test_the_laplacian_times_the_change_is_the_growth_of_the_squared_gradient():
    """−Σ ∇²(A + B)·(B − A) = Σ|∇B|² − Σ|∇A|², with ∇² = −GᵀG, on periodic pictures."""
    first, second = make_generator("test_sign_change").integers(0, 40, (2, 24, 30)).astype(float)

    def gradients(c):
        return [correlate(c, kernel, mode="wrap") for kernel in (SOBEL, SOBEL.T)]

    def laplacian(c):
        kernels = zip(gradients(c), (SOBEL, SOBEL.T), strict=True)
        return -sum(correlate(g, kernel[::-1, ::-1], mode="wrap") for g, kernel in kernels)

    energy = [sum((g**2).sum() for g in gradients(c)) for c in (first, second)]
    assert -(laplacian(first + second) * (second - first)).sum() == pytest.approx(energy[1] - energy[0])
    inside = [sum(g[1:-1, 1:-1] ** 2 for g in gradients(c)) for c in (first, second)]
    tenengrad = get_measure("tenengrad")
    assert [tenengrad(c) for c in (first, second)] == pytest.approx([i.mean() for i in inside])


@pytest.mark.parametrize("focus", [1000, 2030, 3100])
def test_it_stops_within_two_blocks_of_the_focus_and_answers_between(focus):
    view = Sweep(bell(focus))
    answer = get_search("sign_change")(view)
    assert answer.frame == pytest.approx(focus, abs=10)
    assert focus < view.now <= focus + 200
    assert answer.trace[0] < answer.frame <= answer.trace[1]


def test_noise_alone_is_no_answer_and_a_peak_in_noise_is_found():
    """2 % of sweeps of noise stop by chance; more than 4 of 40 do with probability 0.001 (one sample, fixed seed)."""
    random = make_generator("test_sign_change", "noise")
    stopped = sum(get_search("sign_change")(Sweep(random.normal(0, 1, 4000))).frame is not None for _ in range(40))
    assert stopped <= 4
    noisy = bell(2500) + random.normal(0, 0.02, 4000)
    assert get_search("sign_change")(Sweep(noisy)).frame == pytest.approx(2500, abs=60)


def test_a_small_fluctuation_is_smoothed_and_a_jump_is_kept():
    search = get_search("sign_change", past=3, near=0.5)
    before, growths = deque([2.0, 2.0, 2.0], maxlen=3), [4.0]
    assert search._smooth(3.0, before=before, growths=growths) == pytest.approx(2.25)
    assert list(before) == [2.0, 2.0, 3.0]
    assert search._smooth(-4.0, before=before, growths=growths) == -4.0
