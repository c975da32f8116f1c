"""Networks in ONNX files: the one door to onnxruntime, which the extra ``onnx`` brings."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput

MAX_BYTES = 1 << 26
DECIMALS = 4
"""Outputs are rounded to these: processors sum in another order, and an answer is to be the same on all of them."""


class OnnxNetwork:
    """A network that is read from an ONNX file once, and run on one thread.

    Parameters
    ----------
    path : the file, at most 64 MiB, with all weights in it.

    Attributes
    ----------
    version : 12 digits of a SHA-256 over the file. A search that keeps it in a field has it in its records.

    Raises
    ------
    BadInput : without onnxruntime, and for a file that is missing, too large or no network.
    """

    def __init__(self, path: str | Path) -> None:
        require_extra("onnx", "onnxruntime", of="a network in an ONNX file")
        self.path, content = Path(path), _read(Path(path))
        self.version = hashlib.sha256(content).hexdigest()[:12]
        self._session = _load(content, str(path))

    def __call__(self, **inputs: np.ndarray) -> list[np.ndarray]:
        """Return the outputs, in the network's order, for its inputs by name, which are given as float32.

        Floating outputs are float64, rounded to four decimals. Raises BadInput for inputs of other names or shapes.
        """
        with _told(f"{self.path} does not run"):
            found = self._session.run(None, {name: np.asarray(value, np.float32) for name, value in inputs.items()})
        return [each.astype(np.float64).round(DECIMALS) if each.dtype.kind == "f" else each for each in found]


def _read(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise BadInput(f"{path} is larger than {MAX_BYTES >> 20} MiB", allowed="a small network")
        return path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}", allowed="a network in an ONNX file") from error


@lru_cache(maxsize=16)
def _load(content: bytes, where: str) -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    with _told(f"{where} is no network that onnxruntime {onnxruntime.__version__} reads"):
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


@contextmanager
def _told(problem: str) -> Iterator[None]:
    """Turn what onnxruntime raises, exceptions of its own without a common class, into one line."""
    try:
        yield
    except Exception as error:
        text = " ".join(str(error).split())
        raise BadInput(f"{problem}: {text[:200]}", hint="export it again") from error
