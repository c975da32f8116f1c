"""The learned method of studies/learned, run from its weights without a framework."""

import shutil

import numpy as np
import pytest
from refusals import refusal
from small_dataset import HERE

from saf_gen import get_search
from saf_gen.benchmark.conformance._samples import SyntheticRecording, bell
from saf_gen.benchmark.method_spec import parse_method

LEARNED = HERE.parent / "studies" / "learned"
CURVES = f"{LEARNED}/running_curves.py:RunningCurves"


@pytest.fixture(autouse=True)
def _runtime():
    pytest.importorskip("onnxruntime", reason="the extra onnx is not installed")


@pytest.mark.parametrize("peak", [0.2, 0.7])
def test_running_curves_find_the_top_of_a_bell_and_stop_behind_it(peak):
    view = SyntheticRecording(bell(20_000, peak))
    answer = get_search(CURVES)(view)
    assert answer.frame == pytest.approx(peak * 20_000, abs=400)
    assert peak < view.seen / 20_000 < peak + 0.25


def test_running_curves_abstain_where_the_network_sees_no_focus_and_where_it_is_too_dark(monkeypatch):
    search = get_search(CURVES)
    monkeypatch.setattr(type(search), "_network", lambda self: lambda curves: [np.eye(101)[[-1]]])
    answer = search(SyntheticRecording(bell(4_000, 0.5)))
    assert (answer.frame, answer.note) == (None, "stopped after 4000 of 4000 frames: no focus in it")
    assert search(SyntheticRecording(np.zeros(4_000), light=0.0)).note == "too dark"


def test_other_weights_are_another_version_of_the_method(tmp_path):
    copy = tmp_path / "other.onnx"
    shutil.copy(LEARNED / "running_curves.onnx", copy)
    before = parse_method(f"sd+{CURVES}:weights={copy}").code
    assert parse_method(f"sd+{CURVES}:weights={copy}").code == before
    copy.write_bytes(copy.read_bytes().replace(b"pytorch", b"pytorcH"))  # one bit, in the producer's name
    assert parse_method(f"sd+{CURVES}:weights={copy}").code != before


def test_bad_options_and_weights_of_a_learned_method_are_refused_in_one_line(tmp_path):
    assert "cannot be read" in refusal(get_search, CURVES, weights=str(tmp_path / "none.onnx")).problem
    assert "sure is 1" in refusal(get_search, CURVES, sure=1).problem
    assert "too short for 100 steps" in refusal(get_search(CURVES), SyntheticRecording(np.ones(150))).problem
