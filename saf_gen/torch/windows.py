"""Windows of spike counts as tensors."""

from typing import Any

import torch
from torch.utils.data import Dataset

from saf_gen.stream import spike_windows


class SpikeWindows(spike_windows.SpikeWindows, Dataset):
    """:class:`saf_gen.SpikeWindows` as a map-style dataset of tensors, for any sampler and any number of workers.

    ``windows[i]`` is (counts, target): counts float32 (1, h, w), spikes per pixel; the target float32 (), or what a
    function of your own returns. A ``torch.utils.data.DataLoader`` may fork or spawn its workers, also after windows
    were read. Parameters and errors are those of :class:`saf_gen.SpikeWindows`.
    """

    def __getitem__(self, number: int) -> tuple[torch.Tensor, Any]:
        counts, target = super().__getitem__(number)
        return torch.from_numpy(counts), target if callable(self.target) else torch.tensor(float(target))
