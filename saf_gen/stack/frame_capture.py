"""The frames that another camera would have recorded of a sequence: the same scene, lens, light and moment.

The frame camera stands on the grid of the spike camera, and each of its pixels collects as many photo-electrons per
second as the pixel of the spike camera. During an exposure the lens moves and the light changes: the light of each
lamp is integrated by the law of its schedule, and the lens is followed in steps of at most 50 µs, so that the charge is
a sum of the pictures at the knots that the lens passes, each with its own weight.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import ceil, isfinite
from pathlib import Path

import numpy as np
import yaml

from saf_gen.camera import Sensor, knot_weights
from saf_gen.camera.frames import FrameCamera, FrameSensor
from saf_gen.camera.frames.kernel import add_planes
from saf_gen.camera.frames.sensor import exposure_for
from saf_gen.core.config.frozen_benchmarks import BENCHMARK_KEY
from saf_gen.errors import BadInput
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.recapture import light_integrals, resample
from saf_gen.stack.time_resolved import FrameRun
from saf_gen.stream.frame_file import FINGERPRINT, FrameFile, write_frames
from saf_gen.stream.stream_file import SpikeStream

MODEL = 3
"""Number of the law by which frames are made; it is part of their fingerprint."""
STEP_S, LEAST_STEPS = 5e-5, 8
LIGHT_S = "light_s"
"""Name of the text in the provenance that says for how many seconds the schedules of the light run."""


def frames_fingerprint(content_sha256: str, sensor: FrameSensor, *, share: float | None) -> str:
    """Return what identifies the frames that a sensor makes of a sequence: the sequence, the sensor, and the law."""
    made = {"model": MODEL, "stream": content_sha256, "sensor": sensor.as_dict(), "share": share}
    return hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest()


def record_frames(
    stream: SpikeStream, stacks: Path, *, sensor: FrameSensor, share: float | None, path: Path
) -> tuple[int, str, FrameSensor]:
    """Record a sequence with a frame camera into the file ``path``.

    Parameters
    ----------
    stream : SpikeStream
        Sequence that ``saf-gen generate`` made.
    stacks : Path
        Folder of the focal stacks.
    sensor : FrameSensor
        The camera, of which pitch, fill factor, quantum efficiency and spectrum are not used.
    share : float or None
        Share of its well that a pixel of the target fills at best focus and gain 1: the exposure is as long as that
        takes, and at most a frame. None keeps the exposure of the sensor.
    path : Path
        File to write.

    Returns
    -------
    tuple of int, str and FrameSensor
        Frames, content_sha256, and the sensor as it was exposed.

    Raises
    ------
    BadInput
        If ``saf-gen generate`` did not make the stream or it is not of a spike camera, its stacks are missing or have
        changed, it does not say where the lens was or how its light changed, or it is shorter than a frame.
    """
    capture = Capture.from_stream(stream, stacks)
    lens, spikes = stream.metadata.lens_position, capture.sensor
    if not isinstance(spikes, Sensor):
        raise BadInput("no spike camera recorded it", where=str(stream.path), allowed="a dataset of a spike camera")
    if lens is None:
        raise BadInput("the stream does not say where the lens was", where=str(stream.path))
    placed = sensor.in_place_of(spikes)
    source = ChargeSource(capture.plane_source, spikes, colour=capture.colour)
    source.scale = capture.exposure
    truth, per_s = stream.metadata.truth, stream.readout_hz
    if share is not None:
        moment = truth.frame if isfinite(truth.frame) else 0.0
        light = source.nominal_image(moment, truth.position)[np.asarray(truth.target, bool)]
        placed = exposure_for(light.astype(np.float64) * per_s, placed, share=share)
    rows_s = row_starts_s(placed)
    seconds = capture.frames / per_s
    frames = int((seconds - rows_s[-1] - placed.exposure_s) * placed.readout_hz + 1e-9) + 1
    if frames < 1 or seconds < rows_s[-1] + placed.exposure_s:
        raise BadInput(f"the sequence lasts {seconds:g} s", where=str(stream.path), allowed="at least a frame")
    middle_s = float(rows_s.mean()) + placed.exposure_s / 2
    metadata = resample(stream, frames, readout_hz=placed.readout_hz, middle_s=middle_s)
    groups = capture.plane_source.time_stack.specs[0].groups
    seconds_of_light = stream.shape[0] / per_s
    integrals = light_integrals(stream, groups, duration_s=seconds_of_light)
    begins = np.arange(frames) / placed.readout_hz + float(rows_s.mean())
    gain = np.stack([f(begins + placed.exposure_s) - f(begins) for f in integrals], axis=1) / placed.exposure_s
    texts = {name: text for name, text in metadata.provenance.items() if name != BENCHMARK_KEY}
    metadata = replace(
        metadata,
        gain=gain.astype(np.float32),
        provenance={
            **texts,
            "sensor": yaml.safe_dump(placed.as_dict(), sort_keys=False),
            "spikes_content": stream.content_sha256,
            LIGHT_S: repr(seconds_of_light),
            FINGERPRINT: frames_fingerprint(stream.content_sha256, sensor, share=share),
        },
    )
    shape = frames, placed.rows, placed.columns
    camera = FrameCamera(placed, shape[1:], seed=capture.seed, device_seed=capture.device_seed)
    readouts = np.arange(len(lens))

    def position(at: np.ndarray) -> np.ndarray:
        return np.interp(at * per_s - 0.5, readouts, lens.astype(np.float64))

    def expose() -> Iterator[np.ndarray]:
        for frame in range(frames):
            begin = frame / placed.readout_hz + rows_s
            charge = expose_light(source, integrals, begin_s=begin, exposure_s=placed.exposure_s, position=position)
            yield camera.expose(charge * per_s, frame=frame)

    hz, black = placed.readout_hz, placed.black_level_dn
    digest = write_frames(path, expose(), shape=shape, readout_hz=hz, black_level_dn=black, metadata=metadata)
    return frames, digest, placed


def recorded_light(stream: FrameFile, capture: Capture) -> list[Callable[[np.ndarray], np.ndarray]]:
    """Return the integral of the gain of each lamp, over seconds, in front of a camera that recorded frames.

    Raises BadInput if the file does not say how its light changed, or by a schedule that is not there any more.
    """
    try:
        seconds = float(stream.metadata.provenance[LIGHT_S])
    except (KeyError, ValueError) as error:
        raise BadInput(
            "the file does not say for how long its light changed", where=str(stream.path),
            hint="record it again with saf-gen recapture",
        ) from error  # fmt: skip
    return light_integrals(stream, capture.plane_source.time_stack.specs[0].groups, duration_s=seconds)


def row_starts_s(sensor: FrameSensor) -> np.ndarray:
    """Return when the exposure of each row begins, seconds from the beginning of a frame: (H,), or (1,) for all."""
    return np.arange(sensor.rows) * sensor.row_s if sensor.shutter == "rolling" else np.zeros(1)


def expose_light(
    source: ChargeSource,
    integrals: Sequence[Callable[[np.ndarray], np.ndarray]],
    *,
    begin_s: np.ndarray,
    exposure_s: float,
    position: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Return the light of an exposure, in the charge per readout of the source times seconds, (H, W).

    ``begin_s`` holds when each row begins, or all rows together: (H,) or (1,).
    """
    time_stack = source.time_stack
    steps = max(LEAST_STEPS, ceil(exposure_s / STEP_S))
    edges = begin_s[:, None] + exposure_s * np.linspace(0, 1, steps + 1)
    middles = (edges[:, 1:] + edges[:, :-1]) / 2
    light = np.stack([np.diff(integral(edges), axis=1) for integral in integrals], axis=-1)  # (rows, steps, G)
    j = 0
    if time_stack.is_moving:
        times = np.array([spec.time_s for spec in time_stack.specs])
        j = int(np.clip(np.searchsorted(times, middles.mean(), side="right") - 1, 0, len(times) - 2))
        later = np.clip((middles - times[j]) / (times[j + 1] - times[j]), 0, 1)[..., None]
        light = np.concatenate([light * (1 - later), light * later], axis=-1)
    index, fraction = knot_weights(position(middles.ravel()), time_stack.specs[0].positions)
    first, stop = int(index.min()), int((index + (fraction > 0)).max()) + 1
    weights = np.zeros((len(begin_s), light.shape[-1], stop - first + 1))
    row = np.repeat(np.arange(len(begin_s)), steps)
    flat = light.reshape(-1, light.shape[-1])
    np.add.at(weights.transpose(0, 2, 1), (row, index - first), flat * (1 - fraction[:, None]))
    np.add.at(weights.transpose(0, 2, 1), (row, index - first + 1), flat * fraction[:, None])
    stack = source.stack(FrameRun(0, 1, j), range(first, stop))
    charge = np.zeros(stack.shape[2:])
    add_planes(stack, source.scale * weights[..., :-1], charge)
    return charge
