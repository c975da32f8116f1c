"""A sequence recorded again by a single-photon array: the same scene, lens, light and moment, another sensor.

The array stands on the grid of the spike camera, and each of its pixels meets as many photons per second as the pixel
of the spike camera turns into electrons. What differs is what the sensor makes of them. The lens is interpolated in its
log; light is integrated over each time that the gate is open, by the law of its schedule.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from math import isfinite
from pathlib import Path

import numpy as np
import yaml

from saf_gen.camera import Sensor, start_camera
from saf_gen.camera.spad import SpadSensor
from saf_gen.camera.spad.sensor import exposure_for
from saf_gen.core.config.frozen_benchmarks import BENCHMARK_KEY
from saf_gen.core.config.json_document import load_plain_json
from saf_gen.errors import BadInput
from saf_gen.parts import Light
from saf_gen.plugins.lights import build_light, list_lamps
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.time_resolved import TimeResolvedStack
from saf_gen.stream.metadata import Metadata
from saf_gen.stream.recordings import Recording
from saf_gen.stream.stream_file import SpikeStream
from saf_gen.stream.stream_writer import StreamWriter

MODEL = 2
"""Number of the law by which photons are detected; it is part of the fingerprint."""
BLOCK_FRAMES = 2000  # frames in memory at a time, as for spikes


def recapture_fingerprint(content_sha256: str, sensor: SpadSensor, *, rate: float | None) -> str:
    """Return what identifies a recording of a sequence by another sensor: the sequence, the sensor, and the law."""
    made = {"model": MODEL, "stream": content_sha256, "sensor": sensor.as_dict(), "rate": rate}
    return hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest()


def record_photons(
    stream: SpikeStream,
    stacks: Path,
    *,
    sensor: SpadSensor,
    rate: float | None,
    path: Path,
    threads: int | None = None,
    progress: Callable[[float], None] = lambda done: None,
) -> tuple[int, str, SpadSensor]:
    """Record a sequence with a single-photon array into the stream file ``path``.

    Parameters
    ----------
    stream : SpikeStream
        Sequence that ``saf-gen generate`` made.
    stacks : Path
        Folder of the focal stacks.
    sensor : SpadSensor
        The array, of which pitch, fill factor, detection probability and spectrum are not used.
    rate : float or None
        Share of the frames in which a pixel of the target detects a photon at best focus and gain 1: the gate is opened
        for as long as that takes, and for at most a frame. None keeps the exposure of the sensor.
    path : Path
        Stream file to write.
    threads : int, optional
        Number of threads.
    progress : callable, optional
        Called with the finished fraction.

    Returns
    -------
    tuple of int, str and SpadSensor
        Frames, content_sha256, and the sensor as it was exposed.

    Raises
    ------
    BadInput
        If ``saf-gen generate`` did not make the stream, it was recorded by another sensor already, its stacks are
        missing or have changed, or it does not say where the lens was or how its light changed.
    """
    capture = Capture.from_stream(stream, stacks)
    if not isinstance(capture.sensor, Sensor):
        raise BadInput(
            "it was recorded by a single-photon array", where=str(stream.path), allowed="a dataset of a spike camera"
        )
    placed = sensor.in_place_of(capture.sensor)
    plane_source = capture.plane_source
    hz, ratio = placed.readout_hz, placed.readout_hz / stream.readout_hz
    frames = int(capture.frames * ratio + 1e-9)
    time_stack, starts = plane_source.time_stack, tuple[int, ...]((0,))
    if time_stack.is_moving:
        starts = tuple(round(spec.time_s * hz) for spec in time_stack.specs)
        frames = min(frames, starts[-1])
    plane_source = replace(plane_source, time_stack=TimeResolvedStack(starts, time_stack.specs))
    charge_source = ChargeSource(plane_source, placed, colour=capture.colour)
    charge_source.scale = capture.exposure
    metadata = resample(stream, frames, readout_hz=hz, middle_s=0.5 / hz)
    if rate is not None:
        moment = metadata.truth.frame if isfinite(metadata.truth.frame) else 0.0
        target = np.asarray(metadata.truth.target, bool)
        light = charge_source.nominal_image(moment, metadata.truth.position)[target]
        placed = exposure_for(light.astype(np.float64) * hz, placed, rate=rate)
    position = metadata.lens_position
    if position is None:
        raise BadInput("the stream does not say where the lens was", where=str(stream.path))
    groups = plane_source.time_stack.specs[0].groups
    opened = np.arange(frames) / hz
    gain = np.stack(
        [
            (integral(opened + placed.gate / hz) - integral(opened)) * hz / placed.gate
            for integral in light_integrals(stream, groups, duration_s=stream.shape[0] / stream.readout_hz)
        ],
        axis=1,
    ).astype(np.float32)
    fingerprint = recapture_fingerprint(stream.content_sha256, sensor, rate=rate)
    texts = {name: text for name, text in metadata.provenance.items() if name != BENCHMARK_KEY}
    metadata = replace(
        metadata,
        gain=gain,
        kind="photons",
        provenance={
            **texts,
            "sensor": yaml.safe_dump(placed.as_dict(), sort_keys=False),
            "spikes_content": stream.content_sha256,
            "fingerprint": fingerprint,
        },
    )
    shape = placed.rows, placed.columns
    camera = start_camera(placed, shape, seed=capture.seed, device_seed=capture.device_seed, threads=threads)
    with StreamWriter(path, shape=(frames, *shape), readout_hz=hz, metadata=metadata, threads=threads) as writer:
        for begin in range(0, frames, BLOCK_FRAMES):
            for run in plane_source.time_stack.split_at_slices(begin, min(begin + BLOCK_FRAMES, frames)):
                writer.write(camera.encode(**charge_source.encoder_inputs(run, position=position, gain=gain)))
                progress(run.end / frames)
    return frames, writer.content_sha256, placed


def resample(stream: SpikeStream, frames: int, *, readout_hz: float, middle_s: float) -> Metadata:
    """Return what a stream says of each of its readouts, for the frames of another camera.

    Frame k of the other camera is the light about the moment k/``readout_hz`` + ``middle_s``, in seconds.
    """
    metadata = stream.metadata
    at = (np.arange(frames) / readout_hz + middle_s) * stream.readout_hz - 0.5  # in readouts

    def resampled(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        return np.interp(at, np.arange(len(values)), values.astype(np.float64)).astype(values.dtype)

    truth = metadata.truth
    return replace(
        metadata,
        focus_position=resampled(metadata.focus_position),
        image_distance=resampled(metadata.image_distance),
        object_distance=resampled(metadata.object_distance),
        truth=replace(
            truth,
            frame=((truth.frame + 0.5) / stream.readout_hz - middle_s) * readout_hz,
            track=resampled(truth.track),
            lens=resampled(truth.lens),
        ),
    )


def light_integrals(
    stream: Recording, groups: tuple[str, ...], *, duration_s: float
) -> list[Callable[[np.ndarray], np.ndarray]]:
    """Return the integral of the gain of each lamp, in the order of the lights of its charge.

    Raises BadInput if the stream does not say how its light changed, or by a schedule that is not there any more.
    """
    try:
        schedule = load_plain_json(stream.metadata.provenance["sequence"])["schedule"]
        components = [lamp.component for lamp in list_lamps(schedule, groups)]
        lights = [None if component is None else build_light(component) for component in components]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise BadInput(
            "the stream does not say how its light changed", where=str(stream.path), hint="saf-gen generate makes such"
        ) from error

    def integral(light: Light | None) -> Callable[[np.ndarray], np.ndarray]:
        if light is None:
            return lambda at: np.asarray(at, np.float64)
        return lambda at: light.integral(at, duration_s)

    return [integral(light) for light in lights]
