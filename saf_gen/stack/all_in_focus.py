"""The all-in-focus pictures of a recording: what its lens would draw if its aperture were a point.

They are the focal stacks of the recording itself, rendered once more through an aperture so small that nothing blurs: a
recipe with ``truth: {sharp: true}`` renders them with its other stacks, into the same folder, and they are read as
those are (:func:`open_all_in_focus`), with the light that the recording's own aperture collects. They therefore equal
the recorded picture where that is in focus, at every frame and every position of the lens.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.camera import parse_sensor
from saf_gen.core.config.json_document import load_plain_json
from saf_gen.errors import BadInput
from saf_gen.optics import FittedLensDrive
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.focal_stack import PICTURES, WAVES, StackSpec
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack, slice_windows
from saf_gen.stream.stream_file import SpikeStream

F_NUMBER = 512.0
"""f-number of the point: a blur of 20 pixels at f/2 is then a twelfth of a pixel."""


def sharp_stack(time_stack: TimeResolvedStack, position: np.ndarray) -> TimeResolvedStack:
    """Return the stacks of a recording through the aperture of a point, at the positions that the lens passes.

    Parameters
    ----------
    time_stack : TimeResolvedStack
        Focal stacks of the recording.
    position : ndarray, shape (T,)
        Position of the lens in each readout, 0 to 1.

    Raises
    ------
    BadInput
        If the scene is a thin section or was photographed, or if its lens has aberrations or a ring.
    """
    windows: list[tuple[int, int] | None] = [None]
    if time_stack.is_moving:
        windows = [*slice_windows(position, time_stack.slice_frames, positions=time_stack.specs[0].positions)]
    specs = [_of_point(spec, window) for spec, window in zip(time_stack.specs, windows, strict=True)]
    return replace(time_stack, specs=tuple(specs))


def _of_point(spec: StackSpec, window: tuple[int, int] | None) -> StackSpec:
    """Return a stack with the aperture of a point, drawn by rays alone, at the positions of a window."""
    drive = spec.drive
    if spec.estimator in (WAVES, PICTURES):
        what = "is a thin section, drawn by waves" if spec.estimator == WAVES else "was photographed"
        raise BadInput(f"its scene {what}", allowed="scenes that light paths render")
    if isinstance(drive, FittedLensDrive) or not drive.fills_its_aperture_perfectly:
        raise BadInput("its lens has aberrations or a ring, which a point has not", allowed="perfect thin lenses")
    aperture: dict[str, Any] = {"f_number": F_NUMBER}
    point = replace(drive, **aperture)  # type: ignore[type-var]
    return replace(spec, drive=point, wavelength_m=0.0, window=window, margin=(0, 0))


def open_all_in_focus(stream: SpikeStream, stacks: str | Path) -> ChargeSource:
    """Return the all-in-focus charge of a recording, from the folder of stacks that it was made from.

    Parameters
    ----------
    stream : SpikeStream
        Recording of a recipe with ``truth: {sharp: true}``.
    stacks : str or Path
        Folder ``stacks`` of its dataset.

    Returns
    -------
    ChargeSource
        ``charge_image(frame, position)`` is float32 (light, row, col): the photo-electrons per readout at gain 1,
        without noise, at the scale that the picture has with the lens at ``position``. Weighted with
        ``stream.gain[frame]`` and added up, at ``stream.metadata.lens_position[frame]``, it is what the readout would
        collect if everything were in focus.

    Raises
    ------
    BadInput
        If no recipe made the stream, if :func:`sharp_stack` refuses its scene or lens, or if its all-in-focus pictures
        were not rendered or are damaged.
    """
    provenance, where = stream.metadata.provenance, str(stream.path)
    lens = stream.metadata.lens_position
    if lens is None or not {"stack", "sensor", "exposure"} <= set(provenance):
        raise BadInput("was not recorded from focal stacks", where=where, allowed="recordings of saf-gen generate")
    specs = tuple(StackSpec.read(Path(stacks), key) for key in provenance["stack"].split("\n"))
    frames = tuple(round(spec.time_s * stream.readout_hz) for spec in specs) if len(specs) > 1 else (0,)
    recorded = TimeResolvedStack(frames, specs)
    points = sharp_stack(recorded, lens.astype(np.float64))
    if missing := points.find_missing(Path(stacks)):
        raise BadInput(
            f"{len(missing)} of its {len(specs)} all-in-focus stacks are not under {stacks}", where=where,
            hint="set truth: {sharp: true} in its recipe and run saf-gen generate again, which keeps its spikes",
        )  # fmt: skip
    # With the drive of the recording, the pictures of a point count as the light that its aperture collects.
    lit = tuple(replace(point, drive=spec.drive) for point, spec in zip(points.specs, specs, strict=True))
    source = replace(PlaneSource.from_folder(points, Path(stacks)), time_stack=replace(points, specs=lit))
    sensor = parse_sensor(provenance["sensor"], f"{where} /provenance/sensor", kind=stream.counted)
    charge = ChargeSource(source, sensor)
    charge.scale = float(load_plain_json(provenance["exposure"])["scale"])
    return charge
