"""Windows of a dataset for training: counts and targets as stored, counted once, and read in any order."""

import json
import multiprocessing
import pickle
from dataclasses import replace

import h5py
import numpy as np
import pytest
from isal import isal_zlib
from refusals import assert_says, refusal
from windowed_dataset import FRAMES, SHAPE, TRUTH, list_windowed, make_spikes, make_truth, make_windowed_dataset

from saf_gen import SpikeWindows
from saf_gen.stream import time_blocks
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.stream_writer import write_stream


@pytest.fixture
def dataset(tmp_path, monkeypatch):
    """Three sequences of 1,000 frames in blocks of 64 frames; two are for training."""
    monkeypatch.setattr(time_blocks, "TIME_BLOCK_BYTES", 8)
    return make_windowed_dataset(tmp_path)


@pytest.mark.slow
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
    list_windowed(dataset)
    assert SpikeWindows(dataset, "all", window=100, target="position")[4][1] == track[450]
    assert SpikeWindows(dataset, "all", window=100)[4][1] == pytest.approx(track[450] - position[450])


def read_all(windows, seed=0):
    return [windows[number] for number in np.random.default_rng(seed).permutation(len(windows))]


def test_each_stream_is_inflated_once_whatever_the_order_and_however_often(dataset, monkeypatch):
    inflated = []
    inflater = isal_zlib.decompressobj
    monkeypatch.setattr(isal_zlib, "decompressobj", lambda *args: inflated.append(1) or inflater(*args))
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


def replace_stream(dataset):
    position = np.zeros(FRAMES, np.float32)
    write_stream(dataset / "train/s0.h5", make_spikes(9), focus_position=position, truth=make_truth())


def test_a_stream_that_was_replaced_is_counted_again_once_the_manifest_lists_it(dataset):
    before, _ = SpikeWindows(dataset, "all", window=100)[0]
    replace_stream(dataset)
    list_windowed(dataset)
    after, _ = SpikeWindows(dataset, "all", window=100)[0]
    assert np.array_equal(after[0], make_spikes(9)[:100].sum(axis=0))
    assert not np.array_equal(after, before)


def shorten(dataset):
    write_stream(dataset / "train/s0.h5", make_spikes(0)[:500], truth=make_truth())


def change_file(change):
    def of_dataset(dataset):
        with h5py.File(dataset / "train/s0.h5", "r+") as file:
            change(file)

    return of_dataset


def move_the_lens(file):
    del file.attrs["spikes_sha256"]  # with which opening the file would tell
    file["focus/position"][:5] = 0.5


REPLACED = {
    "another stream": (replace_stream, "as in manifest.json"),
    "a shorter stream": (shorten, "holds 500 frames | 1000 frames"),
    "no spikes": (change_file(lambda file: file["spikes"].__setitem__(..., 0)), "the content has SHA-256"),
    "one other spike": (
        change_file(lambda file: file["spikes"].__setitem__((5, 8, 124), 7)),
        "the content has SHA-256",
    ),
    "another way of the lens": (change_file(move_the_lens), "the content has SHA-256"),
}


@pytest.mark.parametrize("listed", [True, False])
@pytest.mark.parametrize("crop", [None, (2, 2)])
@pytest.mark.parametrize("kind", REPLACED)
def test_a_stream_that_is_not_the_one_of_the_manifest_is_refused(dataset, kind, crop, listed):
    """Even if what differs is not in the windows that are counted; nothing is kept of it."""
    change, words = REPLACED[kind]
    if not listed:  # as if the streams were links
        document = json.loads((dataset / "manifest.json").read_text()) | {"files": []}
        del document["checksum"]
        (dataset / "manifest.json").write_text(json.dumps(document))
    change(dataset)
    windows = SpikeWindows(dataset, "all", window=100, stride=400, crop=crop, target="position")
    assert_says(refusal(windows.__getitem__, 0), f"train/s0.h5 | {words}")
    assert not windows.counts.exists()
    assert windows[3][1] == np.float32(TRUTH)  # of the next recording


def test_a_stream_that_is_replaced_after_it_was_counted_is_refused_too(dataset):
    SpikeWindows(dataset, "all", window=100)[0]
    replace_stream(dataset)
    assert_says(refusal(SpikeWindows(dataset, "all", window=100).__getitem__, 0), "train/s0.h5 | as in manifest.json")


def test_counts_that_were_zeroed_behind_their_header_are_refused(dataset):
    """tests/stream/test_count_cache.py: any other change of the file."""
    windows = SpikeWindows(dataset, "all", window=100, crop=(4, 5))
    assert sum(windows[number][0].sum() for number in range(10)) == make_spikes(0)[:, 0:4, 4:9].sum()
    (file,) = windows.counts.glob("s0-*.npy")
    data = file.read_bytes()
    file.write_bytes(data[:128] + bytes(10 * 20) + data[128 + 10 * 20 :])
    for again in (windows, SpikeWindows(dataset, "all", window=100, crop=(4, 5))):
        assert_says(refusal(again.__getitem__, 0), f"{file} | delete the file")
    file.unlink()
    assert SpikeWindows(dataset, "all", window=100, crop=(4, 5))[0][0].sum() > 0


@pytest.mark.parametrize("number", [slice(0, 3), [0, 1], (0, 1), 1.5, "0", None, ..., np.arange(3)])
def test_a_number_of_a_window_that_is_none_is_one_line(dataset, number):
    windows = SpikeWindows(dataset, "all", window=100)
    assert_says(refusal(windows.__getitem__, number), f"{dataset}: the number of a window is | a whole number below 30")


def test_a_loop_over_windows_ends_behind_the_last(dataset):
    windows = SpikeWindows(dataset, "all", window=100)
    assert len(list(windows)) == 30
    assert np.array_equal(windows[np.int64(-1)][0], windows[29][0])
    for number in (30, -31):
        with pytest.raises(IndexError, match=f"^{dataset}: the number of a window is {number}; allowed: .* below 30$"):
            windows[number]


@pytest.mark.parametrize(
    "crop", [5, (5,), (5, 5, 5), (2.5, 2), (0, 1), (-1, 1), (7, 9), "45", {}, (None, 1), np.ones(2)]
)
def test_a_crop_that_does_not_fit_is_one_line_that_names_the_recording(dataset, crop):
    error = refusal(SpikeWindows(dataset, "all", crop=crop).__getitem__, 0)
    assert (error.where, error.allowed) == (str(dataset / "train/s0.h5"), "(1, 1) to (6, 9)")
    assert error.problem.startswith("crop is ")


def test_windows_of_the_sample_are_had_by_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert len(SpikeWindows("sample", window=50, counts=tmp_path)) == 3 * 12


@pytest.mark.parametrize("crop", [[4, 5], np.array([4, 5])])
def test_a_crop_may_be_any_pair_of_whole_numbers(dataset, crop):
    assert SpikeWindows(dataset, "all", crop=crop)[0][0].shape == (1, 4, 5)


def test_a_recording_that_is_shorter_than_a_window_is_named(dataset):
    write_stream(dataset / "train/s1.h5", make_spikes(1)[:60], truth=make_truth())
    list_windowed(dataset)
    error = refusal(SpikeWindows, dataset, "all", window=61)
    assert (error.where, error.problem) == (str(dataset / "train/s1.h5"), "window is 61")
    assert error.allowed == "a whole number, at least 1, at most 60"
    assert len(SpikeWindows(dataset, "test", window=61)) == 16


def test_a_dataset_without_recordings_is_refused(tmp_path):
    assert_says(refusal(SpikeWindows, list_windowed(tmp_path)), f"{tmp_path}: holds no recordings")


def test_half_written_counts_are_not_used(dataset, monkeypatch):
    windows = SpikeWindows(dataset, "all", window=100, counts=dataset / "elsewhere")
    expected = windows[3]
    (file,) = (dataset / "elsewhere").glob("*.npy")
    file.write_bytes(file.read_bytes()[:-1])
    assert np.array_equal(SpikeWindows(dataset, "all", window=100, counts=dataset / "elsewhere")[3][0], expected[0])
    file.unlink()

    inflater, inflated = isal_zlib.decompressobj, []

    def stop(*args):
        inflated.append(1)
        if len(inflated) == 3:
            raise KeyboardInterrupt
        return inflater(*args)

    again = SpikeWindows(dataset, "all", window=100, counts=dataset / "elsewhere")
    with monkeypatch.context() as patch:
        patch.setattr(isal_zlib, "decompressobj", stop)
        with pytest.raises(KeyboardInterrupt):
            again[3]
    assert not list((dataset / "elsewhere").iterdir())
    assert np.array_equal(again[3][0], expected[0])


def read_and_send(windows, numbers, pipe):
    pipe.send([windows[number] for number in numbers])


@pytest.mark.slow
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


def test_a_truth_that_is_not_there_is_refused_when_it_is_read(dataset):
    write_stream(dataset / "train/s0.h5", make_spikes(0))
    list_windowed(dataset)
    assert refusal(lambda: SpikeWindows(dataset, "all")[0]).problem == "does not state its true focus"
    assert SpikeWindows(dataset, "all", target=lambda stream, first, stop: 1.0)[0][1] == 1.0


def test_a_folder_for_counts_that_cannot_be_written_is_refused(dataset):
    (dataset / "file").touch()
    error = refusal(lambda: SpikeWindows(dataset, "all", counts=dataset / "file")[0])
    assert "cannot be written" in error.problem
    assert error.hint == "choose another folder"
