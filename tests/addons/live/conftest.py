from dataclasses import replace

import pytest

from saf_gen.addons.live.source import open_capture
from saf_gen.camera import get_sensor


@pytest.fixture(scope="session")
def still(captured_dataset):
    """The still plane of the tests, as a live camera looks at it."""
    return open_capture(captured_dataset / "test" / "plane-constant-00.h5")


@pytest.fixture(scope="session")
def moving(captured_dataset):
    """The plane of the tests that comes nearer."""
    return open_capture(captured_dataset / "test" / "plane-dynamic-constant-00.h5")


@pytest.fixture
def photons(still):
    """The still plane in front of a single-photon array."""
    size = {"rows": still.sensor.rows, "columns": still.sensor.columns}
    return replace(still, sensor=get_sensor("qvga_spad", kind="photons", exposure_s=1e-6, **size))
