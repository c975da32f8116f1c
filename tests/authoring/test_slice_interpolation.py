"""The error of interpolating between time slices, compared with closed forms, and the check's findings."""

import re

import numpy as np
import pytest
from refusals import refusal
from small_dataset import DRIVE
from written_scenes import VARIANT, write_scene

from saf_gen.authoring.checks import SceneUnderTest, check_slices, pictures
from saf_gen.authoring.checks.pictures import SliceMismatch, _measure_mismatch
from saf_gen.camera import get_sensor
from saf_gen.scene.scene_folder import find_scene

SENSOR = get_sensor("vidar_400x250", rows=6, columns=146)  # all rows show the same
FOOTPRINT_M = 20e-6 * 0.5 / float(DRIVE.image_distance(DRIVE.best_position(0.5)))
PERIOD = 7.3  # pixels; the frame has 20 periods, whose edges are at every twentieth of a pixel
SLICES = 500  # per second


@pytest.fixture
def stripes(tmp_path, monkeypatch):
    """A function that moves stripes of 0.2 and 0.8, in focus under an even sky, along the rows.

    ``step`` is in pixels per time slice; ``more`` are more lines of the card.
    """
    periods = 130  # enough to fill the frame at all times
    texture = f"mi.Bitmap(np.tile(np.array([0.2, 0.8], dtype='float32'), (2, {periods})))"
    shapes = (
        f"{{'plane': {{'type': 'rectangle',"
        f" 'to_world': t.rotate([0, 1, 0], 180).scale({periods * PERIOD / 2 * FOOTPRINT_M}),"
        " 'bsdf': {'type': 'diffuse', 'reflectance': {'type': 'bitmap', 'raw': True,"
        f" 'filter_type': 'nearest', 'bitmap': {texture}}}}}}}, 'sky': {{'type': 'constant'}}}}"
    )
    scene = write_scene(tmp_path, monkeypatch, shapes=shapes, light="sky", target="plane")
    card = scene.folder / "scene.yaml"
    still = card.read_text()

    def moved(step, *, key="translate_m", slices=SLICES, more="", sensor=SENSOR):
        half = step * SLICES * FOOTPRINT_M / 2
        ends = [f"[{x}, 0, 0]" for x in (-half, half)] if key == "translate_m" else (0, step)
        keyframes = f"[{{time_s: 0, {key}: {ends[0]}}}, {{time_s: 1, {key}: {ends[1]}}}]"
        card.write_text(f"{still}motion: {{plane: {{keyframes: {keyframes}}}}}\nslices_per_s: {slices}\n{more}")
        return SceneUnderTest(find_scene("made"), sensor, backend=VARIANT)

    return moved


@pytest.mark.parametrize("step", [0.4, 0.9])
def test_the_error_of_stripes_is_the_closed_form(stripes, step):
    """An edge that crosses a box pixel is a ramp one pixel wide. The mean of two ramps that are d <= 1 apart differs
    from the ramp halfway between them by triangles where the ramps bend, whose squares add up to d³/24 of the squared
    height. With two edges per period P, rms = height · √(d³/(12·P)).
    """
    error = _measure_mismatch(stripes(step), 0.5)
    expected = 0.6 / 0.5 * np.sqrt(step**3 / (12 * PERIOD))
    assert error.rms(3) - error.rms(-3) < 0.2 * expected
    assert error.rms() == pytest.approx(expected, rel=0.03)


def test_a_region_is_that_part_of_the_picture(stripes):
    """Stripes are turned by 30 degrees, so that no two rows or columns are alike."""
    renderer = stripes(30, key="rotate_deg", sensor=get_sensor("vidar_400x250", rows=30, columns=146)).renderer
    rows, columns = slice(4, 19), slice(31, 97)
    whole, part = (
        renderer.render_region(0.46, samples=128, region=region, time_s=1.0)
        for region in ((slice(0, 30), slice(0, 146)), (rows, columns))
    )
    assert part.shape == (15, 66)
    assert np.abs(part - whole[rows, columns]).mean() < 0.02
    assert np.abs(part - whole[5:20, columns]).mean() > 0.05


def test_what_does_not_change_has_no_error(stripes):
    """The plane turns by 0 degrees. Threads may add up the samples of a pixel in another order."""
    error = _measure_mismatch(stripes(0, key="rotate_deg"), 0.5)
    assert error.rms() < 1e-6
    assert error.rms(3) < 1e-3


def test_noise_is_taken_out():
    """A difference of 2 % is planted under noise of 10 % in four pictures of 250,000 pixels.

    The product of two differences, each of variance 0.02, has a standard error of 0.02/500 = 4e-5; four are allowed.
    """
    random = np.random.default_rng(3)
    clean = np.ones((500, 500))
    pairs = [[level * clean + 0.1 * random.standard_normal(clean.shape) for level in (1.02, 1)] for _ in "12"]
    error = SliceMismatch.from_pairs(*pairs)
    assert error.standard_error == pytest.approx(4e-5, rel=0.05)
    assert error.mean_square == pytest.approx(0.02**2, abs=4 * 4e-5)


def test_a_black_picture_has_an_error_that_is_no_number():
    black, grey = np.zeros((4, 4)), np.full((4, 4), 0.5)
    assert np.isnan(SliceMismatch.from_pairs((black, black), (black, black)).mean_square)
    assert np.isnan(SliceMismatch.from_pairs((grey, black), (grey, black)).mean_square)


def test_a_target_out_of_sight_has_none(stripes):
    assert _measure_mismatch(stripes(20), 1.0) is None  # 10,000 pixels away


MEASURED = {}


@pytest.fixture
def measured_once(monkeypatch):
    """Render stripes that move by 0.9 pixels per slice only once, because cards differ but pictures do not."""

    def measure(subject, moment_s):
        key = (subject.scene.card.slices_per_s, moment_s)
        if key not in MEASURED:
            MEASURED[key] = _measure_mismatch(subject, moment_s)
        return MEASURED[key]

    monkeypatch.setattr(pictures, "_measure_mismatch", measure)


@pytest.mark.parametrize(
    ("stated", "level", "message"),
    [
        pytest.param(None, "warning", r" 1[01]\.\d+% .*write interpolation_error: 0.1\d+", marks=pytest.mark.slow),
        pytest.param(0.15, "ok", r" 1[01]\.\d+% .* 15\.00%", marks=pytest.mark.slow),
        (0.05, "warning", r" 1[01]\.\d+% .* 5\.00%: write slices_per_s: 8\d\d, or"),
    ],
)
def test_the_error_on_the_card_is_compared_with_the_measured_one(stripes, measured_once, stated, level, message):
    more = f"interpolation_error: {stated}\n" if stated else ""
    (finding,) = check_slices(stripes(0.9, more=more))
    assert finding.level == level
    assert re.search(message, finding.text)


@pytest.mark.slow
def test_what_the_check_says_to_write_passes(stripes, measured_once):
    (finding,) = check_slices(stripes(0.9, more="interpolation_error: 0.05\n"))
    slices, error = re.search(r"slices_per_s: (\d+), or interpolation_error: (\S+)", finding.text).groups()
    for more in (
        {"slices": slices, "more": "interpolation_error: 0.05\n"},
        {"more": f"interpolation_error: {error}\n"},
    ):
        (finding,) = check_slices(stripes(0.9, **more))
        assert finding.level == "ok"


def test_a_scene_that_stands_still_or_is_recorded_so_has_nothing_to_check(stripes):
    card = stripes(0.9).scene.folder / "scene.yaml"
    text = card.read_text()
    for gone in ("slices_per_s: .*\n", "motion: .*\n"):
        card.write_text(re.sub(gone, "", text))
        assert list(check_slices(SceneUnderTest(find_scene("made"), SENSOR, backend=VARIANT))) == []


def test_an_error_that_is_not_a_fraction_is_refused(stripes):
    assert "interpolation_error is" in refusal(stripes, 0.9, more="interpolation_error: 1\n").problem
