"""When the lens passes a position, for motions with known answers."""

import numpy as np
import pytest

from saf_gen.optics.focus_crossings import focus_crossings


def test_a_sweep_passes_every_place_of_the_travel_once_when_its_formula_says():
    sweep = (np.arange(50) + 0.5) / 50
    for position in (1e-4, 0.003, 0.25, 0.5, 0.999, 1 - 1e-4):
        assert focus_crossings(sweep, position) == pytest.approx([position * 50 - 0.5], abs=1e-9)
        assert focus_crossings(sweep[::-1], position) == pytest.approx([(1 - position) * 50 - 0.5], abs=1e-9)


def test_what_lies_outside_the_way_is_never_passed():
    sweep = 0.2 + 0.5 * (np.arange(50) + 0.5) / 50
    assert [focus_crossings(sweep, position).size for position in (0.19, 0.71, float("nan"))] == [0, 0, 0]


def test_there_and_back_passes_a_place_twice_and_its_turn_once():
    lens = np.array([0.0, 0.5, 1.0, 0.5, 0.0])
    assert focus_crossings(lens, 0.25) == pytest.approx([0.5, 3.5])
    assert focus_crossings(lens, 0.5).tolist() == [1, 3]
    assert focus_crossings(lens, 1.0).tolist() == [2]


def test_a_lens_at_rest_crosses_its_position_in_every_readout():
    assert focus_crossings(np.full(3, 0.2), 0.2).tolist() == [0, 1, 2]
    assert focus_crossings(np.full(3, 0.2), 0.3).size == 0
    assert focus_crossings(np.array([0.1, 0.2, 0.2, 0.3]), 0.2).tolist() == [1, 2]


def test_float32_as_in_a_file_gives_the_same_frames():
    grid = np.round((np.arange(1000) + 0.5) / 1000 * 2**24) / 2**24
    assert np.array_equal(focus_crossings(grid, 0.37), focus_crossings(grid.astype(np.float32), 0.37))
