"""Searches that look at nothing: the rows of a table for guessing."""

import numpy as np
import pytest
from planted_sweeps import SHAPE, write_three_sweeps

from saf_gen import get_search
from saf_gen.benchmark.conformance._check_runner import CheckLimits
from saf_gen.benchmark.conformance.commanding_search_checks import run_on_scene
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.method_spec import DEFAULT_CLOSED_LOOP_METHODS, DEFAULT_RECORDED_METHODS, parse_method
from saf_gen.core.seeds import make_generator

BLIND = ["middle", "anywhere"]


class Noise:
    """A recording of noise alone."""

    def __init__(self, number, frames=200):
        self.frames, self.now, self.number = frames, 0, number

    def counts(self, first, stop):
        self.now = max(self.now, stop)
        return make_generator("test_blind_searches", self.number, first).integers(0, 9, (6, 8)).astype(np.uint32)


@pytest.mark.parametrize(("frames", "answer"), [(1, 0.0), (2, 0.5), (800, 399.5), (801, 400.0)])
def test_the_middle_is_the_middle(frames, answer):
    view = Noise(0, frames)
    assert get_search("middle")(view).frame == answer
    assert view.now > answer  # so the sweep of a closed loop has been there


def test_anywhere_repeats_on_a_recording_and_is_uniform_over_recordings():
    """Kolmogorov and Smirnov's distance of 1,000 draws; 1.95/√n is exceeded with probability 0.001; seed in Noise."""
    search = get_search("anywhere")
    found = np.array([search(Noise(number)).frame for number in range(1000)])
    assert [search(Noise(number)).frame for number in range(20)] == found[:20].tolist()
    share = (np.arange(1000) + 0.5) / 1000
    assert np.abs(np.sort((found + 0.5) / 200) - share).max() < 1.95 / np.sqrt(1000)
    view = Noise(3)
    assert search(view).frame < view.now


def test_records_show_that_no_measure_takes_part(tmp_path):
    names = [f"{measure}+{search}" for measure in ("sd", "tenengrad") for search in BLIND]
    found = evaluate(write_three_sweeps(tmp_path), methods=names).records
    frames = {(r.who.method, r.what.sequence): r.judgement.frame for r in found}
    for sequence in ("one", "two", "three"):
        assert frames["sd+middle", sequence] == frames["tenengrad+middle", sequence] == (SHAPE[0] - 1) / 2
        assert frames["sd+anywhere", sequence] == frames["tenengrad+anywhere", sequence]
    assert frames["sd+anywhere", "one"] != frames["sd+anywhere", "two"]


@pytest.mark.parametrize("search", BLIND)
def test_in_the_closed_loop_the_lens_goes_where_the_guess_is(search):
    runs = [run_on_scene(parse_method(f"sd+{search}"), "voice_coil", limits=CheckLimits()) for _ in range(2)]
    assert runs[0].problem == ""
    assert 0 <= runs[0].path[-1] <= 1
    assert runs[0].path[-1] == runs[1].path[-1]
    if search == "middle":
        assert runs[0].path[-1] == pytest.approx(0.5, abs=0.05)


def test_nobody_is_given_a_guess_who_does_not_ask():
    assert not [
        name for name in (*DEFAULT_RECORDED_METHODS, *DEFAULT_CLOSED_LOOP_METHODS) if name.endswith(tuple(BLIND))
    ]
