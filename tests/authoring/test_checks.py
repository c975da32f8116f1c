"""The checks of a scene, each with a planted fault, and their figures, compared with closed forms."""

import re
import shutil
from io import StringIO
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from scipy.special import j1
from small_dataset import DRIVE, SCENES
from written_scenes import VARIANT, needs_llvm, write_scene

from saf_gen.authoring import checks
from saf_gen.authoring.checks import SceneUnderTest, check_licence, check_scene
from saf_gen.authoring.checks.geometry import _find_fastest_shape
from saf_gen.authoring.checks.pictures import TargetDetail, _check_contrast, _measure_detail, check_curve
from saf_gen.authoring.template import scene_from_template
from saf_gen.camera import get_sensor
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.focal_stack import FocalStack, StackSpec

pytestmark = pytest.mark.slow


@pytest.fixture
def skeleton(tmp_path, own_folder):
    """A function that edits and returns the scene ``mine``, made from the script template, without open numbers."""
    scene_from_template("mine", tmp_path / "scenes")
    folder = tmp_path / "scenes/mine"
    card = folder / "scene.yaml"
    text = re.sub(r"tilt_deg: .*", "tilt_deg: 0", card.read_text().replace('licence: ""', "licence: CC-BY-4.0"))
    card.write_text(re.sub(r"square_mm: .*", "square_mm: 2", text))

    def edit(*pairs):
        for old, new in pairs:
            at = [p for p in (card, folder / "scene.py") if old in p.read_text()]
            assert len(at) == 1, old
            at[0].write_text(at[0].read_text().replace(old, new))
        return find_scene("mine")

    return edit


@pytest.fixture
def sensor():
    """The middle of the vidar_400x250: few pixels of the same size."""
    return get_sensor("vidar_400x250", rows=40, columns=64)


@pytest.fixture
def sensor_file(tmp_path, small_sensor):
    """A sensor file of the middle of the vidar_400x250."""
    text = re.sub(
        r"rows: \d+\ncolumns: \d+\npitch_m: .*", "rows: 40\ncolumns: 64\npitch_m: 2.0e-5", small_sensor.read_text()
    )
    path = tmp_path / "crop.yaml"
    path.write_text(text)
    return path


def findings(scene, sensor, check):
    """Return a generator of level and text of a check's findings; the next finding may need rendering."""
    run = getattr(checks, f"check_{check}")
    return ((f.level, f.text) for f in run(SceneUnderTest(scene, sensor, backend=VARIANT)))


def found(scene, sensor, check):
    return list(findings(scene, sensor, check))


def last_finding(scene, sensor):
    """Return check, level and text of the last finding of all checks."""
    last = list(check_scene(scene, sensor, backend=VARIANT))[-1]
    return last.check, last.level, last.text


def only(scene, sensor, check):
    """Return the only finding of a check that is not ok."""
    (bad,) = [(level, text) for level, text in found(scene, sensor, check) if level != "ok"]
    return bad


# --- licence and source -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("licence", "level", "message"),
    [
        ("MIT OR Apache-2.0", "ok", "MIT OR Apache-2.0"),
        ("CC-BY-NC-4.0", "warning", "forbids some uses or changes"),
        ("CC BY 4.0", "warning", "CC is not the SPDX name of a known open licence"),
        ("Apache2", "warning", "did you mean Apache-2.0?"),
        ("''", "warning", "licence is empty: a dataset of this scene cannot be published until you write one"),
    ],
)
def test_the_licence_is_one_that_lets_others_use_the_scene(skeleton, licence, level, message):
    finding = next(check_licence(skeleton(("licence: CC-BY-4.0", f"licence: {licence}"))))
    assert finding.level == level
    assert message in finding.text


@pytest.mark.parametrize(
    ("source", "words", "level", "message"),
    [
        ("SOURCE.md", "Made by hand of nothing but a pencil, here, this very year.", "ok", "SOURCE.md"),
        ("SOURCE.md", "", "warning", "SOURCE.md says too little"),
        ("ORIGIN.md", "", "error", "ORIGIN.md does not exist"),
        ("made here", "", "warning", "photo.png has no documented origin"),
        ("''", "", "error", "source is empty: name SOURCE.md"),
    ],
)
def test_a_source_must_be_documented(skeleton, source, words, level, message):
    scene = skeleton(("source: SOURCE.md", f"source: {source}"))
    (scene.folder / "SOURCE.md").write_text(words)
    if source == "made here":
        shutil.copy(SCENES / "workbench/textures/print.png", scene.folder / "photo.png")
    finding = list(check_licence(scene))[1]
    assert finding.level == level
    assert message in finding.text


# --- geometry and units -------------------------------------------------------------------------------


NEVER = "motion: {card: {keyframes: [{time_s: 0, translate_m: [3, 0, 0]}, {time_s: 1, translate_m: [3, 1, 0]}]}}"


@pytest.mark.parametrize(
    ("pair", "check", "message"),
    [
        (("target: [card]", "target: [cart]"), "geometry", "did you mean 'card'"),
        (("lamp: [lamp]", "lamp: [lump]"), "geometry", "unknown emitter of light group 'lamp': 'lump'"),
        (
            ('"type": "rectangle",  # from', '"type": "rectangel",  # from'),
            "geometry",
            "the type 'rectangel' is unknown",
        ),
        (("    t = mi", "    t = nix"), "geometry", "scene.py failed: NameError"),
        (
            ("origin_m: [0, 0, 0.5]", "origin_m: [0, 0, 500]"),
            "reach",
            "if camera.origin_m is in millimetres, multiply it and look_at_m by 0.001",
        ),
        (("target: [card]", NEVER + "\ntarget: [card]"), "reach", "is not visible to the camera"),
    ],
)
def test_geometry_that_cannot_be_built_or_seen_ends_the_checks(skeleton, sensor, pair, check, message):
    found_check, level, text = last_finding(skeleton(pair), sensor)
    assert (found_check, level) == (check, "error")
    assert message in text


IN_MM = (
    ("WIDTH_M = 0.1\n", "WIDTH_M = 100.0\n"),
    ("TEXEL_M = 0.0001", "TEXEL_M = 0.1"),
    ('["square_mm"] / 1000', '["square_mm"]'),
    ("translate([0, 0, -0.2]).scale(0.5)", "translate([0, 0, -200]).scale(500)"),
    ("origin=[0.3, 0.3, 0.6]", "origin=[300, 300, 600]"),
    (".scale(0.08)", ".scale(80)"),
)


def test_geometry_in_millimetres_is_reported_with_the_factor(skeleton, sensor):
    """The target is off the world's origin, so that a wrong unit moves it out of the lens's reach."""
    away = ("t.rotate([0, 1, 0], params", "t.translate([0, 0, 50]).rotate([0, 1, 0], params")
    scene = skeleton(*IN_MM, away, ("origin_m: [0, 0, 0.5]", "origin_m: [0, 0, 0.55]"))
    check, level, text = last_finding(scene, sensor)
    assert (check, level) == ("reach", "error")
    assert "if the geometry is in millimetres, write unit_m: 0.001 on the card" in text
    mended = skeleton(("id: mine", "unit_m: 0.001\nid: mine"))
    assert {level for level, _ in found(mended, sensor, "reach")} == {"ok"}


# --- reach and family ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("travel", "level", "message"),
    [
        ("[0.9, 0.6]", "error", "out of the lens's reach"),
        ("[0.9, 0.49]", "warning", "the focus is near an end of the travel, widen focus_range_m"),
        ("[0.51, 0.49]", "warning", "open the lens or widen focus_range_m"),
    ],
)
def test_a_travel_that_does_not_fit_is_reported(skeleton, sensor, monkeypatch, travel, level, message):
    monkeypatch.setattr(checks, "CHECKS_OF_BUILT_SCENES", (checks.check_reach,))
    scene = skeleton(("[0.65, 0.40]", travel))
    findings = [f for f in check_scene(scene, sensor, backend=VARIANT) if f.check == "reach"]
    assert [f.level for f in findings] == [level]
    assert message in findings[0].text


def test_the_positions_that_recipes_need_are_reported(skeleton, sensor):
    """Neighbouring positions are at most half a depth of focus apart."""
    scene = skeleton()
    ((_, text),) = found(scene, sensor, "reach")
    positions = int(re.search(r"focus.positions: (\d+)", text)[1])
    subject = SceneUnderTest(scene, sensor, backend=VARIANT)
    low, high = subject.depth_of_focus
    assert 1 / (positions - 1) <= (high - low) / 2 < 2 / (positions - 1)


def test_a_member_of_the_family_out_of_reach_is_named(skeleton, sensor):
    """Members are 0.66 to 0.69 m away, and the lens reaches 0.65 m."""
    script = ("t.rotate([0, 1, 0], params", 't.translate([0, 0, params["z"]]).rotate([0, 1, 0], params')
    scene = skeleton(script, ("square_mm: 2", "square_mm: 2\n  z: {uniform: [-0.19, -0.16]}"))
    errors = [text for level, text in found(scene.with_params({"z": 0.0}), sensor, "family") if level == "error"]
    assert len(errors) == 3
    assert re.match(r"with z -0\.1\d+: the target is .* out of the lens's reach.*narrow the ranges", errors[0])


# --- exposure, detail and curve -----------------------------------------------------------------------

DARK_LAMP = (
    ("look_at(origin=[0.3, 0.3, 0.6], target=[0, 0, 0]", "look_at(origin=[0.3, 0.3, 0.6], target=[9, 9, 9]"),
    ("translate([0, 0, -0.2]).scale(0.5)", "translate([0, 0, -0.2]).scale(0.01)"),
)
PRINTED, GREY = '"reflectance": printed(params["square_mm"] / 1000)', '"reflectance": 0.3'
UNIFORM = ((PRINTED, GREY), ('"radiance": 60.0', '"radiance": 1e-6'))  # the lamp would shade it
SHARPER_WALL = (  # a uniform card, turned by 45°, in front of a textured wall
    ('t.rotate([0, 1, 0], params["tilt_deg"])', "t.rotate([0, 0, 1], 45)"),
    (PRINTED, GREY),
    (
        '"bsdf": {"type": "diffuse", "reflectance": 0.3},\n        },\n        "lamp"',
        '"bsdf": {"type": "diffuse", "reflectance": printed(0.004)},\n        },\n        "lamp"',
    ),
    ("WIDTH_M = 0.1\n", "WIDTH_M = 0.015\n"),
    ("WIDTH_M / square_m)", "1.0 / square_m)"),
    ("TEXEL_M = 0.0001", "TEXEL_M = 0.001"),
    ("[0.65, 0.40]", "[0.9, 0.40]"),
)


@pytest.mark.parametrize(
    ("pairs", "check", "levels", "message"),
    [
        ((), "units", "ok", "target 100 × 100 × 0 mm, 0.5 m away"),
        ([("WIDTH_M = 0.1\n", "WIDTH_M = 0.006\n")], "units", "warning", "pixels are too few to focus on"),
        ([('"radiance": 60.0', '"radiance": 6e5')], "exposure", "warning", "implausible"),
        (DARK_LAMP, "exposure", "error", "light group 'lamp' does not reach the target: move its lamps, or remove it"),
        (UNIFORM, "detail", "error", "give it details of 0.38 to 1.9 mm; a pixel sees 0.38 mm"),
        (SHARPER_WALL, "curve", "warning error", "something else in the target's box is sharper there"),
    ],
    ids=["ok", "small", "bright", "dark", "uniform", "sharper wall"],
)
def test_a_planted_fault_is_reported(skeleton, sensor, pairs, check, levels, message):
    assert any(f[0] in levels and message in f[1] for f in findings(skeleton(*pairs), sensor, check))


def subject_that_peaks(offset, *, dof=0.04, truth=0.5):
    """A subject whose curve peaks ``offset`` depths of focus behind the true focus, a bell three of them wide."""
    board = np.random.default_rng(3).random((16, 16)) - 0.5  # no checkerboard, of which Sobel's filters see nothing

    def stack(focus):
        bell = 0.2 + 0.6 * np.exp(-(((focus - truth - offset * dof) / (3 * dof)) ** 2))
        spec = SimpleNamespace(focus=focus)
        return SimpleNamespace(spec=spec, target=board > -1, charge=1 + bell[:, None, None] * board)

    near = stack(truth + dof / 4 * np.arange(-8, 9))
    return SimpleNamespace(
        stack=stack(np.linspace(0, 1, 65)),
        near_stacks=(near, near),
        half_depth_of_focus=dof / 2,
        true_focus=truth,
        collected_charge=lambda stack: stack.charge,
    )


@pytest.mark.parametrize(
    ("offset", "level", "message"),
    [
        (0.0, "ok", "sharpest at 0.500 of the travel"),
        (0.14, "ok", "0.14 depths of focus"),
        (0.16, "warning", "which weighs all pixels of the target alike"),
        (-0.3, "warning", "compare methods by the error from their own optimum"),
        (0.6, "warning", "something else in the target's box is sharper there"),
        (1.6, "error", "something else in the target's box is sharper there"),
    ],
)
def test_a_curve_that_peaks_off_the_true_focus_is_reported_from_three_tenths_of_a_half_depth_on(offset, level, message):
    finding = next(check_curve(subject_that_peaks(offset)))
    assert finding.level == level
    assert message in finding.text


def test_the_peaks_of_other_measures_are_said_beside_that_of_sd():
    finding = next(check_curve(subject_that_peaks(0.16)))
    assert "by sd (octave_structure 0.16, structure_calibrated 0.16, tenengrad 0.16), which weighs" in finding.text


def test_illuminance_is_reported_and_compared_with_the_card(skeleton, sensor):
    """The light group room gives 0.5 W m⁻² sr⁻¹ from all directions that the card sees: π·0.5·683 = 1,073 lux."""
    _, text = next(findings(skeleton(), sensor, "exposure"))
    written = re.search(r"illuminance_lux: \{lamp: ([\d.]+), room: ([\d.]+)\}", text)
    lamp, room = (float(n) for n in written.groups())
    assert room == pytest.approx(np.pi * 0.5 * 683, rel=0.02)
    key = "illuminance_lux: {lamp: %g, room: %g}\ntarget: [card]"
    scene = skeleton(("target: [card]", key % (lamp, room)))
    level, text = next(findings(scene, sensor, "exposure"))
    assert level == "ok"
    assert "as the card says" in text
    level, text = next(findings(skeleton((f"lamp: {lamp:g},", f"lamp: {2 * lamp:g},")), sensor, "exposure"))
    assert level == "warning"
    assert f"lux from 'lamp', the card says {2 * lamp:,g}: write illuminance_lux: {{lamp: {lamp:g}" in text


def test_every_scene_here_states_its_illuminance_and_interpolation_error():
    cards = [find_scene(p.parent.name).card for p in sorted((SCENES.parent.parent / "scenes").glob("*/scene.yaml"))]
    assert [card.id for card in cards if not card.illuminance_lux] == []
    assert [card.id for card in cards if card.slices_per_s and not card.interpolation_error] == []


def test_a_coarse_texture_is_reported(skeleton, sensor):
    """Texels have 4 mm, and a pixel sees 0.38 mm."""
    coarse = ("np.ones((round(square_m / TEXEL_M),) * 2)", "np.ones((1, 1))")
    details = found(skeleton(coarse, ("square_mm: 2", "square_mm: 4")), sensor, "detail")
    (text,) = [text for level, text in details if level == "warning" and "texel" in text]
    size = float(re.search(r"a texel of the target covers ([\d.]+) pixels: use an image with", text)[1])
    assert size == pytest.approx(4 / 0.38, rel=0.05)


def planted(signal, noise, seed):
    """Return a stack of five positions, each a random picture times its ``signal`` plus independent noise."""
    random = np.random.default_rng(seed)
    picture = np.random.default_rng(1).standard_normal((200, 200))
    radiance = np.array([3 + s * picture + noise * random.standard_normal((200, 200)) for s in signal])
    spec = StackSpec("plane", "0" * 64, ("all",), DRIVE, 200, 200, 2e-5, 5, 16, 4)
    everywhere = np.ones((200, 200), dtype=bool)
    return FocalStack(spec, radiance[None].astype(np.float32), np.ones((200, 200)), everywhere, "none")


def test_loss_and_noise_are_those_that_were_planted():
    """With 40,000 pixels noise and loss have a standard error of 0.5 %; four standard errors are allowed."""
    signal = (0.5, 0.8, 1.0, 0.9, 0.6)
    shown = _measure_detail(planted(signal, 0.3, 2), planted(signal, 0.3, 3), truth=0.5, offset=0.25)
    assert shown.blur_loss == pytest.approx(1 - 0.8**2, abs=0.02)
    assert shown.noise == pytest.approx(0.3, rel=0.02)
    assert shown.contrast == pytest.approx(1 / 3, rel=0.02)


def test_a_picture_of_noise_alone_has_no_detail():
    shown = _measure_detail(planted((0,) * 5, 0.3, 2), planted((0,) * 5, 0.3, 5), truth=0.5, offset=0.25)
    assert shown.contrast < 0.01  # the standard error is 0.007, from noise of 0.3/3 in 40,000 pixels


def test_an_even_target_into_which_blur_brings_what_is_beside_it_loses_nothing():
    finding = _check_contrast(SimpleNamespace(pixel_footprint_m=1e-3), TargetDetail(0.2, -1.8, 0.0), blur=3.0)
    assert (finding.level, "removes 0.0% of its square: it shows no defocus" in finding.text) == ("error", True)


@needs_llvm
def test_the_loss_of_stripes_is_that_of_the_discs_transfer(tmp_path, monkeypatch, sensor):
    """Slanted stripes with a period of eight pixels are blurred by a disc of three pixels.

    The blur multiplies harmonic k by 2·J1(x)/x, x = 3π·k/8, and each pixel by a sinc.
    """
    footprint_m = 20e-6 * 0.5 / float(DRIVE.image_distance(DRIVE.best_position(0.5)))
    period, slant, periods = 8, np.radians(10), 50
    texture = f"mi.Bitmap(np.tile(np.array([0.2, 0.8], dtype='float32'), (2, {periods})))"
    shapes = (
        "{'plane': {'type': 'rectangle', 'to_world': t.rotate([0, 1, 0], 180).rotate([0, 0, 1], 10)"
        f".scale({periods * period / 2 * footprint_m}), 'bsdf': {{'type': 'diffuse', 'reflectance':"
        f" {{'type': 'bitmap', 'raw': True, 'filter_type': 'nearest', 'bitmap': {texture}}}}}}},"
        " 'sky': {'type': 'constant', 'radiance': 1.0}}"
    )
    scene = write_scene(tmp_path, monkeypatch, shapes=shapes, light="sky", target="plane")
    subject = SceneUnderTest(scene, sensor, backend="llvm")
    loss = _measure_detail(
        *subject.near_stacks, truth=subject.true_focus, offset=3 * subject.half_depth_of_focus
    ).blur_loss
    k = np.arange(1, 400, 2) / period
    weight = (np.sinc(k * np.cos(slant)) * np.sinc(k * np.sin(slant)) / k) ** 2
    left = (2 * j1(3 * np.pi * k) / (3 * np.pi * k)) ** 2
    assert loss == pytest.approx(1 - (weight * left).sum() / weight.sum(), abs=0.02)


# --- motion -------------------------------------------------------------------------------------------

MOVES = """motion: {card: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: %s}]}}
slices_per_s: %d
target: [card]"""


def moving(skeleton, path, slices=500):
    return skeleton(("target: [card]", MOVES % (path, slices)))


def test_the_speed_of_a_shift_and_of_a_turn_is_the_closed_form(skeleton, sensor):
    """A shape moves at 0.1 m/s across the view: in pixels, v/u of that on the sensor, over the pitch.

    The corners of one that turns move on a circle; a lamp is no shape.
    """
    subject = SceneUnderTest(moving(skeleton, "[0.1, 0, 0]"), sensor, backend=VARIANT)
    assert _find_fastest_shape(subject, [0.0, 0.5]) == (
        "card",
        pytest.approx(0.1 / subject.pixel_footprint_m, rel=1e-3),
    )
    lamp = "rotate_deg: 90}]}, lamp: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: [3, 0, 0]}]}}"
    turns = skeleton(("translate_m: [0.1, 0, 0]}]}}", lamp))
    subject = SceneUnderTest(turns, sensor, backend=VARIANT)
    turn = np.pi / 2 * 0.05 * np.sqrt(2) / subject.pixel_footprint_m
    assert _find_fastest_shape(subject, [0.5]) == ("card", pytest.approx(turn, rel=1e-3))


@pytest.mark.parametrize(
    ("path", "slices", "level", "message"),
    [
        ("[0.01, 0, 0]", 500, "ok", "in focus from 0.4"),
        ("[0.12, 0, 0]", 5000, "warning", "the target has left the frame at 0.625 s"),
        ("[0, 0, 0.16]", 5000, "warning", "it leaves the lens's reach"),
        ("[0.05, 0, 0]", 20, "warning", "slices_per_s: 13"),
    ],
)
def test_motion_is_reported(skeleton, sensor, path, slices, level, message):
    assert any(f[0] == level and message in f[1] for f in found(moving(skeleton, path, slices), sensor, "motion"))


def test_a_motion_without_slices_and_slices_without_motion_are_reported(skeleton, sensor):
    scene = moving(skeleton, "[0.01, 0, 0]")
    card = scene.folder / "scene.yaml"
    text = card.read_text()
    card.write_text(text.replace("slices_per_s: 500\n", ""))
    assert "recordings show it at rest: with slices_per_s: 26" in only(find_scene("mine"), sensor, "motion")[1]
    card.write_text(re.sub(r"motion: .*\n", "", text))
    assert "nothing moves: remove it, or add motion" in only(find_scene("mine"), sensor, "motion")[1]


LAMPS = {
    "spot": "'to_world': t.look_at(origin=[0.1, 0, -0.5], target=[0, 0, 0], up=[0, 1, 0])",
    "point": "'position': [0.1, 0, -0.5]",
    "directional": "'to_world': t.look_at(origin=[0.1, 0, -0.5], target=[0, 0, 0], up=[0, 1, 0])",
}
GLIDES = "motion: {%s: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: [0.01, 0, 0]}]}}\n"


@pytest.fixture
def lit_by(tmp_path, monkeypatch):
    """A function that makes a chequered plane under one lamp, with more lines on its card."""

    def scene(lamp, more):
        chequers = "{'type': 'checkerboard', 'to_uv': t.scale(60)}"
        shapes = (
            "{'plane': {'type': 'rectangle', 'to_world': t.rotate([0, 1, 0], 180).scale(0.1),"
            f" 'bsdf': {{'type': 'diffuse', 'reflectance': {chequers}}}}}, 'lamp': {{{lamp}}}}}"
        )
        made = write_scene(tmp_path, monkeypatch, shapes=shapes, light="lamp", target="plane")
        with (made.folder / "scene.yaml").open("a") as card:
            card.write(more)
        return find_scene("made")

    return scene


@pytest.mark.parametrize("kind", LAMPS)
def test_a_lamp_without_a_body_may_move(lit_by, sensor, kind):
    lamp = f"'type': '{kind}', {LAMPS[kind]}"
    scene = lit_by(lamp, GLIDES % "lamp" + "slices_per_s: 40\n")
    assert found(scene, sensor, "motion")[1] == ("ok", "no shape moves, only 'lamp'; slices_per_s: 40")


def test_a_lamp_that_moves_without_slices_is_reported(lit_by, sensor):
    scene = lit_by(f"'type': 'spot', {LAMPS['spot']}", GLIDES % "lamp")
    level, text = only(scene, sensor, "motion")
    assert level == "warning"
    assert "only 'lamp', but recordings show it at rest: write slices_per_s" in text


def test_a_scene_in_the_dark_is_one_error(lit_by):
    """The scene moves, and its only lamp faces away: no pixel shows the target."""
    sensor = get_sensor("vidar_400x250", rows=20, columns=32)
    lamp = (
        "'type': 'rectangle', 'to_world': t.translate([0, 0, -0.6]).rotate([0, 1, 0], 180).scale(0.05),"
        " 'emitter': {'type': 'area', 'radiance': 5.0}"
    )
    scene = lit_by(lamp, GLIDES % "plane" + "slices_per_s: 100\n")
    errors = {f.check: f.text for f in check_scene(scene, sensor, backend=VARIANT) if f.level == "error"}
    assert list(errors) == ["reach"]
    assert "is black: its own light reaches 0.0% of its pixels" in errors["reach"]


def test_a_scene_that_is_dark_for_a_while_is_measured_where_it_is_not(lit_by, sensor):
    """A spot turns away."""
    turns = (
        "motion: {lamp: {keyframes: [{time_s: 0}, {time_s: 1, rotate_deg: 90}], axis: [0, 1, 0],"
        " centre_m: [0.1, 0, -0.5]}}\nslices_per_s: 100\nstill_s: 0\n"
    )
    warnings = found(lit_by(f"'type': 'spot', {LAMPS['spot']}", turns), sensor, "slices")
    assert [level for level, _ in warnings] == ["warning", "warning"]
    assert "black at 1 s" in warnings[0][1]
    assert "(rms, at 0 s): write interpolation_error" in warnings[1][1]


# --- the command --------------------------------------------------------------------------------------


def test_the_command_prints_a_line_a_finding_and_ends_with_0(call, skeleton, sensor_file):
    skeleton()
    code, out, err = call("scenes", "check", "mine", "--sensor", sensor_file, "--variant", VARIANT)
    assert (code, err) == (0, "")
    assert all(line.startswith("mine ok ") for line in out.splitlines())


def test_progress_and_the_time_left_are_shown_on_a_terminal_and_in_a_log(call, skeleton, monkeypatch):
    scene = skeleton()

    def run(jobs, report, **_):
        for done in (0.0, 0.25, 0.5):
            report(jobs[0].name, done)
            sleep(0.15)
        yield jobs[0], (), None

    monkeypatch.setattr("saf_gen.authoring.jobs.run_scene_jobs", run)
    monkeypatch.setattr("saf_gen.cli._terminal.LOG_EVERY_S", 0.1)
    assert re.search("^scenes 50%: check mine$", call("scenes", "check", scene.id, progress=True)[2], re.MULTILINE)
    terminal = Console(file=StringIO(), force_terminal=True, width=80)
    monkeypatch.setattr("saf_gen.cli._terminal.err", terminal)
    assert call("scenes", "check", scene.id)[0] == 0
    shown = re.sub("\x1b\\[[^A-Za-z]*[A-Za-z]", "", terminal.file.getvalue())
    assert re.search(r"scenes check mine +\S+ +50 % +0:00:0", shown)


def test_an_error_is_exit_code_1_and_a_broken_card_does_not_stop_other_scenes(call, skeleton, monkeypatch, sensor_file):
    scene = skeleton(("target: [card]", "target: [cart]"))
    broken = scene.folder.parent / "broken"
    broken.mkdir()
    (broken / "scene.yaml").write_text("id: broken\n")
    monkeypatch.setattr("saf_gen.scene.scene_folder.scene_names", lambda: ["broken", "mine"])
    code, out, _ = call("scenes", "check", "--sensor", sensor_file, "--variant", VARIANT)
    assert code == 1
    assert "broken error card: " in out
    assert "mine error geometry: " in out


def test_a_folder_may_be_named_and_its_script_is_not_run(call, tmp_path, monkeypatch, sensor_file):
    monkeypatch.setattr(checks, "CHECKS_OF_BUILT_SCENES", (checks.check_reach,))
    shutil.copytree(SCENES / "workbench", tmp_path / "x/workbench")
    code, _, err = call("scenes", "check", tmp_path / "x/workbench", "--sensor", sensor_file, "--variant", VARIANT)
    assert (code, err) == (0, "")
    shutil.copytree(SCENES / "plane", tmp_path / "x/plane")
    code, _, err = call("scenes", "check", tmp_path / "x/plane")
    assert code == 2
    assert "scene.py is code, and would be run" in err
