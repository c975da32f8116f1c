"""A recorded sequence that can be captured again with another lens motion and everything else unchanged.

Light is linear, and the stacks hold every focus position. A camera that runs while a method moves its lens therefore
needs no renderer, only the stacks, light gains, sensor and seeds of the recording.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import gcd
from pathlib import Path
from typing import Any

import numpy as np

from saf_gen.camera import LANES, parse_sensor
from saf_gen.camera.camera import Camera, Integral
from saf_gen.camera.kinds import camera_type
from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.region import Region
from saf_gen.errors import BadInput
from saf_gen.parts import is_endless
from saf_gen.plugins.lights import PRODUCT, Schedule, build_light, group_gains, list_lamps
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.colour import Colour
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.light import SceneLight, lamp_integrals
from saf_gen.stack.time_resolved import FRAMES_PER_BYTE, PlaneSource, TimeResolvedStack
from saf_gen.stream.metadata import Truth
from saf_gen.stream.optima import PROVENANCE_KEYS, optima_of_stream
from saf_gen.stream.recordings import LIGHT_S, SENSOR, Recording

CACHE_BYTES = 1 << 30  # planes of a moving scene: methods read them one after another, most in the same sweep


@dataclass(frozen=True, eq=False)
class Capture:
    """The scene that was in front of the lens, and the camera that recorded it.

    Attributes
    ----------
    plane_source : PlaneSource
        Focal stacks of the recording.
    sensor : Sensor, SpadSensor or FrameSensor
        Sensor to whose readouts the light belongs; by them lens and truth are logged.
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
    optima : mapping of str to mapping of str to float
        Distances of the noise-free peaks of measures from the true focus, by region and measure
        (:mod:`saf_gen.stream.optima`).
    recorder : CameraSensor, optional
        Sensor of the camera, if that is another one than ``sensor``: an event camera's.
    lamps : callable
        Returns the integral of the gain of each lamp; raises BadInput if the recording does not say how its light
        changed.
    light_s : float, default 0.0
        For how many seconds the schedules of the light run, as long as the recording.
    schedule : mapping, default {}
        Light schedules of the recording.
    """

    plane_source: PlaneSource
    sensor: Any
    gain: np.ndarray
    exposure: float
    seed: int
    device_seed: int
    truth: Truth
    frames: int
    slices: str = ""
    colour: Colour | None = None
    optima: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    recorder: Any = None
    lamps: Callable[[], Sequence[Integral]] = tuple
    light_s: float = 0.0
    schedule: Mapping[str, Schedule] = field(default_factory=dict)

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
            own = SENSOR[stream.form] == "sensor"
            kind = stream.counted if own else "spikes"
            sensor = parse_sensor(provenance["sensor"], f"{where} /provenance/sensor", kind=kind)
            scale, device_seed = float(exposure["scale"]), int(exposure["device_seed"])
            gain = np.asarray(stream.metadata.gain, dtype=np.float32)  # TypeError if there is no gain
        except (KeyError, ValueError, TypeError, OverflowError) as error:
            raise BadInput(
                "the stream does not say how to capture it again",
                where=where,
                allowed="streams of a dataset, for the closed-loop track",
                hint="remove it and run saf-gen generate again, or use --track recorded",
            ) from error
        recorder = None if own else _recorder(stream)
        specs = tuple(StackSpec.read(stacks, key) for key in keys)
        moving = len(specs) > 1
        if moving and stream.form == "frames":
            raise BadInput("frames of a moving scene cannot be captured again", where=where, allowed="scenes at rest")
        slice_frames = tuple(round(s.time_s * stream.readout_hz) for s in specs) if moving else (0,)
        time_stack = TimeResolvedStack(slice_frames, specs)
        axial_colour, groups, light_s = sequence.get("axial_colour"), specs[0].groups, _light_s(stream)
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
        return cls(
            plane_source,
            sensor,
            gain,
            scale,
            seed,
            device_seed,
            stream.truth,
            frames,
            slices,
            colour,
            {region: optima_of_stream(provenance, region) for region in PROVENANCE_KEYS},
            recorder,
            partial(lamp_integrals, provenance, groups, duration_s=light_s, where=where),
            light_s,
            sequence.get("schedule", {}),
        )

    @property
    def end(self) -> str:
        """Why the camera cannot run longer than ``frames``; '' if it can.

        A scene at rest has no end where the light has none.
        """
        if self.plane_source.time_stack.is_moving:
            return "as long as " + (
                "was recorded" if self.frames == len(self.gain) else "its time slices hold all focus positions"
            )
        if self.truth.track is not None:
            return "as long as was recorded, because its focus follows the colour of the light"
        try:
            stated = [lamp.component for lamp in list_lamps(self.schedule, self._groups) if lamp.component is not None]
            ending = next((one for one in stated if not is_endless(build_light(one))), None)
        except (AttributeError, KeyError, TypeError, ValueError):
            return "as long as was recorded, which does not say how its light changed"
        if ending is None:
            return ""
        return f"as long as was recorded, where the light {ending.get('kind', PRODUCT)!r} ends"

    @property
    def _groups(self) -> tuple[str, ...]:
        return self.plane_source.time_stack.specs[0].groups

    def lasting(self, frames: int) -> "Capture":
        """Return the capture with at least this number of readouts, or as it is if it cannot run longer.

        After the recording, the light goes on as its schedules say, and so does the noise.
        """
        if frames <= self.frames or self.end:
            return self
        hz = self.sensor.readout_hz
        gain = group_gains(self.schedule, self._groups, frames=frames, readout_hz=hz, duration_s=self.light_s)
        return replace(self, gain=np.concatenate([self.gain, gain[len(self.gain) :]]), frames=frames)

    @property
    def kind(self) -> str:
        """Kind of the camera."""
        return str((self.recorder or self.sensor).kind)

    @property
    def camera(self) -> type[Camera]:
        """Class of the camera."""
        return camera_type(self.kind)

    def rows_for(self, region: Region) -> slice:
        """Return the rows that the camera needs for a region: all, or from the beginning of a block of its noise."""
        if self.camera.whole_array:
            return slice(0, self.sensor.rows)
        step = LANES // gcd(self.sensor.columns, LANES)
        return slice(region[0].start // step * step, region[0].stop)

    def open_charge_source(self, rows: slice | None = None) -> ChargeSource:
        """Return the source of the charge collected in these rows (all by default); many runs may share it."""
        part = None if rows == slice(0, self.sensor.rows) else rows
        charge_source = ChargeSource(
            self.plane_source, self.sensor, rows=part, cache_bytes=CACHE_BYTES, colour=self.colour
        )
        charge_source.scale = self.exposure
        return charge_source

    def open_light(self, rows: slice | None = None) -> SceneLight:
        """Return the light in these rows (all by default), in which the camera may be started many times."""
        lamps = () if self.camera.form == "bits" else self.lamps()
        return SceneLight(self.open_charge_source(rows), self.gain, lamps)

    def start_camera(self, rows: slice | None = None, *, threads: int | None = None) -> Camera:
        """Return the camera before its first readout, with the noise of the recording."""
        return self.camera.start(
            self.recorder or self.sensor,
            shape=(self.sensor.rows, self.sensor.columns),
            seed=self.seed,
            device_seed=self.device_seed,
            rows=rows,
            threads=threads,
        )


def _recorder(stream: Recording) -> Any:
    """Return the sensor that recorded a stream; raise BadInput if the file does not describe a valid one."""
    name = SENSOR[stream.form]
    if (text := stream.metadata.provenance.get(name)) is None:
        raise BadInput(
            f"the file does not say which camera recorded its {stream.counted}",
            where=str(stream.path),
            hint="record it again with saf-gen recapture, or use --track recorded",
        )
    return parse_sensor(text, f"{stream.path} /provenance/{name}", kind=stream.counted)


def _light_s(stream: Recording) -> float:
    """Return for how many seconds the schedules of the light run: by default, as long as the recording."""
    text = stream.metadata.provenance.get(LIGHT_S)
    if text is None and stream.form != "frames":
        return stream.shape[0] / stream.readout_hz
    try:
        return float(text or "")
    except ValueError as error:
        raise BadInput(
            "the file does not say for how long its light changed",
            where=str(stream.path),
            hint="record it again with saf-gen recapture",
        ) from error


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
