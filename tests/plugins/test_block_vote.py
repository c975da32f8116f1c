"""Blocks of the picture that vote on the focus with equal weight, whatever their contrast."""

import numpy as np
import pytest
from refusals import refusal
from scipy.ndimage import gaussian_filter

from saf_gen import get_measure, get_search
from saf_gen.benchmark.conformance import check_search
from saf_gen.core.seeds import make_generator
from saf_gen.plugins.searches.block_vote import block_scores, scaled, vertex

FRAMES, SHAPE = 2000, (40, 48)


class Drawn:
    """A view of a sweep over parts of a picture that are sharp at frames of their own.

    ``parts`` are (columns, frame, contrast) of each; ``light`` is the gain in each frame, times 0.2 spikes per readout.
    Pixels integrate without noise, from random phases.
    """

    frames, readout_hz, lag_s, now = FRAMES, 20_000.0, 0.0, FRAMES

    def __init__(self, *parts, light=1.0, measure="vollath_f4_n", seed=0):
        random = make_generator("test_block_vote", seed)
        texture, t = gaussian_filter(random.normal(size=SHAPE), 1.0), np.arange(FRAMES)
        texture = np.clip(texture / (2 * texture.std()), -1, 1)
        self.measure, contrast = get_measure(measure), np.zeros((FRAMES, SHAPE[1]))
        for columns, sharp, most in parts:
            contrast[:, columns] = (most / (1 + ((t - sharp) / 100) ** 2))[:, None]
        gain = 0.2 * np.broadcast_to(light, FRAMES)[:, None, None]
        charge = np.cumsum(gain * (1 + contrast[:, None, :] * texture), axis=0)
        self.total = np.concatenate([np.zeros((1, *SHAPE)), np.floor(charge + random.random(SHAPE))]).astype(np.uint32)

    def counts(self, first, stop):
        return self.total[stop] - self.total[first]

    def score(self, first, stop, measure=None):
        return (get_measure(measure) if measure else self.measure)(self.counts(first, stop))


ALL, LEFT, RIGHT = slice(0, 48), slice(0, 36), slice(36, 48)


def lens(view, **options):
    answer = get_search("block_vote", **options)(view)
    return answer.frame


@pytest.mark.parametrize("at", [500, 1000, 1530])
def test_the_focus_of_a_flat_target_is_found_to_a_step(at):
    assert lens(Drawn((ALL, at, 0.5))) == pytest.approx(at, abs=30)


@pytest.mark.parametrize("seed", range(3))
def test_most_of_the_area_decides_and_not_most_of_the_contrast(seed):
    """A strip on 25 % of the box with 2.7 times the contrast is sharp elsewhere; a measure of the whole follows it."""
    view = Drawn((LEFT, 600, 0.35), (RIGHT, 1400, 0.95), seed=seed)
    assert lens(view) == pytest.approx(600, abs=40)
    assert get_search("argmax", window=100)(view).frame == pytest.approx(1400, abs=100)
    assert lens(view, block=48, own=10.0) == pytest.approx(1400, abs=60), "one block is a measure of the whole"


@pytest.mark.parametrize("last", [0.15, 1.0, 6.0])
def test_light_that_changes_moves_the_answer_by_less_than_two_steps(last):
    light = np.geomspace(1, last, FRAMES)
    assert lens(Drawn((ALL, 900, 0.5), light=np.minimum(light, 2.4))) == pytest.approx(900, abs=50)


both = pytest.mark.parametrize("f4", [True, False])


@both
def test_a_gain_of_all_counts_changes_nothing(f4):
    halves = make_generator("test_block_vote", "gain").integers(1, 50, (2, 30, 41))
    expected = block_scores(*halves, size=10, f4=f4)
    assert block_scores(*(7 * halves), size=10, f4=f4) == pytest.approx(expected, rel=1e-12)


@both
def test_scores_of_blocks_equal_their_slow_twin(f4):
    a, b = make_generator("test_block_vote", "twin").integers(1, 30, (2, 7, 9))
    c = a + b
    fine, laplacian = np.zeros(a.shape), np.zeros(a.shape)
    for i in range(7):
        for j in range(9):
            if f4:
                fine[i, j] += c[i, j] * (c[i + 1, j] - c[i + 2, j]) if i < 5 else 0
                fine[i, j] += c[i, j] * (c[i, j + 1] - c[i, j + 2]) if j < 7 else 0
            else:
                fine[i, j] += (a[i + 1, j] - a[i, j]) * (b[i + 1, j] - b[i, j]) if i < 6 else 0
                fine[i, j] += (a[i, j + 1] - a[i, j]) * (b[i, j + 1] - b[i, j]) if j < 8 else 0
            if 0 < i < 6 and 0 < j < 8:
                one, two = (x[i - 1, j] + x[i + 1, j] + x[i, j - 1] + x[i, j + 1] - 4 * x[i, j] for x in (a, b))
                laplacian[i, j] = one * two
    expected = []
    for rows, columns in ((slice(0, 7), slice(0, 4)), (slice(0, 7), slice(4, 9))):  # 4 pixels wide, one block high
        part = [x[rows, columns].mean() for x in (fine, laplacian, a, b, c)]
        lit = part[2] * part[3]
        expected.append([part[0] / (part[4] ** 2 if f4 else lit), part[1] / lit])
    assert block_scores(a, b, size=4, f4=f4) == pytest.approx(np.array(expected).T, rel=1e-12)


@pytest.mark.parametrize("period", [2, 3, 4, 5, 7])
def test_differences_see_stripes_of_any_period_and_f4_all_but_those_of_three_pixels(period):
    stripes = np.where(np.arange(60) % period < period / 2, 20, 10) * np.ones((60, 1), int)
    assert (block_scores(stripes, stripes, size=10, f4=False) > 0.03).all()
    left = block_scores(stripes, stripes, size=30, f4=True)[0, 0]  # whose pixels have all their neighbours across
    assert (abs(left) < 1e-12) == (period == 3)


def test_f4_sees_no_fixed_pattern_of_independent_pixels_and_differences_do():
    """A pattern of variance 16 about 20 in both halves, 200 × 200 pixels, fixed seed. F4 adds 80,000 products of a sum,
    40 ± 8, and a difference of two of them, 0 ± 8·√2: within five standard errors (significance 6·10⁻⁷).
    """
    pattern = np.round(make_generator("test_block_vote", "fixed").normal(20, 4, (200, 200))).astype(int)
    f4, differences = (block_scores(pattern, pattern, size=200, f4=f4)[0, 0] for f4 in (True, False))
    assert abs(f4) < 5 * (2 * (64 * 128 + 1600 * 128) / 200**2) ** 0.5 / 40**2
    assert differences == pytest.approx(2 * 2 * 16 / 20**2, rel=0.05)


@both
def test_counting_noise_scores_nothing(f4):
    """Poisson counts of mean 20 on 200 × 200 pixels, fixed seed: means of 40,000 sums of two products, of differences
    of variance 2·20 or of a count of 40 and a difference of variance 2·40, and of products of Laplacians of variance
    20·20, within five standard errors (significance 6·10⁻⁷) as if one product in four were independent.
    """
    first, second = make_generator("test_block_vote", "noise").poisson(20, (2, 200, 200))
    fine, laplacian = block_scores(first, second, size=200, f4=f4)[:, 0]
    spread = (2 * (40 * 80 + 40**2 * 80)) ** 0.5 / 40**2 if f4 else 2**0.5 * 2 * 20 / 20**2
    assert abs(fine) < 5 * 2 * spread / 200
    assert abs(laplacian) < 5 * 2 * (20 * 20 / 20**2) / 200


@both
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (2, 2), (3, 3), (2, 40), (11, 3)])
def test_boxes_of_few_pixels_have_finite_scores(shape, f4):
    first, second = make_generator("test_block_vote", "small").integers(0, 3, (2, *shape))
    assert np.isfinite(block_scores(first, second, size=10, f4=f4)).all()
    assert block_scores(0 * first, second, size=10, f4=f4) == pytest.approx(0)


def test_each_curve_is_scaled_to_its_own_range_above_its_floor():
    curves = np.array([[0.0, 5.0, 3.0], [1.0, 5.0, 3.0], [9.0, 5.0, 1003.0], [1.0, 5.0, 3.0]])
    assert scaled(curves)[:, 0] == pytest.approx([-1 / 17, 1 / 17, 1, 1 / 17])  # the floor is 0.5
    assert pytest.approx(np.array([[0, 0, 0, 0], [0, 0, 1, 0]])) == scaled(curves)[:, 1:].T


def test_the_top_lies_on_the_parabola_and_an_end_stays_an_end():
    x = np.array([0.0, 10, 20, 30])
    assert vertex(x, -((x - 13.0) ** 2)) == pytest.approx(13)
    assert vertex(x, x) == 30
    assert vertex(x[:1], x[:1]) == 0


def test_without_light_there_is_no_answer_and_little_light_is_taken():
    dark = get_search("block_vote")(Drawn((ALL, 900, 0.5), light=0.0))
    assert (dark.frame, dark.note) == (None, "too dark")
    assert lens(Drawn((ALL, 900, 0.9), light=0.08)) == pytest.approx(900, abs=150)


@pytest.mark.parametrize(
    ("options", "said"),
    [({"block": 0}, "block is 0"), ({"steps": 0}, "steps is 0"), ({"longest": 2.0}, "longest is 2.0"),
     ({"own": -1.0}, "own is -1.0"), ({"by": "f5"}, "unknown kind of curve 'f5'"),
     ({"counts": float("nan")}, "counts is nan"), ({"blok": 3}, "block")],
)  # fmt: skip
def test_options_out_of_range_are_refused(options, said):
    assert said in str(refusal(get_search, "block_vote", **options))


@pytest.mark.slow
def test_it_passes_the_checks_of_a_search():
    assert [one for one in check_search(get_search("block_vote")) if one.level == "error"] == []
