"""Pictures of videos, and of image files with more bits than Pillow reads, decoded by ffmpeg in PyAV."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput
from saf_gen.stream.interop.linear_light import LINEAR, LUMINANCE, WIDE_LUMINANCE, PictureFrames, find_transfer
from saf_gen.stream.interop.stated_length import find_cut
from saf_gen.stream.metadata import MAX_PIXELS

if TYPE_CHECKING:
    from av import Packet, VideoFrame
    from av.container import InputContainer
    from av.video.stream import VideoStream

OLDEST_AV = 18
TIMED = ("mov", "matroska", "avi", "mpegts", "mpeg", "flv", "asf", "ogg", "mxf", "ivf", "yuv4mpegpipe", "cine")
UNTIMED = ("h264", "hevc", "m4v", "mjpeg", "mpegvideo", "obu")
"""Containers by their names in ffmpeg. All others are refused, because some of them name other files or hosts; the
second group has pictures without times, for which ffmpeg would invent a rate."""
ESTIMATED = {"mpegts", "mpeg"}
"""Containers that state no duration, for which ffmpeg estimates one."""
MATRICES = {
    1: (0.2126, 0.0722), 2: (0.299, 0.114), 4: (0.30, 0.11), 5: (0.299, 0.114), 6: (0.299, 0.114), 7: (0.212, 0.087),
    9: (0.2627, 0.0593),
}  # fmt: skip
"""Shares of red and blue in the luma, by the number of the matrix coefficients in ITU-T H.273; 2 is unspecified."""
HIDING = {"vp8", "vp9", "mpeg4", "msmpeg4v3", "wmv3", "vc1", "theora"}
"""Codecs with packets that are intact and show no picture, or show the one before again."""
UNSPECIFIED, LIMITED_RANGE, FULL_RANGE = 2, 1, 2
ERRORS = "crccheck+bitstream+buffer+careful"
KEEP_REST = "to keep what can be read: ffmpeg -i FILE -c:v ffv1 NEW.mkv"


@dataclass(frozen=True)
class Scan:
    """What a video turned out to hold when all of it was decoded.

    ``times`` are those of its pictures in s, exact, from the first, or none at all; ``tick`` is their resolution in s;
    ``rates`` are the pictures per second that the container states, several of them if they differ.
    """

    count: int
    times: tuple[Fraction | None, ...]
    tick: Fraction
    rates: tuple[Fraction, ...]
    shape: tuple[int, int]
    transfer: int
    primaries: int
    notes: tuple[str, ...]


class VideoFrames(PictureFrames):
    """Pictures of a video, with all bits of its pixel format and the times of its container.

    All of it is decoded once, to find the times and any damage, before the first picture is used.
    """

    def __init__(self, path: Path, *, linear: bool) -> None:
        _check_av(of=f"a video ({path.name})")
        scan = _scan(path)
        super().__init__(path, linear=linear, shape=scan.shape)
        self.transfer = LINEAR if linear else find_transfer(scan.transfer, where=path)
        self.weights = WIDE_LUMINANCE.get(scan.primaries, LUMINANCE)
        self.notes, self._count = scan.notes, scan.count
        if scan.times:
            self.times, self.rate_hz = scan.times, steady_rate(scan.times, tick=scan.tick, stated=scan.rates)

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        number = 0
        with _open(self.path) as (container, stream):
            for packet in container.demux(stream):
                for frame in stream.codec_context.decode(packet):
                    number += 1
                    yield f"picture {number}", _upright(_values(frame, where=self.path), frame, where=self.path)
        if number != self._count:
            raise BadInput(f"had {self._count} pictures and has {number} now", where=str(self.path), hint="try again")


def steady_rate(
    times: Sequence[Fraction | None], *, tick: Fraction, stated: Sequence[Fraction] = ()
) -> Fraction | None:
    """Return the pictures per second if ``times`` (s) follow each other at equal steps, or None.

    A container rounds times to its ``tick`` (s). They are also steady if each picture is less than a tick away from its
    place at one of the ``stated`` rates, or at a single one of the usual rates near the average.
    """
    known = [time for time in times if time is not None]
    if len(known) < 2 or len(known) < len(times) or known[0] >= known[-1]:
        return None
    steps = {after - before for before, after in pairwise(known)}
    if len(steps) == 1:
        return 1 / steps.pop()

    def fits(rate: Fraction) -> bool:
        return all(abs(time - known[0] - number / rate) < tick for number, time in enumerate(known))

    for rate in sorted(stated, key=lambda rate: rate.denominator not in (1, 1001)):
        if fits(rate):  # Matroska makes 60000/1001 of the television into 19001/317
            television = _television_rate(rate)
            return television if abs(television - rate) < rate / 1_000_000 else rate
    average = (len(known) - 1) / (known[-1] - known[0])
    usual = [rate for rate in (Fraction(round(average)), _television_rate(average)) if rate and fits(rate)]
    return usual[0] if len(usual) == 1 else None


def _television_rate(rate: Fraction) -> Fraction:
    """Return the nearest multiple of 1000/1001."""
    return Fraction(round(rate * 1001 / 1000) * 1000, 1001)


def decode_image(data: bytes, codec: str, *, where: Path) -> np.ndarray:
    """Return the picture of an image file with all its bits, float32 (H, W) or (H, W, 3), from 0 to 1, without alpha.

    ``codec`` is ffmpeg's name of the format, such as png. Raises BadInput if the picture cannot be decoded.
    """
    _check_av(of=f"a picture with more than 8 bits per colour ({where.name})")
    import av

    with _messages() as messages, _refusing(where):
        context: Any = av.CodecContext.create(codec, "r")
        context.options = {"max_pixels": str(4 * MAX_PIXELS), "err_detect": ERRORS}
        frames = [*context.decode(av.Packet(data)), *context.decode(None)]
        if len(frames) != 1 or frames[0].is_corrupt or messages:
            raise ValueError(messages[0][2].strip() if messages else "damaged")
        return _values(frames[0], where=where)


def _check_av(*, of: str) -> None:
    """Raise BadInput if PyAV is missing, or is a release that crashes on some damaged files."""
    require_extra("video", "av", of=of)
    import av

    if int(av.__version__.partition(".")[0]) < OLDEST_AV:
        raise BadInput(
            f"{of} is read with PyAV, here of version {av.__version__}", allowed=f"version {OLDEST_AV} or newer",
            hint="pip install --upgrade 'saf-gen[video]'",
        )  # fmt: skip


@contextmanager
def _open(path: Path) -> Iterator[tuple["InputContainer", "VideoStream"]]:
    """Open a video and yield its container and its stream of pictures; nothing but this one file is ever opened."""
    import av

    def refuse(*unused: Any) -> None:
        raise PermissionError("names another file")

    allowed = {"format_whitelist": ",".join((*TIMED, *UNTIMED)), "protocol_whitelist": "file"}
    limits = {"max_pixels": str(4 * MAX_PIXELS)}  # codecs store more pixels than they show
    with _refusing(path):
        if not path.is_file():  # opening a pipe would wait for ever
            raise ValueError("not a file on a disk")
        # As a Python file it has no address, from which ffmpeg would choose a protocol.
        with (
            path.open("rb") as file,
            av.open(
                file, "r", container_options=allowed, options=limits, io_open=refuse, metadata_errors="replace"
            ) as container,
        ):
            stream = _choose_stream(container, where=path)
            if stream.width * stream.height > MAX_PIXELS:
                size = f"has {stream.width} × {stream.height} pixels"
                raise BadInput(size, where=str(path), allowed=f"at most {MAX_PIXELS}")
            stream.thread_count = 1  # so that errors come in the order of the pictures
            stream.codec_context.options = {**limits, "err_detect": ERRORS}
            yield container, stream


@contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Raise BadInput in place of the errors of ffmpeg."""
    import av

    try:
        yield
    except (av.FFmpegError, OSError, ValueError, LookupError, MemoryError) as error:
        report: Any = getattr(error, "log", None)  # level, name of the part, and message
        reason = report[2].strip() if report else getattr(error, "strerror", None) or str(error)
        if "whitelist" in reason:
            reason = "it is in none of the containers that are read"
        raise BadInput(
            f"cannot be decoded: {reason}", where=str(path),
            allowed=f"a picture, or a video in a container such as {', '.join(TIMED[:3])}",
        ) from error  # fmt: skip


@contextmanager
def _messages() -> Iterator[list[tuple[int, str, str]]]:
    """Collect what ffmpeg reports as errors on this thread, each as level, name of the part, and message."""
    import av.logging as log

    before = log.get_level(), log.get_skip_repeated()
    log.set_level(log.ERROR)
    log.set_skip_repeated(False)  # or a repetition would be reported with the next file
    try:
        with log.Capture() as found:
            yield found
    finally:
        log.set_level(before[0])
        log.set_skip_repeated(before[1])


def _choose_stream(container: "InputContainer", *, where: Path) -> "VideoStream":
    """Return the only stream of moving pictures, or the only one that is marked as default; covers do not count."""
    from av.stream import Disposition

    still = Disposition.attached_pic | Disposition.timed_thumbnails
    found = [stream for stream in container.streams.video if not stream.disposition & still]
    usual = [stream for stream in found if stream.disposition & Disposition.default]
    if not found:
        kinds = sorted({"a cover" if stream.type == "video" else stream.type for stream in container.streams})
        raise BadInput(f"has no moving pictures, but {' and '.join(kinds) or 'nothing'}", where=str(where))
    if len(found) > 1 and len(usual) != 1:
        raise BadInput(
            f"has {len(found)} streams of pictures", where=str(where), allowed="one, or one that is marked as default",
            hint="to keep the first: ffmpeg -i FILE -map 0:v:0 -c copy NEW.mkv",
        )  # fmt: skip
    chosen = found[0] if len(found) == 1 else usual[0]
    if chosen.codec_context is None:
        raise BadInput("its pictures are stored in a way that ffmpeg does not know", where=str(where))
    return chosen


def _scan(path: Path) -> Scan:
    """Decode all of a video, and return its times and what is the same for all of its pictures.

    Raises BadInput if it is damaged, shorter than it states, interlaced, or changes in size or in its colours.
    """
    import av

    with _messages() as messages, _open(path) as (container, stream):
        found = _decode_all(container, stream, where=path)
        kind = container.format.name.partition(",")[0]
        estimated = kind in (*ESTIMATED, *UNTIMED) or not container.duration
        stated = None if estimated else Fraction(container.duration or 0, av.time_base)
        listed = _count_listed(stream, kind)
        others = {s.codec_context.name for s in container.streams if s.codec_context and s is not stream}
        if listed:  # what the container complains about, such as chapters, took no picture away
            others.add(container.format.name)
        found.faults += [message.strip() for _, name, message in messages if name not in others]
        if not (listed or found.faults) and (cut := find_cut(path)):
            found.faults.append(cut)
        packets = 0 if stream.codec_context.name in HIDING else found.packets
        if listed == len(found.times):  # with B-frames, MP4 adds the last step in the order of decoding to its length
            stated = None
        _check_length(found, where=path, expected=max(listed - found.empty, packets), stated=stated)
        tick = stream.time_base or Fraction(1, av.time_base)
        rates = [rate for rate in (stream.average_rate, stream.base_rate, stream.guessed_rate) if rate]
        if found.first is None:
            raise BadInput("has no picture", where=str(path))
        first, notes = found.first, _list_notes(found.first, stream, container=container, where=path)
    times = [] if kind in UNTIMED else found.times
    if kind == "avi":  # they are stated in the order of decoding
        times = sorted(times, key=lambda time: time or 0)
    start = next((time for time in times if time is not None), Fraction(0))
    times = [None if time is None else time - start for time in times]
    if kind == "mpeg" and steady_rate(times, tick=tick, stated=rates) is None:  # it states no length
        raise BadInput("is damaged: its pictures do not follow each other steadily", where=str(path), hint=KEEP_REST)
    height, width = _upright(np.empty((first.height, first.width), bool), first, where=path).shape
    return Scan(
        len(found.times),
        tuple(times),
        tick,
        tuple(rates),
        (height, width),
        first.color_trc,
        first.color_primaries,
        notes,
    )


@dataclass
class _Decoded:
    """What came out of a video: the times of its pictures in s, what went wrong, and where it ends in s.

    ``last_step`` is how long the last packet lasts in s, 0 if this is not stated; ``packets`` are those that should
    become a picture, and ``empty`` those that repeat the picture before.
    """

    first: "VideoFrame | None" = None
    times: list[Fraction | None] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    end: Fraction = Fraction(0)
    last_step: Fraction = Fraction(0)
    packets: int = 0
    empty: int = 0


def _decode_all(container: "InputContainer", stream: "VideoStream", *, where: Path) -> _Decoded:
    import av

    found, length_size = _Decoded(), _length_size(stream)
    for packet in container.demux():
        time = packet.pts if packet.pts is not None else packet.dts
        if time is not None:
            found.last_step = (packet.duration or 0) * packet.time_base
            found.end = max(found.end, time * packet.time_base + found.last_step)
        if packet.stream.index != stream.index:
            continue
        found.packets += packet.size > 0 and not packet.is_discard
        found.empty += time is not None and packet.size == 0
        if packet.is_corrupt or _has_hole(packet, length_size):
            found.faults.append("a part of it is missing")
        try:
            frames = stream.codec_context.decode(packet)
        except av.FFmpegError as error:
            found.faults.append(error.strerror or str(error))
            continue
        for frame in frames:
            if found.first is None:
                found.first = frame
            if frame.is_corrupt:
                found.faults.append("a picture is damaged")
            elif not found.faults:
                _check_frame(frame, found.first, number=len(found.times) + 1, where=where)
            pts, unit = frame.pts, frame.time_base
            found.times.append(None if pts is None or unit is None else pts * unit)
    return found


def _length_size(stream: "VideoStream") -> int:
    """Return in how many bytes the lengths of the units of H.264 and H.265 are stated, 0 if they are not."""
    at = {"h264": 4, "hevc": 21}.get(stream.codec_context.name)
    setup = stream.codec_context.extradata or b""
    return (setup[at] & 3) + 1 if at and len(setup) > at and setup[0] == 1 else 0


def _has_hole(packet: "Packet", length_size: int) -> bool:
    """Return whether a unit of H.264 or H.265 has three zeros in a row, which ITU-T H.264, 7.4.1, rules out.

    Decoders show whatever the zeros of a hole happen to mean.
    """
    data, at = bytes(packet) if length_size else b"", 0
    while at < len(data):
        begin = at + length_size
        at = begin + int.from_bytes(data[at:begin])
        if at > len(data) or b"\0\0\0" in data[begin:at].rstrip(b"\0"):
            return True
    return False


def _count_listed(stream: "VideoStream", kind: str) -> int:
    """Return the number of pictures that a container lists, without those that it tells players to skip; 0 for none.

    An AVI lists the pictures that are repeats of the one before as well.
    """
    if not stream.frames or kind == "avi":
        return 0
    if kind == "mov":
        return sum(not entry.is_discard for entry in stream.index_entries)
    return stream.frames


def _check_length(found: _Decoded, *, where: Path, expected: int, stated: Fraction | None) -> None:
    """Raise BadInput if there are fewer pictures, or less time, than the container states, or if there was a fault."""
    count, faults = len(found.times), found.faults
    short = count < expected
    if stated and count:  # half of the usual time between two pictures, and 1 ms, are left for rounding
        short |= found.end + (stated / count) * Fraction(1 if found.last_step else 3, 2) + Fraction(1, 1000) < stated
    if not (short or faults):
        return
    of = f" of {expected}" if expected > count else ""
    until = f", up to {float(found.end):.4g} s; the container states {float(stated):.4g} s" if stated else ""
    reason = f" ({faults[0]})" if faults else ""
    raise BadInput(
        f"is damaged or cut off: {count}{of} pictures can be read{until}{reason}", where=str(where), hint=KEEP_REST
    )


def _check_frame(frame: "VideoFrame", first: "VideoFrame", *, number: int, where: Path) -> None:
    """Raise BadInput if a picture is interlaced, has colours that cannot be decoded, or differs from the first."""
    if frame.interlaced_frame:
        raise BadInput(
            f"is interlaced: picture {number} has rows of two moments", where=str(where), allowed="progressive video",
            hint="ffmpeg -i FILE -vf bwdif -c:v ffv1 NEW.mkv",
        )  # fmt: skip
    if (frame.width, frame.height) != (first.width, first.height):
        raise BadInput(
            f"picture {number} has {frame.width}×{frame.height} pixels", where=str(where),
            allowed=f"{first.width}×{first.height}, like the first",
        )  # fmt: skip
    if (frame.color_trc, frame.color_primaries) != (first.color_trc, first.color_primaries):
        raise BadInput(f"picture {number} has other tags of colour than the first", where=str(where))
    is_yuv = len(frame.format.components) > 2 and not frame.format.is_rgb
    if is_yuv and frame.colorspace not in MATRICES:
        raise BadInput(
            f"its colours are stored with the matrix {frame.colorspace} of ITU-T H.273", where=str(where),
            allowed="BT.601, BT.709, BT.2020 or RGB", hint="ffmpeg -i FILE -pix_fmt gbrp16 -c:v ffv1 NEW.mkv",
        )  # fmt: skip


def _list_notes(
    frame: "VideoFrame", stream: "VideoStream", *, container: "InputContainer", where: Path
) -> tuple[str, ...]:
    notes = []
    if len(container.streams.video) > 1:
        notes.append(
            f"{where.name}: of {len(container.streams.video)} streams of pictures, number {stream.index} is read"
        )
    wide = stream.sample_aspect_ratio
    if wide and wide != 1:
        notes.append(f"{where.name}: its pixels are {wide.numerator}:{wide.denominator}, and are taken as square")
    if frame.colorspace == UNSPECIFIED and len(frame.planes) > 1 and not frame.format.is_rgb:
        notes.append(f"{where.name}: no tag states its colour matrix, which is assumed to be that of BT.601")
    return tuple(notes)


def _upright(values: np.ndarray, frame: "VideoFrame", *, where: Path) -> np.ndarray:
    """Return values (H, W, …) turned and mirrored as the display matrix of a picture asks for."""
    side: Any = frame.side_data.get("DISPLAYMATRIX")
    if side is None:
        return values
    a, b, _, c, d = (int(entry) for entry in np.frombuffer(bytes(side), np.int32)[:5])
    if (a, d) == (0, 0) and b and c:  # columns become rows
        values, across, down = np.swapaxes(values, 0, 1), c, b
    elif (b, c) == (0, 0) and a and d:
        across, down = a, d
    else:
        raise BadInput("lies at an angle", where=str(where), allowed="0, 90, 180 or 270 degrees")
    return values[:: 1 if down > 0 else -1, :: 1 if across > 0 else -1]


def _values(frame: "VideoFrame", *, where: Path) -> np.ndarray:
    """Return a picture as uint8 (H, W, 3) if it has 8 bits, else as float32 (H, W) or (H, W, 3) from 0 to 1.

    ffmpeg turns 8 bits to RGB as players show it. It would lose bits of deeper pictures (one part in 256 of a limited
    range), so that these are converted here, by the equations of ITU-R BT.601, BT.709 and BT.2020.
    """
    form = frame.format
    bits = max(component.bits for component in form.components)
    limited_grey = form.name == "gray" and frame.color_range == LIMITED_RANGE  # ffmpeg takes it to be of full range
    if bits <= 8 and not (limited_grey or (form.is_bayer and "16" in form.name)):
        return np.asarray(frame.reformat(format="rgb24").to_ndarray())
    first, *others = _planes(frame, bits, where=where)
    top, step = 2**bits - 1, 2 ** (bits - 8)
    if form.is_rgb:
        return np.stack([others[1], first, others[0]], axis=2) / np.float32(top)
    # Grey without a tag is of full range, as ffmpeg takes it.
    full = frame.color_range == FULL_RANGE or (not others and frame.color_range != LIMITED_RANGE)
    luma = first / np.float32(top) if full else (first - np.float32(16 * step)) / np.float32(219 * step)
    if not others:
        return np.clip(luma, 0, 1)
    span = np.float32(top if full else 224 * step)
    blue_less, red_less = ((_enlarge(plane, luma.shape) - np.float32(128 * step)) / span for plane in others)
    kr, kb = MATRICES[frame.colorspace]
    red, blue = luma + np.float32(2 * (1 - kr)) * red_less, luma + np.float32(2 * (1 - kb)) * blue_less
    green = (luma - np.float32(kr) * red - np.float32(kb) * blue) / np.float32(1 - kr - kb)
    return np.clip(np.stack([red, green, blue], axis=2), 0, 1)


def _planes(frame: "VideoFrame", bits: int, *, where: Path) -> list[np.ndarray]:
    """Return the integers of each plane, float32: grey; green, blue and red; or luma and two smaller ones of chroma."""
    form = frame.format
    colours = sum(not component.is_alpha for component in form.components)
    alpha = "a" if 1 < colours < len(form.components) else ""  # ffmpeg returns noise where it should leave it out
    if colours == 1:
        kind = "gray"
    elif form.is_rgb:
        kind = f"gbr{alpha}p"
    else:
        kind = f"yuv{alpha}{_SUBSAMPLED.get((form.chroma_width(2), form.chroma_height(2)))}p"
    try:
        if bits > 16 or form.is_bayer or "f" in form.name or form.name.startswith("xyz"):
            raise ValueError
        planes = frame.reformat(format=kind if bits == 8 else f"{kind}{bits}le").planes  # the same integers, in planes
    except ValueError as error:
        raise BadInput(
            f"has pixels of the format {form.name}", where=str(where), allowed="grey, RGB or YUV of 8 to 16 bits",
            hint="ffmpeg -i FILE -pix_fmt gbrp16 -c:v ffv1 NEW.mkv",
        ) from error  # fmt: skip
    dtype = "u1" if bits == 8 else "<u2"
    rows = (np.frombuffer(memoryview(plane), dtype).reshape(plane.height, -1) for plane in planes[:colours])
    return [values[:, : plane.width].astype(np.float32) for values, plane in zip(rows, planes, strict=False)]


_SUBSAMPLED = {(2, 2): 444, (1, 2): 422, (1, 1): 420, (2, 1): 440}
"""Names of formats by the width and height of chroma for 2×2 pixels of luma."""


def _enlarge(plane: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return chroma interpolated to the size of luma; its columns lie on even ones of luma, its rows between two."""
    for axis, offset in ((0, -0.25), (1, 0.0)):
        have = plane.shape[axis]
        if have == shape[axis]:
            continue
        at = np.clip(np.arange(shape[axis]) / 2 + offset, 0, have - 1)
        before = at.astype(int)
        share = np.expand_dims((at - before).astype(np.float32), 1 - axis)
        plane = plane.take(before, axis) * (1 - share) + plane.take(np.minimum(before + 1, have - 1), axis) * share
    return plane
