"""Computing takes time in the closed loop: by declared operations, so that a record can be made again anywhere."""

import numpy as np
import pytest
from handmade_records import record
from refusals import refusal
from test_versions import make_sequence

from saf_gen import get_measure, get_search
from saf_gen.benchmark.admission import cost_of, describe_undeclared
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.tracks.closed_loop_run import run_closed_loop, start_camera
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.operations import UNDECLARED, DeclaredCost, declared_cost, reference_rate
from saf_gen.leaderboard.ranking import rank_methods
from saf_gen.leaderboard.tables import ranking
from saf_gen.optics.actuators import get_actuator

VOICE_COIL = get_actuator("voice_coil")


def run(method, rate=None):
    sequence = make_sequence()
    protocol = ClosedLoopProtocol(VOICE_COIL, operations_per_s=rate)
    return sequence, run_closed_loop(sequence.make_captured(), parse_method(method), protocol=protocol)


@pytest.mark.parametrize("method", ["sd+argmax:window=40", "sd+golden_section", "sd_calibrated+photon_aware"])
def test_operations_are_those_of_the_windows_and_do_not_depend_on_the_machine(method):
    (sequence, first), (_, again) = run(method), run(method)
    assert first.operations == again.operations > 0
    if method.startswith("sd+argmax"):
        rows, columns = ((s.stop - s.start) for s in sequence.box)
        own = cost_of(parse_method(method))
        assert first.operations == first.windows * (own.measure * rows * columns + own.window)


@pytest.mark.parametrize("method", ["sd+argmax:window=40", "sd+golden_section", "sd_calibrated+sgfs_causal"])
def test_the_clock_advances_by_the_operations_at_the_stated_rate(method):
    """At 1e15 a second nothing takes a packet of 0.4 ms; slower machines answer later, and a slow one not at all."""
    (_, free), (_, fast) = run(method), run(method, 1e15)
    assert (fast.frames_seen, fast.answer) == (free.frames_seen, free.answer)
    later = [run(method, rate)[1].frames_seen for rate in (1e9, 5e6)]
    assert free.frames_seen <= later[0] < later[1]
    spent = run(method, 1e4)[1]
    assert spent.problem.startswith("the budget of ")


def test_the_camera_runs_on_until_what_was_computed_is_done():
    """A window of 40 frames, and 1e5 operations at 1e7 a second: 10 ms, which are 200 frames."""
    protocol = ClosedLoopProtocol(VOICE_COIL, operations_per_s=1e7)
    camera = start_camera(make_sequence().make_captured(), get_measure("sd"), protocol=protocol)
    camera.scorer.cost = DeclaredCost(0.0, 1e5, 0.0)
    camera.score(0, 40)
    assert camera.now == 240


def test_computing_that_fits_between_two_windows_costs_nothing():
    """A window of 40 frames takes 2 ms, and its score 0.01 ms at 1e9: only the last scores come after the sweep."""
    (_, free), (_, timed) = run("sd+argmax:window=40"), run("sd+argmax:window=40", 1e9)
    assert timed.frames_seen - free.frames_seen <= 8


def test_the_protocol_of_older_records_says_nothing_of_computing_and_a_rate_is_in_the_terms():
    capture = make_sequence().capture
    old, new = (ClosedLoopProtocol(VOICE_COIL, operations_per_s=rate).describe(capture) for rate in (None, 1e9))
    assert new == f"{old}, 1e+09 op/s"
    assert (ClosedLoopProtocol.rate_in(old), ClosedLoopProtocol.rate_in(new)) == (None, 1e9)


@pytest.mark.parametrize("rate", [0.0, -1.0, 0.5, 1e16, float("nan"), float("inf")])
def test_a_rate_that_cannot_be_is_refused(rate):
    assert "allowed: 1 to 1e+15" in str(refusal(ClosedLoopProtocol, VOICE_COIL, operations_per_s=rate))


class Stated:
    cost, look_cost = 7.0, 3.0


@pytest.mark.parametrize(
    ("measure", "search", "expected"),
    [
        (get_measure("sd"), get_search("argmax"), DeclaredCost(3.0, 4e3)),
        (get_measure("tenengrad_n"), get_search("peak_fit"), DeclaredCost(13.0, 1e5, 2.0)),
        (get_measure("sd"), get_search("argmax", reject=True), DeclaredCost(3.0, 1e5, 2.0)),
        (Stated(), Stated(), DeclaredCost(7.0, 7.0, 3.0)),
        (object(), object(), DeclaredCost()),
        *((type("Odd", (), {"cost": cost})(), object(), DeclaredCost()) for cost in (-1, True, "3", float("nan"))),
    ],
)
def test_what_is_declared_is_charged_and_nothing_is_free_by_default(measure, search, expected):
    found = declared_cost(measure, search)
    assert found == expected
    assert None not in (found.known().measure, found.known().window, found.known().look)
    assert DeclaredCost().known() == UNDECLARED


def test_a_method_that_declares_nothing_is_told_in_a_line(tmp_path):
    (tmp_path / "mine.py").write_text("def spread(counts):\n    return float(counts.std())\n")
    method = parse_method(f"{tmp_path}/mine.py:spread+argmax")
    (line,) = describe_undeclared([method, parse_method("sd+argmax")])
    assert "declares no cost of its own: charged 100 operations per pixel" in line


TIMES = {"first": 4.0, "second": 0.11, "third": 0.1}
"""Seconds on three sequences, compiled for the first."""


def test_a_method_that_takes_more_than_three_times_what_it_declares_is_flagged():
    seconds, timed = (0.01, 0.029, 0.031, 1.0), {"operations": 1e7, "reference_rate": 1e9}  # ten milliseconds
    records = [record(f"{s}+s", "a", 0.1, seconds=s, **timed) for s in seconds]
    rows = {row.method: row for row in rank_methods(records)}
    (column,) = (c for c in ranking(list(rows.values())).shown if c.name == "over_declared")
    assert [column.text(rows[f"{s}+s"]) for s in seconds] == ["–", "–", "3×", "100×"]


def test_neither_a_compilation_nor_a_few_calls_of_python_are_flagged():
    compiled = [record("a+s", name, 0.1, seconds=s, operations=1e8, reference_rate=1e9) for name, s in TIMES.items()]
    brief = [record("b+s", name, 0.1, seconds=0.015, operations=1e5, reference_rate=1e9) for name in TIMES]
    rows = {row.method: row.over_declared for row in rank_methods([*compiled, *brief])}
    assert rows == {"a+s": pytest.approx(1.1), "b+s": None}


def test_the_reference_is_measured_on_the_same_region():
    rates = [reference_rate(shape) for shape in ((1, 1), (8, 8), (100, 100))]
    assert all(np.isfinite(rates))
    assert 0 < rates[0] < rates[2]  # calls cost more than pixels on a small region
