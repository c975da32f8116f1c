"""Frozen benchmarks: a published recipe keeps its digest, and results name it."""

import shutil
from dataclasses import replace
from datetime import date

import pytest
from small_dataset import SCENES

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.tracks.sequence_fields import benchmark_of
from saf_gen.core.config.frozen_benchmarks import FrozenBenchmark, read_frozen_digests
from saf_gen.generate.resolve import recipe_digest, resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.leaderboard.results import notes_on
from saf_gen.scene.trusted_folders import register_folder
from saf_gen.stream.stream_file import open_stream


def test_the_digest_moves_with_what_decides_the_spikes_and_with_nothing_else(small_recipe, tmp_path, own_folder):
    shutil.copytree(SCENES / "plane", own_folder / "scenes/plane")
    register_folder(own_folder / "scenes")
    text = small_recipe.read_text()

    def digest(text):
        path = tmp_path / "changed.yaml"
        path.write_text(text)
        return recipe_digest(resolve_recipe(path))

    before = digest(text)
    assert digest(f"# in other words\n{text}") == before
    changes = [("seed: 3", "seed: 4"), ("frames: 400", "frames: 401"), ("to: 2.0", "to: 2.5")]
    changes += [("name: small", "name: other"), ("samples: 16", "samples: 17"), ("mean_rate: 0.2", "mean_rate: 0.3")]
    for old, new in changes:
        assert old in text
        assert digest(text.replace(old, new, 1)) != before
    sensor = (SCENES.parent / "small_sensor.yaml").read_text()
    (tmp_path / "sensor.yaml").write_text(sensor.replace("readout_hz: 20000", "readout_hz: 10000"))
    assert digest(text.replace(str(SCENES.parent / "small_sensor.yaml"), "sensor.yaml")) != before
    script = own_folder / "scenes/plane/scene.py"
    script.write_text(script.read_text() + "# changed\n")
    assert digest(text) != before


@pytest.fixture
def frozen_small(small_recipe, test_scenes, monkeypatch):
    """Freeze the small recipe without diffraction, so that any renderer can render it, and return its digest."""
    small_recipe.write_text(small_recipe.read_text().replace("max_depth: 3", "max_depth: 3, diffraction: false"))
    digest = recipe_digest(resolve_recipe(small_recipe))
    benchmark = FrozenBenchmark(digest=digest, since=date(2026, 11, 23), sequences={"test": 3})
    monkeypatch.setitem(read_frozen_digests(), "small", benchmark)
    return digest


def test_a_frozen_name_with_other_spikes_is_refused_before_anything_is_made(call, frozen_small, small_recipe, tmp_path):
    shown = " ".join(call("recipes", "check", small_recipe)[1].split())
    assert f"digest {frozen_small:.12}, a frozen benchmark" in shown
    small_recipe.write_text(small_recipe.read_text().replace("seed: 3", "seed: 4"))
    for words in (("generate", small_recipe, "--out", tmp_path / "d"), ("recipes", "check", small_recipe)):
        code, _, err = call(*words)
        assert (code, err.count("\n")) == (2, 1)
        assert "the benchmark 'small' is frozen" in err
        assert f"{frozen_small:.12}…, as on 2026-11-23" in err
        assert "another name" in err
    assert not (tmp_path / "d").exists()


@pytest.mark.slow
def test_streams_and_results_name_their_benchmark_and_how_much_of_it_they_cover(frozen_small, small_recipe, tmp_path):
    resolved = resolve_recipe(small_recipe)
    resolved = replace(resolved, sequences=resolved.sequences[::2])
    assert resolved.benchmark == f"small {frozen_small}"
    batch = resolved.sequences[:1]
    assert replace(resolved, all_sequences=batch, sequences=batch).benchmark == resolved.benchmark
    assert resolved.without_diffraction().benchmark == ""
    generate(resolved, tmp_path / "data")
    label = f"small {frozen_small:.12}"
    with open_stream(next((tmp_path / "data/test").glob("*.h5"))) as stream:
        assert stream.metadata.provenance["benchmark"] == f"small {frozen_small}"
    records = evaluate(tmp_path / "data", methods=["sd+argmax"]).records
    assert {record.what.benchmark for record in records} == {label}
    assert f"The benchmark is {label}: 2 of 3 sequences of test." in notes_on(records)


@pytest.mark.parametrize("claim", ["", "small", "small 0123456789ab", "unheard_of 00", "saf_bench " + "0" * 64])
def test_a_recording_that_claims_an_unknown_benchmark_belongs_to_none(claim):
    assert benchmark_of({"benchmark": claim}) is None
    assert benchmark_of({}) is None
