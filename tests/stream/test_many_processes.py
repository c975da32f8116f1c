"""Streams in several processes, and many streams at once, as in the data loader of a network."""

import gc
import multiprocessing

import numpy as np
import pytest

from saf_gen.stream import time_blocks
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream
from saf_gen.stream.time_blocks import BLOCK_MEMORY, BlockMemory

FRAMES = (np.random.default_rng(0).random((5_000, 6, 9)) < 0.3).astype(np.uint8)


@pytest.fixture
def path(tmp_path):
    write_stream(tmp_path / "a.h5", FRAMES)
    return tmp_path / "a.h5"


def count_and_send(stream, pipe):
    pipe.send((stream.counts(100, 4_900), stream.frames(1_990, 2_010), stream.packed(0, 2), stream.verify()))


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # since Python 3.12, in a process that has threads
@pytest.mark.parametrize(
    ("method", "threads"), [("fork", None), ("fork", 2), pytest.param("spawn", 2, marks=pytest.mark.slow)]
)
def test_a_stream_that_the_parent_opened_and_read_is_read_in_another_process(path, method, threads):
    """Threads do not survive a fork, so that a reader that waited for those of its parent would hang."""
    context = multiprocessing.get_context(method)
    with open_stream(path, threads=threads) as stream:
        stream.counts(0, 5_000)
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=count_and_send, args=(stream, sender))
        process.start()
        sender.close()
        assert receiver.poll(60), "the other process does not answer"
        counts, frames, packed, _ = receiver.recv()
        process.join(60)
        assert process.exitcode == 0
        assert np.array_equal(counts, FRAMES[100:4_900].sum(axis=0))
        assert np.array_equal(frames, FRAMES[1_990:2_010])
        assert np.array_equal(packed, stream.packed(0, 2))
        assert np.array_equal(stream.counts(100, 4_900), counts)


def kept_bytes():
    return sum(planes.nbytes for planes, _ in BLOCK_MEMORY._blocks.values())


def test_all_streams_share_one_budget_and_what_is_closed_or_lost_is_free(tmp_path, monkeypatch):
    monkeypatch.setattr(time_blocks, "TIME_BLOCK_BYTES", 8)
    monkeypatch.setattr(time_blocks, "BUDGET_BYTES", 10 * 8 * 6 * 9)
    BLOCK_MEMORY.reset()
    for i in range(6):
        write_stream(tmp_path / f"{i}.h5", FRAMES[i : i + 640])
    streams = [open_stream(tmp_path / f"{i}.h5") for i in range(6)]
    for _ in range(2):
        for i, stream in enumerate(streams):
            assert np.array_equal(stream.counts(0, 640), FRAMES[i : i + 640].sum(axis=0))
            assert kept_bytes() <= time_blocks.BUDGET_BYTES
    assert kept_bytes() == time_blocks.BUDGET_BYTES
    streams.pop().close()
    assert kept_bytes() == 0  # ten blocks fit, all of them from the stream that was read last
    streams[0].counts(0, 640)
    assert kept_bytes() > 0
    del stream, streams
    gc.collect()
    assert kept_bytes() == 0


def test_a_reader_keeps_three_blocks_whatever_the_budget(monkeypatch):
    monkeypatch.setattr(time_blocks, "BUDGET_BYTES", 0)
    memory = BlockMemory()
    for start in range(5):
        planes, _ = memory.find(1, start, shape=(2, 3, 4))
        planes[:] = start
    assert [key for key in memory._blocks] == [(1, 2), (1, 3), (1, 4)]
    memory.find(2, 0, shape=(2, 3, 4))
    assert list(memory._blocks) == [(2, 0)]


def test_a_stream_that_is_lost_while_blocks_are_looked_for_is_forgotten_later(monkeypatch):
    """Garbage may be collected in a thread that holds the lock; waiting for the lock would never end."""
    memory = BlockMemory()
    memory.find(1, 0, shape=(2, 3, 4))
    allocate = memory._allocate
    monkeypatch.setattr(memory, "_allocate", lambda *args: memory.forget(1) or allocate(*args))
    memory.find(2, 0, shape=(2, 3, 4))
    assert list(memory._blocks) == [(1, 0), (2, 0)]
    memory.find(2, 0, shape=(2, 3, 4))
    assert list(memory._blocks) == [(2, 0)]
