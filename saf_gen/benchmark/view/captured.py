"""What a running camera has captured: the contract of all kinds of cameras, and the one that suits a recording."""

from collections.abc import Callable
from functools import partial
from typing import Protocol

import numpy as np

from saf_gen.benchmark.view.captured_events import CapturedEvents
from saf_gen.benchmark.view.captured_exposures import CapturedExposures
from saf_gen.benchmark.view.captured_spikes import CapturedSpikes
from saf_gen.benchmark.view.restricted_view import TimedWindowSource
from saf_gen.core.region import Region
from saf_gen.stack.capture import Capture
from saf_gen.stack.event_capture import recorded_by
from saf_gen.stack.frame_capture import recorded_light
from saf_gen.stack.recapture import light_integrals
from saf_gen.stream.frame_file import FrameFile
from saf_gen.stream.recordings import EventRecording, Recording


class Captured(TimedWindowSource, Protocol):
    """What a running camera has captured so far, in a region of the sensor, whatever the kind of the camera.

    Attributes
    ----------
    capture : Capture
        The recording that is captured again.
    """

    capture: Capture

    def encode_until(self, stop: int, position: np.ndarray) -> None:
        """Capture all readouts before ``stop``, a multiple of the clock's packet.

        ``position``, float64, holds where the lens was in each of the clock's steps, as fractions of the travel. What
        an earlier run captured is kept if its lens was at the same positions.
        """
        ...


def choose_captured(
    stream: Recording, capture: Capture, *, region: Region
) -> tuple[Callable[..., Captured], slice | None]:
    """Return what makes an empty :class:`Captured` for the camera of a recording, and the rows that it needs.

    Parameters
    ----------
    stream : Recording
        The open recording.
    capture : Capture
        What captures it again.
    region : Region
        Region of the sensor; both ends of its slices are numbers.

    Returns
    -------
    callable
        Takes a capture, a source of charge, and by keyword ``region`` and ``threads``.
    slice or None
        Rows of the charge; None for all, because frames are exposed and events are read out as a whole.

    Raises
    ------
    BadInput
        If the recording does not say which event camera recorded it, or how its light changed.
    """
    if isinstance(stream, EventRecording):
        groups, seconds = capture.plane_source.time_stack.specs[0].groups, stream.shape[0] / stream.readout_hz
        light = light_integrals(stream, groups, duration_s=seconds)
        return partial(CapturedEvents, sensor=recorded_by(stream), integrals=light), None
    if isinstance(stream, FrameFile):
        return partial(CapturedExposures, integrals=recorded_light(stream, capture)), None
    return CapturedSpikes, capture.encoder_rows(region)
