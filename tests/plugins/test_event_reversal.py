"""Reversal of signed events on planted pictures whose contrast rises up to a known frame, and then falls."""

import numpy as np
import pytest
from refusals import refusal

from saf_gen import get_search
from saf_gen.core.seeds import make_generator

FRAMES, STEP, FOCUS = 8000, 40, 4900


class Events:
    """A view of events, falls and rises: (block of 40 frames, 2, row, col)."""

    readout_hz = 20_000.0

    def __init__(self, signed):
        self.blocks = np.stack([np.maximum(-signed, 0), np.maximum(signed, 0)], axis=1).astype(np.uint32)
        self.frames = STEP * len(signed)

    def polarities(self, first, stop):
        return self.blocks[first // STEP : stop // STEP].sum(axis=0, dtype=np.uint32)


def bell(focus, *, width=3500):
    return np.maximum(1 - np.abs(np.arange(0, FRAMES + 1, STEP) - focus) / width, 0)


SHARP = bell(FOCUS)


def planted(lamp=lambda x: 0 * x, *, contrast=SHARP):
    """Signed events of a texture, (block, row, col), under a lamp whose logarithm is a function of 0...1, in events."""
    texture = make_generator("test_event_reversal", "texture").normal(0, 8, (20, 25))
    common = lamp(np.linspace(0, 1, FRAMES // STEP + 1))
    return np.diff(np.round(contrast[:, None, None] * texture + common[:, None, None]), axis=0)


def find(signed, **options):
    return get_search("event_reversal", **{"steps": FRAMES // STEP, **options})(Events(signed))


@pytest.mark.parametrize("focus", [2500, 4900, 5600])
def test_the_focus_is_found_to_a_step_at_rest(focus):
    assert find(planted(contrast=bell(focus))).frame == pytest.approx(focus, abs=STEP)


@pytest.mark.parametrize(
    "lamp", [lambda x: 9 * x, lambda x: -9 * x, lambda x: 6.0 * (x > 0.3)], ids=["brighter", "darker", "sudden"]
)
def test_a_lamp_that_all_pixels_follow_does_not_move_it(lamp):
    assert find(planted(lamp)).frame == pytest.approx(FOCUS, abs=STEP)


def test_only_a_lamp_that_varies_limits_it_to_what_is_undone_at_once():
    """A small, steep bell at 2000 wins within 15 ms, and the focus over the whole sweep."""
    contrast = SHARP + bell(2000, width=300) / 4
    still, varying = (planted(lambda x, a=a: a * np.sin(40 * np.pi * x), contrast=contrast) for a in (0, 2))
    assert find(still, window_s=0.015).frame == pytest.approx(FOCUS, abs=STEP)
    assert find(still, window_s=0.015, drift=0).frame == pytest.approx(2000, abs=STEP)
    assert find(varying, window_s=0.015).frame == pytest.approx(2000, abs=STEP)
    assert find(varying, window_s=0.015, drift=9).frame == pytest.approx(FOCUS, abs=STEP)


def test_hot_pixels_do_not_move_it():
    signed = planted()
    hot = signed.copy()
    hot[:, ::9, ::8] = 3
    assert find(hot).frame == pytest.approx(find(signed).frame, abs=STEP)


def test_the_answer_is_the_edge_of_a_step_and_flipped_polarities_give_the_same():
    answer = find(planted())
    assert (answer.frame + 0.5) % STEP == 0
    assert find(-planted()) == answer
    assert answer.trace == (answer.frame,)


@pytest.mark.parametrize("focus", [-5000, 8000])
def test_it_abstains_without_events_and_where_none_is_undone(focus):
    answer = find(planted(contrast=bell(focus)))
    assert (answer.frame, answer.note) == (None, "no event is undone by a later one")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"steps": 0}, "at least 1"),
        ({"steps": 2.5}, "at least 1"),
        ({"window_s": 0}, "above 0"),
        ({"window_s": -1}, "0 to 10000"),
        ({"drift": float("nan")}, "0 to 1e+09"),
        ({"drift": True}, "0 to 1e+09"),
    ],
)
def test_options_out_of_range_are_refused(options, words):
    assert words in str(refusal(get_search, "event_reversal", **options))
