"""Videos of others: their times, all of their bits, their light, and damage, each against what PyAV has written."""

from fractions import Fraction
from itertools import accumulate

import av
import numpy as np
import pytest
from PIL import Image
from refusals import assert_says, refusal
from videos import frame_of, write_video

from saf_gen.camera import get_sensor
from saf_gen.stream.interop import video_frames as module
from saf_gen.stream.interop.encode_pictures import prepare_pictures
from saf_gen.stream.interop.linear_light import decode_hlg, decode_pq, decode_srgb
from saf_gen.stream.interop.picture_frames import open_pictures

IDEAL = get_sensor("ideal")
GREYS = [np.full((16, 16), 40 + 5 * number, np.uint8) for number in range(12)]
MJPEG = {"codec": "mjpeg", "pix_fmt": "yuvj420p"}
H264 = {"codec": "libx264", "pix_fmt": "yuv420p", "options": {"g": "4", "bf": "2"}}
VARIED = [
    *accumulate([Fraction(n, 1000) for n in (33, 34, 500, 10, 33, 250, 17, 33, 90, 500, 500)], initial=Fraction(0))
]


GAPS = [Fraction(n, 50) for n in (0, 1, 2, 5, 6, 10, 11, 12, 13, 20, 21, 22)]

TIMES = {
    "whole": ("a.mp4", H264, {"rate": 25}, 25),
    "film": ("a.mp4", H264, {"rate": Fraction(24000, 1001)}, Fraction(24000, 1001)),
    "film rounded to ms": ("a.mkv", H264, {"rate": Fraction(24000, 1001)}, Fraction(24000, 1001)),
    "thirtieths rounded to ms": ("a.mkv", {}, {"rate": 30}, 30),
    "television rounded to ms": ("a.mkv", {}, {"rate": Fraction(60000, 1001)}, Fraction(60000, 1001)),
    "2000 rounded to ms": ("a.mkv", {}, {"rate": 2000}, 2000),
    "a rate that a stream does not state": ("a.ts", H264, {"rate": Fraction(120000, 1001)}, Fraction(120000, 1001)),
    "one in three seconds": ("a.mkv", {}, {"rate": Fraction(1, 3)}, Fraction(1, 3)),
    "slow motion": ("a.mp4", H264, {"rate": 240}, 240),
    "1000": ("a.mp4", H264, {"rate": 1000}, 1000),
    "2000": ("a.mov", H264, {"rate": 2000}, 2000),
    "2000 in hundredths of ms": (
        "a.mp4",
        {**H264, "muxing": {"video_track_timescale": "100000"}},
        {"rate": 2000},
        2000,
    ),
    "10000": ("a.mp4", H264, {"rate": 10000, "muxing": {"video_track_timescale": "10000"}}, 10000),
    "ticks of 90 kHz": ("a.ts", H264, {"rate": Fraction(30000, 1001)}, Fraction(30000, 1001)),
    "avi": ("a.avi", MJPEG, {"rate": 50}, 50),
    "avi with B pictures": ("a.avi", {**H264, "options": {"bf": "3"}}, {"rate": 50}, 50),
    "variable, AVI": ("a.avi", MJPEG, {"times": GAPS, "rate": 50}, None),
    "variable": ("a.mp4", H264, {"times": VARIED, "tick": Fraction(1, 1000)}, None),
    "variable, 90 kHz": ("a.mp4", H264, {"times": VARIED, "tick": Fraction(1, 90000)}, None),
    "variable, Matroska": ("a.mkv", {}, {"times": VARIED, "tick": Fraction(1, 1000)}, None),
    "variable, WebM": (
        "a.webm",
        {"codec": "libvpx-vp9", "pix_fmt": "yuv420p"},
        {"times": VARIED, "tick": Fraction(1, 1000)},
        None,
    ),
    "late start": ("a.mp4", H264, {"times": [5 + t for t in VARIED], "tick": Fraction(1, 1000)}, None),
    "late steady start": (
        "a.mkv",
        {},
        {"times": [7 + Fraction(n, 20) for n in range(12)], "tick": Fraction(1, 1000)},
        20,
    ),
}


@pytest.mark.parametrize(("name", "how", "when", "rate"), TIMES.values(), ids=TIMES)
def test_times_are_those_that_were_written(tmp_path, name, how, when, rate):
    write_video(tmp_path / name, GREYS, **how, **when)
    pictures = open_pictures(tmp_path / name)
    assert pictures.rate_hz == rate
    expected = [n / Fraction(rate) for n in range(12)] if rate else GAPS if "rate" in when else VARIED
    error = max(abs(found - wanted) for found, wanted in zip(pictures.times, expected, strict=True))
    assert error <= (Fraction(1, 1000) if name.endswith("mkv") and rate else Fraction(1, 80000))
    assert prepare_pictures(pictures, IDEAL).frames == int(expected[-1] * 20_000)


def test_times_that_do_not_increase_are_refused_and_a_rate_overrides_them(tmp_path, call):
    """Matroska rounds to ms, so that two of these pictures come at the same one."""
    times = [Fraction(n, 10_000) for n in (0, 100, 200, 202, 300, 400, 500, 600, 700, 800, 900, 1000)]
    write_video(tmp_path / "a.mkv", GREYS, times=times, tick=Fraction(1, 10_000))
    code, _, err = call("encode", tmp_path / "a.mkv", "--out", tmp_path / "a.h5")
    assert code == 2
    assert "picture 4 is at 0.02 s, and picture 3 at 0.02 s" in err
    code, out, err = call("encode", tmp_path / "a.mkv", "--out", tmp_path / "a.h5", "--rate", "24000/1001")
    assert code == 0
    assert "12 pictures at 24000/1001 Hz (23.976)" in out
    assert "a.mkv: its pictures at times 0 to 10 ms apart are taken to be at 24000/1001 Hz (23.976) (--rate)" in err


def test_a_video_of_one_picture_is_a_scene_at_rest(tmp_path):
    write_video(tmp_path / "a.mp4", GREYS[:1], **H264)
    pictures = open_pictures(tmp_path / "a.mp4")
    assert_says(refusal(prepare_pictures, pictures, IDEAL), "is a single picture | --frames N")
    assert prepare_pictures(pictures, IDEAL, frames=50).frames == 50


def test_raw_video_without_times_asks_for_a_rate(tmp_path):
    write_video(tmp_path / "a.h264", GREYS, **H264)
    pictures = open_pictures(tmp_path / "a.h264")
    assert (pictures.rate_hz, pictures.times, len(list(pictures))) == (None, None, 12)
    assert_says(refusal(prepare_pictures, pictures, IDEAL), "does not state how many pictures | --rate HZ")


# All bits, whatever the format of the pixels.


def reference_rgb(planes, bits, *, full, matrix):
    """The equations of BT.601, BT.709 and BT.2020 in float64, for chroma of the size of luma."""
    kr, kb = {1: (0.2126, 0.0722), 6: (0.299, 0.114), 9: (0.2627, 0.0593)}[matrix]
    y, u, v = (plane.astype(float) for plane in planes)
    step = 2 ** (bits - 8)
    if full:
        y, u, v = y / (2**bits - 1), (u - 128 * step) / (2**bits - 1), (v - 128 * step) / (2**bits - 1)
    else:
        y, u, v = (y - 16 * step) / (219 * step), (u - 128 * step) / (224 * step), (v - 128 * step) / (224 * step)
    red, blue = y + 2 * (1 - kr) * v, y + 2 * (1 - kb) * u
    return np.stack([red, (y - kr * red - kb * blue) / (1 - kr - kb), blue], axis=2)


def integers(bits, shape=(16, 16), seed=0):
    """Values of limited range around grey, so that no colour leaves RGB."""
    return np.random.default_rng(seed).integers(100 << (bits - 8), 150 << (bits - 8), shape, np.uint16)


LUMA = {
    "gray": (8, ()), "gray10le": (10, ()), "gray12le": (12, ()), "gray14le": (14, ()), "gray16le": (16, ()),
    "yuv420p": (8, ((8, 8),) * 2), "yuv420p9le": (9, ((8, 8),) * 2), "yuv420p10le": (10, ((8, 8),) * 2),
    "yuv422p10le": (10, ((16, 8),) * 2), "yuv444p10le": (10, ((16, 16),) * 2), "yuv420p12le": (12, ((8, 8),) * 2),
    "yuv444p12le": (12, ((16, 16),) * 2), "yuv444p16le": (16, ((16, 16),) * 2), "yuv440p10le": (10, ((8, 16),) * 2),
    "yuva444p10le": (10, ((16, 16),) * 3), "p010le": (10, ((8, 16),)), "p210le": (10, ((16, 16),)),
}  # fmt: skip


@pytest.mark.parametrize("full", [False, True], ids=["limited", "full"])
@pytest.mark.parametrize("pix_fmt", LUMA)
def test_every_level_of_grey_in_any_format_is_kept(tmp_path, pix_fmt, full):
    """Chroma is neutral; values are compared with the numbers that went into the file, to a tenth of a level,
    or to one level of 8 bits, as players do."""
    bits, others = LUMA[pix_fmt]
    luma = integers(bits)
    up = 6 if pix_fmt.startswith("p") else 0  # these hold 10 bits in the upper part of 16
    kind = np.uint8 if bits == 8 else np.uint16
    planes = [(luma << up).astype(kind), *(np.full(shape, 128 << (bits - 8) << up, kind) for shape in others)]
    tags = {"colorspace": 1, "color_range": 2 if full else 1}
    frame = frame_of(planes, pix_fmt, **tags)
    if up:  # FFV1 has no such format
        values = module._values(frame, where=tmp_path)
    else:
        write_video(tmp_path / "a.mkv", [frame] * 2, **tags)
        (light, _) = open_pictures(tmp_path / "a.mkv", linear=True)
        values = light[:, :, None]
    top, step = 2**bits - 1, 2 ** (bits - 8)
    expected = luma / top if full else (luma - 16.0 * step) / (219 * step)
    assert np.abs(values - expected[:, :, None]).max() * top < (0.1 if bits > 8 else 1)


@pytest.mark.parametrize("matrix", [1, 6, 9], ids=["BT.709", "BT.601", "BT.2020"])
@pytest.mark.parametrize("full", [False, True], ids=["limited", "full"])
@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_colours_follow_the_matrix_and_range_that_are_stated(tmp_path, bits, full, matrix):
    planes = [integers(bits, seed=seed).astype(np.uint8 if bits == 8 else np.uint16) for seed in range(3)]
    tags = {"colorspace": matrix, "color_range": 2 if full else 1}
    pix_fmt = "yuv444p" if bits == 8 else f"yuv444p{bits}le"
    write_video(tmp_path / "a.mkv", [frame_of(planes, pix_fmt, **tags)] * 2, **tags)
    (light, _) = open_pictures(tmp_path / "a.mkv", linear=True)
    rgb = np.clip(reference_rgb(planes, bits, full=full, matrix=matrix), 0, 1)
    assert np.abs(light - rgb @ [0.2126, 0.7152, 0.0722]).max() * (2**bits - 1) < (0.1 if bits > 8 else 1.5)


RGB = {"bgra": 8, "gbrp9le": 9, "gbrp10le": 10, "gbrp12le": 12, "gbrp14le": 14, "gbrp16le": 16, "gbrap12le": 12,
       "rgb48le": 16, "rgba64le": 16}  # fmt: skip


@pytest.mark.parametrize("pix_fmt", RGB)
def test_every_bit_of_red_green_and_blue_is_kept(tmp_path, pix_fmt):
    """Alpha is zero, and is ignored."""
    bits, kind = RGB[pix_fmt], np.uint8 if RGB[pix_fmt] == 8 else np.uint16
    red, green, blue = (np.random.default_rng(seed).integers(0, 1 << bits, (16, 16), kind) for seed in range(3))
    channels = {"r": red, "g": green, "b": blue, "a": 0 * red}
    order = [channels[name] for name in pix_fmt.removesuffix("le") if name in channels]
    planes = order if "p" in pix_fmt else [np.stack(order, axis=2).reshape(16, -1)]
    write_video(tmp_path / "a.mkv", [frame_of(planes, pix_fmt)] * 2)
    (light, _) = open_pictures(tmp_path / "a.mkv", linear=True)
    expected = np.stack([red, green, blue], axis=2) / (2**bits - 1) @ [0.2126, 0.7152, 0.0722]
    assert np.abs(light - expected).max() < 1e-6


# Light: what the tags say, against the closed forms of the standards and their inverses.


def encode_pq(luminance):
    """The inverse EOTF of SMPTE ST 2084, for luminance in cd/m²."""
    m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 4096 * 128, 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
    power = (luminance / 10_000) ** m1
    return ((c1 + c2 * power) / (1 + c3 * power)) ** m2


def encode_hlg(light):
    """The OETF of ITU-R BT.2100, for light of the scene from 0 to 1."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(light <= 1 / 12, np.sqrt(3 * light), a * np.log(np.maximum(12 * light - b, 1e-9)) + c)


def test_pq_and_hlg_are_undone(tmp_path):
    light = np.linspace(0, 1, 1001)
    assert decode_pq(encode_pq(10_000 * light)) == pytest.approx(10_000 * light, rel=1e-5, abs=1e-4)
    assert decode_hlg(encode_hlg(light)) == pytest.approx(light, rel=1e-5, abs=1e-6)
    # ITU-R BT.2408: the reference white of 203 cd/m² is 58 % of PQ, and a card of 26.5 % of the light is 75 % of HLG.
    assert decode_pq(np.array([0.58])) == pytest.approx(203, rel=0.01)
    assert decode_hlg(np.array([0.75])) == pytest.approx(0.265, rel=0.01)


TRANSFERS = {
    "unspecified": (2, decode_srgb, "sRGB decoded"), "BT.709": (1, decode_srgb, "sRGB decoded"),
    "BT.601": (6, decode_srgb, "sRGB decoded"), "sRGB": (13, decode_srgb, "sRGB decoded"),
    "BT.2020": (14, decode_srgb, "sRGB decoded"), "BT.2020, 12 bits": (15, decode_srgb, "sRGB decoded"),
    "linear": (8, lambda v: v, "linear light"), "PQ": (16, decode_pq, "PQ decoded"),
    "HLG": (18, decode_hlg, "HLG decoded"),
    "gamma 2.2": (4, lambda v: v**2.2, "gamma 2.2 decoded"), "gamma 2.8": (5, lambda v: v**2.8, "gamma 2.8 decoded"),
}  # fmt: skip


@pytest.mark.parametrize(("number", "decode", "words"), TRANSFERS.values(), ids=TRANSFERS)
def test_light_is_decoded_by_the_tag_of_its_transfer(tmp_path, call, number, decode, words):
    luma = integers(12)
    tags = {"color_range": 1, "color_trc": number}
    write_video(tmp_path / "a.mkv", [frame_of([luma], "gray12le", **tags)] * 3, **tags)
    light = next(iter(open_pictures(tmp_path / "a.mkv")))
    assert light == pytest.approx(decode((luma - 256.0) / 3504), rel=1e-4)
    code, out, _ = call("encode", tmp_path / "a.mkv", "--out", tmp_path / "a.h5")
    assert (code, f"3 pictures at 25 Hz, {words}" in out) == (0, True)


@pytest.mark.parametrize("number", [7, 9, 10, 12, 17])
def test_light_that_cannot_be_decoded_is_refused_unless_it_is_stated_to_be_linear(tmp_path, number):
    luma = integers(12)
    tags = {"color_range": 1, "color_trc": number}
    write_video(tmp_path / "a.mkv", [frame_of([luma], "gray12le", **tags)] * 3, **tags)
    assert_says(refusal(open_pictures, tmp_path / "a.mkv"), "light is stored as | PQ, HLG | --linear")
    assert next(iter(open_pictures(tmp_path / "a.mkv", linear=True))) == pytest.approx((luma - 256.0) / 3504, abs=1e-6)


def test_wide_colours_have_the_weights_of_their_primaries(tmp_path):
    """A red and a green of BT.2020 and of P3."""
    planes = [np.zeros((16, 16), np.uint16) for _ in range(3)]
    planes[0][:, 8:], planes[2][:, :8] = 1023, 1023  # green on the right, red on the left
    for primaries, red, green in ((1, 0.2126, 0.7152), (9, 0.2627, 0.6780), (12, 0.2290, 0.6917)):
        write_video(tmp_path / "a.mkv", [frame_of(planes, "gbrp10le")] * 2, color_primaries=primaries)
        light = next(iter(open_pictures(tmp_path / "a.mkv")))
        assert light[0, [0, 15]] == pytest.approx([red, green], abs=1e-4)


# Damage: never a shorter stream.


def damage(tmp_path, name, change, **how):
    """Write 24 noisy pictures at 12 Hz, change the bytes, and return the refusal."""
    noise = np.random.default_rng(2).integers(0, 256, (24, 32, 32), np.uint8)
    write_video(tmp_path / name, list(noise), rate=12, **how)
    (tmp_path / name).write_bytes(change((tmp_path / name).read_bytes()))
    return refusal(open_pictures, tmp_path / name)


def halve(data):
    return data[: len(data) // 2]


def overwrite(data):
    middle = len(data) // 2
    return data[:middle] + bytes(200) + data[middle + 200 :]


FAST_START = {**H264, "muxing": {"movflags": "faststart"}}
FRAGMENTS = {**H264, "muxing": {"movflags": "frag_keyframe+empty_moov"}}
DAMAGE = {
    "half of an MP4": ("a.mp4", halve, FAST_START, "of 24 pictures can be read | the container states 2 s"),
    "a damaged MP4": ("a.mp4", overwrite, FAST_START, "a part of it is missing"),
    "an MP4 without its end": ("a.mp4", lambda data: data[:-2000], H264, "moov atom not found"),
    "an MP4 without its moov": ("a.mp4", lambda data: data.replace(b"moov", b"moon"), H264, "moov atom not found"),
    "half of a fragmented MP4": ("a.mp4", halve, FRAGMENTS, "pictures"),
    "a fragmented MP4 that lost one": (
        "a.mp4", lambda data: data.replace(b"moof", b"xxxx", 2).replace(b"xxxx", b"moof", 1),
        FRAGMENTS, "begins no part of an MP4",
    ),
    "half of a MOV": ("a.mov", halve, {**FAST_START, "codec": "libx264"}, "of 24 pictures can be read"),
    "half of a Matroska": ("a.mkv", halve, H264, "pictures can be read | the container states 2 s"),
    "a Matroska without its last bytes": ("a.mkv", lambda data: data[:-300], {}, "is damaged or cut off"),
    "a damaged Matroska": ("a.mkv", overwrite, {}, "is damaged or cut off"),
    "half of a WebM": ("a.webm", halve, {"codec": "libvpx-vp9", "pix_fmt": "yuv420p"}, "the container states 2 s"),
    "half of an AVI": ("a.avi", halve, MJPEG, "pictures can be read, up to"),
    "a damaged AVI": ("a.avi", overwrite, MJPEG, "is damaged or cut off"),
    "half of a transport stream": ("a.ts", lambda data: halve(data)[:-7], H264, "pictures can be read"),
    "a transport stream that lost packets": (
        "a.ts", lambda data: data[: 188 * 40] + data[188 * 45 :], H264, "is damaged or cut off",
    ),
    "half of a FLV": ("a.flv", halve, H264, "pictures can be read | the container states 2"),
    "half of a WMV": ("a.wmv", halve, {"codec": "wmv2", "pix_fmt": "yuv420p"}, "pictures can be read"),
    "nothing": ("a.mp4", lambda data: b"", H264, "cannot be decoded"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "change", "how", "says"), DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_or_short_file_is_refused_with_what_was_found(tmp_path, name, change, how, says):
    assert_says(damage(tmp_path, name, change, **how), says)


@pytest.mark.parametrize("ending", ["mkv", "mp4"])
def test_damage_is_found_wherever_the_file_is_cut(tmp_path, ending):
    """With checksums (FFV1) or a table of pictures (MP4), at each of 40 lengths."""
    how = {} if ending == "mkv" else FAST_START
    write_video(tmp_path / f"a.{ending}", GREYS, **how)
    data = (tmp_path / f"a.{ending}").read_bytes()
    for stop in np.linspace(1, len(data) - 1, 40).astype(int):
        (tmp_path / f"b.{ending}").write_bytes(data[:stop])
        refusal(open_pictures, tmp_path / f"b.{ending}")


# What else may be in a file.


def silence(number, rate=8000):
    """An eighth of a second."""
    frame = av.AudioFrame.from_ndarray(np.zeros((1, rate // 8), np.int16), format="s16", layout="mono")
    frame.sample_rate, frame.pts, frame.time_base = rate, number * (rate // 8), Fraction(1, rate)
    return frame


def write_streams(path, *, videos=1, sound=False, marks=()):
    """Write streams of 12 pictures at 12 Hz, each of its own level, with sound; ``marks`` are their dispositions."""
    with av.open(str(path), "w") as file:
        streams = [file.add_stream("ffv1", rate=12) for _ in range(videos)]
        for stream, mark in zip(streams, marks or [None] * videos, strict=True):
            stream.width = stream.height = 16
            stream.pix_fmt = "gray"
            if mark is not None:
                stream.disposition = mark
        heard = [file.add_stream("pcm_s16le", rate=8000, layout="mono")] if sound else []
        for number in range(12):
            for level, stream in enumerate(streams):
                frame = av.VideoFrame.from_ndarray(np.full((16, 16), 50 + 100 * level, np.uint8), format="gray")
                frame.pts, frame.time_base = number, Fraction(1, 12)
                file.mux(stream.encode(frame))
            for stream in heard:
                file.mux(stream.encode(silence(number)))
        for stream in (*streams, *heard):
            file.mux(stream.encode())


def test_sound_does_not_count(tmp_path):
    write_streams(tmp_path / "a.mkv", sound=True)
    assert len(list(open_pictures(tmp_path / "a.mkv"))) == 12
    write_streams(tmp_path / "a.mkv", sound=True, videos=0)
    assert_says(refusal(open_pictures, tmp_path / "a.mkv"), "has no moving pictures, but audio")


def test_of_two_streams_the_default_one_is_read_and_named(tmp_path):
    none, default = av.stream.Disposition(0), av.stream.Disposition.default
    for marks, level in (((default, none), 50), ((none, default), 150)):
        write_streams(tmp_path / "a.mkv", videos=2, marks=marks)
        pictures = open_pictures(tmp_path / "a.mkv", linear=True)
        assert [round(float(light.mean()) * 255) for light in pictures] == [level] * 12
        assert "of 2 streams of pictures, number " in pictures.notes[0]
    write_streams(tmp_path / "a.mkv", videos=2, marks=(default, default))
    assert_says(refusal(open_pictures, tmp_path / "a.mkv"), "has 2 streams of pictures | ffmpeg -i FILE -map 0:v:0")


def test_a_cover_is_no_video(tmp_path):
    """Matroska stores covers as attachments."""
    write_streams(tmp_path / "a.mkv", videos=0, sound=True)
    Image.new("RGB", (16, 16)).save(tmp_path / "cover.png")
    with av.open(str(tmp_path / "a.mkv")) as source, av.open(str(tmp_path / "b.mkv"), "w") as file:
        sound = file.add_stream_from_template(source.streams.audio[0])
        file.add_attachment("cover.png", "image/png", (tmp_path / "cover.png").read_bytes())
        for packet in source.demux(audio=0):
            if packet.dts is not None:
                packet.stream = sound
                file.mux(packet)
    assert_says(refusal(open_pictures, tmp_path / "b.mkv"), "has no moving pictures, but a cover and audio")


def test_interlaced_pictures_are_refused_with_the_next_step(tmp_path):
    with av.open(str(tmp_path / "a.ts"), "w") as file:
        stream = file.add_stream("libx264", rate=25, options={"x264-params": "tff=1"})
        stream.width = stream.height = 32
        stream.pix_fmt = "yuv420p"
        for number in range(12):
            frame = av.VideoFrame(32, 32, "yuv420p")
            frame.pts = number
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    assert_says(refusal(open_pictures, tmp_path / "a.ts"), "is interlaced | progressive | -vf bwdif")


def test_pictures_that_change_in_size_are_refused(tmp_path):
    """Two transport streams one after the other are a transport stream."""
    for number, size in enumerate((32, 48)):
        write_video(tmp_path / f"{number}.ts", [np.full((size, size), 90, np.uint8)] * 8, **H264)
    (tmp_path / "a.ts").write_bytes((tmp_path / "0.ts").read_bytes() + (tmp_path / "1.ts").read_bytes())
    assert "a.ts" in str(refusal(open_pictures, tmp_path / "a.ts"))


def test_pixels_that_are_not_square_are_named(tmp_path):
    def setup(stream):
        stream.codec_context.sample_aspect_ratio = Fraction(4, 3)

    write_video(tmp_path / "a.mp4", GREYS, setup=setup, **H264)
    pictures = open_pictures(tmp_path / "a.mp4")
    assert "a.mp4: its pixels are 4:3, and are taken as square" in pictures.notes
    assert "a.mp4: no tag states its colour matrix, which is assumed to be that of BT.601" in pictures.notes


def test_a_video_that_lies_at_an_angle_or_is_too_large_is_refused(tmp_path, monkeypatch):
    write_video(tmp_path / "a.mp4", GREYS, setup=lambda stream: stream.set_display_rotation(30), **H264)
    assert_says(refusal(open_pictures, tmp_path / "a.mp4"), "lies at an angle | 90")
    write_video(tmp_path / "a.mkv", GREYS)
    monkeypatch.setattr(module, "MAX_PIXELS", 100)
    assert_says(refusal(open_pictures, tmp_path / "a.mkv"), "has 16 × 16 pixels | at most 100")


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_video_that_a_phone_took_on_its_side_is_turned_upright(tmp_path, degrees, mirrored):
    """The angle is counterclockwise, as ffmpeg counts it; the mirror is applied after."""
    picture = np.zeros((32, 48), np.uint8) + 40
    picture[:16, :16] = 200  # the upper left corner

    def setup(stream):
        stream.set_display_rotation(degrees, hflip=mirrored)

    how = {**H264, "options": {"crf": "5"}}
    write_video(tmp_path / "a.mp4", [picture] * 4, setup=setup, **how)
    light = next(iter(open_pictures(tmp_path / "a.mp4", linear=True)))
    expected = np.rot90(picture, degrees // 90)
    expected = expected[:, ::-1] if mirrored else expected
    assert light.shape == expected.shape
    assert np.abs(light * 255 - expected).mean() < 6


def test_pictures_that_an_edit_list_cuts_off_do_not_count(tmp_path):
    """A copy that begins before its first shown picture, as a trimmed MP4 does."""
    write_video(tmp_path / "a.mp4", GREYS, rate=12, codec="libx264", pix_fmt="yuv420p", options={"bf": "0", "g": "12"})
    with (
        av.open(str(tmp_path / "a.mp4")) as source,
        av.open(str(tmp_path / "b.mp4"), "w", container_options={"avoid_negative_ts": "disabled"}) as file,
    ):
        stream = file.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                shift = round(5 / 12 / packet.time_base)
                packet.pts, packet.dts, packet.stream = packet.pts - shift, packet.dts - shift, stream
                file.mux(packet)
    pictures = open_pictures(tmp_path / "b.mp4", linear=True)
    assert pictures.rate_hz == 12
    assert np.array([light.mean() * 255 for light in pictures]) == pytest.approx(40 + 5 * np.arange(5, 12), abs=3)


PLAYLISTS = {
    "HLS": "#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\n{other}\n#EXT-X-ENDLIST\n",
    "HLS with a range": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n#EXT-X-BYTERANGE:9\n{other}\n",
    "HLS with a host": "#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n",
    "HLS of a script": "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nconcat:{other}|{other}\n#EXT-X-ENDLIST\n",
    "concat": "ffconcat version 1.0\nfile {other}\nduration 1\n", "concat, plain": "file '{other}'\n",
    "SDP": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
    "DASH": '<?xml version="1.0"?><MPD type="static"><Period><BaseURL>{other}</BaseURL></Period></MPD>',
    "Smooth": '<SmoothStreamingMedia MajorVersion="2"><StreamIndex Type="video" Url="{other}"/></SmoothStreamingMedia>',
    "RTSP": "rtsp://127.0.0.1:9/a\n", "images": "frame_%03d.png\n",
}  # fmt: skip


@pytest.mark.parametrize("ending", ["mp4", "m3u8", "ffconcat", "sdp", "mkv"])
@pytest.mark.parametrize("text", PLAYLISTS.values(), ids=PLAYLISTS)
def test_a_file_that_names_others_opens_none_of_them(tmp_path, text, ending, monkeypatch):
    other = tmp_path / "other.ts"
    write_video(other, GREYS, **H264)
    hostile = tmp_path / f"a.{ending}"
    hostile.write_text(text.format(other=other))
    assert "cannot be decoded" in refusal(open_pictures, hostile).problem


def test_grey_needs_no_matrix_of_colours(tmp_path):
    """PNG states the matrix of RGB for its grey pictures as well."""
    write_video(tmp_path / "a.mov", GREYS, codec="png", pix_fmt="gray")
    assert [round(light.mean() * 255) for light in open_pictures(tmp_path / "a.mov", linear=True)] == [
        40 + 5 * number for number in range(12)
    ]


def test_times_of_pictures_that_are_all_there_prove_no_damage(tmp_path):
    """With B-frames, the length of an MP4 is not the end of its last picture: here it is 20 ms more."""
    times = [Fraction(n, 90_000) for n in (0, 5850, 11700, 15300, 18750, 23850, 28500, 29550, 31200, 34950, 39000)]
    wave = 200 + 50 * np.sin(np.add.outer(3 * np.arange(20), 2 * np.arange(50)) / 50)
    pictures = [((0.3 + 0.06 * number) * wave).astype(np.uint8) for number in range(11)]
    codec = {"codec": "libx264", "pix_fmt": "yuv420p", "options": {"crf": "8"}}
    write_video(tmp_path / "a.mp4", pictures, times=times, tick=Fraction(1, 90_000), **codec)
    assert list(open_pictures(tmp_path / "a.mp4").times) == times
