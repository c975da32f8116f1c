"""Windows of spike counts as tensors."""

from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from saf_gen.stream import spike_windows


class SpikeWindows(spike_windows.SpikeWindows, Dataset):
    """Map-style dataset that returns windows as tensors, for any sampler and any number of workers.

    ``windows[i]`` is (counts, target): counts is a float32 tensor (1, h, w) of spikes per pixel; target is a float32
    tensor (), or (h, w) if it is the depth or the blur; if ``target`` is a function, it is its result. A
    ``torch.utils.data.DataLoader`` may fork or spawn its workers, even after windows have been read. See
    :class:`saf_gen.SpikeWindows` for the parameters and errors.
    """

    def __getitem__(self, number: int) -> tuple[torch.Tensor, Any]:
        counts, target = super().__getitem__(number)
        return torch.from_numpy(counts), target if callable(self.target) else torch.from_numpy(np.asarray(target))
