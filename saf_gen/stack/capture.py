"""A recorded sequence that can be captured again with another lens motion and everything else unchanged.

Light is linear, and the stacks hold every focus position. A camera that runs while a method moves its lens therefore
needs no renderer, only the stacks, light gains, sensor and seeds of the recording.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import gcd
from pathlib import Path

import numpy as np

from saf_gen.camera import LANES, BitSensor, CountingSensor, Encoder, parse_sensor, start_camera
from saf_gen.camera.frames import FrameCamera, FrameSensor
from saf_gen.camera.spad import SpadCamera
from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.region import Region
from saf_gen.errors import BadInput
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.colour import Colour
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import FRAMES_PER_BYTE, PlaneSource, TimeResolvedStack
from saf_gen.stream.metadata import Truth, sensor_kind
from saf_gen.stream.optima import optima_of_stream
from saf_gen.stream.recordings import Recording

CACHE_BYTES = 1 << 30  # planes of a moving scene: methods read them one after another, most in the same sweep


@dataclass(frozen=True, eq=False)
class Capture:
    """The scene that was in front of the lens, and the camera that recorded it.

    Attributes
    ----------
    plane_source : PlaneSource
        Focal stacks of the recording.
    sensor : Sensor, SpadSensor or FrameSensor
        Sensor of the camera.
    gain : ndarray of float32, shape (T, G)
        Gain of each light group at each readout.
    exposure : float
        Factor on all gains.
    seed : int
        Seed of the recording's noise.
    device_seed : int
        Seed of the sensor's fixed pattern.
    truth : Truth
        True focus of the recording.
    frames : int
        Number of readouts that can be captured; fewer than recorded if only the first time slices were rendered at all
        focus positions.
    slices : str
        Digest of the time slices; '' if the recording was made from them.
    colour : Colour or None
        Lamps of the recording and the axial colour of its lens; None for light of one wavelength.
    optima : mapping of str to float
        Distances of the noise-free peaks of measures from the true focus (:mod:`saf_gen.stream.optima`).
    """

    plane_source: PlaneSource
    sensor: CountingSensor
    gain: np.ndarray
    exposure: float
    seed: int
    device_seed: int
    truth: Truth
    frames: int
    slices: str = ""
    colour: Colour | None = None
    optima: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def from_stream(cls, stream: Recording, stacks: Path) -> "Capture":
        """Return the capture of a stream, from the folder of stacks that the stream was made from.

        Parameters
        ----------
        stream : SpikeStream, EventRecording or FrameFile
            Stream that `saf-gen generate` made, or what `saf-gen recapture` made of one.
        stacks : Path
            Folder of the focal stacks.

        Raises
        ------
        BadInput
            If `saf-gen generate` did not make the stream, or if the stacks are missing, have changed, or were not
            rendered at all focus positions; or if a frame camera recorded a moving scene.
        """
        provenance, where = stream.metadata.provenance, str(stream.path)
        try:
            keys = provenance["stack"].split("\n")
            exposure = load_plain_json(provenance["exposure"])
            sequence = load_plain_json(provenance["sequence"])
            seed = int(sequence["seed"])
            sensor = parse_sensor(provenance["sensor"], f"{where} /provenance/sensor", kind=sensor_kind(stream))
            scale, device_seed = float(exposure["scale"]), int(exposure["device_seed"])
            gain = np.asarray(stream.metadata.gain, dtype=np.float32)  # TypeError if there is no gain
        except (KeyError, ValueError, TypeError, OverflowError) as error:
            raise BadInput(
                "the stream does not say how to capture it again",
                where=where,
                allowed="streams of a dataset, for the closed-loop track",
                hint="remove it and run saf-gen generate again, or use --track recorded",
            ) from error
        specs = tuple(StackSpec.read(stacks, key) for key in keys)
        moving = len(specs) > 1
        if moving and isinstance(sensor, FrameSensor):
            raise BadInput("frames of a moving scene cannot be captured again", where=where, allowed="scenes at rest")
        slice_frames = tuple(round(s.time_s * stream.readout_hz) for s in specs) if moving else (0,)
        time_stack = TimeResolvedStack(slice_frames, specs)
        axial_colour, groups = sequence.get("axial_colour"), specs[0].groups
        colour = Colour.find(sequence.get("schedule", {}), groups, sensor=sensor, axial_colour=axial_colour)
        plane_source, frames, slices = PlaneSource.from_folder(time_stack, stacks), len(gain), ""
        if plane_source.digest != provenance["stack_digest"]:
            raise BadInput(
                f"the stream was not made from the focal stacks under {stacks}",
                where=where,
                hint="run saf-gen generate again",
            )
        full_travel = time_stack.with_full_travel()
        if moving and full_travel == time_stack and full_travel.count_stored(stacks) < len(specs):
            raise _lacking_slices_error(provenance.get("recipe", ""), where)
        if moving and full_travel != time_stack:
            frames = min(frames, slice_frames[max(full_travel.count_stored(stacks) - 1, 0)])
            if frames < 2 * FRAMES_PER_BYTE:
                raise _lacking_slices_error(provenance.get("recipe", ""), where)
            plane_source = PlaneSource.from_folder(full_travel.truncated_to(frames), stacks)
            slices = plane_source.digest
        optima = optima_of_stream(provenance)
        return cls(plane_source, sensor, gain, scale, seed, device_seed, stream.truth, frames, slices, colour, optima)

    @property
    def bit_sensor(self) -> BitSensor:
        """The sensor, of a spike camera or a single-photon array; raises BadInput if it is that of a frame camera."""
        if isinstance(self.sensor, FrameSensor):
            raise BadInput(f"{self.sensor.name} reads out frames", allowed="a camera that reads out bits")
        return self.sensor

    def encoder_rows(self, region: Region) -> slice:
        """Return the rows that an encoder needs for a region, from the beginning of a block of its noise."""
        step = LANES // gcd(self.sensor.columns, LANES)
        return slice(region[0].start // step * step, region[0].stop)

    def open_charge_source(self, rows: slice | None = None) -> ChargeSource:
        """Return the source of the charge collected in these rows (all by default); many runs may share it."""
        charge_source = ChargeSource(
            self.plane_source, self.sensor, rows=rows, cache_bytes=CACHE_BYTES, colour=self.colour
        )
        charge_source.scale = self.exposure
        return charge_source

    def create_encoder(self, rows: slice | None = None, *, threads: int | None = None) -> Encoder | SpadCamera:
        """Return the camera before its first readout, with the noise of the recording.

        Raises BadInput if it is a frame camera.
        """
        sensor = self.bit_sensor
        shape = sensor.rows, sensor.columns
        return start_camera(sensor, shape, seed=self.seed, device_seed=self.device_seed, rows=rows, threads=threads)

    def create_frame_camera(self) -> FrameCamera:
        """Return the frame camera of the recording, with its noise; raise BadInput if it reads out bits."""
        if not isinstance(self.sensor, FrameSensor):
            raise BadInput(f"{self.sensor.name} reads out bits", allowed="a frame camera")
        shape = self.sensor.rows, self.sensor.columns
        return FrameCamera(self.sensor, shape, seed=self.seed, device_seed=self.device_seed)


def _lacking_slices_error(recipe: str, where: str) -> BadInput:
    """Return the error for a moving scene without slices of all positions; ``recipe`` is the text of its recipe."""
    if "whole_slices: " in recipe and "whole_slices: false" not in recipe:
        return BadInput(
            "its time slices for the closed loop were not kept",
            where=where,
            hint="run saf-gen generate again with --keep-slices closed-loop, or use --track recorded",
        )
    return BadInput(
        "its time slices hold only the positions that the recorded sweep passed",
        where=where,
        hint="set render: {whole_slices: SECONDS} in the recipe and run saf-gen generate again",
    )
