"""Cameras that record the sequences of a dataset again: event cameras and single-photon arrays.

Single photons are streams, events have a file format of their own; the folder of either becomes a dataset, whose
recordings can be judged.
"""

import hashlib
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from saf_gen.camera.events import EventSensor
from saf_gen.camera.frames import FrameSensor
from saf_gen.camera.sensor_files import read_sensor
from saf_gen.camera.spad import SpadSensor
from saf_gen.core.config.presets import change_fields
from saf_gen.core.files import refuse_link
from saf_gen.core.plain_text import plural
from saf_gen.errors import BadInput
from saf_gen.stack.event_capture import events_fingerprint, record_events
from saf_gen.stack.frame_capture import frames_fingerprint, record_frames
from saf_gen.stack.recapture import recapture_fingerprint, record_photons
from saf_gen.stream import frame_file
from saf_gen.stream.event_file import FINGERPRINT, check_replaceable, intact_digest, open_events
from saf_gen.stream.manifest import MANIFEST_NAME, Manifest, SequenceEntry, read_manifest, stem_of, write_manifest
from saf_gen.stream.sharing.croissant import SYNTHETIC, DatasetFacts, stated_licences, write_croissant
from saf_gen.stream.stream_file import SpikeStream, open_stream

RATE = 0.5
"""Share of the frames in which a single-photon array that chooses its exposure detects a photon of the target."""
SHARE = 0.5
"""Share of its well that a pixel of the target fills with a frame camera that chooses its exposure."""
OTHER_KINDS = ("photons", "frames", "events")
"""Kinds of sensors that take the place of a spike camera's."""
STACKS, CAMERAS = "stacks", "cameras"  # folders of a dataset


class OtherCamera(ABC):
    """A camera that takes the place of the spike camera of a dataset.

    Attributes
    ----------
    name : str
        Name of its sensor.
    """

    name: str

    @abstractmethod
    def check_replaceable(self, path: Path) -> None:
        """Raise BadInput if an output would replace a link, or something that such a camera did not record."""

    @abstractmethod
    def has_recorded(self, path: Path, content_sha256: str) -> bool:
        """Return whether a file is intact and this camera's recording of the sequence with this digest."""

    @abstractmethod
    def record(self, stream: SpikeStream, stacks: Path, *, path: Path) -> str:
        """Record a sequence into ``path`` and return what to say of it; raise BadInput if that cannot be."""

    @abstractmethod
    def recorded(self, path: Path, content_sha256: str) -> tuple[int, str, str] | None:
        """Return frames, content_sha256 and fingerprint of this camera's recording of a sequence, if it is there."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Return all that determines what the camera records, as plain data."""

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
            if found := self.recorded(target / file, entry.content_sha256):
                frames, content, fingerprint = found
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
        return read_manifest(target).next_command(target)


@dataclass(frozen=True)
class Recaptured:
    """What came of recording sequences again: how many were made, how many kept, and the error of each that failed."""

    made: int
    kept: int
    failed: dict[str, BadInput]


def recapture(
    dataset: Path,
    entries: Sequence[SequenceEntry],
    *,
    camera: OtherCamera,
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
    camera : OtherCamera
        The camera.
    target : Path
        Folder to write to.
    report : callable, optional
        Called with (sequences done, their number, the next one's id).
    tell : callable, optional
        Called with a line for each sequence that is recorded.

    Raises
    ------
    BadInput
        If ``target`` is the dataset, or anything would be replaced that such a camera did not record; nothing is
        written then.
    """
    if target.resolve() == dataset.resolve():
        raise BadInput(f"--out is the dataset itself, {dataset}", allowed="another folder")
    paths = {entry.id: target / f"{stem_of(entry, where=str(dataset))}.h5" for entry in entries}
    for path in paths.values():
        camera.check_replaceable(path)
    made, kept, failed = 0, 0, {}
    for number, entry in enumerate(entries):
        report(number, len(entries), entry.id)
        try:
            with open_stream(dataset / entry.file) as stream:
                if camera.has_recorded(paths[entry.id], stream.content_sha256):
                    kept += 1
                    continue
                said = camera.record(stream, dataset / STACKS, path=paths[entry.id])
        except BadInput as error:
            failed[entry.id] = error
            continue
        made += 1
        tell(f"{entry.id}: {said}")
    return Recaptured(made, kept, failed)


class _Events(OtherCamera):
    def __init__(self, sensor: EventSensor) -> None:
        self.name, self._sensor = sensor.name, sensor

    def check_replaceable(self, path: Path) -> None:
        check_replaceable(path)

    def has_recorded(self, path: Path, content_sha256: str) -> bool:
        return intact_digest(path, events_fingerprint(content_sha256, self._sensor)) is not None

    def record(self, stream: SpikeStream, stacks: Path, *, path: Path) -> str:
        count, digest = record_events(stream, stacks, sensor=self._sensor, path=path)
        return f"{count:,} events, sha256 {digest[:16]}"

    def recorded(self, path: Path, content_sha256: str) -> tuple[int, str, str] | None:
        wanted = events_fingerprint(content_sha256, self._sensor)
        try:
            with open_events(path) as events:
                if events.metadata.provenance.get(FINGERPRINT) != wanted:
                    return None
                return events.shape[0], events.content_sha256, wanted
        except BadInput:
            return None

    def describe(self) -> dict[str, Any]:
        return {"sensor": asdict(self._sensor)}


class _Photons(OtherCamera):
    def __init__(self, sensor: SpadSensor, *, rate: float | None) -> None:
        self.name, self._sensor, self._rate = sensor.name, sensor, rate

    def check_replaceable(self, path: Path) -> None:
        refuse_link(path)
        if path.exists():
            with open_stream(path) as stream:
                if "spikes_content" not in stream.metadata.provenance:
                    raise BadInput(
                        "saf-gen recapture did not record it", where=str(path), hint="choose another --out, or move it"
                    )

    def has_recorded(self, path: Path, content_sha256: str) -> bool:
        return self._digest(path, content_sha256, verify=True) is not None

    def _digest(self, path: Path, content_sha256: str, *, verify: bool) -> tuple[int, str] | None:
        """Return the frames and the digest of this camera's recording of a sequence, or None if it is not there."""
        wanted = recapture_fingerprint(content_sha256, self._sensor, rate=self._rate)
        try:
            with open_stream(path) as stream:
                if stream.metadata.provenance.get("fingerprint") != wanted:
                    return None
                if verify:
                    stream.verify()
                return stream.shape[0], stream.content_sha256
        except BadInput:
            return None

    def record(self, stream: SpikeStream, stacks: Path, *, path: Path) -> str:
        frames, digest, exposed = record_photons(stream, stacks, sensor=self._sensor, rate=self._rate, path=path)
        exposure = f"{exposed.exposure_s * 1e6:.4g} µs of {1e6 / exposed.readout_hz:.4g}"
        return f"{frames:,} frames, open for {exposure}, sha256 {digest[:16]}"

    def recorded(self, path: Path, content_sha256: str) -> tuple[int, str, str] | None:
        found = self._digest(path, content_sha256, verify=False)
        return found and (*found, recapture_fingerprint(content_sha256, self._sensor, rate=self._rate))

    def describe(self) -> dict[str, Any]:
        return {"sensor": self._sensor.as_dict(), "rate": self._rate}


class _Frames(OtherCamera):
    def __init__(self, sensor: FrameSensor, *, share: float | None) -> None:
        self.name, self._sensor, self._share = sensor.name, sensor, share

    def check_replaceable(self, path: Path) -> None:
        frame_file.check_replaceable(path)

    def has_recorded(self, path: Path, content_sha256: str) -> bool:
        try:
            with frame_file.open_frames(path) as frames:
                frames.verify()
        except BadInput:
            return False
        return self.recorded(path, content_sha256) is not None

    def record(self, stream: SpikeStream, stacks: Path, *, path: Path) -> str:
        frames, digest, exposed = record_frames(stream, stacks, sensor=self._sensor, share=self._share, path=path)
        exposure = f"{exposed.exposure_s * 1e6:.4g} µs of {1e6 / exposed.readout_hz:.4g}"
        return f"{frames:,} frames, exposed for {exposure}, sha256 {digest[:16]}"

    def recorded(self, path: Path, content_sha256: str) -> tuple[int, str, str] | None:
        wanted = frames_fingerprint(content_sha256, self._sensor, share=self._share)
        try:
            with frame_file.open_frames(path) as frames:
                if frames.metadata.provenance.get(frame_file.FINGERPRINT) != wanted:
                    return None
                return frames.shape[0], frames.content_sha256, wanted
        except BadInput:
            return None

    def describe(self) -> dict[str, Any]:
        return {"sensor": self._sensor.as_dict(), "share": self._share}

    def finish(self, dataset: Path, manifest: Manifest, *, target: Path) -> str:
        command = super().finish(dataset, manifest, target=target)
        return command and f"{command} {frame_file.METHOD}"


def find_camera(name: str, *, exposure_us: float | None = None) -> OtherCamera:
    """Return the camera of this name, or of a user's file.

    Parameters
    ----------
    name : str
        Name of a sensor of :data:`OTHER_KINDS`, or path of its .yaml file.
    exposure_us : float, optional
        Exposure of a single-photon array or a frame camera, microseconds; by default it chooses one for each sequence.

    Raises
    ------
    BadInput
        If there is no such sensor, its file is not valid, it is that of a spike camera, or it has no such exposure.
    """
    sensor = read_sensor(name, kinds=OTHER_KINDS)
    if exposure_us is not None:
        if isinstance(sensor, EventSensor):
            raise BadInput(
                f"--exposure-us is given for {name}", allowed="a single-photon array or a frame camera",
                hint="leave it out",
            )  # fmt: skip
        sensor = change_fields(sensor, {"exposure_s": exposure_us * 1e-6}, where=f"sensor {name}")
    if isinstance(sensor, EventSensor):
        return _Events(sensor)
    if isinstance(sensor, SpadSensor):
        return _Photons(sensor, rate=RATE if exposure_us is None else None)
    return _Frames(sensor, share=SHARE if exposure_us is None else None)
