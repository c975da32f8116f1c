"""Recording of a sequence: the spike camera sees the focal stacks under the lights, and its spikes become a stream."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from saf_gen.camera import Encoder, Sensor, camera_exposure_scale, draw_sensor_fixed_pattern
from saf_gen.generate.finished_recordings import fingerprint_generated_recording
from saf_gen.generate.plan import PlannedSequence
from saf_gen.plugins.lights import light_group_gains
from saf_gen.plugins.motions import motion_positions_at_readouts
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.recording_grain import stack_grain_along_recording
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stack.true_focus import find_true_focus_of_stack, noise_free_stack_sharpness
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.recorded_grain import PROVENANCE_KEY
from saf_gen.stream.stream_writer import StreamWriter

BLOCK_FRAMES = 2000  # frames in memory at a time: 25 MB of packed spikes at 400x250, however long the recording


@dataclass(frozen=True)
class Recorder:
    """Records sequences of one dataset.

    Attributes
    ----------
    sensor : Sensor
        Sensor of the spike camera.
    frames : int
        Readouts per sequence.
    device_seed : int
        Seed of the fixed pattern of the device, which is the same in all sequences.
    provenance : dict of str to str
        Texts to store in every stream file.
    """

    sensor: Sensor
    frames: int
    device_seed: int
    provenance: dict[str, str]

    def record(
        self,
        sequence: PlannedSequence,
        plane_source: PlaneSource,
        *,
        path: Path,
        fingerprint: str,
        threads: int | None = None,
        progress: Callable[[float], None] = lambda done: None,
    ) -> str:
        """Encode a sequence into the stream file ``path`` and return its content_sha256.

        Spikes are made and written block by block, so memory does not grow with the length of the recording.
        ``fingerprint`` is that of the plan; see :func:`fingerprint_generated_recording` for what the file stores.

        Raises BadInput if the schedule names a light group that the scene does not have, the motion does not fit the
        recording, the target is never seen, or the exposure is out of reach.
        """
        time_stack, hz = plane_source.time_stack, self.sensor.readout_hz
        spec = time_stack.specs[0]
        position = motion_positions_at_readouts(sequence.motion, self.frames, readout_hz=hz)
        charge_source = ChargeSource(plane_source, self.sensor)
        truth, moment = find_true_focus_of_stack(plane_source, position)
        self._scale_light(charge_source, sequence.mean_rate, truth=truth, moment=moment)
        gain = light_group_gains(sequence.schedule, spec.groups, frames=self.frames, readout_hz=hz)
        grain = stack_grain_along_recording(plane_source, truth, position=position, gain=gain)
        metadata = Metadata(
            focus_position=position.astype(np.float32),
            image_distance=spec.drive.image_distance(position).astype(np.float32),
            object_distance=spec.drive.object_distance(position).astype(np.float32),
            gain=gain,
            light_names=spec.groups,
            truth=replace(truth, sharpness=noise_free_stack_sharpness(charge_source, truth, position=position)),
            provenance={
                **self.provenance,
                "fingerprint": fingerprint_generated_recording(fingerprint, truth, mean_rate=sequence.mean_rate),
                "sequence": json.dumps(sequence.as_dict(), indent=1),
                "exposure": json.dumps({"scale": charge_source.scale, "device_seed": self.device_seed}),
                "stack": "\n".join(spec.key for spec in time_stack.specs),
                "stack_digest": plane_source.digest,
                "variant": plane_source.backend,
                **({} if grain is None else {PROVENANCE_KEY: grain.to_text()}),
            },
        )
        shape = (self.sensor.rows, self.sensor.columns)
        encoder = Encoder(self.sensor, shape, seed=sequence.seed, device_seed=self.device_seed, threads=threads)
        with StreamWriter(
            path, shape=(self.frames, *shape), readout_hz=hz, metadata=metadata, threads=threads
        ) as writer:
            for begin in range(0, self.frames, BLOCK_FRAMES):
                for run in time_stack.split_at_slices(begin, min(begin + BLOCK_FRAMES, self.frames)):
                    writer.write(encoder.encode(**charge_source.encoder_inputs(run, position=position, gain=gain)))
                    progress(run.end / self.frames)
        return writer.content_sha256

    def _scale_light(
        self, charge_source: ChargeSource, mean_rate: float | None, *, truth: Truth, moment: float
    ) -> None:
        """Scale the light so that the target fires at ``mean_rate`` at best focus, in the picture at ``moment``."""
        if mean_rate is None:
            return
        # Use the response and threshold of the target's pixels, whose mean differs from that of the whole array.
        target = np.asarray(truth.target)
        device = draw_sensor_fixed_pattern(self.sensor, target.shape, seed=self.device_seed)
        sensitivity = device.response * (self.sensor.threshold_e / device.threshold)
        at_best = sensitivity * charge_source.charge_image(moment, truth.position).sum(axis=0)
        charge_source.scale = camera_exposure_scale(at_best, target, sensor=self.sensor, mean_rate=mean_rate)
