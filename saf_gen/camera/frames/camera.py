"""Recording of frames: light collected over an exposure, and the numbers that are read out of it."""

from collections.abc import Iterator
from math import ceil

import numpy as np

from saf_gen.camera.camera import Camera, LensCourse, Light, Span
from saf_gen.camera.encoder import knot_weights
from saf_gen.camera.fixed_pattern import draw_relative_dark
from saf_gen.camera.frames.kernel import add_planes, read_out
from saf_gen.camera.frames.sensor import FrameSensor
from saf_gen.core.seeds import derive_seed, make_generator
from saf_gen.errors import BadInput

STEP_S, LEAST_STEPS = 5e-5, 8  # of an exposure, in which the lens is followed
_GRID = 2.0**-16  # of the mean, to which maps are rounded, so that machines whose logarithms differ agree


class FrameCamera(Camera):
    """A frame camera; a frame depends on its number and its light, and on nothing before it.

    Parameters
    ----------
    sensor : FrameSensor
        The sensor to simulate.
    shape : tuple of int
        Rows and columns of the simulated array.
    seed : int
        Seed of the noise.
    device_seed : int, optional
        Seed of what differs between pixels; by default ``seed``.
    rows : slice, optional
        Not used: all rows are exposed.
    threads : int, optional
        Not used: frames are exposed one after another.

    Raises
    ------
    BadInput
        If ``shape`` is not two numbers of at least 1.
    """

    sensor_type, form, model, keeps_state = FrameSensor, "frames", 3, False

    def __init__(
        self,
        sensor: FrameSensor,
        shape: tuple[int, ...],
        *,
        seed: int,
        device_seed: int | None = None,
        rows: slice | None = None,
        threads: int | None = None,
    ) -> None:
        if len(shape) != 2 or min(shape) < 1:
            raise BadInput(f"the array's shape is {tuple(shape)}", allowed="(rows, columns), each at least 1")
        self.sensor, self.shape, self._seed = sensor, (int(shape[0]), int(shape[1])), seed
        device = seed if device_seed is None else device_seed
        self._response = np.ones(self.shape)
        if sensor.noise.response:
            spread = make_generator("frames", device, "response").standard_normal(self.shape) * sensor.response_rms
            self._response = np.rint(np.maximum(1 + spread, 0) / _GRID) * _GRID
        dark = draw_relative_dark(sensor, self.shape, seed=device)
        self._dark = np.rint(dark / _GRID) * _GRID * sensor.mean_dark_e

    def expose(self, light: Light, span: Span, *, lens: LensCourse) -> Iterator[np.ndarray]:
        """Yield the frames of a span, uint16 (H, W)."""
        sensor = self.sensor
        rows_s = sensor.rows_s()
        for frame in range(span.begin, span.end):
            begin_s = frame / sensor.readout_hz + rows_s
            charge = exposed_charge(light, begin_s=begin_s, exposure_s=sensor.exposure_s, lens=lens)
            yield self.read(charge * light.hz, frame=frame)

    def read(self, charge: np.ndarray, *, frame: int) -> np.ndarray:
        """Return the numbers that are read out of a frame.

        A pixel holds as many electrons as came, Poisson about charge·response + dark, up to its full well; the reading
        is off by the read noise, and is the nearest number of electrons per level above the black level, from 0 to the
        largest number.

        Parameters
        ----------
        charge : ndarray, shape (H, W)
            Mean photo-electrons that each pixel collects in the exposure, at least 0.
        frame : int
            Number of the frame, from 0: the noise of a frame is its own.

        Returns
        -------
        ndarray of uint16, shape (H, W)
            The numbers.

        Raises
        ------
        BadInput
            If ``charge`` has another shape, or is negative or not finite.
        """
        sensor, charge = self.sensor, np.asarray(charge, np.float64)
        if charge.shape != self.shape:
            raise BadInput(f"the charge has the shape {charge.shape}", allowed=f"{self.shape}")
        if not (charge.min() >= 0 and charge.max() < np.inf):  # also false for NaN
            raise BadInput("the charge is negative or not finite", allowed="electrons per exposure, at least 0")
        out = np.empty(self.shape, np.uint16)
        read_out(
            charge.ravel(), self._response.ravel(), self._dark.ravel(),
            derive_seed("frames", self._seed, f"frame {frame}"), sensor.noise.shot, float(sensor.full_well_e),
            float(sensor.noise.read * sensor.read_noise_e), sensor.electrons_per_level, float(sensor.black_level_dn),
            float(sensor.levels), out.reshape(-1)
        )  # fmt: skip
        return out


def exposed_charge(light: Light, *, begin_s: np.ndarray, exposure_s: float, lens: LensCourse) -> np.ndarray:
    """Return the light of an exposure, in the charge per readout of the light times seconds, float64 (H, W).

    During an exposure the lens moves and the light changes: the gain of each lamp is integrated by the law of its
    schedule, and the lens is followed in steps of at most 50 µs, so that the charge is a sum of the pictures at the
    knots that the lens passes, each with its own weight.

    Parameters
    ----------
    light : Light
        Light in front of the camera.
    begin_s : ndarray, shape (H,) or (1,)
        When each row begins, or all rows together, seconds.
    exposure_s : float
        Time for which a row collects light, seconds.
    lens : LensCourse
        Where the lens is.
    """
    steps = max(LEAST_STEPS, ceil(exposure_s / STEP_S))
    edges = begin_s[:, None] + exposure_s * np.linspace(0, 1, steps + 1)
    middles = (edges[:, 1:] + edges[:, :-1]) / 2
    lit = np.stack([np.diff(integral(edges), axis=1) for integral in light.lamps], axis=-1)  # (rows, steps, G)
    j, times = 0, np.array(light.slices_s)
    if len(times) > 1:
        j = int(np.clip(np.searchsorted(times, middles.mean(), side="right") - 1, 0, len(times) - 2))
        later = np.clip((middles - times[j]) / (times[j + 1] - times[j]), 0, 1)[..., None]
        lit = np.concatenate([lit * (1 - later), lit * later], axis=-1)
    index, fraction = knot_weights(lens.at(middles.ravel()), light.knots)
    first, stop = int(index.min()), int((index + (fraction > 0)).max()) + 1
    weights = np.zeros((len(begin_s), lit.shape[-1], stop - first + 1))
    row = np.repeat(np.arange(len(begin_s)), steps)
    flat = lit.reshape(-1, lit.shape[-1])
    np.add.at(weights.transpose(0, 2, 1), (row, index - first), flat * (1 - fraction[:, None]))
    np.add.at(weights.transpose(0, 2, 1), (row, index - first + 1), flat * fraction[:, None])
    stack = light.charge(Span(0, 1, j), range(first, stop))
    charge = np.zeros(stack.shape[2:])
    add_planes(stack, light.scale * weights[..., :-1], charge)
    return charge
