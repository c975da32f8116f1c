"""The encoder: integrate-and-fire pixels of a spike camera, from charge to spikes.

A pixel adds the charge of each readout to the charge it holds. When the sum reaches the threshold, the pixel
fires at this readout, at most once, subtracts the threshold, and draws the next one:

    threshold_pixel + N(0, 1)·sqrt(threshold_pixel [shot] + (threshold_noise_rms·threshold_pixel)² [noise])

Shot noise acts through the threshold: Poisson electrons reach a level of n electrons after a mean charge that is
Gamma(n) distributed, so an inter-spike interval measured in mean charge has a variance of exactly n e-². The noise is
read from a table of normal noise (noise_table.py); the first phase is uniform in [0, threshold). At most
``sensor.max_excess_thresholds`` of the charge above the threshold are kept, so that an overload does not echo for long.
The readout after a spike collects ``1 - sensor.post_spike_loss`` of its charge, including dark charge.

Two terms are off, because no figure is known of them. With ``reset_jitter`` the instant of a reset is uncertain: the
charge that comes meanwhile adds (reset_jitter·charge per readout)² to the variance of the next threshold. With
``row_skew`` a row is read before the last one by a fraction e of a readout, and collects 1 - e of this readout's charge
and e of that before: exact for charge that is linear in time, or constant over each readout; else wrong by at most
e·(1 - e)/2 ≤ 1/8 of its largest second derivative, per readout². The first readout takes the one before for its equal.

References
----------
T. Huang et al., 1000x faster camera and machine vision with ordinary devices, Engineering 25, 2023,
doi:10.1016/j.eng.2022.01.012 (the principle); Acnext/SCSim (reset loss, threshold noise).
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from math import gcd

import numpy as np

from saf_gen.camera.encoder_kernel import BLOCK_KEY_STEP, advance_encoder_pixels
from saf_gen.camera.fixed_pattern import FixedPattern, draw_sensor_fixed_pattern
from saf_gen.camera.noise_table import LANES, NOISE_TABLE_SIZE, make_sensor_noise_table
from saf_gen.camera.sensor import Sensor, get_sensor
from saf_gen.core.cores import usable_cores
from saf_gen.core.seeds import derive_seed, make_generator
from saf_gen.core.signals import validate_signal
from saf_gen.errors import BadInput


def encode(charge: np.ndarray, sensor: Sensor | str, *, frames: int, seed: int) -> np.ndarray:
    """Return the spikes of a charge that changes linearly between knots.

    Parameters
    ----------
    charge : float32 (K, H, W), e- per readout, at least 0, at K knots evenly spaced over [0, frames]; one
        knot is a constant charge. Readout t integrates the ramp over [t, t + 1]: its value in the middle.
    sensor : a sensor or its name; the array has the size of ``charge``, not that of the sensor.
    frames : number of readouts, at least 1.
    seed : determines the device, its phases and its noise; the same seed gives the same bits on any machine.

    Returns
    -------
    uint8 (H, W, ceil(frames / 8)); frame t is bit t mod 8, least significant first, of byte t div 8.

    Raises
    ------
    BadInput : an unknown sensor, a wrong shape, or charge that is negative or not finite.
    """
    charge = validate_signal("charge", charge)
    if isinstance(frames, bool) or not isinstance(frames, int | np.integer) or frames < 1:
        raise BadInput(f"frames is {frames!r}", allowed="a whole number of readouts, at least 1")
    sensor = sensor if isinstance(sensor, Sensor) else get_sensor(sensor)
    index, fraction = encoder_knot_weights((np.arange(frames) + 0.5) / frames, charge.shape[0])
    encoder = Encoder(sensor, charge.shape[1:], seed=seed)
    return encoder.encode(charge[None], index=index, fraction=fraction, gain=np.ones((frames, 1), np.float32))


def encoder_knot_weights(position: np.ndarray, knots: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the knot before each position 0...1, int64 (T,), and the fraction to the next, float64 (T,)."""
    knot = np.clip(np.asarray(position, np.float64), 0.0, 1.0) * (knots - 1)
    index = np.minimum(knot.astype(np.int64), max(knots - 2, 0))
    return index, knot - index


class Encoder:
    """A spike camera that records block after block of time and keeps the state of every pixel in between.

    Neither the division into blocks nor the number of threads changes a bit. Memory does not grow with the
    length of the recording.

    Parameters
    ----------
    sensor : the sensor.
    shape : (rows, columns) of the simulated array.
    seed : determines phases and noise (one recording).
    device_seed : determines the fixed pattern (one device); ``seed`` by default.
    rows : record only these rows; they fire as they would in the whole array.
    threads : one per core this process may use by default.
    """

    def __init__(
        self,
        sensor: Sensor,
        shape: tuple[int, ...],
        *,
        seed: int,
        device_seed: int | None = None,
        rows: slice | None = None,
        threads: int | None = None,
    ) -> None:
        if len(shape) != 2 or min(shape) < 1:
            raise BadInput(f"the array's shape is {tuple(shape)}", allowed="(rows, columns), each at least 1")
        self.sensor, self.shape = sensor, (int(shape[0]), int(shape[1]))
        self.pattern = draw_sensor_fixed_pattern(sensor, self.shape, seed=seed if device_seed is None else device_seed)
        self._frames = 0
        self._key = np.uint64(derive_seed("encoder", seed, "noise"))
        self._response = self.pattern.response.ravel()
        self._constants = _pixel_constants(sensor, pattern=self.pattern)
        self._lead, self._before = _row_lead(sensor, self.shape), None
        size = self._response.size
        self._state = np.ones((3, size), np.float32)
        first = make_generator("encoder", seed, "first thresholds").integers(0, NOISE_TABLE_SIZE, size)
        self._state[1] = self._constants[1] + self._constants[2] * make_sensor_noise_table()[first]
        self._state[0] = make_generator("encoder", seed, "phases").random(size, dtype=np.float32) * self._state[1]
        self._threads = threads or usable_cores()
        if rows is not None:
            self._select_rows(rows)
        if self._lead is not None:
            self._before = np.zeros_like(self._lead)

    def _select_rows(self, rows: slice) -> None:
        """Drop all other rows. Noise belongs to blocks of pixels, so the first row must begin one."""
        width = self.shape[1]
        first, last, _ = rows.indices(self.shape[0])
        if first >= last or first * width % LANES:
            raise BadInput(
                f"the rows are {rows}",
                allowed=f"at least one, the first of them a multiple of {LANES // gcd(width, LANES)}",
            )
        pixels = slice(first * width, last * width)
        self.shape = last - first, width
        self._key = np.uint64((int(self._key) + first * width // LANES * BLOCK_KEY_STEP) % 2**64)
        self._response = self._response[pixels].copy()
        self._lead = None if self._lead is None else self._lead[pixels].copy()
        self._constants, self._state = self._constants[:, pixels].copy(), self._state[:, pixels].copy()

    @property
    def frames(self) -> int:
        """Number of readouts recorded so far."""
        return self._frames

    def encode(self, stack: np.ndarray, *, index: np.ndarray, fraction: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Record the next n readouts.

        Readout t collects, before response and dark charge, the sum over light groups g of
        ``gain[t, g]·((1 - fraction[t])·stack[g, index[t]] + fraction[t]·stack[g, index[t] + 1])``.

        Parameters
        ----------
        stack : float32 (G, K, H, W), e- per readout at gain 1.
        index, fraction : (n,), the knot before each readout and the fraction to the next one, 0...1.
        gain : (n, G), the light schedule, at least 0.

        Returns
        -------
        uint8 (H, W, ceil(n / 8)); n is a multiple of 8 in every call but the last.

        Raises
        ------
        BadInput : arrays that do not fit, values out of range, or a call after one that ended within a byte.
        """
        if self._frames % 8:
            raise BadInput(
                f"the previous block ended at readout {self._frames}",
                allowed="blocks of a multiple of 8 readouts, except the last",
            )
        stack = np.asarray(stack)
        if stack.dtype != np.float32 or stack.ndim != 4 or stack.shape[2:] != self.shape or 0 in stack.shape:
            raise BadInput(
                f"the stack is {stack.dtype} of shape {stack.shape}",
                allowed=f"float32 (light, focus, {self.shape[0]}, {self.shape[1]})",
            )
        groups, knots = stack.shape[:2]
        index, fraction, gain = _checked_schedule(index, fraction, gain=gain, groups=groups, knots=knots)
        used = stack[:, index.min() : index.max() + 2]
        if not (used.min() >= 0 and used.max() < np.inf):  # also false for NaN
            raise BadInput("the charge is negative or not finite", allowed="electrons per readout, at least 0")
        frames, size = index.size, self._response.size
        high = (gain * fraction[:, None]).astype(np.float32)
        low = (gain * (1.0 - fraction)[:, None]).astype(np.float32)
        flat = np.ascontiguousarray(stack).reshape(groups, knots, size)
        out = np.empty((size, -(-frames // 8)), np.uint8)
        weight = np.float32(1.0 - self.sensor.post_spike_loss)
        jitter = np.float32(self.sensor.reset_jitter * self.sensor.noise.reset_jitter) or None
        blocks = -(-size // LANES)
        cuts = np.linspace(0, blocks, min(self._threads, blocks) + 1).astype(int).tolist()
        with ThreadPoolExecutor(self._threads) as pool:  # the kernel releases the interpreter's lock
            jobs = [
                pool.submit(
                    advance_encoder_pixels, first, stop, flat, index, low, high, self._key, self._frames,
                    make_sensor_noise_table(), self._response, self._constants, weight, jitter, self._lead,
                    self._before, self._state, out,
                )
                for first, stop in pairwise(cuts)
            ]  # fmt: skip
            for job in jobs:
                job.result()
        self._frames += frames
        return out.reshape(*self.shape, -1)


def _pixel_constants(sensor: Sensor, *, pattern: FixedPattern) -> np.ndarray:
    """Return the kernel's constants per pixel, float32 (4, P): dark charge, mean threshold, its sd, cap."""
    level = pattern.threshold.ravel().astype(np.float64)
    variance = np.zeros_like(level)
    if sensor.noise.shot:
        variance += level
    if sensor.noise.threshold_noise:
        variance += (sensor.threshold_noise_rms * level) ** 2
    cap = level * (sensor.max_excess_thresholds if sensor.reset == "subtract" else 0)
    return np.stack([pattern.dark.ravel(), level, np.sqrt(variance), cap]).astype(np.float32)


def _row_lead(sensor: Sensor, shape: tuple[int, int]) -> np.ndarray | None:
    """Return how many readouts before the last row each pixel is read, float32 (P,); None if all are read at once."""
    if not sensor.row_skew:
        return None
    lead = sensor.row_skew * np.linspace(1, 0, shape[0])
    return np.repeat(lead.astype(np.float32), shape[1])


def _checked_schedule(
    index: np.ndarray, fraction: np.ndarray, *, gain: np.ndarray, groups: int, knots: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    index = np.ascontiguousarray(index, dtype=np.int64)
    fraction, gain = np.asarray(fraction, np.float64), np.asarray(gain, np.float64)
    frames = index.size
    if index.ndim != 1 or frames == 0 or fraction.shape != (frames,) or gain.shape != (frames, groups):
        raise BadInput(
            f"index, fraction and gain have shapes {index.shape}, {fraction.shape}, {gain.shape}",
            allowed=f"(n,), (n,) and (n, {groups}) with n at least 1",
        )
    if not (fraction.min() >= 0 and fraction.max() <= 1):
        raise BadInput("fraction is outside 0...1", allowed="the fraction from one knot to the next")
    last = int((index + (fraction > 0)).max())
    if index.min() < 0 or last >= knots:
        raise BadInput(f"index reaches from knot {index.min()} to knot {last}", allowed=f"0 to {knots - 1}")
    if not (gain.min() >= 0 and gain.max() < np.inf):
        raise BadInput("gain is negative or not finite", allowed="light gains, at least 0")
    return index, fraction, gain
