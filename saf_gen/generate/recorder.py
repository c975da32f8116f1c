"""One sequence: what was filmed, under a light schedule, seen by the spike camera, stored as a stream."""

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.camera import Encoder, Sensor, draw_fixed_pattern, exposure_scale
from saf_gen.errors import BadInput
from saf_gen.generate.plan import PlannedSequence
from saf_gen.lights import get_light, readout_gains
from saf_gen.motions import readout_positions
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stack.true_focus import find_true_focus, noise_free_sharpness
from saf_gen.stream.stream_file import Metadata, StreamWriter, Truth

__all__ = ["MODEL", "Recorder", "group_gains"]

MODEL = 2
"""Raised whenever the same stack, recipe and seed would give other spikes: old files are then made anew."""

BLOCK_FRAMES = 2000  # of spikes in memory at a time: 25 MB packed at 400x250, whatever the length


@dataclass(frozen=True)
class Recorder:
    """What all sequences of a dataset share: the sensor, its device seed, the length, the texts to keep."""

    sensor: Sensor
    frames: int
    device_seed: int
    provenance: dict[str, str]

    def record(
        self,
        sequence: PlannedSequence,
        plane_source: PlaneSource,
        path: Path,
        *,
        fingerprint: str,
        threads: int | None = None,
        progress: Callable[[float], None] = lambda done: None,
    ) -> str:
        """Encode a sequence into ``path``; returns its content_sha256.

        Memory does not grow with the length: spikes are made and written in blocks of time.

        Raises BadInput for a light group that the scene does not have, a motion that does not fit the
        recording, a target that is never seen, or an exposure out of reach.
        """
        spec, time_stack = plane_source.time_stack.specs[0], plane_source.time_stack
        position = readout_positions(sequence.motion, self.frames, self.sensor.readout_hz)
        exposed = ChargeSource(plane_source, self.sensor)
        truth = find_true_focus(plane_source, position)
        self._expose(exposed, sequence, truth)
        gain = group_gains(sequence.schedule, spec.groups, self.frames, self.sensor.readout_hz)
        metadata = Metadata(
            focus_position=position.astype(np.float32),
            image_distance=spec.drive.image_distance(position).astype(np.float32),
            object_distance=spec.drive.object_distance(position).astype(np.float32),
            gain=gain,
            light_names=spec.groups,
            truth=replace(truth, sharpness=noise_free_sharpness(exposed, truth, position=position)),
            provenance={
                **self.provenance,
                "fingerprint": fingerprint,
                "sequence": json.dumps(asdict(sequence), indent=1),
                "exposure": json.dumps({"scale": exposed.scale, "device_seed": self.device_seed}),
                "stack": "\n".join(spec.key for spec in time_stack.specs),
                "stack_digest": plane_source.digest,
                "variant": plane_source.backend,
            },
        )
        shape = (self.sensor.rows, self.sensor.columns)
        encoder = Encoder(
            self.sensor, shape, seed=sequence.seed, device_seed=self.device_seed, threads=threads
        )
        with StreamWriter(
            path,
            shape=(self.frames, *shape),
            readout_hz=self.sensor.readout_hz,
            metadata=metadata,
            threads=threads,
        ) as writer:
            for begin in range(0, self.frames, BLOCK_FRAMES):
                for run in time_stack.split_at_slices(begin, min(begin + BLOCK_FRAMES, self.frames)):
                    inputs = exposed.encoder_inputs(run, position=position, gain=gain)
                    writer.write(encoder.encode(**inputs))
                    progress(run.end / self.frames)
        return writer.content_sha256

    def _expose(self, exposed: ChargeSource, sequence: PlannedSequence, truth: Truth) -> None:
        """Scale the light so that the target fires at the rate asked for, where the lens passes the truth."""
        if sequence.mean_rate is None:
            return
        # This very device's pixels: what the target collects is not the mean of the whole array.
        target = np.asarray(truth.target)
        device = draw_fixed_pattern(self.sensor, target.shape, seed=self.device_seed)
        sensitivity = device.response * (self.sensor.threshold_e / device.threshold)
        frame = truth.frame if math.isfinite(truth.frame) else self.frames / 2
        at_best = sensitivity * exposed.charge_image(frame, truth.position).sum(axis=0)
        exposed.scale = exposure_scale(at_best, target, sensor=self.sensor, mean_rate=sequence.mean_rate)


def group_gains(
    schedule: dict[str, dict[str, Any]], groups: tuple[str, ...], frames: int, readout_hz: float
) -> np.ndarray:
    """Mean gain of each readout for each light group, float32 (frame, light); a group not named stays at 1.

    Raises BadInput for a group that the scene does not have, and for a gain that float32 cannot hold.
    """
    for name in schedule:
        if name and name not in groups:
            raise BadInput(f"the scene has no light group {name!r}", allowed=", ".join(groups))
    gains = np.ones((frames, len(groups)), dtype=np.float32)
    for g, group in enumerate(groups):
        part = schedule.get("", schedule.get(group))
        if part is not None:
            light = get_light(part["kind"], **{k: v for k, v in part.items() if k != "kind"})
            with np.errstate(over="ignore", invalid="ignore"):  # told below, in one line
                gains[:, g] = readout_gains(light, frames, readout_hz)
            if not np.isfinite(gains[:, g]).all():
                raise BadInput(
                    f"the gain of {light!r} is too large to be recorded",
                    allowed=f"gains up to {np.finfo(np.float32).max:.2g}",
                )
    return gains
