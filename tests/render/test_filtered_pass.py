"""The filtered estimator of focal stacks against the plain one, in scenes with visible textures, lamps and glass."""

from dataclasses import replace

import numpy as np
import pytest
from written_scenes import SENSOR_GRID, load_setup, needs_llvm, render_filtered, write_scene

from saf_gen.render import camera_rays, filtered_pass, one_pass
from saf_gen.render.estimators import MomentShading
from saf_gen.scene.scene_folder import find_scene

pytestmark = needs_llvm

LENS = "{focal_length_mm: 25, f_number: 2.0, drive: image_distance, focus_range_m: [0.60, 0.42]}"
SHAPES = """{
    'wall': {'type': 'rectangle', 'to_world': t.translate([0, 0, 0.1 * m]).rotate([0, 1, 0], 180).scale(0.4 * m),
             'bsdf': {'type': 'diffuse', 'reflectance': {'type': 'bitmap', 'raw': True,
                      'bitmap': mi.Bitmap(np.random.default_rng(1).uniform(0.1, 0.9, (64, 64, 1)).astype('f4'))}}},
    'ball': {'type': 'sphere', 'center': [0.02 * m, 0, -0.02 * m], 'radius': 0.02 * m,
             'bsdf': {'type': 'roughplastic', 'alpha': 0.2}},
    'glass': {'type': 'sphere', 'center': [-0.03 * m, 0.01 * m, 0], 'radius': 0.015 * m,
              'bsdf': {'type': 'dielectric'}},
    'lamp': {'type': 'sphere', 'center': [0.1 * m, 0.1 * m, -0.2 * m], 'radius': 0.02 * m,
             'emitter': {'type': 'area', 'radiance': {'type': 'rgb', 'value': 20.0}}},
    'room': {'type': 'constant', 'radiance': {'type': 'rgb', 'value': 0.2}}}"""


@pytest.fixture
def still_life(tmp_path, monkeypatch):
    scene = write_scene(tmp_path, monkeypatch, lens=LENS, distance_m=0.5, shapes=SHAPES, light="lamp", target="ball")
    card = scene.folder / "scene.yaml"
    card.write_text(card.read_text().replace("lights: {lamp: [lamp]}", "lights: {lamp: [lamp], room: [room]}"))
    scene = find_scene("made")
    # Longer than any path, because only the plain estimator counts the segments in glass.
    return {name: load_setup(scene, (name,), max_depth=16) for name in scene.card.lights}


def filtered(setups, *, samples=16, positions=5, **options):
    return render_filtered(setups, samples=samples, positions=positions, **options)


@pytest.mark.slow
def test_the_mean_of_a_picture_is_that_of_the_plain_estimator(still_life):
    """Means over 16 blocks of 10 × 16 pixels under each light: 8 filtered renders of 16 samples, 8 plain ones of 32.

    All positions at once, and a window of two, which is summed in layers, with the same shading. The standard error of
    the difference comes from the scatter of both; a bias of 1 % of the mean is allowed. At 5 standard errors the
    largest of 2 × 16 × 7 blocks exceeds the bound once in 10⁴ runs. A missing reflectance, glass counted once instead
    of six times, or a lamp without its light would be at least 10 % off.
    """
    blocks = lambda stack: stack.reshape(len(stack), 4, 10, 4, 16).mean(axis=(2, 4), dtype=np.float64)  # noqa: E731
    plain = {
        name: np.array(
            [blocks(one_pass.render_stack(setup, positions=5, samples=32, seed=100 + s)[0]) for s in range(8)]
        )
        for name, setup in still_life.items()
    }
    options = {"samples": 16, "emitting": ["lamp", "room"]}
    shadings = [
        filtered_pass.estimate_shading([filtered_pass.gather_shading(still_life, seed=1000 + s, **options)])
        for s in range(8)
    ]
    for window, shown in ((None, slice(0, 5)), ((2, 3), slice(2, 4))):
        found = [
            filtered_pass.render_with_shading(still_life, shading, positions=5, seed=s, window=window, **options)
            for s, shading in enumerate(shadings)
        ]
        for name in still_life:
            ours, theirs = np.array([blocks(stacks[name][0]) for stacks in found]), plain[name][:, shown]
            error = np.sqrt((ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / 8)
            difference = np.abs(ours.mean(axis=0) - theirs.mean(axis=0))
            allowed = 0.01 * theirs.mean(axis=0) + 5 * error
            assert (difference <= allowed).all(), (window, name, (difference / allowed).max())


@pytest.mark.slow
def test_a_light_group_has_the_same_bits_alone(still_life):
    together = filtered(still_life)
    for name in still_life:
        shading = filtered_pass.estimate_shading(
            [filtered_pass.gather_shading({name: still_life[name]}, samples=8, seed=4, emitting=["lamp", "room"])]
        )
        both = filtered_pass.estimate_shading(
            [filtered_pass.gather_shading(still_life, samples=8, seed=4, emitting=["lamp", "room"])]
        )
        assert np.array_equal(shading.shading[:, 0], both.shading[:, list(still_life).index(name)])
    assert set(together) == set(still_life)


@pytest.mark.slow
@pytest.mark.parametrize("window", [None, (2, 3)], ids=["all positions at once", "layers of a few"])
def test_nothing_is_clipped_because_the_first_rows_are_dark(still_life, monkeypatch, window):
    """Bands of four rows, of which the first see no light. Of 140,000 rays a few through glass may be fireflies."""
    setups = {"lamp": still_life["lamp"]}
    shading = filtered_pass.estimate_shading(
        [filtered_pass.gather_shading(setups, samples=8, seed=4, emitting=["lamp", "room"])]
    )
    below = shading.shading.copy()
    rows = (shading.keys >> np.uint64(14)) & np.uint64((1 << 14) - 1)
    finest = (shading.keys >> np.uint64(59)) & np.uint64(7) == 0
    below[finest & (rows < 4096 + 2 * 10)] = 0  # half pixels: the first ten rows
    dark = replace(shading, shading=below)
    options = {"positions": 5, "samples": 4, "seed": 2, "emitting": ["lamp", "room"], "window": window}
    at_once, _ = filtered_pass.render_with_shading(setups, dark, **options)["lamp"]
    monkeypatch.setattr(camera_rays, "RAYS_PER_PASS", 4 * 90 * 24)
    in_bands, clipped = filtered_pass.render_with_shading(setups, dark, **options)["lamp"]
    assert clipped < 10
    assert in_bands.mean() == pytest.approx(at_once.mean(), rel=0.05)
    assert in_bands.max() > 0.5 * at_once.max()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits_and_another_another_picture(still_life):
    first, again, other = (filtered(still_life, seed=s)["lamp"] for s in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.slow
def test_moments_are_traced_once_and_estimates_do_not_depend_on_earlier_ones(still_life):
    shown = []

    def show(time_s):
        shown.append(time_s)
        return still_life

    running = MomentShading(show, seed=9, emitting=["lamp", "room"])
    for moments in ((0.0, 0.0, 0.0), (0.0, 0.0, 0.1), (0.0, 0.1, 0.2)):
        last = running.estimate(moments, samples=8)
    assert shown == [0.0, 0.0, 0.0, 0.1, 0.2]
    alone = MomentShading(show, seed=9, emitting=["lamp", "room"]).estimate((0.0, 0.1, 0.2), samples=8)
    assert np.array_equal(last.keys, alone.keys)
    assert np.array_equal(last.shading, alone.shading)


def test_a_scene_without_a_surface_to_share_is_rendered_from_plain_paths(tmp_path, monkeypatch):
    shapes = SHAPES.replace("'roughplastic', 'alpha': 0.2", "'dielectric'")
    shapes = "{" + shapes[shapes.index("'ball'") :]
    scene = write_scene(tmp_path, monkeypatch, lens=LENS, distance_m=0.5, shapes=shapes, light="room", target="ball")
    card = scene.folder / "scene.yaml"
    card.write_text(card.read_text().replace("lights: {room: [room]}", "lights: {all: [room, lamp]}"))
    setup = replace(load_setup(find_scene("made"), ("room", "lamp")), grid=SENSOR_GRID)
    stack = filtered({"all": setup}, positions=3)["all"]
    plain = one_pass.render_stack(setup, positions=3, samples=64, seed=5)[0]
    assert stack.mean() == pytest.approx(plain.mean(), rel=0.05)
    assert np.isfinite(stack).all()
