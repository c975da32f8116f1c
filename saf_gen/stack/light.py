"""The light of a recorded scene in front of a camera, and the loop in which every camera records it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from saf_gen.camera.camera import Camera, Integral, LensCourse, Span
from saf_gen.core.config.json_document import load_plain_json
from saf_gen.errors import BadInput
from saf_gen.parts import Light
from saf_gen.plugins.lights import build_light, list_lamps
from saf_gen.stack.charge_source import ChargeSource


@dataclass(frozen=True, eq=False)
class SceneLight:
    """The charge of focal stacks and the gains of their lamps; see :class:`saf_gen.camera.camera.Light`.

    Attributes
    ----------
    source : ChargeSource
        Charge of the stacks, of the sensor to whose readouts it belongs.
    gain : ndarray, shape (T, G), or None
        Mean gain of each light group in each readout, for cameras of bits.
    lamps : sequence of callable
        Integral of the gain of each lamp, for cameras that follow the light within a readout.
    """

    source: ChargeSource
    gain: np.ndarray | None = None
    lamps: Sequence[Integral] = field(default=())

    @property
    def hz(self) -> float:
        """Readouts per second."""
        return self.source.sensor.readout_hz

    @property
    def scale(self) -> float:
        """Factor on the charge: the exposure."""
        return self.source.scale

    @property
    def knots(self) -> int:
        """Number of focus positions."""
        return self.source.time_stack.specs[0].positions

    @property
    def slices_s(self) -> tuple[float, ...]:
        """When the scene is as each stack shows it, seconds."""
        return tuple(frame / self.hz for frame in self.source.time_stack.slice_frames)

    def charge(self, span: Span, positions: range) -> np.ndarray:
        """Return electrons per readout at position indices, without the exposure, float32 (light, focus, row, col)."""
        return self.source.stack(span, positions)

    def weighted(self, span: Span, lens: LensCourse) -> dict[str, np.ndarray]:
        """Return the arguments of :meth:`saf_gen.camera.Encoder.encode` for a span."""
        if self.gain is None:
            raise BadInput("the gains of the light in each readout are not known", allowed="light of a recording")
        return self.source.encoder_inputs(span, position=lens.position, gain=self.gain)

    def spans(self, begin: int, end: int, *, form: str) -> Iterator[Span]:
        """Yield the spans of readouts ``begin <= t < end`` for a camera whose recordings have this form.

        Frames are exposed by the clock, whatever the readouts to which time slices belong.
        """
        return iter([Span(begin, end)]) if form == "frames" else self.source.time_stack.split_at_slices(begin, end)


class Sink(Protocol):
    """What takes a recording: the writer of a file."""

    def write(self, piece: Any, /) -> None:
        """Append what follows."""
        ...


def record(
    light: SceneLight,
    camera: Camera,
    *,
    sink: Sink,
    lens: LensCourse,
    frames: int,
    progress: Callable[[float], None] = lambda done: None,
) -> None:
    """Expose a camera to light, readout by readout, and write what it reads out.

    Memory does not grow with the length of the recording.

    Parameters
    ----------
    light : SceneLight
        Light in front of the camera.
    camera : Camera
        The camera before its first readout.
    sink : Sink
        Takes what is read out.
    lens : LensCourse
        Where the lens is.
    frames : int
        Number of readouts.
    progress : callable, optional
        Called with the finished fraction.
    """
    for begin in range(0, frames, camera.block):
        for span in light.spans(begin, min(begin + camera.block, frames), form=camera.form):
            for piece in camera.expose(light, span, lens=lens):
                sink.write(piece)
            progress(span.end / frames)


def lamp_integrals(
    provenance: Mapping[str, str], groups: tuple[str, ...], *, duration_s: float, where: str
) -> list[Integral]:
    """Return the integral of the gain of each lamp, in the order of the lights of its charge.

    Parameters
    ----------
    provenance : mapping of str to str
        Texts of a recording.
    groups : tuple of str
        Light groups of its stacks.
    duration_s : float
        How long the schedules run, seconds.
    where : str
        Name of the recording in error messages.

    Raises
    ------
    BadInput
        If the recording does not say how its light changed, or by a schedule that is not there any more.
    """
    try:
        schedule = load_plain_json(provenance["sequence"])["schedule"]
        components = [lamp.component for lamp in list_lamps(schedule, groups)]
        lights = [None if component is None else build_light(component) for component in components]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise BadInput(
            "the stream does not say how its light changed", where=where, hint="saf-gen generate makes such"
        ) from error

    def integral(light: Light | None) -> Integral:
        if light is None:
            return lambda at: np.asarray(at, np.float64)
        return lambda at: light.integral(at, duration_s)

    return [integral(light) for light in lights]
