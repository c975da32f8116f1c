"""What tests share: the scenes of this folder, and a sensor small enough to be quick."""

from pathlib import Path

import pytest
from small_dataset import HERE, SCENES, SMALL_RECIPE


@pytest.fixture
def test_scenes(monkeypatch):
    """Makes tests/scenes known, beside the project's own scenes."""
    monkeypatch.setenv("SAF_GEN_SCENES", str(SCENES))
    return SCENES


@pytest.fixture
def small_sensor() -> Path:
    """A sensor file of 64×40 pixels of 60 µm, else the vidar_400x250."""
    return HERE / "small_sensor.yaml"


@pytest.fixture
def small_recipe(tmp_path) -> Path:
    """A recipe that generates in seconds: the chequered plane, three lights, 400 frames."""
    path = tmp_path / "small.yaml"
    path.write_text(SMALL_RECIPE)
    return path
