"""PyTorch support: windows of spike counts as tensors for data loaders, and networks as policies of the closed loop.

>>> from saf_gen.torch import SpikeWindows  # doctest: +SKIP
>>> windows = SpikeWindows("datasets/lessons", "train", window=100)  # doctest: +SKIP

This module needs the extra ``torch``; no other part of the package does.
"""

from saf_gen.core.extras import require_extra

require_extra("torch", "torch", of="saf_gen.torch")

from saf_gen.torch.policy import NetworkPolicy, digest_weights  # noqa: E402 the line above reports a missing package
from saf_gen.torch.windows import SpikeWindows  # noqa: E402

__all__ = ["NetworkPolicy", "SpikeWindows", "digest_weights"]
