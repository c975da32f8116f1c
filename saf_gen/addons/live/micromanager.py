"""A live camera as devices of Micro-Manager's core in Python (pymmcore-plus), so that a laboratory's code runs on it.

>>> from pymmcore_plus.experimental.unicore import UniMMCore  # doctest: +SKIP
>>> from saf_gen.addons.live.camera import LiveCamera  # doctest: +SKIP
>>> from saf_gen.addons.live.micromanager import load_devices  # doctest: +SKIP
>>> core = UniMMCore()  # doctest: +SKIP
>>> load_devices(core, LiveCamera("datasets/quickstart"))  # doctest: +SKIP
>>> core.setPosition(400), core.waitForSystem(), core.snap()  # doctest: +SKIP

Time passes only while an image is exposed, and while the core waits for a device that is busy. This module needs the
extra ``micromanager``.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from saf_gen.addons.live.camera import MAX_GAIN, MAX_READ_FRAMES, LiveCamera
from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput

require_extra("micromanager", "pymmcore_plus", of="saf_gen.addons.live.micromanager")

from pymmcore_plus.experimental.unicore import GenericDevice, SimpleCameraDevice, StageDevice, UniMMCore  # noqa: E402

BINNINGS = (1, 2, 4, 8)
BUSY_S = 0.01
"""Time of the camera that passes each time that the core asks whether the lens moves, a hundred times a second."""


class SpikeCameraDevice(SimpleCameraDevice):
    """A camera whose image is the number of spikes of each pixel during the exposure, uint16.

    The exposure is rounded to readouts, at least one and at most 20,000.
    """

    def __init__(self, camera: LiveCamera) -> None:
        super().__init__()
        self._camera, self._frames, self._bin = camera, round(0.01 * camera.readout_hz), 1
        self.set_property_allowed_values("Binning", BINNINGS)

    def get_binning(self) -> int:
        """Return how many rows and columns are added up."""
        return self._bin

    def set_binning(self, value: int) -> None:
        """Add up the spikes of this many rows and columns."""
        self._bin = value

    def get_exposure(self) -> float:
        """Return the exposure in milliseconds."""
        return self._frames / self._camera.readout_hz * 1e3

    def set_exposure(self, exposure: float) -> None:
        """Set the exposure in milliseconds."""
        frames = round(exposure * 1e-3 * self._camera.readout_hz)
        if exposure <= 0 or frames > MAX_READ_FRAMES:
            longest = MAX_READ_FRAMES / self._camera.readout_hz * 1e3
            raise BadInput(f"the exposure is {exposure:g} ms", allowed=f"above 0, at most {longest:g} ms")
        self._frames = max(frames, 1)

    def sensor_shape(self) -> tuple[int, int]:
        """Return the rows and columns of an image."""
        rows, columns = self._camera.shape
        return rows // self._bin, columns // self._bin

    def dtype(self) -> type[np.uint16]:
        """Return the type of the pixels."""
        return np.uint16

    def snap(self, buffer: np.ndarray) -> Mapping[str, Any]:
        """Expose one image into the buffer, and return when it was, in the time of the camera."""
        counts, (rows, columns) = self._camera.read(self._frames), self.sensor_shape()
        blocks = counts[: rows * self._bin, : columns * self._bin].reshape(rows, self._bin, columns, self._bin)
        buffer[:] = np.minimum(blocks.sum(axis=(1, 3)), np.iinfo(np.uint16).max)
        return {"seconds": self._camera.seconds, "lens": self._camera.lens}


class FocusDevice(StageDevice):
    """The drive of the lens; its travel is ``travel_um`` long, in whatever unit a laboratory's code takes steps."""

    def __init__(self, camera: LiveCamera, *, travel_um: float = 1000.0) -> None:
        super().__init__()
        self._camera, self._travel_um, self._origin_um = camera, travel_um, 0.0

    def set_position_um(self, val: float) -> None:
        """Send the lens to a position; it arrives while time passes."""
        to = (val + self._origin_um) / self._travel_um
        if not 0 <= to <= 1:
            low, high = -self._origin_um, self._travel_um - self._origin_um
            raise BadInput(f"the lens was sent to {val:g} um", allowed=f"{low:g} to {high:g} um")
        self._camera.focus = to

    def get_position_um(self) -> float:
        """Return the position to which the lens was sent."""
        return self._camera.focus * self._travel_um - self._origin_um

    def busy(self) -> bool:
        """Return whether the lens moves, after letting some time pass."""
        if not self._camera.is_settled:
            self._camera.wait(max(round(BUSY_S * self._camera.readout_hz), 1))
        return not self._camera.is_settled

    def home(self) -> None:
        """Send the lens to the beginning of its travel."""
        self._camera.focus = 0.0

    def stop(self) -> None:
        """Stop the lens where it is."""
        self._camera.focus = min(max(self._camera.lens, 0.0), 1.0)

    def set_origin(self) -> None:
        """Count positions from the present one."""
        self._origin_um = self._camera.focus * self._travel_um


class LampsDevice(GenericDevice):
    """The lamps: a property for each, its gain, where 1 is the light of the recording."""

    def __init__(self, camera: LiveCamera) -> None:
        super().__init__()
        for lamp in camera.lamps:
            self.register_property(
                lamp,
                property_type=float,
                limits=(0.0, MAX_GAIN),
                getter=partial(_gain_of, camera=camera, lamp=lamp),
                setter=partial(_dim, camera=camera, lamp=lamp),
            )


def _gain_of(_device: LampsDevice, *, camera: LiveCamera, lamp: str) -> float:
    return camera.gains[lamp]


def _dim(_device: LampsDevice, gain: float, *, camera: LiveCamera, lamp: str) -> None:
    camera.dim(lamp, gain)


def load_devices(core: UniMMCore, camera: LiveCamera, *, travel_um: float = 1000.0) -> None:
    """Load a live camera into a core as its devices ``Camera``, ``Focus`` and ``Lamps``, which become the current ones.

    Parameters
    ----------
    core : UniMMCore
        Core of pymmcore-plus that takes devices in Python.
    camera : LiveCamera
        The camera.
    travel_um : float, default 1000.0
        Length of the travel of the lens in the micrometres of the core.
    """
    focus = FocusDevice(camera, travel_um=travel_um)
    for name, device in {"Camera": SpikeCameraDevice(camera), "Focus": focus, "Lamps": LampsDevice(camera)}.items():
        core.loadPyDevice(name, device)
        core.initializeDevice(name)
    core.setCameraDevice("Camera")
    core.setFocusDevice("Focus")
    core.setAutoShutter(False)  # there is no shutter to close between two images
