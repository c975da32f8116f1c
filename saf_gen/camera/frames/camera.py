"""Recording of frames: light collected over an exposure, and the numbers that are read out of it."""

import numpy as np

from saf_gen.camera.fixed_pattern import draw_relative_dark
from saf_gen.camera.frames.kernel import read_out
from saf_gen.camera.frames.sensor import FrameSensor
from saf_gen.core.seeds import derive_seed, make_generator
from saf_gen.errors import BadInput

_GRID = 2.0**-16  # of the mean, to which maps are rounded, so that machines whose logarithms differ agree


class FrameCamera:
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

    Raises
    ------
    BadInput
        If ``shape`` is not two numbers of at least 1.
    """

    def __init__(
        self, sensor: FrameSensor, shape: tuple[int, ...], *, seed: int, device_seed: int | None = None
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

    def expose(self, charge: np.ndarray, *, frame: int) -> np.ndarray:
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
