"""Slices at the same positions trace what stands still once, and no bit of their pictures changes."""

from dataclasses import replace

import numpy as np
import pytest
from written_scenes import SENSOR_GRID, needs_llvm, write_scene

import saf_gen.render
from saf_gen.render import render_missing, still_hits
from saf_gen.render.camera_rays import cast_rays
from saf_gen.render.scene_renderer import SceneRenderer
from saf_gen.render.still_hits import MovingFinder, StillHits
from saf_gen.render.surface_hits import SurfaceFinder
from saf_gen.scene.scene_folder import find_scene
from saf_gen.stack.focal_stack import StackSpec, StackStore

pytestmark = needs_llvm

LENS = "{focal_length_mm: 25, f_number: 2.0, drive: image_distance, focus_range_m: [0.60, 0.42]}"
# A card that passes before a board: it hides it, shades it, and is seen in the mirror beside it; behind all, the sky.
SHAPES = """{
    'board': {'type': 'rectangle', 'to_world': t.translate([0.01 * m, 0, 0]).rotate([0, 1, 0], 180).scale(
        [0.02 * m, 0.02 * m, 1]), 'bsdf': {'type': 'diffuse', 'reflectance': {'type': 'checkerboard'}}},
    'mirror': {'type': 'rectangle', 'bsdf': {'type': 'roughconductor', 'alpha': 0.05},
               'to_world': t.translate([-0.02 * m, 0, 0]).rotate([0, 1, 0], 150).scale([0.01 * m, 0.02 * m, 1])},
    'card': {'type': 'rectangle', 'to_world': t.translate([0, 0, -0.02 * m]).scale(0.006 * m),
             'bsdf': {'type': 'twosided', 'bsdf': {'type': 'diffuse'}}},
    'sun': {'type': 'directional', 'direction': [-1, -0.5, 1], 'irradiance': {'type': 'rgb', 'value': 3.0}},
    'sky': {'type': 'constant'}}"""
MOTION = "{card: {keyframes: [{time_s: 0}, {time_s: 1, translate_m: [0.3, 0.0, -0.05], rotate_deg: 90}]}}"
TIMES = [n / 100 for n in range(5)]


@pytest.fixture
def passing_card(tmp_path, monkeypatch):
    scene = write_scene(
        tmp_path, monkeypatch, lens=LENS, distance_m=0.5, shapes=SHAPES, light="sun,sky", target="board"
    )
    card = scene.folder / "scene.yaml"
    card.write_text(card.read_text() + f"motion: {MOTION}\nslices_per_s: 100\n")
    return find_scene("made")


def render(scene, folder, windows, wanted=None):
    """Render a slice at each of TIMES; return the pictures of the wanted ones, float32 (light, focus, row, col)."""
    specs = [
        replace(
            StackSpec.from_scene(
                scene, SENSOR_GRID, positions=9, samples=4, max_depth=4, time_s=time_s, wavelength_m=0.0, window=window
            ),
            moments_s=(TIMES[max(n - 1, 0)], time_s),
        )
        for n, (time_s, window) in enumerate(zip(TIMES, windows, strict=True))
    ]
    wanted = specs if wanted is None else [specs[n] for n in wanted]
    render_missing(scene, specs, root=folder, backend_name="llvm", wanted=wanted)
    return [StackStore(folder, spec).load().radiance for spec in wanted]


def render_anew(monkeypatch, *arguments, **options):
    """Render with every ray traced in every slice."""
    with monkeypatch.context() as patch:
        patch.setattr(saf_gen.render, "pairwise", lambda specs: [])
        return render(*arguments, **options)


WINDOWS = {
    "one window": [(3, 4)] * 5,
    "two windows": [(3, 5), (3, 5), (4, 5), (4, 6), (4, 6)],
    "the whole travel": [None] * 5,
}


@pytest.mark.parametrize("windows", WINDOWS.values(), ids=WINDOWS)
def test_pictures_are_those_of_rays_that_are_all_traced(passing_card, tmp_path, monkeypatch, windows):
    """Bit for bit, where the card hides the board, shades it and is seen in the mirror; the pictures do change."""
    found = render(passing_card, tmp_path / "kept", windows)
    anew = render_anew(monkeypatch, passing_card, tmp_path / "anew", windows)
    assert all(np.array_equal(one, other) for one, other in zip(found, anew, strict=True))
    assert not np.array_equal(found[0], found[1])


def test_a_slice_rendered_alone_is_the_same(passing_card, tmp_path):
    together = render(passing_card, tmp_path / "all", [(3, 4)] * 5)
    (alone,) = render(passing_card, tmp_path / "alone", [(3, 4)] * 5, wanted=[3])
    assert np.array_equal(together[3], alone)


def finders(scene, time_s):
    """Return the two finders of a moment, that of all rays and that of kept hits, and rays."""
    renderer = SceneRenderer(scene, SENSOR_GRID, backend_name="llvm", kept=1)
    setup = renderer.prepare(time_s=time_s)
    still = StillHits(
        replace(setup, mitsuba_scene=renderer.load_still(list(scene.card.lights)), moved_m={}),
        emitting=renderer.emitting,
    )
    kept = still.finder(setup, renderer.load_movers(time_s), window=(3, 4))
    focus = np.array([0.375, 0.5])
    return SurfaceFinder(setup, emitting=renderer.emitting), kept, next(cast_rays(setup, focus, samples=8, seed=1))


def test_rays_meet_the_same_surfaces_and_only_those_that_may_meet_the_card_are_traced_again(passing_card, monkeypatch):
    """The card covers a fifth of the picture or less."""
    whole, kept, rays = finders(passing_card, 0.02)
    assert isinstance(kept, MovingFinder)
    focus, traced = np.array([0.375, 0.5]), []
    expected = whole.find(rays, focus, seed=1)
    find = SurfaceFinder.find

    def count(self, rays, *arguments, **options):
        sight = find(self, rays, *arguments, **options)
        traced.append(sight.unshared.size)
        return sight

    monkeypatch.setattr(SurfaceFinder, "find", count)
    for _ in range(2):
        sight = kept.find(rays, focus, seed=1)
        for name, array in expected.hits._asdict().items():
            assert np.array_equal(getattr(sight.hits, name), array, equal_nan=name != "shape"), name
        assert np.array_equal(sight.unshared, expected.unshared)
        assert np.array_equal(sight.distances.end, expected.distances.end)
        assert [end.rays.tolist() for end in sight.lights] == [end.rays.tolist() for end in expected.lights]
    everything, again, once_more = traced
    assert everything == expected.unshared.size
    assert again == once_more
    assert 0 < again < everything / 5


def test_rays_that_find_no_room_are_traced_anew(passing_card, monkeypatch):
    monkeypatch.setattr(still_hits, "MAX_BYTES", 1000)
    whole, kept, rays = finders(passing_card, 0.02)
    focus = np.array([0.375, 0.5])
    one, other = (finder.find(rays, focus, seed=1) for finder in (whole, kept))
    assert np.array_equal(one.hits.shape, other.hits.shape)
    assert not kept._still._kept
