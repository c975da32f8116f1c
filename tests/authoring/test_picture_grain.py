"""The findings of `scenes check` on grain: planted in figures, and in scenes with and without grain."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from capture_dataset import write_moving_plane
from written_scenes import VARIANT, needs_llvm, write_scene

from saf_gen.authoring.checks import SceneUnderTest, check_grain
from saf_gen.authoring.checks import grain as goals
from saf_gen.authoring.checks.grain import BEST_FOCUS, QUARTER_AWAY, _compare_with_goals, crop_sensor, grain_positions
from saf_gen.camera import get_sensor
from saf_gen.render.grain import TargetGrain, measure_slices
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.grain import ENERGIES, Grain, GrainFigure


def planted(rms, contrast, *, known=True):
    figure = GrainFigure(contrast, contrast / 1.1, contrast * 1.1 if known else math.inf)
    grain = Grain(1.0, GrainFigure(rms, rms / 1.1, rms * 1.1), dict.fromkeys(ENERGIES, figure))
    return TargetGrain(grain, grain)


@pytest.mark.parametrize(("truth", "away"), [(0.3, 0.55), (0.5, 0.25), (0.9, 0.65)])
def test_a_quarter_away_lies_on_the_longer_side(truth, away):
    assert grain_positions(truth)[QUARTER_AWAY] == pytest.approx(away)


@pytest.mark.parametrize("shape", [(250, 400), (41, 64)], ids=str)
def test_a_cropped_sensor_sees_the_same_target_round_the_same_axis(shape):
    sensor = get_sensor("vidar_400x250", rows=shape[0], columns=shape[1])
    target = np.zeros(shape, bool)
    target[9:30, 20:55] = True
    cropped = crop_sensor(sensor, target)
    top, left = (shape[0] - cropped.rows) / 2, (shape[1] - cropped.columns) / 2
    assert (top, left) == (9, 20 if shape[1] == 400 else 9)
    assert target[int(top) : shape[0] - int(top), int(left) : shape[1] - int(left)].sum() == target.sum()


@needs_llvm
def test_a_pixel_of_a_cropped_sensor_sees_what_it_saw(tmp_path, monkeypatch, small_sensor):
    write_moving_plane(tmp_path, monkeypatch)
    sensor = get_sensor(str(small_sensor))
    cropped = replace(sensor, rows=sensor.rows - 12, columns=sensor.columns - 20)
    whole, part = (
        SceneRenderer(find_scene("plane"), grid, backend_name=VARIANT).trace_geometry() for grid in (sensor, cropped)
    )
    assert np.array_equal(part.target, whole.target[6:-6, 10:-10])
    assert part.depth == pytest.approx(whole.depth[6:-6, 10:-10], rel=1e-6)


@pytest.mark.parametrize(
    ("focus", "end", "moving", "proposed"),
    [
        ((0.02, 0.001), (0.02, 0.009), False, None),
        ((0.02, 0.001), (0.02, 0.03), False, "samples: 256"),  # 64 · 3 = 192
        ((0.02, 0.001), (0.02, 0.0401), False, "samples: 512"),  # 257
        ((0.3, 0.001), (0.3, 0.001), False, None),  # still stacks have a goal only for contrast
        ((0.03, 0.5), (0.03, 0.04), True, None),  # in focus only the rms has a goal
        ((0.08, 0.001), (0.03, 0.04), True, "slice_samples: 64"),  # twice the goal: four times the samples
        ((0.03, 0.001), (0.03, 0.1), True, "slice_samples: 32"),
    ],
)
def test_the_proposed_samples_follow_from_the_law(focus, end, moving, proposed):
    found = {BEST_FOCUS: planted(*focus), "position 1": planted(*end)}
    usual = goals.SLICE_SAMPLES if moving else goals.STILL_SAMPLES
    finding = _compare_with_goals("a", found, samples=usual, usual=usual, moving=moving)
    assert finding.level == ("ok" if proposed is None else "warning")
    if proposed:
        assert f"{{per_scene: {{a: {{{proposed}}}}}}} in a recipe), or larger lamps" in finding.text


def test_grain_of_fewer_samples_is_scaled_to_the_usual_number():
    """A quarter of the samples gives four times the variance: 3.6 % measured means 0.9 %."""
    found = {BEST_FOCUS: planted(0.1, 0.036)}
    assert _compare_with_goals("a", found, samples=64, usual=256, moving=False).level == "ok"
    assert _compare_with_goals("a", found, samples=256, usual=256, moving=False).level == "warning"


def test_a_contrast_that_noise_hides_needs_no_samples():
    finding = _compare_with_goals("a", {BEST_FOCUS: planted(0.02, 9.0, known=False)}, samples=1, usual=1, moving=False)
    assert finding.level == "ok"
    assert "no contrast" in finding.text


@pytest.mark.slow
@needs_llvm
def test_slices_with_the_proposed_number_of_samples_pass(tmp_path, monkeypatch, small_sensor):
    """An extended lamp lights a plane of rough metal, whose paths share no shading."""
    script = write_moving_plane(tmp_path, monkeypatch) / "scene.py"
    metal = '"type": "roughconductor",\n                "alpha": 0.3,\n                "specular_reflectance"'
    script.write_text(script.read_text().replace('"type": "diffuse",\n                "reflectance"', metal))
    sensor = replace(get_sensor(str(small_sensor)), rows=20, columns=32)
    subject = SceneUnderTest(find_scene("plane"), sensor, backend=VARIANT)
    _, finding = check_grain(subject)
    assert finding.level == "warning"
    (samples,) = re.findall(r"slice_samples: (\d+)}", finding.text)
    assert int(samples) > goals.SLICE_SAMPLES
    found = measure_slices(
        subject.renderer,
        subject.depth_and_target,
        at=grain_positions(subject.true_focus),
        positions=goals.POSITIONS,
        samples=int(samples),
    )
    for position_name, grain in found.items():
        assert grain.box.rms.low < goals.MAX_SLICE_RMS, position_name
        if position_name != BEST_FOCUS:
            assert grain.box.noise_over_signal["contrast"].low < goals.MAX_SLICE_CONTRAST, position_name


@pytest.mark.parametrize("variant", [pytest.param("llvm", marks=needs_llvm), "scalar"])
def test_a_scene_of_even_light_has_no_grain(tmp_path, monkeypatch, variant):
    """A glowing plane fills the frame, so that every path brings the same light."""
    shapes = (
        "{'glow': {'type': 'rectangle', 'to_world': t.rotate([0, 1, 0], 180).scale(1.0),"
        " 'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': 1.0}}}}"
    )
    scene = write_scene(tmp_path, monkeypatch, shapes=shapes, light="glow", target="glow")
    sensor = get_sensor("vidar_400x250", rows=20, columns=30)
    (finding,) = check_grain(SceneUnderTest(scene, sensor, backend=variant))
    assert finding.level == "ok"
    rms = float(re.search(r"noise of (\S+) of the mean", finding.text)[1])
    assert rms < 1e-4
