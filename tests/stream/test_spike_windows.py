"""Windows of a dataset to train with: counts and targets as they are stored, in batches that read each block once."""

import multiprocessing
import pickle
from dataclasses import replace
from itertools import chain

import numpy as np
import pytest
from refusals import refusal

from saf_gen import SpikeWindows, WindowBatches
from saf_gen.stream import spike_windows, time_blocks
from saf_gen.stream.manifest import Manifest, SequenceEntry, write_manifest
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_writer import write_stream

SHAPE, FRAMES, TRUTH = (6, 9), 1_000, 0.4
ENTRY = SequenceEntry("", "train", "plane", 0, "static", "sweep", "constant", 0, 1, "", FRAMES, "f", "c")


def spikes(seed):
    return (np.random.default_rng(seed).random((FRAMES, *SHAPE)) < 0.3).astype(np.uint8)


def truth():
    target = np.zeros(SHAPE, bool)
    target[1:3, 6:8] = True
    plane = np.zeros(SHAPE, np.float32)
    return Truth(TRUTH, (0.3, 0.5), 12.5, plane, target, plane, np.arange(5.0))


@pytest.fixture
def dataset(tmp_path, monkeypatch):
    """Three sequences of 1,000 frames, two to train with; blocks of 64 frames."""
    monkeypatch.setattr(time_blocks, "TIME_BLOCK_BYTES", 8)
    monkeypatch.setattr(spike_windows, "BLOCK_FRAMES", 64)
    entries = []
    for n in range(3):
        entry = replace(ENTRY, id=f"s{n}", split="test" if n == 2 else "train", file=f"s{n}.h5")
        position = np.linspace(0, 1, FRAMES, dtype=np.float32)
        entries.append(replace(entry, content_sha256=write_one(tmp_path / entry.file, n, position)))
    write_manifest(tmp_path, Manifest("made", "abc", "llvm", tuple(entries)))
    return tmp_path


def write_one(path, seed, position):
    return write_stream(path, spikes(seed), focus_position=position, truth=truth())


def test_windows_are_the_counts_of_their_frames_and_the_way_of_the_lens_to_focus(dataset):
    windows = SpikeWindows(dataset, "train", window=64)
    assert len(windows) == 2 * 15
    for number, window in enumerate(windows.windows):
        counts, error = windows[number]
        seed = int(window.sequence.id[1:])
        assert (counts.dtype, counts.shape) == (np.float32, (1, *SHAPE))
        assert np.array_equal(counts[0], spikes(seed)[window.first : window.stop].sum(axis=0))
        assert error == pytest.approx(TRUTH - (window.first + 32) / (FRAMES - 1), abs=1e-6)
    assert {w.sequence.split for w in windows.windows} == {"train"}


def test_strides_crops_and_targets_are_chosen(dataset):
    windows = SpikeWindows(dataset, window=100, stride=50, crop=(4, 5), target="position")
    assert len(windows) == 3 * 19
    counts, position = windows[1]
    # The target's middle is row 2, column 7: the box is moved back into the frame.
    assert np.array_equal(counts[0], spikes(0)[50:150].sum(axis=0)[0:4, 4:9])
    assert position == np.float32(TRUTH)
    own = SpikeWindows(dataset, "test", window=100, target=lambda stream, first, stop: (stream.shape, first, stop))
    assert own[3][1] == ((FRAMES, *SHAPE), 300, 400)


def test_where_the_scene_moves_the_truth_is_that_of_the_moment(dataset):
    track, position = np.linspace(0.2, 0.6, FRAMES, dtype=np.float32), np.linspace(1, 0, FRAMES, dtype=np.float32)
    write_stream(dataset / "s0.h5", spikes(0), focus_position=position, truth=replace(truth(), track=track))
    assert SpikeWindows(dataset, window=100, target="position")[4][1] == track[450]
    assert SpikeWindows(dataset, window=100)[4][1] == pytest.approx(track[450] - position[450])


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_an_epoch_has_every_window_once_in_an_order_of_its_own(dataset, workers):
    windows = SpikeWindows(dataset, window=16)
    batches = WindowBatches(windows, batch_size=8, workers=workers, blocks=4, seed=5)
    count, first, second = len(batches), list(batches), list(batches)
    assert count == len(first)
    for epoch in (first, second):
        assert sorted(chain.from_iterable(epoch)) == list(range(len(windows)))
    assert first != second
    assert first == list(WindowBatches(windows, batch_size=8, workers=workers, blocks=4, seed=5))
    assert first != list(WindowBatches(windows, batch_size=8, workers=workers, blocks=4, seed=6))
    assert max(map(len, first)) == 8


def test_every_block_is_inflated_once_in_an_epoch(dataset, monkeypatch):
    """As many blocks as are shuffled together fit in memory, and nothing else does."""
    inflated = []
    inflate = time_blocks._inflated
    monkeypatch.setattr(time_blocks, "_inflated", lambda *given: inflated.append(1) or inflate(*given))
    monkeypatch.setattr("saf_gen.stream.block_memory.BUDGET_BYTES", 5 * 8 * 6 * 9)
    windows = SpikeWindows(dataset, window=16, stride=16)
    for numbers in WindowBatches(windows, batch_size=8, blocks=4):
        for number in numbers:
            windows[number]
    blocks = 3 * -(-FRAMES // 64)
    assert blocks <= len(inflated) <= 1.5 * blocks  # reading in order, a stream inflates the next block too
    inflated.clear()
    windows.close()
    for number in np.random.default_rng(0).permutation(len(windows)):
        windows[number]
    assert len(inflated) > 2.5 * blocks


def read_and_send(windows, numbers, pipe):
    pipe.send([windows[number] for number in numbers])


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # since Python 3.12, in a process that has threads
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_windows_are_read_in_other_processes(dataset, method):
    context = multiprocessing.get_context(method)
    windows = SpikeWindows(dataset, window=100)
    expected = [windows[number] for number in (0, 25, 13)]
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=read_and_send, args=(windows, (0, 25, 13), there))
    process.start()
    there.close()
    assert here.poll(60), "the other process does not answer"
    for (counts, error), (other, told) in zip(expected, here.recv(), strict=True):
        assert np.array_equal(counts, other)
        assert error == told
    process.join(60)
    assert len(pickle.dumps(windows)) < 100_000


@pytest.mark.parametrize(
    ("options", "problem", "allowed"),
    [
        ({"split": "tain"}, "unknown split 'tain'", "test, train"),
        ({"window": 0}, "window is 0", "a whole number, at least 1, at most 1000"),
        ({"window": 1_001}, "window is 1001", "a whole number, at least 1, at most 1000"),
        ({"stride": 2.5}, "stride is 2.5", "a whole number, at least 1"),
        ({"target": "eror"}, "unknown target 'eror'", "error, position"),
    ],
)
def test_what_does_not_fit_is_refused(dataset, options, problem, allowed):
    error = refusal(lambda: SpikeWindows(dataset, **options))
    assert (error.problem, error.allowed) == (problem, allowed)


def test_a_crop_and_a_truth_that_are_not_there_are_refused_when_they_are_read(dataset):
    assert refusal(lambda: SpikeWindows(dataset, crop=(7, 9))[0]).allowed == "(1, 1) to (6, 9)"
    write_stream(dataset / "s0.h5", spikes(0))
    assert refusal(lambda: SpikeWindows(dataset)[0]).problem == "does not state its true focus"
    assert SpikeWindows(dataset, target=lambda stream, first, stop: 1.0)[0][1] == 1.0


@pytest.mark.parametrize("option", ["batch_size", "workers", "blocks"])
def test_batches_of_nothing_are_refused(dataset, option):
    given = {"batch_size": 8, option: 0}
    assert refusal(lambda: WindowBatches(SpikeWindows(dataset), **given)).problem == f"{option} is 0"
