"""Recording of single photons: the bits that an array reads out, frame by frame."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from math import gcd

import numpy as np

from saf_gen.camera.camera import BitCamera
from saf_gen.camera.encoder import check_schedule
from saf_gen.camera.encoder_kernel import LANES
from saf_gen.camera.events.camera import exponential_waits
from saf_gen.camera.fixed_pattern import draw_relative_dark
from saf_gen.camera.photons.kernel import expose_clocked, expose_passive
from saf_gen.camera.photons.sensor import SpadSensor
from saf_gen.core.cores import usable_cores
from saf_gen.core.seeds import derive_seed, make_generator
from saf_gen.errors import BadInput

_GRID = 2.0**-16  # of the mean, to which maps are rounded, so that machines whose logarithms differ agree
WORDS = 16  # random words of 32 bits for 64 frames of a pixel


class SpadCamera(BitCamera):
    """A single-photon array that records block after block of time; it is called as :class:`saf_gen.camera.Encoder` is.

    The bits depend neither on the division into blocks nor on the number of threads. Memory does not grow with the
    length of the recording.

    Parameters
    ----------
    sensor : SpadSensor
        The sensor to simulate.
    shape : tuple of int
        Rows and columns of the simulated array.
    seed : int
        Seed of the photons.
    device_seed : int, optional
        Seed of what differs between pixels; by default ``seed``.
    rows : slice, optional
        Rows to record; they detect exactly as in the full array. By default all rows are recorded.
    threads : int, optional
        Number of threads; by default one per core that this process may use.

    Raises
    ------
    BadInput
        If ``shape`` is not two numbers of at least 1, or ``rows`` is empty or begins at a row that does not begin a
        block of 64 pixels.
    """

    sensor_type, model = SpadSensor, 2

    def __init__(
        self,
        sensor: SpadSensor,
        shape: tuple[int, ...],
        *,
        seed: int,
        device_seed: int | None = None,
        rows: slice | None = None,
        threads: int | None = None,
    ) -> None:
        if len(shape) != 2 or min(shape) < 1:
            raise BadInput(f"the array's shape is {tuple(shape)}", allowed="(rows, columns), each at least 1")
        self.sensor, self.shape, self.frames = sensor, (int(shape[0]), int(shape[1])), 0
        self._response, self._dark = _draw_device(sensor, self.shape, seed=seed if device_seed is None else device_seed)
        size = self._response.size
        self._words = _random_words("pixels", range(size), seed=seed)
        if rows is not None:
            first, last, _ = rows.indices(self.shape[0])
            if first >= last or first * self.shape[1] % LANES:
                raise BadInput(
                    f"the rows are {rows}",
                    allowed=f"at least one row, beginning at a multiple of {LANES // gcd(self.shape[1], LANES)}",
                )
            kept = slice(first * self.shape[1], last * self.shape[1])
            self.shape = last - first, self.shape[1]
            self._response, self._dark = self._response[kept].copy(), self._dark[kept].copy()
            self._words, size = self._words[:, kept].copy(), kept.stop - kept.start
        self._seed, self._threads = seed, threads or usable_cores()
        self._fired, self._blind = np.zeros(size, np.uint64), np.zeros((2, size))
        q = sensor.afterpulse_on
        self._waits = 1 - np.cumprod(np.r_[1.0, np.full(LANES, 1 - q)]) if q else None

    def encode(self, stack: np.ndarray, *, index: np.ndarray, fraction: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Record the next n frames and return their bits, packed as spikes are.

        Parameters
        ----------
        stack : ndarray of float32, shape (G, K, H, W)
            Light of each group at each knot: photons that a pixel which is never blind would detect in a whole frame at
            gain 1.
        index, fraction, gain : ndarray
            As in :meth:`saf_gen.camera.Encoder.encode`.

        Returns
        -------
        ndarray of uint8, shape (H, W, ceil(n / 8))
            Packed bits. n must be a multiple of 8 in every call except the last.

        Raises
        ------
        BadInput
            As :meth:`saf_gen.camera.Encoder.encode`.
        """
        stack, index, low, high = check_schedule(
            stack, index=index, fraction=fraction, gain=gain, shape=self.shape, done=self.frames
        )
        frames, size, sensor = index.size, self._response.size, self.sensor
        flat = np.ascontiguousarray(stack).reshape(*stack.shape[:2], size)
        low, high = (weight * np.float32(sensor.gate) for weight in (low, high))
        out = np.zeros((size, -(-frames // 8)), np.uint8)
        blocks = -(-size // LANES)
        cuts = np.linspace(0, blocks, min(self._threads, blocks) + 1).astype(int).tolist()
        light, device = (flat, index, low, high), (self._response, self._dark)
        with ThreadPoolExecutor(self._threads) as pool:  # the kernels release the interpreter's lock
            if sensor.recharge == "clocked":
                numbers = range(self.frames // LANES * WORDS, -(-(self.frames + frames) // LANES) * WORDS)
                words = _random_words("frames", numbers, seed=self._seed)
                state = self._waits, self._fired, out
                jobs = [
                    pool.submit(expose_clocked, first, stop, self.frames, *light, self._words, words, *device, *state)
                    for first, stop in pairwise(cuts)
                ]
            else:
                words = _random_words("frames", range(self.frames, self.frames + frames), seed=self._seed)
                of_device = float(sensor.afterpulse_on), self._blind, out
                of_time = exponential_waits(), float(sensor.gate), float(sensor.dead_frames)
                jobs = [
                    pool.submit(expose_passive, first, stop, *light, self._words, words, *device, *of_device, *of_time)
                    for first, stop in pairwise(cuts)
                ]
            for job in jobs:
                job.result()
        self.frames += frames
        return out.reshape(*self.shape, -1)


def _random_words(what: str, numbers: range, *, seed: int) -> np.ndarray:
    """Return two random words for each number of a pixel or frame, uint32 (2, n), whatever the range begins with."""
    key = np.uint64(derive_seed("spad", seed, what))
    with np.errstate(over="ignore"):
        word = key + np.arange(numbers.start, numbers.stop, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):  # SplitMix64
            word = (word ^ (word >> np.uint64(shift))) * np.uint64(factor)
    word ^= word >> np.uint64(31)
    return np.stack([word >> np.uint64(32), word & np.uint64(0xFFFFFFFF)]).astype(np.uint32)


def _draw_device(sensor: SpadSensor, shape: tuple[int, int], *, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the relative detection probability and the dark counts per frame of each pixel, float32 (P,)."""
    response = np.ones(shape)
    if sensor.noise.response:
        spread = make_generator("spad", seed, "response").standard_normal(shape) * sensor.response_rms
        response = np.rint(np.maximum(1 + spread, 0) / _GRID) * _GRID
    dark = np.rint(draw_relative_dark(sensor, shape, seed=seed) / _GRID) * _GRID * sensor.mean_dark
    return response.ravel().astype(np.float32), dark.ravel().astype(np.float32)
