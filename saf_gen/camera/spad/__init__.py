"""Single-photon cameras: sensors, and the binary frames that their pixels give of light."""

from saf_gen.camera.spad.camera import SpadCamera
from saf_gen.camera.spad.sensor import SpadSensor

__all__ = ["SpadCamera", "SpadSensor"]
