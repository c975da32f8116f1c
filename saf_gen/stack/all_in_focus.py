"""The all-in-focus picture of a recording: what its lens would draw if its aperture were a point.

It is a focal stack of its own, of the same scene, lights and pixels, whose lens has an aperture so small that nothing
blurs. It has the perspective and the scale of the recorded picture at one position of the lens, and the amount of light
of the recording's own aperture, so that it equals the recorded picture where that is in focus.

A recipe with ``truth: {sharp: true}`` renders it with the other stacks (:func:`sharp_stack`), and every stream holds it
as ``/truth/sharp`` (:class:`SharpPictures`): of a scene at rest at the true focus, and of a scene that moves at each
time slice, where the lens is then. For all other recordings of scenes at rest,
:func:`saf_gen.render.all_in_focus.render_all_in_focus` renders it afterwards; it then lies beside the stacks of the
dataset and is no part of the streams.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.camera import BitSensor, charge_of_images
from saf_gen.errors import BadInput, located
from saf_gen.optics import FittedLensDrive
from saf_gen.stack.capture import Capture
from saf_gen.stack.focal_stack import PICTURES, WAVES, StackSpec, StackStore
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
from saf_gen.stream.defocus_blur import known_depth
from saf_gen.stream.metadata import Truth
from saf_gen.stream.stream_file import SpikeStream

F_NUMBER = 512.0
"""f-number of the point: a blur of 20 pixels at f/2 is then a twelfth of a pixel."""


def sharp_stack(time_stack: TimeResolvedStack, position: np.ndarray) -> TimeResolvedStack:
    """Return the stacks of a recording's all-in-focus pictures, one for each of its moments.

    That of a scene at rest holds all positions, because where its target is in focus is known once it is rendered; each
    of those of a scene that moves holds the two positions around that of the lens.

    Parameters
    ----------
    time_stack : TimeResolvedStack
        Focal stacks of the recording.
    position : ndarray, shape (T,)
        Position of the lens in each readout, 0 to 1.

    Raises
    ------
    BadInput
        If the scene is a thin section or was photographed, if its lens has aberrations or a ring, or if its lamps have
        spectra.
    """
    if not time_stack.is_moving:
        return TimeResolvedStack((0,), (_point_spec(time_stack, 0),))
    at = _lens_at_slices(time_stack, position)
    specs = (_point_spec(time_stack, j, around=float(one)) for j, one in enumerate(at))
    return TimeResolvedStack(time_stack.slice_frames, tuple(specs))


def _lens_at_slices(time_stack: TimeResolvedStack, position: np.ndarray) -> np.ndarray:
    """Return where the lens is at each time slice, 0 to 1; the last slice may lie behind the recording."""
    return np.clip(position[np.minimum(time_stack.slice_frames, len(position) - 1)], 0, 1)


def _point_spec(time_stack: TimeResolvedStack, j: int, *, around: float | None = None) -> StackSpec:
    """Return the stack of a moment with the aperture of a point: at all positions, or at the two around one."""
    spec = time_stack.specs[j]
    drive = spec.drive
    if spec.estimator in (WAVES, PICTURES):
        what = "is a thin section, drawn by waves" if spec.estimator == WAVES else "was photographed"
        raise BadInput(f"its scene {what}", allowed="scenes that light paths render")
    if isinstance(drive, FittedLensDrive) or not drive.fills_its_aperture_perfectly:
        raise BadInput("its lens has aberrations or a ring, which a point has not", allowed="perfect thin lenses")
    changes: dict[str, Any] = {"f_number": F_NUMBER}
    point = replace(drive, **changes)  # type: ignore[type-var]
    window = None
    if around is not None:
        first = int(np.clip(np.floor(around * (spec.positions - 1)), 0, spec.positions - 2))
        window = (first, first + 1)
    return replace(spec, drive=point, wavelength_m=0.0, window=window, margin=(0, 0))


@dataclass(frozen=True, eq=False)
class SharpPictures:
    """The all-in-focus charge of a recording, computed one moment at a time, as ``Truth.sharp`` takes it.

    Attributes
    ----------
    planes : PlaneSource
        Stacks of :func:`sharp_stack`.
    recorded : PlaneSource
        Focal stacks of the recording, whose aperture collects the light.
    sensor : Sensor or SpadSensor
        Sensor of the recording.
    exposure : float
        Factor on all gains.
    position : ndarray of float64, shape (S,)
        Position of the lens at each of S moments, 0 to 1.
    """

    planes: PlaneSource
    recorded: PlaneSource
    sensor: BitSensor
    exposure: float
    position: np.ndarray

    @classmethod
    def of_recording(
        cls,
        planes: PlaneSource,
        recorded: PlaneSource,
        *,
        sensor: BitSensor,
        exposure: float,
        truth: Truth,
        position: np.ndarray,
    ) -> "SharpPictures":
        """Return the pictures of a recording with this truth, whose lens is at ``position`` in each readout (T,)."""
        moving = planes.time_stack.is_moving
        at = _lens_at_slices(planes.time_stack, position) if moving else np.clip([truth.position], 0.0, 1.0)
        return cls(planes, recorded, sensor, exposure, np.asarray(at, np.float64))

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Shape (slice, light, row, col) of all pictures."""
        spec = self.planes.time_stack.specs[0]
        return len(self.position), len(spec.groups), spec.rows, spec.columns

    @property
    def dtype(self) -> np.dtype:
        """The type of the numbers, float32."""
        return np.dtype(np.float32)

    def __getitem__(self, j: int) -> np.ndarray:
        """Return the charge at moment j, float32 (light, row, col), in electrons per readout at gain 1.

        Raises BadInput if its stack is missing or damaged.
        """
        spec, lens = self.planes.time_stack.specs[j], self.recorded.time_stack.specs[0].drive
        last = spec.first_index + spec.rendered_count - 1
        knot = float(np.clip(self.position[j] * (spec.positions - 1), spec.first_index, last))
        k = min(int(knot), last - 1)
        first = k - spec.first_index
        planes = self.planes.load_planes(j, first, first + 2)
        charge = charge_of_images(planes, self.sensor, lens=lens, position=spec.focus[first : first + 2])
        between = charge[:, 0] + np.float32(knot - k) * (charge[:, 1] - charge[:, 0])
        return np.asarray(between * np.float32(self.exposure), dtype=np.float32)


@dataclass(frozen=True, eq=False)
class AllInFocus:
    """The all-in-focus picture of a recording of a scene at rest, on disk or still to be rendered.

    Attributes
    ----------
    capture : Capture
        The recording that can be captured again.
    spec : StackSpec
        Focal stack of the lens with a small aperture, at the two positions around the true focus.
    stacks : Path
        Folder of the stacks.
    """

    capture: Capture
    spec: StackSpec
    stacks: Path

    @classmethod
    def of_stream(cls, stream: SpikeStream, stacks: Path) -> "AllInFocus":
        """Return the picture of a stream, from the folder of the stacks that it was made from.

        Raises BadInput if the stream cannot be captured again from these stacks, if its scene moves, is a thin section
        or was photographed, if its lens has aberrations or a ring, or if its lamps have spectra.
        """
        known_depth(stream)
        capture = Capture.from_stream(stream, stacks)
        with located(str(stream.path)):
            if capture.colour is not None:
                raise BadInput("its lamps have spectra", allowed="light of one wavelength")
            spec = _point_spec(capture.plane_source.time_stack, 0, around=stream.truth.position)
        return cls(capture, spec, stacks)

    def load(self) -> np.ndarray:
        """Return the charge of each light group, float32 (light, row, col), in electrons per readout at gain 1.

        Raises BadInput if it was not rendered yet.
        """
        store = StackStore(self.stacks, self.spec)
        if missing := store.missing_pieces():
            raise BadInput(
                f"the all-in-focus picture {self.spec.key} lacks {', '.join(missing)}",
                where=str(self.stacks),
                hint="render it: saf_gen.render.all_in_focus.render_all_in_focus(stream, stacks)",
            )
        planes = PlaneSource.from_folder(TimeResolvedStack((0,), (self.spec,)), self.stacks)
        capture, at = self.capture, np.array([self.capture.truth.position])
        return SharpPictures(planes, capture.plane_source, capture.bit_sensor, capture.exposure, at)[0]


def load_all_in_focus(stream: SpikeStream, stacks: str | Path) -> np.ndarray:
    """Return the all-in-focus charge of a stream, which it holds, or from the folder in which it was rendered.

    Parameters
    ----------
    stream : SpikeStream
        Stream of a scene at rest that `saf-gen generate` made.
    stacks : str or Path
        Folder ``stacks`` of its dataset; not read if the stream has ``truth.sharp``.

    Returns
    -------
    ndarray of float32, shape (light, row, col)
        Photo-electrons per readout at gain 1, without noise, at the scale of the depth map; its sum weighted with
        ``stream.gain[t]`` is what an all-in-focus lens would collect in readout t.

    Raises
    ------
    BadInput
        If it was not rendered yet, or if :meth:`AllInFocus.of_stream` refuses the stream.
    """
    if (held := held_picture(stream)) is not None:
        return held
    return AllInFocus.of_stream(stream, Path(stacks)).load()


def held_picture(stream: SpikeStream) -> np.ndarray | None:
    """Return the all-in-focus charge that a stream of a scene at rest holds, float32 (light, row, col), or None."""
    sharp = stream.truth.sharp
    if sharp is None:
        return None
    known_depth(stream)
    return sharp[0]
