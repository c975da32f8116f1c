"""Pictures of videos of 8 bits, decoded by ffmpeg in PyAV, at the times that their container states."""

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from saf_gen.core.extras import require_extra
from saf_gen.errors import BadInput
from saf_gen.stream.interop.linear_light import BT709, LUMINANCE, SRGB, PictureFrames, Transfer, equal_rate
from saf_gen.stream.interop.stated_length import find_cut
from saf_gen.stream.metadata import MAX_PIXELS

if TYPE_CHECKING:
    from av import VideoFrame
    from av.container import InputContainer
    from av.video.stream import VideoStream

OLDEST_AV = 18
CONTAINERS = ("mov", "matroska", "avi")
"""By their names in ffmpeg. All others are refused: some name other files or hosts, and some state no times."""
COUNTED = ("mov", "avi")
"""Containers that state the number of their pictures."""
UNSPECIFIED, FULL_RANGE = 2, 2
TRANSFERS = {1: BT709, 6: BT709, 13: SRGB, 14: BT709, 15: BT709}
"""By the number of the transfer characteristic in ITU-T H.273; 1, 6, 14 and 15 are one curve."""
BT709_MATRIX, BT601_MATRIX = 1, 5
MATRICES = (1, 5, 6, 9)
"""Numbers of the matrix coefficients in ITU-T H.273 that ffmpeg undoes: BT.709, BT.601 and BT.2020."""
WEIGHTS = {
    1: LUMINANCE, UNSPECIFIED: LUMINANCE, 5: LUMINANCE, 6: LUMINANCE,
    9: np.array([0.2627, 0.6780, 0.0593], np.float32),  # ITU-R BT.2020
    12: np.array([0.2290, 0.6917, 0.0793], np.float32),  # SMPTE EG 432-1, Display P3
}  # fmt: skip
"""Share of linear red, green and blue in the light, by the number of the primaries in ITU-T H.273."""
ERRORS = "crccheck+bitstream+buffer+careful"
KEEP_REST = "to keep what can be read: ffmpeg -i FILE -c:v ffv1 NEW.mkv"
AS_FOLDER = "for a folder of pictures with all bits: ffmpeg -i FILE FOLDER/%06d.tif"


class VideoFrames(PictureFrames):
    """Pictures of a video.

    All of it is decoded once, to find the times and any damage, before the first picture is used. ``transfer`` is what
    the user states; it counts before what the video states.

    Raises BadInput if the video is damaged, or stores its pictures in a way in which they cannot be read as meant.
    """

    def __init__(self, path: Path, *, transfer: Transfer | None) -> None:
        _check_av(of=f"a video ({path.name})")
        first, times, notes = _scan(path)
        if transfer is None and first.color_trc != UNSPECIFIED:
            if first.color_trc not in TRANSFERS:
                raise BadInput(
                    f"states the transfer {first.color_trc} of ITU-T H.273", where=str(path),
                    allowed="sRGB or BT.709", hint="convert it to BT.709",
                )  # fmt: skip
            transfer = TRANSFERS[first.color_trc]
        shape = _upright(np.empty((first.height, first.width)), first, where=path).shape
        super().__init__(path, transfer=transfer, shape=shape)
        self.weights = WEIGHTS[first.color_primaries]
        if _is_yuv(first) and first.colorspace == UNSPECIFIED:
            name = "BT.709" if self._usual_matrix == BT709_MATRIX else "BT.601"
            notes.append(f"{path.name}: no tag states its colour matrix, which is taken to be that of {name}")
        self.notes = tuple(notes)
        start = next((time for time in times if time is not None), Fraction(0))
        self.times = tuple(None if time is None else time - start for time in times)
        self.rate_hz = equal_rate(self.times)

    @property
    def _usual_matrix(self) -> int:
        """That of the standard of the transfer, for a video that states none: sYCC has that of BT.601."""
        return BT601_MATRIX if self.transfer is SRGB else BT709_MATRIX

    def _read(self) -> Iterator[tuple[str, np.ndarray]]:
        number = 0
        with _open(self.path) as (container, stream):
            for frame in _decode(container, stream, faults=[]):
                if frame is not None:
                    number += 1
                    if _is_yuv(frame) and frame.colorspace == UNSPECIFIED:
                        frame.colorspace = self._usual_matrix
                    values = np.asarray(frame.reformat(format="rgb24").to_ndarray())
                    yield f"picture {number}", _upright(values, frame, where=self.path)


def _check_av(*, of: str) -> None:
    """Raise BadInput if PyAV is missing, or is a release that crashes on some damaged files."""
    require_extra("video", "av", of=of)
    import av

    if int(av.__version__.partition(".")[0]) < OLDEST_AV:
        raise BadInput(
            f"{of} is read with PyAV, here of version {av.__version__}", allowed=f"version {OLDEST_AV} or newer",
            hint="pip install --upgrade 'saf-gen[video]'",
        )  # fmt: skip


def _scan(path: Path) -> tuple["VideoFrame", list[Fraction | None], list[str]]:
    """Decode all of a video, and return its first picture, the times of all in s, and what a user should know.

    Raises BadInput if it is damaged, or has fewer pictures than it states.
    """
    first: VideoFrame | None = None
    times: list[Fraction | None] = []
    with _messages() as messages, _open(path) as (container, stream):
        faults: list[str] = []
        empty = 0
        for frame in _decode(container, stream, faults=faults):
            if frame is None:
                empty += 1
                continue
            if not faults:
                _check_frame(frame, frame if first is None else first, codec=stream.codec_context.name, where=path)
            first = frame if first is None else first
            times.append(None if frame.pts is None or frame.time_base is None else frame.pts * frame.time_base)
        stated = _count_stated(stream, container.format.name.partition(",")[0])
        others = {s.codec_context.name for s in container.streams if s.codec_context and s is not stream}
        if stated:  # what the container complains about, such as chapters, took no picture away
            others.add(container.format.name)
        faults += [message.strip() for _, name, message in messages if name not in others]
        if cut := find_cut(path):
            faults.append(cut)
        if faults or len(times) + empty < stated:
            of, reason = f" of {stated}" if stated else "", f" ({faults[0]})" if faults else ""
            raise BadInput(
                f"is damaged or cut off: {len(times)}{of} pictures can be read{reason}", where=str(path), hint=KEEP_REST
            )
        shape = stream.sample_aspect_ratio
    if first is None:
        raise BadInput("has no picture", where=str(path))
    notes = []
    if shape and shape != 1:
        notes.append(f"{path.name}: its pixels are {shape.numerator}:{shape.denominator}, and are taken as square")
    return first, times, notes


def _decode(container: "InputContainer", stream: "VideoStream", *, faults: list[str]) -> "Iterator[VideoFrame | None]":
    """Yield the pictures of a stream, and None where an AVI shows the one before again; add damage to ``faults``."""
    import av

    for packet in container.demux(stream):
        if packet.is_corrupt:
            faults.append("a part of it is missing")
        if packet.pts is not None and packet.size == 0:
            yield None
        try:
            frames = stream.codec_context.decode(packet)
        except av.FFmpegError as error:
            faults.append(error.strerror or str(error))
            continue
        if any(frame.is_corrupt for frame in frames):
            faults.append("a picture is damaged")
        yield from frames


def _count_stated(stream: "VideoStream", kind: str) -> int:
    """Return the number of pictures that a container states, without those that players are told to skip, or 0."""
    if kind == "mov" and stream.frames:
        return sum(not entry.is_discard for entry in stream.index_entries)
    return stream.frames if kind in COUNTED else 0


def _check_frame(frame: "VideoFrame", first: "VideoFrame", *, codec: str, where: Path) -> None:
    """Raise BadInput if a picture is interlaced, differs from the first, or is not shown by ffmpeg as it is meant."""
    form, problem, hint = frame.format, "", AS_FOLDER
    is_grey = len(form.components) == 1
    tags, usual = ((f.color_trc, f.color_primaries, f.colorspace, f.color_range) for f in (frame, first))
    if frame.interlaced_frame:
        problem, hint = "is interlaced, with rows of two moments", "ffmpeg -i FILE -vf bwdif -c:v ffv1 NEW.mkv"
    elif (frame.width, frame.height) != (first.width, first.height):
        problem = f"changes from {first.width}×{first.height} to {frame.width}×{frame.height} pixels"
    elif tags != usual:
        problem = "changes its tags of colour"
    elif form.is_bayer or any(part.bits != 8 for part in form.components):
        problem = f"has pixels of the format {form.name}"
    elif _is_yuv(frame) and frame.colorspace not in (*MATRICES, UNSPECIFIED):
        problem = f"states the matrix {frame.colorspace} of ITU-T H.273"
    elif frame.color_primaries not in WEIGHTS:
        problem = f"states the primaries {frame.color_primaries} of ITU-T H.273"
    elif is_grey and frame.color_range != FULL_RANGE and (frame.color_range or codec in ("h264", "hevc")):
        problem = "has grey of limited range"  # ffmpeg takes it to be full
    if problem:
        allowed = "progressive video of 8 bits in grey of full range, RGB, or YUV of BT.601, BT.709 or BT.2020"
        raise BadInput(problem, where=str(where), allowed=allowed, hint=hint)


def _is_yuv(frame: "VideoFrame") -> bool:
    return len(frame.format.components) > 2 and not frame.format.is_rgb


@contextmanager
def _open(path: Path) -> Iterator[tuple["InputContainer", "VideoStream"]]:
    """Open a video and yield its container and its stream of pictures; nothing but this one file is ever opened."""
    import av

    def refuse(*unused: Any) -> None:
        raise PermissionError("names another file")

    allowed = {"format_whitelist": ",".join(CONTAINERS), "protocol_whitelist": "file"}
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
            stream = _only_stream(container, where=path)
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
        hint = ""
        if "whitelist" in reason:
            reason, hint = "it is in none of the containers that are read", "ffmpeg -i FILE -c:v ffv1 NEW.mkv"
        raise BadInput(
            f"cannot be decoded: {reason}", where=str(path),
            allowed="pictures, or a video in MP4, MOV, Matroska, WebM or AVI", hint=hint,
        ) from error  # fmt: skip


@contextmanager
def _messages() -> Iterator[list[tuple[int, str, str]]]:
    """Collect what ffmpeg reports as errors on this thread, each as level, name of the part, and message."""
    import av.logging as log

    before = log.get_level(), log.get_skip_repeated()
    log.set_level(log.ERROR)
    log.set_skip_repeated(False)  # or a repetition would be reported with the next file
    try:
        with log.Capture() as messages:
            yield messages
    finally:
        log.set_level(before[0])
        log.set_skip_repeated(before[1])


def _only_stream(container: "InputContainer", *, where: Path) -> "VideoStream":
    """Return the only stream of moving pictures; covers do not count."""
    from av.stream import Disposition

    still = Disposition.attached_pic | Disposition.timed_thumbnails
    streams = [stream for stream in container.streams.video if not stream.disposition & still]
    if len(streams) != 1:
        raise BadInput(
            f"has {len(streams)} streams of moving pictures", where=str(where), allowed="one",
            hint="to keep the first: ffmpeg -i FILE -map 0:v:0 -c copy NEW.mkv" if streams else "",
        )  # fmt: skip
    if streams[0].codec_context is None:
        raise BadInput("its pictures are stored in a way that ffmpeg does not know", where=str(where))
    return streams[0]


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
