"""Scenes drawn at random, and the benchmark: each draw on its own, no aliases, filters by what is there alone."""

import ast
from collections import Counter

import numpy as np
import pytest
from refusals import assert_says, refusal
from written_scenes import SensorGrid

from saf_gen.generate.resolve import resolve_recipe
from saf_gen.render import make_renderer

PITCH_M, WAVE_M = 20e-6, 555e-9  # for which the scene is drawn


def layout(modules, member):
    seen = modules["sight"].look(member.script_params["lens"], member.params["place_deg"])
    return modules["scene"].draw(member.script_params, seen)[0], seen


@pytest.mark.slow
def test_a_member_is_the_same_whenever_it_is_drawn_and_another_one_differs(family, modules):
    one, again, other = (family.draw_member("member", n) for n in (1, 1, 2))
    first, second, third = (layout(modules, m)[0] for m in (one, again, other))
    for name, picture in first.pictures.items():
        assert np.array_equal(picture, second.pictures[name])
        assert not np.array_equal(picture, third.pictures[name])
    assert np.array_equal(first.target.halves, second.target.halves)


@pytest.fixture(scope="module")
def benchmark():
    return resolve_recipe("saf_bench")


@pytest.mark.slow
def test_every_lens_of_the_benchmark_steps_at_most_two_fifths_of_half_a_depth_of_focus(benchmark):
    used = {(s.planned.split, s.planned.params["lens"]): s for s in benchmark.all_sequences}
    for name, one in used.items():
        for place in (0.04, 0.5, 0.96):
            low, high = one.scene.build_drive().depth_of_focus(place, PITCH_M, wavelength_m=WAVE_M)
            assert 1 / (one.time_stack.specs[0].positions - 1) <= 0.41 * (high - low) / 2, name


@pytest.mark.parametrize("lens", ["wide_16mm_11", "liquid_18mm_15", "stage_40mm_21", "fast_50mm_91"])
@pytest.mark.parametrize("place_deg", [3.0, 60.0, 90.0, 170.0])
def test_a_target_is_in_focus_where_it_was_drawn_and_scales_are_those_of_the_lens(family, modules, lens, place_deg):
    card = family.card.lenses[lens]
    seen, drive = modules["sight"].look(card.model_dump(mode="json"), place_deg), card.build_drive()
    assert float(drive.best_position(seen.away / 1e3)) == pytest.approx(seen.place, abs=1e-9)
    low, high = drive.depth_of_focus(seen.place, PITCH_M, wavelength_m=WAVE_M)
    assert 2 / (high - low) == pytest.approx(seen.travel, rel=0.1)  # the travel is not quite even in half depths
    assert float(drive.best_position((seen.away + seen.half) / 1e3)) - seen.place == pytest.approx(
        (low - high) / 2 if not lens.startswith("stage") else (high - low) / 2, rel=0.1
    )


@pytest.mark.parametrize("kind", [
    "noise", "dead_leaves", "halftone", "weave", "print", "bark", "tissue", "circuit", "foliage", "specks", "paper",
])  # fmt: skip
@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_no_texture_holds_what_a_pixel_would_alias(modules, kind, factor):
    textures = modules["textures"]
    assert set(textures.KINDS) >= {kind}
    options = {"feature_px": 3.0, "slope": 0.8, "cut": 0.43, "narrowed": (0.6, factor)}
    picture = textures.texture(kind, 40, **options, random=np.random.default_rng(5))
    assert picture.dtype == np.float32
    assert (picture.mean(), picture.std()) == pytest.approx((0, 1), abs=1e-3)
    window = np.outer(*(np.hanning(n) for n in picture.shape))
    power = np.abs(np.fft.fft2(picture * window)) ** 2
    v, u = (f.copy() for f in np.meshgrid(*(np.fft.fftfreq(n, 0.5) for n in picture.shape), indexing="ij"))
    along = (u * np.cos(0.6) - v * np.sin(0.6)) / factor  # rows count downwards
    seen = np.hypot(along, u * np.sin(0.6) + v * np.cos(0.6))
    assert power[seen > 0.5 / factor].sum() < 1e-6 * power.sum()
    assert power[np.abs(along) > 0.5 / min(factor + 0.1, 1)].sum() < 1e-5 * power.sum()
    assert power[(seen > 0.1) & (seen < 0.4)].sum() > 1e-3 * power.sum()  # and it is no blur


def test_filters_look_at_contrast_cover_and_depth_alone(family, modules):
    scene, member = modules["scene"], family.draw_member("filters", 1).with_params({"form": "flat"})
    good, _ = layout(modules, member)
    assert scene.usable(good)
    for picture in good.pictures.values():
        assert 0.014 < picture.min() < picture.max() < 0.91
    grey = good.pictures | {"target": np.full_like(good.pictures["target"], 0.4)}
    assert not scene.usable(good._replace(pictures=grey))
    assert not scene.usable(good._replace(others=good.others._replace(hidden=0.41)))
    assert not scene.usable(good._replace(target=good.target._replace(halves=50 * good.target.x)))


def test_no_script_of_the_scene_knows_a_focus_measure(family):
    imported = {
        name.name if isinstance(node, ast.Import) else node.module
        for file in (*family.folder.glob("*.py"), *family.kit_files().values())
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in node.names
    }
    assert {name for name in imported if name.startswith("saf_gen")} == {"saf_gen.render.meshes"}


def test_a_layout_that_cannot_be_used_is_drawn_again_and_none_is_an_error(family, modules, monkeypatch):
    member = family.draw_member("again", 1)
    seen = modules["sight"].look(member.script_params["lens"], member.params["place_deg"])
    drawn = []
    monkeypatch.setattr(modules["scene"], "_draw", lambda params, sight, random: drawn.append(random.random()))
    monkeypatch.setattr(modules["scene"], "usable", lambda layout: len(drawn) == 3)
    assert modules["scene"].draw(member.script_params, seen)[1] == 3
    assert len(set(drawn)) == 3
    monkeypatch.setattr(modules["scene"], "usable", lambda layout: False)
    with pytest.raises(ValueError, match="none of 30 layouts"):
        modules["scene"].draw(member.script_params, seen)


@pytest.mark.slow
def test_members_of_the_benchmark_have_a_lens_motion_each_and_ten_for_each_place_of_focus(benchmark):
    places = {"first": 0, "last": 0, "middle": 0, "outside": 0}
    members = {s.planned.counted_as: s for s in benchmark.all_sequences if s.planned.split == "test"}
    assert len(members) == 240
    for one in members.values():
        lens = one.planned.lens_course(400, readout_hz=400)[0]
        place = 0.5 - 0.46 * np.cos(np.radians(one.planned.params["place_deg"]))
        off = lens - place
        low, high = one.scene.build_drive().depth_of_focus(place, PITCH_M, wavelength_m=WAVE_M)
        met = np.flatnonzero(np.diff(np.sign(off)))
        when = (met[0] if met.size else np.abs(off).argmin()) / lens.size
        outside = np.abs(off).min() > high - low
        places["outside" if outside else "first" if when < 0.1 else "last" if when > 0.9 else "middle"] += 1
    assert min(places.values()) >= 10
    assert len({str(s.planned.motion) + str(s.planned.params["place_deg"]) for s in members.values()}) == 240


@pytest.mark.slow
def test_no_two_splits_of_the_benchmark_share_a_member(benchmark):
    drawn = {s.planned.counted_as: (s.planned.split, s.planned.params["seed"]) for s in benchmark.all_sequences}
    counts = Counter(split for split, _ in drawn.values())
    assert counts == {"train": 120, "validation": 60, "test": 240, "test_far": 40, "test_moving": 40}
    assert len({seed for _, seed in drawn.values()}) == sum(counts.values())


@pytest.mark.slow
def test_members_render_with_light_on_their_target(family):
    grid = SensorGrid(rows=32, columns=32, pitch_m=80e-6)
    for n, form in enumerate(("ball", "two_depths")):
        member = family.draw_member("render", n).with_params({"form": form})
        renderer = make_renderer(member, grid, backend_name="scalar")
        seen = renderer.trace_geometry()
        renderer.require_own_light(seen)
        stack = renderer.render_stack(seen, positions=3, samples=2)
        assert seen.target.mean() > 0.05
        assert np.isfinite(stack.radiance).all()
        assert stack.radiance[0, 1][seen.target].mean() > 0


def test_a_lens_that_a_card_does_not_list_is_refused(family):
    assert family.draw_member("lens", 1).build_drive() != family.draw_member("lens", 2).build_drive()
    message = refusal(family.with_params, {"lens": "near_35mm_26"})
    assert_says(message, "lens of scene 'assorted_moving' | near_35mm_26 | near_35mm_25")
