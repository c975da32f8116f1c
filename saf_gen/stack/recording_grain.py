"""The grain along a recording, computed from the grain of its focal stacks."""

from itertools import chain

import numpy as np

from saf_gen.stack.stack_grain import StackGrain
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stream.metadata import Truth
from saf_gen.stream.recorded_grain import GrainMoment, RecordedGrain

MOMENTS = 17  # along a recording of a still scene


def grain_along(
    plane_source: PlaneSource, truth: Truth, *, position: np.ndarray, gain: np.ndarray
) -> RecordedGrain | None:
    """Return the grain at moments along a recording, or None if the grain of its stacks is not known.

    A still scene is evaluated at evenly spaced frames, and in the frame in which the lens is nearest to the truth; a
    moving scene at the slices whose grain was measured. Between two rendered positions or slices, a recording mixes
    pictures, which lowers independent noise. The figure of the nearest picture is used, and is thus too large rather
    than too small.

    Parameters
    ----------
    plane_source : PlaneSource
        Focal stacks of the recording.
    truth : Truth
        True focus; ``position`` and ``track`` are used.
    position : ndarray, shape (T,)
        Position of the lens in each readout, 0 to 1.
    gain : ndarray, shape (T, light)
        Gains of the light groups.
    """
    time_stack = plane_source.time_stack
    last = len(position) - 1
    off = np.abs(position - (truth.position if truth.track is None else truth.track))
    if time_stack.is_moving:
        found = {min(frame, last): j for j, frame in enumerate(time_stack.slice_frames)}
        measured = {t: (j, grain) for t, j in found.items() if (grain := plane_source.load_grain(j)) is not None}
    else:
        still_grain = plane_source.load_grain(0)
        frames = chain(np.linspace(0, last, min(MOMENTS, last + 1)).round().astype(int).tolist(), [int(off.argmin())])
        measured = {} if still_grain is None else {t: (0, still_grain) for t in frames}
    if not measured:
        return None
    moments = tuple(
        _moment(plane_source, t, j=j, grain=grain, position=float(position[t]), gain=gain[t])
        for t, (j, grain) in sorted(measured.items())
    )
    focus = min(range(len(moments)), key=lambda n: off[moments[n].frame])
    return RecordedGrain(moments, focus, next(iter(measured.values()))[1].samples)


def _moment(
    plane_source: PlaneSource, frame: int, *, j: int, grain: StackGrain, position: float, gain: np.ndarray
) -> GrainMoment:
    spec = plane_source.time_stack.specs[j]
    measured = spec.focus[grain.indices]
    index = int(np.abs(measured - position).argmin())
    rms, noise, signal = grain.mix(index, gain)
    return GrainMoment(frame, float(measured[index]), rms, noise, signal)
