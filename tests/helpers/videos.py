"""Videos whose pictures and times are known, written with PyAV."""

from fractions import Fraction

import av
import numpy as np


def frame_of(planes, pix_fmt, **tags):
    """Return a frame of this pixel format whose planes hold exactly these integers, each (rows, numbers in a row)."""
    packed = av.VideoFormat(pix_fmt, 2, 2)
    per_pixel = 1
    if len(planes) == 1:
        per_pixel = packed.padded_bits_per_pixel // (8 * planes[0].itemsize)
    frame = av.VideoFrame(planes[0].shape[1] // per_pixel, planes[0].shape[0], pix_fmt)
    for values, plane in zip(planes, frame.planes, strict=True):
        padded = np.zeros((plane.height, plane.line_size // values.itemsize), values.dtype)
        padded[:, : values.shape[1]] = values
        plane.update(padded.tobytes())
    for name, value in tags.items():
        setattr(frame, name, value)
    return frame


def write_video(
    path,
    pictures,
    *,
    times=None,
    rate=25,
    codec="ffv1",
    pix_fmt=None,
    tick=None,
    options=(),
    muxing=(),
    setup=None,
    **tags,
):
    """Write frames, or arrays uint8 (H, W) or (H, W, 3), at these times (s) or at a rate.

    ``tick`` is the unit of the times; ``setup`` is called with the stream; ``tags`` are those of the colours.
    """
    with av.open(str(path), "w", container_options=dict(muxing)) as file:
        stream = file.add_stream(codec, rate=Fraction(rate), options=dict(options))
        frames = [
            av.VideoFrame.from_ndarray(p, format="gray" if p.ndim == 2 else "rgb24") if isinstance(p, np.ndarray) else p
            for p in pictures
        ]
        stream.width, stream.height = frames[0].width, frames[0].height
        stream.pix_fmt = pix_fmt or frames[0].format.name
        tick = Fraction(tick or 1 / Fraction(rate))
        stream.codec_context.time_base = tick
        for name, value in tags.items():
            setattr(stream.codec_context, name, value)
        if setup is not None:
            setup(stream)
        for number, frame in enumerate(frames):
            if frame.format.name != stream.pix_fmt:
                frame = frame.reformat(format=stream.pix_fmt)
            for name, value in tags.items():
                setattr(frame, name, value)
            frame.time_base = tick
            frame.pts = round((number / Fraction(rate) if times is None else Fraction(times[number])) / tick)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
