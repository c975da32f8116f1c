"""An event file as a recording: its counts over readouts, and what it has not."""

import itertools

import numpy as np
import pytest
from refusals import refusal

import saf_gen
from saf_gen.stream.event_file import EventColumns, EventWriter
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.recordings import EventRecording, open_recording
from saf_gen.stream.stream_file import SpikeStream

SHAPE, HZ = (4000, 6, 9), 20_000


@pytest.fixture
def written(tmp_path):
    """An event file of 0.2 s, and its columns."""
    random = np.random.default_rng(3)
    t = np.sort(random.integers(0, 200_000, 3000)).astype(np.uint32)
    columns = EventColumns(
        random.integers(0, 9, 3000).astype(np.uint16), random.integers(0, 6, 3000).astype(np.uint16), t,
        random.integers(0, 2, 3000).astype(np.uint8),
    )  # fmt: skip
    metadata = Metadata(focus_position=np.linspace(0, 1, SHAPE[0], dtype=np.float32), truth=Truth(position=0.4))
    with EventWriter(tmp_path / "events.h5", shape=SHAPE, readout_hz=HZ, metadata=metadata) as writer:
        writer.write(columns)
    return tmp_path / "events.h5", columns


@pytest.mark.parametrize(("first", "stop"), [(0, 4000), (0, 1), (1, 3), (999, 1001), (37, 2111), (3999, 4000)])
def test_counts_are_the_events_of_these_readouts(written, first, stop):
    path, columns = written
    within = (columns.t >= first * 50) & (columns.t < stop * 50)
    wanted = np.zeros(SHAPE[1:], int)
    np.add.at(wanted, (columns.y[within], columns.x[within]), 1)
    with open_recording(path) as recording:
        assert isinstance(recording, EventRecording)
        np.testing.assert_array_equal(recording.counts(first, stop), wanted)
        part = slice(1, 4), slice(2, 9)
        np.testing.assert_array_equal(recording.counts(first, stop, region=part), wanted[part])


def test_consecutive_windows_share_no_event_and_lose_none(written):
    path, columns = written
    edges = np.unique(np.random.default_rng(4).integers(0, 4001, 60)).tolist()
    edges = [0, *[edge for edge in edges if 0 < edge < 4000], 4000]
    with open_recording(path) as recording:
        recording.verify()
        total = sum(int(recording.counts(a, b).sum()) for a, b in itertools.pairwise(edges))
    assert total == len(columns.t)


def test_what_an_event_camera_has_not_is_refused(written, tmp_path):
    with open_recording(written[0]) as recording:
        assert "no frames" in str(refusal(recording.frames, 0, 1))
        assert "no spikes" in str(refusal(recording.packed, 0, 1))
        assert "no intervals" in str(refusal(recording.texture, 0, 1))
        for first, stop in ((0, 0), (-1, 5), (5, 4001), (7, 3)):
            refusal(recording.counts, first, stop)
        refusal(recording.counts, 0, 5, region=(slice(0, 7), slice(0, 9)))
    saf_gen.write_stream(tmp_path / "spikes.h5", np.zeros((16, 4, 4), np.uint8))
    with open_recording(tmp_path / "spikes.h5") as recording:
        assert isinstance(recording, SpikeStream)
    refusal(open_recording, tmp_path / "missing.h5")
