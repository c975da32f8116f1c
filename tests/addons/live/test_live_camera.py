"""A live camera is the encoder and the closed loop without an end."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal

import saf_gen
from saf_gen.addons.live.camera import LiveCamera
from saf_gen.addons.live.source import open_capture
from saf_gen.benchmark.view.captured import CapturedReadouts
from saf_gen.core.bits import unpack_bits
from saf_gen.errors import BadInput


@pytest.mark.slow
def test_its_counts_are_those_of_the_encoder_bit_for_bit(still):
    # A power of two, because the encoder may multiply gain, charge and response in another order.
    capture = replace(still, seed=7, device_seed=7, exposure=2.0 ** round(np.log2(still.exposure)))
    camera = LiveCamera(capture, region="frame", start=0.5)  # a rendered position
    source = capture.open_charge_source()
    source.scale = 1.0
    charge = source.charge_image(0, 0.5).sum(axis=0) * np.float32(capture.exposure)
    spikes = saf_gen.encode(charge[None], capture.sensor, frames=1600, seed=7)
    frames = np.empty((1600, *camera.shape), np.uint8)
    unpack_bits(np.ascontiguousarray(spikes.transpose(2, 0, 1)), frames, first=0)
    begin = 0
    for count in (100, 3, 1, 7, 300, 5, 8, 1024):  # windows that begin anywhere in a packet
        assert np.array_equal(camera.read(count), frames[begin : begin + count].sum(axis=0, dtype=np.uint32)), begin
        begin += count
        assert camera.seconds == begin / 20_000
    camera.wait(13)
    begin += 13
    assert np.array_equal(camera.read(40), frames[begin : begin + 40].sum(axis=0, dtype=np.uint32))


@pytest.mark.parametrize("scene", ["still", "moving"])
def test_its_counts_are_those_of_the_closed_loop_and_a_moving_scene_begins_again(scene, request):
    capture = request.getfixturevalue(scene)
    camera = LiveCamera(capture, region="target", start=0.3)
    known = CapturedReadouts(capture, capture.open_light(capture.rows_for(camera.box)), region=camera.box)
    known.encode_until(capture.frames, np.full(capture.frames, 0.3))
    for first in range(0, capture.frames, 100):
        assert np.array_equal(camera.read(100), known.window(first, first + 100)), first
    focus = camera.true_focus
    assert camera.read(200).any()
    assert focus == (capture.truth.position if scene == "still" else capture.truth.track[0])


@pytest.mark.slow
def test_a_lens_takes_time_and_focus_changes_the_score(still):
    camera = LiveCamera(still, start=1.0)
    camera.focus = camera.true_focus
    assert camera.focus == camera.true_focus
    assert camera.lens == 1.0
    assert camera.is_settled is False
    far = camera.score("sd", frames=8)
    camera.settle()
    assert camera.is_settled
    assert camera.lens == pytest.approx(camera.true_focus, abs=0.01)
    assert 0 < camera.seconds < 1
    assert camera.score("sd", frames=400) > 1.05 * LiveCamera(still, start=1.0).score("sd", frames=400)
    assert np.isfinite(far)
    assert camera.score("sd_debiased") != camera.score("sd")  # of the same window, in another form
    assert np.isfinite(camera.score("sd_tfi", frames=403))


def test_lamps_dim_and_follow_schedules(still):
    camera = LiveCamera(still)
    assert camera.lamps == ("lamp", "room")
    bright = int(camera.read(400).sum())
    for lamp in camera.lamps:
        camera.dim(lamp, 0.25)
    camera.read(8)
    dim = int(camera.read(400).sum())
    assert camera.gains == {"lamp": 0.25, "room": 0.25}
    assert 0.2 * bright < dim < 0.35 * bright
    camera.play({"kind": "steps", "every_s": 0.01, "levels": [1.0, 4.0]}, seconds=0.02)
    counts = [int(camera.read(200).sum()) for _ in range(4)]
    assert counts[1] > 2.5 * counts[0] > counts[2]
    assert counts[3] > 2.5 * counts[2]
    half = {"kind": "constant", "level": 0.5}
    camera.play({"product": [{"kind": "steps", "every_s": 0.01, "levels": [2.0, 8.0]}, half]}, seconds=0.02)
    halved = [int(camera.read(200).sum()) for _ in range(4)]
    assert halved == pytest.approx(counts, rel=0.1)
    camera.play(None)
    camera.read(8)
    assert int(camera.read(400).sum()) == pytest.approx(dim, rel=0.1)


def test_a_method_turns_the_lens_and_time_goes_on(still):
    camera = LiveCamera(still, start=0.95)
    seen = []
    run = camera.run("sd+golden_section", budget_s=0.6, watch=seen.append)
    assert run.method == "sd+golden_section"
    assert run.truth == camera.true_focus
    assert abs(run.error_dof) < 2
    assert camera.lens == run.position == camera.focus
    assert camera.seconds == sum(seen) / 20_000 >= run.seconds > 0
    assert camera.read(50).any()
    swept = LiveCamera(still, start=0.95).run("sd+argmax", budget_s=0.6)
    assert abs(swept.error_dof) < 2
    again = LiveCamera(still, start=0.95).run("sd+golden_section", budget_s=0.6)
    assert again == run


def test_a_watcher_may_stop_a_method_and_the_camera_goes_on(still):
    camera = LiveCamera(still)

    def stop(frames):
        raise InterruptedError

    with pytest.raises(InterruptedError):
        camera.run("sd+golden_section", watch=stop)
    assert camera.read(100).any()
    assert camera.is_settled


def test_a_change_of_the_region_starts_the_pixels_anew(still):
    camera = LiveCamera(still, region="target")
    first = camera.read(100)
    camera.region = "frame"
    assert camera.shape == (still.sensor.rows, still.sensor.columns)
    assert camera.read(100).shape == camera.shape
    camera.region = "target"
    assert not np.array_equal(camera.read(100), first)
    assert camera.seconds == pytest.approx(300 / 20_000, abs=16 / 20_000)


def test_the_same_calls_give_the_same_counts_and_another_seed_others(still):
    def turn(seed):
        camera = LiveCamera(still, seed=seed)
        camera.focus = 0.2
        return camera.read(333)

    assert np.array_equal(turn(4), turn(4))
    assert not np.array_equal(turn(4), turn(5))


@pytest.mark.parametrize(
    ("call", "problem"),
    [
        (lambda c: c.read(0), "0 frames were asked for; allowed: a whole number, 1 to 20,000"),
        (lambda c: c.read(2.5), "2.5 frames were asked for"),
        (lambda c: setattr(c, "focus", 1.5), "focus is 1.5; allowed: 0 to 1"),
        (
            lambda c: setattr(c, "region", "targt"),
            "unknown region 'targt'; allowed: frame, target; did you mean 'target'",
        ),
        (lambda c: c.dim("lmp", 1), "unknown lamp 'lmp'; allowed: lamp, room; did you mean 'lamp'"),
        (lambda c: c.dim("lamp", -1), "the gain of lamp 'lamp' is -1; allowed: 0 to 100"),
        (lambda c: c.play({"kind": "flickr"}), "did you mean 'flicker'"),
        (lambda c: c.play({"product": [{"kind": "constant"}]}), "allowed: a list of at least two schedules"),
        (lambda c: c.play({"kind": "ramp"}, seconds=0), "a schedule of 0 s; allowed: above 0, at most 60"),
        (lambda c: c.score("sdd", 100), "unknown focus measure 'sdd'"),
        (lambda c: c.score("sd"), "nothing has been read yet"),
        (lambda c: c.run("sd+gold"), "gold"),
    ],
)
def test_what_is_not_allowed_is_told_in_one_line(still, call, problem):
    with pytest.raises(BadInput) as refused:
        call(LiveCamera(still))
    assert problem in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.slow
def test_photons_are_scored_by_no_measure_that_corrects_for_spikes(photons):
    camera, problem = LiveCamera(photons), "corrects for the noise of spikes, and this camera counts single photons"
    assert camera.score("sd", frames=400) > 0
    for call in (lambda: camera.score("sd_debiased"), lambda: camera.run("structure_calibrated+photon_aware")):
        assert problem in str(refusal(call))


@pytest.mark.slow
def test_a_scene_is_rendered_once_and_kept(tmp_path, monkeypatch, test_scenes, small_sensor):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    told = []
    monkeypatch.setattr("saf_gen.addons.live.source.POSITIONS", 5)
    first = open_capture("plane", sensor=str(small_sensor), samples=1, tell=told.append)
    assert told == [
        f"rendering the focal stack of plane, which is kept in {next((tmp_path / 'saf_gen/live').glob('plane-*/'))}"
    ]
    monkeypatch.setattr("saf_gen.addons.live.source.run_plan", None)  # nothing is left to do
    again = open_capture("plane", sensor=str(small_sensor), samples=1, tell=told.append)
    assert len(told) == 1
    assert again.plane_source.digest == first.plane_source.digest
    assert np.array_equal(LiveCamera(again).read(100), LiveCamera(first).read(100))


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ("usaf_taget", "unknown scene 'usaf_taget'"),
        ("datasets/none", "no dataset or stream at 'datasets/none'"),
        ("none.h5", "no dataset or stream at 'none.h5'"),
    ],
)
def test_what_cannot_be_looked_at_is_told_in_one_line(source, problem, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput) as refused:
        open_capture(source)
    assert problem in str(refused.value)


@pytest.mark.slow
def test_the_sample_is_looked_at_without_a_renderer(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    camera = LiveCamera("sample")
    camera.focus = camera.true_focus
    camera.settle()
    sharp = camera.score("sd", frames=200)
    camera.focus = 0.0
    camera.settle()
    assert sharp > camera.score("sd", frames=200)
    assert list(tmp_path.iterdir()) == []


def test_a_lens_that_runs_for_long_keeps_few_readings(still):
    camera = LiveCamera(still)
    for _ in range(5):
        camera.wait(5000)
    assert camera._lens._read.size <= 1 << 13
    with pytest.raises(BadInput, match="is forgotten"):
        camera._lens.read_sensor(0, 10)
