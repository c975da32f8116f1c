"""Streams in several processes, and many streams at once, as in the data loader of a network."""

import gc
import multiprocessing
import tracemalloc
import weakref

import h5py
import numpy as np
import pytest
from refusals import refusal

from saf_gen.stream import time_blocks
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream
from saf_gen.stream.time_blocks import BlockMemory

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


def damage(path):
    """Overwrite all spikes on the disk, so that only what is in memory can still be read."""
    with h5py.File(path) as file:
        chunks = file["spikes"].id
        places = [chunks.get_chunk_info(k) for k in range(chunks.get_num_chunks())]
    with path.open("r+b") as file:
        for place in places:
            file.seek(place.byte_offset)
            file.write(bytes(place.size))


@pytest.mark.slow
def test_all_streams_share_one_budget_and_what_is_closed_or_lost_is_free(tmp_path, monkeypatch):
    """Blocks of 250 × 40 × 50 bytes, of which ten fit; each stream has four."""
    block = 250 * 40 * 50
    monkeypatch.setattr(time_blocks, "BUDGET_BYTES", 10 * block)
    frames = np.random.default_rng(0).integers(0, 2, (8_000, 40, 50), np.uint8)
    names = [tmp_path / f"{i}.h5" for i in range(4)]
    for i, path in enumerate(names):
        write_stream(path, np.roll(frames, i, axis=1))
    tracemalloc.start()
    try:
        streams = [open_stream(path) for path in names]
        counts = [stream.counts(0, 8_000) for stream in streams]
        assert all(np.array_equal(found, np.roll(frames.sum(axis=0), i, axis=0)) for i, found in enumerate(counts))
        kept = tracemalloc.get_traced_memory()[0]
        assert 9.5 * block < kept < 11 * block
        streams.pop().close()
        assert tracemalloc.get_traced_memory()[0] < kept - 3.5 * block
        damage(names[2])
        assert np.array_equal(streams[2].counts(0, 8_000), counts[2])
        del streams[1:]
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] < 0.5 * block
        damage(names[0])
        assert "damaged" in refusal(streams[0].counts, 0, 8_000).problem
    finally:
        tracemalloc.stop()


def test_a_reader_keeps_three_blocks_whatever_the_budget(tmp_path, monkeypatch):
    monkeypatch.setattr(time_blocks, "BUDGET_BYTES", 0)
    frames = np.random.default_rng(0).integers(0, 2, (10_000, 6, 9), np.uint8)
    write_stream(tmp_path / "a.h5", frames)
    write_stream(tmp_path / "b.h5", frames[:2_000])
    with open_stream(tmp_path / "a.h5") as stream, open_stream(tmp_path / "b.h5") as other:
        stream.counts(0, 10_000)
        damage(tmp_path / "a.h5")
        assert np.array_equal(stream.counts(4_000, 10_000), frames[4_000:].sum(axis=0))
        assert "damaged" in refusal(stream.counts, 0, 4_000).problem
        other.counts(0, 2_000)
        assert "damaged" in refusal(stream.counts, 8_000, 10_000).problem


def test_a_stream_that_is_lost_while_blocks_are_looked_for_is_forgotten_later():
    """Garbage may be collected in a thread that holds the lock; waiting for the lock would never end."""
    memory = BlockMemory()
    lost = weakref.ref(memory.find(1, 0, shape=(2, 3, 4))[0])

    class Shape(tuple):
        def __iter__(self):
            memory.forget(1)  # while the size of a new block is computed
            return super().__iter__()

    memory.find(2, 0, shape=Shape((2, 3, 4)))
    memory.find(2, 0, shape=(2, 3, 4))
    assert lost() is None
