"""The study of threshold noise, on a small recipe."""

import shutil

import pytest
from small_dataset import HERE
from written_scenes import needs_llvm

from saf_gen.benchmark.records import read_records
from studies.ranking import noisy_sensor


@needs_llvm
@pytest.mark.slow
def test_two_sensors_are_compared_on_the_same_stacks(tmp_path, test_scenes, small_recipe, capsys):
    """With twenty times the threshold noise every stream differs; stacks are shared, and a second run reads records."""
    own = HERE / "small_sensor.yaml"
    noisy = tmp_path / "noisy.yaml"
    noisy.write_text(own.read_text().replace("threshold_noise_rms: 0.0058", "threshold_noise_rms: 0.12"))
    (tmp_path / "methods.txt").write_text("sd+argmax\nbrenner+argmax\n")
    arguments = ["--out", str(tmp_path / "out"), "--recipe", str(small_recipe), "--sensor", str(own), str(noisy)]
    arguments += ["--methods", str(tmp_path / "methods.txt")]
    noisy_sensor.main(arguments)
    first = capsys.readouterr().out
    assert "| method | success, `small_sensor` | error | success, `noisy` | error |" in first
    assert "| `sd+argmax` | " in first
    assert "Of 6 answers " in first
    folder = tmp_path / "out" / "small"
    assert len(list((folder / "dataset" / "stacks").iterdir())) == 1
    a, b = (read_records(folder / f"{name}.jsonl") for name in ("small_sensor", "noisy"))
    assert {r.data for r in a}.isdisjoint({r.data for r in b})
    shutil.rmtree(folder / "dataset")
    noisy_sensor.main(arguments)
    assert capsys.readouterr().out == first
