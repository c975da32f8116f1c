"""Windows of equal light along a sweep: their length is set by the number of spikes, not by time."""

from collections.abc import Iterator
from typing import NamedTuple

from saf_gen.errors import BadInput
from saf_gen.parts import View


class LightWindow(NamedTuple):
    """A window, ``first <= t < stop``, with ``light`` spikes per pixel, ``steps`` steps of the recording long."""

    first: int
    stop: int
    light: float
    steps: int


def equal_light_windows(view: View, light: float, *, steps: int, longest: float) -> Iterator[LightWindow]:
    """Yield a trailing window after each of ``steps`` equal steps of a recording, while it runs.

    The window is the shortest one with ``light`` spikes per pixel that ends there, but no longer than the fraction
    ``longest`` of the recording. No window is yielded while all frames so far have fewer spikes than that, or later if
    the longest window has less than a quarter of them. Raises BadInput if a step would have fewer than two frames.
    """
    step = view.frames // steps
    if step < 2:
        raise BadInput(
            f"a recording of {view.frames} frames is too short for {steps} steps",
            allowed=f"at least {2 * steps} frames",
            hint="choose fewer steps",
        )
    spikes, pixels, most = [0.0], 0.0, max(int(longest * steps), 2)
    for k in range(1, steps + 1):
        stop = k * step
        spikes.append(spikes[-1] + view.score(stop - step, stop, "er_count"))
        pixels = pixels or view.score(stop - step, stop, "er_count_n")
        begin = k - 1
        while begin > max(k - most, 0) and spikes[k] - spikes[begin] < light * pixels:
            begin -= 1
        found = (spikes[k] - spikes[begin]) / pixels if pixels else 0.0
        if found >= (light if k < most else light / 4):
            yield LightWindow(begin * step, stop, found, k - begin)
