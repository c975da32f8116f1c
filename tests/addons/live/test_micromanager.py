"""A live camera as devices of pymmcore-plus: its own benchmark of devices, an acquisition, and an autofocus."""

import time

import numpy as np
import pytest

from saf_gen import get_measure
from saf_gen.addons.live.camera import LiveCamera
from saf_gen.core import extras
from saf_gen.errors import BadInput

TRAVEL_UM = 500.0


@pytest.fixture
def camera(still):
    return LiveCamera(still, region="frame", start=0.9)


@pytest.fixture
def core(camera):
    unicore = pytest.importorskip("pymmcore_plus.experimental.unicore", reason="pip install 'saf-gen[micromanager]'")
    from saf_gen.addons.live.micromanager import load_devices

    made = unicore.UniMMCore()
    load_devices(made, camera, travel_um=TRAVEL_UM)
    yield made
    made.unloadAllDevices()


def test_without_the_package_the_extra_is_named(monkeypatch):
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(BadInput, match=r"needs the package pymmcore_plus; pip install 'saf-gen\[micromanager\]'"):
        extras.require_extra("micromanager", "pymmcore_plus", of="saf_gen.addons.live.micromanager")


def test_the_devices_pass_the_benchmark_of_the_framework(core):
    from pymmcore_plus._benchmark import benchmark_core_and_devices

    problems = [
        one for one in benchmark_core_and_devices(core, 2) if isinstance(one, tuple) and isinstance(one[1], str)
    ]
    # The C++ core answers for several regions at once, and knows no camera in Python.
    assert [name for name, _ in problems] == ["getMultiROI"]


def test_an_image_is_the_counts_of_its_exposure(core, camera):
    still = LiveCamera(camera.capture, region="frame", start=0.9)
    core.setExposure(2.5)
    assert core.getExposure() == 2.5
    core.snapImage()
    image = core.getImage()
    assert image.dtype == np.uint16
    assert np.array_equal(image, still.read(50))
    core.setProperty("Camera", "Binning", 4)
    core.snapImage()
    rows, columns = camera.shape
    blocks = still.read(50).reshape(rows // 4, 4, columns // 4, 4).sum(axis=(1, 3))
    assert np.array_equal(core.getImage(), blocks)
    core.setProperty("Camera", "Binning", 1)
    core.setROI(8, 4, 16, 12)
    core.snapImage()
    assert np.array_equal(core.getImage(), still.read(50)[4:16, 8:24])
    with pytest.raises(Exception, match="the exposure is 2000 ms; allowed: above 0, at most 1000 ms"):
        core.setExposure(2000)


def test_a_sequence_goes_on_in_time(core):
    core.setExposure(1.0)
    core.startSequenceAcquisition(3, 0, True)
    while core.isSequenceRunning():
        time.sleep(0.001)
    seconds = [float(core.popNextImageAndMD()[1]["seconds"]) for _ in range(3)]
    assert np.diff(seconds) == pytest.approx(0.001)


def test_the_lens_takes_time_and_positions_count_from_the_origin(core, camera):
    assert core.getFocusDevice() == "Focus"
    assert core.getPosition() == pytest.approx(0.9 * TRAVEL_UM)
    core.setPosition(100)
    assert core.deviceBusy("Focus")
    core.waitForDevice("Focus")
    assert camera.lens == pytest.approx(0.2, abs=0.01)
    core.setRelativePosition(-25)
    assert core.getPosition() == pytest.approx(75)
    core.setOrigin()
    assert core.getPosition() == 0
    core.setPosition(10)
    assert camera.focus == pytest.approx(85 / TRAVEL_UM)
    core.stop("Focus")
    assert camera.focus == camera.lens
    core.home("Focus")
    assert camera.focus == 0
    with pytest.raises(Exception, match="the lens was sent to 1000 um; allowed: -75 to 425 um"):
        core.setPosition(1000)


def test_lamps_are_properties(core, camera):
    assert core.getDevicePropertyNames("Lamps") == camera.lamps
    core.setProperty("Lamps", "lamp", 0.5)
    assert float(core.getProperty("Lamps", "lamp")) == camera.gains["lamp"] == 0.5
    assert core.getPropertyUpperLimit("Lamps", "lamp") == 100


def test_the_framework_takes_a_stack_of_positions(core):
    useq = pytest.importorskip("useq")
    taken = []
    core.setExposure(5)
    core.mda.events.frameReady.connect(lambda image, event, _: taken.append((event.z_pos, image.mean())))
    sequence = useq.MDASequence(stage_positions=[(None, None, 250)], z_plan={"range": 200, "step": 50})
    core.mda.run(sequence)
    assert [z for z, _ in taken] == [150, 200, 250, 300, 350]
    assert all(mean > 0 for _, mean in taken)


def test_an_autofocus_that_climbs_finds_the_true_focus(core, camera):
    sharpness = get_measure("sd")
    core.setExposure(20)

    def look(z):
        core.setPosition(z)
        core.waitForDevice("Focus")
        core.snapImage()
        return sharpness(core.getImage().astype(np.uint32))

    z, step = core.getPosition(), -0.1 * TRAVEL_UM
    best = look(z)
    while abs(step) > 0.005 * TRAVEL_UM:
        there = min(max(z + step, 0), TRAVEL_UM)
        if (score := look(there)) > best:
            z, best = there, score
        else:
            step /= -2
    low, high = camera.capture.truth.depth_of_focus
    assert abs(z / TRAVEL_UM - camera.true_focus) <= abs(high - low)
