"""Windows of spike counts as tensors."""

from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset, get_worker_info

from saf_gen.errors import BadInput
from saf_gen.stream import spike_windows


class SpikeWindows(spike_windows.SpikeWindows, Dataset):
    """Map-style dataset that returns windows as tensors, for any sampler and any number of workers.

    ``windows[i]`` is (counts, target): counts is a float32 tensor (1, h, w) of spikes per pixel; target is a float32
    tensor (), or (h, w) if it is the depth or the blur; if ``target`` is a function, it is its result. A
    ``torch.utils.data.DataLoader`` may fork or spawn its workers, even after windows have been read; what is a BadInput
    elsewhere is a RuntimeError with the same text in them. See :class:`saf_gen.SpikeWindows` for the parameters and
    errors.
    """

    def __getitem__(self, number: int) -> tuple[torch.Tensor, Any]:
        try:
            counts, target = super().__getitem__(number)
        except BadInput as error:
            if get_worker_info() is None:
                raise
            # The loader makes an error of the same type from the text of the traceback, of which BadInput keeps a line.
            raise RuntimeError(str(error)) from None
        return torch.from_numpy(counts), target if callable(self.target) else torch.from_numpy(np.asarray(target))
