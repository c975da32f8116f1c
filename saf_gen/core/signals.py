"""The arrays of the processing chain, with the axes, dtype and unit of each.

Axes are always in the order light, focus, time, row, column. :func:`validate_signal` checks arrays that come from
users.
"""

from dataclasses import dataclass

import numpy as np

from saf_gen.errors import BadInput


@dataclass(frozen=True)
class Signal:
    """One array of the processing chain: names of its axes, dtype, unit, and meaning."""

    name: str
    axes: tuple[str, ...]
    dtype: str
    unit: str
    meaning: str


SIGNALS = {
    s.name: s
    for s in (
        Signal("radiance", ("light", "focus", "row", "col"), "float32", "W m^-2 sr^-1 at gain 1",
               "mean over aperture and pixel, one light group alone"),
        Signal("depth", ("row", "col"), "float32", "m",
               "axial distance of the first surface, pinhole at the lens centre"),
        Signal("target", ("row", "col"), "bool", "-", "the pixels to focus on"),
        Signal("gain", ("frame", "light"), "float32", "1", "the light schedule"),
        Signal("focus_position", ("frame",), "float32", "0...1 of the travel",
               "position of the lens, as it was told or read"),
        Signal("charge", ("focus", "row", "col"), "float32", "e- per readout",
               "photo-electrons collected by a pixel"),
        Signal("spikes", ("row", "col", "frame/8"), "uint8", "bit",
               "frame t is bit t mod 8, least significant first, of byte t div 8"),
        Signal("counts", ("row", "col"), "uint32", "spikes", "in a window of frames"),
        Signal("score", (), "float64", "per measure", "larger is sharper"),
    )
}  # fmt: skip


def validate_signal(name: str, array: np.ndarray) -> np.ndarray:
    """Return ``array`` as the signal ``name``: the same values, with the dtype that SIGNALS gives, in C order.

    Raises BadInput if the number of axes is wrong, or the values are not numbers that the dtype can hold.
    """
    signal = SIGNALS[name]
    array = np.asarray(array)
    if array.ndim != len(signal.axes):
        raise BadInput(f"{name} has shape {array.shape}", allowed=f"{len(signal.axes)} axes ({', '.join(signal.axes)})")
    if array.dtype.kind not in "buif":
        raise BadInput(f"{name} has dtype {array.dtype}", allowed=f"numbers ({signal.dtype})")
    out = np.ascontiguousarray(array, dtype=signal.dtype)
    if signal.dtype == "float32" and not np.isfinite(out).all():
        raise BadInput(f"{name} holds values that are not finite", allowed=f"finite numbers in {signal.unit}")
    return out
