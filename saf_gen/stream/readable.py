"""The interface of an open stream for code that describes, draws or scores it, however it is stored."""

from typing import Protocol

import numpy as np

from saf_gen.core.object_store import AnyPath
from saf_gen.core.region import Region
from saf_gen.stream.metadata import Metadata, Truth


class ReadableStream(Protocol):
    """An open recording and its metadata, such as a :class:`saf_gen.stream.stream_file.SpikeStream`."""

    path: AnyPath
    shape: tuple[int, int, int]
    readout_hz: float
    content_sha256: str
    metadata: Metadata
    truth: Truth
    focus_position: np.ndarray | None
    gain: np.ndarray | None
    light_names: tuple[str, ...]

    def frames(self, first: int, stop: int, *, region: Region | None = None) -> np.ndarray: ...

    def counts(self, first: int, stop: int, *, region: Region | None = None) -> np.ndarray: ...

    def packed(self, first_byte: int, stop_byte: int, *, region: Region | None = None) -> np.ndarray: ...
