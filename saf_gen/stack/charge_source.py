"""A recording's stacks as charge: what the sensor collects at any frame and focus position.

Of a scene that stands still the whole stack is in memory. Of one that moves only those positions are read at
which the lens is, and unless told to keep more those of three stacks at most are in memory.
"""

import numpy as np

from saf_gen.camera import Sensor, charge_stack, knot_weights
from saf_gen.stack.time_resolved import FrameRun, PlaneSource

__all__ = ["ChargeSource"]


class ChargeSource:
    """PlaneSource in front of a sensor, in photo-electrons a readout at gain 1.

    ``scale`` multiplies the light (the exposure): 1 at first, and may be set at any time. ``rows``: of these
    rows of the sensor alone. ``keep_bytes``: of a scene that moves, keep what was read up to this.
    """

    def __init__(
        self, plane_source: PlaneSource, sensor: Sensor, *, rows: slice | None = None, keep_bytes: int = 0
    ) -> None:
        self.time_stack, self.sensor, self.scale = plane_source.time_stack, sensor, 1.0
        self._plane_source, self._rows, self._keep_bytes = plane_source, rows, keep_bytes
        # Plain dictionaries: an lru_cache over a method would keep both, and the stacks, until a collection.
        self._still: dict[bool, np.ndarray] = {}  # the whole stack: each light alone, all as one
        self._kept: dict[tuple[int, int], np.ndarray] = {}  # (stack, position): charge (light, row, col)

    def charge_image(self, frame: float, position: float) -> np.ndarray:
        """Photo-electrons a readout at gain 1, float32 (light, row, col), at a moment and a focus position.

        Where a moving scene was not rendered at that position, at the nearest one that was.
        """
        j, w = self._between(frame)
        before = self._at(j, position)
        if w > 0:
            before = before + np.float32(w) * (self._at(j + 1, position) - before)
        return before * np.float32(self.scale)

    def encoder_inputs(
        self, run: FrameRun, *, position: np.ndarray, gain: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Return the arguments of :meth:`saf_gen.camera.Encoder.encode` for a run of frames.

        ``position`` and ``gain`` are those of the whole recording, (T,) and (T, G). One schedule for all
        light groups makes one light of them, as far as the camera can tell.
        """
        positions = self.time_stack.specs[0].positions
        index, fraction = knot_weights(position[run.begin : run.end], positions)
        as_one = bool((gain == gain[:, :1]).all())
        if as_one:
            gain = gain[:, :1]
        gain = gain[run.begin : run.end] * self.scale
        if not self.time_stack.is_moving:
            index = index - self.time_stack.specs[0].first_index
            return {"stack": self._whole(as_one), "index": index, "fraction": fraction, "gain": gain}
        first, stop = int(index.min()), int((index + (fraction > 0)).max()) + 1
        before_and_after = run.slice_index, run.slice_index + 1
        stack = np.concatenate([self._charge(j, first, stop, as_one) for j in before_and_after])
        weight = self.time_stack.interpolation_weight(run)[:, None]
        gain = np.concatenate([gain * (1 - weight), gain * weight], axis=1)
        return {"stack": stack, "index": index - first, "fraction": fraction, "gain": gain}

    def _between(self, frame: float) -> tuple[int, float]:
        """The stack before a moment and the share of the way to the next."""
        if not self.time_stack.is_moving:
            return 0, 0.0
        at = self.time_stack.slice_frames
        j = min(max(int(np.searchsorted(at, frame + 0.5, side="right")) - 1, 0), len(at) - 2)
        return j, float(np.clip((frame + 0.5 - at[j]) / (at[j + 1] - at[j]), 0, 1))

    def _at(self, j: int, position: float) -> np.ndarray:
        spec = self.time_stack.specs[j]
        last = spec.first_index + spec.rendered_count - 1
        knot = float(np.clip(position * (spec.positions - 1), spec.first_index, last))
        k = min(int(knot), last - 1)
        charge = self._charge(j, k, k + 2)
        return charge[:, 0] + np.float32(knot - k) * (charge[:, 1] - charge[:, 0])

    def _charge(self, j: int, first: int, stop: int, as_one: bool = False) -> np.ndarray:
        """Charge float32 (light, focus, row, col) of stack j at positions first <= k < stop of the travel.

        Before the exposure; ``as_one``: all light groups as one.
        """
        if self.time_stack.is_moving:
            charge = np.stack(self._planes(j, first, stop), axis=1)
            return charge.sum(axis=0, keepdims=True) if as_one else charge
        begin = self.time_stack.specs[0].first_index
        return self._whole(as_one)[:, first - begin : stop - begin]

    def _whole(self, as_one: bool) -> np.ndarray:
        """The same of a scene that stands still, at all rendered positions."""
        if False not in self._still:
            spec = self.time_stack.specs[0]
            self._still[False] = self._developed(0, spec.first_index, spec.first_index + spec.rendered_count)
        if as_one not in self._still:
            self._still[True] = self._still[False].sum(axis=0, keepdims=True)
        return self._still[as_one]

    def _planes(self, j: int, first: int, stop: int) -> list[np.ndarray]:
        """The same of a scene that moves, position by position; those not yet in memory are read."""
        lacking = [k for k in range(first, stop) if (j, k) not in self._kept]
        if lacking:
            begin, end = lacking[0], lacking[-1] + 1
            charge = self._developed(j, begin, end)
            self._kept |= {(j, k): charge[:, k - begin].copy() for k in range(begin, end)}
        found = [self._kept[j, k] for k in range(first, stop)]
        over = len(self._kept) - self._keep_bytes // found[0].nbytes
        if over > 0:  # the oldest go; neighbours stay, for a moment of the scene lies between two stacks
            for key in [key for key in self._kept if abs(key[0] - j) > 1][:over]:
                del self._kept[key]
        return found

    def _developed(self, j: int, first: int, stop: int) -> np.ndarray:
        """The same, read and worked out anew."""
        spec = self.time_stack.specs[j]
        first, stop = first - spec.first_index, stop - spec.first_index
        radiance = self._plane_source.load_planes(j, first, stop)
        charge = charge_stack(radiance, self.sensor, lens=spec.drive, position=spec.focus[first:stop])
        return charge if self._rows is None else charge[:, :, self._rows].copy()
