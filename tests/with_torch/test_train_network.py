"""The worked example of training a network: how it finds the focus and, if PyTorch is installed, a complete run."""

import json
import sys

import numpy as np
import pytest
from windowed_dataset import FRAMES, TRUTH, make_windowed_dataset

import saf_gen
from saf_gen.benchmark.evaluate import evaluate


@pytest.fixture(scope="module")
def script():
    with pytest.MonkeyPatch.context() as patch:
        from studies.learned import train_network

        patch.setattr(train_network, "BOX", 8)
        yield train_network


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Three streams of noise, one per split, which are large enough to train with but teach nothing."""
    return make_windowed_dataset(tmp_path_factory.mktemp("noise"), (24, 24), splits=("train", "validation", "test"))


@pytest.mark.parametrize("focus", [0.25, 0.4, 0.72])
def test_the_focus_is_where_blurs_rise_to_both_sides(script, focus):
    """Blurs are too large near the focus, saturate far from it and scatter by 3 %; 20 draws, seed 0."""
    positions, random = np.linspace(0, 1, 80), np.random.default_rng(0)
    for _ in range(20):
        blurs = np.minimum(4 + 60 * np.abs(positions - focus), 16) * random.normal(1, 0.03, 80)
        assert script.find_focus(positions, blurs) == pytest.approx(focus, abs=0.01)


def test_a_network_learns_the_blur_in_pixels(script, dataset):
    """At both ends of the depth of focus, here 0.2 of the travel around 0.4, the blur is one pixel."""
    with saf_gen.open_stream(dataset / "train" / "s0.h5") as stream:
        blurs = [np.expm1(script.log_blur(stream, first, first + 100)) for first in (350, 450, 850)]
    assert blurs == pytest.approx([0, 1, 5], abs=0.01)


def test_predictions_are_judged_as_they_were_meant(script, dataset, tmp_path):
    """With the exact blurs the answer is the truth, to the grid of positions and frames."""
    middles = np.arange(0, FRAMES - 99, 50) + 50

    def tell(pictures):
        return 1 + 50 * np.abs(middles / (FRAMES - 1) - TRUTH)

    found = script.predict_split(dataset, "test", tell=tell, method="knows")
    (tmp_path / "lines.jsonl").write_text("".join(json.dumps(line) + "\n" for line, _, _ in found))
    result = evaluate(dataset, split="test", methods=["sd+argmax"], predictions=tmp_path / "lines.jsonl")
    (record,) = (r for r in result.records if r.method == "knows")
    assert record.error == pytest.approx(0, abs=0.002)
    assert script.judge(dataset, found, "test") == pytest.approx([record.error / 0.2], abs=1e-6)


def test_what_it_cannot_train_on_is_refused_in_one_line(script, dataset, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(script, "require_extra", lambda *names, of: None)
    made = make_windowed_dataset(tmp_path)
    for folder, problem in ((made, "has no split validation"), (tmp_path / "nowhere", "there is no such folder")):
        monkeypatch.setattr(sys, "argv", ["train_network.py", str(folder), "--out", str(tmp_path / "out")])
        with pytest.raises(SystemExit) as ended:
            script.main()
        assert ended.value.code == 2
        assert problem in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_small_run_writes_predictions_curve_and_weights(script, dataset, tmp_path, monkeypatch):
    pytest.importorskip("torch", reason="the extra torch is not installed")
    monkeypatch.setattr(sys, "argv", ["train_network.py", str(dataset), "--out", str(tmp_path), "--epochs", "1"])
    monkeypatch.setattr(script, "WORKERS", 0)
    script.main()
    assert {path.name for path in tmp_path.iterdir()} == {
        *(f"blur_net_{seed}.pt" for seed in (0, 1, 2)),
        *("curve.csv", "curve.png", "predictions.jsonl"),
    }
    result = evaluate(dataset, split="test", methods=["sd+argmax"], predictions=tmp_path / "predictions.jsonl")
    assert {r.method for r in result.records} == {"sd+argmax", "blur_net_0", "blur_net_1", "blur_net_2"}
    first = script.train(dataset, seed=1, epochs=1)[1]
    assert first == script.train(dataset, seed=1, epochs=1)[1] != script.train(dataset, seed=2, epochs=1)[1]
