"""A recipe with several cameras: the spikes stay as they are, and the others record the same sequences."""

import json

import pytest


@pytest.fixture
def recipe_of(small_recipe, test_scenes, small_sensor):
    """Return a function that names the cameras of the small recipe."""

    def write(sensor):
        text = small_recipe.read_text()
        line = next(line for line in text.splitlines() if "sensor:" in line)
        stated = line[line.index("sensor:") :].split(",")[0]
        small_recipe.write_text(text.replace(stated, f"sensor: {sensor}", 1))
        return small_recipe

    return write


@pytest.mark.slow
def test_every_camera_of_a_recipe_records_every_sequence(recipe_of, small_sensor, tmp_path, call):
    alone, several = tmp_path / "alone", tmp_path / "several"
    assert call("generate", recipe_of(small_sensor), "--out", alone)[0] == 0
    recipe = recipe_of(f"[{small_sensor}, qvga_spad, davis346]")
    code, output, error = call("generate", recipe, "--out", several)
    assert code == 0, error
    assert "recorded with qvga_spad" in output
    assert "recorded with davis346" in output
    listed = {name: json.loads((several / name / "manifest.json").read_text()) for name in (".", "cameras/qvga_spad")}
    spikes = {entry["id"]: entry["content_sha256"] for entry in listed["."]["sequences"]}
    photons = [entry["id"] for entry in listed["cameras/qvga_spad"]["sequences"]]
    assert photons == list(spikes)
    assert sorted(path.stem for path in several.glob("cameras/davis346/*/*.h5")) == sorted(spikes)
    before = json.loads((alone / "manifest.json").read_text())["sequences"]
    assert len(before) == len(spikes) > 1
    assert {entry["id"]: entry["content_sha256"] for entry in before} == spikes
    code, output, _ = call("generate", recipe, "--out", several)
    assert code == 0
    assert f"0 sequences recorded with qvga_spad, {len(spikes)} kept" in output


def test_a_dry_run_names_the_cameras_and_a_shard_leaves_them_out(recipe_of, small_sensor, tmp_path, call):
    recipe = recipe_of(f"[{small_sensor}, swissspad3]")
    code, output, _ = call("generate", recipe, "--out", tmp_path / "out", "--dry-run")
    assert code == 0
    assert "then recorded again, which is not in these figures, with: swissspad3" in output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ("[vidar_400x250, swisspad3]", "did you mean 'swissspad3'?"),
        ("[swissspad3, vidar_400x250]", "the sensor swissspad3 is of kind photons; allowed: spikes ("),
        ("[vidar_400x250, ideal]", "the sensor ideal is of kind spikes; allowed: photons ("),
        ("davis346", "the sensor davis346 is of kind events; allowed: spikes ("),
        ("[vidar_400x250, davis346, davis346]", "each camera once"),
        ("[]", "a list of a spike camera's sensor and other cameras"),
        ("7", "a sensor, or a list"),
        ("[vidar_400x250, 7]", "a sensor, or a list"),
        ("{kind: photons}", "a sensor, or a list"),
        ("[vidar_400x250, mine.yaml]", "mine.yaml"),
    ],
)
def test_what_names_no_camera_is_refused_before_anything_is_made(recipe_of, sensor, words, tmp_path, call):
    code, _, error = call("generate", recipe_of(sensor), "--out", tmp_path / "out")
    assert (code, len(error.splitlines())) == (2, 1)
    assert words in error
    assert not (tmp_path / "out").exists()
