"""The renderer against closed forms, and against Mitsuba's own thin lens."""

import gc
import shutil
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from refusals import refusal
from written_scenes import JIT, dispersion, load_setup, measure_edge, needs_llvm, render_stack_once, write_edge_scene

from saf_gen.optics import FocalLengthDrive, ImageDistanceDrive, Stage
from saf_gen.render import camera_rays, depth_and_target, mitsuba_scene, one_pass, render_missing, thin_lens
from saf_gen.render.render_setup import SensorGrid
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.focal_stack import StackSpec, StackStore
from studies.laws.pupils import find_peak

# The plane at 0.5 m is well inside each travel.
DRIVES = {
    "image_distance": ImageDistanceDrive(0.025, 2.0, (0.60, 0.42)),
    "focal_length": FocalLengthDrive(0.0263, 2.0, (0.60, 0.42)),
    "stage": Stage(0.025, 2.0, 1 / 19, (-0.08, 0.10)),
}
every_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)


@pytest.fixture
def plane(test_scenes):
    return find_scene("plane")


@pytest.mark.parametrize(("reference", "drive"), [("scalar", "image_distance"), (JIT, "stage")])
@needs_llvm
@pytest.mark.slow
def test_one_pass_agrees_with_mitsubas_thin_lens(plane, reference, drive):
    """Welch's t in every pixel of both ends of the travel, 8 + 8 renders of 32 samples, fixed seeds.

    With 14 degrees of freedom t² has mean 7/6 and standard deviation about 2.1, so that its mean over 2,560
    pixels scatters by 0.042: the bounds are at least 5 sigma away (1e-6). A shift of half a pixel, or an error
    of 1 % in the scale, gives means of at least 2.
    """
    options = {"positions": 2, "samples": 32}
    setup = load_setup(plane, drive=DRIVES[drive])
    ours = np.array([render_stack_once(setup, seed=s, **options) for s in range(8)])
    setup = load_setup(plane, name=reference, drive=DRIVES[drive])
    theirs = np.array([thin_lens.render_stack(setup, seed=1000 + s, **options)[0] for s in range(8)])
    error = (ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / 8
    t2 = ((ours.mean(axis=0) - theirs.mean(axis=0)) ** 2 / error).mean(axis=(1, 2))
    assert t2.min() > 0.9
    assert t2.max() < 1.4


@needs_llvm
@every_drive
def test_every_position_gets_the_samples_asked_for(plane, drive):
    """50 per pixel on the sensor and within the aperture, less as the image grows (v²), within 1 %."""
    setup, landed = load_setup(plane, drive=drive), np.zeros(5)
    for _, band in one_pass.trace_paths(setup, np.linspace(0, 1, 5), samples=50, seed=1):
        paths = band.to_host()
        for k in range(5):
            x, y = paths.first_x + k * paths.step_x, paths.first_y + k * paths.step_y
            counts = (x >= 0) & (x < setup.grid.columns) & (y >= 0) & (y < setup.grid.rows)
            if paths.begin is not None:
                counts &= (paths.begin <= k) & (k < paths.end)
            landed[k] += counts.sum()
    scale = drive.image_distance(np.linspace(0, 1, 5)) / drive.image_distance(0.5)
    assert landed / (setup.grid.rows * setup.grid.columns) == pytest.approx(50 / scale**2, rel=0.01)


@needs_llvm
@pytest.mark.slow
def test_an_even_light_is_even_at_both_ends_of_a_very_long_travel(plane, monkeypatch):
    """From 0.5 m to 36 mm the samples per pixel go from 4.2 to 0.4 times the requested number, in several passes."""
    monkeypatch.setattr(camera_rays, "RAYS_PER_PASS", 1 << 17)
    setup = load_setup(plane, drive=ImageDistanceDrive(0.025, 2.0, (0.5, 0.036)))
    sky, integrator = mitsuba_scene.load_lit_scene(
        {"sky": {"type": "constant", "radiance": 3.0}}, ("sky",), max_depth=2
    )
    stack = render_stack_once(replace(setup, mitsuba_scene=sky, integrator=integrator), positions=9, samples=16, seed=1)
    assert stack == pytest.approx(3.0, rel=1e-5)


@needs_llvm
@pytest.mark.slow
def test_light_groups_alone_add_up_to_all_together(plane):
    """Welch's t over 10 + 10 means of a stack, with a bound of 5 sigma at 18 degrees of freedom (1e-4)."""

    def means(burning, first_seed):
        scene = load_setup(plane, burning)
        stacks = [render_stack_once(scene, positions=2, samples=64, seed=first_seed + s) for s in range(10)]
        return np.array([float(s.mean()) for s in stacks])

    apart = means(("lamp",), 0) + means(("room",), 100)
    together = means(("lamp", "room"), 200)
    error = np.sqrt((apart.var(ddof=1) + together.var(ddof=1)) / 10)
    assert abs(apart.mean() - together.mean()) < 5 * error
    assert error < 0.005 * together.mean()


MM5 = 0.005  # off the axis, 0.5 m away: the edge is seen 0.26 mm from the middle of the picture
CARDS = {
    "image_distance": "{focal_length_mm: 25, f_number: 2.0, focus_range_m: [0.60, 0.42]}",
    "focal_length": "{drive: focal_length, image_distance_mm: 26.3, f_number: 2, focus_range_m: [0.6, 0.42]}",
    "stage": "{drive: stage, focal_length_mm: 25, f_number: 2, magnification: 0.0526, travel_m: [-.1, 0.08]}",
}


@needs_llvm
@pytest.mark.parametrize("kind", ["image_distance", "focal_length"])
@pytest.mark.slow
def test_an_edge_is_blurred_and_placed_by_the_closed_forms(tmp_path, monkeypatch, kind):
    """Its width is c within 2 %; it is at -v·h/d within 0.05 pixel, and narrowest at best focus within ½ step.

    One stack of 21 positions, 1.6 million paths. Between seeds the width scatters by 0.6 %, the edge by 0.014
    pixel, the narrowest position by 0.04 step. The stage is in tests/optics/test_microscope.py.
    """
    grid = SensorGrid(rows=20, columns=160, pitch_m=5e-6)
    scene = write_edge_scene(tmp_path, monkeypatch, lens=CARDS[kind], distance_m=0.5, edge_m=MM5)
    setup = load_setup(scene, ("glow",), grid=grid)
    drive = setup.drive
    assert drive.kind == kind
    stack = render_stack_once(setup, positions=21, samples=400, seed=2)
    for position in (0.0, 0.25, 0.85, 1.0):
        width, offset = measure_edge(stack[round(position * 20)], grid.pitch_m)
        assert width == pytest.approx(float(drive.blur_diameter(position, 0.5)), rel=0.02)
        assert offset == pytest.approx(-drive.image_distance(position) / 0.5 * MM5, abs=0.05 * grid.pitch_m)
    widths = np.array([measure_edge(image, grid.pitch_m)[0] for image in stack])
    assert abs(find_peak(-(widths**2)) - 20 * drive.best_position(0.5)) < 0.5


@pytest.mark.parametrize("name", [pytest.param("scalar", marks=pytest.mark.long), pytest.param(JIT, marks=needs_llvm)])
@pytest.mark.slow
def test_a_sweep_shows_no_beat_with_the_positions(plane, name):
    """Half way between two positions SD is as large as at them, to 0.1 %.

    Noise that neighbours do not share averages out half way: with one seed per position the difference is 3 % at 36
    samples. The remaining 0.02 to 0.06 % is the cross-fade of neighbouring blurs.
    """
    stack_of = thin_lens.render_stack if name == "scalar" else one_pass.render_stack
    stack, _ = stack_of(load_setup(plane, name=name), positions=65, samples=36, seed=1, window=(20, 32))
    at, half_way = dispersion(stack), dispersion((stack[1:] + stack[:-1]) / 2)
    assert half_way == pytest.approx((at[1:] + at[:-1]) / 2, rel=0.001)


@needs_llvm
@pytest.mark.slow
@pytest.mark.parametrize("drive", [DRIVES["image_distance"], DRIVES["stage"]])
def test_a_window_of_positions_is_that_part_of_the_stack(plane, drive):
    """Equal within noise: the mean squared difference against that of two stacks, 5120 pixels, 4 sigma.

    The window has another middle position; compared one step off, the difference is more than twice as large. On the
    stage, with a quarter of the samples but several paths for each, it is 28 times as large.
    """
    setup, samples = load_setup(plane, drive=drive), 64 if drive.kind == "stage" else 256
    full, other = (render_stack_once(setup, positions=5, samples=samples, seed=s) for s in (1, 2))
    part = render_stack_once(setup, positions=5, samples=samples, seed=3, window=(3, 4))
    assert part.shape == (2, setup.grid.rows, setup.grid.columns)
    noise = np.mean((full[3:5] - other[3:5]) ** 2)
    assert np.mean((part - full[3:5]) ** 2) < 1.2 * noise
    assert np.mean((part - full[2:4]) ** 2) > 2 * noise


def test_a_window_of_the_reference_is_that_part_of_its_stack(plane):
    setup = load_setup(plane, name="scalar")
    full, _ = thin_lens.render_stack(setup, positions=5, samples=4, seed=1)
    part, _ = thin_lens.render_stack(setup, positions=5, samples=4, seed=1, window=(1, 2))
    assert np.array_equal(part, full[1:3])


@needs_llvm
def test_a_stack_is_the_same_bit_for_bit_when_made_again(plane):
    setup = load_setup(plane, drive=DRIVES["stage"])
    again = [render_stack_once(setup, positions=5, samples=16, seed=9) for _ in range(2)]
    assert np.array_equal(again[0], again[1])


@needs_llvm
def test_shapes_of_one_surface_share_it_and_others_do_not(plane):
    """Only if it is the same dictionary, and refers to nothing by name."""
    glass, paint = {"type": "dielectric"}, {"type": "twosided", "bsdf": {"type": "ref", "id": "grey"}}
    bsdfs = {"a": glass, "b": glass, "c": dict(glass), "d": paint, "e": paint}
    described = {"grey": {"type": "diffuse"}} | {name: {"type": "sphere", "bsdf": b} for name, b in bsdfs.items()}
    load_setup(plane)
    loaded, _ = mitsuba_scene.load_lit_scene(described, (), max_depth=3)
    a, b, c, d, e = (shape.bsdf() for shape in loaded.shapes())
    assert a == b
    assert c != a
    assert d != e


@pytest.mark.parametrize("name", ["scalar", pytest.param(JIT, marks=needs_llvm)])
def test_the_target_is_found_with_other_scenes_in_the_process(plane, name):
    others = [load_setup(plane, name=name) for _ in range(2)]
    assert depth_and_target.trace_geometry(load_setup(plane, name=name), ("plane",)).target.all()
    assert len(others) == 2


@needs_llvm
def test_scenes_are_released_with_their_renderer(plane):
    """The indices of live scenes are part of a kernel's code, which would be compiled again for the next scene."""

    def first_free_index():
        return int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(mi.load_dict({"type": "sphere"})))[0])

    SceneRenderer(plane, SensorGrid(4, 6, 400e-6), backend_name=JIT).render_picture(0.5, samples=1)  # numba compiles
    gc.collect()  # the garbage of compilers and of other tests; this test must leave none
    gc.disable()
    try:
        renderer = SceneRenderer(plane, SensorGrid(4, 6, 400e-6), backend_name=JIT)
        before = first_free_index()
        for groups in (None, *((name,) for name in plane.card.lights)):
            renderer.prepare(groups)
        renderer.trace_geometry()
        renderer.render_region(0.5, samples=1, region=(slice(0, 2), slice(0, 2)))
        renderer.render_picture(0.5, samples=1)
        assert first_free_index() > before
        del renderer
        assert first_free_index() == before
    finally:
        gc.enable()


@needs_llvm
@pytest.mark.parametrize(
    ("drive", "allowed"),
    [
        (ImageDistanceDrive(0.025, 2.0, (0.45, 0.42)), "0.42 to 0.45 m (focus_range_m in scene.yaml)"),
        (FocalLengthDrive(0.026, 2.0, (0.60, 0.52)), "0.52 to 0.6 m (focus_range_m in scene.yaml)"),
        (Stage(0.025, 2.0, 1 / 19, (0.1, 0.02)), "0.52 to 0.6 m (travel_m in scene.yaml)"),
    ],
)
def test_a_target_that_the_lens_cannot_reach_is_refused(plane, drive, allowed):
    error = refusal(depth_and_target.trace_geometry, load_setup(plane, drive=drive), ("plane",))
    assert "0.5 m away" in error.problem
    assert error.allowed == allowed


@pytest.mark.parametrize("name", ["scalar", pytest.param(JIT, marks=needs_llvm)])
def test_a_stage_that_runs_into_the_lens_is_refused(plane, name):
    near = Stage(0.3, 2.0, 1.5, (0.3, 0.6))  # focuses 0.5 m away; the plane passes the lens at 0.5 m
    setup = load_setup(plane, name=name, drive=near)
    error = refusal(depth_and_target.trace_geometry, setup, ("plane",))
    assert "a surface is 0.5 m" in error.problem
    assert "0.6 m" in error.allowed


@pytest.mark.parametrize("name", ["scalar", pytest.param(JIT, marks=needs_llvm)])
def test_depth_counts_from_the_lens_of_the_card_wherever_the_stage_is(plane, name):
    seen = depth_and_target.trace_geometry(load_setup(plane, name=name, drive=DRIVES["stage"]), ("plane",))
    assert seen.depth == pytest.approx(0.5, abs=1e-6)


def test_a_stack_of_the_scalar_variant_is_stored_and_not_rendered_twice(plane, tmp_path):
    spec = StackSpec("plane", plane.digest, ("room",), plane.build_drive(), 40, 64, 60e-6, 2, 4, 3)
    assert render_missing(plane, [spec], root=tmp_path, backend_name="scalar") == ["geometry", "room"]
    assert render_missing(plane, [spec], root=tmp_path, backend_name="scalar") == []
    stack = StackStore(tmp_path, spec).load()
    assert stack.backend == "scalar"
    assert stack.depth == pytest.approx(0.5, abs=1e-5)


@pytest.mark.parametrize("kind", CARDS)
def test_the_scalar_variant_has_every_drive(tmp_path, monkeypatch, kind):
    """An edge at both ends of the travel: its width within 3 % and its position within 0.12 pixel of the closed forms.

    200,000 paths per picture, fixed seed; between seeds the width scatters by 0.7 %, the position by 0.03 pixel.
    """
    grid = SensorGrid(rows=8, columns=64, pitch_m=10e-6)
    scene = write_edge_scene(tmp_path, monkeypatch, lens=CARDS[kind], distance_m=0.5, edge_m=0.001)
    setup = load_setup(scene, ("glow",), name="scalar", grid=grid)
    drive = setup.drive
    stack, _ = thin_lens.render_stack(setup, positions=2, samples=400, seed=3)
    for position, image in zip((0.0, 1.0), stack, strict=True):
        width, offset = measure_edge(image, grid.pitch_m)
        assert width == pytest.approx(float(drive.blur_diameter(position, 0.5)), rel=0.03)
        scale = float(drive.image_distance(position) / (0.5 - drive.shift(position)))
        assert offset == pytest.approx(-scale * 0.001, abs=0.12 * grid.pitch_m)


@pytest.mark.parametrize(
    ("old", "new", "file", "message"),
    [
        ("lamp: [lamp]", "lamp: [lampe]", "scene.yaml", "did you mean 'lamp'?"),
        ("target: [plane]", "target: [plain]", "scene.yaml", "did you mean 'plane'?"),
        ("  room: [room]\n", "", "scene.yaml", "'room' belongs to no light group"),
        ("def build", "def built", "scene.py", "scene.py failed: AttributeError: "),
        ("return {", "return 1/0, {", "scene.py", "scene.py failed: ZeroDivisionError: division by zero"),
        ("return {", "raise SystemExit(2)\n    return {", "scene.py", "CodeStopped: its code called exit(2)"),
        ("checkerboard", "chequerboard", "scene.py", "the type 'chequerboard' is unknown"),
    ],
)
def test_a_scene_that_cannot_be_built_is_refused_in_one_line(plane, tmp_path, monkeypatch, old, new, file, message):
    folder = tmp_path / "plane"
    shutil.copytree(plane.folder, folder, ignore=shutil.ignore_patterns("__pycache__"))
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path))
    assert message in str(refusal(load_setup, find_scene("plane"), name="scalar"))
