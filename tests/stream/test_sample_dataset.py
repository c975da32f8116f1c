"""The dataset in the package."""

from pathlib import Path

import pytest
import yaml

import saf_gen
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.sample_dataset import find_data

ROOT = Path(__file__).resolve().parents[2]


def test_the_sample_is_small_intact_and_made_by_its_recipe(call):
    folder = saf_gen.sample()
    assert folder == ROOT / "datasets/sample"
    assert sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) <= 3_000_000
    code, out, _ = call("verify", folder)
    assert (code, "3 of 3 sequences are intact" in out) == (0, True)
    recipe = yaml.safe_load((ROOT / "recipes/sample.yaml").read_text())
    lights = {entry.light for entry in read_manifest(folder).sequences}
    assert lights == set(recipe["lights"])
    for path in sorted((folder / "test").glob("*.h5")):
        with saf_gen.open_stream(path) as stream:
            assert stream.shape == (recipe["camera"]["frames"], 128, 128)
            assert 0.4 < stream.truth.position < 0.7


@pytest.mark.slow
def test_the_sample_is_evaluated_by_its_name_and_written_to_the_current_folder(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = sorted(saf_gen.sample().rglob("*"))
    code, out, err = call("evaluate", "sample", "--method", "sd_code+egs_code")
    assert code == 0, err
    assert "100%" in out
    assert (tmp_path / "sample-evaluation/index.html").is_file()
    assert sorted(saf_gen.sample().rglob("*")) == before


def test_a_name_stands_for_a_folder_in_datasets_unless_something_is_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "datasets/quick").mkdir(parents=True)
    assert find_data(Path("quick")) == Path("datasets/quick")
    assert find_data(Path("sample")) == saf_gen.sample()
    for left in ("slow", "elsewhere/quick"):
        assert find_data(Path(left)) == Path(left)
    (tmp_path / "quick").mkdir()
    assert find_data(Path("quick")) == Path("quick")


def test_a_folder_of_that_name_goes_before_the_sample(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sample").mkdir()
    code, _, err = call("evaluate", "sample")
    assert code == 2
    assert "manifest.json" in err


def test_the_sample_has_no_closed_loop(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = call("evaluate", "sample", "--track", "closed_loop", "--method", "sd+golden_section")
    assert code == 2
    assert "stacks" in err
    assert not (tmp_path / "sample-evaluation-closed-loop/records.jsonl").exists()
