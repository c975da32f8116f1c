"""Strata against planes whose shares are known in closed form."""

import numpy as np
import pytest
from planted_sweeps import SHAPE, list_streams, make_spikes, make_truth

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.records import STRATA
from saf_gen.benchmark.strata import stratum_of
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_writer import write_stream

WHOLE = slice(0, 40), slice(0, 100)


def seen(best, *, dof=0.02, at=0.5, **more):
    """Return the truth of a scene whose pixels are in focus at the positions ``best`` (row, col)."""
    known = {"position": at, "depth_of_focus": (at + dof / 2, at - dof / 2), **more}
    return Truth(best_position=np.broadcast_to(np.float32(best), (40, 100)), **known)


def filled(share):
    """Return a truth whose target fills the first columns of its box and is one corner elsewhere."""
    target = np.zeros((40, 100), bool)
    target[:, : round(100 * share)] = True
    return Truth(target=target)


@pytest.mark.parametrize(
    ("best", "stratum"), [(0.5, "one depth"), (0.5099, "one depth"), (0.5101, "relief"), (np.nan, "relief")]
)
def test_a_plane_is_one_depth_within_half_a_depth_of_focus(best, stratum):
    assert stratum_of("inside", WHOLE, truth=seen(best)) == stratum


@pytest.mark.parametrize(("columns", "stratum"), [(100, "one depth"), (96, "one depth"), (94, "relief"), (2, "relief")])
def test_of_a_tilted_plane_as_many_columns_count_as_are_within_half_a_depth_of_focus(columns, stratum):
    step = 0.001
    tilted = 0.5 + step * (np.arange(100) - 49.5)  # one step from column to column, the middle at the truth
    assert stratum_of("inside", WHOLE, truth=seen(tilted, dof=columns * step)) == stratum


@pytest.mark.parametrize(("rows", "stratum"), [(0, "one depth"), (2, "one depth"), (3, "relief"), (20, "relief")])
def test_of_two_planes_the_one_at_the_truth_must_have_95_percent(rows, stratum):
    best = np.where(np.arange(40) < rows, 0.3, 0.5)[:, None]
    assert stratum_of("inside", WHOLE, truth=seen(best)) == stratum


def test_only_the_region_counts_not_what_lies_beside_it():
    best = np.where(np.arange(100) < 50, 0.3, 0.5)
    assert stratum_of("inside", (slice(5, 30), slice(50, 100)), truth=seen(best)) == "one depth"
    assert stratum_of("inside", (slice(5, 30), slice(45, 100)), truth=seen(best)) == "relief"


@pytest.mark.parametrize(
    ("share", "stratum"),
    [(1.0, "80 % and more"), (0.8, "80 % and more"), (0.79, "60 to 80 %"), (0.6, "60 to 80 %"), (0.59, "below 60 %")],
)
def test_the_box_of_the_target_is_sorted_by_how_much_of_it_the_target_fills(share, stratum):
    assert stratum_of("target", WHOLE, truth=filled(share)) == stratum


@pytest.mark.parametrize(
    ("region", "box", "truth"),
    [
        ("frame", None, seen(0.5)),
        ("centre", WHOLE, seen(0.5)),
        ("target", WHOLE, Truth()),
        ("inside", WHOLE, filled(0.9)),
        ("inside", WHOLE, seen(0.5, position=np.nan)),
        ("inside", WHOLE, seen(0.5, depth_of_focus=(np.nan, np.nan))),
    ],
)
def test_where_the_geometry_is_unknown_there_is_no_stratum(region, box, truth):
    assert stratum_of(region, box, truth=truth) is None


def test_records_state_the_stratum_of_the_evaluation_wherever_a_method_looks(tmp_path):
    (tmp_path / "test").mkdir()
    for name, share in (("full", 1.0), ("half", 0.5)):
        target = np.zeros(SHAPE[1:], bool)
        target[8:40, 8:56] = np.arange(48) < 48 * share
        target[8, 55] = True  # the box stays
        lens = np.linspace(0, 1, SHAPE[0], dtype=np.float32)
        truth = make_truth(300.0, target=target)
        write_stream(tmp_path / "test" / f"{name}.h5", make_spikes(300.0), focus_position=lens, truth=truth)
    list_streams(tmp_path, {"id": "full", "scene": "a"}, {"id": "half", "scene": "b"})
    found = evaluate(tmp_path, methods=["sd+argmax", "sd+argmax@frame"]).records
    assert {(r.who.method, r.what.sequence, r.what.stratum) for r in found} == {
        ("sd+argmax", "full", STRATA[2]),
        ("sd+argmax@frame", "full", STRATA[2]),
        ("sd+argmax", "half", STRATA[4]),
        ("sd+argmax@frame", "half", STRATA[4]),
    }
