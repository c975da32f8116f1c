"""Videos as strangers store them, written with PyAV plane by plane, so that their content is known."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

LOSSLESS_H264 = {"qp": "0", "preset": "ultrafast"}
FFV1 = {"slicecrc": "1", "level": "3"}
FORMATS = {
    # name: container, codec, its options, pixel formats, whether it loses anything
    "ffv1 mkv": ("mkv", "ffv1", FFV1, ["gray", "yuv420p", "yuv444p", "bgr0", "gray10le", "yuv420p10le"], False),
    "h264 mkv": ("mkv", "libx264", LOSSLESS_H264, ["yuv420p", "yuv444p"], False),
    "h264 mp4": ("mp4", "libx264", LOSSLESS_H264, ["yuv420p", "yuv444p", "yuv420p10le", "gray"], False),
    "h264 lossy mp4": ("mp4", "libx264", {"crf": "8"}, ["yuv420p"], True),
    "h264 rgb mp4": ("mp4", "libx264rgb", LOSSLESS_H264, ["rgb24"], False),
    "mpeg4 mp4": ("mp4", "mpeg4", {"b": "4000000"}, ["yuv420p"], True),
    "vp9 webm": ("webm", "libvpx-vp9", {"lossless": "1", "cpu-used": "8"}, ["yuv420p", "yuv444p"], False),
    "raw avi": ("avi", "rawvideo", {}, ["bgr24"], False),
    "mjpeg avi": ("avi", "mjpeg", {"b": "8000000", "qmin": "1", "qmax": "2"}, ["yuvj420p"], True),
    "ffv1 avi": ("avi", "ffv1", FFV1, ["yuv420p", "gray", "bgr0"], False),
    "png mov": ("mov", "png", {}, ["rgb24", "gray"], False),
    "qtrle mov": ("mov", "qtrle", {}, ["rgb24"], False),
}  # fmt: skip
SLOW = [Fraction(text) for text in ("24", "25", "30", "60", "24000/1001", "30000/1001", "240")]
FAST = [*SLOW, Fraction(1000), Fraction(2000), Fraction(10000), Fraction(1, 3), Fraction(12, 7)]
CURVES = {1: "bt709", 6: "bt709", 13: "srgb", 14: "bt709", 15: "bt709", 2: ""}
"""By the number of the transfer in ITU-T H.273; unspecified has none, and others are not read."""
MATRICES = {1: (0.2126, 0.0722), 5: (0.299, 0.114), 6: (0.299, 0.114), 9: (0.2627, 0.0593)}
BT709, BT2020 = (0.2126, 0.7152, 0.0722), (0.2627, 0.6780, 0.0593)
LIMITED, FULL, UNSPECIFIED = 1, 2, 2


@dataclass(frozen=True)
class Video:
    """A video that was written: ``levels`` from 0 to 1 are what its integers mean, before the curve is undone.

    ``curve`` is what the file states, or what a user would have to; ``is_read`` is False if it must be refused.
    """

    path: Path
    levels: np.ndarray
    curve: str
    weights: tuple[float, ...]
    stored: str
    loss: str
    times: np.ndarray
    tick: float
    is_stated: bool
    is_read: bool


def to_frame(planes: list[np.ndarray], pix_fmt: str, size: tuple[int, ...]) -> av.VideoFrame:
    """Return a frame whose planes hold these integers, each (rows, integers of a row)."""
    frame = av.VideoFrame(size[1], size[0], pix_fmt)
    for values, plane in zip(planes, frame.planes, strict=True):
        rows = np.zeros((plane.height, plane.line_size // values.itemsize), values.dtype)
        rows[: values.shape[0], : values.shape[1]] = values
        plane.update(rows.tobytes())
    return frame


def to_planes(values: np.ndarray, pix_fmt: str, matrix: int) -> list[np.ndarray]:
    """Return the integers by which a pixel format stores a picture, grey (H, W) or colour (H, W, 3)."""
    bits = 10 if "10" in pix_fmt else 8
    kind, top = ("u1" if bits == 8 else "<u2"), 2**bits - 1
    if pix_fmt.startswith("gray"):
        return [np.rint(values * top).astype(kind)]
    if pix_fmt in ("rgb24", "bgr24", "bgr0"):
        ordered = values[..., ::-1] if pix_fmt.startswith("bgr") else values
        if pix_fmt == "bgr0":
            ordered = np.dstack([ordered, np.ones(ordered.shape[:2])])
        return [np.rint(ordered * top).astype(kind).reshape(len(values), -1)]
    step = 2 ** (bits - 8)
    if values.ndim == 2:
        low, span = (0, 255) if pix_fmt.startswith("yuvj") else (16, 219)
        luma = np.rint((low + span * values) * step)
        down, across = (2 if "420" in pix_fmt else 1), (1 if "444" in pix_fmt else 2)
        chroma = np.full((-(-values.shape[0] // down), -(-values.shape[1] // across)), 128 * step)
        return [plane.astype(kind) for plane in (luma, chroma, chroma)]
    red_share, blue_share = MATRICES[matrix]
    luma = values @ np.array([red_share, 1 - red_share - blue_share, blue_share])
    blue, red = (values[..., 2] - luma) / (2 - 2 * blue_share), (values[..., 0] - luma) / (2 - 2 * red_share)
    planes = ((16 + 219 * luma) * step, (128 + 224 * blue) * step, (128 + 224 * red) * step)
    return [np.rint(plane).astype(kind) for plane in planes]


def to_levels(planes: list[np.ndarray], pix_fmt: str, matrix: int, size: tuple[int, ...]) -> np.ndarray:
    """Return what these integers mean: the inverse of :func:`to_planes`, with the matrix that a file states."""
    bits = 8 if planes[0].itemsize == 1 else 10
    top = 2**bits - 1
    if pix_fmt.startswith("gray"):
        return planes[0] / top
    if not pix_fmt.startswith("yuv"):
        packed = planes[0].reshape(*size, -1)[..., :3] / top
        return packed[..., ::-1] if pix_fmt.startswith("bgr") else packed
    step = 2 ** (bits - 8)
    if pix_fmt.startswith("yuvj"):
        return planes[0] / 255
    luma = (planes[0] / step - 16) / 219
    if planes[1].shape != planes[0].shape:  # only grey is written so
        return np.clip(luma, 0, 1)
    red_share, blue_share = MATRICES[matrix]
    blue = luma + (2 - 2 * blue_share) * (planes[1] / step - 128) / 224
    red = luma + (2 - 2 * red_share) * (planes[2] / step - 128) / 224
    green = (luma - red_share * red - blue_share * blue) / (1 - red_share - blue_share)
    return np.clip(np.stack([red, green, blue], axis=-1), 0, 1)


def write_video_file(random: np.random.Generator, folder: Path, draw: Callable[[bool], np.ndarray]) -> Video:
    """Draw a format, tags and times, and write a video; ``draw`` returns grey values or colours."""
    name = str(random.choice(list(FORMATS)))
    container, codec, options, formats, lossy = FORMATS[name]
    pix_fmt = str(random.choice(formats))
    is_yuv = pix_fmt.startswith("yuv")
    colour = not pix_fmt.startswith("gray") and (not is_yuv or (pix_fmt == "yuv444p" and bool(random.integers(2))))
    values = draw(colour)
    deep = pix_fmt.endswith("10le")
    tags = {
        "color_trc": int(random.choice([2, 13, 1, 6, 8, 16], p=[0.4, 0.2, 0.2, 0.1, 0.05, 0.05])),
        "color_primaries": int(random.choice([1, 9])),
        "color_range": FULL if pix_fmt.startswith(("gray", "yuvj")) else LIMITED,
    }
    if is_yuv:
        tags["colorspace"] = int(random.choice([1, 5, 9]))
    elif codec != "libx264rgb":
        tags.pop("color_range" if not pix_fmt.startswith("gray") else "", None)
    planes = [to_planes(one, pix_fmt, tags.get("colorspace", 1)) for one in values]
    times, rate, tick, how = draw_times(random, name, len(values))
    path = folder / f"in.{container}"
    muxing = {}
    if container in ("mp4", "mov"):  # otherwise edit lists are rounded to ms, and leave out pictures of fast video
        muxing = {"movie_timescale": "90000", **({"movflags": "+faststart"} if random.integers(2) else {})}
    size = values.shape[1:3]
    frames = [to_frame(one, pix_fmt, size) for one in planes]
    write_frames(path, frames, times, codec=codec, options=options, muxing=muxing, rate=rate, tick=tick, tags=tags)
    with av.open(str(path)) as file:  # containers do not hold every tag
        kept = next(file.decode(video=0))
        matrix, stated = int(kept.colorspace), CURVES.get(int(kept.color_trc))
        weights = BT2020 if int(kept.color_primaries) == 9 else BT709
        full = int(kept.color_range) == FULL
    curve = stated or str(random.choice(["srgb", "bt709", "linear"]))
    if matrix == UNSPECIFIED:
        matrix = 5 if curve == "srgb" else 1
    is_read = not deep and (full or not pix_fmt.startswith("gray") or codec != "libx264")
    levels = np.stack([to_levels(one, pix_fmt, matrix, size) for one in planes])
    loss = "lossy" if lossy else "rounded" if is_yuv else "exact"
    checksums = " slicecrc" if codec == "ffv1" and container == "mkv" else ""
    said = stated or f"{'no' if stated == '' else 'another'} transfer ({curve})"
    stored = f"{name} {pix_fmt} {said} {size} {how}{checksums}"
    coarse = 1.1e-3 if container in ("mkv", "webm") else 1e-6
    seconds = np.array([float(time - times[0]) for time in times])
    return Video(path, levels, curve, weights, stored, loss, seconds, coarse, bool(stated), is_read)


def draw_times(random: np.random.Generator, name: str, count: int) -> tuple[list[Fraction], Fraction, Fraction, str]:
    """Return the times of pictures in s, a rate that is stated, the unit of the times, and a description."""
    container = FORMATS[name][0]
    rates = FAST if container in ("mp4", "mov") else SLOW
    rate = rates[random.integers(len(rates))]
    offset = 0 if container == "avi" else int(random.choice([0, 0, 7]))
    if container == "avi" or random.random() < 0.5:
        times = [(offset + number) / rate for number in range(count)]
        return times, rate, 1 / rate, f"at {rate} Hz from {offset}"
    ticks = [1000] if container in ("mkv", "webm") else [600, 1000] if name == "mpeg4 mp4" else [600, 1000, 90_000]
    tick = Fraction(1, int(random.choice(ticks)))
    steps = np.cumsum([offset, *random.integers(1, 40, count - 1)])
    if tick < Fraction(1, 1000):
        steps = steps * 150
    return [int(step) * tick for step in steps], Fraction(25), tick, f"at {[int(step) for step in steps]} of {tick} s"


def write_frames(
    path: Path, frames: list[av.VideoFrame], times: list[Fraction], *, codec: str, options: dict[str, str],
    muxing: dict[str, str], rate: Fraction, tick: Fraction, tags: dict[str, int],
) -> None:  # fmt: skip
    with av.open(str(path), "w", container_options=muxing) as file:
        stream = file.add_stream(codec, rate=rate, options=options)
        stream.width, stream.height, stream.pix_fmt = frames[0].width, frames[0].height, frames[0].format.name
        stream.codec_context.time_base = tick
        for name, value in tags.items():
            setattr(stream.codec_context, name, value)
        for frame, time in zip(frames, times, strict=True):
            for name, value in tags.items():
                setattr(frame, name, value)
            frame.time_base, frame.pts = tick, round(time / tick)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
