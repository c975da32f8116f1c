"""The encoder: integrate-and-fire pixels that turn charge into spikes.

A pixel adds the charge of each readout to the charge that it holds. When the sum reaches the threshold, the pixel fires
at this readout, at most once, subtracts the threshold, and draws the next threshold:

    threshold_pixel + N(0, 1)·sqrt(threshold_pixel [shot] + (threshold_noise_rms·threshold_pixel)² [noise])

Shot noise acts through the threshold: Poisson electrons reach a level of n electrons after a mean charge that is
Gamma(n) distributed, so an interval between spikes, measured in mean charge, has a variance of exactly n e-². The noise
is read from a table in ``encoder_kernel``; the first phase is uniform in [0, threshold). At a spike, at most
``sensor.max_excess_thresholds`` thresholds of excess charge are kept, so that the effect of an overload ends soon. The
readout after a spike collects the fraction ``1 - sensor.post_spike_loss`` of its charge, including dark charge.

Two terms are off in all sensors that come with saf_gen, because no values are published. With ``reset_jitter`` the
instant of a reset is uncertain: the charge that arrives in the meantime adds (reset_jitter·charge per readout)² to the
variance of the next threshold. With ``row_skew`` a row is read a fraction e of a readout before the last row, and
collects 1 - e of the charge of this readout and e of the charge of the previous one; the first readout uses its own
charge for both. This is exact for charge that is linear in time or constant over each readout; otherwise the error is
at most e·(1 - e)/2 ≤ 1/8 of the largest second derivative of the charge, per readout².

References
----------
T. Huang et al., 1000x faster camera and machine vision with ordinary devices, Engineering 25, 2023,
doi:10.1016/j.eng.2022.01.012 (the principle); Acnext/SCSim (reset loss, threshold noise).
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from math import gcd

import numpy as np

from saf_gen.camera.camera import BitCamera
from saf_gen.camera.encoder_kernel import BLOCK_KEY_STEP, LANES, NOISE_TABLE_SIZE, advance_pixels, make_noise_table
from saf_gen.camera.fixed_pattern import FixedPattern, draw_fixed_pattern
from saf_gen.camera.sensor import Sensor
from saf_gen.camera.sensor_files import get_sensor
from saf_gen.core.cores import usable_cores
from saf_gen.core.seeds import derive_seed, make_generator
from saf_gen.core.signals import validate_signal
from saf_gen.errors import BadInput


def encode(charge: np.ndarray, sensor: Sensor | str, *, frames: int, seed: int) -> np.ndarray:
    """Return the spikes that a sensor fires for a charge that changes linearly between knots.

    Parameters
    ----------
    charge : ndarray of float32, shape (K, H, W)
        Charge in electrons per readout, at least 0, at K knots evenly spaced over [0, frames]; a single knot is a
        constant charge. Readout t integrates the charge over [t, t + 1].
    sensor : Sensor or str
        A sensor or its name. The array has the size of ``charge``, not the sensor's size.
    frames : int
        Number of readouts, at least 1.
    seed : int
        Seed of the device, its phases and its noise. The same seed gives the same bits on any machine.

    Returns
    -------
    ndarray of uint8, shape (H, W, ceil(frames / 8))
        Packed spikes: frame t is bit t mod 8, least significant first, of byte t div 8.

    Raises
    ------
    BadInput
        If the sensor is unknown, ``charge`` has a wrong shape or dtype or is negative or not finite, or ``frames`` is
        not an integer of at least 1.
    """
    charge = validate_signal("charge", charge)
    if isinstance(frames, bool) or not isinstance(frames, int | np.integer) or frames < 1:
        raise BadInput(f"frames is {frames!r}", allowed="a whole number of readouts, at least 1")
    sensor = sensor if isinstance(sensor, Sensor) else get_sensor(sensor)
    index, fraction = knot_weights((np.arange(frames) + 0.5) / frames, charge.shape[0])
    encoder = Encoder(sensor, charge.shape[1:], seed=seed)
    return encoder.encode(charge[None], index=index, fraction=fraction, gain=np.ones((frames, 1), np.float32))


def knot_weights(position: np.ndarray, knots: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the knot before each position, int64 (T,), and the fraction of the way to the next knot, float64 (T,).

    Positions run from 0 at the first of the evenly spaced knots to 1 at the last; others are clipped to this range.
    """
    knot = np.clip(np.asarray(position, np.float64), 0.0, 1.0) * (knots - 1)
    index = np.minimum(knot.astype(np.int64), max(knots - 2, 0))
    return index, knot - index


class Encoder(BitCamera):
    """A spike camera that records block after block of time and keeps the state of every pixel in between.

    The spikes depend neither on the division into blocks nor on the number of threads. Memory does not grow with the
    length of the recording.

    Parameters
    ----------
    sensor : Sensor
        The sensor to simulate.
    shape : tuple of int
        Rows and columns of the simulated array.
    seed : int
        Seed of phases and noise, which differ between recordings.
    device_seed : int, optional
        Seed of the fixed pattern, which identifies a device; by default ``seed``.
    rows : slice, optional
        Rows to record; they fire exactly as in the full array. By default all rows are recorded.
    threads : int, optional
        Number of threads; by default one per core that this process may use.

    Raises
    ------
    BadInput
        If ``shape`` is not two numbers of at least 1, or ``rows`` is empty or begins at a row that does not begin a
        block of 64 pixels; the message gives the allowed first rows.
    """

    sensor_type = Sensor

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
        self.pattern = draw_fixed_pattern(sensor, self.shape, seed=seed if device_seed is None else device_seed)
        self._frames = 0
        self._key = np.uint64(derive_seed("encoder", seed, "noise"))
        self._response = self.pattern.response.ravel()
        self._constants = _pixel_constants(sensor, pattern=self.pattern)
        self._lead, self._before = _row_lead(sensor, self.shape), None
        size = self._response.size
        self._state = np.ones((3, size), np.float32)
        first = make_generator("encoder", seed, "first thresholds").integers(0, NOISE_TABLE_SIZE, size)
        self._state[1] = self._constants[1] + self._constants[2] * make_noise_table()[first]
        self._state[0] = make_generator("encoder", seed, "phases").random(size, dtype=np.float32) * self._state[1]
        self._threads = threads or usable_cores()
        if rows is not None:
            self._select_rows(rows)
        if self._lead is not None:
            self._before = np.zeros_like(self._lead)

    def _select_rows(self, rows: slice) -> None:
        """Drop all other rows; the first row must begin a block of pixels, because blocks share their noise."""
        width = self.shape[1]
        first, last, _ = rows.indices(self.shape[0])
        if first >= last or first * width % LANES:
            raise BadInput(
                f"the rows are {rows}",
                allowed=f"at least one row, beginning at a multiple of {LANES // gcd(width, LANES)}",
            )
        pixels = slice(first * width, last * width)
        self.shape = last - first, width
        self._key = np.uint64((int(self._key) + first * width // LANES * BLOCK_KEY_STEP) % 2**64)
        self._response = self._response[pixels].copy()
        self._lead = None if self._lead is None else self._lead[pixels].copy()
        self._constants, self._state = self._constants[:, pixels].copy(), self._state[:, pixels].copy()

    @property
    def frames(self) -> int:
        """Readouts recorded so far."""
        return self._frames

    def encode(self, stack: np.ndarray, *, index: np.ndarray, fraction: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Record the next n readouts and return their spikes.

        Readout t collects, before response and dark charge are applied, the sum over light groups g of
        ``gain[t, g]·((1 - fraction[t])·stack[g, index[t]] + fraction[t]·stack[g, index[t] + 1])``.

        Parameters
        ----------
        stack : ndarray of float32, shape (G, K, H, W)
            Charge of each light group at each knot, electrons per readout at gain 1.
        index : ndarray of int, shape (n,)
            Knot before each readout.
        fraction : ndarray, shape (n,)
            Fraction of the way to the next knot, 0 to 1.
        gain : ndarray, shape (n, G)
            Gain of each light group at each readout, at least 0.

        Returns
        -------
        ndarray of uint8, shape (H, W, ceil(n / 8))
            Packed spikes, one bit per readout. n must be a multiple of 8 in every call except the last.

        Raises
        ------
        BadInput
            If shapes or dtypes do not match, a value is out of range, or the previous call did not record a multiple of
            8 readouts.
        """
        stack, index, low, high = check_schedule(
            stack, index=index, fraction=fraction, gain=gain, shape=self.shape, done=self._frames
        )
        frames, size = index.size, self._response.size
        flat = np.ascontiguousarray(stack).reshape(*stack.shape[:2], size)
        out = np.empty((size, -(-frames // 8)), np.uint8)
        weight = np.float32(1.0 - self.sensor.post_spike_loss)
        jitter = np.float32(self.sensor.reset_jitter * self.sensor.noise.reset_jitter) or None
        blocks = -(-size // LANES)
        cuts = np.linspace(0, blocks, min(self._threads, blocks) + 1).astype(int).tolist()
        with ThreadPoolExecutor(self._threads) as pool:  # the kernel releases the interpreter's lock
            jobs = [
                pool.submit(
                    advance_pixels, first, stop, flat, index, low, high, self._key, self._frames,
                    make_noise_table(), self._response, self._constants, weight, jitter, self._lead,
                    self._before, self._state, out,
                )
                for first, stop in pairwise(cuts)
            ]  # fmt: skip
            for job in jobs:
                job.result()
        self._frames += frames
        return out.reshape(*self.shape, -1)


def _pixel_constants(sensor: Sensor, *, pattern: FixedPattern) -> np.ndarray:
    """Return constants of each pixel, float32 (4, P): dark charge, mean and sd of the threshold, largest excess."""
    level = pattern.threshold.ravel().astype(np.float64)
    variance = np.zeros_like(level)
    if sensor.noise.shot:
        variance += level
    if sensor.noise.threshold_noise:
        variance += (sensor.threshold_noise_rms * level) ** 2
    cap = level * (sensor.max_excess_thresholds if sensor.reset == "subtract" else 0)
    return np.stack([pattern.dark.ravel(), level, np.sqrt(variance), cap]).astype(np.float32)


def _row_lead(sensor: Sensor, shape: tuple[int, int]) -> np.ndarray | None:
    """Return by how many readouts each pixel is read before the last row, float32 (P,); None without row skew."""
    if not sensor.row_skew:
        return None
    lead = sensor.row_skew * np.linspace(1, 0, shape[0])
    return np.repeat(lead.astype(np.float32), shape[1])


def check_schedule(
    stack: np.ndarray, *, index: np.ndarray, fraction: np.ndarray, gain: np.ndarray, shape: tuple[int, int], done: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return what a camera is given as its kernel takes it: the stack, the knots, and the weights of both knots.

    Raises BadInput as :meth:`Encoder.encode` does; ``done`` are the readouts before.
    """
    if done % 8:
        raise BadInput(
            f"the previous block ended at readout {done}", allowed="blocks of a multiple of 8 readouts, except the last"
        )
    stack = np.asarray(stack)
    if stack.dtype != np.float32 or stack.ndim != 4 or stack.shape[2:] != shape or 0 in stack.shape:
        raise BadInput(
            f"the stack is {stack.dtype} of shape {stack.shape}",
            allowed=f"float32 (light, focus, {shape[0]}, {shape[1]})",
        )
    groups, knots = stack.shape[:2]
    index, fraction, gain = _checked_course(index, fraction, gain=gain, groups=groups, knots=knots)
    used = stack[:, index.min() : index.max() + 2]
    if not (used.min() >= 0 and used.max() < np.inf):  # also false for NaN
        raise BadInput("the charge is negative or not finite", allowed="electrons per readout, at least 0")
    high = (gain * fraction[:, None]).astype(np.float32)
    low = (gain * (1.0 - fraction)[:, None]).astype(np.float32)
    return stack, index, low, high


def _checked_course(
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
        raise BadInput("fraction is outside 0 to 1", allowed="the fraction of the way to the next knot, 0 to 1")
    last = int((index + (fraction > 0)).max())
    if index.min() < 0 or last >= knots:
        raise BadInput(f"index reaches from knot {index.min()} to knot {last}", allowed=f"0 to {knots - 1}")
    if not (gain.min() >= 0 and gain.max() < np.inf):
        raise BadInput("gain is negative or not finite", allowed="light gains, at least 0")
    return index, fraction, gain
