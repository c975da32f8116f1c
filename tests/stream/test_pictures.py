"""Views of a stream: the right windows in each kind of file, together with plots of the known metadata."""

import html
import json
import re
from itertools import combinations

import numpy as np
import pytest
from browser import CHROMIUM, NO_CHROMIUM, run_in_page
from matplotlib.figure import Figure
from PIL import Image, ImageColor, ImageSequence
from refusals import assert_says, refusal

from saf_gen.benchmark.evaluate import score_blocks
from saf_gen.core.figure_style import assign_styles, use_plot_style
from saf_gen.stream.interval_texture import window_texture
from saf_gen.stream.pictures import write_view
from saf_gen.stream.pictures.movie import CURSOR, MovieCanvas
from saf_gen.stream.pictures.panels import draw_panels, stream_legends_height
from saf_gen.stream.pictures.timeline import BINS, choose_windows, describe_moment, read_timeline
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import write_stream

pytestmark = pytest.mark.usefixtures("readable_figures")

FRAMES, ROWS, COLUMNS, FLASH = 1_200, 20, 32, 700
BOX = (slice(5, 15), slice(8, 24))


@pytest.fixture(scope="module")
def stream(tmp_path_factory):
    """A sweep with its truth; half the array has twice the light of the other, and one readout ten times as much."""
    rate = np.where(np.arange(COLUMNS) < COLUMNS // 2, 0.2, 0.4)
    frames = np.random.default_rng(2).random((FRAMES, ROWS, COLUMNS)) < rate
    gain = np.ones((FRAMES, 2), np.float32)
    gain[FLASH, 0] = 10
    target = np.zeros((ROWS, COLUMNS), bool)
    target[BOX] = True
    path = tmp_path_factory.mktemp("view") / "sweep.h5"
    write_stream(
        path,
        frames,
        focus_position=(np.arange(FRAMES) + 0.5) / FRAMES,
        gain=gain,
        light_names=("lamp", "room"),
        truth={"position": 0.4, "depth_of_focus": (0.35, 0.45), "frame": 479.5, "target": target},
    )
    with open_stream(path) as opened:
        yield opened


@pytest.fixture
def bare(tmp_path):
    """A stream without metadata."""
    write_stream(tmp_path / "bare.h5", np.ones((40, 6, 10), np.uint8))
    with open_stream(tmp_path / "bare.h5") as opened:
        yield opened


def test_pictures_are_counts_textures_or_one_readout_of_evenly_spaced_windows(stream):
    counts = choose_windows(stream, first=100, stop=700, window=50, count=4)
    assert counts.starts.tolist() == [100, 283, 466, 650]
    assert counts.centres[0] == 124.5
    assert np.array_equal(counts.linear(1), stream.counts(283, 333))
    textures = choose_windows(stream, kind="tfi", window=50, every=400)
    assert textures.starts.tolist() == [0, 400, 800]
    assert np.array_equal(textures.linear(2), window_texture(stream.packed, stream.counts, first=800, stop=850))
    spikes = choose_windows(stream, kind="spikes", window=51, count=1)
    assert np.array_equal(list(spikes), 255 * stream.frames(25, 26))


def test_a_short_view_has_windows_of_a_tenth(stream):
    assert choose_windows(stream, stop=395).window == 40
    at = choose_windows(stream, at=[900.0, 4.0, 1199.0])  # the middles, as nearly as the recording allows
    assert at.starts.tolist() == [0, 850, 1100]
    assert choose_windows(stream, stop=3).window == 1
    assert choose_windows(stream, stop=1_000).window == choose_windows(stream).window == 100


@pytest.mark.parametrize("size", [(300, 20), (4, 900)])
def test_a_screen_holds_a_picture_of_any_shape(tmp_path, size):
    write_stream(tmp_path / "odd.h5", np.random.default_rng(1).integers(0, 2, (30, *size), np.uint8))
    with open_stream(tmp_path / "odd.h5") as odd:
        timeline = read_timeline(odd, first=0, stop=30, window=3)
        width, height = MovieCanvas(choose_windows(odd), timeline, region=None).size
    assert width <= 800 + 380
    assert height <= 800 + 26


def test_half_the_light_is_as_dark_in_every_picture(stream):
    """Counts of 20 and 40 in 100 frames: the ratio of grey values is that of the light to the power of 1/2.2."""
    for picture in choose_windows(stream, count=3):
        dark, bright = picture[:, :16].mean(), picture[:, 16:].mean()
        assert dark / bright == pytest.approx(0.5 ** (1 / 2.2), abs=0.02)


class Watched:
    """A stream that notes which counts are asked for."""

    def __init__(self, stream):
        self.stream, self.read = stream, []

    def __getattr__(self, name):
        return getattr(self.stream, name)

    def counts(self, first, stop, **how):
        self.read.append((first, stop))
        return self.stream.counts(first, stop, **how)


def test_a_long_recording_is_read_window_by_window(stream):
    """A view of 1,200 frames reads one window at a time, and only the windows that it draws and scores."""
    watched = Watched(stream)
    assert len(list(choose_windows(watched, window=20, count=30))) == 30
    read_timeline(watched, first=0, stop=FRAMES, window=20, measures=["sd"])
    assert {stop - first for first, stop in watched.read} == {20}
    assert len(watched.read) == 12 + 30 + 2 * 60


def test_scores_next_to_pictures_are_those_of_the_methods(stream):
    for measure in ("sd", "sd_debiased", "tenengrad_tfi", "sd_calibrated"):
        timeline = read_timeline(stream, first=0, stop=FRAMES, window=100, measures=[measure], region=BOX)
        first, scores = score_blocks(stream, measure, window=100, region="target")
        assert timeline.centres.tolist() == (first + 49.5).tolist()
        assert timeline.scores[measure].tolist() == scores.tolist()


def test_a_flash_of_one_readout_is_drawn_however_long_the_view(stream):
    timeline = read_timeline(stream, first=0, stop=FRAMES, window=100)
    lamp = timeline.gains["lamp"]
    assert len(lamp.frames) == BINS < FRAMES
    assert (lamp.low.max(), lamp.high.max()) == (1, 10)
    assert abs(lamp.frames[lamp.high.argmax()] - FLASH) <= 1.5
    assert timeline.rate == pytest.approx(0.3, abs=0.01)
    assert timeline.truth.low == pytest.approx(0.4)
    assert timeline.depth_of_focus == pytest.approx((-0.05, 0.05)) == timeline.whole_target


def test_a_moment_is_described_in_words(stream, bare):
    # Frames 540 to 639: the lens is at 590/1,200, which is 0.0917 travels or 0.9 depths of focus from 0.4.
    assert describe_moment(stream, first=540, window=100) == "frames 540–639 · lens 0.492 · +0.9 DoF · from 27.0 ms"
    assert describe_moment(bare, first=3, window=1) == "frame 3 · from 0.1 ms"


@pytest.mark.slow
def test_each_kind_of_figure_is_one_column_wide_and_the_same_again(stream, tmp_path):
    for name in ("a.png", "b.png", "a.svg", "b.svg"):
        write_view(stream, tmp_path / name, measures=["sd"], window=50, every=1_150)
    for form in ("png", "svg"):
        assert (tmp_path / f"a.{form}").read_bytes() == (tmp_path / f"b.{form}").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.size[0] == 3.5 * 300


@pytest.mark.slow
def test_what_is_not_known_leaves_no_empty_plot(bare, stream, tmp_path):
    for opened, known in ((stream, True), (bare, False)):
        write_view(opened, tmp_path / "a.svg", window=20)
        svg = (tmp_path / "a.svg").read_text()
        assert (">position<" in svg, ">spikes per readout<" in svg) == (known, True)


@pytest.mark.slow
def test_a_gif_has_a_frame_for_each_picture_and_the_rate_asked_for(stream, tmp_path):
    write_view(stream, tmp_path / "a.gif", every=100, fps=8, measures=["sd"])
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 12
        assert {frame.info["duration"] for frame in ImageSequence.Iterator(image)} == {120}  # hundredths of a second
        image.seek(5)
        screen = np.asarray(image.convert("RGB"), int)
    pictures = choose_windows(stream, every=100)
    expected = np.kron(list(pictures)[5], np.ones((13, 13)))[:240, :300]
    # Outside the box; the GIF has 200 greys, of which Pillow chooses a near one, not always the nearest.
    assert np.abs(screen[:240, :300].mean(axis=2) - expected)[:60, :100].max() <= 4


def lit(path, names):
    """Write a stream with these lights, which have different gains, and open it."""
    gain = np.arange(1, len(names) + 1) + 0.3 * np.sin(np.arange(300)[:, None] / 20) + 1
    spikes = np.random.default_rng(2).integers(0, 2, (300, ROWS, COLUMNS), np.uint8)
    write_stream(path, spikes, gain=gain.astype(np.float32), light_names=names)
    return open_stream(path)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["gif", "png"])
def test_each_of_many_lights_with_long_names_has_its_own_colour(tmp_path, form):
    """Matplotlib would warn if the legend left no room for the plot.

    Only the plot of the lights is drawn; nothing else in it is as near to the colour of a light.
    """
    names = [f"emit-lamp_over_the_bench_{n}" for n in range(8)]
    with lit(tmp_path / "it.h5", names) as stream:
        write_view(stream, tmp_path / f"it.{form}", every=100)
    with Image.open(tmp_path / f"it.{form}") as image:
        screens = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(image)]
    wanted = np.array([ImageColor.getrgb(style.colour) for style in assign_styles(["lens", *names]).values()])[1:]
    for screen in screens:
        seen = np.unique(screen.reshape(-1, 3), axis=0).astype(int)
        drawn = np.array([seen[np.abs(seen - colour).sum(axis=1).argmin()] for colour in wanted])
        assert np.abs(drawn - wanted).sum(axis=1).max() < 20
        assert min(np.abs(a - b).sum() for a, b in combinations(drawn, 2)) > 60


@pytest.mark.slow
@pytest.mark.parametrize(("width", "ending"), [(3.5, "_over_the_bench"), (4.4, "")])
def test_the_names_of_lights_are_in_the_picture_above_a_plot_of_useful_size(tmp_path, width, ending):
    with lit(tmp_path / "it.h5", [f"daylight_{n}{ending}" for n in range(8)]) as stream, use_plot_style():
        timeline = read_timeline(stream, first=0, stop=300, window=30)
        figure = Figure((width, 1.2 + stream_legends_height(timeline, width=width)), layout="constrained")
        (axes,) = draw_panels(figure, timeline)
        figure.draw_without_rendering()
    legend, plot = axes.get_legend().get_window_extent(), axes.get_window_extent()
    assert (legend.x1 <= figure.bbox.x1, legend.y1 <= figure.bbox.y1) == (True, True)
    assert plot.width > 0.6 * figure.bbox.width
    assert plot.height > 0.3 * figure.dpi


def test_the_cursor_goes_as_frames_go(stream):
    pictures = choose_windows(stream, window=100, count=5)
    canvas = MovieCanvas(pictures, read_timeline(stream, first=0, stop=FRAMES, window=100), region=None)
    seen = []
    for image in canvas:
        assert image.shape == (canvas.size[1], canvas.size[0], 3)
        seen.append(np.flatnonzero((image == CURSOR).all(axis=2).sum(axis=0) > 50).min())
    steps = np.diff(seen) / np.diff(pictures.centres)
    assert steps == pytest.approx(steps.mean(), rel=0.02)


@pytest.mark.slow
def test_a_page_stands_alone_and_holds_every_picture(stream, tmp_path):
    write_view(stream, tmp_path / "index.html", every=100, measures=["sd"])
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=\"(?!data:|#)", page)
    assert 'src="data:image/jpeg;base64,' in page
    play = json.loads(html.unescape(re.search(r'data-play="([^"]+)"', page)[1]))
    assert len(play["words"]) == len(play["x"]) == 12
    assert np.diff(play["x"]) == pytest.approx(np.diff(play["x"])[0], abs=1e-3)


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)
def test_a_page_is_scrubbed_by_keys_and_by_the_plots(stream, tmp_path):
    write_view(stream, tmp_path / "index.html", every=100, measures=["sd"])
    script = """
    const text = page.querySelector("output"), slider = page.querySelector("input"), plot = page.querySelector(".plot");
    const at = () => [text.value.split(" ")[1], slider.value, page.querySelector(".cursor").style.left];
    const key = (name) => page.dispatchEvent(new window.KeyboardEvent("keydown", { key: name }));
    const seen = [at()];
    key("ArrowRight"); seen.push(at());
    key("ArrowLeft"); key("ArrowLeft"); seen.push(at());
    const box = plot.getBoundingClientRect();
    plot.dispatchEvent(new window.PointerEvent("pointermove", { pointerType: "mouse", clientX: box.right }));
    seen.push(at());
    key(" "); const playing = page.querySelector("button").textContent; key(" ");
    return { seen, playing, wide: page.documentElement.scrollWidth, ratio: page.querySelector(".view").offsetWidth };
    """
    answer = run_in_page(tmp_path, script, width=390)
    # It starts at the picture nearest to the focus, at frame 479.5.
    assert [moment[1] for moment in answer["seen"]] == ["4", "5", "3", "11"]
    assert [moment[0] for moment in answer["seen"]] == ["400–499", "500–599", "300–399", "1,100–1,199"]
    assert answer["playing"] == "Stop"
    assert answer["wide"] <= 390
    assert answer["ratio"] >= 350


MEASURES = ["sd", "variance", "brenner", "entropy", "tenengrad", "er_count", "er_sumsq", "vollath_f4", "vollath_f5"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"name": "a.txt"}, "unknown kind of file '.txt' | .gif, .html, .png, .svg"),
        ({"name": "a.pngg"}, "did you mean '.png'?"),
        ({"kind": "tfq"}, "unknown kind of picture 'tfq' | did you mean"),
        ({"first": 1_200}, "frames 1200 to 1200 were asked for"),
        ({"window": 101, "stop": 100}, "a window of 101 frames in a view of 100 | allowed: 1 to 100"),
        ({"window": 0}, "window is 0"),
        ({"every": 0}, "every is 0"),
        ({"every": 1}, "1101 pictures | at most 48 | --every 23"),  # 1101/23 is 48
        ({"measures": ["sdd"]}, "unknown focus measure 'sdd' | did you mean 'sd'?"),
        ({"measures": ["sd_debiased"], "window": 1}, "has no halves"),
        ({"region": "box"}, "unknown region 'box'"),
        ({"fps": 0.0}, "0 pictures per second"),
        ({"measures": MEASURES}, "9 measures | at most 8"),
    ],
)
def test_what_cannot_be_drawn_is_one_line_and_nothing_is_written(stream, tmp_path, options, message):
    name = options.pop("name", "a.png")
    assert_says(refusal(write_view, stream, tmp_path / name, **options), message)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_command_draws_what_its_options_say(stream, tmp_path, call):
    code, out, err = call(
        "view", stream.path, "--as", "tfi", "--window", 60, "--from", 200, "--to", 800, "--every", 100,
        "--measure", "sd", "--measure", "sd_tfi", "--region", "frame", "--out", tmp_path / "a.png",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert out == f"6 pictures of 60 frames each in {tmp_path / 'a.png'}\n"
    code, _, err = call("view", tmp_path / "none.h5", "--out", tmp_path / "b.png")
    assert (code, "there is no such file" in err) == (2, True)
