"""A moving scene, from recipe to streams: members of its family, time slices, and a truth that follows the target."""

import json
import shutil
from dataclasses import replace

import drjit as dr
import numpy as np
import pytest
from capture_dataset import VARIANT
from small_dataset import SCENES

import saf_gen
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.optics import ImageDistanceDrive
from saf_gen.render import estimators, render_missing
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.focal_stack import StackStore
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.recorded_grain import grain_of_stream

pytestmark = pytest.mark.slow
DRIVE = ImageDistanceDrive(0.025, 2.0, (0.60, 0.42))
COMES_NEARER = 2.0  # m/s
CARD = """
params: {contrast: {uniform: [0.4, 0.6]}}
motion:
  plane: {keyframes: [{time_s: 0}, {time_s: 0.02, translate_m: [0.002, 0, -0.04]}]}
slices_per_s: 500
still_s: 0.01
"""
RECIPE = """\
name: moving
seed: 3
camera: {{sensor: {sensor}, frames: 400, exposure: {{mean_rate: 0.2}}}}
focus: {{positions: 9}}
render: {{samples: 16, max_depth: 3, slice_samples: 64}}
lights: {{constant: {{kind: constant}}}}
splits:
  train: {{scenes: [usaf_target], lights: [constant]}}
  test: {{scenes: [plane], lights: [constant], repeats: 2, variants: 2, scene_motion: [static, dynamic]}}
"""


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """The plane of the tests, as a scene family that comes nearer."""
    root = tmp_path_factory.mktemp("scenes")
    shutil.copytree(SCENES / "plane", root / "plane")
    with (root / "plane" / "scene.yaml").open("a") as card:
        card.write(CARD)
    script = root / "plane" / "scene.py"
    script.write_text(script.read_text().replace('"value": 0.7', '"value": params["contrast"]'))
    return root


@pytest.fixture
def recipe(scenes, tmp_path, monkeypatch, small_sensor):
    monkeypatch.setenv("SAF_GEN_SCENES", str(scenes))
    path = tmp_path / "moving.yaml"
    path.write_text(RECIPE.format(sensor=small_sensor))
    return path


@pytest.fixture(scope="module")
def made(scenes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    path = folder / "moving.yaml"
    path.write_text(RECIPE.format(sensor=SCENES.parent / "small_sensor.yaml"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SAF_GEN_SCENES", str(scenes))
        work = resolve_recipe(path)
        # One moving sequence is enough: its slices take most of the time.
        made = [s for s in work.sequences if s.planned.scene == "plane" and s.planned.id != "plane-dynamic-constant-01"]
        work = replace(work, sequences=made)
        outcome = generate(work, folder / "made", variant=VARIANT)
        assert outcome.failed == {}
        yield outcome, work


def test_static_and_dynamic_of_every_member_are_listed(made, recipe):
    outcome, work = made
    planned = {
        "plane-constant-00": (0, "static"),
        "plane-constant-01": (1, "static"),
        "plane-dynamic-constant-00": (0, "dynamic"),
        "plane-dynamic-constant-01": (1, "dynamic"),
    }
    plan = [s.planned for s in resolve_recipe(recipe).all_sequences if s.planned.scene == "plane"]
    assert {s.id: (s.member, s.scene_motion) for s in plan} == planned
    listed = {s.id: (s.variant, s.scene_motion) for s in read_manifest(outcome.folder).sequences}
    assert listed == {s.planned.id: planned[s.planned.id] for s in work.sequences}
    assert len(listed) == 3


def test_members_of_a_family_have_parameters_and_stacks_of_their_own(made):
    outcome, work = made
    contrasts = {s.planned.id: s.planned.params["contrast"] for s in work.sequences}
    assert contrasts["plane-constant-00"] == contrasts["plane-dynamic-constant-00"]
    assert contrasts["plane-constant-00"] != contrasts["plane-constant-01"]
    with saf_gen.open_stream(outcome.folder / "test" / "plane-constant-01.h5") as stream:
        written = json.loads(stream.metadata.provenance["sequence"])
    assert written["params"] == {"contrast": contrasts["plane-constant-01"]}
    assert len({s.time_stack for s in work.sequences}) == 3


def test_the_truth_of_a_target_that_comes_nearer_is_the_closed_form(made):
    """The depth is 0.5 m less 2 m/s, and the lens meets it once; time slices 2 ms apart limit the precision of both."""
    outcome, _ = made
    seconds = (np.arange(400) + 0.5) / 20_000
    best = DRIVE.best_position(0.5 - COMES_NEARER * seconds)
    with saf_gen.open_stream(outcome.folder / "test" / "plane-dynamic-constant-00.h5") as stream:
        truth, focus = stream.truth, stream.focus_position
        assert truth.track == pytest.approx(best, abs=1e-3)
        assert np.interp(truth.frame, np.arange(400), focus - truth.track) == pytest.approx(0, abs=1e-5)
        assert truth.position == pytest.approx(np.interp(truth.frame, np.arange(400), best), abs=1e-3)
    with saf_gen.open_stream(outcome.folder / "test" / "plane-constant-00.h5") as stream:
        assert stream.truth.track is None
        assert stream.truth.position == pytest.approx(DRIVE.best_position(0.48), abs=1e-4)  # at still_s


def test_only_the_positions_that_the_lens_passes_are_rendered(made):
    _, work = made
    dynamic = work.sequences[-1].time_stack
    assert len(dynamic.specs) == 11
    assert max(spec.rendered_count for spec in dynamic.specs) <= 4
    assert dynamic.specs[0].first_index == 0
    assert dynamic.specs[-1].window[1] == 8


def test_a_moving_recording_says_how_much_grain_its_slices_have(made):
    """Of eleven slices one in the middle and the one in focus are rendered twice, with 64 and with 32 samples."""
    outcome, _ = made
    with saf_gen.open_stream(outcome.folder / "test" / "plane-dynamic-constant-00.h5") as stream:
        grain = grain_of_stream(stream.metadata.provenance)
        assert abs(grain.moments[grain.focus].frame - stream.truth.frame) <= 40
    assert grain.samples == (64, 32)
    assert 1 <= len(grain.moments) <= 2
    assert all(0.005 < moment.rms < 0.2 for moment in grain.moments)


def test_between_two_slices_the_picture_is_a_render_of_that_time(made, scenes, monkeypatch, tmp_path):
    """In the middle of an interval it differs by 3 % rms of the mean from a stack rendered there, noise included.

    The picture of either slice alone is a third of a pixel off at the border, and differs twice as much.
    """
    outcome, work = made
    monkeypatch.setenv("SAF_GEN_SCENES", str(scenes))
    sequence = work.sequences[-1]
    time_stack = sequence.time_stack
    plane_source = PlaneSource.from_folder(time_stack, outcome.folder / "stacks")
    j, position = 5, 0.5
    frame = (time_stack.slice_frames[j] + time_stack.slice_frames[j + 1]) / 2 - 0.5
    blended = ChargeSource(plane_source, work.sensor).charge_image(frame, position)
    middle = replace(time_stack.specs[j], time_s=(time_stack.specs[j].time_s + time_stack.specs[j + 1].time_s) / 2)
    render_missing(sequence.scene, [middle], root=tmp_path, backend_name=VARIANT)
    stack = StackStore(tmp_path, middle).load()
    rendered = ChargeSource(PlaneSource.from_stack(stack), work.sensor).charge_image(0, position)
    before = ChargeSource(plane_source, work.sensor).charge_image(time_stack.slice_frames[j] - 0.5, position)

    def off(picture):
        return np.sqrt(np.mean((picture - rendered).sum(axis=0) ** 2)) / rendered.sum(axis=0).mean()

    assert off(blended) < 0.03
    assert off(before) > 2 * off(blended)


def test_a_recipe_may_choose_parameters_by_name(recipe):
    recipe.write_text(recipe.read_text() + "scene_params: {plane: {contrast: 0.5}}\n")
    of_plane = [s.planned for s in resolve_recipe(recipe).sequences if s.planned.scene == "plane"]
    assert {planned.params["contrast"] for planned in of_plane} == {0.5}


@pytest.mark.skipif(VARIANT == "scalar", reason="scalar writes no kernels")
def test_all_moments_are_traced_by_the_same_kernels(recipe, tmp_path, monkeypatch):
    """At each moment the lens passes other positions, and the scene is loaded again for each light."""
    sequence = resolve_recipe(recipe).sequences[-1]
    moments = sequence.time_stack.specs[1::4]
    assert len({moment.window for moment in moments}) == len(moments) == 3
    render, used = estimators.render_groups, []

    def spied(*args, **kwargs):
        dr.kernel_history_clear()
        stacks = render(*args, **kwargs)
        kernels = [kernel for kernel in dr.kernel_history() if kernel["type"] is dr.KernelType.JIT]
        used.append(frozenset(kernel["hash"] for kernel in kernels))
        return stacks

    monkeypatch.setattr(estimators, "render_groups", spied)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        render_missing(sequence.scene, moments, root=tmp_path, backend_name=VARIANT)
    assert len(used) == len(moments)
    assert all(kernels for kernels in used)
    assert len(set(used[1:])) == 1  # the first moment also loads what all moments share
