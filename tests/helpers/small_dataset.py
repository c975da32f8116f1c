"""The recipe and a planned sequence of the tests' small dataset."""

from pathlib import Path
from typing import Any

from saf_gen.generate.draw import PlannedSequence
from saf_gen.optics import ImageDistanceDrive
from saf_gen.stack.focal_stack import StackSpec

HERE = Path(__file__).parents[1]
SCENES = HERE / "scenes"
SMALL_RECIPE = f"""\
name: small
seed: 3
camera: {{sensor: {HERE / "small_sensor.yaml"}, frames: 400, exposure: {{mean_rate: 0.2}}}}
focus: {{drive: image_distance, positions: 9}}
render: {{samples: 16, max_depth: 3}}
lights:
  constant: {{kind: constant}}
  continuous: {{kind: ramp, from: 0.5, to: 2.0}}
  lamp_only:
    lamp: {{kind: steps, every_s: 0.005, levels: [1.0, 0.4, 2.0]}}
splits:
  test: {{scenes: [plane], lights: [constant, continuous, lamp_only]}}
"""

DRIVE = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))
SPEC = StackSpec("plane", "0" * 64, ("lamp", "room"), DRIVE, 16, 24, 60e-6, 9, 16, 4)


def make_sequence(**changes: Any) -> PlannedSequence:
    """Return a planned sequence, by default of a still plane under constant light during one sweep of the lens."""
    usual: dict[str, Any] = {
        "id": "s", "split": "test", "scene": "plane", "member": 0, "params": {}, "scene_motion": "static",
        "light": "constant", "repeat": 0, "seed": 5, "schedule": {"": {"kind": "constant"}},
        "motion": {"kind": "sweep"}, "mean_rate": 0.2,
    }  # fmt: skip
    return PlannedSequence(**{**usual, **changes})
