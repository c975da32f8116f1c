"""The quotient of octaves, its witness, and the search in which both must agree."""

import numpy as np
import pytest
from lit_sweep import Sweep

from saf_gen import get_measure, get_search
from saf_gen.core.seeds import make_generator
from saf_gen.errors import BadInput
from saf_gen.plugins.searches._light_windows import LightWindow
from saf_gen.plugins.searches.agreed_peak import blocks_prefer, scatter, skew_top

quotient, split = get_measure("octave_quotient"), get_measure("split_gradient")


def structure_by_pixel(c, apart):
    """S(l): the mean squared difference of pixels that far apart, along rows plus along columns."""
    c = np.asarray(c, dtype=float).tolist()
    rows, cols = len(c), len(c[0])
    down = [(c[i + apart][j] - c[i][j]) ** 2 for i in range(rows - apart) for j in range(cols)]
    across = [(c[i][j + apart] - c[i][j]) ** 2 for i in range(rows) for j in range(cols - apart)]
    return sum(down) / len(down) + sum(across) / len(across)


@pytest.mark.slow
def test_the_quotient_equals_its_slow_twin():
    counts = make_generator("test_agreed_peak").integers(0, 30, (21, 34)).cumsum(axis=1)
    s = [structure_by_pixel(counts, apart) for apart in (1, 2, 4, 8, 16)]
    d = np.diff(s)
    assert quotient(counts) == pytest.approx((d[0] + d[1] / 2) / (d.sum() + 4 * s[0] / 714**0.5), rel=1e-12)


def test_the_quotient_of_an_edge_by_hand():
    """An edge of height 1 across 32 × 32 pixels: S(l) = l/(32 − l) for l up to 16, along one axis."""
    edge = np.repeat([[0] * 16 + [1] * 16], 32, axis=0)
    s = [apart / (32 - apart) for apart in (1, 2, 4, 8, 16)]
    expected = (s[1] - s[0] + (s[2] - s[1]) / 2) / (s[4] - s[0] + 4 * s[0] / 32)
    assert quotient(edge) == pytest.approx(expected, rel=1e-12)


def test_gain_of_light_dark_spikes_and_white_noise_hardly_change_the_quotient():
    """Cumulated steps have all octaves; white noise of their own rms difference moves the quotient by under 10 %."""
    random = make_generator("test_agreed_peak", "noise")
    picture = random.integers(-3, 4, (128, 128)).cumsum(axis=0).cumsum(axis=1) // 4 + 4000
    assert quotient(3 * picture) == quotient(picture + 500) == quotient(picture)
    assert quotient(picture + random.integers(-4, 5, picture.shape)) == pytest.approx(quotient(picture), rel=0.1)
    assert quotient(random.poisson(12, (128, 128))) < 0.5


def test_the_split_gradient_equals_its_slow_twin_and_drops_noise():
    random = make_generator("test_agreed_peak", "split")
    a, b = random.integers(1, 30, (2, 9, 14))
    total = sum(np.mean(np.diff(a, axis=axis) * np.diff(b, axis=axis)) for axis in (0, 1))
    assert split(np.stack([a, b])) == pytest.approx((total + 4 / 12) / (a.mean() * b.mean()), rel=1e-12)
    noise = random.poisson(30, (2, 128, 128))
    assert abs(split(noise)) < 0.1 * get_measure("squared_gradient")(noise[0]) / 900


@pytest.mark.slow
def test_the_split_gradient_falls_with_blur_where_the_quotient_is_blind():
    """A stripe of period 4 px has D₁ = A, D₂ = −2A: the quotient is the same, sharp or blurred."""
    stripe = np.sin(np.pi / 2 * (np.arange(64) + 0.5))
    sharp, blurred = (np.round(1000 * (1 + height * stripe) * np.ones((64, 1))) for height in (0.5, 0.1))
    assert quotient(sharp) == pytest.approx(quotient(blurred), rel=1e-9)
    assert split(np.stack([sharp, sharp])) > 20 * split(np.stack([blurred, blurred]))


@pytest.mark.parametrize("skew", [0.0, 0.5])
@pytest.mark.parametrize("at", [4.3, 20.0, 33.6])
def test_the_top_of_a_skew_curve_is_found(at, skew):
    x = np.arange(40.0)
    width = np.where(x > at, 5 * (1 + skew), 5)
    assert skew_top(x, 1 / (1 + ((x - at) / width) ** 2), above=0.6) == pytest.approx(at, abs=0.1 + skew)


def test_the_scatter_is_that_of_windows_that_share_no_frame():
    """400 scores of unit noise in windows two steps long; 3 sd of the median of 396 is 12 %. A slope adds nothing."""
    noise = make_generator("test_agreed_peak", "scatter").normal(size=400)
    windows = [LightWindow(10 * k, 10 * k + 20, 6.0, 2) for k in range(400)]
    assert scatter(list(noise + np.arange(400.0)), windows) == pytest.approx(1, abs=0.15)
    assert scatter([1.0, 2.0], windows[:2]) == np.inf


def bell(lens, *, at, width, height):
    return height / (1 + ((lens - at) / width) ** 2)


class Witnessed(Sweep):
    """A sweep whose witness has a curve of its own, and whose blocks are as sharp as that curve."""

    def __init__(self, curve, witness, **options):
        super().__init__(curve, **options)
        self.witness = self.named["split_gradient"] = witness

    def counts(self, first, stop):
        self.now = max(self.now, stop)
        board = np.where(np.indices((32, 32)).sum(axis=0) % 2, 1.0, -1.0)
        contrast = np.sqrt(self.witness[first:stop].mean())
        return np.round(1000 * (1 + 0.5 * contrast * board)).astype(np.uint32)


def witnessed(at, witness_at, *, frames=4000, noise=0.01, **options):
    lens = np.linspace(0, 1, frames)
    curve = 0.05 + bell(lens, at=at, width=0.1, height=0.25)
    return Witnessed(curve, bell(lens, at=witness_at, width=0.04, height=0.5), noise=noise, **options)


@pytest.mark.parametrize("at", [0.2, 0.5, 0.8])
def test_it_finds_the_focus_and_stops_behind_it(at):
    """Noise of 1 % in windows of six spikes per pixel, seeded by the window."""
    view = witnessed(at, at)
    answer = get_search("agreed_peak")(view)
    assert answer.frame == pytest.approx(4000 * at, abs=60)
    assert 4000 * at < view.now < 4000 * at + 900


def test_the_witness_answers_if_its_peak_is_clear_and_elsewhere():
    view = witnessed(0.7, 0.4)
    answer = get_search("agreed_peak")(view)
    assert answer.frame == pytest.approx(1600, abs=60)
    assert answer.note.endswith("by split_gradient")
    low = witnessed(0.7, 0.4)
    low.named["split_gradient"] = 0.3 + 0.5 * low.witness  # not four times its median
    assert get_search("agreed_peak")(low).frame == pytest.approx(2800, abs=80)


@pytest.mark.parametrize("at", [-0.4, 1.5])
def test_a_focus_outside_the_sweep_has_no_answer(at):
    assert get_search("agreed_peak")(witnessed(at, at)).frame is None


@pytest.mark.parametrize(("frames", "light"), [(300, 0.3), (120, 0.6), (80, 1.0)])
def test_short_recordings_are_not_refused(frames, light):
    view = witnessed(0.5, 0.5, frames=frames, light=np.full(frames, light))
    assert get_search("agreed_peak")(view).frame == pytest.approx(frames / 2, abs=0.08 * frames)


def test_a_dark_recording_has_no_answer_and_no_frames_are_refused_in_one_line():
    view = witnessed(0.5, 0.5, light=np.full(4000, 1e-4))
    assert get_search("agreed_peak")(view).note == "too dark"
    with pytest.raises(BadInput, match="at least 2 frames"):
        get_search("agreed_peak")(witnessed(0.5, 0.5, frames=1))


class Halves:
    """A view whose pictures are sharp on the left before frame 10, and on the right after it."""

    def __init__(self, left):
        self.left = left  # columns of 64

    def counts(self, first, stop):
        board = np.where(np.indices((64, 64)).sum(axis=0) % 2, 150, 50)
        sharp_left = np.arange(64) < self.left
        return np.where(sharp_left == (stop <= 10), board, 100)


@pytest.mark.parametrize(("left", "passed"), [(16, False), (48, True), (64, True)])
def test_blocks_vote_whether_the_target_has_passed(left, passed):
    windows = [LightWindow(0, 10, 6.0, 1), LightWindow(20, 30, 6.0, 1)]
    assert blocks_prefer(Halves(left), windows[0], over=windows[1], least=0.25) is passed
    assert blocks_prefer(Halves(left), windows[0], over=windows[1], least=1.0) is (left == 64)
