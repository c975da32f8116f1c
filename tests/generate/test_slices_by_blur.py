"""A recipe places the slices of a moving scene by the blur of what moves in it; nothing is rendered for it."""

import shutil
from itertools import pairwise

import pytest
from refusals import assert_says, refusal

from saf_gen.generate.resolve import resolve_recipe
from saf_gen.scene.scene_folder import find_scene, load_scene
from saf_gen.stack.all_in_focus import sharp_stack

RECIPE = """\
name: by_blur
seed: 7
camera: {sensor: vidar_400x250, frames: 20000, exposure: {mean_rate: 0.2}}
focus: {positions: 129, motion: {kind: sweep}}
render: {samples: 64, slice_samples: 16}
lights: {constant: {kind: constant}}
splits:
  test: {scenes: [bottle], lights: [constant], scene_motion: [dynamic]}
"""
STEP = 200  # frames between the slices of bottle as its card states them


@pytest.fixture
def resolve(tmp_path, monkeypatch):
    """A function that resolves the recipe with other keys of ``render``; the card says where bubbles move."""
    folder = tmp_path / "scenes" / "bottle"
    shutil.copytree(find_scene("bottle").folder, folder)
    with (folder / "scene.yaml").open("a") as card:
        card.write("moving_depth: {range_m: [-0.002, 0.052], param: distance_m}  # from face to back\n")
    monkeypatch.setenv("SAF_GEN_SCENES", str(folder.parent))

    def resolved(render=""):
        path = tmp_path / "by_blur.yaml"
        path.write_text(RECIPE.replace("render: {", f"render: {{{render}, " if render else "render: {"))
        return resolve_recipe(path).sequences[0]

    return resolved


def steps_of(stack):
    return [b - a for a, b in pairwise(stack.slice_frames)]


def test_slices_are_dense_where_bubbles_are_in_focus_and_up_to_three_times_as_far_apart_elsewhere(resolve):
    sequence = resolve()
    stack, drive = sequence.time_stack, sequence.scene.build_drive()
    assert stack.slice_frames[-1] == 20_000
    assert set(steps_of(stack)[:9]) == {3 * STEP}
    assert len(stack.specs) < 52  # 101 evenly spaced ones
    near, far = sequence.scene.card.moving_depth.range_of(sequence.scene.params)
    assert near == pytest.approx(sequence.scene.params["distance_m"] - 0.002)
    for (begin, end), spec in zip(pairwise(stack.slice_frames), stack.specs, strict=False):
        if near < float(drive.object_distance(float(spec.focus.mean()))) < far and end < 20_000:
            assert end - begin == STEP
    assert [spec.time_s for spec in stack.specs] == [frame / 20_000 for frame in stack.slice_frames]


def test_a_closed_loop_has_even_slices_because_nobody_knows_its_lens(resolve):
    some = resolve("whole_slices: 0.1")
    assert set(steps_of(some.closed_loop_stack)) == {STEP}
    assert some.time_stack == resolve().time_stack
    whole = resolve("whole_slices: true")
    assert set(steps_of(whole.time_stack)) == {STEP}


def test_more_slices_than_on_the_card_are_spaced_alike_and_fewer_are_even(resolve):
    fewer, more = (resolve(f"slices_per_s: {rate}").time_stack for rate in (50, 200))
    assert set(steps_of(fewer)) == {2 * STEP}
    assert min(steps_of(more)[:-1]) == 96  # whole bytes, at most half as far as on the card
    assert max(steps_of(more)) == 3 * 96


def test_all_in_focus_nothing_is_blurred_so_slices_are_dense_everywhere(resolve):
    sequence = resolve()
    position, _ = sequence.planned.lens_course(20_000, readout_hz=20_000)
    stack = sharp_stack(sequence.time_stack, position)
    assert set(steps_of(stack)) == {STEP}
    assert stack.specs[7].moments_s == tuple(max(n, 0) * STEP / 20_000 for n in range(-1, 8))


def test_a_card_may_leave_it_out(tmp_path, monkeypatch):
    assert find_scene("fan").card.moving_depth is None
    folder = tmp_path / "scenes" / "mine"
    folder.mkdir(parents=True)
    monkeypatch.setenv("SAF_GEN_SCENES", str(folder.parent))
    (folder / "scene.py").write_text("def build(params): ...\n")
    card = (find_scene("fan").folder / "scene.yaml").read_text().replace("id: fan", "id: mine")
    card += "moving_depth: {range_m: [0.012, 0.047], param: distance_m}\n"
    (folder / "scene.yaml").write_text(card.replace("param: distance_m", "param: target"))
    assert_says(refusal(load_scene, folder), "moving_depth.param is 'target' | a parameter that is a number")
    (folder / "scene.yaml").write_text(card.replace("[0.012, 0.047]", "[0.047, 0.012]"))
    assert "the nearest depth, then the farthest" in str(refusal(load_scene, folder))
