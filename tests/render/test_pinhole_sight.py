"""What a pixel shows through clear surfaces, and the depth at which the lens must be focused on it."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from refusals import refusal
from written_scenes import JIT, dispersion, load_setup, needs_llvm, render_stack_once, write_scene

from saf_gen.render import pinhole_sight
from saf_gen.render.depth_and_target import trace_geometry
from saf_gen.render.own_light import require_own_light
from saf_gen.render.pinhole_sight import PinholeSight
from saf_gen.render.render_setup import SensorGrid
from studies.laws.pupils import find_peak

GRID = SensorGrid(rows=10, columns=16, pitch_m=240e-6)
LENS = "{focal_length_mm: 25, f_number: 2.0, drive: image_distance, focus_range_m: [0.60, 0.42]}"
WALL = "'type': 'rectangle', 'to_world': t.translate([0, 0, {z} * m]).rotate([0, 1, 0], 180).scale({half} * m)"
ROOM = "'room': {'type': 'constant', 'radiance': 1.0}"
NULL, GLASS, THIN = (
    "{'type': 'null'}",
    "{'type': 'dielectric', 'int_ior': 1.5, 'ext_ior': 1.0}",
    "{'type': 'thindielectric'}",
)
GREY = "{'type': 'twosided', 'bsdf': {'type': 'diffuse', 'reflectance': 0.5}}"
CHECKS = (
    "{'type': 'bitmap', 'raw': True, 'filter_type': 'nearest', 'data': mi.TensorXf(np.array([[0.0, 1.0]])[..., None])}"
)


def wall(name, z, bsdf=GREY, *, half=0.5):
    return f"'{name}': {{{WALL.format(z=z, half=half)}, 'bsdf': {bsdf}}}"


def ball(name, z, bsdf, *, radius=0.02):
    return f"'{name}': {{'type': 'sphere', 'center': [0, 0, {z} * m], 'radius': {radius} * m, 'bsdf': {bsdf}}}"


def pane(name, z, bsdf, *, thickness=0.03, half=0.5):
    scale = f"t.translate([0, 0, {z} * m]).scale([{half} * m, {half} * m, {thickness / 2} * m])"
    return f"'{name}': {{'type': 'cube', 'to_world': {scale}, 'bsdf': {bsdf}}}"


@pytest.fixture(params=["scalar", pytest.param(JIT, marks=needs_llvm)])
def look(request, tmp_path, monkeypatch):
    """Load a scene of these shapes, with the lens 0.5 m in front of the target's place, and trace it.

    If ``strict``, a target out of sight is refused.
    """

    def looked(*shapes, target="target", grid=GRID, unit_m=1.0, lens=LENS, light="room", strict=False):
        folder = Path(tempfile.mkdtemp(dir=tmp_path))
        text = "{" + ", ".join([*shapes, *([] if light != "room" or "room" in "".join(shapes) else [ROOM])]) + "}"
        scene = write_scene(
            folder, monkeypatch, lens=lens, distance_m=0.5, shapes=text, light=light, target=target, unit_m=unit_m
        )
        setup = load_setup(scene, (light,), name=request.param, grid=grid)
        return setup, trace_geometry(setup, scene.card.target, allow_unseen_target=not strict)

    return looked


PRINT = wall("target", 0.0, half=0.02)
MASK = "{{'type': 'mask', 'opacity': {}, 'bsdf': {{'type': 'diffuse'}}}}"
BEFORE = {
    "nothing": [],
    "a null ball": [ball("fog", -0.1, NULL)],
    "a null box about the camera": [pane("fog", -0.3, NULL, thickness=0.9)],
    "a mask of opacity 0": [wall("film", -0.05, MASK.format(0.0))],
    "a mask of opacity 0.3": [wall("film", -0.05, MASK.format(0.3))],
    "thin glass": [wall("film", -0.05, THIN)],
    "thin dark glass": [wall("film", -0.05, "{'type': 'thindielectric', 'specular_transmittance': 0.1}")],
    "thin principled glass": [
        wall("film", -0.05, "{'type': 'principledthin', 'spec_trans': 1.0, 'roughness': 0.0, 'eta': 1.5}")
    ],
    "two films": [wall("film", -0.05, THIN), wall("other", -0.03, MASK.format(0.2))],
    "a blend with nothing": [
        wall("film", -0.05, "{'type': 'blendbsdf', 'weight': 0.1, 'a': {'type': 'null'}, 'b': {'type': 'diffuse'}}")
    ],
}


@pytest.mark.parametrize("before", BEFORE.values(), ids=BEFORE.keys())
def test_a_target_behind_what_lets_light_straight_through_is_seen_at_its_own_depth(look, before):
    _, seen = look(*before, PRINT)
    assert seen.target.sum() == 64  # the print is eight pixels wide
    assert seen.depth[seen.target] == pytest.approx(0.5, rel=1e-6)


HIDDEN = {
    "a mask of opacity 0.7": wall("film", -0.05, MASK.format(0.7)),
    "paper": wall("film", -0.05),
    "a mirror": wall("film", -0.05, "{'type': 'conductor'}"),
    "frosted glass": pane("film", -0.05, "{'type': 'roughdielectric', 'alpha': 0.3}"),
    "frosted principled glass": pane("film", -0.05, "{'type': 'principled', 'spec_trans': 1.0, 'roughness': 0.5}"),
    "glass painted black": pane("film", -0.05, "{'type': 'dielectric', 'specular_transmittance': 0.0}"),
    "plastic": pane("film", -0.05, "{'type': 'plastic'}"),
    "a blend with little glass": wall(
        "film", -0.05, "{'type': 'blendbsdf', 'weight': 0.9, 'a': {'type': 'null'}, 'b': {'type': 'diffuse'}}"
    ),
}


@pytest.mark.parametrize("before", HIDDEN.values(), ids=HIDDEN.keys())
def test_a_target_behind_what_hides_it_is_not_visible(look, before):
    assert "(target) is not visible" in refusal(look, before, PRINT, strict=True).problem


INVISIBLE = {
    "a null ball": ball("target", 0.0, NULL),
    "a null sheet": wall("target", 0.0, NULL),
    "the boundary of fog": "'target': {'type': 'sphere', 'radius': 0.05 * m, 'bsdf': {'type': 'null'}, 'interior': "
    "{'type': 'homogeneous', 'albedo': 0.9, 'sigma_t': 1.0}}",
    "opacity 0": wall("target", 0.0, MASK.format(0.0)),
    "a picture of opacity 0": wall("target", 0.0, MASK.format(CHECKS.replace("1.0", "0.0"))),
    "a null blend": wall(
        "target", 0.0, "{'type': 'blendbsdf', 'weight': 0.5, 'a': {'type': 'null'}, 'b': {'type': 'null'}}"
    ),
}


@pytest.mark.parametrize("shape", INVISIBLE.values(), ids=INVISIBLE.keys())
def test_an_invisible_target_is_not_visible(look, shape):
    assert "(target) is not visible" in refusal(look, shape, wall("wall", 0.1), strict=True).problem


def test_depth_is_that_of_the_first_visible_surface(look):
    """A null ball before a wall, and a sheet whose left half is open (opacity 0 and 1, two texels)."""
    _, seen = look(ball("fog", -0.1, NULL), wall("target", 0.04))
    assert seen.depth == pytest.approx(0.54, rel=1e-6)
    _, seen = look(wall("target", 0.0, MASK.format(CHECKS)), wall("wall", 0.04))
    assert seen.target.sum() == seen.target.size / 2
    assert seen.depth == pytest.approx(np.where(seen.target, 0.5, 0.54), rel=1e-6)


PANES = {
    "dielectric": GLASS,
    "dielectric in water": "{'type': 'dielectric', 'int_ior': 1.5, 'ext_ior': 1.333}",
    "almost smooth": "{'type': 'roughdielectric', 'alpha': 0.001, 'int_ior': 1.5, 'ext_ior': 1.0}",
    "principled": "{'type': 'principled', 'spec_trans': 1.0, 'roughness': 0.0, 'eta': 1.5}",
    "Blender's glass": "{'type': 'principled', 'spec_trans': 1.0, 'roughness': 0.05, 'specular': 0.5}",
    "bumps that are flat": "{'type': 'bumpmap', 'map': {'type': 'bitmap', 'raw': True,"
    " 'data': mi.TensorXf(np.full((2, 2, 1), 0.5))}, 'glass': " + GLASS + "}",
}


@pytest.mark.slow
@pytest.mark.daily(4)
@pytest.mark.parametrize("glass", PANES.values(), ids=PANES.keys())
@pytest.mark.parametrize("unit_m", [1.0, 0.001], ids=["m", "mm"])
def test_a_window_of_thickness_t_brings_the_target_nearer_by_t_times_1_minus_1_by_n(look, glass, unit_m):
    """Glass of 30 mm brings a target from 0.5 m to 0.49 m. The field is up to 5 degrees, the lens f/2.

    Mitsuba starts rays 90 µm off a surface if the unit is a metre, which brings pictures and truth nearer by 180 µm.
    """
    index = 1.5 / 1.333 if "1.333" in glass else 1.5
    setup, seen = look(pane("window", -0.1, glass), PRINT, unit_m=unit_m)
    assert seen.target.sum() >= 64
    shift = 0.03 * (1 - 1 / index) + (1.8e-4 if unit_m == 1 else 0.0)
    assert 0.5 - seen.depth[seen.target] == pytest.approx(shift, rel=0.01)
    truth = setup.in_focus.true_focus(seen.depth, seen.target)
    assert truth == pytest.approx(float(setup.drive.best_position(0.5 - shift)), abs=3e-4)
    assert seen.residual_blur_px < 0.01


def test_a_ball_lens_before_the_target_magnifies_its_depth_by_the_thick_lens_formula(look):
    """A ball of radius R and index n has f = nR / (2(n - 1)) from its middle; the target is g behind that, g < f.

    The image of the target is virtual, at b = 1/(1/f - 1/g) behind the ball's middle.
    """
    radius, behind = 0.04, 0.05
    small = SensorGrid(rows=3, columns=3, pitch_m=20e-6)
    lens = "{focal_length_mm: 25, f_number: 8.0, drive: image_distance, focus_range_m: [2.0, 0.3]}"
    _, seen = look(ball("lens", -behind, GLASS, radius=radius), PRINT, grid=small, lens=lens)
    focal = 1.5 * radius / (2 * 0.5)
    image = 1 / (1 / behind - 1 / focal)
    assert seen.target.all()
    assert seen.depth == pytest.approx(0.5 - behind + image, rel=0.02)


def test_glass_as_the_target_is_at_its_own_surface(look):
    _, seen = look(ball("target", 0.0, GLASS), wall("wall", 0.1))
    assert seen.depth[seen.target].min() == pytest.approx(0.48, rel=2e-3)


def test_a_film_with_holes_on_the_targets_plate_counts_as_one_with_it(look):
    """The film is 20 µm before the plate, at 0.5 m; a leaf with holes 1 cm before another leaf is not one with it."""
    for gap, depth in ((2e-5, 0.5), (0.01, 0.51)):
        film = wall("film", 0.0, MASK.format(CHECKS))
        _, seen = look(film.replace("film", "target"), wall("plate", gap), target="target, plate", unit_m=0.001)
        assert seen.target.all()
        half = seen.depth[:, [0, -1]]
        assert sorted(half[0]) == pytest.approx([0.5, depth], rel=1e-6)


GROUP = (
    "'group': {'type': 'shapegroup', 'leaf': {'type': 'rectangle'}, 'stem': {'type': 'cube', 'to_world': t.scale(0.2)}}"
)


def instance(name, x, z=0.0):
    place = f"t.translate([{x} * m, 0, {z} * m]).rotate([0, 1, 0], 180).scale(0.02 * m)"
    return f"'{name}': {{'type': 'instance', 'group': {{'type': 'ref', 'id': 'group'}}, 'to_world': {place}}}"


@pytest.mark.daily(4)
@pytest.mark.parametrize(
    ("target", "pixels", "depth"), [("first", 64, 0.5), ("second", 64, 0.5), ("leaf", 124, 0.5), ("stem", 4, 0.496)]
)
@pytest.mark.parametrize("behind_glass", [False, True])
def test_an_instance_and_a_shape_of_its_group_can_be_targets(look, target, pixels, depth, behind_glass):
    before = [wall("film", -0.05, THIN)] if behind_glass else []
    _, seen = look(GROUP, instance("first", -0.02), instance("second", 0.02), *before, target=target)
    assert seen.target.sum() == pixels
    assert seen.depth[seen.target].max() == pytest.approx(depth, abs=1e-3)


LAMP = "'room': {'type': 'point', 'position': [0, 0, -0.3 * m], 'intensity': 1.0}"
BEHIND = LAMP.replace("-0.3", "0.02")
NEAR = LAMP.replace("-0.3", "-0.03")
OWN = {
    "grey": ([PRINT, LAMP], True),
    "black": ([wall("target", 0.0, "{'type': 'diffuse', 'reflectance': 0.0}"), LAMP], False),
    "turned away": (["'target': {'type': 'rectangle', 'bsdf': {'type': 'diffuse'}}", LAMP], False),
    "in full shadow": ([PRINT, BEHIND], False),
    "partly in shadow": ([PRINT, LAMP, wall("screen", -0.29, half=0.0003)], True),
    "a lamp": ([f"'target': {{{WALL.format(z=0, half=0.02)}, 'emitter': {{'type': 'area', 'radiance': 1.0}}}}"], True),
    "behind glass": ([PRINT, NEAR, wall("film", -0.05, THIN)], True),
    "black behind bright glass": (
        [wall("target", 0.0, "{'type': 'diffuse', 'reflectance': 0.0}"), LAMP, wall("film", -0.05, MASK.format(0.4))],
        False,
    ),
    "a clear pane before a lit wall": ([wall("target", 0.0, THIN), BEHIND, wall("wall", 0.1)], False),
    "a stained pane before a lit wall": (
        [wall("target", 0.0, "{'type': 'thindielectric', 'specular_transmittance': 0.7}"), BEHIND, wall("wall", 0.1)],
        True,
    ),
    "glass that bends": ([ball("target", 0.0, GLASS), ROOM], True),
    "a mirror of the dark": ([wall("target", 0.0, "{'type': 'conductor'}"), LAMP], False),
}


@pytest.mark.daily(4)
@pytest.mark.parametrize(("shapes", "shines"), OWN.values(), ids=OWN.keys())
def test_a_target_must_send_light_of_its_own(look, shapes, shines):
    setup, seen = look(*shapes, light="target" if "emitter" in shapes[0] else "room")
    if shines:
        require_own_light([setup], ("target",), seen=seen)
    else:
        error = refusal(require_own_light, [setup], ("target",), seen=seen)
        assert "(target) is black: its own light reaches 0.0% of its pixels" in error.problem


@pytest.mark.slow
@needs_llvm
@pytest.mark.parametrize("thickness", [0.0, 0.03])
def test_a_rendered_stack_is_sharpest_where_the_target_appears(tmp_path, monkeypatch, thickness):
    """A checkerboard behind 30 mm of glass: the peak of its contrast, within a tenth of the shift of 10 mm."""
    squares = "{'type': 'checkerboard', 'to_uv': t.scale(12), 'color0': 0.1, 'color1': 0.9}"
    shapes = [wall("target", 0.0, f"{{'type': 'diffuse', 'reflectance': {squares}}}", half=0.02), ROOM]
    if thickness:
        shapes.append(pane("window", -0.1, GLASS, thickness=thickness))
    text = "{" + ", ".join(shapes) + "}"
    scene = write_scene(tmp_path, monkeypatch, lens=LENS, distance_m=0.5, shapes=text, light="room", target="target")
    setup = load_setup(scene, ("room",), grid=SensorGrid(rows=40, columns=64, pitch_m=20e-6), max_depth=8)
    seen = trace_geometry(setup, ("target",))
    truth = setup.in_focus.true_focus(seen.depth, seen.target)
    positions = 33
    stack = render_stack_once(setup, positions=positions, samples=16, seed=1)
    peak = find_peak(dispersion(stack)) / (positions - 1)
    shift = float(setup.drive.best_position(0.49) - setup.drive.best_position(0.5))
    assert peak == pytest.approx(truth, abs=0.1 * shift)


@pytest.mark.slow
@needs_llvm
def test_lines_that_one_kernel_follows_are_those_followed_from_surface_to_surface(tmp_path, monkeypatch):
    """Bit for bit, through balls in which light is reflected totally, thin and dark films, and films with holes."""
    shapes = [
        *(ball(f"ball{n}", z, GLASS, radius=radius) for n, (z, radius) in enumerate([(-0.2, 0.03), (-0.2, 0.01)])),
        wall("film", -0.1, MASK.format(CHECKS)),
        wall("thin", -0.05, "{'type': 'principledthin', 'spec_trans': 1.0, 'roughness': 0.0, 'eta': 1.5}"),
        wall("holes", 0.0, MASK.format(0.3)),
        wall("target", 0.01),
        ROOM,
    ]
    text = "{" + ", ".join(shapes) + "}"
    scene = write_scene(tmp_path, monkeypatch, lens=LENS, distance_m=0.5, shapes=text, light="room", target="target")
    setup = load_setup(scene, ("room",), grid=GRID)
    random = np.random.default_rng(7)
    direction = np.column_stack([random.uniform(-0.12, 0.12, (3000, 2)), np.ones(3000)])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    origin = np.broadcast_to([0.0, 0.0, -0.5], direction.shape)
    together, apart = (PinholeSight(setup.mitsuba_scene, ("target",)) for _ in range(2))
    assert together._bends_on_device
    apart._bends_on_device = False
    monkeypatch.setattr(pinhole_sight, "LINES_AT_ONCE", 1024)  # the last kernel has fewer lines
    one, other = together.follow(origin, direction), apart.follow(origin, direction)
    assert 0 < one.bent.mean() < 1
    assert one.passed.max() > 3
    for name in one._fields:
        found, expected = getattr(one, name), getattr(other, name)
        if name in ("last", "instance"):
            found, expected = (
                [sight.name_of(int(n)) for n in numbers] for sight, numbers in ((together, found), (apart, expected))
            )
        assert np.array_equal(found, expected), name
