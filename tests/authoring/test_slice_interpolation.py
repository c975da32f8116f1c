"""The error of interpolating between time slices, against closed forms, and what the check says of it."""

import re

import numpy as np
import pytest
from refusals import refusal
from written_scenes import VARIANT, write_scene

from saf_gen.authoring.checks import SceneUnderTest, check_scene_slices, slice_interpolation
from saf_gen.authoring.checks.slice_interpolation import SliceMismatch, measure_slices_in_scene_check
from saf_gen.camera import get_sensor
from saf_gen.optics import ImageDistanceDrive
from saf_gen.scene.scene_folder import find_scene

SENSOR = get_sensor("vidar_400x250", rows=6, columns=146)  # all rows show the same
DRIVE = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))
FOOTPRINT_M = 20e-6 * 0.5 / float(DRIVE.image_distance(DRIVE.best_position(0.5)))
PERIOD, SLICES = 7.3, 500  # pixels: 20 periods in the frame, edges on every twentieth of one; a second


@pytest.fixture
def stripes(tmp_path, monkeypatch):
    """Stripes of 0.2 and 0.8 under an even sky, in focus; gives a function that moves them along the rows.

    ``step``: pixels from one time slice to the next. More of the card may be given.
    """
    periods = 130  # wide enough to fill the frame all the time
    texture = f"mi.Bitmap(np.tile(np.array([0.2, 0.8], dtype='float32'), (2, {periods})))"
    shapes = (
        f"{{'plane': {{'type': 'rectangle',"
        f" 'to_world': t.rotate([0, 1, 0], 180).scale({periods * PERIOD / 2 * FOOTPRINT_M}),"
        " 'bsdf': {'type': 'diffuse', 'reflectance': {'type': 'bitmap', 'raw': True,"
        f" 'filter_type': 'nearest', 'bitmap': {texture}}}}}}}, 'sky': {{'type': 'constant'}}}}"
    )
    lens = "{focal_length_mm: 25, f_number: 2.0, focus_range_m: [0.6, 0.42]}"
    scene = write_scene(tmp_path, monkeypatch, lens=lens, distance_m=0.5, shapes=shapes, light="sky", target="plane")
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
    """An edge that crosses a box pixel is a ramp a pixel wide. Two of them, d <= 1 apart, mixed and compared
    with one between them differ where the ramps bend, by a triangle: the square adds up to d³/24 of the
    step's square. At two edges a period P: rms = step · √(d³/(12·P))."""
    error = measure_slices_in_scene_check(stripes(step), 0.5)
    expected = 0.6 / 0.5 * np.sqrt(step**3 / (12 * PERIOD))
    assert error.rms(3) - error.rms(-3) < 0.2 * expected
    assert error.rms() == pytest.approx(expected, rel=0.03)


def test_a_region_is_that_part_of_the_picture(stripes):
    """Stripes turned by 30 degrees: no two rows or columns are alike."""
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
    """A turn by nothing that lasts a second. Threads may add up a pixel's samples in another order."""
    error = measure_slices_in_scene_check(stripes(0, key="rotate_deg"), 0.5)
    assert error.rms() < 1e-6
    assert error.rms(3) < 1e-3


def test_noise_is_taken_out():
    """A planted difference of 2 % under noise of 10 % in each of four pictures, 250,000 pixels: the
    product of two differences, each of variance 0.02, scatters by 0.02/500 = 4e-5; four are allowed."""
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
    assert measure_slices_in_scene_check(stripes(20), 1.0) is None  # 10,000 pixels away


MEASURED = {}


@pytest.fixture
def measured_once(monkeypatch):
    """Stripes that move by 0.9 pixels per slice are rendered once: their cards differ, and the pictures do not."""

    def measure(subject, moment_s):
        key = (subject.scene.card.slices_per_s, moment_s)
        if key not in MEASURED:
            MEASURED[key] = measure_slices_in_scene_check(subject, moment_s)
        return MEASURED[key]

    monkeypatch.setattr(slice_interpolation, "measure_slices_in_scene_check", measure)


@pytest.mark.parametrize(
    ("said", "level", "told"),
    [
        pytest.param(None, "warning", r" 1[01]\.\d+% .*write interpolation_error: 0.1\d+", marks=pytest.mark.slow),
        pytest.param(0.15, "ok", r" 1[01]\.\d+% .* 15\.00%", marks=pytest.mark.slow),
        (0.05, "warning", r" 1[01]\.\d+% .* 5\.00%: write slices_per_s: 8\d\d, or"),
    ],
)
def test_the_card_is_compared(stripes, measured_once, said, level, told):
    more = f"interpolation_error: {said}\n" if said else ""
    (finding,) = check_scene_slices(stripes(0.9, more=more))
    assert finding.level == level
    assert re.search(told, finding.text)


@pytest.mark.slow
def test_what_the_check_says_to_write_passes(stripes, measured_once):
    (finding,) = check_scene_slices(stripes(0.9, more="interpolation_error: 0.05\n"))
    slices, error = re.search(r"slices_per_s: (\d+), or interpolation_error: (\S+)", finding.text).groups()
    for more in (
        {"slices": slices, "more": "interpolation_error: 0.05\n"},
        {"more": f"interpolation_error: {error}\n"},
    ):
        (finding,) = check_scene_slices(stripes(0.9, **more))
        assert finding.level == "ok"


def test_a_scene_that_stands_still_or_is_recorded_so_has_nothing_to_check(stripes):
    card = stripes(0.9).scene.folder / "scene.yaml"
    text = card.read_text()
    for gone in ("slices_per_s: .*\n", "motion: .*\n"):
        card.write_text(re.sub(gone, "", text))
        assert list(check_scene_slices(SceneUnderTest(find_scene("made"), SENSOR, backend=VARIANT))) == []


@pytest.mark.parametrize("value", ["0", "1", "a"])
def test_an_error_that_is_not_a_fraction_is_refused(stripes, value):
    error = refusal(stripes, 0.9, more=f"interpolation_error: {value}\n")
    assert "interpolation_error is" in error.problem
