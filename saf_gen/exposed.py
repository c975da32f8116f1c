"""A recording's stacks as charge: what the sensor collects at any frame and focus position.

Unless told to keep more, at most two stacks are in memory, those between which a moving scene is.
"""

import numpy as np

from saf_gen.camera import Sensor, charge_stack, knot_weights
from saf_gen.reel import Footage

__all__ = ["Exposed"]


class Exposed:
    """Footage in front of a sensor, in photo-electrons a readout at gain 1.

    ``scale`` multiplies the light (the exposure): 1 at first, and may be set at any time. ``rows``: of these
    rows of the sensor alone. ``keep_bytes``: keep more than two stacks in memory while they take no more.
    """

    def __init__(
        self, footage: Footage, sensor: Sensor, *, rows: slice | None = None, keep_bytes: int = 0
    ) -> None:
        self.reel, self.sensor, self.scale = footage.reel, sensor, 1.0
        self._footage, self._rows, self._keep_bytes = footage, rows, keep_bytes
        # Plain dictionaries: an lru_cache over a method would keep both, and the stacks, until a collection.
        self._charges: dict[int, np.ndarray] = {}
        self._sums: dict[int, np.ndarray] = {}

    def picture(self, frame: float, position: float) -> np.ndarray:
        """Photo-electrons a readout at gain 1, float32 (light, row, col), at a moment and a focus position.

        Where a moving scene was not rendered at that position, at the nearest one that was.
        """
        j, w = self._between(frame)
        before = self._at(j, position)
        if w > 0:
            before = before + np.float32(w) * (self._at(j + 1, position) - before)
        return before * np.float32(self.scale)

    def lights(
        self, begin: int, end: int, j: int, position: np.ndarray, gain: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """What :meth:`saf_gen.camera.Encoder.encode` takes for frames begin <= t < end, a run of the reel.

        ``position`` and ``gain`` are those of the whole recording, (T,) and (T, G). One schedule for all
        light groups makes one light of them, as far as the camera can tell.
        """
        positions, specs = self.reel.specs[0].positions, self.reel.specs
        index, fraction = knot_weights(position[begin:end], positions)
        charge = self._charge
        if (gain == gain[:, :1]).all():
            gain, charge = gain[:, :1], self._summed
        gain = gain[begin:end] * self.scale
        if not self.reel.moves:
            return charge(j), index, fraction, gain
        first, last = int(index.min()), int((index + (fraction > 0)).max())
        both = [charge(n)[:, first - specs[n].first : last + 1 - specs[n].first] for n in (j, j + 1)]
        way = self.reel.way(begin, end, j)[:, None]
        gains = np.concatenate([gain * (1 - way), gain * way], axis=1)
        return np.concatenate(both), index - first, fraction, gains

    def _between(self, frame: float) -> tuple[int, float]:
        """The stack before a moment and the share of the way to the next."""
        if not self.reel.moves:
            return 0, 0.0
        at = self.reel.frames
        j = min(max(int(np.searchsorted(at, frame + 0.5, side="right")) - 1, 0), len(at) - 2)
        return j, float(np.clip((frame + 0.5 - at[j]) / (at[j + 1] - at[j]), 0, 1))

    def _at(self, j: int, position: float) -> np.ndarray:
        charge, spec = self._charge(j), self.reel.specs[j]
        knot = float(np.clip(position * (spec.positions - 1) - spec.first, 0, spec.rendered - 1))
        k = min(int(knot), spec.rendered - 2)
        return charge[:, k] + np.float32(knot - k) * (charge[:, k + 1] - charge[:, k])

    def _charge(self, j: int) -> np.ndarray:
        """Charge float32 (light, focus, row, col) of stack j, before the exposure."""
        if j not in self._charges:
            self._make_room(self._charges)
            stack = self._footage.stack(j)
            drive = stack.spec.drive
            charge = charge_stack(
                stack.radiance,
                drive.image_distance(stack.spec.focus),
                drive.aperture_radius_m,
                self.sensor,
                transmission=drive.transmission,
            )
            self._charges[j] = charge if self._rows is None else charge[:, :, self._rows].copy()
        return self._charges[j]

    def _summed(self, j: int) -> np.ndarray:
        """The same with all light groups as one."""
        if j not in self._sums:
            self._make_room(self._sums)
            self._sums[j] = self._charge(j).sum(axis=0, keepdims=True)
        return self._sums[j]

    def _make_room(self, kept: dict[int, np.ndarray]) -> None:
        """Let go of the oldest but one: of a scene that moves two stacks are needed at a time."""
        while len(kept) > 1 and sum(charge.nbytes for charge in kept.values()) > self._keep_bytes:
            del kept[next(iter(kept))]
