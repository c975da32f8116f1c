"""The all-in-focus charge of rendered recordings: their pictures in focus, and two planes in closed form."""

import json
import shutil
from dataclasses import replace

import capture_dataset
import h5py
import numpy as np
import pytest

import saf_gen
from saf_gen.camera import electrons_per_irradiance, parse_sensor
from saf_gen.camera.exposure import irradiance_ratio
from saf_gen.generate.plan import make_plan
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.optics import drive_from_dict
from saf_gen.render.all_in_focus import render_all_in_focus
from saf_gen.stack.all_in_focus import load_all_in_focus
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
from saf_gen.stream.dataset import verify_dataset
from saf_gen.stream.manifest import read_manifest

pytestmark = pytest.mark.slow

NEAR_M, FAR_M, EDGE_M = 0.45, 0.55, 0.004
"""Distances of two glowing planes, the near of which begins beside the axis."""
LIGHT = {"near": 3.0, "far": 8.0}
CARD = """\
id: planes
title: Two glowing planes, for tests
licence: Apache-2.0
source: made here
camera: {origin_m: [0, 0, 0], look_at_m: [0, 0, 1]}
lens: {focal_length_mm: 25, f_number: 1.0, drive: image_distance, focus_range_m: [0.60, 0.42]}
lights:
  near: [near]
  far: [far]
target: [far]
"""
SCENE = f"""
import mitsuba as mi


def build(params):
    t = mi.ScalarTransform4f()
    black = {{"type": "diffuse", "reflectance": {{"type": "rgb", "value": 0.0}}}}

    def glowing(depth, x, value):
        return {{
            "type": "rectangle",
            "to_world": t.translate([x, 0, depth]).rotate([0, 1, 0], 180).scale(0.5),
            "bsdf": black,
            "emitter": {{"type": "area", "radiance": {{"type": "rgb", "value": value}}}},
        }}

    return {{
        "near": glowing({NEAR_M}, {EDGE_M} + 0.5, {LIGHT["near"]}),
        "far": glowing({FAR_M}, 0.0, {LIGHT["far"]}),
    }}
"""
RECIPE = (
    capture_dataset.RECIPE.replace("samples: 16, max_depth: 3, slice_samples: 16, whole_slices: true", "samples: 256, "
                                   "max_depth: 3, slice_samples: 256")
    .replace("frames: 800", "frames: 400")
    .replace("[plane], lights: [constant, lamp_only]", "[plane], lights: [lamp_only]")
    .replace("  test:", "  glow: {scenes: [planes], lights: [constant]}\n  test:")
    + "truth: {sharp: true}\n"
)  # fmt: skip
NOISE = 0.02
"""Relative noise of a picture with this number of samples."""
STILL, MOVING, GLOWING = (
    "test/plane-lamp_only-00.h5",
    "test/plane-dynamic-lamp_only-00.h5",
    "glow/planes-constant-00.h5",
)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sharp")
    with pytest.MonkeyPatch.context() as patch:
        planes = folder / "scenes/planes"
        planes.mkdir(parents=True)
        (planes / "scene.yaml").write_text(CARD)
        (planes / "scene.py").write_text(SCENE)
        shutil.copytree(capture_dataset.SCENES / "plane", folder / "scenes/plane")
        with (folder / "scenes/plane/scene.yaml").open("a") as card:
            card.write(capture_dataset.MOTION)
        patch.setenv("SAF_GEN_SCENES", str(folder / "scenes"))
        (folder / "takes.yaml").write_text(RECIPE)
        outcome = generate(resolve_recipe(folder / "takes.yaml"), folder / "takes", variant=capture_dataset.VARIANT)
        assert outcome.failed == {}
        yield outcome.folder


@pytest.fixture
def copy(dataset, tmp_path):
    shutil.copytree(dataset, tmp_path / "takes")
    return tmp_path / "takes"


@pytest.fixture
def work(dataset):
    return resolve_recipe(dataset.parent / "takes.yaml")


def run(work, folder, **options):
    """Generate once more, without failures, and return the outcome."""
    again = generate(work, folder, variant=capture_dataset.VARIANT, **options)
    assert again.failed == {}
    return again


def source_of(stream, dataset):
    """The charge of the stacks from which a stream was recorded, at the positions that its lens passed."""
    texts, stacks = stream.metadata.provenance, dataset / "stacks"
    specs = tuple(StackSpec.read(stacks, key) for key in texts["stack"].split("\n"))
    starts = tuple(round(spec.time_s * stream.readout_hz) for spec in specs) if len(specs) > 1 else (0,)
    planes = PlaneSource.from_folder(TimeResolvedStack(starts, specs), stacks)
    source = ChargeSource(planes, parse_sensor(texts["sensor"], ""))
    source.scale = json.loads(texts["exposure"])["scale"]
    return source


def recorded(stream, dataset, frame):
    """The charge that the recording collected in a readout, without noise: float32 (H, W)."""
    charge = source_of(stream, dataset).charge_image(frame, float(stream.metadata.lens_position[frame]))
    return np.tensordot(stream.gain[frame], charge, 1)


@pytest.mark.parametrize("name", [STILL, MOVING])
def test_in_focus_it_is_what_the_recording_collects(dataset, name):
    with saf_gen.open_stream(dataset / name) as stream:
        frame = round(stream.truth.frame)
        sharp, focused = stream.sharp(frame), recorded(stream, dataset, frame)
        assert sharp.mean() == pytest.approx(focused.mean(), rel=0.005)
        assert np.sqrt(np.mean((sharp - focused) ** 2)) < 3 * NOISE * focused.mean()
        counts = stream.counts(frame - 50, frame + 50)
        assert np.corrcoef(counts.ravel(), sharp.ravel())[0, 1] > 0.98


def test_of_a_moving_scene_it_has_the_scale_of_the_recording_at_every_slice(dataset):
    """The plane comes nearer and the lens breathes: away from the focus, the mean picture stays that of the readout."""
    with saf_gen.open_stream(dataset / MOVING) as stream:
        slices, lights = stream.truth.sharp.shape[:2]
        assert (slices, lights) == (len(stream.truth.sharp_frame), len(stream.light_names))
        assert slices == 6
        for frame in (20, 200, 380):
            sharp, seen = stream.sharp(frame), recorded(stream, dataset, frame)
            assert sharp.mean() == pytest.approx(seen.mean(), rel=0.01)


def test_two_glowing_planes_have_the_charge_of_their_light_and_an_edge_where_the_lens_draws_it(dataset):
    """The edge of the near plane is sharp although the lens is focused on the far one; the unit is electrons."""
    with saf_gen.open_stream(dataset / GLOWING) as stream:
        sharp, texts, at = stream.truth.sharp[0], stream.metadata.provenance, stream.truth.position
        near_picture = source_of(stream, dataset).charge_image(0, at)[0]
    drive = drive_from_dict(json.loads(texts["lens"])["drive"])
    sensor, scale = parse_sensor(texts["sensor"], ""), json.loads(texts["exposure"])["scale"]
    v = float(drive.image_distance(at))
    assert v == pytest.approx(1 / (1 / 0.025 - 1 / FAR_M), rel=1e-3)
    per_radiance = scale * electrons_per_irradiance(sensor) * irradiance_ratio(
        sharp.shape[1:], np.array([v]), pitch_m=sensor.pitch_m, aperture_radius_m=0.025 / 2
    )[0]  # fmt: skip
    near, far = (sharp[n] / (LIGHT[name] * per_radiance) for n, name in enumerate(("near", "far")))
    assert near + far == pytest.approx(np.ones_like(near), abs=0.01)
    columns = sharp.shape[2] / 2 - v * EDGE_M / NEAR_M / sensor.pitch_m
    assert near.sum(axis=1) == pytest.approx(np.full(len(near), columns), abs=0.1)
    between = (near > 0.02) & (near < 0.98)
    assert between.sum(axis=1).max() <= 2
    recorded_near = near_picture / (LIGHT["near"] * per_radiance)
    assert ((recorded_near > 0.02) & (recorded_near < 0.98)).sum(axis=1).min() >= 4, "the recorded edge is blurred"


def test_the_spikes_are_those_without_it_and_so_is_the_rest(dataset, copy, tmp_path):
    """The same stacks without the key: the recordings differ in nothing but /truth/sharp."""
    path = dataset.parent / "plain.yaml"
    path.write_text(RECIPE.replace("truth: {sharp: true}\n", ""))
    plain = run(resolve_recipe(path), copy)
    assert (plain.rendered, len(plain.recorded)) == ([], 3)
    for name in (STILL, MOVING, GLOWING):
        with saf_gen.open_stream(dataset / name) as sharp, saf_gen.open_stream(copy / name) as without:
            assert np.array_equal(sharp.packed(0, 50), without.packed(0, 50))
            assert without.truth.sharp is None
            sharp.verify()
        with h5py.File(dataset / name) as sharp, h5py.File(copy / name) as without:
            assert set(sharp["truth"]) - set(without["truth"]) == {"sharp", "sharp_frame"}
            assert sharp.attrs["spikes_sha256"] == without.attrs["spikes_sha256"]
            assert set(sharp["provenance"]) - set(without["provenance"]) == {"sharp_stack", "sharp_stack_digest"}


def test_generated_again_it_is_kept_and_made_again_only_if_a_file_is_damaged(work, copy):
    again = run(work, copy)
    assert (again.rendered, again.recorded, len(again.kept)) == ([], [], 3)
    assert make_plan(work, copy).to_render == {}
    data = bytearray((copy / STILL).read_bytes())
    with saf_gen.open_stream(copy / STILL) as stream:
        at = stream.truth.sharp.offset
    data[at] ^= 1
    (copy / STILL).write_bytes(data)
    digests = {entry.id: entry.content_sha256 for entry in read_manifest(copy).sequences}
    repaired = run(work, copy)
    assert (repaired.rendered, repaired.recorded) == ([], ["plane-lamp_only-00"])
    assert {entry.id: entry.content_sha256 for entry in repaired.manifest.sequences} == digests
    assert verify_dataset(copy) == (3, {})


def test_its_stacks_are_deleted_with_the_slices_and_rendered_again_where_they_are_needed(work, copy):
    """What is deleted is not rendered again while the recordings are whole; a damaged one needs its own stack alone."""
    of_point = {spec.key for s in work.sequences for spec in s.sharp_stack.specs}

    def pictures():
        return {path.parent.name for path in (copy / "stacks").glob("*/*.exr")} & of_point

    assert pictures() == of_point
    freed = run(work, copy, keep_slices="none")
    assert freed.freed_bytes > 0
    assert pictures() == set()
    assert make_plan(work, copy, keep_slices="none").to_render == {}
    once_more = run(work, copy, keep_slices="none")
    assert (once_more.rendered, once_more.recorded) == ([], [])
    (copy / GLOWING).write_bytes((copy / GLOWING).read_bytes()[:-1])
    glowing = next(s for s in work.sequences if s.planned.scene == "planes")
    assert set(make_plan(work, copy, keep_slices="none").to_render) == {glowing.sharp_stack}
    repaired = run(work, copy, keep_slices="all")
    assert repaired.recorded == ["planes-constant-00"]
    assert {name.partition(" · ")[0] for name in repaired.rendered} == {"planes, all in focus"}
    assert pictures() == {spec.key for spec in glowing.sharp_stack.specs}


def test_a_recording_whose_stack_went_after_the_plan_waits_for_it(work, copy):
    """The spikes are damaged, which only reading them shows: the plan has nothing to render."""
    run(work, copy, keep_slices="none")
    data = bytearray((copy / GLOWING).read_bytes())
    with h5py.File(copy / GLOWING) as file:
        at = file["spikes"].id.get_chunk_info(0).byte_offset + 40
    data[at] ^= 1
    (copy / GLOWING).write_bytes(data)
    plan = make_plan(work, copy, keep_slices="none")
    assert plan.to_render == {}
    repaired = run(work, copy, keep_slices="none")
    assert repaired.recorded == ["planes-constant-00"]
    assert verify_dataset(copy) == (3, {})


def test_the_picture_that_is_rendered_afterwards_is_not_rendered_where_there_is_one(dataset):
    """It is read from the stream, and no folder of stacks is needed."""
    with saf_gen.open_stream(dataset / STILL) as stream:
        held = stream.truth.sharp[0]
        assert np.array_equal(render_all_in_focus(stream, "nowhere"), held)
        assert np.array_equal(load_all_in_focus(stream, "nowhere"), held)
        stream.truth = replace(stream.truth, sharp=None)
        afterwards = render_all_in_focus(stream, dataset / "stacks", variant=capture_dataset.VARIANT)
    assert afterwards == pytest.approx(held, abs=5 * NOISE * float(held.mean()))
