"""The blur of every pixel of a recording in closed form: the circle of confusion of a thin lens, with its sign.

A lens of aperture diameter A and image distance v images a surface at the distance u' at v' = 1/(1/f - 1/u'). On the
sensor, a point of it is a disc of the diameter A·|v - v'|/v', which is |v·A·(1/u - 1/u')| for the distance u in focus.
The sign is that of v - v': positive where the surface lies behind the plane in focus, negative in front of it.

Aperture, focal length and pixel pitch are in the text ``/provenance/lens``. In files of before that text, the scene's
card states the lens; it is used if it agrees with the distances and the depth of focus in the file.
"""

import json
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from saf_gen.core.config.json_document import load_plain_json
from saf_gen.core.region import Region, validate_window
from saf_gen.errors import BadInput
from saf_gen.optics import Drive, drive_from_dict
from saf_gen.stream.metadata import ReadableStream, sensor_kind

PROVENANCE_KEY = "lens"
_UNREADABLE = (ValueError, KeyError, TypeError, AttributeError, OverflowError, ZeroDivisionError, BadInput)
_AGREEMENT = 1e-6
"""Largest relative difference between numbers in a file, most of them float32, and those of a card's lens."""


def lens_to_text(drive: Drive, *, pitch_m: float) -> str:
    """Return the text of ``/provenance/lens`` (JSON): the pitch of the pixels in metres, and the drive of the lens."""
    return json.dumps({"pitch_m": pitch_m, "drive": drive.as_dict()})


@dataclass(frozen=True, eq=False)
class DefocusBlur:
    """The blur of the pixels of a recording, at any of its frames.

    Attributes
    ----------
    drive : Drive
        Lens with its focus drive.
    pitch_m : float
        Pitch of the pixels, in metres.
    depth : ndarray of float64, shape (h, w)
        Depth of the pixels, in metres.
    position : ndarray of float32, shape (T,)
        Position of the lens in the middle of each readout, as a fraction of the travel.
    """

    drive: Drive
    pitch_m: float
    depth: np.ndarray
    position: np.ndarray

    @classmethod
    def of_stream(cls, stream: ReadableStream, *, region: Region | None = None) -> "DefocusBlur":
        """Return the blur of the pixels of a region, by default of the whole frame.

        Raises BadInput if the stream lacks depth, lens positions or its lens, or if its scene moves.
        """
        depth, where = known_depth(stream), str(stream.path)
        position = stream.metadata.lens_position
        if position is None:
            raise BadInput("does not state the positions of its lens", where=where, allowed="streams that do")
        drive, pitch_m = _find_lens(stream)
        part = depth if region is None else depth[region]
        return cls(drive, pitch_m, part.astype(np.float64), position)

    def at(self, frame: int) -> np.ndarray:
        """Return the signed diameter of the blur in pixels at a frame, float32 (h, w).

        It is positive behind the plane in focus, and -inf at the lens and behind it.
        """
        position = float(self.position[frame])
        lens, shift = self.drive, float(self.drive.shift(position))
        width_px = 2 * lens.aperture_radius_m * float(lens.image_distance(position)) / self.pitch_m
        vergence = _vergence(self.depth - shift) if shift else self._vergence_on_the_card
        return (width_px * (1 / float(lens.object_distance(position)) - vergence)).astype(np.float32)

    @cached_property
    def _vergence_on_the_card(self) -> np.ndarray:
        """1/u' of each pixel (1/m) from a lens where the card places it, which only a stage leaves."""
        return _vergence(self.depth)


def _vergence(distance: np.ndarray) -> np.ndarray:
    """Return 1/u' for distances from the lens; infinite at the lens and behind it."""
    out = np.full(distance.shape, np.inf)
    return np.divide(1.0, distance, out=out, where=distance > 0)


def check_frame(stream: ReadableStream, frame: int) -> None:
    """Raise BadInput if a frame is no whole number, or outside the recording."""
    try:
        validate_window(frame, frame + 1, total=stream.shape[0])
    except (BadInput, TypeError):
        raise BadInput(
            f"frame {frame!r} was asked for",
            where=str(stream.path),
            allowed=f"a whole number, 0 to {stream.shape[0] - 1}",
        ) from None


def blur_at(stream: ReadableStream, frame: int) -> np.ndarray:
    """Return the blur of a stream at a frame; see :meth:`saf_gen.stream.stream_file.SpikeStream.blur`."""
    check_frame(stream, frame)
    return DefocusBlur.of_stream(stream).at(frame)


def known_depth(stream: ReadableStream) -> np.ndarray:
    """Return the depth map that holds in every frame, float32 (H, W), in metres.

    Raises BadInput if the stream has none, or if its scene moves, so that it holds at one moment only.
    """
    depth, where = stream.truth.depth, str(stream.path)
    if depth is None or np.isnan(depth).all():
        raise BadInput("does not state the depth of its scene", where=where, allowed="streams of rendered scenes")
    if _scene_moves(stream):
        raise BadInput(
            "its scene moves, and its depth is that of one moment",
            where=where,
            allowed="streams of scenes at rest",
            hint="stream.truth.depth is the depth at stream.truth.frame",
        )
    return depth


def _scene_moves(stream: ReadableStream) -> bool:
    try:
        return bool(load_plain_json(stream.metadata.provenance["sequence"])["scene_motion"] == "dynamic")
    except (KeyError, TypeError, ValueError):  # not written by saf-gen generate
        return stream.truth.track is not None


def _find_lens(stream: ReadableStream) -> tuple[Drive, float]:
    """Return the drive of the lens and the pixel pitch in metres; raise BadInput if the file does not state them."""
    provenance, where = stream.metadata.provenance, str(stream.path)
    if PROVENANCE_KEY in provenance:
        try:
            text = load_plain_json(provenance[PROVENANCE_KEY])
            drive, pitch_m = drive_from_dict(text["drive"]), float(text["pitch_m"])
            numbers = (pitch_m, float(drive.aperture_radius_m), float(drive.image_distance(0.5)))
            if not all(math.isfinite(number) and number > 0 for number in numbers):
                raise ValueError(numbers)
        except _UNREADABLE as error:
            raise BadInput(
                f"its /provenance/{PROVENANCE_KEY} is {provenance[PROVENANCE_KEY][:80]!r}",
                where=where,
                allowed="pitch_m and drive, as saf-gen generate writes them",
            ) from error
        return drive, pitch_m
    try:
        drive, pitch_m, wavelengths_m = _lens_of_card(stream)
        agrees = _agrees(stream, drive, pitch_m=pitch_m, wavelengths_m=wavelengths_m)
    except _UNREADABLE:
        agrees = False
    if not agrees:
        raise BadInput(
            "does not state the aperture of its lens",
            where=where,
            allowed=f"streams with /provenance/{PROVENANCE_KEY}",
            hint="generate it again, which keeps its spikes",
        )
    return drive, pitch_m


def _lens_of_card(stream: ReadableStream) -> tuple[Drive, float, tuple[float, float]]:
    """Return the drive that the scene's card states today, the pixel pitch, and wavelengths that may have been drawn.

    Raises an error of ``_UNREADABLE`` if the file does not state its scene or sensor, or there is no such scene.
    """
    from saf_gen.camera import parse_sensor  # these take a second to load, and newer streams need none of them
    from saf_gen.core.config.yaml_document import parse_yaml
    from saf_gen.scene.scene_folder import find_scene

    provenance = stream.metadata.provenance
    sequence = load_plain_json(provenance["sequence"])
    recipe = parse_yaml(provenance["recipe"], f"{stream.path} /provenance/recipe").data
    sensor = parse_sensor(provenance["sensor"], f"{stream.path} /provenance/sensor", kind=sensor_kind(stream))
    scene = find_scene(str(sequence["scene"])).with_params(dict(sequence["params"]))
    drive = scene.build_drive(recipe["camera"]["exposure"]["f_number"])
    return drive, sensor.pitch_m, (0.0, sensor.wavelength_m)


def _agrees(stream: ReadableStream, drive: Drive, *, pitch_m: float, wavelengths_m: tuple[float, float]) -> bool:
    """Return whether the distances and the depth of focus in a file are those of this lens.

    The depth of focus tells its aperture. Of a lens with aberrations it does not follow from the aperture alone, so
    that the aperture of such a lens cannot be checked.
    """
    metadata, truth = stream.metadata, stream.truth
    if metadata.focus_position is None or truth.in_focus is not None:
        return False
    log = np.clip(metadata.focus_position.astype(np.float64), 0.0, 1.0)
    stored: list[tuple[Any, Any]] = [
        (metadata.image_distance, drive.image_distance(log)),
        (metadata.object_distance, drive.object_distance(log)),
    ]
    if any(one is None or not np.allclose(one, other, rtol=_AGREEMENT, atol=0) for one, other in stored):
        return False
    depths = [drive.depth_of_focus(truth.position, pitch_m, wavelength_m=length) for length in wavelengths_m]
    return any(np.allclose(sorted(truth.depth_of_focus), depth, rtol=_AGREEMENT, atol=0) for depth in depths)
