"""One recording shows one scene: a script that returns something else the next time is refused, and loses nothing."""

import os
import shutil
import subprocess
import sys

import pytest
from small_dataset import SCENES, SMALL_RECIPE

from saf_gen.authoring.checks.repeat import check_repeat
from saf_gen.stack.same_scene import HINT

PRINT = """\
import os
from pathlib import Path

import mitsuba as mi
import numpy as np

HERE = Path(__file__).parent


def paint():
{code}


def build(params):
    t, rows = mi.ScalarTransform4f(), np.asarray(paint(), dtype=np.float32)
    return {{
        "plane": {{
            "type": "rectangle",
            "to_world": t.translate([0, 0, 0.5]).rotate([0, 1, 0], 180).scale(0.5),
            "bsdf": {{
                "type": "diffuse",
                "reflectance": {{
                    "type": "bitmap",
                    "bitmap": mi.Bitmap(np.repeat(rows[..., None], 3, axis=2)),
                    "filter_type": "nearest",
                }},
            }},
        }},
        "lamp": {{
            "type": "rectangle",
            "to_world": t.translate([0.3, 0.2, -0.1]).scale(0.1),
            "emitter": {{"type": "area", "radiance": {{"type": "rgb", "value": 20.0}}}},
        }},
        "room": {{"type": "constant", "radiance": {{"type": "rgb", "value": 0.5}}}},
    }}
"""
MOTION = """
motion:
  plane: {keyframes: [{time_s: 0}, {time_s: 0.02, translate_m: [0.002, 0, -0.04]}]}
slices_per_s: 500
still_s: 0.01
"""
NAMES = "'amber blue coral green indigo lemon mauve olive pink red silver teal'.split()"
UNSTABLE = {
    "unseeded": "return np.random.default_rng().random((64, 64))",
    "hashed": "return np.random.default_rng(hash('camel') % 2**32).random((64, 64))",
    "unordered": f"return np.resize([len(name) / 10 + ord(name[0]) / 400 for name in set({NAMES})], (64, 64))",
    "by_age": "files = sorted(HERE.glob('*.txt'), key=lambda file: file.stat().st_mtime); "
    "return np.resize([float(file.read_text()) for file in files], (64, 64))",
    "clocked": "import time; return np.resize([time.time() % 1, 0.5, 0.1], (64, 64))",
}
"""What ``paint()`` does, so that its print is another one in each process."""
STABLE = {
    "seeded": "return np.random.default_rng(5).random((64, 64))",
    "rounded": "last = np.random.default_rng().random((64, 64)); "
    "return np.random.default_rng(5).random((64, 64)) * (1 + 1e-7 * last)",
    "ordered": f"return np.resize([len(name) / 10 + ord(name[0]) / 400 for name in sorted(set({NAMES}))], (64, 64))",
}
"""What is the same each time, but for the last digits that other processors round."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of scenes with prints, and a recipe for each."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path / "scenes"))
    for name, code in (UNSTABLE | STABLE).items():
        write_scene(tmp_path, name, PRINT.format(code=f"    {code}"))
    return tmp_path


def write_scene(folder, name, script):
    scene = folder / "scenes" / name
    shutil.copytree(SCENES / "plane", scene)
    (scene / "scene.yaml").write_text((SCENES / "plane/scene.yaml").read_text().replace("id: plane", f"id: {name}"))
    (scene / "scene.py").write_text(script)
    for age, value in enumerate((0.2, 0.5, 0.9)):
        (scene / f"{value}.txt").write_text(f"{value}")
        os.utime(scene / f"{value}.txt", (age, age))
    recipe = SMALL_RECIPE.replace("[plane]", f"[{name}]").replace("name: small", f"name: {name}")
    recipe = recipe.replace("max_depth: 3", "max_depth: 3, diffraction: false")  # which scalar does not render
    (folder / f"{name}.yaml").write_text(recipe)
    return scene


def generate(name, *options, seed="0"):
    """Run the command in a process with its own order of sets, and return it."""
    command = [sys.executable, "-m", "saf_gen", "generate", f"{name}.yaml", "--variant", "scalar", *options]
    return subprocess.run(
        command, env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, text=True, check=False
    )


def problems(ended):
    return [line for line in ended.stderr.splitlines() if line.startswith("saf-gen: ")]


def change_what_may_change(folder):
    """Give the files of all scenes another age, as copies of them have."""
    for path in folder.glob("scenes/*/0.2.txt"):
        os.utime(path, (9, 9))


@pytest.mark.daily(2)
@pytest.mark.slow
@pytest.mark.parametrize("name", UNSTABLE)
def test_a_picture_that_is_made_again_shows_the_same_scene_or_is_refused(folder, name):
    """What differs within one process is noticed when the grain is measured, before anything is recorded."""
    first = generate(name, seed="1")
    made = folder / "datasets" / name
    (lamp,) = made.glob("stacks/*/lamp.exr")
    kept = {path: path.read_bytes() for path in made.glob("*/*/*") if path != lamp}
    kept |= {path: path.read_bytes() for path in made.glob("test/*.h5")}
    recorded = len(list(made.glob("test/*.h5")))
    assert recorded == (0 if name in ("unseeded", "clocked") else 3)
    lamp.unlink()
    change_what_may_change(folder)
    second = generate(name, seed="2")
    for ended in [second] if recorded else [first, second]:
        (line,) = problems(ended)
        assert ended.returncode == 2
        assert f"scene {name!r} is not the same twice: for pictures in " in line
        assert "seed random numbers, sort sets and lists of files, and avoid hash()" in line
    assert not lamp.exists()
    assert {path: path.read_bytes() for path in kept} == kept


@pytest.mark.daily(1)
@pytest.mark.slow
@pytest.mark.parametrize("name", STABLE)
def test_a_picture_of_a_scene_that_is_the_same_twice_is_made_again(folder, name):
    generate(name, seed="1")
    made = folder / "datasets" / name
    (lamp,) = made.glob("stacks/*/lamp.exr")
    before = lamp.read_bytes()
    lamp.unlink()
    change_what_may_change(folder)
    again = generate(name, seed="2")
    assert (again.returncode, problems(again)) == (0, [])
    assert "1 piece of focal stacks rendered" in again.stdout
    assert (lamp.read_bytes() == before) == (name != "rounded")


@pytest.mark.daily(1)
@pytest.mark.slow
@pytest.mark.parametrize(("name", "exit_code"), [("unordered", 2), ("ordered", 0)])
def test_shards_show_the_same_scene_on_one_folder_and_when_they_are_merged(folder, name, exit_code):
    with (folder / "scenes" / name / "scene.yaml").open("a") as card:
        card.write(MOTION)
    recipe = folder / f"{name}.yaml"
    recipe.write_text(recipe.read_text().replace("lamp_only]}", "lamp_only], scene_motion: [dynamic]}"))
    for shard, seed in (("1/2", "1"), ("2/2", "2")):
        apart = generate(name, "--shard", shard, "--out", f"shard{seed}", seed=seed)
        together = generate(name, "--shard", shard, "--out", "both", seed=seed)
        assert apart.returncode == 0, apart.stderr
        assert together.returncode == (exit_code if seed == "2" else 0), together.stderr
    merged = generate(name, "--from", "shard1", "--from", "shard2", "--out", "merged")
    assert merged.returncode == exit_code, merged.stderr
    assert len(list((folder / "merged/test").glob("*.h5"))) == (3 if exit_code == 0 else 0)
    for ended in (together, merged) if exit_code else ():
        assert all(f"scene {name!r} is not the same twice" in line for line in problems(ended))
        assert problems(ended)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["unseeded", "hashed", "unordered", "rounded"])
def test_a_check_says_whether_a_scene_is_the_same_in_another_process(folder, call, monkeypatch, name):
    monkeypatch.setattr("saf_gen.authoring.checks.CHECKS_OF_BUILT_SCENES", (check_repeat,))
    code, out, _ = call("scenes", "check", name, "--variant", "scalar")
    lines = [line for line in out.splitlines() if " error " in line]
    if name in STABLE:
        assert (code, lines) == (0, [])
    else:
        assert code == 1
        assert lines == [f"{name} error repeat: not the same scene in a second process: {HINT}"]
