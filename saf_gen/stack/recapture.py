"""The sequences of a dataset recorded again by another camera: the same scene, lens, light and moment.

The other camera stands on the grid of the spike camera, and each of its pixels meets as many photons per second as the
pixel of the spike camera turns into electrons. What differs is what the sensor makes of them. Where the lens was
between readouts is interpolated in its log; light is known at any instant, by the law of its schedule. The recordings
of a folder become a dataset, which can be judged.
"""

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from saf_gen.camera import Sensor
from saf_gen.camera.camera import Camera, CameraSensor, LensCourse, Readouts
from saf_gen.camera.kinds import camera_type, kinds_of_cameras
from saf_gen.camera.sensor_files import read_sensor
from saf_gen.core.config.frozen_benchmarks import BENCHMARK_KEY
from saf_gen.core.config.presets import change_fields
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput
from saf_gen.stack.capture import Capture
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.light import SceneLight, record
from saf_gen.stack.time_resolved import TimeResolvedStack
from saf_gen.stream.manifest import MANIFEST_NAME, Manifest, SequenceEntry, read_manifest, stem_of, write_manifest
from saf_gen.stream.metadata import Metadata
from saf_gen.stream.recordings import (
    FINGERPRINT,
    LIGHT_S,
    METHODS_OF,
    SENSOR,
    SPIKES_CONTENT,
    check_replaceable,
    recording_of,
    write_recording,
)
from saf_gen.stream.sharing.croissant import SYNTHETIC, DatasetFacts, stated_licences, write_croissant
from saf_gen.stream.stream_file import SpikeStream, open_stream

STACKS, CAMERAS = "stacks", "cameras"  # folders of a dataset


def other_kinds() -> tuple[str, ...]:
    """Return the kinds of cameras that take the place of a spike camera."""
    return tuple(kind for kind in kinds_of_cameras() if kind != "spikes")


@dataclass(frozen=True)
class Recaptured:
    """What came of recording sequences again: how many were made, how many kept, and the error of each that failed."""

    made: int
    kept: int
    failed: dict[str, BadInput]


@dataclass(frozen=True)
class Recapture:
    """A camera that takes the place of the spike camera of a dataset.

    Attributes
    ----------
    sensor : CameraSensor
        Its sensor, of which pitch, fill factor, quantum efficiency and spectrum are not used.
    chosen : bool, default True
        Whether it chooses the exposure that suits the target of each sequence, at best focus and gain 1.
    """

    sensor: CameraSensor
    chosen: bool = True

    @classmethod
    def by(cls, name: str, *, exposure_us: float | None = None) -> "Recapture":
        """Return the camera with the sensor of this name, or of a user's file.

        Parameters
        ----------
        name : str
            Name of a sensor of another kind than spikes, or path of its .yaml file.
        exposure_us : float, optional
            Exposure of each frame, microseconds; by default the camera chooses one for each sequence.

        Raises
        ------
        BadInput
            If there is no such sensor, its file is not valid, it is that of a spike camera, or it has no such exposure.
        """
        sensor = read_sensor(name, kinds=other_kinds())
        if exposure_us is None:
            return cls(sensor)
        if not hasattr(sensor, "exposure_s"):
            raise BadInput(
                f"--exposure-us is given for {name}",
                allowed="a camera that is exposed frame by frame",
                hint="leave it out",
            )
        return cls(change_fields(sensor, {"exposure_s": exposure_us * 1e-6}, where=f"sensor {name}"), chosen=False)

    @property
    def name(self) -> str:
        """Name of the sensor."""
        return self.sensor.name

    @property
    def camera(self) -> type[Camera]:
        """Class of the camera."""
        return camera_type(self.sensor.kind)

    def describe(self) -> dict[str, Any]:
        """Return all that determines what the camera records, as plain data."""
        made = {"kind": self.sensor.kind, "model": self.camera.model, "sensor": self.sensor.as_dict()}
        return {**made, "chosen": self.chosen}

    def fingerprint(self, content_sha256: str) -> str:
        """Return what identifies the recording of a sequence: the sequence, the sensor, and the law."""
        made = json.dumps({"stream": content_sha256, **self.describe()}, sort_keys=True)
        return hashlib.sha256(made.encode()).hexdigest()

    def record(
        self,
        stream: SpikeStream,
        stacks: Path,
        *,
        path: Path,
        threads: int | None = None,
        progress: Callable[[float], None] = lambda done: None,
    ) -> str:
        """Record a sequence into the file ``path`` and return what to say of it.

        Parameters
        ----------
        stream : SpikeStream
            Sequence that ``saf-gen generate`` made.
        stacks : Path
            Folder of the focal stacks.
        path : Path
            File to write.
        threads : int, optional
            Number of threads.
        progress : callable, optional
            Called with the finished fraction.

        Raises
        ------
        BadInput
            If ``saf-gen generate`` did not make the stream or it is not of a spike camera, its stacks are missing or
            have changed, it does not say where the lens was or how its light changed, or it is shorter than a frame.
        """
        capture, hz = Capture.from_stream(stream, stacks), stream.readout_hz
        if not isinstance(capture.sensor, Sensor):
            raise BadInput("no spike camera recorded it", where=str(stream.path), allowed="a dataset of a spike camera")
        if (position := stream.metadata.lens_position) is None:
            raise BadInput("the stream does not say where the lens was", where=str(stream.path))
        light = SceneLight(capture.open_charge_source(), lamps=capture.lamps())
        sensor = self.sensor.in_place_of(capture.sensor)
        if self.chosen:
            sensor = sensor.exposed_for(_light_of_target(stream, light.source) * hz)
        lens, metadata, frames = LensCourse(position, hz), stream.metadata, capture.frames
        if readouts := sensor.readouts(frames / hz):
            if self.camera.form == "bits":  # its kernel takes the light of its own readouts
                source, frames = _retimed(capture, sensor, readouts=readouts)
                readouts = readouts._replace(frames=frames)
            metadata = _resampled(stream, readouts, gain=readouts.mean_gain(light.lamps))
            frames = readouts.frames
            if self.camera.form == "bits" and metadata.lens_position is not None:
                light, lens = SceneLight(source, metadata.gain), LensCourse(metadata.lens_position, readouts.hz)
        metadata = replace(metadata, kind=self.sensor.kind, provenance=self._texts(stream, sensor))
        array, seed, device_seed = stream.shape[1:], capture.seed, capture.device_seed
        shape = stream.shape[0] if readouts is None else frames, *array
        camera = self.camera.start(sensor, shape=array, seed=seed, device_seed=device_seed, threads=threads)
        with write_recording(
            path,
            form=self.camera.form,
            shape=shape,
            readout_hz=readouts.hz if readouts else hz,
            metadata=metadata,
            black_level_dn=getattr(sensor, "black_level_dn", 0),
            threads=threads,
        ) as writer:
            record(light, camera, sink=writer, lens=lens, frames=frames, progress=progress)
            writer.notes = camera.notes()
        open_for = f", open for {readouts.open_s * 1e6:.4g} µs of {1e6 / readouts.hz:.4g}" if readouts else ""
        return f"{writer.size}{open_for}, sha256 {writer.content_sha256[:16]}"

    def _texts(self, stream: SpikeStream, sensor: CameraSensor) -> dict[str, str]:
        """Return the provenance of the recording of a stream by this sensor, which may have chosen its exposure."""
        texts = {name: text for name, text in stream.metadata.provenance.items() if name != BENCHMARK_KEY}
        return {
            **texts,
            SENSOR[self.camera.form]: yaml.safe_dump(sensor.as_dict(), sort_keys=False),
            SPIKES_CONTENT: stream.content_sha256,
            LIGHT_S: repr(stream.shape[0] / stream.readout_hz),
            FINGERPRINT: self.fingerprint(stream.content_sha256),
        }

    def recording(self, path: Path, content_sha256: str, *, verify: bool = False) -> tuple[int, str] | None:
        """Return frames and content_sha256 of this camera's recording of a sequence, or None if it is not there.

        ``verify`` reads all of it; a damaged recording is then not there.
        """
        return recording_of(path, self.fingerprint(content_sha256), verify=verify)

    def record_all(
        self,
        dataset: Path,
        entries: Sequence[SequenceEntry],
        *,
        target: Path,
        report: Callable[[int, int, str], None] = lambda done, total, name: None,
        tell: Callable[[str], None] = lambda line: None,
    ) -> Recaptured:
        """Record sequences of a dataset again; what is there and intact is kept.

        Parameters
        ----------
        dataset : Path
            Dataset folder with its stacks.
        entries : sequence of SequenceEntry
            The sequences.
        target : Path
            Folder to write to.
        report : callable, optional
            Called with (sequences done, their number, the next one's id).
        tell : callable, optional
            Called with a line for each sequence that is recorded.

        Raises
        ------
        BadInput
            If ``target`` is the dataset, or anything would be replaced that no such camera recorded; nothing is written
            then.
        """
        if target.resolve() == dataset.resolve():
            raise BadInput(f"--out is the dataset itself, {dataset}", allowed="another folder")
        paths = {entry.id: target / f"{stem_of(entry, where=str(dataset))}.h5" for entry in entries}
        for path in paths.values():
            check_replaceable(path)
        made, kept, failed = 0, 0, {}
        for number, entry in enumerate(entries):
            report(number, len(entries), entry.id)
            try:
                with open_stream(dataset / entry.file) as stream:
                    if self.recording(paths[entry.id], stream.content_sha256, verify=True):
                        kept += 1
                        continue
                    line = self.record(stream, dataset / STACKS, path=paths[entry.id])
            except BadInput as error:
                failed[entry.id] = error
                continue
            made += 1
            tell(f"{entry.id}: {line}")
        return Recaptured(made, kept, failed)

    def finish(self, dataset: Path, manifest: Manifest, *, target: Path) -> str:
        """Write the manifest of all that this camera has recorded in ``target``, and a link to the stacks.

        Return the command to go on with, or '' if there is nothing. Raises BadInput if the folder holds another
        dataset.
        """
        name = f"{manifest.name}_{self.name}"
        if (target / MANIFEST_NAME).exists() and (held := read_manifest(target)).name != name:
            raise BadInput(f"{target} holds the dataset {held.name!r}", allowed=name, hint="choose another --out")
        entries = []
        for entry in manifest.sequences:
            file = f"{stem_of(entry, where=str(dataset))}.h5"
            if recording := self.recording(target / file, entry.content_sha256):
                frames, content = recording
                fingerprint = self.fingerprint(entry.content_sha256)
                entries.append(
                    replace(entry, file=file, frames=frames, content_sha256=content, fingerprint=fingerprint)
                )
        if not entries:
            return ""
        made = json.dumps([manifest.recipe_fingerprint, self.describe()], sort_keys=True)
        recipe = hashlib.sha256(made.encode()).hexdigest()
        made_here = replace(manifest, name=name, recipe_fingerprint=recipe, sequences=tuple(entries))
        write_manifest(target, made_here)
        described = f"The scenes of {manifest.name} as {self.name} sees them: {plural(len(entries), 'sequence')}."
        facts = DatasetFacts(described, stated_licences(dataset), responsible=SYNTHETIC)
        write_croissant(target, made_here, facts=facts)
        stacks = target / STACKS
        if not (stacks.exists() or stacks.is_symlink()):  # for the closed loop
            stacks.symlink_to(os.path.relpath((dataset / STACKS).resolve(), target.resolve()), target_is_directory=True)
        command = read_manifest(target).next_command(target)
        return f"{command} {METHODS_OF.get(self.camera.form, '')}".rstrip()


def _light_of_target(stream: SpikeStream, source: ChargeSource) -> np.ndarray:
    """Return the charge of the target's pixels at best focus and gain 1, electrons per readout, float64 (n,)."""
    truth = stream.metadata.truth
    moment = truth.frame if isfinite(truth.frame) else 0.0
    return source.nominal_image(moment, truth.position)[np.asarray(truth.target, bool)].astype(np.float64)


def _retimed(capture: Capture, sensor: Any, *, readouts: Readouts) -> tuple[ChargeSource, int]:
    """Return the charge of a camera's own readouts, and the number of those that the stacks cover."""
    planes, frames = capture.plane_source, readouts.frames
    if planes.time_stack.is_moving:
        starts = tuple(round(spec.time_s * readouts.hz) for spec in planes.time_stack.specs)
        planes = replace(planes, time_stack=TimeResolvedStack(starts, planes.time_stack.specs))
        frames = min(frames, starts[-1])
    source = ChargeSource(planes, sensor, colour=capture.colour)
    source.scale = capture.exposure
    return source, frames


def _resampled(stream: SpikeStream, readouts: Readouts, *, gain: np.ndarray) -> Metadata:
    """Return what a stream says of each of its readouts, for those of another camera, and the gain of its light."""
    metadata, hz = stream.metadata, stream.readout_hz
    at = (np.arange(readouts.frames) / readouts.hz + readouts.middle_s) * hz - 0.5  # in readouts

    def resampled(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        return np.interp(at, np.arange(len(values)), values.astype(np.float64)).astype(values.dtype)

    truth = metadata.truth
    return replace(
        metadata,
        gain=gain,
        focus_position=resampled(metadata.focus_position),
        image_distance=resampled(metadata.image_distance),
        object_distance=resampled(metadata.object_distance),
        truth=replace(
            truth,
            frame=((truth.frame + 0.5) / hz - readouts.middle_s) * readouts.hz,
            track=resampled(truth.track),
            lens=resampled(truth.lens),
        ),
    )
