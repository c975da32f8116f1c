"""Windows as tensors, in loaders with forked or spawned workers; all tests except the last need PyTorch."""

import subprocess
import sys

import numpy as np
import pytest
from refusals import refusal
from windowed_dataset import SHAPE, make_windowed_dataset

import saf_gen


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    pytest.importorskip("torch", reason="the extra torch is not installed")
    return make_windowed_dataset(tmp_path_factory.mktemp("windows"))


def mean_of_stream(stream, first, stop):
    return stream.counts(first, stop).mean()


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # since Python 3.12, in a process that has threads
@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_a_loader_reads_streams_that_its_parent_had_opened_and_read(dataset, method):
    """A stream that was read before a fork used to hang the child, and no stream could be pickled."""
    from torch.utils.data import DataLoader

    from saf_gen.torch import SpikeWindows

    windows = SpikeWindows(dataset, "train", window=100, target=mean_of_stream)
    expected = [(counts.numpy(), float(mean)) for counts, mean in (windows[number] for number in range(len(windows)))]
    loader = DataLoader(windows, batch_size=8, num_workers=2, multiprocessing_context=method, timeout=60)
    batches = list(loader)
    assert [len(counts) for counts, _ in batches] == [8, 8, 4]
    assert np.array_equal(np.concatenate([counts for counts, _ in batches]), [counts for counts, _ in expected])
    assert np.array_equal(np.concatenate([means for _, means in batches]), [mean for _, mean in expected])


def test_tensors_are_the_arrays(dataset):
    import torch

    from saf_gen.torch import SpikeWindows

    arrays, tensors = saf_gen.SpikeWindows(dataset, "all", window=100), SpikeWindows(dataset, "all", window=100)
    assert len(tensors) == len(arrays) == 30
    for number in (0, 7, 29):
        (counts, error), (array, value) = tensors[number], arrays[number]
        assert (counts.dtype, counts.shape, error.dtype, error.shape) == (torch.float32, (1, *SHAPE), torch.float32, ())
        assert np.array_equal(counts, array)
        assert float(error) == value


def test_an_error_in_a_worker_of_a_loader_keeps_its_reason(dataset):
    from torch.utils.data import DataLoader

    from saf_gen.torch import SpikeWindows

    windows = SpikeWindows(dataset, "all", crop=(500, 500))
    assert refusal(windows.__getitem__, 0).problem == "crop is (500, 500)"
    with pytest.raises(RuntimeError, match=r"crop is \(500, 500\); allowed: \(1, 1\) to"):
        next(iter(DataLoader(windows, num_workers=1)))


def test_tensors_arrays_and_environment_refuse_several_splits_in_the_same_words(dataset):
    pytest.importorskip("gymnasium", reason="the extra gym is not installed")
    from saf_gen.benchmark.gym import AutofocusEnv
    from saf_gen.torch import SpikeWindows

    error = refusal(SpikeWindows, dataset)
    assert (error.problem, error.allowed) == ("no split is given", "train, test, or all")
    assert str(refusal(saf_gen.SpikeWindows, dataset)) == str(refusal(AutofocusEnv, dataset)) == str(error)
    assert {window.sequence.id for window in SpikeWindows(dataset, "train").windows} == {"s0", "s1"}


def test_without_torch_one_line_says_what_to_install():
    code = (
        "import sys\n"
        "sys.modules['torch'] = None\n"
        "from saf_gen.errors import BadInput\n"
        "try: import saf_gen.torch\n"
        "except BadInput as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "saf_gen.torch needs the package torch; pip install 'saf-gen[torch]'\n"
