"""The training of the learned method: labels, network inputs and, if PyTorch is installed, a complete run."""

import sys
from importlib import import_module

import numpy as np
import pytest
from small_dataset import HERE
from windowed_dataset import make_windowed_dataset

LEARNED = HERE.parent / "studies" / "learned"


@pytest.fixture(scope="module")
def curves():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(LEARNED)
        yield import_module("train_running_curves")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Three streams of noise, which are large enough to train with but teach nothing."""
    return make_windowed_dataset(tmp_path_factory.mktemp("noise"), (24, 24), splits=("train", "validation", "test"))


def rows_of_sweep(first, last, *, peak=0.4, windows=50):
    """Return the rows of a sweep with four equal curves, each a bell over positions."""
    rows = np.ones((windows, 9))
    rows[:, 0], rows[:, 1] = np.arange(windows), np.linspace(first, last, windows)
    rows[:, 5:] = np.exp(-(((rows[:, 1:2] - peak) / 0.1) ** 2))
    return rows


def test_the_focus_is_labelled_where_the_lens_passed_it_and_else_as_not_there_yet(curves):
    target = curves.label(rows_of_sweep(0, 1), 0.4, 0.05)
    assert target.sum() == pytest.approx(1)
    assert np.average(np.linspace(0, 1, 50), weights=target[:50]) == pytest.approx(0.4, abs=0.005)
    assert target[:50][np.abs(np.linspace(0, 1, 50) - 0.4) > 0.05].sum() < 0.05
    assert curves.label(rows_of_sweep(0, 0.3), 0.4, 0.05)[-1] == 1
    assert curves.label(rows_of_sweep(1, 0.45), 0.4, 0.05)[-1] == 1
    assert curves.label(rows_of_sweep(0, 0.39), 0.4, 0.05)[-1] == 0  # it rests within half a depth of focus


def test_a_network_sees_curves_alike_in_any_unit_and_anywhere_in_the_travel(curves):
    rows = rows_of_sweep(0, 0.5)
    other = rows_of_sweep(0.4, 0.9, peak=0.8)
    other[:, 5] *= 1024
    seen, again = curves.method.describe_curves(rows), curves.method.describe_curves(other)
    assert seen.shape == (curves.CHANNELS, curves.method.STEPS)
    assert np.allclose(seen, again, atol=1e-5)
    assert not seen[:, 50:].any()


def test_what_cannot_be_trained_on_is_refused_in_one_line(curves, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("training.require_extra", lambda *names, of: None)
    monkeypatch.setattr(sys, "argv", ["train", str(make_windowed_dataset(tmp_path)), "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        curves.run(curves.main, "train_running_curves")
    assert ended.value.code == 2
    assert "has no split validation" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_created_is_refused_before_the_training(curves, dataset, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("training.require_extra", lambda *names, of: None)
    monkeypatch.setattr(curves, "read_examples", lambda *names, **more: pytest.fail("training has started"))
    (tmp_path / "file").touch()
    monkeypatch.setattr(sys, "argv", ["train", str(dataset), "--out", str(tmp_path / "file" / "out")])
    with pytest.raises(SystemExit) as ended:
        curves.run(curves.main, "train_running_curves")
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "Not a directory" in line
    assert "name a folder that can be created" in line


def test_a_small_run_writes_weights_that_the_method_runs(curves, dataset, tmp_path, monkeypatch):
    for package in ("torch", "onnxscript", "onnxruntime"):
        pytest.importorskip(package, reason="the extra train is not installed")
    out = tmp_path / "new"
    monkeypatch.setattr(sys, "argv", ["train", str(dataset), "--out", str(out), "--epochs", "1", "--seeds", "0"])
    curves.main()
    names = {"running_curves.csv", "running_curves.md", "running_curves.onnx", "running_curves.png"}
    assert {path.name for path in out.iterdir()} == names
    card = (out / "running_curves.md").read_text()
    assert "Seed 0 has the most successes" in card
    assert "| seed 0 |" in card
    noise = {split: curves.read_examples(dataset, split, keep=dataset / "curves") for split in ("train", "validation")}
    first = curves.train(noise, seed=1, epochs=1).rows
    assert first == curves.train(noise, seed=1, epochs=1).rows != curves.train(noise, seed=2, epochs=1).rows
