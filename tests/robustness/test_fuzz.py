"""A few damaged inputs of every kind; fuzz.py and flips.py here are also commands that try many."""

import pytest
from flips import flip_kinds
from fuzz import fuzz

SEED = 41


@pytest.mark.slow
@pytest.mark.parametrize("of_each_kind", [1, pytest.param(8, marks=pytest.mark.long)])
def test_no_spoiled_input_ends_in_anything_but_one_line(tmp_path, of_each_kind):
    lines = []
    assert fuzz(range(of_each_kind), SEED, folder=tmp_path, tell=lines.append) == []
    assert lines[-1].startswith(f"{17 * of_each_kind} inputs of 17 kinds, seed {SEED}")


@pytest.mark.slow
@pytest.mark.parametrize("flips", [12, pytest.param(40, marks=pytest.mark.long)])
def test_no_flipped_bit_is_read_in_silence(flips, monkeypatch, tmp_path):
    kinds = ["stream", "focal stack", "note of a focal stack"]
    monkeypatch.chdir(tmp_path)  # restored afterwards: the flips change the directory
    found = list(flip_kinds(flips, SEED, kinds))
    assert [one["kind"] for one in found] == kinds
    assert all(one["told"] + one["harmless"] == flips for one in found), found
    assert sum(one["told"] for one in found) > 0.75 * len(kinds) * flips
