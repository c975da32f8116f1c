"""Time-resolved stacks of moving scenes: their moments, their positions, and interpolation between them."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal
from small_dataset import make_sequence

import saf_gen
from saf_gen.camera import Encoder, get_sensor
from saf_gen.camera.photons import SpadCamera
from saf_gen.core.region import bounding_box
from saf_gen.generate.record import Recorder
from saf_gen.optics import ImageDistanceDrive
from saf_gen.stack.charge_source import ChargeSource
from saf_gen.stack.focal_stack import FocalStack, StackSpec, StackStore
from saf_gen.stack.noise_free import noise_free_sharpness
from saf_gen.stack.time_resolved import PlaneSource, TimeResolvedStack, slice_starts, slice_windows
from saf_gen.stack.true_focus import find_true_focus

DRIVE = ImageDistanceDrive(0.025, 2.0, (0.6, 0.42))
SPEC = StackSpec("plane", "0" * 64, ("lamp", "room"), DRIVE, 6, 8, 60e-6, 9, 16, 4)
SENSOR = get_sensor("ideal", rows=6, columns=8, pitch_m=60e-6)
FRAMES = 400
AT = (0, 160, 320, 480)
SWEEP = (np.arange(FRAMES) + 0.5) / FRAMES


def stacks(position=SWEEP, at=AT, depths=(0.5, 0.5, 0.5, 0.5)):
    """A stack of random light per moment; the target is visible if its depth is not None."""
    random = np.random.default_rng(4)
    made = []
    for frame, window, depth in zip(at, slice_windows(position, at, positions=SPEC.positions), depths, strict=True):
        spec = replace(SPEC, time_s=frame / 20_000, window=window)
        light = random.uniform(0.1, 1, (2, spec.rendered_count, 6, 8)).astype(np.float32)
        target = np.full((6, 8), depth is not None)
        far = np.full((6, 8), 0.5 if depth is None else depth, np.float32)
        made.append(FocalStack(spec, light, far, target, "llvm"))
    return made


def plane_source(made, at=AT):
    time_stack = TimeResolvedStack(at, tuple(stack.spec for stack in made))
    light = lambda j, first, stop: made[j].radiance[:, first:stop]  # noqa: E731
    return PlaneSource(time_stack, light, lambda j: (made[j].depth, made[j].target), "d", "llvm")


def seen(made, frame, position):
    """The radiance at a moment and a position, interpolated step by step."""
    j = max(n for n in range(len(made) - 1) if AT[n] <= frame + 0.5)
    w = (frame + 0.5 - AT[j]) / (AT[j + 1] - AT[j])
    pictures = []
    for stack in made[j : j + 2]:
        focus = stack.spec.focus
        k = min(int(np.searchsorted(focus, position, side="right")) - 1, len(focus) - 2)
        fraction = (position - focus[k]) / (focus[k + 1] - focus[k])
        pictures.append((1 - fraction) * stack.radiance[:, k] + fraction * stack.radiance[:, k + 1])
    return (1 - w) * pictures[0] + w * pictures[1]


@pytest.mark.parametrize(
    ("frames", "hz", "slices_per_s", "step"),
    [(20_000, 20_000, 100, 200), (20_000, 20_000, 64, 312), (400, 20_000, 1, 20_000), (100, 20_000, 1e4, 8)],
)
def test_moments_are_whole_bytes_apart_and_reach_the_end(frames, hz, slices_per_s, step):
    at = slice_starts(frames, readout_hz=hz, slices_per_s=slices_per_s)
    assert set(np.diff(at)) == {step}
    assert at[0] == 0
    assert at[-2] < frames <= at[-1]
    assert step % 8 == 0


def test_windows_hold_every_position_that_the_lens_passes_between_neighbouring_moments():
    for position in (SWEEP, SWEEP[::-1], np.abs(1 - 2 * SWEEP), np.full(FRAMES, 0.25)):
        found = slice_windows(position, AT, positions=9)
        for j, (first, last) in enumerate(found):
            around = position[AT[max(j - 1, 0)] : AT[min(j + 1, 3)]] * 8
            assert 0 <= first < last <= 8
            assert first <= around.min()
            assert around.max() <= last
    assert slice_windows(SWEEP, AT, positions=9)[0][1] < 8  # not the full travel
    assert set(slice_windows(np.full(FRAMES, 0.25), AT, positions=9)) == {(2, 3)}


@pytest.mark.parametrize("cut", [400, 96])
def test_runs_cover_every_frame_once_and_never_cross_a_moment(cut):
    time_stack = plane_source(stacks()).time_stack
    frames = []
    for begin in range(0, FRAMES, cut):
        for first, end, j, _ in time_stack.split_at_slices(begin, min(begin + cut, FRAMES)):
            assert AT[j] <= first < end <= AT[j + 1]
            assert first % 8 == 0
            frames += range(first, end)
    assert frames == list(range(FRAMES))


@pytest.mark.parametrize("frame", [0, 79.5, 160, 399])
def test_a_picture_is_the_straight_line_in_time_and_in_focus(frame):
    made = stacks()
    charge_source = ChargeSource(plane_source(made), SENSOR)
    even = [replace_light(stack, 1.0) for stack in made]
    position = float(np.interp(frame, np.arange(FRAMES), SWEEP))
    flat = ChargeSource(plane_source(even), SENSOR).charge_image(frame, position)  # only lens and sensor
    found = charge_source.charge_image(frame, position) / flat
    # The bellows factor is interpolated with the light, which is an error of 1e-3 over a focus step.
    assert found == pytest.approx(seen(made, frame, position), rel=2e-3)


def replace_light(stack, radiance):
    return replace(stack, radiance=np.full_like(stack.radiance, radiance))


def test_what_the_encoder_gets_is_the_picture_of_every_readout():
    charge_source = ChargeSource(plane_source(stacks()), SENSOR)
    charge_source.scale = 3.0
    gain = np.stack([np.linspace(1, 2, FRAMES), np.linspace(1, 0, FRAMES)], axis=1)
    for run in charge_source.time_stack.split_at_slices(0, FRAMES):
        begin, end = run[:2]
        stack, index, fraction, weights = charge_source.encoder_inputs(run, position=SWEEP, gain=gain).values()
        for t in range(0, end - begin, 37):
            k, f = index[t], fraction[t]
            after = stack[:, min(k + 1, stack.shape[1] - 1)]
            pictures = (1 - f) * stack[:, k] + f * after
            got = np.tensordot(weights[t], pictures, 1)
            wanted = np.tensordot(gain[begin + t], charge_source.charge_image(begin + t, SWEEP[begin + t]), 1)
            assert got == pytest.approx(wanted, rel=1e-5)


@pytest.mark.slow
@pytest.mark.daily(4)
@pytest.mark.parametrize("step", [8, 24, 80, 312])
@pytest.mark.parametrize("hz", [311, 1_000, 16_000, 48_500, 50_000, 97_700])
def test_a_camera_of_any_rate_records_slices_of_any_rate(step, hz):
    """All but the last call are whole bytes, and each readout gets its own picture, whichever stacks share its byte."""
    spike_frames = 1600
    spike_starts = tuple(range(0, spike_frames + step, step))
    swing = 0.5 + 0.5 * np.sin(np.arange(spike_frames) / 90)
    made = stacks(swing, spike_starts, (0.5,) * len(spike_starts))
    starts = tuple(round(frame * hz / 20_000) for frame in spike_starts)
    frames = int(spike_frames * hz / 20_000)
    charge_source = ChargeSource(plane_source(made, starts), SENSOR)
    position = np.interp((np.arange(frames) + 0.5) * 20_000 / hz - 0.5, np.arange(spike_frames), swing)
    gain = np.stack([np.linspace(1, 2, frames), np.linspace(1, 0, frames)], axis=1)
    array = SpadCamera(get_sensor("swissspad3", kind="photons", readout_hz=hz, exposure_s=1e-5), (6, 8), seed=3)
    done = 0
    for run in charge_source.time_stack.split_at_slices(0, frames):
        assert run.begin == done
        inputs = charge_source.encoder_inputs(run, position=position, gain=gain)
        array.encode(**inputs)  # refuses to go on within a byte
        done = run.end
        stack, index, fraction, weights = inputs.values()
        for t in range(run.end - run.begin):
            after = stack[:, min(index[t] + 1, stack.shape[1] - 1)]
            got = np.tensordot(weights[t], (1 - fraction[t]) * stack[:, index[t]] + fraction[t] * after, 1)
            at = run.begin + t
            wanted = np.tensordot(gain[at], charge_source.charge_image(at, position[at]), 1)
            assert got == pytest.approx(wanted, rel=1e-4)
    assert done == frames


def counted(made):
    """The plane source, and the list of its reads: (stack, first, stop)."""
    source, reads = plane_source(made), []

    def planes(j, first, stop):
        reads.append((j, first, stop))
        return source.load_planes(j, first, stop)

    return replace(source, load_planes=planes), reads


def through(charge_source, position, frames=FRAMES):
    gain = np.ones((FRAMES, 2), np.float32)
    return [
        list(charge_source.encoder_inputs(run, position=position, gain=gain).values())
        for run in charge_source.time_stack.split_at_slices(0, frames)
    ]


def test_only_those_positions_are_read_at_which_the_lens_is():
    source, reads = counted([replace_window(stack) for stack in stacks(np.abs(1 - 2 * SWEEP))])
    charge_source = ChargeSource(source, SENSOR)
    got = through(charge_source, 0.3 + 0.1 * SWEEP)  # positions 2.4 to 3.2 of 0 to 8
    assert set(reads) == {(0, 2, 4), (1, 2, 4), (1, 4, 5), (2, 2, 5), (3, 3, 5)}
    assert len(reads) == 5
    assert len(charge_source._cache) <= 3 * 3  # from at most three stacks
    for (stack, index, fraction, _), (j, k) in zip(got, [(0, 2), (1, 2), (2, 3)], strict=True):
        flat = ChargeSource(source, SENSOR)._load_charge(j, range(k, k + 1)).sum(axis=0)
        assert stack[0, 0] == pytest.approx(flat[0], rel=1e-6)
        assert index.min() == 0
        assert 0 <= fraction.min() <= fraction.max() < 1


def replace_window(stack):
    """The stack rendered at all positions: those of the window unchanged, the others random."""
    light = np.random.default_rng(5).uniform(0.1, 1, (2, SPEC.positions, 6, 8)).astype(np.float32)
    first, last = stack.spec.window
    light[:, first : last + 1] = stack.radiance
    return replace(stack, spec=replace(stack.spec, window=None), radiance=light)


def test_the_cache_exceeds_its_budget_only_by_neighbouring_planes():
    """The cache is full after one pass; each later pass needs more positions of each stack."""
    at = tuple(range(0, 8 * 61, 8))
    still = np.full(480, 0.5)
    made = [replace_window(stack) for stack in stacks(still, at, (0.5,) * len(at))]
    plane = 2 * 6 * 8 * 4
    charge_source = ChargeSource(plane_source(made, at), SENSOR, cache_bytes=2 * len(at) * plane)
    gain, cached = np.ones((480, 2), np.float32), []
    for swing in (0.0, 0.2, 0.4, 0.45):
        position = 0.5 + swing * np.sin(np.arange(480) / 2)
        for run in charge_source.time_stack.split_at_slices(0, 480):
            charge_source.encoder_inputs(run, position=position, gain=gain)
            cached.append(len(charge_source._cache))
    assert max(cached) <= 2 * len(at) + 3 * SPEC.positions
    assert cached[-1] <= 2 * len(at)


def test_a_scene_that_stands_still_is_recorded_alike_as_one_stack_and_as_many():
    """Equal up to the rounding of a sum of two terms, which is one spike per pixel."""
    random = np.random.default_rng(1)
    light = random.uniform(0.1, 1, (2, 9, 6, 8)).astype(np.float32)
    single = FocalStack(SPEC, light, np.ones((6, 8), np.float32), np.ones((6, 8), bool), "llvm")
    slices = []
    for stack in stacks():
        first, last = stack.spec.window
        slices.append(replace(stack, radiance=light[:, first : last + 1]))
    counts = []
    for source in (PlaneSource.from_stack(single), plane_source(slices)):
        charge_source, encoder = ChargeSource(source, SENSOR), Encoder(SENSOR, (6, 8), seed=3)
        charge_source.scale = 0.2 * SENSOR.threshold_e / float(charge_source.charge_image(0, 0.0).sum(axis=0).mean())
        gain = np.ones((FRAMES, 2), np.float32)
        blocks = [
            encoder.encode(**charge_source.encoder_inputs(run, position=SWEEP, gain=gain))
            for run in source.time_stack.split_at_slices(0, FRAMES)
        ]
        counts.append(np.unpackbits(np.concatenate(blocks, axis=-1), axis=-1).sum(axis=-1).astype(int))
    assert np.abs(counts[0] - counts[1]).max() <= 1
    assert counts[0].sum() > 1_000


def test_a_lens_that_comes_when_the_target_is_out_of_sight_does_not_meet_it():
    """The lens is at the target's focus between the second and the third moment."""
    met, _ = find_true_focus(plane_source(stacks(depths=(0.5, 0.5, 0.5, 0.5))), SWEEP)
    assert 160 < met.frame < 320
    gone, _ = find_true_focus(plane_source(stacks(depths=(0.5, 0.5, None, None))), SWEEP)
    assert np.isnan(gone.frame)
    assert gone.target.any()
    assert gone.position == pytest.approx(met.position, abs=1e-6)
    back, _ = find_true_focus(plane_source(stacks(depths=(None, 0.5, 0.5, None))), SWEEP)
    assert back.frame == pytest.approx(met.frame)


def test_a_lens_that_never_meets_the_target_has_no_frame():
    position = np.full(FRAMES, 0.9)
    truth, _ = find_true_focus(plane_source(stacks(position, depths=(0.55, 0.53, 0.51, 0.50))), position)
    assert np.isnan(truth.frame)
    assert truth.position == pytest.approx(truth.track.max(), abs=0.01)  # the nearest focus on the track


def test_a_target_that_is_never_seen_is_refused(tmp_path):
    recorder = Recorder(SENSOR, FRAMES, device_seed=1, provenance={})
    source = plane_source(stacks(depths=(None,) * 4))
    error = refusal(recorder.record, make_sequence(), source, path=tmp_path / "s.h5", fingerprint="")
    assert "the target of plane is never seen in 400 frames" in error.problem
    assert "check its motion" in error.hint
    assert not (tmp_path / "s.h5").exists()


def box_of(truth):
    return bounding_box(truth.target)


def test_sharpness_is_taken_where_the_lens_is_then_and_nowhere_else():
    source = plane_source(stacks())
    charge_source = ChargeSource(source, SENSOR)
    found = noise_free_sharpness(charge_source, [box_of(find_true_focus(source, SWEEP)[0])], position=SWEEP)[0]
    assert np.isfinite(found).all()
    half = SWEEP / 2
    source = plane_source(stacks(half))
    found = noise_free_sharpness(
        ChargeSource(source, SENSOR), [box_of(find_true_focus(source, half)[0])], position=half
    )[0]
    assert np.isfinite(found[:5]).all()
    assert np.isnan(found[5:]).all()


def test_a_recording_of_a_moving_scene_fires_as_asked_and_keeps_its_track(tmp_path):
    recorder = Recorder(SENSOR, FRAMES, device_seed=1, provenance={})
    recorder.record(make_sequence(mean_rate=0.25), plane_source(stacks()), path=tmp_path / "s.h5", fingerprint="")
    with saf_gen.open_stream(tmp_path / "s.h5") as stream:
        frame = round(stream.truth.frame)
        rate = stream.counts(frame - 20, frame + 20).mean() / 40
        assert stream.truth.track.shape == (FRAMES,)
        assert stream.metadata.provenance["stack"].count("\n") == 3
    assert rate == pytest.approx(0.25, rel=0.1)  # the light changes over 40 frames


def test_a_truncated_stack_ends_with_the_slice_after_the_last_readout():
    specs = tuple(replace(SPEC, window=(n, n + 1), time_s=n * 0.008) for n in range(4))
    time_stack = TimeResolvedStack((0, 160, 320, 480), specs)
    assert [time_stack.truncated_to(frames).slice_frames[-1] for frames in (1, 160, 160.5, 320, 470, 9000)] == [
        *(160, 160, 320, 320, 480, 480)
    ]
    assert time_stack.truncated_to(200).specs == specs[:3]
    assert {spec.rendered_count for spec in time_stack.with_full_travel().specs} == {9}
    assert time_stack.with_full_travel().with_full_travel() == time_stack.with_full_travel() != time_stack
    assert [spec.time_s for spec in time_stack.with_full_travel().specs] == [spec.time_s for spec in specs]


def test_a_time_resolved_stack_lists_its_missing_pieces(tmp_path):
    made = stacks()
    time_stack = plane_source(made).time_stack
    assert time_stack.find_missing(tmp_path) == list(time_stack.specs)
    assert time_stack.count_stored(tmp_path) == 0
    for stack in made:
        store = StackStore(tmp_path, stack.spec)
        store.write_geometry(stack.depth, stack.target, backend="llvm")
        for group, radiance in zip(SPEC.groups, stack.radiance, strict=True):
            store.write_group(group, radiance, backend="llvm")
    assert time_stack.find_missing(tmp_path) == []
    assert (time_stack.count_stored(tmp_path), time_stack.with_full_travel().count_stored(tmp_path)) == (4, 0)
    source = PlaneSource.from_folder(time_stack, tmp_path)
    stored = source.load_planes(2, 0, made[2].spec.rendered_count)
    assert stored == pytest.approx(made[2].radiance, rel=2**-11)  # time slices are half floats
    assert np.array_equal(source.load_planes(2, 1, 3), stored[:, 1:3])
    assert source.backend == "llvm"
    digest = time_stack.digest(tmp_path)
    StackStore(tmp_path, time_stack.specs[1]).write_group("lamp", made[1].radiance[0] * 2, backend="llvm")
    assert time_stack.digest(tmp_path) != digest
