"""The renderer against closed forms, and against Mitsuba's own thin lens."""

from dataclasses import replace

import numpy as np
import pytest

from saf_gen.errors import BadInput
from saf_gen.focal_stack import StackSpec, StackStore
from saf_gen.render import geometry, one_pass, render_missing, thinlens, variant, world
from saf_gen.render.film import Film, Setup
from saf_gen.scene import find_scene

FILM = Film(rows=40, columns=64, pitch_m=60e-6)
needs_llvm = pytest.mark.skipif(not variant.probe().llvm_usable, reason=variant.probe().llvm_in_words)


@pytest.fixture
def plane(test_scenes):
    return find_scene("plane")


def one_pass_stack(setup, **options):
    """The stack alone; none of these scenes has a firefly."""
    stack, clipped = one_pass.render_stack(setup, **options)
    assert clipped == 0
    return stack


def loaded(scene, burning=("lamp", "room"), name="llvm"):
    variant.use(name)
    lit, integrator = world.load(world.build(scene), burning, 3)
    return Setup(lit, integrator, world.camera_to_world(scene), scene.drive(), FILM)


def edge_scene(folder, monkeypatch):
    """A bright half plane and a dark one, 0.5 m away, lit evenly: the camera sees one straight edge."""
    scene = folder / "edge"
    scene.mkdir()
    (scene / "scene.yaml").write_text(
        "id: edge\ntitle: An edge\nlicence: Apache-2.0\nsource: here\n"
        "camera: {origin_m: [0, 0, 0], look_at_m: [0, 0, 1]}\n"
        "lens: {focal_length_mm: 25, f_number: 2.0, focus_range_m: [0.60, 0.42]}\n"
        "lights: {glow: [glow]}\ntarget: [glow]\n"
    )
    (scene / "scene.py").write_text(
        "import mitsuba as mi\n"
        "def build(params):\n"
        "    t = mi.ScalarTransform4f()\n"
        "    place = t.translate([0.5, 0, 0.5]).rotate([0, 1, 0], 180).scale(0.5)\n"
        "    return {'glow': {'type': 'rectangle', 'to_world': place,\n"
        "            'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': 1.0}}}}\n"
    )
    monkeypatch.setenv("SAF_GEN_SCENES", str(folder))
    return find_scene("edge")


@needs_llvm
def test_one_pass_agrees_with_mitsubas_thin_lens_at_five_positions(plane):
    """Welch's t in every pixel of five positions, 12 + 12 renders of 64 samples, fixed seeds.

    With 22 degrees of freedom t² has mean 1.1 and standard deviation about 1.8, so its mean over 2,560
    pixels scatters by 0.036: the bounds are 6 sigma wide (2e-9). A shift of half a pixel, or a scale off
    by 1 %, gives means of 3 and more.
    """
    scene = loaded(plane)
    repeats, positions = 12, np.linspace(0, 1, 5)
    ours = np.array([one_pass_stack(scene, positions=5, samples=64, seed=s) for s in range(repeats)])
    for k, position in enumerate(positions):
        theirs = np.array(
            [
                thinlens.render_at(scene, position=float(position), samples=64, seed=1000 + s)
                for s in range(repeats)
            ]
        )
        error = (ours[:, k].var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / repeats
        t2 = (ours[:, k].mean(axis=0) - theirs.mean(axis=0)) ** 2 / error
        assert 0.85 < t2.mean() < 1.35, f"position {position}: mean t² {t2.mean():.3f}"


@needs_llvm
def test_light_groups_alone_add_up_to_all_together(plane):
    """Welch's t over 10 + 10 means of a whole stack, bound 5 sigma of 18 degrees of freedom (1e-4)."""

    def means(burning, first_seed):
        scene = loaded(plane, burning)
        stacks = [one_pass_stack(scene, positions=2, samples=64, seed=first_seed + s) for s in range(10)]
        return np.array([float(s.mean()) for s in stacks])

    apart = means(("lamp",), 0) + means(("room",), 100)
    together = means(("lamp", "room"), 200)
    error = np.sqrt((apart.var(ddof=1) + together.var(ddof=1)) / 10)
    assert abs(apart.mean() - together.mean()) < 5 * error
    assert error < 0.005 * together.mean()


@needs_llvm
def test_the_truth_is_the_maximum_of_noise_free_sharpness_within_half_a_step(plane):
    scene = loaded(plane)
    seen = geometry.look(scene, plane.card.target)
    stack = one_pass_stack(scene, positions=33, samples=256, seed=1).astype(np.float64)
    sharpness = stack.var(axis=(1, 2)) / stack.mean(axis=(1, 2)) ** 2
    k = int(sharpness.argmax())
    near = slice(k - 4, k + 5)
    curve = np.polynomial.Polynomial.fit(np.arange(33)[near], sharpness[near], 2)
    peak = float(curve.deriv().roots()[0])
    assert abs(peak - 32 * plane.drive().truth(seen.depth[seen.target])) < 0.5


@needs_llvm
@pytest.mark.parametrize("position", [0.0, 0.25, 0.85, 1.0])
def test_an_edge_is_blurred_by_the_width_of_the_closed_form(tmp_path, monkeypatch, position):
    """The profile of an edge blurred by a disc of diameter c has a derivative of standard deviation c/4.

    3 million paths an image; the fitted width scatters by 0.3 % between seeds, the bound is 2 %.
    """
    scene = edge_scene(tmp_path, monkeypatch)
    film = Film(rows=40, columns=160, pitch_m=5e-6)
    setup = replace(loaded(scene, ("glow",)), film=film)
    stack = one_pass_stack(setup, positions=21, samples=400, seed=2).astype(np.float64)
    profile = stack[round(position * 20)].mean(axis=0)
    slope = np.abs(np.diff(profile))
    slope /= slope.sum()
    x = np.arange(slope.size)
    centre = (slope * x).sum()
    width = 4 * np.sqrt((slope * (x - centre) ** 2).sum()) * film.pitch_m
    assert width == pytest.approx(float(setup.drive.blur_diameter(position, 0.5)), rel=0.02)


@pytest.mark.parametrize("name", ["scalar", pytest.param("llvm", marks=needs_llvm)])
def test_a_sweep_shows_no_beat_with_the_positions(plane, name):
    """Half way between two positions SD is as large as at them, to 0.1 %.

    Monte Carlo noise that is not shared by neighbours averages out half way: with a seed for each position
    this is 3 % off at 36 samples. What is left (0.02 to 0.06 %) is the cross-fade of neighbouring blurs.
    """
    stack_of = thinlens.render_stack if name == "scalar" else one_pass.render_stack
    stack, _ = stack_of(loaded(plane, name=name), positions=65, samples=36, seed=1)
    at, half_way = dispersion(stack), dispersion((stack[1:] + stack[:-1]) / 2)
    assert half_way == pytest.approx((at[1:] + at[:-1]) / 2, rel=0.001)


def dispersion(stack):
    stack = stack.astype(np.float64)
    return stack.var(axis=(1, 2)) / stack.mean(axis=(1, 2)) ** 2


@needs_llvm
def test_defocus_conserves_flux(plane):
    """The mean of a field much larger than the blur stays within 1 % over the travel."""
    means = one_pass_stack(loaded(plane, ("room",)), positions=9, samples=64, seed=4).mean(axis=(1, 2))
    assert np.ptp(means) < 0.01 * means.mean()


@needs_llvm
def test_a_stack_is_the_same_bit_for_bit_when_made_again(plane):
    scene = loaded(plane)
    again = [one_pass_stack(scene, positions=5, samples=16, seed=9) for _ in range(2)]
    assert np.array_equal(again[0], again[1])


@needs_llvm
def test_depth_and_target_are_where_the_plane_is(plane):
    seen = geometry.look(loaded(plane), ("plane",))
    assert seen.depth == pytest.approx(0.5, abs=1e-6)
    assert seen.target.all()


@pytest.mark.parametrize("name", ["scalar", pytest.param("llvm", marks=needs_llvm)])
def test_the_target_is_found_beside_other_scenes_in_the_process(plane, name):
    others = [loaded(plane, name=name) for _ in range(2)]
    assert geometry.look(loaded(plane, name=name), ("plane",)).target.all()
    assert len(others) == 2


@needs_llvm
def test_a_target_out_of_sight_is_told(plane):
    setup = loaded(plane)
    with pytest.raises(BadInput, match=r"the target \(lamp\) is not visible to the camera"):
        geometry.look(setup, ("lamp",))


@needs_llvm
def test_a_target_that_the_lens_cannot_reach_is_told(plane):
    short = replace(loaded(plane), drive=replace(plane.drive(), focus_range_m=(0.45, 0.42)))
    with pytest.raises(BadInput, match=r"is 0.5 m away, out of the lens's reach; allowed: 0.42 to 0.45 m"):
        geometry.look(short, ("plane",))


def test_the_scalar_variant_renders_the_same_scene(plane, tmp_path):
    """Means of 3 positions, 64 samples, within 2 % of the one-pass stack's (scatter between seeds 0.3 %).

    Without LLVM there is nothing to compare with; what is stored, and what is not rendered twice, holds.
    """
    means = {}
    spec = StackSpec("plane", plane.digest, ("room",), plane.drive(), 40, 64, 60e-6, 3, 64, 3)
    for name in ("scalar", "llvm") if variant.probe().llvm_usable else ("scalar",):
        root = tmp_path / name
        assert render_missing(plane, spec, root, variant_name=name) == ["geometry", "room"]
        assert render_missing(plane, spec, root, variant_name=name) == []
        stack = StackStore(root, spec).load()
        assert stack.variant == name
        assert stack.depth == pytest.approx(0.5, abs=1e-5)
        means[name] = stack.radiance.mean()
    assert means["scalar"] == pytest.approx(means.get("llvm", means["scalar"]), rel=0.02)


@pytest.mark.parametrize(
    ("old", "new", "file", "told"),
    [
        (
            "lamp: [lamp]",
            "lamp: [lampe]",
            "scene.yaml",
            r"unknown emitter of light group 'lamp': 'lampe'; .*'lamp'\?",
        ),
        (
            "target: [plane]",
            "target: [plain]",
            "scene.yaml",
            r"unknown target shape 'plain'; .*mean 'plane'\?",
        ),
        (
            "  room: [room]\n",
            "",
            "scene.yaml",
            r"the emitter 'room' belongs to no light group; name it under lights",
        ),
        ("def build", "def built", "scene.py", r"scene.py failed: AttributeError: .*build"),
        ("return {", "return 1/0, {", "scene.py", r"scene.py failed: ZeroDivisionError: division by zero"),
        ("checkerboard", "chequerboard", "scene.py", r"Mitsuba cannot load the scene"),
    ],
)
def test_a_scene_that_cannot_be_built_is_told_in_one_line(plane, tmp_path, monkeypatch, old, new, file, told):
    import shutil

    folder = tmp_path / "plane"
    shutil.copytree(plane.folder, folder, ignore=shutil.ignore_patterns("__pycache__"))
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path))
    variant.use("scalar")
    with pytest.raises(BadInput, match=told) as caught:
        world.load(world.build(find_scene("plane")), ("lamp", "room"), 3)
    assert "\n" not in str(caught.value)
