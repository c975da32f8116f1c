"""Searches of others, and ours, that ask for polarities: on events, on spikes, and in the checks."""

import numpy as np
import pytest

import saf_gen
from saf_gen.benchmark.conformance import check_by_name
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.core.seeds import make_generator
from saf_gen.stream.event_file import EventColumns, EventWriter
from saf_gen.stream.metadata import Metadata, Truth

SHAPE, HZ = (4000, 10, 12), 20_000
GUEST = '''
from dataclasses import dataclass
from typing import ClassVar

from saf_gen.parts import Answer


@dataclass(frozen=True)
class Last:
    """The frame of the last window with more rises than falls, and the sums of both.

    References
    ----------
    None.
    """

    causal: ClassVar[bool] = False
    {polarities}

    def __call__(self, view):
        best, seen = None, [0.0, 0.0]
        for first in range(0, view.frames - 99, 100):
            falls, rises = view.polarities(first, first + 100)
            assert falls.dtype == "uint32" and not falls.flags.writeable
            seen = [seen[0] + float(falls.sum()), seen[1] + float(rises.sum())]
            best = first + 49.5 if rises.sum() > falls.sum() else best
        return Answer(best, tuple(seen))
'''


@pytest.fixture
def events(tmp_path):
    """An event file with rises in its first half and falls in its second; its path and both numbers."""
    t = np.sort(make_generator("test_guests_on_events").integers(0, 200_000, 3000))
    p = (t < 100_000).astype(np.uint8)
    metadata = Metadata(
        focus_position=np.linspace(0, 1, SHAPE[0], dtype=np.float32),
        truth=Truth(position=0.5, frame=1999.5, depth_of_focus=(0.45, 0.55)),
    )
    with EventWriter(tmp_path / "events.h5", shape=SHAPE, readout_hz=HZ, metadata=metadata) as writer:
        writer.write(EventColumns(t % 12, t % 10, t, p))
    return tmp_path / "events.h5", int((1 - p).sum()), int(p.sum())


@pytest.fixture
def guest(tmp_path):
    def write(polarities="polarities: ClassVar[bool] = True"):
        path = tmp_path / "mine.py"
        path.write_text(GUEST.replace("{polarities}", polarities))
        return f"er_count+{path}:Last"

    return write


@pytest.mark.slow
def test_a_guest_sees_the_polarities_that_a_search_of_ours_sees(events, guest):
    path, falls, rises = events
    (record,) = evaluate(path, methods=[guest()]).records
    assert (record.judgement.status, record.judgement.note) == ("answered", "")
    assert record.judgement.trace == (falls, rises)
    assert record.judgement.frame == 1949.5
    assert (record.judgement.windows, record.judgement.frames_seen) == (40, 4000)
    assert record.judgement.operations == pytest.approx(40 * (100.0 * 120 + 2e5))  # undeclared: a look, and a window


@pytest.mark.slow
def test_a_guest_that_does_not_say_so_fails_in_one_line_where_there_are_no_events(tmp_path, guest):
    saf_gen.write_stream(tmp_path / "spikes.h5", np.zeros((160, 10, 12), np.uint8))
    (record,) = evaluate(tmp_path / "spikes.h5", methods=[guest(polarities="")]).records
    assert record.judgement.status == "failed"
    assert "no events, and so no polarities" in record.judgement.note


@pytest.mark.slow
@pytest.mark.parametrize("method", ["er_count+pbf_events", "er_count+elp_events:reject=true", "guest"])
def test_what_needs_events_is_refused_on_spikes_before_it_runs(tmp_path, guest, call, method):
    saf_gen.write_stream(tmp_path / "spikes.h5", np.zeros((160, 10, 12), np.uint8))
    name = guest() if method == "guest" else method
    code, _, error = call("evaluate", tmp_path / "spikes.h5", "--method", name, "--out", tmp_path / "out")
    assert code == 2
    assert "needs events with their polarities, and these recordings hold spikes" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("method", "twin"), [("sd+pbf", "pbf_events"), ("sd+elp", "elp_events"), ("sd+pbf:reject=true", "pbf_events")]
)
def test_what_makes_events_of_spikes_is_refused_on_events_and_names_its_twin(events, tmp_path, call, method, twin):
    code, _, error = call("evaluate", events[0], "--method", method, "--out", tmp_path / "out")
    assert code == 2
    assert "makes events of spikes, and these recordings hold events" in error
    assert f"use {twin}" in error


@pytest.mark.slow
def test_searches_of_ours_run_on_events(events):
    searches = "pbf_events", "elp_events", "egs_events", "event_reversal", "pbf_events:reject=true"
    methods = [f"er_count+{search}" for search in searches]
    records = evaluate(events[0], methods=methods).records
    assert all(record.judgement.status in ("answered", "abstained") for record in records), [
        r.judgement.note for r in records
    ]


def test_the_checks_of_a_search_give_it_polarities(guest):
    found = list(check_by_name(guest().partition("+")[2]))
    assert not [finding for finding in found if finding.level == "error"], found


def test_the_checks_of_a_method_say_that_their_samples_hold_spikes():
    found = list(check_by_name("er_count+pbf_events"))
    assert found[-1].part == "method"
    assert "spike camera" in found[-1].text
    assert not [finding for finding in found if finding.level == "error"], found
