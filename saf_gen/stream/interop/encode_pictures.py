"""Encoding of pictures of other cameras as spikes; the light changes linearly from one picture to the next."""

import os
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from json import dumps
from math import ceil, floor, prod
from typing import Any

import numpy as np

from saf_gen.camera import Encoder, Sensor, exposure_scale
from saf_gen.core.files import name_as_text
from saf_gen.errors import BadInput
from saf_gen.stream.interop.linear_light import PictureFrames
from saf_gen.stream.metadata import metadata_from_options
from saf_gen.stream.stream_writer import StreamWriter

BLOCK_FRAMES, BLOCK_KNOTS, BLOCK_BYTES = 2_000, 64, 256 << 20
"""Largest numbers of readouts, pictures, and bytes of pictures in memory at a time."""
SLOW_READOUTS = 10
"""Readouts per picture from which a camera counts as slow: motion then looks like a fade."""


@dataclass(frozen=True)
class PictureEncoding:
    """A plan for encoding pictures as spikes.

    The pictures are read once to make this object and once more to write the spikes.

    Attributes
    ----------
    pictures : PictureFrames
        The pictures as linear light.
    sensor : Sensor
        The sensor that records them.
    count : int
        Number of pictures.
    rate_hz : float
        Pictures per second.
    frames : int
        Number of readouts: those that were requested, or all from the first picture to the last.
    scale : float
        Electrons per readout for linear light 1.
    mean_rate : float
        Spikes per pixel and readout of the mean picture.
    """

    pictures: PictureFrames
    sensor: Sensor
    count: int
    rate_hz: float
    frames: int
    scale: float
    mean_rate: float

    @property
    def readouts_per_picture(self) -> float:
        """Readouts between two pictures."""
        return self.sensor.readout_hz / self.rate_hz

    @property
    def focus_position(self) -> np.ndarray | None:
        """Position of the lens in the middle of each readout, float32 (frames,), if the pictures state it.

        Raises BadInput if they state positions that turn back.
        """
        if self.pictures.positions is None:
            return None
        at = (np.arange(self.frames) + 0.5) / self.readouts_per_picture
        return np.interp(at, np.arange(self.count), self.pictures.positions.travel).astype(np.float32)

    @property
    def integrates(self) -> bool:
        """Whether readouts collect an integral, because the middle of a readout does not stand for all of it."""
        pace = self.readouts_per_picture
        return self.count > 1 and pace < SLOW_READOUTS and not float(pace).is_integer()


def prepare_pictures(
    pictures: PictureFrames,
    sensor: Sensor,
    *,
    rate_hz: float | None = None,
    mean_rate: float = 0.2,
    frames: int | None = None,
) -> PictureEncoding:
    """Return a plan for encoding pictures as spikes.

    Parameters
    ----------
    pictures : PictureFrames
        The pictures as linear light; their size becomes that of the sensor array.
    sensor : Sensor
        The sensor, whose own size is ignored.
    rate_hz : float, optional
        Pictures per second; by default as the source states.
    mean_rate : float, default 0.2
        Spikes per pixel and readout of the mean picture. Light in pictures has no unit; this sets one factor for all
        pictures.
    frames : int, optional
        Number of readouts; by default, and at most, those up to the last picture. Required for a single picture.

    Returns
    -------
    PictureEncoding
        The plan that :func:`encode_pictures` carries out.

    Raises
    ------
    BadInput
        If neither the caller nor the source states a rate, if there are too many frames, if all pictures are black, or
        if the sensor cannot reach the mean rate.
    """
    stated = pictures.rate_hz if rate_hz is None else rate_hz
    rate = None if stated is None else float(stated)
    total, count = np.zeros(pictures.shape, np.float64), 0
    for light in pictures:
        total += light
        count += 1
    where = str(pictures.path)
    if count == 1:
        if frames is None:
            raise BadInput("is a single picture", where=where, hint="state the number of readouts with --frames N")
        rate = sensor.readout_hz if rate is None else rate
    if rate is None:
        raise BadInput("does not state how many pictures it has per second", where=where, hint="add --rate HZ")
    if not 0 < rate < np.inf:
        raise BadInput(f"{rate:g} pictures per second", where=where, allowed="above 0")
    max_frames = floor((count - 1) / rate * sensor.readout_hz) if count > 1 else None
    if max_frames is not None and (max_frames < 1 or (frames is not None and frames > max_frames)):
        raise BadInput(
            f"{frames or 1} readouts were requested of {count} pictures at {rate:g} Hz", where=where,
            allowed=f"1 to {max_frames}" if max_frames else f"pictures that last a readout, 1/{sensor.readout_hz:g} s",
        )  # fmt: skip
    length = frames if frames is not None else max_frames
    mean = total / count
    if not mean.max() > 0:
        raise BadInput("all pictures are black", where=where, allowed="pictures with light")
    everywhere = np.ones(pictures.shape, bool)
    scale = exposure_scale(mean, everywhere, sensor=sensor, mean_rate=mean_rate)
    return PictureEncoding(pictures, sensor, count, rate, int(length or 1), scale, mean_rate)


def encode_pictures(plan: PictureEncoding, out: str | os.PathLike[str], *, seed: int = 0, **optional: Any) -> str:
    """Write the spikes of pictures as the stream file ``out`` and return its ``content_sha256``.

    Picture k is the light at the time k/rate_hz, and between two pictures the light changes linearly. Each readout
    collects the light of its middle; if there are fewer than SLOW_READOUTS readouts per picture, and not a whole
    number, it collects the exact integral, so that no light falls between two readouts. The use of memory does not grow
    with the number of pictures. ``optional`` are fields of :class:`Metadata` other than the provenance; by default, the
    position of the lens is what the pictures state.

    Raises BadInput if a picture differs in size from the first, has values that are not allowed, or is missing.
    """
    settings = {
        "pictures": name_as_text(plan.pictures.path.name), "count": plan.count, "rate_hz": plan.rate_hz,
        "values": "linear" if plan.pictures.linear else "sRGB, decoded", "between": "linear cross-fade",
        "sensor": plan.sensor.name, "mean_rate": plan.mean_rate, "scale": plan.scale, "seed": seed,
    }  # fmt: skip
    if (stated := plan.pictures.positions) is not None:
        settings["focus"] = {"source": stated.source, "unit": stated.unit, "z": stated.z.tolist()}
        if optional.get("focus_position") is None:
            optional["focus_position"] = plan.focus_position
    metadata = metadata_from_options({**optional, "provenance": {"encode": dumps(settings, ensure_ascii=False)}})
    encoder = Encoder(plan.sensor, plan.pictures.shape, seed=seed)
    shape, readout_hz = (plan.frames, *plan.pictures.shape), plan.sensor.readout_hz
    with StreamWriter(out, shape=shape, readout_hz=readout_hz, metadata=metadata) as writer:
        for knots, index, fraction in _integrated(plan) if plan.integrates else _blocks(plan):
            stack = (np.stack(knots)[None] * np.float32(plan.scale)).astype(np.float32, copy=False)
            gain = np.ones((len(index), 1), np.float32)
            writer.write(encoder.encode(stack, index=index, fraction=fraction, gain=gain))
    return writer.content_sha256


def _blocks(plan: PictureEncoding) -> Iterator[tuple[list[np.ndarray], np.ndarray, np.ndarray]]:
    """Yield the pictures for each block of readouts, and the position of each readout among them.

    The position is the index of the picture before the readout and the fraction, 0 to 1, of the time to the next.
    """
    knots = max(min(BLOCK_KNOTS, BLOCK_BYTES // (4 * prod(plan.pictures.shape))), 2)
    step = int(min(BLOCK_FRAMES, max(knots * plan.readouts_per_picture, 8))) // 8 * 8
    held: deque[tuple[int, np.ndarray]] = deque()
    source = enumerate(plan.pictures)
    for begin in range(0, plan.frames, step):
        at = (np.arange(begin, min(begin + step, plan.frames)) + 0.5) / plan.readouts_per_picture
        at = np.clip(at, 0, plan.count - 1)
        first = np.minimum(at.astype(np.int64), max(plan.count - 2, 0))
        last = min(int(first[-1]) + 1, plan.count - 1)
        while held and held[0][0] < first[0]:
            held.popleft()
        while not held or held[-1][0] < last:
            number, light = next(source, (plan.count, None))
            if light is None:
                raise BadInput("has fewer pictures than before", where=str(plan.pictures.path), hint="encode it again")
            if number >= first[0]:
                held.append((number, light))
        yield [light for _, light in held], first - held[0][0], at - first


def _integrated(plan: PictureEncoding) -> Iterator[tuple[list[np.ndarray], np.ndarray, np.ndarray]]:
    """Yield the mean light of each readout of a block, exact for light that is linear between pictures.

    A picture contributes a triangle of light, from the time of the picture before it to that of the one after it.
    """
    pace = plan.rate_hz / plan.sensor.readout_hz  # pictures per readout
    step = max(min(BLOCK_KNOTS, BLOCK_BYTES // (8 * prod(plan.pictures.shape))) // 8 * 8, 8)
    source = enumerate(plan.pictures)
    held: dict[int, np.ndarray] = {}
    for begin in range(0, plan.frames, step):
        start = np.arange(begin, min(begin + step, plan.frames)) * pace
        light = np.zeros((len(start), *plan.pictures.shape), np.float32)
        first, last = floor(start[0]), min(ceil(start[-1] + pace), plan.count - 1)
        held = {number: picture for number, picture in held.items() if number >= first}
        for number in range(first, last + 1):
            while number not in held:
                found, picture = next(source, (plan.count, None))
                if picture is None:
                    raise BadInput(
                        "has fewer pictures than before", where=str(plan.pictures.path), hint="encode it again"
                    )
                held[found] = picture
            weight = (_triangle_area(start + pace - number) - _triangle_area(start - number)) / pace
            for readout in np.flatnonzero(weight):
                light[readout] += np.float32(weight[readout]) * held[number]
            if number < last - 1:
                del held[number]
        yield list(light), np.arange(len(light)), np.zeros(len(light))


def _triangle_area(x: np.ndarray) -> np.ndarray:
    """Return the area of a triangle from -1 to 1, of height 1 at 0, to the left of ``x``."""
    x = np.clip(x, -1, 1)
    return np.asarray(0.5 + x - np.sign(x) * x**2 / 2)
