"""Encoding of pictures of other cameras as spikes; the light changes linearly from one picture to the next."""

import os
import re
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, repeat
from json import dumps
from math import floor, prod
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
    rate_hz : Fraction or None
        Pictures per second; None if the pictures have their own times, which are not steady.
    frames : int
        Number of readouts: those that were requested, or all from the first picture to the last.
    scale : float
        Electrons per readout for linear light 1.
    mean_rate : float
        Spikes per pixel and readout of the mean picture.
    notes : tuple of str
        What was assumed or left out, a line each.
    """

    pictures: PictureFrames
    sensor: Sensor
    count: int
    rate_hz: Fraction | None
    frames: int
    scale: float
    mean_rate: float
    notes: tuple[str, ...] = ()

    @property
    def readouts_per_picture(self) -> float:
        """Readouts between two pictures, on average."""
        if self.rate_hz is None:
            return float(_last_time(self.pictures) * Fraction(self.sensor.readout_hz) / (self.count - 1))
        return self.sensor.readout_hz / float(self.rate_hz)

    @property
    def samples(self) -> bool:
        """Whether the light in the middle of each readout stands for all of it.

        That is exact if every picture falls between two readouts, and is done as well for slow pictures at a whole
        number per second, where only the readouts that contain a picture differ.
        """
        if self.count == 1 or self.rate_hz is None:
            return self.count == 1
        pace = Fraction(self.sensor.readout_hz) / self.rate_hz
        return pace.denominator == 1 or (self.rate_hz.denominator == 1 and pace >= SLOW_READOUTS)

    @property
    def focus_position(self) -> np.ndarray | None:
        """Position of the lens in the middle of each readout, float32 (frames,), if the pictures state it.

        Raises BadInput if they state positions that turn back.
        """
        if self.pictures.positions is None:
            return None
        middle = np.arange(self.frames) + 0.5
        return np.interp(middle, _times_in_readouts(self), self.pictures.positions.travel).astype(np.float32)

    @property
    def pace(self) -> str:
        """The times of the pictures in words, such as "at 24000/1001 Hz (23.976)"."""
        return describe_pace(self.pictures.times, self.rate_hz)


def rate_from_text(text: str) -> Fraction:
    """Return a rate in Hz, above 0, that is written as 240, 23.976, 1e3 or 24000/1001, without rounding it.

    Raises BadInput for any other text.
    """
    written = re.fullmatch(r"((\d+(\.\d*)?|\.\d+)(e[+-]?\d{1,2})?)(/\d*[1-9]\d*)?", text, re.IGNORECASE)
    rate = Fraction(written[1]) / Fraction((written[5] or "/1")[1:]) if written else Fraction(0)
    if not rate:
        raise BadInput(f"--rate is {text}", allowed="a number above 0, such as 240, 23.976 or 24000/1001")
    return rate


def describe_pace(times: tuple[Fraction | None, ...] | None, rate_hz: Fraction | None) -> str:
    """Return the times of pictures in words: their rate as it was stated, or the range of their distances."""
    if rate_hz is not None:
        exact, about = str(rate_hz), f"{float(rate_hz):.12g}"
        if Fraction(about) == rate_hz:
            return f"at {about} Hz"
        return f"at {exact} Hz" + (f" ({float(rate_hz):.5g})" if rate_hz.numerator > 1 else "")
    known = [time for time in times or () if time is not None]
    steps = [1000 * float(after - before) for before, after in pairwise(known)]
    return f"at times {min(steps):.4g} to {max(steps):.4g} ms apart" if steps else "at unknown times"


def prepare_pictures(
    pictures: PictureFrames,
    sensor: Sensor,
    *,
    rate_hz: Fraction | float | None = None,
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
    rate_hz : Fraction or float, optional
        Pictures per second; by default as the source states, or at the times that it states for each picture.
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
        If neither the caller nor the source states how values stand for light, or a rate, if times do not increase, if
        there are too many frames, if all pictures are black, or if the sensor cannot reach the mean rate.
    """
    where, notes = str(pictures.path), pictures.notes
    pictures.check_stated()
    if rate_hz is not None and not 0 < rate_hz < np.inf:
        raise BadInput(f"{rate_hz:g} pictures per second", where=where, allowed="above 0")
    rate = pictures.rate_hz if rate_hz is None else Fraction(str(rate_hz))
    own_times = rate is None and pictures.times is not None and len(pictures.times) > 1
    shares = iter(_time_shares(pictures)) if own_times else repeat(1.0)
    total, count, all_shares = np.zeros(pictures.shape, np.float64), 0, 0.0
    for light, share in zip(pictures, shares, strict=False):
        total += share * light
        count, all_shares = count + 1, all_shares + share
    if count == 1:
        if frames is None:
            raise BadInput("is a single picture", where=where, hint="state the number of readouts with --frames N")
        rate = Fraction(sensor.readout_hz) if rate is None else rate
    elif rate is None and pictures.times is None:
        raise BadInput("does not state how many pictures it has per second", where=where, hint="add --rate HZ")
    elif rate is not None and pictures.times is not None and rate != pictures.rate_hz:
        own = describe_pace(pictures.times, pictures.rate_hz)
        taken = describe_pace(None, rate)
        notes = (*notes, f"{pictures.path.name}: its pictures {own} are taken to be {taken} (--rate)")
    max_frames = _max_frames(pictures, sensor, count=count, rate=rate) if count > 1 else None
    if max_frames is not None and (max_frames < 1 or (frames is not None and frames > max_frames)):
        raise BadInput(
            f"{frames or 1} readouts were requested of {count} pictures {describe_pace(pictures.times, rate)}",
            where=where,
            allowed=f"1 to {max_frames}" if max_frames else f"pictures that last a readout, 1/{sensor.readout_hz:g} s",
        )
    mean = total / all_shares
    if not mean.max() > 0:
        raise BadInput("all pictures are black", where=where, allowed="pictures with light")
    everywhere = np.ones(pictures.shape, bool)
    scale = exposure_scale(mean, everywhere, sensor=sensor, mean_rate=mean_rate)
    return PictureEncoding(pictures, sensor, count, rate, int(frames or max_frames or 1), scale, mean_rate, notes)


def _time_shares(pictures: PictureFrames) -> list[float]:
    """Return how long each picture counts in the mean of the light between all of them, in s.

    Raises BadInput unless the times that the source states increase from each picture to the next.
    """
    known: list[Fraction] = []
    for number, time in enumerate(pictures.times or (), start=1):
        if time is None:
            raise BadInput(f"states no time for picture {number}", where=str(pictures.path), hint="add --rate HZ")
        if known and time <= known[-1]:
            raise BadInput(
                f"picture {number} is at {float(time):.6g} s, and picture {number - 1} at {float(known[-1]):.6g} s",
                where=str(pictures.path), allowed="times that increase", hint="add --rate HZ",
            )  # fmt: skip
        known.append(time)
    around = [known[0], *known, known[-1]]
    return [float(after - before) / 2 for before, after in zip(around, around[2:], strict=False)]


def _last_time(pictures: PictureFrames) -> Fraction:
    """Return the time of the last picture in s."""
    return (pictures.times or ())[-1] or Fraction(0)


def _max_frames(pictures: PictureFrames, sensor: Sensor, *, count: int, rate: Fraction | None) -> int:
    """Return the number of whole readouts from the first picture to the last."""
    if rate is None:
        return floor(_last_time(pictures) * Fraction(sensor.readout_hz))
    if rate.denominator == 1:  # in floats, by which streams have been made before
        return floor((count - 1) / float(rate) * sensor.readout_hz)
    return floor((count - 1) / rate * Fraction(sensor.readout_hz))


def encode_pictures(plan: PictureEncoding, out: str | os.PathLike[str], *, seed: int = 0, **optional: Any) -> str:
    """Write the spikes of pictures as the stream file ``out`` and return its ``content_sha256``.

    Picture k is the light at its time, k/rate_hz if they are steady, and between two pictures the light changes
    linearly. Each readout collects the exact integral of this light, so that none of it falls between two readouts, or
    the light of its middle where that is as good (:attr:`PictureEncoding.samples`). The use of memory does not grow
    with the number of pictures. ``optional`` are fields of :class:`Metadata` other than the provenance; by default, the
    position of the lens is what the pictures state.

    Raises BadInput if a picture differs in size from the first, has values that are not allowed, or is missing.
    """
    settings = {
        "pictures": name_as_text(plan.pictures.path.name), "count": plan.count,
        "rate_hz": None if plan.rate_hz is None else float(plan.rate_hz), "times": plan.pace,
        "values": plan.pictures.transfer.name, "between": "linear cross-fade",
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
        for knots, index, fraction in _blocks(plan):
            stack = (np.stack(knots)[None] * np.float32(plan.scale)).astype(np.float32, copy=False)
            gain = np.ones((len(index), 1), np.float32)
            writer.write(encoder.encode(stack, index=index, fraction=fraction, gain=gain))
    return writer.content_sha256


def _times_in_readouts(plan: PictureEncoding) -> np.ndarray:
    """Return the time of each picture, float64 (count,), in readouts from the first picture."""
    if plan.rate_hz is not None:
        return np.arange(plan.count) * plan.readouts_per_picture
    hz = Fraction(plan.sensor.readout_hz)
    return np.array([float((time or 0) * hz) for time in plan.pictures.times or ()])


class _Reader:
    """The pictures of a plan in their order; those that are held begin with the number ``first``."""

    def __init__(self, plan: PictureEncoding) -> None:
        self._plan, self._source = plan, iter(plan.pictures)
        self.first, self.held = 0, deque[np.ndarray]()

    def hold(self, first: int, last: int) -> None:
        """Let go of the pictures before ``first``, and read up to and including ``last``."""
        while self.first + len(self.held) <= last:
            light = next(self._source, None)
            if light is None:
                raise BadInput(
                    "has fewer pictures than before", where=str(self._plan.pictures.path), hint="encode it again"
                )
            self.held.append(light)
            self._drop(first)
        self._drop(first)

    def _drop(self, first: int) -> None:
        while self.held and self.first < first:
            self.held.popleft()
            self.first += 1

    def __getitem__(self, number: int) -> np.ndarray:
        return self.held[number - self.first]


def _blocks(plan: PictureEncoding) -> Iterator[tuple[list[np.ndarray], np.ndarray, np.ndarray]]:
    """Yield the pictures for each block of readouts, and the position of each readout among them.

    The position is the index of the picture before the readout and the fraction, 0 to 1, of the time to the next. A
    readout during which a picture falls has a mean light of its own, added to the pictures of the block, unless the
    plan samples; in any other readout the middle is the mean.
    """
    knots = max(min(BLOCK_KNOTS, BLOCK_BYTES // (4 * prod(plan.pictures.shape))), 2)
    step = int(min(BLOCK_FRAMES, max(knots * plan.readouts_per_picture, 8))) // 8 * 8
    times, reader, begin = _times_in_readouts(plan), _Reader(plan), 0
    while begin < plan.frames:
        stop = min(begin + step, plan.frames)
        while stop - begin > 8 and np.diff(np.searchsorted(times, (begin, stop)))[0] > knots:
            stop = begin + max((stop - begin) // 16 * 8, 8)  # pictures may crowd at some times
        middle = np.arange(begin, stop) + 0.5
        if plan.rate_hz is None:
            at = np.interp(middle, times, np.arange(plan.count))
        else:
            at = np.clip(middle / plan.readouts_per_picture, 0, plan.count - 1)
        first = np.minimum(at.astype(np.int64), max(plan.count - 2, 0))
        before, after = int(first[0]), min(int(first[-1]) + 1, plan.count - 1)
        crossed: np.ndarray = np.empty(0, np.int64)
        if not plan.samples:
            edges = np.arange(begin, stop + 1)
            crossed = np.flatnonzero(
                np.searchsorted(times, edges[1:], "left") > np.searchsorted(times, edges[:-1], "right")
            )
            before = min(before, int(np.searchsorted(times, begin, "right")) - 1)
            after = min(max(after, int(np.searchsorted(times, stop, "left"))), plan.count - 1)
        reader.hold(before, after)
        index, fraction, lights = first - before, at - first, list(reader.held)
        for readout in crossed:
            index[readout], fraction[readout] = len(lights), 0
            lights.append(_mean_light(reader, times, readout=begin + int(readout)))
        yield lights, index, fraction
        begin = stop


def _mean_light(reader: _Reader, times: np.ndarray, *, readout: int) -> np.ndarray:
    """Return the mean light (H, W) of one readout."""
    first = int(np.searchsorted(times, readout, "right")) - 1
    last = min(int(np.searchsorted(times, readout + 1, "left")), len(times) - 1)
    edges = np.array([readout, readout + 1])
    light = np.zeros_like(reader[first])
    for number in range(first, last + 1):
        light += np.float32(_light_shares(edges, times, number=number)[0]) * reader[number]
    return light


def _light_shares(edges: np.ndarray, times: np.ndarray, *, number: int) -> np.ndarray:
    """Return the share of picture ``number`` in the mean light of the readouts between ``edges``.

    A picture contributes a triangle of light, from the time of the picture before it to that of the one after it.
    """
    at = times[number]
    area = np.zeros(len(edges))
    if number > 0:
        length = at - times[number - 1]
        area += length / 2 * np.clip(1 + (edges - at) / length, 0, 1) ** 2
    if number + 1 < len(times):
        length = times[number + 1] - at
        area -= length / 2 * np.clip(1 - (edges - at) / length, 0, 1) ** 2
    return np.diff(area)
