"""Scenes that are thin sections: the card, what their script draws, and their stacks."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import assert_says, refusal
from thin_sections import BUILD, CARD, GRID, write_slide

from saf_gen.authoring.checks import check_scene
from saf_gen.camera import get_sensor
from saf_gen.generate.cost import render_seconds
from saf_gen.optics import Wavefront
from saf_gen.render import make_renderer, render_missing
from saf_gen.render.grain import measure_by_repeat
from saf_gen.render.thin_section import SectionRenderer, draw_section
from saf_gen.scene.scene_folder import load_scene
from saf_gen.stack.focal_stack import StackSpec, StackStore
from saf_gen.stack.grain import read_grain
from saf_gen.stack.time_resolved import TimeResolvedStack

CLEAR = """\
import numpy as np
def build(params):
    return {'transmission': np.ones((9, 9)), 'path_nm': 0, 'texel_um': 1}
"""


@pytest.fixture
def slide(tmp_path, monkeypatch):
    return write_slide(tmp_path, monkeypatch)


def spec_of(scene, **changes):
    asked = {"positions": 9, "samples": 16, "max_depth": 6, "time_s": 0.0, "wavelength_m": 555e-9, **changes}
    return StackSpec.from_scene(scene, GRID, **asked)


def drawn(scene, spec, folder):
    render_missing(scene, [spec], root=folder, backend_name="scalar", threads=1)
    return StackStore(folder, spec).load()


def test_the_stack_of_a_section_has_the_light_depth_and_target_of_its_card(tmp_path, monkeypatch):
    """A clear slide sends radiance times the squared coherence into the aperture, at any position."""
    scene = write_slide(tmp_path, monkeypatch, build=CLEAR)
    stack = drawn(scene, spec_of(scene, positions=3), tmp_path / "stacks")
    assert stack.radiance.shape == (2, 3, 16, 24)
    assert stack.radiance[0] == pytest.approx(np.full((3, 16, 24), 50 * 0.6**2), rel=1e-5)
    assert stack.radiance[1] == pytest.approx(np.full((3, 16, 24), 80 * 0.3**2), rel=1e-5)
    assert stack.depth == pytest.approx(np.full((16, 24), 0.0198))
    footprint_um = 20e-6 / 10 * 1e6
    assert stack.target.sum() == pytest.approx((9 / footprint_um) ** 2, abs=6)
    assert stack.backend == "waves"


@pytest.mark.slow
def test_the_truth_of_a_phase_section_is_the_focus_of_its_plane(slide, tmp_path):
    for height_um in (-40, 0, 25):
        scene = slide.with_params({"height_um": height_um})
        spec = spec_of(scene, positions=2, groups=["lamp"])
        store = StackStore(tmp_path, spec)
        drawn(scene, spec, tmp_path)
        truth = spec.in_focus.true_focus(*store.load_geometry())
        assert truth == pytest.approx(0.5 - height_um / 240, abs=2e-5)  # depths are float32


@pytest.mark.slow
def test_a_phase_section_shows_least_where_it_is_in_focus(slide, tmp_path):
    scene = slide.with_params({"height_um": 0})
    stack = drawn(scene, spec_of(scene, positions=7), tmp_path)
    contrast = stack.radiance.std(axis=(2, 3)) / stack.radiance.mean(axis=(2, 3))
    assert (contrast.argmin(axis=1) == 3).all()
    assert (contrast[:, 3] < 0.3 * contrast.max(axis=1)).all()
    assert contrast[1].max() > contrast[0].max()  # narrow light shows phase better


def test_a_section_is_the_same_whatever_a_recipe_asks_of_light_paths(slide):
    first = spec_of(slide)
    for change in ({"samples": 256}, {"max_depth": 2}, {"wavelength_m": 0.0}, {"estimator": "plain"}):
        assert spec_of(slide, **change).key == first.key
    assert first.without_diffraction() == first
    assert first.wavelength_m == pytest.approx(550e-9)


@pytest.mark.slow
def test_pieces_are_made_once_and_a_missing_one_again_alike(slide, tmp_path):
    spec = spec_of(slide, positions=3)
    whole = drawn(slide, spec, tmp_path)
    assert render_missing(slide, [spec], root=tmp_path, backend_name="llvm") == []
    (tmp_path / spec.key / "stopped.exr").unlink()
    assert render_missing(slide, [spec], root=tmp_path, backend_name="llvm", threads=1) == ["stopped"]
    assert np.array_equal(StackStore(tmp_path, spec).load().radiance, whole.radiance)


def test_no_grain_of_a_section_is_measured(slide, tmp_path):
    spec = spec_of(slide, positions=2)
    drawn(slide, spec, tmp_path)
    measure_by_repeat(slide, [spec], root=tmp_path, backend_name="scalar")
    assert read_grain(tmp_path, spec) is None
    assert TimeResolvedStack((0,), (spec,)).has_grain(tmp_path)


def test_spherical_aberration_enters_the_pupil(tmp_path, monkeypatch):
    """A picture of the card's aberrations is that of a lens that has them; other aberrations are refused."""
    card = CARD.replace("f_number: 3.6,", "f_number: 3.6, aberrations: {spherical: 0.7},")
    scene = write_slide(tmp_path, monkeypatch, card=card)
    drive = scene.build_drive()
    assert drive.wavefront == Wavefront(spherical_m=0.7 * 550e-9, radius_m=drive.aperture_radius_m, height_m=1.0)
    straight = SectionRenderer(scene, GRID, drive=replace(drive, wavefront=None))
    bent = make_renderer(scene, GRID, backend_name="auto")
    assert abs(bent.render_picture(0.5) - straight.render_picture(0.5)).max() > 0.1
    assert_says(refusal(spec_of, scene, aberrations="mild"), "differs over the field | spherical aberration alone")


def test_the_plan_counts_waves_and_not_samples(slide):
    short, long = (render_seconds(spec_of(slide, positions=n)) for n in (9, 18))
    assert long == pytest.approx(2 * short)
    assert short > 0


@pytest.mark.slow
def test_checks_take_a_section(slide):
    sensor = get_sensor("vidar_400x250", rows=16, columns=24)
    found = list(check_scene(slide, sensor))
    assert {f.check for f in found} >= {"geometry", "units", "reach", "exposure", "family"}
    assert not [f for f in found if f.level == "error"]


def test_a_section_without_light_is_refused_by_the_checks(tmp_path, monkeypatch):
    sensor = get_sensor("vidar_400x250", rows=16, columns=24)
    scene = write_slide(tmp_path, monkeypatch, build=CLEAR.replace("np.ones", "np.zeros"))
    assert any("is black" in f.text for f in check_scene(scene, sensor))


def test_a_preview_shows_a_phase_section_beside_its_focus(slide):
    """In focus there would be nothing to see."""
    renderer = make_renderer(slide.with_params({"height_um": 0}), GRID, backend_name="auto")
    in_focus, beside = renderer.render_picture(0.5), renderer.render_pinhole(0.5)
    assert beside.std() > 2 * in_focus.std()


DRAWN = {
    "no dictionary": ("return 3", "returned int | a dictionary of transmission, path_nm, texel_um, height_um"),
    "nothing": ("pass", "returned NoneType"),
    "an unknown key": ("return {'transmision': 1, **good}", "returned transmision, transmission, | a dictionary of"),
    "a missing key": ("good.pop('path_nm'); return good", "returned transmission, texel_um | path_nm"),
    "texels of 0": ("return {**good, 'texel_um': 0}", "texel_um as 0 to 0 | a number of 0.001 to 10000"),
    "texels in words": ("return {**good, 'texel_um': 'fine'}", "texel_um as <U4 | a number"),
    "no height": ("return {**good, 'height_um': float('nan')}", "height_um as nan to nan"),
    "too much light": ("return {**good, 'transmission': a + 1.5}", "transmission as 1.5 to 1.5 | of 0 to 1"),
    "negative light": ("return {**good, 'transmission': a - 0.1}", "transmission as -0.1 to -0.1"),
    "light that is no number": ("a[2, 2] = np.nan; return {**good, 'transmission': a}", "transmission as nan to nan"),
    "infinite path": ("return {**good, 'path_nm': a + np.inf}", "path_nm as inf to inf"),
    "a path in metres of glass": ("return {**good, 'path_nm': a + 1e7}", "path_nm as 1e+07 to 1e+07"),
    "a line": ("return {**good, 'path_nm': a[0]}", "path_nm as float64 of shape (6,)"),
    "colours": ("return {**good, 'transmission': np.ones((4, 6, 3))}", "transmission as float64 of shape (4, 6, 3)"),
    "no texels": ("return {**good, 'path_nm': np.ones((0, 6))}", "path_nm as float64 of shape (0, 6)"),
    "complex": ("return {**good, 'transmission': a * 1j}", "transmission as complex128"),
    "text": ("return {**good, 'path_nm': 'path.png'}", "path_nm as <U8"),
    "ragged rows": ("return {**good, 'path_nm': [[1, 2], [3]]}", "path_nm as object | an array (row, col)"),
    "two shapes": ("return {**good, 'path_nm': a[:, :3]}", "transmission of shape (4, 6) and path_nm of (4, 3)"),
    "two numbers": ("return {**good, 'transmission': 1, 'path_nm': 20}", "transmission of shape () and path_nm of ()"),
    "an error": ("return 1 / 0", "ZeroDivisionError"),
}


@pytest.mark.parametrize(("line", "says"), DRAWN.values(), ids=DRAWN)
def test_what_a_script_draws_wrongly_is_told_in_one_line(line, says, tmp_path, monkeypatch):
    build = (
        "import numpy as np\ndef build(params):\n    a = np.zeros((4, 6))\n"
        f"    good = {{'transmission': a + 0.5, 'path_nm': a, 'texel_um': 1.0}}\n    {line}\n"
    )
    assert_says(refusal(draw_section, write_slide(tmp_path, monkeypatch, build=build)), says)


def test_integers_and_numbers_are_read_as_they_are(tmp_path, monkeypatch):
    build = BUILD.replace('"transmission": 0.99', '"transmission": 1').replace(
        "30 * smooth", "(30 * smooth).astype(int)"
    )
    section = draw_section(write_slide(tmp_path, monkeypatch, build=build))
    assert section.transmission.shape == section.path_m.shape == (60, 80)
    assert (section.transmission == 1).all()
    assert np.unique(section.path_m * 1e9).tolist() == pytest.approx(np.unique(np.rint(section.path_m * 1e9)))


CARDS = {
    "an unknown condenser": (("lamp: [wide]", "lamp: [wild]"), "lights are ['narrow', 'wild'] | wide, narrow"),
    "a condenser without a group": ((", stopped: [narrow]", ""), "lights are ['wide'] | wide, narrow"),
    "a condenser in two groups": (("stopped: [narrow]", "stopped: [narrow, wide]"), "'wide' is in two light groups"),
    "another target": (("[section]", "[cells]"), "target is ['cells'] | [section]"),
    "slices": (("target:", "slices_per_s: 80\ntarget:"), "does not move | slices_per_s"),
    "a motion": (("target:", "motion: {section: {}}\ntarget:"), "motion"),
    "no coherence": (("coherence: 0.6", "coherence: 0"), "section.condensers.wide.coherence is 0"),
    "too wide a condenser": (("coherence: 0.6", "coherence: 2.5"), "coherence is 2.5"),
    "an unknown key": (("coherence: 0.6", "aperture: 0.6"), "unknown key 'aperture'"),
    "no light": (("radiance: 50", "radiance: 0"), "radiance is 0"),
    "a wavelength in metres": (("wavelength_nm: 550", "wavelength_nm: 5.5e-7"), "wavelength_nm is 5.5e-07"),
    "no condensers": (("condensers: {wide", "lamps: {wide"), "section"),
}


@pytest.mark.parametrize(("change", "says"), CARDS.values(), ids=CARDS)
def test_a_card_that_does_not_fit_a_section_is_told_in_one_line(change, says, tmp_path, monkeypatch):
    card = CARD.replace(*change)
    assert card != CARD
    assert_says(refusal(write_slide, tmp_path, monkeypatch, card=card), says)


def test_a_section_needs_a_script(tmp_path, monkeypatch):
    scene = write_slide(tmp_path, monkeypatch)
    (scene.folder / "scene.py").rename(scene.folder / "scene.xml")
    assert_says(refusal(load_scene, scene.folder), "scene.yaml:7 | a thin section has scene.xml | scene.py")


def test_a_section_out_of_reach_is_told_with_what_is_allowed(tmp_path, monkeypatch):
    scene = write_slide(tmp_path, monkeypatch, card=CARD.replace("-40, 40", "500, 501"))
    spec = spec_of(scene)
    error = refusal(render_missing, scene, [spec], root=tmp_path, backend_name="scalar")
    assert_says(error, "out of the lens's reach | travel_m | height_um")
    assert not (tmp_path / spec.key).exists()


RECIPE = """\
name: slides
seed: 3
camera: {{sensor: {sensor}, frames: 300, exposure: {{mean_rate: 0.2}}}}
focus: {{positions: 3}}
{render}
lights: {{constant: {{kind: constant}}}}
splits: {{test: {{scenes: [slide], lights: [constant]}}}}
"""


@pytest.mark.slow
@pytest.mark.parametrize("render", ["render: {samples: 64}", "render: {samples: 4, diffraction: false}"])
def test_a_recipe_with_a_section_is_made_once_and_verified(slide, tmp_path, small_sensor, call, render):
    recipe, made = tmp_path / "recipe.yaml", tmp_path / "made"
    recipe.write_text(RECIPE.format(sensor=small_sensor, render=render))
    code, said, _ = call("generate", recipe, "--out", made, "--variant", "scalar")
    assert code == 0
    assert "3 pieces of focal stacks rendered" in said
    assert "without diffraction" not in said
    code, said, _ = call("generate", recipe, "--out", made)
    assert code == 0
    assert "0 pieces of focal stacks rendered" in said
    assert call("verify", made)[0] == 0
