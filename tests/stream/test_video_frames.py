"""Videos of others: their times, values, light, and damage, each against what PyAV has written."""

from fractions import Fraction
from itertools import accumulate

import av
import numpy as np
import pytest
from refusals import assert_says, refusal
from videos import frame_of, write_video

from saf_gen.camera import get_sensor
from saf_gen.stream.interop.encode_pictures import prepare_pictures
from saf_gen.stream.interop.linear_light import decode_bt709, decode_srgb
from saf_gen.stream.interop.picture_frames import open_pictures

IDEAL = get_sensor("ideal")
GREYS = [np.full((16, 16), 40 + 5 * number, np.uint8) for number in range(12)]
MJPEG = {"codec": "mjpeg", "pix_fmt": "yuvj420p"}
H264 = {"codec": "libx264", "pix_fmt": "yuv420p", "options": {"g": "4", "bf": "2"}}
VP9 = {"codec": "libvpx-vp9", "pix_fmt": "yuv420p"}
VARIED = [
    *accumulate([Fraction(n, 1000) for n in (33, 34, 500, 10, 33, 250, 17, 33, 90, 500, 500)], initial=Fraction(0))
]

# The times are those that the file states, to the digits that it has; only exactly equal steps are a rate.
TIMES = {
    "whole": ("a.mp4", H264, {"rate": 25}, 25),
    "film": ("a.mp4", H264, {"rate": Fraction(24000, 1001)}, Fraction(24000, 1001)),
    "slow motion": ("a.mov", H264, {"rate": 240}, 240),
    "10000": ("a.mp4", {**H264, "muxing": {"video_track_timescale": "10000"}}, {"rate": 10_000}, 10_000),
    "whole, Matroska": ("a.mkv", {}, {"rate": 50}, 50),
    "rounded to ms": ("a.mkv", H264, {"rate": Fraction(24000, 1001)}, None),
    "AVI": ("a.avi", MJPEG, {"rate": 50}, 50),
    "variable": ("a.mp4", H264, {"times": VARIED, "tick": Fraction(1, 90_000)}, None),
    "variable, WebM": ("a.webm", VP9, {"times": VARIED, "tick": Fraction(1, 1000)}, None),
    "late start": ("a.mp4", H264, {"times": [5 + t for t in VARIED], "tick": Fraction(1, 1000)}, None),
}


@pytest.mark.parametrize(("name", "how", "when", "rate"), TIMES.values(), ids=TIMES)
def test_times_are_those_that_were_written(tmp_path, name, how, when, rate):
    write_video(tmp_path / name, GREYS, **how, **when)
    pictures = open_pictures(tmp_path / name, transfer="srgb")
    assert pictures.rate_hz == rate
    expected = [n / Fraction(when["rate"]) for n in range(12)] if "rate" in when else VARIED
    error = max(abs(time - wanted) for time, wanted in zip(pictures.times, expected, strict=True))
    assert error <= (Fraction(1, 2000) if name.endswith("mkv") else Fraction(1, 80_000))
    plan = prepare_pictures(pictures, IDEAL)
    assert abs(plan.frames - int(expected[-1] * 20_000)) <= (10 if name.endswith("mkv") else 0)


def test_times_that_do_not_increase_are_refused_and_a_rate_overrides_them(tmp_path, call):
    """Matroska rounds to ms, so that two of these pictures come at the same one."""
    times = [Fraction(n, 10_000) for n in (0, 100, 200, 202, 300, 400, 500, 600, 700, 800, 900, 1000)]
    write_video(tmp_path / "a.mkv", GREYS, times=times, tick=Fraction(1, 10_000))
    code, _, err = call("encode", tmp_path / "a.mkv", "--out", tmp_path / "a.h5", "--linear")
    assert code == 2
    assert "picture 4 is at 0.02 s, and picture 3 at 0.02 s" in err
    code, out, err = call("encode", tmp_path / "a.mkv", "--out", tmp_path / "a.h5", "--rate", "24000/1001", "--linear")
    assert code == 0
    assert "12 pictures at 24000/1001 Hz (23.976)" in out
    assert "a.mkv: its pictures at times 0 to 10 ms apart are taken to be at 24000/1001 Hz (23.976) (--rate)" in err


def test_a_video_of_one_picture_is_a_scene_at_rest(tmp_path):
    write_video(tmp_path / "a.mp4", GREYS[:1], **H264)
    pictures = open_pictures(tmp_path / "a.mp4", transfer="srgb")
    assert_says(refusal(prepare_pictures, pictures, IDEAL), "is a single picture | --frames N")
    assert prepare_pictures(pictures, IDEAL, frames=50).frames == 50


def test_a_container_without_times_is_refused_with_the_next_step(tmp_path):
    write_video(tmp_path / "a.h264", GREYS, **H264)
    assert_says(refusal(open_pictures, tmp_path / "a.h264"), "in none of the containers | Matroska | -c:v ffv1 NEW.mkv")


# Values: 8 bits, whatever the format of the pixels.


def reference_rgb(planes, *, full, matrix):
    """The equations of BT.601, BT.709 and BT.2020 in float64, for chroma of the size of luma."""
    kr, kb = {1: (0.2126, 0.0722), 6: (0.299, 0.114), 9: (0.2627, 0.0593)}[matrix]
    y, u, v = (plane.astype(float) for plane in planes)
    if full:
        y, u, v = y / 255, (u - 128) / 255, (v - 128) / 255
    else:
        y, u, v = (y - 16) / 219, (u - 128) / 224, (v - 128) / 224
    red, blue = y + 2 * (1 - kr) * v, y + 2 * (1 - kb) * u
    return np.stack([red, (y - kr * red - kb * blue) / (1 - kr - kb), blue], axis=2)


def integers(seed=0, kind=np.uint8):
    """Values of limited range around grey, so that no colour leaves RGB."""
    return np.random.default_rng(seed).integers(100, 150, (16, 16)).astype(kind)


@pytest.mark.parametrize("matrix", [1, 6, 9], ids=["BT.709", "BT.601", "BT.2020"])
@pytest.mark.parametrize("full", [False, True], ids=["limited", "full"])
def test_colours_follow_the_matrix_and_range_that_are_stated(tmp_path, full, matrix):
    planes = [integers(seed) for seed in range(3)]
    tags = {"colorspace": matrix, "color_range": 2 if full else 1}
    write_video(tmp_path / "a.mkv", [frame_of(planes, "yuv444p", **tags)] * 2, **tags)
    (light, _) = open_pictures(tmp_path / "a.mkv", linear=True)
    rgb = np.clip(reference_rgb(planes, full=full, matrix=matrix), 0, 1)
    assert np.abs(light - rgb @ [0.2126, 0.7152, 0.0722]).max() * 255 < 1.5


@pytest.mark.parametrize(("transfer", "matrix", "name"), [("srgb", 6, "BT.601"), ("bt709", 1, "BT.709")])
def test_a_matrix_that_is_not_stated_is_that_of_the_transfer(tmp_path, transfer, matrix, name):
    planes = [integers(seed) for seed in range(3)]
    write_video(tmp_path / "a.mkv", [frame_of(planes, "yuv444p", color_range=1)] * 2, color_range=1)
    pictures = open_pictures(tmp_path / "a.mkv", transfer=transfer)
    decode = {"srgb": decode_srgb, "bt709": decode_bt709}[transfer]
    expected = decode(reference_rgb(planes, full=False, matrix=matrix)) @ [0.2126, 0.7152, 0.0722]
    assert next(iter(pictures)) == pytest.approx(expected, abs=0.01)
    assert pictures.notes == (f"a.mkv: no tag states its colour matrix, which is taken to be that of {name}",)


@pytest.mark.parametrize("pix_fmt", ["gray", "bgra"])
def test_every_value_of_grey_and_rgb_is_kept(tmp_path, pix_fmt):
    """Alpha is zero, and is ignored."""
    channels = dict(zip("rgba", [*(integers(seed) for seed in range(3)), np.zeros((16, 16), np.uint8)], strict=True))
    order = [channels[name] for name in pix_fmt if name in channels]
    planes = [channels["r"] if pix_fmt == "gray" else np.stack(order, axis=2).reshape(16, -1)]
    write_video(tmp_path / "a.mkv", [frame_of(planes, pix_fmt)] * 2)
    (light, _) = open_pictures(tmp_path / "a.mkv", linear=True)
    shown = [channels["r"]] * 3 if pix_fmt == "gray" else [channels[name] for name in "rgb"]
    assert np.abs(light - np.stack(shown, axis=2) / 255 @ [0.2126, 0.7152, 0.0722]).max() < 1e-6


def test_wide_colours_have_the_weights_of_their_primaries(tmp_path):
    """A red and a green of BT.709, BT.2020 and P3."""
    picture = np.zeros((16, 16, 3), np.uint8)
    picture[:, :8, 0], picture[:, 8:, 1] = 255, 255
    for primaries, red, green in ((1, 0.2126, 0.7152), (9, 0.2627, 0.6780), (12, 0.2290, 0.6917)):
        write_video(tmp_path / "a.mkv", [picture] * 2, pix_fmt="bgr0", color_primaries=primaries)
        light = next(iter(open_pictures(tmp_path / "a.mkv", transfer="srgb")))
        assert light[0, [0, 15]] == pytest.approx([red, green], abs=1e-4)


UNREAD = {
    "10 bits": ("yuv420p10le", np.uint16, {}, "format yuv420p10le | FOLDER/%06d.tif"),
    "16 bits of grey": ("gray16le", np.uint16, {}, "format gray16le | 8 bits"),
    "grey of limited range": ("gray", np.uint8, {"color_range": 1}, "grey of limited range"),
    "a matrix of another colour space": ("yuv444p", np.uint8, {"colorspace": 8}, "states the matrix 8"),
    "primaries of film": ("yuv444p", np.uint8, {"color_primaries": 8}, "states the primaries 8"),
}


@pytest.mark.parametrize("name", UNREAD)
def test_values_that_are_not_read_are_one_line(tmp_path, name):
    pix_fmt, kind, tags, says = UNREAD[name]
    planes = [integers(kind=kind)] + [integers(kind=kind)[:8, :8] if "420" in pix_fmt else integers()] * 2
    write_video(tmp_path / "a.mkv", [frame_of(planes[: 1 if "gray" in pix_fmt else 3], pix_fmt, **tags)] * 3, **tags)
    assert_says(refusal(open_pictures, tmp_path / "a.mkv", transfer="srgb"), says)


# Light: what the tags say, or the user.

TRANSFERS = {
    "BT.709": (1, decode_bt709, "BT.709 decoded"), "BT.601": (6, decode_bt709, "BT.709 decoded"),
    "BT.2020": (14, decode_bt709, "BT.709 decoded"), "sRGB": (13, decode_srgb, "sRGB decoded"),
}  # fmt: skip


@pytest.mark.parametrize(("number", "decode", "words"), TRANSFERS.values(), ids=TRANSFERS)
def test_light_is_decoded_by_the_tag_of_its_transfer(tmp_path, call, number, decode, words):
    tags = {"color_range": 2, "color_trc": number}
    write_video(tmp_path / "a.mkv", [frame_of([integers()], "gray", **tags)] * 3, **tags)
    light = next(iter(open_pictures(tmp_path / "a.mkv")))
    assert light == pytest.approx(decode(integers() / 255), rel=1e-4)
    code, out, _ = call("encode", tmp_path / "a.mkv", "--out", tmp_path / "a.h5")
    assert (code, f"3 pictures at 25 Hz, {words}" in out) == (0, True)


def test_bt709_is_the_inverse_of_the_curve_of_a_camera():
    """ITU-R BT.709, 1.2: light of 18 % is 40.9 % of the signal."""
    light = np.linspace(0, 1, 1001)
    signal = np.where(light < 0.018, 4.5 * light, 1.099 * np.maximum(light, 1e-9) ** 0.45 - 0.099)
    assert decode_bt709(signal) == pytest.approx(light, abs=2e-4)
    assert float(decode_bt709(np.array(0.409))) == pytest.approx(0.18, abs=1e-3)


def test_a_transfer_that_is_not_stated_is_asked_for(tmp_path, call):
    write_video(tmp_path / "a.mkv", GREYS)
    ask = ("encode", tmp_path / "a.mkv", "--out", tmp_path / "a.h5")
    code, _, err = call(*ask)
    assert (code, err.count("\n"), (tmp_path / "a.h5").exists()) == (2, 1, False)
    assert "--transfer srgb, --transfer bt709, or --linear" in err
    for options, words in (
        (("--transfer", "srgb"), "sRGB"), (("--transfer", "bt709"), "BT.709"), (("--linear",), "linear")
    ):  # fmt: skip
        code, out, _ = call(*ask, *options)
        assert (code, words in out) == (0, True)
    code, _, err = call(*ask, "--transfer", "pq")
    assert (code, "srgb" in err, err.count("\n")) == (2, True, 1)
    code, _, err = call(*ask, "--transfer", "srgb", "--linear")
    assert (code, "one of them" in err) == (2, True)


@pytest.mark.parametrize("number", [4, 7, 8, 16, 18], ids=["gamma 2.2", "240M", "linear", "PQ", "HLG"])
def test_another_transfer_is_refused_unless_the_user_states_one(tmp_path, number):
    tags = {"color_range": 2, "color_trc": number}
    write_video(tmp_path / "a.mkv", [frame_of([integers()], "gray", **tags)] * 3, **tags)
    assert_says(refusal(open_pictures, tmp_path / "a.mkv"), f"states the transfer {number} | sRGB or BT.709")
    assert next(iter(open_pictures(tmp_path / "a.mkv", linear=True))) == pytest.approx(integers() / 255, abs=1e-6)


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
    "half of an MP4": ("a.mp4", halve, FAST_START, "of 24 pictures can be read"),
    "an MP4 without its end": ("a.mp4", lambda data: data[:-2000], H264, "moov atom not found"),
    "half of a fragmented MP4": ("a.mp4", halve, FRAGMENTS, "pictures"),
    "a fragmented MP4 that lost one": (
        "a.mp4", lambda data: data.replace(b"moof", b"xxxx", 2).replace(b"xxxx", b"moof", 1),
        FRAGMENTS, "begins no part of an MP4",
    ),
    "half of a Matroska": ("a.mkv", halve, H264, "pictures can be read"),
    "a Matroska without its last bytes": ("a.mkv", lambda data: data[:-300], {}, "is damaged or cut off"),
    "a damaged Matroska": ("a.mkv", overwrite, {}, "is damaged or cut off"),
    "half of a WebM": ("a.webm", halve, VP9, "pictures can be read"),
    "half of an AVI": ("a.avi", halve, MJPEG, "pictures can be read"),
    "a damaged AVI": ("a.avi", overwrite, MJPEG, "is damaged or cut off"),
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


def write_streams(path, *, videos):
    """Write streams of 12 pictures at 12 Hz, each of its own level, with sound."""
    with av.open(str(path), "w") as file:
        streams = [file.add_stream("ffv1", rate=12) for _ in range(videos)]
        sound = file.add_stream("pcm_s16le", rate=8000, layout="mono")
        for stream in streams:
            stream.width, stream.height, stream.pix_fmt = 16, 16, "gray"
        for number in range(12):
            for level, stream in enumerate(streams):
                frame = av.VideoFrame.from_ndarray(np.full((16, 16), 50 + 100 * level, np.uint8), format="gray")
                frame.pts, frame.time_base = number, Fraction(1, 12)
                file.mux(stream.encode(frame))
            heard = av.AudioFrame.from_ndarray(np.zeros((1, 1000), np.int16), format="s16", layout="mono")
            heard.sample_rate, heard.pts, heard.time_base = 8000, number * 1000, Fraction(1, 8000)
            file.mux(sound.encode(heard))
        for stream in (*streams, sound):
            file.mux(stream.encode())


def test_a_file_has_one_stream_of_pictures(tmp_path):
    write_streams(tmp_path / "a.mkv", videos=1)
    assert len(list(open_pictures(tmp_path / "a.mkv"))) == 12
    write_streams(tmp_path / "a.mkv", videos=0)
    assert_says(refusal(open_pictures, tmp_path / "a.mkv"), "has 0 streams of moving pictures")
    write_streams(tmp_path / "a.mkv", videos=2)
    assert_says(refusal(open_pictures, tmp_path / "a.mkv"), "has 2 streams | ffmpeg -i FILE -map 0:v:0")


def test_interlaced_pictures_are_refused_with_the_next_step(tmp_path):
    with av.open(str(tmp_path / "a.mkv"), "w") as file:
        stream = file.add_stream("libx264", rate=25, options={"x264-params": "tff=1"})
        stream.width = stream.height = 32
        stream.pix_fmt = "yuv420p"
        for number in range(12):
            frame = av.VideoFrame(32, 32, "yuv420p")
            frame.pts = number
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    assert_says(refusal(open_pictures, tmp_path / "a.mkv"), "is interlaced | progressive | -vf bwdif")


def test_pixels_that_are_not_square_are_named(tmp_path):
    def setup(stream):
        stream.codec_context.sample_aspect_ratio = Fraction(4, 3)

    write_video(tmp_path / "a.mp4", GREYS, setup=setup, **H264)
    pictures = open_pictures(tmp_path / "a.mp4")
    assert "a.mp4: its pixels are 4:3, and are taken as square" in pictures.notes


def test_a_video_that_lies_at_an_angle_or_is_too_large_is_refused(tmp_path):
    write_video(tmp_path / "a.mp4", GREYS, setup=lambda stream: stream.set_display_rotation(30), **H264)
    assert_says(refusal(open_pictures, tmp_path / "a.mp4"), "lies at an angle | 90")
    write_video(tmp_path / "a.mkv", np.zeros((2, 2_048, 2_064), np.uint8))
    assert_says(refusal(open_pictures, tmp_path / "a.mkv"), "has 2064 × 2048 pixels | at most 4194304")


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
    other = tmp_path / "other.mkv"
    write_video(other, GREYS, **H264)
    hostile = tmp_path / f"a.{ending}"
    hostile.write_text(text.format(other=other))
    assert "cannot be decoded" in refusal(open_pictures, hostile).problem
