"""The learned methods of studies/learned, run from their weights without a framework."""

import shutil
import sys

import numpy as np
import pytest
from ideal_camera import IdealCamera, bell_curve
from refusals import refusal
from scipy.ndimage import gaussian_filter
from small_dataset import HERE

from saf_gen import get_search
from saf_gen.benchmark.conformance._samples import SyntheticRecording, bell
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.core.seeds import make_generator

LEARNED = HERE.parent / "studies" / "learned"
CURVES = f"{LEARNED}/running_curves.py:RunningCurves"
POLICY = f"{LEARNED}/policy.py:Policy"
SHOT = f"{LEARNED}/single_shot.py:SingleShot"


class TexturedCamera(IdealCamera):
    """Sees texture of five octaves, whose blur is two pixels wide at one depth of focus from ``focus``."""

    def __init__(self, focus, *, depth=0.06, rate=0.2, shape=(80, 120), **more):
        super().__init__(None, sensor=0.0, lag_s=0.0, speed=50.0, **more)
        self._random = make_generator("textured camera")
        octaves = [gaussian_filter(self._random.normal(size=shape), 0.7 * 2**k, mode="wrap") for k in range(5)]
        self._texture = sum(each / each.std() for each in octaves) / 5
        self._focus, self._depth, self._rate = focus, depth, rate

    def counts(self, first, stop):
        self.wait(max(stop - self.now, 0))
        away = abs(np.mean(self.positions[first:stop]) - self._focus) / self._depth
        blurred = gaussian_filter(self._texture, 0.5 * away, mode="wrap")
        return self._random.poisson(self._rate * (stop - first) * np.clip(1 + 0.8 * blurred, 0, None)).astype(np.uint32)


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
    assert "sure is 0" in refusal(get_search, SHOT, sure=0).problem
    assert "looks is 2" in refusal(get_search, SHOT, looks=2).problem
    assert "step is 1.5" in refusal(get_search, SHOT, step=1.5).problem
    assert "cannot" in refusal(get_search(SHOT), SyntheticRecording(np.ones(4_000))).problem
    assert "too short for 100 steps" in refusal(get_search(CURVES), SyntheticRecording(np.ones(150))).problem


@pytest.mark.parametrize(("start", "focus"), [(0.1, 0.5), (0.9, 0.6)])
def test_single_shot_sends_the_lens_to_the_focus_from_either_side(start, focus):
    answer = get_search(SHOT)(TexturedCamera(focus, start=start))
    assert answer.position == pytest.approx(focus, abs=0.06)  # one depth of focus; the noise has a fixed seed
    assert answer.trace[2] == pytest.approx(focus, abs=0.1)  # the first command
    assert 3 <= len(answer.trace) <= 7


def test_single_shot_abstains_in_the_dark_and_where_the_time_is_too_short_for_two_looks():
    search = get_search(SHOT)
    assert search(TexturedCamera(0.5, rate=0.0)).note == "too dark"
    answer = search(TexturedCamera(0.5, frames=300))
    assert (answer.position, answer.note) == (None, "out of frames before the second look")


def test_single_shot_weighs_what_all_pairs_say_and_finds_a_focus_that_no_look_was_at():
    """With a network that gives the true distances, for a depth of focus of 0.06, the focus is found within a bin."""
    search = get_search(SHOT)
    module = sys.modules[type(search).__module__]
    bins = np.arcsinh((0.42 - np.array([[0.2], [0.3]])) / 0.06)
    chances = np.exp(-((bins - module.CENTRES) ** 2) / 0.02)[:, None]
    belief = module.Belief(lambda windows, apart: chances)
    for position in (0.2, 0.3):
        belief.add(position, np.zeros((6, 2, 64, 64), np.float32))
    assert belief.weigh().sum() == pytest.approx(1)
    assert belief.find_focus()[0] == pytest.approx(0.42, abs=0.02)


class LitCamera(IdealCamera):
    """A camera with an ideal lens that sees four spikes per pixel in 20 frames."""

    def counts(self, first, stop):
        self.wait(max(stop - self.now, 0))
        return np.full((4, 4), (stop - first) // 5)


@pytest.mark.parametrize(("peak", "start"), [(0.5, 0.1), (0.7, 0.9)])
def test_the_policy_ends_at_the_top_of_a_bell_within_its_time(peak, start):
    curve = bell_curve(peak)
    camera = LitCamera(curve, start=start, frames=4_000, speed=50.0, others={"sd_calibrated": curve})
    answer = get_search(POLICY)(camera)
    assert answer.position == pytest.approx(peak, abs=0.04)
    assert answer.trace[-1] == answer.position
    assert camera.now <= 4_000


def test_the_policy_abstains_where_there_is_no_time_to_look_twice_and_moves_no_recording():
    search = get_search(POLICY)
    assert search(LitCamera(bell_curve(0.5), frames=200)).note == "no time to look twice"
    assert "recording" in refusal(search, SyntheticRecording(np.ones(4_000))).problem
