"""The training of the learned methods: labels, network inputs and, if PyTorch is installed, a complete run."""

import sys
from importlib import import_module

import numpy as np
import pytest
from small_dataset import HERE
from windowed_dataset import make_windowed_dataset

LEARNED = HERE.parent / "studies" / "learned"


def training_script(name):
    @pytest.fixture(scope="module")
    def script():
        with pytest.MonkeyPatch.context() as patch:
            patch.syspath_prepend(LEARNED)
            yield import_module(name)

    return script


curves, shot = training_script("train_running_curves"), training_script("train_single_shot")


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


def test_soft_ordinal_labels_are_highest_at_the_distance_and_alike_on_both_sides_of_a_bin(shot):
    torch = pytest.importorskip("torch", reason="the extra train is not installed")
    centres = shot.method.CENTRES
    found = shot.label(torch.sinh(torch.tensor([centres[20], -centres[20]], dtype=torch.float32))).numpy()
    assert found.sum(axis=1) == pytest.approx(1)
    assert list(found.argmax(axis=1)) == [20, 8]
    assert found[0, 19] == pytest.approx(found[0, 21], rel=1e-4)
    assert np.allclose(found[0], found[1, ::-1], atol=1e-5)


def test_the_network_that_is_exported_measures_windows_as_its_training_does(shot):
    torch = pytest.importorskip("torch", reason="the extra train is not installed")
    random = np.random.default_rng(7)
    windows = random.poisson(8.0, (2, 6, 2, 64, 64)).astype(np.float32) / 8
    found = shot.measure_windows(windows)
    energies = [*found["alone"], found["both"][0, 1], *found["noise"]]
    network = shot.make_network().eval()
    apart = torch.tensor([[0.3]])
    with torch.inference_mode():
        trained = torch.softmax(network.score(torch.from_numpy(np.stack(energies))[None], apart), 2)[0]
        exported = network(torch.from_numpy(np.concatenate(windows, axis=1))[None], apart)
    assert np.allclose(trained, torch.cat(exported), atol=1e-5)


def test_a_small_network_trains_alike_with_the_same_seed(shot, dataset):
    for package in ("torch", "onnxscript"):
        pytest.importorskip(package, reason="the extra train is not installed")
    keep = dataset / "windows"
    noise = {split: shot.read_examples(dataset, split, keep=keep) for split in ("train", "validation")}
    assert len(list(keep.glob("*.npz"))) == 2
    again = {split: shot.read_examples(dataset, split, keep=keep) for split in ("train", "validation")}
    assert np.array_equal(noise["train"][0]["both"], again["train"][0]["both"])
    first = shot.train(noise, seed=1, epochs=1).rows
    assert first == shot.train(noise, seed=1, epochs=1).rows != shot.train(noise, seed=2, epochs=1).rows
