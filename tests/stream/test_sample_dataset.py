"""The dataset in the package."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

import saf_gen
from saf_gen.benchmark.gym import AutofocusEnv
from saf_gen.benchmark.records import read_records
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.stack.capture import Capture
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.sample_dataset import find_data

ROOT = Path(__file__).resolve().parents[2]


def test_the_sample_is_small_intact_and_made_by_its_recipe(call):
    folder = saf_gen.sample()
    assert folder == ROOT / "datasets/sample"
    sizes = {path: path.stat().st_size for path in folder.rglob("*") if path.is_file()}
    assert sum(sizes.values()) <= 2_900_000  # the wheel stays below 7 MB
    code, out, _ = call("verify", folder)
    assert (code, "3 of 3 sequences are intact" in out) == (0, True)
    recipe = yaml.safe_load((ROOT / "recipes/sample.yaml").read_text())
    lights = {entry.light for entry in read_manifest(folder).sequences}
    assert lights == set(recipe["lights"])
    for path in sorted((folder / "test").glob("*.h5")):
        with saf_gen.open_stream(path) as stream:
            assert stream.shape == (recipe["camera"]["frames"], 128, 128)
            assert 0.4 < stream.truth.position < 0.7
            Capture.from_stream(stream, folder / "stacks")  # refuses other stacks than those it was made from


@pytest.mark.slow
def test_the_recordings_are_those_that_the_recipe_makes_of_the_stack(tmp_path):
    """From the stack, which is not rendered again: the notes say which recipe it belongs to."""
    folder = tmp_path / "sample"
    shutil.copytree(saf_gen.sample() / "stacks", folder / "stacks")
    outcome = generate(resolve_recipe(ROOT / "recipes/sample.yaml"), folder)
    assert outcome.rendered == []
    for path in sorted(folder.rglob("*.h5")):
        with saf_gen.open_stream(path) as made, saf_gen.open_stream(saf_gen.sample() / "test" / path.name) as kept:
            assert made.content_sha256 == kept.content_sha256


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


@pytest.mark.slow
def test_a_camera_can_focus_on_the_sample_for_longer_than_it_was_recorded(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    loop = ("evaluate", "sample", "--track", "closed_loop", "--method", "sd+golden_section")
    code, _, err = call(*loop, "--budget", "1000")
    assert code == 0, err
    records = read_records(tmp_path / "sample-evaluation-closed-loop")
    assert {record.what.frames for record in records} == {20_000}
    assert all(abs(record.judgement.error_dof) <= 1 for record in records)


@pytest.mark.slow
def test_other_cameras_record_the_sample_into_the_current_folder(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = sorted(saf_gen.sample().rglob("*"))
    code, out, err = call("recapture", "sample", "--sensor", "davis346")
    assert code == 0, err
    assert "next: saf-gen evaluate sample-davis346" in out
    assert len(list((tmp_path / "sample-davis346/test").glob("*.h5"))) == 3
    assert sorted(saf_gen.sample().rglob("*")) == before


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (("export", "sample", "--out", "saf", "--for", "saf"), "128"),
        (("paper", "sample"), "no dynamic scene; allowed"),
        (("verify", "sample"), ""),
    ],
)
def test_whatever_takes_a_dataset_takes_its_name(call, tmp_path, monkeypatch, command, said):
    monkeypatch.chdir(tmp_path)
    code, _, err = call(*command)
    assert code == (2 if said else 0)
    assert said in err
    assert "no such" not in err.lower()
    assert "does not exist" not in err


@pytest.mark.slow
def test_a_policy_trains_on_the_sample():
    env = AutofocusEnv(saf_gen.sample(), control_s=0.005)
    observation, _ = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    *_, info = env.step(np.array([0.58, 1.0], np.float32))
    assert info["status"] == "answered"
