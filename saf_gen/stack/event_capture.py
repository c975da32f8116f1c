"""The events that another camera would have recorded of a sequence: the same scene, lens, light and moment.

The event camera stands on the grid of the spike camera, and each of its pixels collects as many photo-electrons per
second as the pixel of the spike camera: what differs is the sensor. The focal stacks hold every position, light is
linear, and the schedules are known between the readouts, so that the light at any instant is known too; nothing is
interpolated from frames.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from saf_gen.camera import LightCourse
from saf_gen.camera.events import EventCamera, EventSensor
from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.seeds import derive_seed
from saf_gen.errors import BadInput
from saf_gen.parts import Light
from saf_gen.plugins.lights import build_light, list_lamps
from saf_gen.stack.capture import Capture
from saf_gen.stream.event_file import FINGERPRINT, EventColumns, EventWriter
from saf_gen.stream.stream_file import SpikeStream

MODEL = 1
"""Number of the law by which events are made; it is part of their fingerprint."""
BLOCK_CELLS = 400  # a tenth of a second of even light; memory grows with the events of a block


def events_fingerprint(stream: SpikeStream, sensor: EventSensor) -> str:
    """Return what identifies the events that a sensor makes of a sequence: the sequence, the sensor, and the law."""
    text = json.dumps({"model": MODEL, "stream": stream.content_sha256, "sensor": asdict(sensor)}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def record_events(
    stream: SpikeStream, stacks: Path, *, sensor: EventSensor, path: Path, threads: int | None = None
) -> tuple[int, str]:
    """Record a sequence with an event camera into the event file ``path``; return the events and the content_sha256.

    Parameters
    ----------
    stream : SpikeStream
        Sequence that ``saf-gen generate`` made.
    stacks : Path
        Folder of the focal stacks.
    sensor : EventSensor
        The camera, of which pitch, fill factor and quantum efficiency are not used.
    path : Path
        Event file to write.
    threads : int, optional
        Number of threads.

    Raises
    ------
    BadInput
        If ``saf-gen generate`` did not make the stream, its stacks are missing or have changed, or it does not say how
        its light changed.
    """
    capture = Capture.from_stream(stream, stacks)
    lens = stream.metadata.lens_position
    if lens is None:
        raise BadInput("the stream does not say where the lens was", where=str(stream.path))
    frames, hz = capture.frames, stream.readout_hz
    middles = (np.arange(len(lens)) + 0.5) / hz
    logged = lens.astype(np.float64)
    source, time_stack = capture.open_charge_source(), capture.plane_source.time_stack
    spec = time_stack.specs[0]
    integrals = _light_integrals(stream, spec.groups, duration_s=len(lens) / hz)
    seed = derive_seed("events", capture.seed, sensor.name)
    camera = EventCamera(
        sensor, (stream.shape[1], stream.shape[2]), seed=seed,
        device_seed=derive_seed("events", capture.device_seed, sensor.name), threads=threads,
    )  # fmt: skip
    metadata = replace(
        stream.metadata,
        provenance={
            **stream.metadata.provenance,
            "event_sensor": json.dumps(asdict(sensor), indent=1),
            "spikes_content": stream.content_sha256,
            FINGERPRINT: events_fingerprint(stream, sensor),
        },
    )
    with EventWriter(path, shape=stream.shape, readout_hz=hz, metadata=metadata) as writer:
        for run in time_stack.split_at_slices(0, frames):
            span = run.begin / hz, run.end / hz
            course = LightCourse.follow(
                lambda at: np.interp(at, middles, logged), integrals, span_s=span, knots=spec.positions
            )
            first, stop = int(course.index.min()), min(int(course.index.max()) + 2, spec.positions)
            light = source.stack(run, range(first, stop)) * np.float32(hz * source.scale)
            course = course.seen_from(first)
            if time_stack.is_moving:
                before, after = time_stack.slice_frames[run.slice_index : run.slice_index + 2]
                course = course.mixed(before / hz, after / hz)
            for cell in range(0, len(course.seconds) - 1, BLOCK_CELLS):
                part = course.block(cell, min(cell + BLOCK_CELLS, len(course.seconds) - 1))
                events = camera.record(light, part)
                writer.write(EventColumns(events.x, events.y, events.t, events.p))
    return writer.count, writer.content_sha256


def _light_integrals(
    stream: SpikeStream, groups: tuple[str, ...], *, duration_s: float
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
