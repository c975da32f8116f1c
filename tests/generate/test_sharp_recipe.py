"""Recipes that ask for the all-in-focus charge: what they add, what stays as it was, and where it cannot be."""

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
from saf_gen.generate.jobs import JobOrder, MeasureGrainJob, RecordJob, RecordResult, RenderJob
from saf_gen.generate.plan import make_plan, stacks_of
from saf_gen.generate.recipe import read_recipe
from saf_gen.generate.record import Recorder
from saf_gen.generate.resolve import recipe_digest, recipe_fingerprint, resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.generate.shards import share_out
from saf_gen.stack.all_in_focus import F_NUMBER, sharp_stack
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack
from saf_gen.stream.dataset import verify_dataset

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


def test_a_recipe_that_asks_is_another_and_so_are_its_recordings_but_not_their_draws(plain, asked):
    assert recipe_fingerprint(asked.recipe) != recipe_fingerprint(plain.recipe)
    assert yaml.safe_load(yaml.safe_dump(asked.recipe.model_dump(mode="json")))["truth"] == {"sharp": True}
    for with_it, without in zip(asked.all_sequences, plain.all_sequences, strict=True):
        assert with_it.planned == without.planned
        assert (with_it.time_stack, with_it.closed_loop_stack) == (without.time_stack, without.closed_loop_stack)
        assert with_it.fingerprint("x") != without.fingerprint("x")
        assert without.fingerprint("x") == replace(with_it, sharp_stack=None).fingerprint("x")


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


def test_pictures_of_other_cameras_have_none(write):
    text = """\
name: real
seed: 3
camera: {sensor: vidar_400x250, frames: 320, exposure: {mean_rate: 0.2}}
stacks: {dots: {folder: pictures, values: linear, licence: CC0-1.0}}
lights: {constant: {kind: constant}}
splits: {test: {scenes: [dots], lights: [constant]}}
"""
    read_recipe(write(text))
    assert_says(refusal(read_recipe, write(text + ASKED)), "no truth in a recipe of stacks")
    assert "truth" not in read_recipe(write(text)).model_dump(mode="json")


def test_the_lens_is_the_same_with_the_aperture_of_a_point(asked):
    """At rest at all positions, moving at the two around that of the lens at each slice."""
    for s in asked.all_sequences:
        assert s.sharp_stack.slice_frames == s.time_stack.slice_frames
        position, _ = s.planned.lens_course(s.frames, readout_hz=s.sensor.readout_hz)
        for frame, spec, point in zip(s.time_stack.slice_frames, s.time_stack.specs, s.sharp_stack.specs, strict=True):
            assert point.drive == replace(spec.drive, f_number=F_NUMBER)
            assert point == replace(spec, drive=point.drive, window=point.window, wavelength_m=0.0)
            if s.time_stack.is_moving:
                at = position[min(frame, s.frames - 1)] * (spec.positions - 1)
                assert point.window[1] == point.window[0] + 1
                assert point.window[0] <= at <= point.window[1]
            else:
                assert point.window is None


def test_of_several_lights_and_repeats_all_have_one_stack(asked, plain):
    stacks = {s.sharp_stack for s in asked.all_sequences}
    assert len(stacks) == len({s.time_stack for s in asked.all_sequences}) == 5
    assert not {spec for stack in stacks for spec in stack.specs} & set(stacks_of(plain.all_sequences))


def test_the_plan_renders_counts_and_names_it(asked, plain, tmp_path):
    """A second rendering of the scenes at rest, one more picture of each slice, and bytes on the disk."""
    with_it, without = make_plan(asked, tmp_path / "a"), make_plan(plain, tmp_path / "b")
    of_point = {s.sharp_stack for s in asked.all_sequences}
    assert set(with_it.to_render) - set(without.to_render) == of_point
    assert sum(label.endswith(", all in focus") for label in with_it.labels) == len(of_point)
    more, less = with_it.estimate(), without.estimate()
    assert 1.3 * less.render_s < more.render_s < 2.2 * less.render_s
    assert more.record_s == less.record_s
    pixels = 400 * 250
    in_streams = sum(4 * pixels * len(s.sharp_stack.specs) * len(s.time_stack.specs[0].groups) for s in asked.sequences)
    assert with_it.disk_bytes - without.disk_bytes > in_streams
    assert with_it.kept_bytes("all") > without.kept_bytes("all")
    assert with_it.kept_bytes("closed-loop") == without.kept_bytes("closed-loop")
    assert with_it.kept_bytes("none") == 0


@pytest.mark.parametrize("count", [1, 2, 3, 7, 40, 1000])
def test_shards_render_each_of_its_pieces_once(asked, count):
    shares = share_out(asked, count)
    everything = stacks_of(asked.sequences)
    assert sorted(spec.key for share in shares for spec in share.specs) == sorted(spec.key for spec in everything)
    whole = {stack for share in shares for stack in share.whole}
    for s in asked.sequences:
        assert (s.time_stack in whole) == (s.sharp_stack in whole), "who records it has both"
    if count < 8:
        assert max(share.seconds for share in shares) < 1.4 * sum(share.seconds for share in shares) / count


def test_a_shard_plans_what_is_its_own(write, tmp_path):
    path, planned = write(RECIPE + ASKED), []
    for index in (1, 2, 3):
        plan = make_plan(resolve_recipe(path, part=(index, 3)), tmp_path / "ds")
        planned += {spec.key for specs in plan.to_render.values() for spec in specs}
        assert all(s.sharp_stack in plan.to_render for s in plan.sequences)
    assert sorted(planned) == sorted(spec.key for spec in stacks_of(resolve_recipe(path).sequences))


def test_recordings_wait_for_both_their_stacks(asked, tmp_path):
    """In whatever order the two are rendered, the last of them starts the recordings, once."""
    plan = make_plan(asked, tmp_path / "ds")
    recorder = Recorder(asked.sensor, 400, device_seed=1, provenance={})
    order = JobOrder(plan, recorder, workers=1, choose_backend=lambda: "llvm")
    jobs = order.first_jobs()
    assert {type(job) for job in jobs} == {RenderJob}
    of_point = {s.sharp_stack for s in asked.sequences}
    assert all(job.measure_grain != (job.time_stack in of_point) for job in jobs if job.time_stack in plan.by_stack)
    started = []
    for job in reversed(jobs):  # the all-in-focus stacks come first here
        after = order.jobs_after(job, [])
        assert not after or job.time_stack not in of_point
        started += after
    assert {type(job) for job in started} == {RecordJob}
    assert sorted(job.sequence.id for job in started) == sorted(s.planned.id for s in asked.sequences)
    assert all(job.sharp_stack is not None for job in started)
    lacking = order.jobs_after(started[0], RecordResult("", kept=False, lacks_slices=True))
    assert [job.time_stack for job in lacking] == [started[0].time_stack, started[0].sharp_stack]
    assert order.jobs_after(lacking[1], []) == []
    assert {job.sequence.id for job in order.jobs_after(lacking[0], [])} >= {started[0].sequence.id}
    assert not any(isinstance(job, MeasureGrainJob) for job in started)


SENSOR = replace(get_sensor("ideal"), rows=16, columns=24)
POINT, MOMENTS = SPEC.drive, (0, 40, 80, 120, 160)


def source(time_stack, radiance):
    """Stacks whose planes are ``radiance(j, k)`` (light, row, col), with a flat target in focus at 0.31."""
    depth = np.full((SPEC.rows, SPEC.columns), POINT.focus_depth(0.31), np.float32)
    return PlaneSource(
        time_stack,
        lambda j, first, stop: np.stack(
            [radiance(j, time_stack.specs[j].first_index + k) for k in range(first, stop)], axis=1
        ),
        lambda j: (depth, np.ones(depth.shape, bool)),
        "digest",
        "llvm",
    )


def record(path, time_stack, sequence, *, dim=1.0):
    """Record from planes that are brighter from position to position, and twice as bright through a point."""
    position, _ = sequence.lens_course(160, readout_hz=SENSOR.readout_hz)

    def radiance(j, k):
        return np.stack([np.full((SPEC.rows, SPEC.columns), dim * (1 + 0.1 * k + j) * g, np.float32) for g in (1, 3)])

    of_point = sharp_stack(time_stack, position)
    Recorder(SENSOR, 160, device_seed=1, provenance={}).record(
        sequence, source(time_stack, radiance), path=path, fingerprint="f",
        sharp_source=source(of_point, lambda j, k: 2 * radiance(j, k)),
    )  # fmt: skip
    return position


def test_at_rest_the_charge_is_that_of_the_true_focus_through_the_aperture_of_the_recording(tmp_path):
    """Between two rendered positions it is between their pictures; its aperture is the recorded one, not a point."""
    record(tmp_path / "a.h5", TimeResolvedStack((0,), (SPEC,)), make_sequence())
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        charge, truth, texts = stream.truth.sharp[0], stream.truth, stream.metadata.provenance
        lens_charge = stream.sharp(0)
    assert truth.position == pytest.approx(0.31, abs=1e-4)
    k = truth.position * 8
    scale = json.loads(texts["exposure"])["scale"]
    v = float(POINT.image_distance(truth.position))
    per_radiance = np.pi * POINT.aperture_radius_m**2 / v**2 * _electrons() * scale
    middle = charge[:, 7:9, 11:13].mean(axis=(1, 2))
    assert middle == pytest.approx(2 * (1 + 0.1 * k) * np.array([1, 3]) * per_radiance, rel=2e-3)
    assert lens_charge == pytest.approx(charge.sum(axis=0), rel=1e-6)
    assert texts["sharp_stack_digest"] == "digest"


def _electrons():
    """Electrons per readout of a pixel for an irradiance of 1 W/m²."""
    area = SENSOR.pitch_m**2 * SENSOR.fill_factor
    photon = 6.62607015e-34 * 299792458 / SENSOR.wavelength_m
    return area * SENSOR.quantum_efficiency / photon / SENSOR.readout_hz


def test_in_a_moving_scene_each_slice_has_the_charge_of_its_moment_and_of_where_the_lens_is(tmp_path):
    specs = tuple(replace(SPEC, time_s=frame / SENSOR.readout_hz, window=(0, 8)) for frame in MOMENTS)
    position = record(tmp_path / "a.h5", TimeResolvedStack(MOMENTS, specs), make_sequence(scene_motion="dynamic"))
    with saf_gen.open_stream(tmp_path / "a.h5") as stream:
        truth, texts = stream.truth, stream.metadata.provenance
        middle = np.asarray(truth.sharp)[:, :, 7:9, 11:13].mean(axis=(2, 3))
        between = stream.sharp(59)[7:9, 11:13].mean()
    assert truth.sharp_frame.tolist() == list(MOMENTS)
    scale = json.loads(texts["exposure"])["scale"]
    for j, frame in enumerate(MOMENTS):
        at = float(position[min(frame, 159)])
        v = float(POINT.image_distance(at))
        radiance = 2 * (1 + 0.1 * at * 8 + j) * np.array([1, 3])
        expected = radiance * np.pi * POINT.aperture_radius_m**2 / v**2 * _electrons() * scale
        assert middle[j] == pytest.approx(expected, rel=2e-3)
    assert between == pytest.approx(0.5125 * middle[1].sum() + 0.4875 * middle[2].sum(), rel=1e-4)


@pytest.mark.slow
def test_shards_that_share_out_a_scene_at_rest_and_its_picture_make_one_dataset(small_recipe, test_scenes, tmp_path):
    """One renders the stack, another that of the point, without waves; who sees both records, and nobody fails."""
    path, folder = tmp_path / "asked.yaml", tmp_path / "ds"
    path.write_text(small_recipe.read_text() + ASKED)
    rendered, recorded = [], []
    for index in (1, 2):
        outcome = generate(resolve_recipe(path, part=(index, 2)), folder, variant="scalar")
        assert outcome.failed == {}
        rendered.append({name.partition(" · ")[0] for name in outcome.rendered})
        recorded.append(len(outcome.recorded))
    assert sorted(map(sorted, rendered)) == [["plane"], ["plane, all in focus"]]
    assert recorded == [0, 3]
    closing = generate(resolve_recipe(path), folder, variant="scalar")
    assert (closing.failed, closing.rendered, closing.recorded, len(closing.kept)) == ({}, [], [], 3)
    assert verify_dataset(folder) == (3, {})
