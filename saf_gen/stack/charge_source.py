"""The charge that a sensor collects from recorded focal stacks, at any frame and focus position.

The complete stack of a static scene is held in memory. For a moving scene, only the focus positions that the lens
visits are read, and by default those of at most three stacks are held in memory.
"""

import numpy as np

from saf_gen.camera import charge_of_images, electrons_per_irradiance, knot_weights
from saf_gen.camera.camera import Span
from saf_gen.camera.exposure import Pixels
from saf_gen.stack.colour import Colour
from saf_gen.stack.focal_stack import PICTURES
from saf_gen.stack.time_resolved import PlaneSource


class ChargeSource:
    """The planes of a :class:`PlaneSource` as photo-electrons per readout at gain 1, in all or some rows of the sensor.

    Parameters
    ----------
    plane_source : PlaneSource
        Source of the image planes.
    sensor : Sensor, SpadSensor or FrameSensor
        Sensor that collects the charge.
    rows : slice, optional
        Rows of the sensor; by default all.
    cache_bytes : int, default 0
        Memory in which planes of a moving scene are kept for the next run.
    colour : Colour, optional
        Lamps of the recording, which then take the place of the light groups; by default each group is a lamp in light
        of one wavelength.

    Attributes
    ----------
    scale : float
        Factor on the light (the exposure); 1 at first, and may be set at any time.
    """

    def __init__(
        self,
        plane_source: PlaneSource,
        sensor: Pixels,
        *,
        rows: slice | None = None,
        cache_bytes: int = 0,
        colour: Colour | None = None,
    ) -> None:
        self.time_stack, self.sensor, self.scale = plane_source.time_stack, sensor, 1.0
        self._plane_source, self._rows, self._cache_bytes, self._colour = plane_source, rows, cache_bytes, colour
        # Plain dictionaries, because an lru_cache on a method would keep self and the stacks until garbage collection.
        self._static: dict[bool, np.ndarray] = {}  # charge of the full stack, summed over lights or not
        self._cache: dict[tuple[int, int], np.ndarray] = {}  # (stack, position): charge (light, row, col)

    def charge_image(self, frame: float, position: float) -> np.ndarray:
        """Return photo-electrons per readout at gain 1, float32 (light, row, col), at a frame and a position.

        Beyond the positions rendered for a moving scene, the nearest rendered ones are used.
        """
        j, weight = self._slice_weight(frame)
        before = self._charge_at(j, position)
        if weight > 0:
            before = before + np.float32(weight) * (self._charge_at(j + 1, position) - before)
        return before * np.float32(self.scale)

    def nominal_image(self, frame: float, position: float) -> np.ndarray:
        """Return the charge of all light groups together at gain 1, float32 (row, col).

        A group with several lamps counts as their mean.
        """
        charge = self.charge_image(frame, position)
        if self._colour is not None:
            charge = charge * self._colour.shares[:, None, None]
        return np.asarray(charge.sum(axis=0))

    def encoder_inputs(self, run: Span, *, position: np.ndarray, gain: np.ndarray) -> dict[str, np.ndarray]:
        """Return the arguments of :meth:`saf_gen.camera.Encoder.encode` for a run of frames.

        Light groups that share one gain are summed, because the camera cannot distinguish them.

        Parameters
        ----------
        run : Span
            Frames among the same time slices.
        position : ndarray, shape (T,)
            Position of the lens in each readout of the recording, 0 to 1.
        gain : ndarray, shape (T, G)
            Gain of each light group in each readout of the recording.
        """
        spec = self.time_stack.specs[0]
        index, fraction = knot_weights(position[run.begin : run.end], spec.positions)
        summed = bool((gain == gain[:, :1]).all())
        gain = (gain[:, :1] if summed else gain)[run.begin : run.end] * self.scale
        if not self.time_stack.is_moving:
            stack = self._static_charge(summed=summed)
            return {"stack": stack, "index": index - spec.drawn.start, "fraction": fraction, "gain": gain}
        first, stop = int(index.min()), int((index + (fraction > 0)).max()) + 1
        stack = self.stack(run, range(first, stop), summed=summed)
        weights = self.time_stack.interpolation_weights(run)
        gain = np.concatenate([gain * weight[:, None] for weight in weights.T], axis=1)
        return {"stack": stack, "index": index - first, "fraction": fraction, "gain": gain}

    def stack(self, run: Span, positions: range, *, summed: bool = False) -> np.ndarray:
        """Return the charge at position indices during a run of frames, float32 (light, focus, row, col), at scale 1.

        In a moving scene the lights of the earliest time slice come first, and then those of the next ones. ``summed``
        adds up the lights of each. Of a position at which a stack was not rendered it gives the nearest picture: its
        weight is 0 there, or all but 0 if another camera meets the lens between two readouts of the first one.
        """
        return np.concatenate([self._charge(j, positions, summed=summed) for j in self.time_stack.stacks_of(run)])

    def _slice_weight(self, frame: float) -> tuple[int, float]:
        """Return the index of the stack before the middle of a frame, and the weight of the next one, 0 to 1."""
        if not self.time_stack.is_moving:
            return 0, 0.0
        starts = self.time_stack.slice_frames
        j = min(max(int(np.searchsorted(starts, frame + 0.5, side="right")) - 1, 0), len(starts) - 2)
        apart = max(starts[j + 1] - starts[j], 1)  # 0 if both belong to one readout of a slow camera
        return j, float(np.clip((frame + 0.5 - starts[j]) / apart, 0, 1))

    def _charge_at(self, j: int, position: float) -> np.ndarray:
        """Return the charge of stack j at one focus position, (light, row, col), without the exposure."""
        spec = self.time_stack.specs[j]
        last = spec.drawn.stop - 1
        knot = float(np.clip(position * (spec.positions - 1), spec.drawn.start, last))
        k = min(int(knot), last - 1)
        charge = self._charge(j, range(k, k + 2))
        return charge[:, 0] + np.float32(knot - k) * (charge[:, 1] - charge[:, 0])

    def _charge(self, j: int, positions: range, *, summed: bool = False) -> np.ndarray:
        """Return the charge of stack j at position indices, float32 (light, focus, row, col), without the exposure.

        ``summed`` adds up the light groups.
        """
        if self.time_stack.is_moving:
            drawn = self.time_stack.specs[j].drawn
            nearest = np.clip(positions, drawn.start, drawn.stop - 1)
            planes = self._cached_planes(j, range(int(nearest[0]), int(nearest[-1]) + 1))
            charge = np.stack([planes[k - nearest[0]] for k in nearest], axis=1)
            return charge.sum(axis=0, keepdims=True) if summed else charge
        begin = self.time_stack.specs[0].drawn.start
        return self._static_charge(summed=summed)[:, positions.start - begin : positions.stop - begin]

    def _static_charge(self, *, summed: bool) -> np.ndarray:
        """Return the charge of a static scene at all rendered positions."""
        if False not in self._static:
            self._static[False] = self._load_charge(0, self.time_stack.specs[0].drawn)
        if summed not in self._static:
            self._static[True] = self._static[False].sum(axis=0, keepdims=True)
        return self._static[summed]

    def _cached_planes(self, j: int, positions: range) -> list[np.ndarray]:
        """Return the charge of a moving scene plane by plane; planes that are not in memory are read."""
        lacking = [k for k in positions if (j, k) not in self._cache]
        if lacking:
            begin, end = lacking[0], lacking[-1] + 1
            charge = self._load_charge(j, range(begin, end))
            self._cache |= {(j, k): charge[:, k - begin].copy() for k in range(begin, end)}
        found = [self._cache[j, k] for k in positions]
        excess = len(self._cache) - self._cache_bytes // found[0].nbytes
        if excess > 0:  # drop the oldest, except neighbours: a moment of the scene is between two stacks
            for key in [key for key in self._cache if abs(key[0] - j) > 1][:excess]:
                del self._cache[key]
        return found

    def _load_charge(self, j: int, positions: range) -> np.ndarray:
        """Read planes of stack j and return their charge."""
        spec = self.time_stack.specs[j]
        first, stop = positions.start - spec.first_index, positions.stop - spec.first_index
        if self._colour is None:
            radiance = self._plane_source.load_planes(j, first, stop)
        else:
            before, after = spec.margin
            wide = range(positions.start - before, positions.stop + after)
            planes = self._plane_source.load_planes(j, wide.start - spec.first_index, wide.stop - spec.first_index)
            radiance = self._colour.mix(planes, spec, drawn=positions, rendered=wide)
        if spec.estimator == PICTURES:  # the light that fell on a sensor, in a unit that the exposure makes good
            charge = radiance * np.float32(electrons_per_irradiance(self.sensor))
        else:
            charge = charge_of_images(radiance, self.sensor, lens=spec.drive, position=spec.focus[first:stop])
        return charge if self._rows is None else charge[:, :, self._rows].copy()
