"""The events that another camera would have recorded of a sequence: the same scene, lens, light and moment.

The event camera stands on the grid of the spike camera, and each of its pixels collects as many photo-electrons per
second as the pixel of the spike camera: what differs is the sensor. The focal stacks hold every position, light is
linear, and the schedules are known between the readouts, so that the light at any instant is known too; nothing is
interpolated from frames.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from saf_gen.camera import LightCourse
from saf_gen.camera.events import EventCamera, EventSensor
from saf_gen.camera.events.camera import Events
from saf_gen.core.config.document import Document, validate_document
from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.seeds import derive_seed
from saf_gen.errors import BadInput
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.recapture import light_integrals
from saf_gen.stack.time_resolved import FrameRun
from saf_gen.stream.event_file import FINGERPRINT, EventColumns, EventWriter
from saf_gen.stream.recordings import EventRecording
from saf_gen.stream.stream_file import SpikeStream

MODEL = 2
"""Number of the law by which events are made; it is part of their fingerprint."""
BLOCK_CELLS = 400  # a tenth of a second of even light; memory grows with the events of a block


def events_fingerprint(content_sha256: str, sensor: EventSensor) -> str:
    """Return what identifies the events that a sensor makes of a sequence: the sequence, the sensor, and the law."""
    text = json.dumps({"model": MODEL, "stream": content_sha256, "sensor": asdict(sensor)}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


class EventCapture:
    """The event camera in front of the scene of a recording, before its first event; pixels keep their state.

    Parameters
    ----------
    capture : Capture
        The recording.
    source : ChargeSource
        Charge of all rows of the sensor.
    sensor : EventSensor
        The camera, of which pitch, fill factor and quantum efficiency are not used.
    integrals : sequence of callable
        Integral of the gain of each lamp over time, in seconds.
    threads : int, optional
        Number of threads.
    """

    def __init__(
        self,
        capture: Capture,
        source: ChargeSource,
        *,
        sensor: EventSensor,
        integrals: Sequence[Callable[[np.ndarray], np.ndarray]],
        threads: int | None = None,
    ) -> None:
        self._source, self._integrals, self._hz = source, integrals, capture.sensor.readout_hz
        self._camera = EventCamera(
            sensor, (capture.sensor.rows, capture.sensor.columns),
            seed=derive_seed("events", capture.seed, sensor.name),
            device_seed=derive_seed("events", capture.device_seed, sensor.name), threads=threads,
        )  # fmt: skip

    @property
    def bus_full_s(self) -> float:
        """For how many seconds so far events have waited for the readout, by more than a microsecond."""
        return self._camera.bus_full_s

    def follow(self, position: Callable[[np.ndarray], np.ndarray], *, begin: int, end: int) -> LightCourse:
        """Return the course of readouts ``begin <= t < end`` for a lens whose position is a function of seconds."""
        span_s, knots = (begin / self._hz, end / self._hz), self._source.time_stack.specs[0].positions
        return LightCourse.follow(position, self._integrals, span_s=span_s, knots=knots)

    def record(self, run: FrameRun, course: LightCourse) -> Iterator[Events]:
        """Yield the events of a run of frames, which follows the one before it."""
        time_stack = self._source.time_stack
        first, stop = int(course.index.min()), min(int(course.index.max()) + 2, time_stack.specs[0].positions)
        light = self._source.stack(run, range(first, stop)) * np.float32(self._hz * self._source.scale)
        course = course.seen_from(first)
        if time_stack.is_moving:
            before, after = time_stack.slice_frames[run.slice_index : run.slice_index + 2]
            course = course.mixed(before / self._hz, after / self._hz)
        for cell in range(0, len(course.seconds) - 1, BLOCK_CELLS):
            yield self._camera.record(light, course.block(cell, min(cell + BLOCK_CELLS, len(course.seconds) - 1)))


def recorded_by(stream: EventRecording) -> EventSensor:
    """Return the sensor that recorded events; raise BadInput if the file does not describe a valid one."""
    where = f"{stream.path} /provenance/event_sensor"
    try:
        data = load_plain_json(stream.metadata.provenance["event_sensor"])
    except (KeyError, ValueError) as error:
        raise BadInput(
            "the file does not say which camera recorded its events", where=str(stream.path),
            hint="record it again with saf-gen recapture, or use --track recorded",
        ) from error  # fmt: skip
    return validate_document(EventSensor, Document(data, Path(where), find_lines=dict))


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
    hz = stream.readout_hz
    middles = (np.arange(len(lens)) + 0.5) / hz
    logged = lens.astype(np.float64)
    source, time_stack = capture.open_charge_source(), capture.plane_source.time_stack
    integrals = light_integrals(stream, time_stack.specs[0].groups, duration_s=len(lens) / hz)
    events = EventCapture(capture, source, sensor=sensor, integrals=integrals, threads=threads)
    metadata = replace(
        stream.metadata,
        provenance={
            **stream.metadata.provenance,
            "event_sensor": json.dumps(asdict(sensor), indent=1),
            "spikes_content": stream.content_sha256,
            FINGERPRINT: events_fingerprint(stream.content_sha256, sensor),
        },
    )
    with EventWriter(path, shape=stream.shape, readout_hz=hz, metadata=metadata) as writer:
        for run in time_stack.split_at_slices(0, capture.frames):
            course = events.follow(lambda at: np.interp(at, middles, logged), begin=run.begin, end=run.end)
            for part in events.record(run, course):
                writer.write(EventColumns(part.x, part.y, part.t, part.p))
        writer.bus_full_s = events.bus_full_s
    return writer.count, writer.content_sha256
