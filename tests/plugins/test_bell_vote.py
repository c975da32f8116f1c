"""Bells in the focus curves of a picture and of its blocks: where they agree, and what does not move the answer."""

import numpy as np
import pytest
from refusals import refusal
from scipy.ndimage import gaussian_filter

from saf_gen import get_measure, get_search
from saf_gen.benchmark.conformance import check_search
from saf_gen.core.block_structure import block_edges
from saf_gen.core.seeds import make_generator
from saf_gen.plugins.searches.bell_vote import bell_correlation, frame_of, vertex

FRAMES, SHAPE = 2000, (40, 48)


class Drawn:
    """A view of a sweep over parts of a picture that are sharp at lens positions of their own.

    ``parts`` are (columns, frame, contrast) of each, for an even sweep; ``light`` is the gain in each frame, times 0.2
    spikes per readout; ``shading`` is the contrast of a slow gradient of brightness, which grows over the sweep; and
    ``lens`` holds the position of the lens in each frame. Pixels integrate without noise, from random phases.
    """

    frames, readout_hz, lag_s, now = FRAMES, 20_000.0, 0.0, 0

    def __init__(self, *parts, light=1.0, shading=0.0, lens=None, measure="fine_structure", seed=0):
        random = make_generator("test_bell_vote", seed)
        texture, t = gaussian_filter(random.normal(size=SHAPE), 1.0), np.arange(FRAMES)
        texture = np.clip(texture / (2 * texture.std()), -1, 1)
        self.lens = t / FRAMES if lens is None else lens
        self.measure, contrast = get_measure(measure), np.zeros((FRAMES, SHAPE[1]))
        for columns, sharp, most in parts:
            contrast[:, columns] = (most / (1 + ((self.lens * FRAMES - sharp) / 100) ** 2))[:, None]
        gain = 0.2 * np.broadcast_to(light, FRAMES)[:, None, None]
        slope = shading * t[:, None, None] / FRAMES * np.linspace(-1, 1, SHAPE[1])
        charge = np.cumsum(gain * (1 + contrast[:, None, :] * texture + slope), axis=0)
        self.total = np.concatenate([np.zeros((1, *SHAPE)), np.floor(charge + random.random(SHAPE))]).astype(np.uint32)

    def counts(self, first, stop):
        self.now = max(self.now, stop)
        return self.total[stop] - self.total[first]

    def score(self, first, stop, measure=None):
        return (get_measure(measure) if measure else self.measure)(self.counts(first, stop))

    def position(self, frame):
        return float(self.lens[frame])


ALL, LEFT, RIGHT = slice(0, 48), slice(0, 36), slice(36, 48)


def focus(view, **options):
    return get_search("bell_vote", **options)(view).frame


@pytest.mark.parametrize("area", [False, True])
@pytest.mark.parametrize("at", [500, 1000, 1530])
def test_the_focus_of_a_flat_target_is_found_to_a_hundredth_of_the_sweep(at, area):
    assert focus(Drawn((ALL, at, 0.5)), area=area) == pytest.approx(at, abs=20)


@pytest.mark.parametrize("seed", range(3))
def test_with_area_most_of_the_area_decides_and_otherwise_most_of_the_contrast_does(seed):
    """A strip on 25 % of the box with 2.7 times the contrast is sharp elsewhere."""
    view = Drawn((LEFT, 600, 0.35), (RIGHT, 1400, 0.95), seed=seed)
    assert focus(view, area=True) == pytest.approx(600, abs=30)
    assert focus(view, own=10.0) == pytest.approx(1400, abs=60)


@pytest.mark.parametrize("last", [0.15, 1.0, 6.0])
def test_light_that_changes_moves_the_answer_by_less_than_two_steps(last):
    light = np.minimum(np.geomspace(1, last, FRAMES), 2.4)
    assert focus(Drawn((ALL, 900, 0.5), light=light)) == pytest.approx(900, abs=20)


def test_shading_that_grows_over_the_sweep_moves_f4_and_not_the_answer():
    view = Drawn((ALL, 600, 0.2), shading=0.9)
    assert focus(view) == pytest.approx(600, abs=20)
    assert get_search("argmax")(Drawn((ALL, 600, 0.2), shading=0.9, measure="variance_n")).frame > 1500


def test_a_lens_that_passes_twice_is_one_curve_over_its_position():
    there_and_back = 1 - abs(np.linspace(-1, 1, FRAMES))
    answer = focus(Drawn((ALL, 1400, 0.4), lens=there_and_back))
    assert there_and_back[round(answer)] == pytest.approx(0.7, abs=0.01)
    assert answer < FRAMES / 2, "the first pass"


def test_without_positions_frames_take_their_place():
    view = Drawn((ALL, 900, 0.5))
    view.position = lambda frame: float("nan")
    assert focus(view) == pytest.approx(900, abs=20)


def test_the_correlation_is_that_of_each_curve_with_each_bell():
    lens, places = np.linspace(0, 1, 50), np.array([0.2, 0.5])
    curves = make_generator("test_bell_vote", "curves").normal(size=(50, 3))
    curves[:, 2] = 7.0
    curves[:, 0] *= 9  # what another curve is like changes nothing
    found = bell_correlation(curves, lens=lens, places=places)
    bell = 1 / (1 + ((lens - 0.5) / 0.18) ** 2) ** 2
    least = bell.var() / (bell.var() + 0.02 * np.mean(bell**2))
    expected = np.corrcoef(bell, curves[:, 1])[0, 1] * least**0.5
    assert found.shape == (8, 2, 3)
    assert found[-1, 1, 1] == pytest.approx(expected, rel=1e-9)
    assert abs(found[..., 2]).max() < 1e-9, "a constant curve"
    own = bell_correlation(bell[:, None], lens=lens, places=places)[..., 0]
    assert np.unravel_index(own.argmax(), own.shape) == (7, 1)


@pytest.mark.parametrize(("pixels", "size", "count"), [(23, 10, 2), (37, 10, 3), (37, 100, 1), (5, 1, 5)])
def test_blocks_cover_each_pixel_once_and_are_about_as_large_as_asked(pixels, size, count):
    edges = block_edges(pixels, size)
    assert (len(edges) - 1, edges[0], edges[-1]) == (count, 0, pixels)
    assert np.ptp(np.diff(edges)) <= 1


def test_the_top_lies_on_the_parabola_and_an_end_stays_an_end():
    x = np.array([0.0, 10, 20, 30])
    assert vertex(x, -((x - 13.0) ** 2)) == pytest.approx(13)
    assert vertex(x, x) == 30


def test_the_frame_is_the_first_at_which_the_lens_passes():
    lens, frames = np.array([0.0, 0.5, 1.0, 0.5]), np.array([5.0, 15, 25, 35])
    assert frame_of(0.75, lens=lens, frames=frames) == pytest.approx(20)
    assert frame_of(0.0, lens=lens, frames=frames) == 5
    assert frame_of(1.0, lens=lens, frames=frames) == 25


def test_without_a_focus_few_blocks_agree_and_the_answer_can_be_withdrawn():
    known, none = Drawn((ALL, 900, 0.5)), Drawn((ALL, 5000, 0.5))
    assert get_search("bell_vote", agree=0.9)(known).note.endswith("100% of the blocks agree")
    withdrawn = get_search("bell_vote", agree=0.9)(none)
    assert withdrawn.frame is None
    assert withdrawn.note.endswith("of the blocks agree")
    assert focus(none) is not None


def test_the_sweep_stops_once_enough_blocks_agree_and_the_lens_is_past_the_answer():
    view = Drawn((ALL, 700, 0.5))
    assert focus(view, enough=0.7) == pytest.approx(700, abs=20)
    assert 700 < view.now < 1300
    nearer_first = Drawn((RIGHT, 500, 0.95), (LEFT, 1400, 0.35))
    assert focus(nearer_first, enough=0.7, area=True) == pytest.approx(1400, abs=30), "a quarter is not enough"
    focus(view)
    assert view.now == FRAMES
    sure = Drawn((LEFT, 700, 0.5), (RIGHT, 1500, 0.5))
    assert focus(sure, enough=0.5, agree=0.95) is None
    assert sure.now == FRAMES, "what would be withdrawn does not stop the sweep"


def test_without_light_or_motion_there_is_no_answer_and_little_light_is_taken():
    assert get_search("bell_vote")(Drawn((ALL, 900, 0.5), light=0.0)).note == "too dark"
    assert get_search("bell_vote")(Drawn((ALL, 900, 0.5), lens=np.full(FRAMES, 0.5))).note == "the lens rested"
    assert focus(Drawn((ALL, 900, 0.9), light=0.08)) == pytest.approx(900, abs=150)


@pytest.mark.parametrize(
    ("options", "said"),
    [({"block": 0}, "block is 0"), ({"steps": 0}, "steps is 0"), ({"longest": 2.0}, "longest is 2.0"),
     ({"own": -1.0}, "own is -1.0"), ({"agree": 35}, "agree is 35"), ({"enough": 2}, "enough is 2"),
     ({"area": 1}, "area is 1"), ({"counts": float("nan")}, "counts is nan"), ({"blok": 3}, "block")],
)  # fmt: skip
def test_options_out_of_range_are_refused(options, said):
    assert said in str(refusal(get_search, "bell_vote", **options))


@pytest.mark.slow
@pytest.mark.parametrize("enough", [0.0, 0.7])
def test_it_passes_the_checks_of_a_search(enough):
    assert [one for one in check_search(get_search("bell_vote", enough=enough)) if one.level == "error"] == []
