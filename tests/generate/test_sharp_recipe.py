"""Recipes that ask for all-in-focus pictures: what they add, what stays as it was, how they are read, and refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from refusals import assert_says, refusal
from small_dataset import SPEC, make_sequence
from thin_sections import BUILD, CARD

import saf_gen
from saf_gen.camera import get_sensor
from saf_gen.generate.plan import make_plan, stacks_of
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.record import Recorder
from saf_gen.generate.resolve import recipe_digest, recipe_fingerprint, resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.generate.shards import partition
from saf_gen.stack.all_in_focus import F_NUMBER, open_all_in_focus, sharp_stack
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.focal_stack import StackStore
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
from saf_gen.stream.dataset import verify_dataset
from saf_gen.stream.stream_writer import write_stream

RECIPE = """\
name: many
seed: 7
camera: {sensor: vidar_400x250, frames: 400, exposure: {mean_rate: 0.2}}
focus: {positions: 9}
render: {samples: 16, whole_slices: 0.01}
lights: {constant: {kind: constant}, ramp: {kind: ramp, from: 0.5, to: 2.0}}
splits:
  train: {scenes: [fan, bottle], lights: [constant, ramp], scene_motion: [static, dynamic]}
  test: {scenes: [usaf_target], lights: [constant]}
"""
ASKED = "truth: {sharp: true}\n"


@pytest.fixture
def write(tmp_path):
    def written(text, name="r.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return written


@pytest.fixture
def plain(write):
    return resolve_recipe(write(RECIPE, "plain.yaml"))


@pytest.fixture
def asked(write):
    return resolve_recipe(write(RECIPE + ASKED, "asked.yaml"))


@pytest.mark.parametrize("more", ["truth: {}\n", "truth: {sharp: false}\n"])
def test_a_recipe_that_does_not_ask_is_as_it_was_before_the_key(write, plain, more):
    stated = resolve_recipe(write(RECIPE + more))
    assert recipe_fingerprint(stated.recipe) == recipe_fingerprint(plain.recipe)
    assert recipe_digest(stated) == recipe_digest(plain)
    assert "truth" not in yaml.safe_dump(stated.recipe.model_dump(mode="json"))
    assert [s.sharp_stack for s in plain.all_sequences] == [None] * len(plain.all_sequences)


def test_a_recipe_that_asks_is_another_but_its_recordings_are_the_same(plain, asked):
    assert recipe_fingerprint(asked.recipe) != recipe_fingerprint(plain.recipe)
    assert yaml.safe_load(yaml.safe_dump(asked.recipe.model_dump(mode="json")))["truth"] == {"sharp": True}
    assert recipe_digest(asked) == recipe_digest(plain)
    for with_it, without in zip(asked.all_sequences, plain.all_sequences, strict=True):
        assert replace(with_it, sharp_stack=None) == without
        assert with_it.fingerprint("x") == without.fingerprint("x")


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("truth: {sharpe: true}\n", "sharpe | did you mean 'sharp'?"),
        ("truths: {sharp: true}\n", "truths | did you mean 'truth'?"),
        ("truth: {sharp: true, depth: true}\n", "depth | allowed: sharp"),
        ("truth: {sharp: 1}\n", "sharp"),
        ("truth: {sharp: yes please}\n", "sharp"),
        ("truth: {sharp: [true]}\n", "sharp"),
        ("truth: {sharp: }\n", "sharp"),
        ("truth: {sharp: {uniform: [0, 1]}}\n", "sharp"),
        ("truth: sharp\n", "truth"),
        ("truth: true\n", "truth"),
        ("truth: [sharp]\n", "truth"),
        ("truth:\n", "truth"),
    ],
)
def test_what_is_no_flag_is_refused_with_its_line(write, more, says):
    assert_says(refusal(read_recipe, write(RECIPE + more)), f"r.yaml:10 | {says}")


WITH_SECTION = RECIPE.replace("[fan, bottle]", "[slide]").replace(", scene_motion: [static, dynamic]", "")
REFUSED = {
    "typical aberrations": (RECIPE.replace("positions: 9", "positions: 9, aberrations: mild"), "has aberrations"),
    "a spectrum": (RECIPE.replace("ramp, from", "ramp, spectrum: led, from"), "-ramp-00 | its lamps have spectra"),
    "lamps in a group": (
        RECIPE.replace("{kind: constant}", "[{kind: constant}, {kind: constant}]"),
        "several lamps share a light group | one lamp for each",
    ),
    "a thin section": (WITH_SECTION, "slide-constant-00 | its scene is a thin section, drawn by waves"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_where_a_point_draws_no_such_picture_the_recipe_is_refused_in_one_line(write, tmp_path, monkeypatch, case):
    text, says = REFUSED[case]
    slide = tmp_path / "scenes/slide"
    slide.mkdir(parents=True)
    (slide / "scene.yaml").write_text(CARD)
    (slide / "scene.py").write_text(BUILD)
    monkeypatch.setenv("SAF_GEN_SCENES", str(tmp_path / "scenes"))
    resolve_recipe(write(text))
    assert_says(refusal(resolve_recipe, write(text + ASKED)), f"r.yaml: truth.sharp: | {says}")


def test_the_lens_is_the_same_with_the_aperture_of_a_point(asked):
    """At rest at all positions, moving at those that the lens passes; without what only the closed loop needs."""
    for s in asked.all_sequences:
        assert s.sharp_stack.slice_frames == s.time_stack.slice_frames
        position, _ = s.planned.lens_course(s.frames, readout_hz=s.sensor.readout_hz)
        for spec, point in zip(s.time_stack.specs, s.sharp_stack.specs, strict=True):
            assert point.drive == replace(spec.drive, f_number=F_NUMBER)
            assert point == replace(spec, drive=point.drive, wavelength_m=0.0)
        assert sharp_stack(s.time_stack.with_full_travel(), position) == s.sharp_stack or not s.time_stack.is_moving


def test_of_several_lights_and_repeats_all_have_one_stack(asked, plain):
    stacks = {s.sharp_stack for s in asked.all_sequences}
    assert len(stacks) == len({s.time_stack for s in asked.all_sequences}) == 5
    assert not {spec for stack in stacks for spec in stack.specs} & set(stacks_of(plain.all_sequences))


def test_the_plan_renders_counts_and_names_it(asked, plain, tmp_path):
    """A second rendering of all that is recorded, and bytes on the disk, which stay whatever slices are deleted."""
    with_it, without = make_plan(asked, tmp_path / "a"), make_plan(plain, tmp_path / "b")
    of_point = {s.sharp_stack for s in asked.all_sequences}
    assert set(with_it.to_render) - set(without.to_render) == of_point
    assert sum(label.endswith(", all in focus") for label in with_it.labels) == len(of_point)
    more, less = with_it.estimate(), without.estimate()
    assert 1.3 * less.render_s < more.render_s < 2.2 * less.render_s
    assert more.record_s == less.record_s
    assert with_it.disk_bytes > 1.5 * without.disk_bytes
    for keep in ("all", "closed-loop", "none"):
        assert with_it.kept_bytes(keep) > without.kept_bytes(keep)
    deletable = {
        spec for specs in make_plan(asked, tmp_path / "a", keep_slices="none").deletable.values() for spec in specs
    }
    assert not deletable & {spec for stack in of_point for spec in stack.specs}


@pytest.mark.parametrize("count", [1, 2, 3, 7, 40, 1000])
def test_shards_render_each_of_its_pieces_once(asked, count):
    shares = partition(asked, count)
    everything = stacks_of(asked.sequences)
    assert sorted(spec.key for share in shares for spec in share.specs) == sorted(spec.key for spec in everything)
    if count < 8:
        assert max(share.seconds for share in shares) < 1.4 * sum(share.seconds for share in shares) / count


def test_a_shard_plans_what_is_its_own(write, tmp_path):
    path, planned = write(RECIPE + ASKED), []
    for index in (1, 2, 3):
        plan = make_plan(resolve_recipe(path, part=(index, 3)), tmp_path / "ds")
        planned += {spec.key for specs in plan.to_render.values() for spec in specs}
    assert sorted(planned) == sorted(spec.key for spec in stacks_of(resolve_recipe(path).sequences))


SENSOR = replace(get_sensor("ideal"), rows=16, columns=24)
POINT, MOMENTS = SPEC.drive, (0, 40, 80, 120, 160)
STACKS = {
    "at rest": TimeResolvedStack((0,), (SPEC,)),
    "moving": TimeResolvedStack(
        MOMENTS, tuple(replace(SPEC, time_s=frame / SENSOR.readout_hz, window=(0, 8)) for frame in MOMENTS)
    ),
}


def store(time_stack, root, *, dim):
    """Store pictures that are brighter from position to position and slice to slice, of a target in focus at 0.31."""
    depth = np.full((SPEC.rows, SPEC.columns), POINT.focus_depth(0.31), np.float32)
    for j, spec in enumerate(time_stack.specs):
        at = np.arange(spec.first_index, spec.first_index + spec.rendered_count)[:, None, None]
        for group, light in zip(spec.groups, (1, 3), strict=True):
            picture = np.broadcast_to(dim * light * (1 + 0.125 * at + j), (len(at), *depth.shape))
            StackStore(root, spec).write_group(group, picture.astype(np.float32), backend="llvm")
        StackStore(root, spec).write_geometry(depth, np.ones(depth.shape, bool), backend="llvm")


@pytest.fixture(params=STACKS)
def recording(request, tmp_path):
    """Record from pictures, and store those of a point, which are twice as bright."""
    time_stack, root = STACKS[request.param], tmp_path / "stacks"
    sequence = make_sequence(scene_motion="dynamic" if time_stack.is_moving else "static")
    position, _ = sequence.lens_course(160, readout_hz=SENSOR.readout_hz)
    store(time_stack, root, dim=1.0)
    sensor = yaml.safe_dump(SENSOR.as_dict())
    source = PlaneSource.from_folder(time_stack, root)
    Recorder(SENSOR, 160, device_seed=1, provenance={"sensor": sensor}).record(
        sequence, source, path=tmp_path / "a.h5", fingerprint="f"
    )
    store(sharp_stack(time_stack, position), root, dim=2.0)
    charge = ChargeSource(source, SENSOR)
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        charge.scale = json.loads(stream.metadata.provenance["exposure"])["scale"]
        yield stream, root, charge


def test_the_charge_is_that_of_the_aperture_of_the_recording(recording):
    """Twice that of the recording, at every frame: between its slices, and at the position of its lens."""
    stream, root, recorded = recording
    source, lens = open_all_in_focus(stream, root), stream.metadata.lens_position
    for frame in (0, 39, 59, 80, 131, 159):
        charge, seen = (one.charge_image(frame, float(lens[frame])) for one in (source, recorded))
        assert (charge.shape, charge.dtype) == ((2, SPEC.rows, SPEC.columns), np.float32)
        assert charge == pytest.approx(2 * seen, rel=2e-3)


@pytest.mark.slow
def test_what_was_not_rendered_or_is_no_recording_of_stacks_is_refused_in_one_line(recording, tmp_path):
    stream, root, _ = recording
    keys = stream.metadata.provenance["stack"].split("\n")
    for path in root.glob("*/lamp.exr"):
        if path.parent.name not in keys:
            path.unlink()
    says = f"{len(keys)} of its {len(keys)} all-in-focus stacks are not under | truth: {{sharp: true}} in its recipe"
    assert_says(refusal(open_all_in_focus, stream, root), says)
    assert_says(refusal(open_all_in_focus, stream, tmp_path / "nowhere"), "there is no focal stack")
    write_stream(tmp_path / "b.h5", np.zeros((16, 8, 8), np.uint8))
    with saf_gen.open_stream(tmp_path / "b.h5") as elsewhere:
        assert_says(refusal(open_all_in_focus, elsewhere, root), "was not recorded from focal stacks")


@pytest.mark.slow
def test_shards_that_share_out_a_scene_at_rest_and_its_picture_make_one_dataset(small_recipe, test_scenes, tmp_path):
    """One renders the stack and records it, the other that of the point, without waves."""
    path, folder = tmp_path / "asked.yaml", tmp_path / "ds"
    path.write_text(small_recipe.read_text() + ASKED)
    rendered, recorded = [], []
    for index in (1, 2):
        outcome = generate(resolve_recipe(path, part=(index, 2)), folder, variant="scalar")
        assert outcome.failed == {}
        rendered.append({name.partition(" · ")[0] for name in outcome.rendered})
        recorded.append(len(outcome.recorded))
    assert rendered == [{"plane"}, {"plane, all in focus"}]
    assert recorded == [3, 0]
    closing = generate(resolve_recipe(path), folder, variant="scalar")
    assert (closing.failed, closing.rendered, closing.recorded, len(closing.kept)) == ({}, [], [], 3)
    assert verify_dataset(folder) == (3, {})
