"""What tests share: the scenes of this folder, and a sensor small enough to be quick."""

from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.fixture
def test_scenes(monkeypatch):
    """Makes tests/scenes known, beside the project's own scenes."""
    monkeypatch.setenv("SAF_GEN_SCENES", str(HERE / "scenes"))
    return HERE / "scenes"


@pytest.fixture
def small_sensor() -> Path:
    """A sensor file of 64×40 pixels of 60 µm, else the vidar_400x250."""
    return HERE / "small_sensor.yaml"


@pytest.fixture
def small_recipe(tmp_path, small_sensor) -> Path:
    """A recipe that generates in seconds: the chequered plane, three lights, 400 frames."""
    path = tmp_path / "small.yaml"
    path.write_text(f"""\
name: small
seed: 3
camera: {{sensor: {small_sensor}, frames: 400, exposure: {{mean_rate: 0.2}}}}
focus: {{drive: image_distance, positions: 9}}
render: {{samples: 16, max_depth: 3}}
lights:
  constant: {{kind: constant}}
  continuous: {{kind: ramp, from: 0.5, to: 2.0}}
  lamp_only:
    lamp: {{kind: steps, every_s: 0.005, levels: [1.0, 0.4, 2.0]}}
splits:
  test: {{scenes: [plane], lights: [constant, continuous, lamp_only]}}
""")
    return path
