"""Networks in ONNX files; only this module imports onnxruntime, which the extra ``onnx`` installs."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput

MAX_NETWORK_BYTES = 1 << 26
DECIMALS = 4
"""Decimals to which outputs are rounded, so that answers agree on processors that add in different orders."""


class OnnxNetwork:
    """A network that is read once from an ONNX file and run on one thread.

    Parameters
    ----------
    path : str or Path
        ONNX file of at most 64 MiB that contains all weights.

    Attributes
    ----------
    version : str
        First 12 digits of the SHA-256 of the file. If a search stores it in a field, its records contain it.

    Raises
    ------
    BadInput
        If onnxruntime is not installed, or the file is missing, too large or not a network.
    """

    def __init__(self, path: str | Path) -> None:
        require_extra("onnx", "onnxruntime", of="a network in an ONNX file")
        self.path, content = Path(path), _read(Path(path))
        self.version = hashlib.sha256(content).hexdigest()[:12]
        self._session = _load(content, str(path))

    def __call__(self, **inputs: np.ndarray) -> list[np.ndarray]:
        """Return the outputs of the network, in the order in which the network lists them.

        Parameters
        ----------
        **inputs : ndarray
            Inputs, under the names that the network gives them; they are converted to float32.

        Returns
        -------
        list of ndarray
            Floating-point outputs are float64, rounded to four decimals; others keep their dtype.

        Raises
        ------
        RuntimeError
            If the network cannot be run, for example because inputs have wrong names or shapes. A method that lets it
            pass has broken, which is not the same as a refused input.
        """
        with _in_one_line(f"{self.path} cannot be run", RuntimeError):
            found = self._session.run(None, {name: np.asarray(value, np.float32) for name, value in inputs.items()})
        return [each.astype(np.float64).round(DECIMALS) if each.dtype.kind == "f" else each for each in found]


def _read(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_NETWORK_BYTES:
            raise BadInput(f"{path} is larger than {MAX_NETWORK_BYTES >> 20} MiB", allowed="a small network")
        return path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}", allowed="a network in an ONNX file") from error


@lru_cache(maxsize=16)
def _load(content: bytes, where: str) -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    with _in_one_line(f"{where} is not a network that onnxruntime {onnxruntime.__version__} can read", BadInput):
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


@contextmanager
def _in_one_line(problem: str, kind: type[Exception]) -> Iterator[None]:
    """Turn exceptions of onnxruntime, which have no common base class, into one of a kind that is a single line."""
    try:
        yield
    except Exception as error:
        text = " ".join(str(error).split())
        raise kind(f"{problem}: {text[:200]}; export it again") from error
