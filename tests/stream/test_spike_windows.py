"""Windows of a dataset for training: counts and targets as stored, counted once, and read in any order."""

import multiprocessing
import pickle
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal
from windowed_dataset import FRAMES, SHAPE, TRUTH, make_spikes, make_truth, make_windowed_dataset

from saf_gen import SpikeWindows
from saf_gen.stream import time_blocks
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.stream_writer import write_stream


@pytest.fixture
def dataset(tmp_path, monkeypatch):
    """Three sequences of 1,000 frames in blocks of 64 frames; two are for training."""
    monkeypatch.setattr(time_blocks, "TIME_BLOCK_BYTES", 8)
    return make_windowed_dataset(tmp_path)


def test_windows_are_the_counts_of_their_frames_and_the_way_of_the_lens_to_focus(dataset):
    windows = SpikeWindows(dataset, "train", window=64)
    assert len(windows) == 2 * 15
    for number, window in enumerate(windows.windows):
        counts, error = windows[number]
        seed = int(window.sequence.id[1:])
        assert (counts.dtype, counts.shape) == (np.float32, (1, *SHAPE))
        assert np.array_equal(counts[0], make_spikes(seed)[window.first : window.stop].sum(axis=0))
        assert error == pytest.approx(TRUTH - (window.first + 32) / (FRAMES - 1), abs=1e-6)
    assert {w.sequence.split for w in windows.windows} == {"train"}


def test_windows_of_train_read_no_recording_of_test(dataset):
    digests = {entry.id: entry.content_sha256 for entry in read_manifest(dataset).sequences}
    for split, ids in (("train", ["s0", "s1"]), ("test", ["s2"]), ("all", ["s0", "s1", "s2"])):
        windows = SpikeWindows(dataset, split, window=100, target=lambda stream, first, stop: stream.content_sha256)
        assert {windows[number][1] for number in range(len(windows))} == {digests[name] for name in ids}


@pytest.mark.parametrize(
    ("splits", "allowed", "learn"),
    [
        (("test", "train"), "test, train, or all", "train"),
        (("test", "validation", "far"), "test, validation, far, or all", "validation"),
    ],
)
def test_a_dataset_of_several_splits_needs_the_name_of_one(tmp_path, splits, allowed, learn):
    error = refusal(SpikeWindows, make_windowed_dataset(tmp_path, splits=splits))
    assert (error.problem, error.where, error.allowed) == ("no split is given", str(tmp_path), allowed)
    assert error.hint == f'train with split="{learn}", or with another one except test'


def test_a_dataset_of_one_split_does_not_need_its_name(tmp_path):
    assert len(SpikeWindows(make_windowed_dataset(tmp_path, splits=("test", "test")), window=100)) == 2 * 10


def test_strides_crops_and_targets_are_chosen(dataset):
    windows = SpikeWindows(dataset, "all", window=100, stride=50, crop=(4, 5), target="position")
    assert len(windows) == 3 * 19
    counts, position = windows[1]
    # The target's middle is row 2, column 7: the box is moved back into the frame.
    assert np.array_equal(counts[0], make_spikes(0)[50:150].sum(axis=0)[0:4, 4:9])
    assert position == np.float32(TRUTH)
    custom = SpikeWindows(dataset, "test", window=100, target=lambda stream, first, stop: (stream.shape, first, stop))
    assert custom[3][1] == ((FRAMES, *SHAPE), 300, 400)


def test_where_the_scene_moves_the_truth_is_that_of_the_moment(dataset):
    track, position = np.linspace(0.2, 0.6, FRAMES, dtype=np.float32), np.linspace(1, 0, FRAMES, dtype=np.float32)
    write_stream(
        dataset / "train/s0.h5", make_spikes(0), focus_position=position, truth=replace(make_truth(), track=track)
    )
    assert SpikeWindows(dataset, "all", window=100, target="position")[4][1] == track[450]
    assert SpikeWindows(dataset, "all", window=100)[4][1] == pytest.approx(track[450] - position[450])


def read_all(windows, seed=0):
    return [windows[number] for number in np.random.default_rng(seed).permutation(len(windows))]


def test_each_stream_is_inflated_once_whatever_the_order_and_however_often(dataset, monkeypatch):
    inflated = []
    inflate = time_blocks.inflate_chunk
    monkeypatch.setattr(time_blocks, "inflate_chunk", lambda *args: inflated.append(1) or inflate(*args))
    windows = SpikeWindows(dataset, "all", window=16)
    read_all(windows)
    blocks = 3 * -(-FRAMES // 64)
    assert len(inflated) == blocks
    windows.close()
    read_all(windows, seed=1)
    read_all(SpikeWindows(dataset, "train", window=16, target="position"))
    assert len(inflated) == blocks
    SpikeWindows(dataset, "all", window=16, crop=(2, 2))[0]
    assert len(inflated) > blocks


def test_a_stream_that_was_replaced_is_counted_again(dataset):
    before, _ = SpikeWindows(dataset, "all", window=100)[0]
    write_stream(
        dataset / "train/s0.h5", make_spikes(9), focus_position=np.zeros(FRAMES, np.float32), truth=make_truth()
    )
    after, _ = SpikeWindows(dataset, "all", window=100)[0]
    assert np.array_equal(after[0], make_spikes(9)[:100].sum(axis=0))
    assert not np.array_equal(after, before)


def test_half_written_counts_are_not_used(dataset, monkeypatch):
    windows = SpikeWindows(dataset, "all", window=100, counts=dataset / "elsewhere")
    expected = windows[3]
    (file,) = (dataset / "elsewhere").glob("*.npy")
    file.write_bytes(file.read_bytes()[:-1])
    assert np.array_equal(SpikeWindows(dataset, "all", window=100, counts=dataset / "elsewhere")[3][0], expected[0])
    file.unlink()

    def stop(time_blocks, firsts, **options):
        yield np.zeros((1, *SHAPE), np.uint8)
        raise KeyboardInterrupt

    again = SpikeWindows(dataset, "all", window=100, counts=dataset / "elsewhere")
    with monkeypatch.context() as patch:
        patch.setattr("saf_gen.stream.stream_file.count_windows", stop)
        with pytest.raises(KeyboardInterrupt):
            again[3]
    assert not list((dataset / "elsewhere").iterdir())
    assert np.array_equal(again[3][0], expected[0])


def read_and_send(windows, numbers, pipe):
    pipe.send([windows[number] for number in numbers])


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # since Python 3.12, in a process that has threads
def test_processes_that_count_the_same_sequences_at_once_agree(dataset):
    """tests/stream/test_many_processes.py: a stream in a process that was spawned."""
    context = multiprocessing.get_context("fork")
    windows, numbers = SpikeWindows(dataset, "all", window=50), range(60)
    assert len(pickle.dumps(windows)) < 100_000
    pipes = [context.Pipe(duplex=False) for _ in range(4)]
    processes = [context.Process(target=read_and_send, args=(windows, numbers, sender)) for _, sender in pipes]
    for process in processes:
        process.start()
    assert all(receiver.poll(60) for receiver, _ in pipes), "another process does not answer"
    expected = [windows[number] for number in numbers]
    for receiver, _ in pipes:
        for (counts, error), (other_counts, other_error) in zip(expected, receiver.recv(), strict=True):
            assert np.array_equal(counts, other_counts)
            assert error == other_error
    for process in processes:
        process.join(60)
    assert sorted(path.suffix for path in windows.counts.iterdir()) == [".npy"] * 3


@pytest.mark.parametrize(
    ("options", "problem", "allowed"),
    [
        ({"split": "tain"}, "unknown split 'tain'", "all, test, train"),
        ({"window": 0}, "window is 0", "a whole number, at least 1, at most 1000"),
        ({"window": 1_001}, "window is 1001", "a whole number, at least 1, at most 1000"),
        ({"stride": 2.5}, "stride is 2.5", "a whole number, at least 1"),
        ({"target": "eror"}, "unknown target 'eror'", "blur, depth, error, position"),
    ],
)
def test_what_does_not_fit_is_refused(dataset, options, problem, allowed):
    error = refusal(lambda: SpikeWindows(dataset, **{"split": "all"} | options))
    assert (error.problem, error.allowed) == (problem, allowed)


def test_a_crop_and_a_truth_that_are_not_there_are_refused_when_they_are_read(dataset):
    assert refusal(lambda: SpikeWindows(dataset, "all", crop=(7, 9))[0]).allowed == "(1, 1) to (6, 9)"
    write_stream(dataset / "train/s0.h5", make_spikes(0))
    assert refusal(lambda: SpikeWindows(dataset, "all")[0]).problem == "does not state its true focus"
    assert SpikeWindows(dataset, "all", target=lambda stream, first, stop: 1.0)[0][1] == 1.0


def test_a_folder_for_counts_that_cannot_be_written_is_refused(dataset):
    (dataset / "file").touch()
    error = refusal(lambda: SpikeWindows(dataset, "all", counts=dataset / "file")[0])
    assert "cannot be written" in error.problem
    assert error.hint == "choose another folder"
