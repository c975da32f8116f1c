"""Networks in ONNX files run without the framework that trained them; other files are refused in one line."""

import sys

import numpy as np
import pytest
from refusals import refusal

from saf_gen.core.onnx_network import DECIMALS, OnnxNetwork


def pieces(*fields):
    """Return a protobuf message of (number, value) fields; values are integers, texts or the bytes of messages."""
    message = b""
    for number, value in fields:
        if isinstance(value, int):
            message += bytes([number << 3, value])
        else:
            value = value.encode() if isinstance(value, str) else value
            assert len(value) < 128
            message += bytes([number << 3 | 2, len(value)]) + value
    return message


def scaling_network(factor):
    """Return the bytes of an ONNX file in which output ``y`` (2) is input ``x`` (2) times a factor."""
    kind = pieces((1, pieces((1, 1), (2, pieces((1, pieces((1, 2))))))))  # tensor(float), shape (2)
    weight = pieces((2, 1), (8, "factor"), (9, np.float32(factor).tobytes()))
    node = pieces((1, "x"), (1, "factor"), (2, "y"), (4, "Mul"))
    ends = [(number, pieces((1, name), (2, kind))) for number, name in ((11, "x"), (12, "y"))]
    graph = pieces((1, node), (2, "scale"), (5, weight), *ends)
    return pieces((1, 8), (7, graph), (8, pieces((1, ""), (2, 13))))


@pytest.fixture
def scaling(tmp_path):
    pytest.importorskip("onnxruntime", reason="the extra onnx is not installed")
    (tmp_path / "scale.onnx").write_bytes(scaling_network(1 / 3))
    return OnnxNetwork(tmp_path / "scale.onnx")


def test_a_network_runs_and_its_outputs_are_rounded(scaling):
    (found,) = scaling(x=np.array([1, 3]))
    assert found.dtype == np.float64
    assert found.tolist() == [round(1 / 3, DECIMALS), 1]


def test_its_version_is_that_of_its_weights(scaling, tmp_path):
    (tmp_path / "other.onnx").write_bytes(scaling_network(1 / 4))
    (tmp_path / "same.onnx").write_bytes(scaling_network(1 / 3))
    versions = [OnnxNetwork(tmp_path / name).version for name in ("other.onnx", "same.onnx")]
    assert versions[0] != scaling.version == versions[1]


def test_a_file_or_input_that_cannot_run_is_one_line(scaling, tmp_path):
    (tmp_path / "text.onnx").write_text("no network")
    (tmp_path / "half.onnx").write_bytes(scaling_network(2)[:-20])
    for name in ("text.onnx", "half.onnx"):
        assert "is not a network that onnxruntime" in refusal(OnnxNetwork, tmp_path / name).problem
    assert "cannot be read" in refusal(OnnxNetwork, tmp_path / "none.onnx").problem
    for inputs in ({"x": np.zeros(3)}, {"z": np.zeros(2)}):
        with pytest.raises(RuntimeError, match=r"cannot be run: [^\n]*; export it again$"):
            scaling(**inputs)


def test_without_onnxruntime_the_extra_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    error = refusal(OnnxNetwork, tmp_path / "any.onnx")
    assert (error.problem, error.hint) == (
        "a network in an ONNX file needs the package onnxruntime",
        "pip install 'saf-gen[onnx]'",
    )
