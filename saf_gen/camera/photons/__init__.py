"""Single-photon cameras: sensors, and the binary frames that their pixels give of light."""

from saf_gen.camera.photons.camera import SpadCamera
from saf_gen.camera.photons.sensor import SpadSensor

__all__ = ["SpadCamera", "SpadSensor"]

CAMERA = SpadCamera
