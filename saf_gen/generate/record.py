"""Recording of sequences; fingerprints of finished recordings on disk, and whether one is undamaged."""

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from saf_gen.camera import Encoder, Sensor, draw_fixed_pattern, exposure_scale
from saf_gen.camera.camera import LensCourse
from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.region import bounding_box
from saf_gen.errors import BadInput
from saf_gen.generate.draw import PlannedSequence
from saf_gen.plugins.lights import group_gains
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.colour import Blends, Colour
from saf_gen.stack.focal_stack import PICTURES
from saf_gen.stack.light import SceneLight, record
from saf_gen.stack.noise_free import find_optima, noise_free_sharpness
from saf_gen.stack.picture_stack import describe_picture_truth, find_picture_truth
from saf_gen.stack.time_resolved import PlaneSource, grain_along
from saf_gen.stack.true_focus import find_inside, find_true_focus
from saf_gen.stream.defocus_blur import PROVENANCE_KEY as LENS_KEY
from saf_gen.stream.defocus_blur import lens_to_text
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.optima import PROVENANCE_KEYS, optima_to_text
from saf_gen.stream.recorded_grain import PROVENANCE_KEY as GRAIN_KEY
from saf_gen.stream.stream_file import SpikeStream, open_stream
from saf_gen.stream.stream_writer import StreamWriter


def fingerprint_generated_recording(planned: str, truth: Truth, *, mean_rate: float | None) -> str:
    """Return the fingerprint that a recording stores, from the fingerprint of its plan.

    It is that of the plan, except for a moving scene with a mean rate whose lens never meets the focus. The first files
    of such sequences have light for a picture in which the target was elsewhere, so they must be made again. Whether
    the lens meets the focus is known only once the scene is rendered; a higher MODEL would condemn all other files too.

    Parameters
    ----------
    planned : str
        Fingerprint of the plan.
    truth : Truth
        True focus of the recording.
    mean_rate : float or None
        Spikes per readout for which the light was scaled; None for the absolute exposure.
    """
    if truth.track is None or math.isfinite(truth.frame) or mean_rate is None:
        return planned
    return fingerprint_generated_out_of_focus(planned)


def fingerprint_generated_out_of_focus(planned: str) -> str:
    """Return the fingerprint of a recording with a mean rate of a moving scene that is never in focus."""
    return hashlib.sha256(f"{planned} with light for the picture of the target mask".encode()).hexdigest()


def has_generated_fingerprint(stream: SpikeStream, planned: str) -> bool:
    """Return whether a stream has the fingerprint that a recording of this plan stores."""
    provenance = stream.metadata.provenance
    stored = provenance.get("fingerprint")
    if stored != planned:
        return stored == fingerprint_generated_out_of_focus(planned)
    try:
        mean_rate = load_plain_json(provenance["sequence"])["mean_rate"]
    except (KeyError, TypeError, ValueError):  # not written by this package
        return False
    return stored == fingerprint_generated_recording(planned, stream.truth, mean_rate=mean_rate)


def has_recording(path: Path, planned: str) -> bool:
    """Return whether ``path`` is a recording of the plan with this fingerprint; its spikes are not read."""
    return _stored_digest(path, planned, verify=False) is not None


def recording_digest(path: Path, planned: str) -> str | None:
    """Return the content_sha256 of a recording, or None if it is of another plan, missing or damaged.

    All spikes are read.
    """
    return _stored_digest(path, planned, verify=True)


def _stored_digest(path: Path, planned: str, *, verify: bool) -> str | None:
    if not path.is_file():
        return None
    try:
        with open_stream(path) as stream:
            if not has_generated_fingerprint(stream, planned):
                return None
            if verify:
                stream.verify()
            return stream.content_sha256
    except BadInput:
        return None


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
        position, log = sequence.lens_course(self.frames, readout_hz=hz)
        gain = group_gains(sequence.schedule, spec.groups, frames=self.frames, readout_hz=hz)
        colour = Colour.find(sequence.schedule, spec.groups, sensor=self.sensor, axial_colour=sequence.axial_colour)
        charge_source = ChargeSource(plane_source, self.sensor, colour=colour)
        blends = None if colour is None else _find_blends(colour, charge_source, plane_source=plane_source, gain=gain)
        photographed = spec.estimator == PICTURES
        if photographed:
            (truth, peaks), moment = find_picture_truth(plane_source, position), 0.0
        else:
            truth, moment = find_true_focus(plane_source, position, blends=blends)
        self._scale_light(charge_source, sequence.mean_rate, truth=truth, moment=moment)
        of_groups = gain if colour is None else colour.group_gains(gain)
        grain = grain_along(plane_source, truth, position=position, gain=of_groups)
        inside = find_inside(plane_source, truth, position=position)
        boxes = {"target": bounding_box(np.asarray(truth.target))} | ({} if inside is None else {"inside": inside})
        curves = dict(
            zip(boxes, noise_free_sharpness(charge_source, list(boxes.values()), position=position), strict=True)
        )
        truth = replace(truth, sharpness=curves["target"])
        if inside is not None:
            rows, columns = inside
            stated = (rows.start, rows.stop, columns.start, columns.stop)
            truth = replace(truth, inside=stated, sharpness_inside=curves["inside"])
        if photographed:  # the peaks by which its focus is known are of the box
            optima = {"target": peaks}
        else:
            optima = {
                region: find_optima(charge_source, truth, box=box, sharpness=curves[region], position=position)
                for region, box in boxes.items()
            }
        in_travel = np.clip(log, 0.0, 1.0)  # a reading may be a little outside
        metadata = Metadata(
            focus_position=log.astype(np.float32),
            image_distance=None if photographed else spec.drive.image_distance(in_travel).astype(np.float32),
            object_distance=None if photographed else spec.drive.object_distance(in_travel).astype(np.float32),
            gain=gain,
            light_names=spec.groups if colour is None else colour.names,
            truth=truth if sequence.actuator is None else replace(truth, lens=position.astype(np.float32)),
            provenance={
                **self.provenance,
                "fingerprint": fingerprint_generated_recording(fingerprint, truth, mean_rate=sequence.mean_rate),
                "sequence": json.dumps(sequence.as_dict(), indent=1),
                "exposure": json.dumps({"scale": charge_source.scale, "device_seed": self.device_seed}),
                "stack": "\n".join(spec.key for spec in time_stack.specs),
                "stack_digest": plane_source.digest,
                "variant": plane_source.backend,
                **({} if photographed else {LENS_KEY: lens_to_text(spec.drive, pitch_m=spec.pitch_m)}),
                **({} if grain is None else {GRAIN_KEY: grain.to_text()}),
                **({"photographed": describe_picture_truth(spec, peaks)} if photographed else {}),
                **{PROVENANCE_KEYS[region]: optima_to_text(found) for region, found in optima.items() if found},
            },
        )
        shape = (self.sensor.rows, self.sensor.columns)
        camera = Encoder(self.sensor, shape, seed=sequence.seed, device_seed=self.device_seed, threads=threads)
        light, lens = SceneLight(charge_source, gain), LensCourse(position, hz)
        with StreamWriter(
            path, shape=(self.frames, *shape), readout_hz=hz, metadata=metadata, threads=threads
        ) as writer:
            record(light, camera, sink=writer, lens=lens, frames=self.frames, progress=progress)
        return writer.content_sha256

    def _scale_light(
        self, charge_source: ChargeSource, mean_rate: float | None, *, truth: Truth, moment: float
    ) -> None:
        """Scale the light so that the target fires at ``mean_rate`` at best focus, in the picture at ``moment``."""
        if mean_rate is None:
            return
        # Use the response and threshold of the target's pixels, whose mean differs from that of the whole array.
        target = np.asarray(truth.target)
        device = draw_fixed_pattern(self.sensor, target.shape, seed=self.device_seed)
        sensitivity = device.response * (self.sensor.threshold_e / device.threshold)
        at_best = sensitivity * charge_source.nominal_image(moment, truth.position)
        charge_source.scale = exposure_scale(at_best, target, sensor=self.sensor, mean_rate=mean_rate)


def _find_blends(colour: Colour, charge_source: ChargeSource, *, plane_source: PlaneSource, gain: np.ndarray) -> Blends:
    """Return the mixes of light on the target, which counts as lit as it is in the first picture that sees it."""
    time_stack = plane_source.time_stack
    charge = np.ones(len(colour.lamps))
    for j, (begin, spec) in enumerate(zip(time_stack.slice_frames, time_stack.specs, strict=True)):
        _, target = plane_source.load_geometry(j)
        if target.any():
            middle = float(np.mean(spec.focus))
            charge = charge_source.charge_image(begin - 0.5, middle)[:, target].mean(axis=1, dtype=np.float64)
            break
    return colour.blends(time_stack.specs[0], gain=gain, charge=charge)
