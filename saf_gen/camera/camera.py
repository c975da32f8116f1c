"""What every camera is: a sensor in front of light, read out span by span of time.

A kind of camera is a folder beside this module, named as its kind, whose package names its class ``CAMERA``. Its sensor
files state that kind; the class says in which form of file its recordings are kept. A new kind needs nothing else.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np

Integral = Callable[[np.ndarray], np.ndarray]
"""Integral of the gain of a lamp from 0 to each time, seconds."""


class Span(NamedTuple):
    """Readouts ``begin <= t < end`` of a recording.

    ``slice_index`` is that of the last time slice before them. With a ``packet``, cells of time end where packets of so
    many readouts do: what a running camera gives then does not depend on how often it is looked at.
    """

    begin: int
    end: int
    slice_index: int = 0
    packet: int = 0


@dataclass(frozen=True, eq=False)
class LensCourse:
    """Where the lens is over time.

    Attributes
    ----------
    position : ndarray, shape (T,)
        Position in the middle of each readout, 0 to 1.
    hz : float
        Readouts per second.
    knots : tuple of ndarray or None
        Seconds, and positions between which the lens moves evenly; by default the middles of readouts.
    """

    position: np.ndarray
    hz: float
    knots: tuple[np.ndarray, np.ndarray] | None = None

    @cached_property
    def _knots(self) -> tuple[np.ndarray, np.ndarray]:
        middles = (np.arange(len(self.position)) + 0.5) / self.hz
        return (middles, self.position.astype(np.float64)) if self.knots is None else self.knots

    def at(self, seconds: np.ndarray) -> np.ndarray:
        """Return the position at each time, float64."""
        return np.interp(seconds, *self._knots)


class Light(Protocol):
    """What falls on the pixels: charge at knots of the travel, and the gains of lamps; never a picture per readout.

    Attributes
    ----------
    hz : float
        Readouts per second to which the charge belongs.
    scale : float
        Factor on the charge.
    knots : int
        Number of knots, evenly spaced over the travel.
    slices_s : tuple of float
        When the scene is as the charge of each time slice shows it, seconds; one for a scene at rest.
    lamps : sequence of callable
        Integral of the gain of each lamp.
    """

    @property
    def hz(self) -> float: ...

    @property
    def scale(self) -> float: ...

    @property
    def knots(self) -> int: ...

    @property
    def slices_s(self) -> tuple[float, ...]: ...

    @property
    def lamps(self) -> Sequence[Integral]: ...

    def charge(self, span: Span, positions: range) -> np.ndarray:
        """Return electrons per readout, float32 (light, focus, row, col); later slices follow as further lights."""
        ...

    def weighted(self, span: Span, lens: LensCourse) -> dict[str, np.ndarray]:
        """Return charge, and the knot, the way to the next one and the gains of each readout, as kernels take them."""
        ...


class Readouts(NamedTuple):
    """The frames of a camera that exposes them one by one.

    Attributes
    ----------
    frames : int
        Number of frames.
    hz : float
        Frames per second.
    open_s : float
        How long a pixel collects light in a frame, seconds.
    rows_s : ndarray, shape (H,) or (1,)
        When each row begins to, seconds from the beginning of the frame; one number for all rows.
    middle_s : float
        When a frame is said to have been taken, seconds from its beginning.
    """

    frames: int
    hz: float
    open_s: float
    rows_s: np.ndarray
    middle_s: float

    def mean_gain(self, lamps: Sequence[Integral]) -> np.ndarray:
        """Return the mean gain of each lamp in each frame, float32 (T, G)."""
        begins = np.arange(self.frames) / self.hz + float(self.rows_s.mean())
        return np.stack([(f(begins + self.open_s) - f(begins)) / self.open_s for f in lamps], axis=1).astype(np.float32)


class CameraSensor(Protocol):
    """A sensor as its file states it, immutable; :class:`saf_gen.camera.Sensor` is that of a spike camera."""

    kind: ClassVar[str]
    switched: ClassVar[Mapping[str, tuple[str, ...]]]
    """By switch of the noise: the keys that have an effect only if it is on."""

    @property
    def name(self) -> str: ...

    @property
    def rows(self) -> int: ...

    @property
    def columns(self) -> int: ...

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as plain data."""
        ...

    def in_place_of(self, grid: Any) -> Self:
        """Return a copy that stands on the grid of a spike camera, and collects as much light as that does."""
        ...

    def exposed_for(self, electrons_per_s: np.ndarray) -> Self:
        """Return a copy with the exposure that suits pixels in this light, (n,); itself if it has no exposure."""
        ...

    def readouts(self, seconds: float) -> Readouts | None:
        """Return the frames of a recording; None if the camera answers to the light at any instant.

        Raises BadInput if the recording is shorter than a frame.
        """
        ...


class Camera(ABC):
    """A camera before its first readout, which keeps the state of its pixels from span to span.

    Attributes
    ----------
    form : str
        Form of its recordings: ``bits`` (packed spikes; its light is that of its own readouts), ``events`` or
        ``frames`` (numbers).
    model : int
        Number of the law by which it turns light into readouts; it is part of fingerprints.
    block : int
        Readouts of a span, at most.
    keeps_state : bool
        Whether a readout depends on those before it.
    whole_array : bool
        Whether it needs the light of all rows; else rows from the beginning of a block of 64 pixels are enough.
    sensor : CameraSensor
        The sensor.
    shape : tuple of int
        Rows and columns.
    """

    sensor_type: ClassVar[Any]
    form: ClassVar[str]
    model: ClassVar[int] = 1
    block: ClassVar[int] = 2000  # 25 MB of packed spikes at 400×250, however long the recording
    keeps_state: ClassVar[bool] = True
    whole_array: ClassVar[bool] = True
    sensor: Any
    shape: tuple[int, int]

    @classmethod
    def start(
        cls,
        sensor: Any,
        *,
        shape: tuple[int, int],
        seed: int,
        device_seed: int,
        rows: slice | None = None,
        threads: int | None = None,
    ) -> Self:
        """Return the camera of a recording.

        Parameters
        ----------
        sensor : CameraSensor
            The sensor.
        shape : tuple of int
            Rows and columns of the array.
        seed : int
            Seed of the recording's noise.
        device_seed : int
            Seed of what differs between pixels.
        rows : slice, optional
            Rows that are needed; a camera may record more.
        threads : int, optional
            Number of threads; by default one per core.
        """
        return cls(sensor, shape, seed=seed, device_seed=device_seed, rows=rows, threads=threads)  # type: ignore[call-arg]

    @abstractmethod
    def expose(self, light: Light, span: Span, *, lens: LensCourse) -> Iterator[Any]:
        """Yield what is read out in a span, which follows the one before it, in pieces.

        A piece is uint8 (H, W, bytes) of packed bits, a tuple (t, x, y, p) of columns of events, or a frame, uint16
        (H, W).
        """

    def notes(self) -> dict[str, str]:
        """Return texts about the recording that are known at its end, by the names under which a file keeps them."""
        return {}


class BitCamera(Camera):
    """A camera of bits: its kernel weighs the charge of each readout itself."""

    form, whole_array = "bits", False

    @abstractmethod
    def encode(self, stack: np.ndarray, *, index: np.ndarray, fraction: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Record the next readouts and return their packed bits, uint8 (H, W, bytes)."""

    def expose(self, light: Light, span: Span, *, lens: LensCourse) -> Iterator[np.ndarray]:
        """Yield the bits of a span, which ends at a whole byte unless it is the last."""
        yield self.encode(**light.weighted(span, lens))
