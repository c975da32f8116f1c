"""A camera to hold: it runs while somebody turns the focus and the lamps, as an object, a page or a laboratory's device.

Nothing is rendered while it runs: one traced focal stack serves every position of the lens and every light.
"""

from saf_gen.live.camera import LiveCamera, LiveRun

__all__ = ["LiveCamera", "LiveRun"]
