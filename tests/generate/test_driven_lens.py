"""Recordings whose lens is moved by an actuator: the log is what it was told or read, the truth what it did."""

import numpy as np
import pytest
import yaml
from capture_dataset import VARIANT, write_moving_plane
from refusals import refusal
from small_dataset import DRIVE, SMALL_RECIPE, make_sequence
from test_recorder import CONSTANT, SWITCHED_OFF, stack

import saf_gen
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.camera import get_sensor
from saf_gen.generate.record import Recorder
from saf_gen.generate.resolve import recipe_digest, resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.optics.actuators import get_actuator
from saf_gen.optics.focus_crossings import focus_crossings
from saf_gen.stack.time_resolved import PlaneSource
from saf_gen.stream.cutting import cut_stream
from saf_gen.stream.description import describe_content

FRAMES = 4_000
THERE_AND_BACK = {"kind": "sweep_and_return", "dwell_s": 0.02}


def record(folder, actuator, *, motion=THERE_AND_BACK, pictures=None, name="s"):
    sensor = get_sensor("vidar_400x250", rows=16, columns=24, pitch_m=60e-6, reset_loss=0.0)
    recorder = Recorder(sensor.with_noise(**SWITCHED_OFF), FRAMES, device_seed=1, provenance={})
    sequence = make_sequence(schedule=CONSTANT, motion=motion, actuator=actuator, actuator_seed=3)
    path = folder / f"{name}.h5"
    recorder.record(sequence, PlaneSource.from_stack(pictures or stack()), path=path, fingerprint="f")
    return saf_gen.open_stream(path)


def test_the_log_is_what_a_piezo_was_told_and_the_truth_where_it_was(tmp_path):
    with record(tmp_path, get_actuator("piezo")) as stream:
        log, did, truth = stream.focus_position, stream.truth.lens, stream.truth
        told = make_sequence(motion=THERE_AND_BACK).lens_course(FRAMES, readout_hz=20_000)[0]
        assert log == pytest.approx(told, abs=3e-3)
        assert stream.metadata.lens_position is did
        assert stream.metadata.image_distance == pytest.approx(DRIVE.image_distance(log), rel=1e-6)
        up, down = (float(np.interp(0.5, log[part][::way], did[part][::way]))
                    for part, way in ((slice(0, FRAMES // 2), 1), (slice(FRAMES // 2, None), -1)))  # fmt: skip
        assert down - up == pytest.approx(0.13, rel=0.05)
        assert truth.frame == pytest.approx(focus_crossings(did, truth.position)[0], abs=1e-3)
        assert abs(truth.frame - focus_crossings(log, truth.position)[0]) > 20
        assert "off its log" in describe_content(stream)["lens"]


def test_the_spikes_are_those_of_where_the_lens_was(tmp_path):
    """A field that grows brighter over the travel, in windows of 200 readouts, without noise."""
    pictures = stack()
    pictures.radiance[:] *= np.linspace(0.5, 1.5, 9, dtype=np.float32)[:, None, None]
    with record(tmp_path, get_actuator("piezo"), pictures=pictures) as stream:
        did, log, best = (np.float64(x) for x in (stream.truth.lens, stream.focus_position, stream.truth.position))
        counts = np.array([stream.counts(t, t + 200)[4:12, 8:16].mean() for t in range(0, FRAMES, 200)])

    def expected(position):
        light = (0.5 + position) / DRIVE.image_distance(position) ** 2
        rate = 0.2 * light / ((0.5 + best) / DRIVE.image_distance(best) ** 2)
        return rate.reshape(-1, 200).sum(axis=1)

    assert counts == pytest.approx(expected(did), rel=0.01)
    assert np.abs(counts / expected(log) - 1).max() > 0.04


def test_a_log_of_a_sensor_at_the_lens_has_only_its_noise(tmp_path):
    with record(tmp_path, get_actuator("piezo", reads="lens", position_noise_rms=0.001)) as stream:
        off = np.float64(stream.focus_position) - stream.truth.lens
    assert off.std() == pytest.approx(0.001, rel=0.05)  # of 4,000 readings: 4.5 standard errors


def test_without_an_actuator_no_truth_of_the_lens_is_stored(tmp_path):
    with record(tmp_path, None) as stream:
        assert stream.truth.lens is None
        assert stream.metadata.lens_position is stream.focus_position
        assert "lens" not in describe_content(stream)


def test_methods_see_the_log_alone(tmp_path):
    with record(tmp_path, get_actuator("piezo")) as stream:
        view = RecordingView(WindowCounts(stream), saf_gen.get_measure("sd"))
        assert np.array_equal(view.positions(0), stream.focus_position)
        assert view.position(1_000) == stream.focus_position[1_000] != stream.truth.lens[1_000]


def test_a_part_keeps_its_part_of_the_truth(tmp_path):
    with record(tmp_path, get_actuator("piezo")) as stream:
        whole = stream.truth.lens
    cut_stream(tmp_path / "s.h5", tmp_path / "part.h5", first=2_000, stop=3_900)
    with saf_gen.open_stream(tmp_path / "part.h5") as part:
        assert np.array_equal(part.truth.lens, whole[2_000:3_900])
        assert part.truth.frame == pytest.approx(focus_crossings(part.truth.lens, part.truth.position)[0], abs=1e-3)


@pytest.mark.parametrize(
    ("lens", "problem"),
    [(np.zeros(7), "lens has shape (7,)"), (np.r_[np.nan, np.zeros(7)], "lens is not finite in 1 of 8 frames")],
)
def test_a_truth_of_the_lens_that_cannot_be_is_refused(tmp_path, lens, problem):
    frames = np.zeros((8, 4, 4), np.uint8)
    error = refusal(saf_gen.write_stream, tmp_path / "s.h5", frames, readout_hz=1e4, truth={"lens": lens})
    assert error.problem.startswith(problem)
    assert not list(tmp_path.iterdir())


# --- recipes -----------------------------------------------------------------------------------------


def write_recipe(folder, actuator=None, **changes):
    recipe = {**yaml.safe_load(SMALL_RECIPE), **changes}
    recipe["focus"] = {"drive": "image_distance", "positions": 9, **({"actuator": actuator} if actuator else {})}
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(recipe))
    return path


def test_the_digest_sees_the_numbers_of_the_actuator_and_not_its_name(tmp_path, test_scenes):
    text = (get_actuator.__globals__["PRESETS"].folder / "piezo.yaml").read_text()
    digests = []
    for name, change in ((None, ""), ("piezo", ""), ("mine.yaml", "name: mine"), ("mine.yaml", "hysteresis: 0.12")):
        key = change.partition(":")[0] or "name"
        lines = [change if change and line.startswith(f"{key}:") else line for line in text.splitlines()]
        (tmp_path / "mine.yaml").write_text("\n".join(lines) + "\n")
        digests.append(recipe_digest(resolve_recipe(write_recipe(tmp_path, name))))
    assert digests[1] == digests[2]
    assert len(set(digests)) == 3


def test_the_lens_errs_alike_under_every_light_and_not_in_every_repeat(tmp_path, test_scenes):
    splits = {"test": {"scenes": ["plane"], "lights": ["constant", "continuous"], "repeats": 2}}
    sequences = resolve_recipe(write_recipe(tmp_path, "hand", splits=splits)).sequences
    courses = {(s.planned.light, s.planned.repeat): s.planned.lens_course(400, readout_hz=20_000)[1] for s in sequences}
    assert (courses["constant", 0] == courses["continuous", 0]).all()
    assert (courses["constant", 0] != courses["constant", 1]).any()


@pytest.mark.parametrize(
    ("actuator", "problem", "expected"),
    [
        ("piezzo", "unknown actuator 'piezzo'", "piezo"),
        ("Piezo", "unknown actuator 'Piezo'", "piezo"),
        ("voice coil", "unknown actuator 'voice coil'", "voice_coil"),
        ("piezo.yml", "", "piezo.yml"),
        ("cards/piezo.yaml", "", "cards/piezo.yaml"),
        ("..", "unknown actuator '..'", ""),
        (["piezo"], "focus.actuator is ['piezo']", ""),
        ({"name": "piezo"}, "focus.actuator is {'name': 'piezo'}", ""),
        (7, "focus.actuator is 7", ""),
        (True, "focus.actuator is True", ""),
        ("bad.yaml", "hysteresis is 13", "0 to 0.3 of the travel"),
    ],
)
def test_an_actuator_that_there_is_not_is_refused_in_one_line(tmp_path, test_scenes, actuator, problem, expected):
    text = (get_actuator.__globals__["PRESETS"].folder / "piezo.yaml").read_text()
    (tmp_path / "bad.yaml").write_text(text.replace("hysteresis: 0.13", "hysteresis: 13"))
    error = refusal(resolve_recipe, write_recipe(tmp_path, actuator))
    assert "\n" not in str(error)
    assert problem in error.problem
    assert expected in str(error)


# --- from a recipe to the leaderboard ----------------------------------------------------------------


@pytest.mark.slow
def test_a_recipe_with_a_piezo_is_ranked_by_where_its_lens_was(tmp_path, monkeypatch):
    """At rest and moving: the slices of the moving scene hold the positions where the lens was."""
    write_moving_plane(tmp_path, monkeypatch)
    splits = {"test": {"scenes": ["plane"], "lights": ["constant"], "scene_motion": ["static", "dynamic"]}}
    made = generate(resolve_recipe(write_recipe(tmp_path, "piezo", splits=splits)), tmp_path / "made", variant=VARIANT)
    assert made.failed == {}
    assert "told to the actuator piezo" in (made.folder / "README.md").read_text()
    records = evaluate(made.folder, methods=["sd+argmax:window=20"], draw=False).records
    assert len(records) == 2
    for record in records:
        with saf_gen.open_stream(made.folder / "test" / f"{record.what.sequence}.h5") as stream:
            log, did, truth = stream.focus_position, stream.truth.lens, stream.truth
            assert "hysteresis: 0.13" in stream.metadata.provenance["actuator"]
        assert 0.03 < np.abs(did - log).max() < 0.12  # it rings, too
        best = truth.position if truth.track is None else np.interp(record.judgement.frame, np.arange(400), truth.track)
        assert record.judgement.position == pytest.approx(
            np.interp(record.judgement.frame, np.arange(400), did), abs=1e-9
        )
        assert record.judgement.error == pytest.approx(record.judgement.position - best, abs=1e-9)
    again = generate(resolve_recipe(tmp_path / "small.yaml"), tmp_path / "made", variant=VARIANT)
    assert (again.recorded, again.kept) == ([], ["plane-constant-00", "plane-dynamic-constant-00"])
