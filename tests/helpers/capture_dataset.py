"""A dataset that can be captured again: the chequered plane of the tests, still and coming nearer."""

import shutil
from pathlib import Path

from small_dataset import HERE, SCENES

from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.render import backend

VARIANT = "llvm" if backend.probe_backends().llvm_usable else "scalar"
MOTION = """
motion:
  plane: {keyframes: [{time_s: 0}, {time_s: 0.04, translate_m: [0.002, 0, -0.04]}]}
slices_per_s: 250
still_s: 0.02
"""
RECIPE = f"""\
name: takes
seed: 3
camera: {{sensor: {HERE / "small_sensor.yaml"}, frames: 800, exposure: {{mean_rate: 0.2}}}}
focus: {{positions: 9}}
render: {{samples: 16, max_depth: 3, slice_samples: 16, whole_slices: true}}
lights:
  constant: {{kind: constant}}
  lamp_only: {{lamp: {{kind: ramp, from: 0.5, to: 2.0}}}}
splits:
  test: {{scenes: [plane], lights: [constant, lamp_only], scene_motion: [static, dynamic]}}
"""


def make_dataset(folder: Path, monkeypatch, recipe: str = RECIPE) -> Path:
    """Generate the dataset below ``folder`` and return its folder."""
    write_moving_plane(folder, monkeypatch)
    path = folder / "takes.yaml"
    path.write_text(recipe)
    outcome = generate(resolve_recipe(path), folder / "takes", variant=VARIANT)
    assert outcome.failed == {}
    return outcome.folder


def write_moving_plane(folder: Path, monkeypatch) -> Path:
    """Write the scene below ``folder``, let saf_gen find it, and return its folder."""
    scenes = folder / "scenes"
    shutil.copytree(SCENES / "plane", scenes / "plane")
    with (scenes / "plane" / "scene.yaml").open("a") as card:
        card.write(MOTION)
    monkeypatch.setenv("SAF_GEN_SCENES", str(scenes))
    return scenes / "plane"
