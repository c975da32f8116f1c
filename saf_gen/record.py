"""One sequence: a focal stack under a light schedule, seen by the spike camera, stored as a stream."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.camera import (
    Encoder,
    Sensor,
    charge_stack,
    exposure_scale,
    fixed_pattern,
    knot_weights,
)
from saf_gen.errors import BadInput
from saf_gen.focal_stack import FocalStack
from saf_gen.lights import get_light, readout_gains
from saf_gen.optics import ImageDistance, sweep
from saf_gen.plan import Sequence
from saf_gen.region import target_box
from saf_gen.stream import Metadata, StreamWriter, Truth

__all__ = ["MODEL", "Recorder", "group_gains"]

MODEL = 1
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
        sequence: Sequence,
        stack: FocalStack,
        path: Path,
        *,
        fingerprint: str,
        threads: int | None = None,
        progress: Callable[[float], None] = lambda done: None,
    ) -> str:
        """Encode a sequence into ``path``; returns its content_sha256.

        Memory does not grow with the length: spikes are made and written in blocks of time.

        Raises BadInput for a light group that the scene does not have, or an exposure out of reach.
        """
        drive = stack.spec.drive
        position = sweep(self.frames)
        truth = self._truth(stack, drive)
        charge = self._charge(sequence, stack, truth.position)
        gain = group_gains(sequence.schedule, stack.spec.groups, self.frames, self.sensor.readout_hz)
        metadata = Metadata(
            focus_position=position.astype(np.float32),
            image_distance=drive.image_distance(position).astype(np.float32),
            object_distance=drive.object_distance(position).astype(np.float32),
            gain=gain,
            light_names=stack.spec.groups,
            truth=replace(truth, sharpness=_sharpness(charge.sum(axis=0), stack.target)),
            provenance={
                **self.provenance,
                "fingerprint": fingerprint,
                "sequence": json.dumps(asdict(sequence), indent=1),
                "stack": stack.spec.key,
                "stack_digest": stack.digest,
                "variant": stack.variant,
            },
        )
        if (
            gain == gain[:, :1]
        ).all():  # one schedule for all groups: one light as far as the camera can tell
            charge, gain = charge.sum(axis=0, keepdims=True), gain[:, :1]
        index, fraction = knot_weights(position, stack.spec.positions)
        shape = (self.sensor.rows, self.sensor.columns)
        encoder = Encoder(self.sensor, shape, sequence.seed, device_seed=self.device_seed, threads=threads)
        with StreamWriter(
            path,
            shape=(self.frames, *shape),
            readout_hz=self.sensor.readout_hz,
            metadata=metadata,
            threads=threads,
        ) as writer:
            for begin in range(0, self.frames, BLOCK_FRAMES):
                block = slice(begin, begin + BLOCK_FRAMES)
                writer.write(encoder.encode(charge, index[block], fraction[block], gain[block]))
                progress(min(1.0, block.stop / self.frames))
        return writer.content_sha256

    def _charge(self, sequence: Sequence, stack: FocalStack, best: float) -> np.ndarray:
        """Photo-electrons a readout at gain 1, float32 (light, focus, row, col), as exposed."""
        drive = stack.spec.drive
        charge = charge_stack(
            stack.radiance,
            drive.image_distance(stack.spec.focus),
            drive.aperture_radius_m,
            self.sensor,
            transmission=drive.transmission,
        )
        if sequence.mean_rate is not None:
            # This very device's pixels: what the target collects is not the mean of the whole array.
            device = fixed_pattern(self.sensor, stack.target.shape, seed=self.device_seed)
            sensitivity = device.response * (self.sensor.threshold_e / device.threshold)
            at_best = sensitivity * _interpolated(charge.sum(axis=0), float(np.clip(best, 0, 1)))
            charge *= np.float32(exposure_scale(at_best, stack.target, self.sensor, sequence.mean_rate))
        return charge

    def _truth(self, stack: FocalStack, drive: ImageDistance) -> Truth:
        depths = stack.depth[stack.target]
        position = drive.truth(depths)
        frame = position * self.frames - 0.5
        return Truth(
            position=position,
            depth_of_focus=drive.depth_of_focus(depths, stack.spec.pitch_m),
            frame=frame if -0.5 <= frame <= self.frames - 0.5 else float("nan"),
            depth=stack.depth,
            target=stack.target,
            best_position=drive.best_position(stack.depth).astype(np.float32),
        )


def group_gains(
    schedule: dict[str, dict[str, Any]], groups: tuple[str, ...], frames: int, readout_hz: float
) -> np.ndarray:
    """Mean gain of each readout for each light group, float32 (frame, light); a group not named stays at 1.

    Raises BadInput for a group that the scene does not have.
    """
    for name in schedule:
        if name and name not in groups:
            raise BadInput(f"the scene has no light group {name!r}", allowed=", ".join(groups))
    gains = np.ones((frames, len(groups)), dtype=np.float32)
    for g, group in enumerate(groups):
        part = schedule.get("", schedule.get(group))
        if part is not None:
            light = get_light(part["kind"], **{k: v for k, v in part.items() if k != "kind"})
            gains[:, g] = readout_gains(light, frames, readout_hz)
    return gains


def _interpolated(stack: np.ndarray, position: float) -> np.ndarray:
    knot = position * (len(stack) - 1)
    k = min(int(knot), len(stack) - 2)
    return stack[k] + (knot - k) * (stack[k + 1] - stack[k])


def _sharpness(charge: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Noise-free SD (variance over squared mean) in the target's box at each rendered focus, float64."""
    rows, columns = target_box(target)
    seen = charge[:, rows, columns].astype(np.float64)
    return seen.var(axis=(1, 2)) / seen.mean(axis=(1, 2)) ** 2
