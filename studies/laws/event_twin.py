"""A second event camera, written from the model's description alone: slow, readable, and without code of saf_gen.

The photoreceptor's output V is the logarithm of a current that charges its input node until it equals the photocurrent
I, and a second time constant, s, adds to the first:

    dV/dt = (I - exp(V)) / (Q + s·I)

A pixel reports a rise when V is a threshold above the stored level, a fall when it is a threshold below. It is then
held in reset, sees nothing, and stores the V that it has when the reset ends. saf_gen solves for the instants of events
in 1/exp(V), cell by cell; here V itself is stepped through time.
"""

import math
from typing import NamedTuple

import numpy as np


class TwinEvents(NamedTuple):
    """Events, in no particular order.

    Attributes
    ----------
    t : ndarray of float64, shape (n,)
        Seconds since the recording began.
    pixel : ndarray of int64, shape (n,)
        Number of the pixel, counted row by row.
    rise : ndarray of bool, shape (n,)
        True for a rise of the light.
    """

    t: np.ndarray
    pixel: np.ndarray
    rise: np.ndarray


def make_events(
    light: np.ndarray,
    *,
    seconds: float,
    on: float | np.ndarray,
    off: float | np.ndarray,
    charge_e: float = 0.0,
    receptor_s: float = 0.0,
    refractory_s: float = 0.0,
    step_s: float = 2e-5,
) -> TwinEvents:
    """Return the events of light that changes linearly between knots, without noise.

    Parameters
    ----------
    light : ndarray, shape (K, H, W)
        Photocurrent of each pixel, electrons per second, above 0, at K ≥ 2 knots evenly spaced over the recording.
    seconds : float
        Length of the recording, seconds.
    on, off : float or ndarray, shape (H·W,)
        Thresholds of rises and falls, of the natural logarithm of the light.
    charge_e, receptor_s : float, default 0
        Charge Q of the input node, electrons, and time constant s, seconds; both 0 if V follows the light at once.
    refractory_s : float, default 0
        Time in reset after an event, seconds.
    step_s : float, default 2e-5
        Longest step of time, seconds; well below the time constant Q/I + s, if there is one.
    """
    light = np.asarray(light, np.float64).reshape(len(light), -1)
    on, off = (np.broadcast_to(threshold, light.shape[1]) for threshold in (on, off))
    steps = math.ceil(seconds / step_s)
    step_s = seconds / steps
    found = [(np.empty(0), np.empty(0, np.int64), np.empty(0, bool))]

    def current(step: float) -> np.ndarray:
        place = min(step / steps, 1.0) * (len(light) - 1)
        knot = min(int(place), len(light) - 2)
        return np.asarray(light[knot] + (place - knot) * (light[knot + 1] - light[knot]))

    def slope(v: np.ndarray, photocurrent: np.ndarray) -> np.ndarray:
        return (photocurrent - np.exp(v)) / (charge_e + receptor_s * photocurrent)

    v = np.log(current(0))
    stored, reset_end = v.copy(), np.full(len(v), np.inf)  # inf: not in reset
    for step in range(steps):
        begin, before = step * step_s, v
        if charge_e + receptor_s > 0:  # the midpoint rule
            halfway = before + 0.5 * step_s * slope(before, current(step))
            v = before + step_s * slope(halfway, current(step + 0.5))
        else:
            v = np.log(current(step + 1))
        while True:  # events within the step, in which V is straight
            ended = np.flatnonzero(reset_end <= begin + step_s)
            stored[ended] = before[ended] + (v - before)[ended] * (reset_end[ended] - begin) / step_s
            reset_end[ended] = np.inf
            rise = v >= stored + on
            pixel = np.flatnonzero((rise | (v <= stored - off)) & np.isinf(reset_end))
            if not pixel.size:
                break
            bound = (stored + np.where(rise, on, -off))[pixel]
            at = begin + step_s * (bound - before[pixel]) / (v - before)[pixel]
            found.append((at, pixel, rise[pixel]))
            reset_end[pixel] = at + refractory_s
    return TwinEvents(*(np.concatenate(column) for column in zip(*found, strict=True)))
