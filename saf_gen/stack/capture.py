"""A recorded sequence that can be filmed again: the lens moved otherwise, everything else as it was.

Light is linear and the stacks hold every focus position, so a camera that runs while a method moves its lens
needs no renderer: the stacks, the light of each readout, the sensor and the seeds of the recording do.
"""

import json
from dataclasses import dataclass
from math import gcd
from pathlib import Path

import numpy as np

from saf_gen.camera import LANES, Encoder, Sensor, sensor_from_text
from saf_gen.errors import BadInput
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import FRAMES_PER_BYTE, PlaneSource, TimeResolvedStack
from saf_gen.stream.stream_file import SpikeStream, Truth

__all__ = ["Capture"]

KEEP_BYTES = 1 << 30  # of a moving scene: methods go through it one after the other, most by the same sweep


@dataclass(frozen=True, eq=False)
class Capture:
    """What was in front of the lens, and the camera.

    ``gain`` float32 (T, G): the light of each readout; ``exposure`` multiplies it. ``seed`` names the noise
    of the recording, ``device_seed`` the fixed pattern. ``frames``: so many readouts can be filmed, all of
    them or fewer, since time slices at all focus positions may be there for the beginning only.
    """

    plane_source: PlaneSource
    sensor: Sensor
    gain: np.ndarray
    exposure: float
    seed: int
    device_seed: int
    truth: Truth
    frames: int
    slices: str = ""
    """Digest of the time slices, where the recording was not made of these."""

    @classmethod
    def from_stream(cls, stream: SpikeStream, stacks: Path) -> "Capture":
        """The take behind a stream, from the stacks that it was made of.

        Raises BadInput where the stream was not made by `saf-gen generate`, or the stacks are gone, are
        others, or none is at all focus positions.
        """
        said, where = stream.metadata.provenance, str(stream.path)
        try:
            keys = said["stack"].split("\n")
            exposure, seed = json.loads(said["exposure"]), int(json.loads(said["sequence"])["seed"])
            sensor = sensor_from_text(said["sensor"], f"{where} /provenance/sensor")
            scale, device = float(exposure["scale"]), int(exposure["device_seed"])
            gain = np.asarray(stream.metadata.gain, dtype=np.float32)  # TypeError where there is none
        except (KeyError, ValueError, TypeError) as error:
            raise BadInput(
                "the stream does not tell how to film it again",
                where=where,
                allowed="streams of a dataset, for the closed-loop track",
                hint="remove it and run saf-gen generate again, or use --track recorded",
            ) from error
        specs = tuple(StackSpec.read(stacks, key) for key in keys)
        moments = (0,) if len(specs) == 1 else tuple(round(s.time_s * stream.readout_hz) for s in specs)
        time_stack = TimeResolvedStack(moments, specs)
        plane_source, frames, slices = PlaneSource.from_folder(time_stack, stacks), len(gain), ""
        if plane_source.digest != said["stack_digest"]:
            raise BadInput(
                f"the focal stacks under {stacks} are not those it was made from",
                where=where,
                hint="run saf-gen generate again",
            )
        if time_stack.is_moving and time_stack.with_full_travel() != time_stack:
            there = time_stack.with_full_travel().count_stored(stacks)
            frames = min(frames, moments[max(there - 1, 0)])
            if frames < 2 * FRAMES_PER_BYTE:
                raise BadInput(
                    "its time slices hold only the positions that the recorded sweep passed",
                    where=where,
                    hint="set render: {whole_slices: SECONDS} in the recipe and run saf-gen generate again",
                )
            plane_source = PlaneSource.from_folder(time_stack.truncated_to(frames).with_full_travel(), stacks)
            slices = plane_source.digest
        return cls(plane_source, sensor, gain, scale, seed, device, stream.truth, frames, slices)

    @property
    def row_alignment(self) -> int:
        """Rows from which an encoder may begin: multiples of this."""
        return LANES // gcd(self.sensor.columns, LANES)

    def open_charge_source(self, rows: slice | None = None) -> ChargeSource:
        """What the sensor collects, in these rows (None: all). One may serve many runs."""
        exposed = ChargeSource(self.plane_source, self.sensor, rows=rows, keep_bytes=KEEP_BYTES)
        exposed.scale = self.exposure
        return exposed

    def create_encoder(self, rows: slice | None = None, *, threads: int | None = None) -> Encoder:
        """The camera at rest before the first readout, with the noise of the recording."""
        shape = self.sensor.rows, self.sensor.columns
        return Encoder(
            self.sensor, shape, seed=self.seed, device_seed=self.device_seed, rows=rows, threads=threads
        )
