"""All-in-focus pictures of rendered recordings: those in focus, blur, and two planes in closed form."""

import json
import shutil

import capture_dataset
import numpy as np
import pytest
from scipy.ndimage import map_coordinates, spline_filter

import saf_gen
from saf_gen.camera import electrons_per_irradiance, parse_sensor
from saf_gen.camera.exposure import irradiance_ratio
from saf_gen.generate.plan import make_plan
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.optics import drive_from_dict
from saf_gen.stack.all_in_focus import open_all_in_focus
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.focal_stack import StackSpec
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
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
    .replace("mean_rate: 0.2", "mean_rate: 0.2, f_number: 1.0")
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


def at_frame(source, stream, frame):
    """The charge of each light in a readout, at the position of its lens, without noise."""
    return source.charge_image(frame, float(stream.metadata.lens_position[frame]))


@pytest.mark.daily(1)
@pytest.mark.parametrize("name", [pytest.param(STILL, id="still"), pytest.param(MOVING, id="moving")])
def test_in_focus_it_is_the_recorded_picture_of_each_light(dataset, name):
    with saf_gen.open_stream(dataset / name) as stream:
        frame = round(stream.truth.frame)
        sources = open_all_in_focus(stream, dataset / "stacks"), source_of(stream, dataset)
        sharp, focused = (at_frame(source, stream, frame) for source in sources)
        assert (sharp.shape, sharp.dtype) == (focused.shape, np.float32)
        for charge, seen in zip(sharp, focused, strict=True):
            assert charge.mean() == pytest.approx(seen.mean(), rel=0.005)
            assert np.sqrt(np.mean((charge - seen) ** 2)) < 3 * NOISE * seen.mean()
        counts = stream.counts(frame - 50, frame + 50)
        assert np.corrcoef(counts.ravel(), np.tensordot(stream.gain[frame], sharp, 1).ravel())[0, 1] > 0.98


@pytest.mark.parametrize("name", [pytest.param(STILL, id="still"), pytest.param(MOVING, id="moving")])
def test_it_has_the_scale_of_the_recording_in_every_frame(dataset, name):
    """The lens breathes, and the plane comes nearer: out of focus, too, the mean picture is that of the readout."""
    with saf_gen.open_stream(dataset / name) as stream:
        sharp, recorded = open_all_in_focus(stream, dataset / "stacks"), source_of(stream, dataset)
        for frame in (20, 200, 380):
            charge, seen = (at_frame(source, stream, frame) for source in (sharp, recorded))
            assert charge.mean() == pytest.approx(seen.mean(), rel=0.01)


def disc(points=300):
    """Points spread evenly over a disc of diameter 1, on a sunflower's spiral: (2, points)."""
    n = np.arange(points) + 0.5
    angle = np.pi * (1 + np.sqrt(5)) * n
    return np.sqrt(n / points) / 2 * np.stack([np.cos(angle), np.sin(angle)])


def test_blurred_by_the_closed_form_it_is_the_picture_out_of_focus(dataset):
    """The blur of the renderer is that of stream.blur, at both ends of the travel, within the steps of the search."""
    inner, trials = (slice(8, -8), slice(8, -8)), np.linspace(0.7, 1.3, 13)
    with saf_gen.open_stream(dataset / STILL) as stream:
        sharp, recorded = open_all_in_focus(stream, dataset / "stacks"), source_of(stream, dataset)
        for frame in (0, stream.shape[0] - 1):
            picture = spline_filter(at_frame(sharp, stream, frame).sum(axis=0))
            seen = at_frame(recorded, stream, frame).sum(axis=0)
            width, errors = float(np.abs(np.median(stream.blur(frame)))), []
            assert width > 3
            for trial in trials:
                at = [np.indices(picture.shape) + trial * width * point[:, None, None] for point in disc().T]
                found = np.mean([map_coordinates(picture, one, prefilter=False)[inner] for one in at], axis=0)
                errors.append(np.mean((found / found.mean() - seen[inner] / seen[inner].mean()) ** 2))
            assert trials[int(np.argmin(errors))] == pytest.approx(1, abs=0.051)


def test_two_glowing_planes_have_the_charge_of_their_light_and_an_edge_where_the_lens_draws_it(dataset):
    """The edge of the near plane is sharp although the lens is focused on the far one; the unit is electrons."""
    with saf_gen.open_stream(dataset / GLOWING) as stream:
        texts, at = stream.metadata.provenance, stream.truth.position
        sharp = open_all_in_focus(stream, dataset / "stacks").charge_image(0, at)
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


def test_the_key_adds_pictures_to_a_dataset_and_changes_nothing_else(dataset, copy, work):
    """Without the key, nothing is recorded again; with it once more, the pictures alone are rendered, to the same."""
    of_point = {spec.key for s in work.sequences for spec in s.sharp_stack.specs}
    path = dataset.parent / "plain.yaml"
    path.write_text(RECIPE.replace("truth: {sharp: true}\n", ""))
    plain = run(resolve_recipe(path), copy)
    assert (plain.rendered, plain.recorded, len(plain.kept)) == ([], [], 3)
    assert [entry.content_sha256 for entry in plain.manifest.sequences] == [
        entry.content_sha256 for entry in read_manifest(dataset).sequences
    ]
    for key in of_point:
        shutil.rmtree(copy / "stacks" / key)
    again = run(work, copy)
    assert {name.partition(" · ")[0].rpartition(", ")[2] for name in again.rendered} == {"all in focus"}
    assert (again.recorded, len(again.kept)) == ([], 3)
    for name in (STILL, MOVING, GLOWING):
        with saf_gen.open_stream(dataset / name) as stream:
            first, second = (open_all_in_focus(stream, folder / "stacks") for folder in (dataset, copy))
            assert np.array_equal(first.charge_image(200, 0.5), second.charge_image(200, 0.5)), name


def test_it_is_kept_when_slices_are_deleted(work, copy):
    of_point = {spec.key for s in work.sequences for spec in s.sharp_stack.specs}
    freed = run(work, copy, keep_slices="none")
    assert freed.freed_bytes > 0
    assert {path.parent.name for path in (copy / "stacks").glob("*/*.exr")} >= of_point
    assert make_plan(work, copy, keep_slices="none").to_render == {}
    with saf_gen.open_stream(copy / MOVING) as stream:
        assert open_all_in_focus(stream, copy / "stacks").charge_image(0, 0.0).min() > 0
