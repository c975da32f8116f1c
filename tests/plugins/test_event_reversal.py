"""Signed events on planted pictures whose contrast rises up to a known place of the lens, and then falls."""

import numpy as np
import pytest
from refusals import refusal
from scipy.ndimage import gaussian_filter

from saf_gen import get_search
from saf_gen.core.seeds import make_generator

FRAMES, STEP, FOCUS = 8000, 40, 4900
FORWARD = np.linspace(0, 1, FRAMES // STEP + 1)


class Events:
    """A view of events, falls and rises: (block of 40 frames, 2, row, col), and of the lens at the blocks' edges."""

    readout_hz = 20_000.0

    def __init__(self, falls, rises, lens):
        self.blocks = np.stack([falls, rises], axis=1).astype(np.uint32)
        self.frames, self.lens = STEP * len(falls), lens

    def polarities(self, first, stop):
        return self.blocks[first // STEP : stop // STEP].sum(axis=0, dtype=np.uint32)

    def position(self, frame):
        return float(np.interp(frame, np.arange(len(self.lens)) * STEP, self.lens))


def bell(focus, *, lens=FORWARD, width=3500):
    return np.maximum(1 - np.abs(lens * FRAMES - focus) / width, 0)


def planted(lamp=lambda x: 0 * x, *, focus=FOCUS, lens=FORWARD, spread=0.0):
    """Falls and rises of a texture in focus at a place of the lens, under a lamp: a function of 0...1, in events.

    ``spread`` is the standard deviation, over the pixels, of the ratio of the thresholds of rises and falls.
    """
    random = make_generator("test_event_reversal", "texture")
    texture = gaussian_filter(random.normal(0, 20, (30, 35)), 1.0)  # standard deviation: 6 events
    ratio = np.exp(spread * random.standard_normal(texture.shape))
    common = lamp(np.linspace(0, 1, FRAMES // STEP + 1))
    log = bell(focus, lens=lens)[:, None, None] * texture + common[:, None, None]
    up, down = (np.maximum(sign * np.diff(log, axis=0), 0).cumsum(axis=0) for sign in (1, -1))
    return [np.diff(np.round(total), axis=0, prepend=0) for total in (down, up * ratio)]


def find(both, *, lens=FORWARD):
    return get_search("event_reversal", steps=FRAMES // STEP)(Events(*both, lens))


@pytest.mark.parametrize("focus", [200, 2500, 4900, 5600, 7900])
def test_the_focus_is_found_at_rest_at_the_ends_of_the_sweep_too(focus):
    assert find(planted(focus=focus)).frame == pytest.approx(focus, abs=3 * STEP)


@pytest.mark.parametrize(
    "lamp",
    [lambda x: 9 * x, lambda x: -9 * x, lambda x: 6.0 * (x > 0.3), lambda x: 3 * np.sin(40 * np.pi * x)],
    ids=["brighter", "darker", "sudden", "clouds"],
)
def test_a_lamp_that_all_pixels_follow_does_not_move_it(lamp):
    assert find(planted(lamp)).frame == pytest.approx(FOCUS, abs=3 * STEP)


def test_thresholds_that_differ_add_up_under_a_lamp_that_varies_and_are_taken_back():
    """Each of 40 cycles leaves a pixel with net events of its own, far more than the texture."""
    drifts = planted(lambda x: 4 * np.sin(80 * np.pi * x), spread=0.1)
    net = (drifts[1] - drifts[0]).sum(axis=0)
    assert net.std() > 20
    assert find(drifts).frame == pytest.approx(FOCUS, abs=6 * STEP)


def test_a_lens_that_comes_back_sees_the_focus_twice_and_not_where_it_turns():
    lens = 1 - np.abs(1 - 2 * FORWARD)
    focus = 0.3 * FRAMES
    answer = find(planted(focus=focus, lens=lens), lens=lens)
    assert np.interp(answer.frame + 0.5, np.arange(len(lens)) * STEP, lens) == pytest.approx(0.3, abs=0.02)


def test_without_positions_frames_take_their_place():
    assert find(planted(), lens=np.full(len(FORWARD), np.nan)) == find(planted())


def test_hot_pixels_do_not_move_it():
    falls, rises = planted()
    hot = rises.copy()
    hot[:, ::9, ::8] += 3
    assert find([falls, hot]).frame == pytest.approx(find([falls, rises]).frame, abs=STEP)


def test_the_answer_is_the_edge_of_a_step_and_flipped_polarities_give_the_same():
    answer = find(planted())
    assert (answer.frame + 0.5) % STEP == 0
    assert find(planted()[::-1]) == answer
    assert answer.trace == (answer.frame,)


@pytest.mark.parametrize(("focus", "frame"), [(-300, 0.0), (8300, FRAMES - 1.0)])
def test_an_answer_at_an_end_is_a_frame_of_the_recording(focus, frame):
    assert find(planted(focus=focus)).frame == pytest.approx(frame, abs=STEP)
    assert 0 <= find(planted(focus=focus)).frame <= FRAMES - 1


def test_it_abstains_without_events():
    answer = find(planted(focus=20_000))
    assert (answer.frame, answer.note) == (None, "no events")


@pytest.mark.parametrize("steps", [0, 2.5])
def test_options_out_of_range_are_refused(steps):
    assert "at least 1" in str(refusal(get_search, "event_reversal", steps=steps))
