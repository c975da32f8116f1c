"""The closed loop as a Gymnasium environment: Gymnasium's checker, seeds, observations, rewards and records."""

import gc
import json
import pickle
import subprocess
import sys
import weakref
from dataclasses import replace
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from handmade_records import BLANK, change
from refusals import assert_says, refusal
from windowed_dataset import make_windowed_dataset

from saf_gen import SpikeWindows
from saf_gen.benchmark.evaluate import evaluate
from saf_gen.benchmark.gym import ENVIRONMENT_ID, AutofocusEnv, evaluate_policy
from saf_gen.benchmark.gym.episode import average_observation
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import format_records, read_records
from saf_gen.benchmark.tracks.closed_loop_run import run_closed_loop
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.errors import BadInput
from saf_gen.optics.actuators import get_actuator
from saf_gen.parts import Answer
from saf_gen.plugins.measures import get_measure
from saf_gen.stack.light import SceneLight

PROTOCOL = ClosedLoopProtocol(get_actuator("voice_coil_hall"), budget_s=0.04, sweep_s=0.02)
PLANE = "plane-constant-00"
STILL = 104  # frames of a control period


@pytest.fixture(scope="module")
def dataset(captured_dataset):
    return captured_dataset


def make_env(dataset, **more):
    return AutofocusEnv(dataset, **{"protocol": PROTOCOL, "pixels": 16, **more})


def visit(*positions):
    """Return a maker of policies that send the lens to these positions, one per step, and answer the last."""

    def make():
        actions = iter([*((position, 0.0) for position in positions), (positions[-1], 1.0)])
        return lambda observation: np.array(next(actions), np.float32)

    return make


def play(env, *positions, **reset):
    """Play an episode; return (observation, reward, info) after the reset and after each step."""
    observation, info = env.reset(**reset)
    policy, rows = visit(*positions)(), [(observation, 0.0, info)]
    over = False
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        rows.append((observation, reward, info))
        over = terminated or truncated
    return rows


def are_equal(rows, others):
    return len(rows) == len(others) and all(
        all(a[key].tobytes() == b[key].tobytes() for key in a) and (reward, info) == (other_reward, other_info)
        for (a, reward, info), (b, other_reward, other_info) in zip(rows, others, strict=True)
    )


def load(env, sequence=PLANE):
    return env.load_sequence(next(task for task in env.tasks if task.id == sequence))


def with_truth(env, **changes):
    """Change the truth of the still plane in an environment, and return the environment."""
    sequence = load(env)
    truth = replace(sequence.capture.truth, **changes)
    changed, load_sequence = replace(sequence, capture=replace(sequence.capture, truth=truth)), env.load_sequence
    env.load_sequence = lambda task: changed if task.id == PLANE else load_sequence(task)
    return env


@pytest.mark.slow
def test_gymnasiums_checker_finds_nothing(dataset):
    """Warnings are errors in tests, so the checker's recommendations count too."""
    check_env(gymnasium.make(ENVIRONMENT_ID, dataset=dataset, protocol=PROTOCOL, render_mode="rgb_array").unwrapped)


def test_a_policy_learns_on_no_split_that_was_not_chosen(tmp_path):
    several = make_windowed_dataset(tmp_path / "several", splits=("train", "train", "test"))
    error = refusal(make_env, several)
    assert (error.problem, error.allowed) == ("no split is given", "train, test, or all")
    assert str(refusal(SpikeWindows, several)) == str(error)  # and that of tensors: tests/with_torch
    assert refusal(SpikeWindows, several, "trian").allowed == refusal(make_env, several, split="trian").allowed
    assert refusal(make_env, several, split="trian").nearest == "train"
    for options, ids in (
        ({"split": "train"}, ["s0", "s1"]),
        ({"split": "all"}, ["s0", "s1", "s2"]),
        ({"sequences": ["s2"]}, ["s2"]),
    ):
        assert [task.id for task in make_env(several, **options).tasks] == ids
    assert len(make_env(make_windowed_dataset(tmp_path / "one", splits=("train",))).tasks) == 1


def test_a_seed_names_an_episode_and_those_after_it_bit_for_bit(dataset):
    env, used = make_env(dataset), make_env(dataset)
    play(used, 0.1, seed=9)
    first, second = ([play(one, 0.2, 0.7, seed=5), play(one, 0.3), play(one, 0.3)] for one in (env, used))
    assert all(map(are_equal, first, second))
    assert not are_equal(first[1], first[2])
    assert not are_equal(first[0], play(env, 0.2, 0.7, seed=6))


def test_seeds_draw_every_sequence_and_positions_of_the_entire_travel(dataset):
    env = make_env(dataset)
    drawn = [env.reset(seed=seed) for seed in range(20)]
    assert {info["sequence"] for _, info in drawn} == {task.id for task in env.tasks}
    lens = {float(seen["lens"][0]) for seen, _ in drawn}
    assert len(lens) == 20
    assert max(lens) - min(lens) > 0.5


@pytest.mark.slow
def test_memory_stays_flat_over_resets(dataset):
    """Of all sequences that were loaded, only ``keep`` are alive."""
    env = make_env(dataset, keep=1)
    loaded = [weakref.ref(env.load_sequence(task)) for task in env.tasks]
    for seed in range(4):
        env.reset(seed=seed)
        env.step(np.array([0.5, 0.0], np.float32))
    gc.collect()
    loaded += [weakref.ref(env.load_sequence(task)) for task in env.tasks]
    gc.collect()
    assert sum(sequence() is not None for sequence in loaded) == 1
    env.close()
    gc.collect()
    assert not any(sequence() for sequence in loaded)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.array([0.5, 0.0], np.float32))


def run_benchmark(sequence, look, *positions):
    """Run a search of the benchmark that acts like ``visit``; return its run, and what it saw at each look."""
    seen = []

    class Search:
        commands = True

        def __call__(self, view):
            seen.append(look(view))
            for position in positions:
                view.move(position)
                seen.append(look(view))
            return Answer(position=positions[-1])

    method = Method("sd+x", get_measure("sd"), Search(), "0" * 12)
    return run_closed_loop(sequence.make_captured(), method, protocol=PROTOCOL), seen


def test_a_named_sequence_is_that_of_the_benchmark_bit_for_bit(dataset):
    """The same positions at the same times give the same lens path, spikes and judgement as the benchmark."""
    env = make_env(dataset)
    rows = play(env, 0.25, 0.75, 0.5, options={"sequence": PLANE})
    sequence = load(env)
    run, pictures = run_benchmark(sequence, lambda view: view.counts(view.now, view.now + STILL), 0.25, 0.75, 0.5)
    assert np.array_equal(env.episode.run.path, run.path)
    assert env.episode.run.frames_seen == run.frames_seen
    for (seen, _, _), counts in zip(rows, pictures, strict=False):
        expected = (average_observation(counts, 16, columns=16) / STILL).astype(np.float32)
        assert np.array_equal(seen["image"], expected)
    info = rows[-1][2]
    judgement = sequence.make_record(run, who=BLANK.who, what=BLANK.what).judgement
    assert (info["error"], info["error_dof"]) == (judgement.error, judgement.error_dof)


def test_the_rest_of_an_observation_is_the_sensor_and_the_time(dataset):
    seen, info = make_env(dataset).reset(options={"sequence": PLANE})
    assert seen["left"][0] == np.float32(1 - STILL / 800)
    assert info == {"sequence": PLANE, "seconds": STILL / 20_000}
    rows = play(make_env(dataset), *[0.75] * 5, options={"sequence": PLANE})
    assert rows[4][0]["lens"][0] == pytest.approx(0.75, abs=0.03)


def test_a_period_is_scored_as_a_search_would_score_it_whatever_the_threads(dataset):
    """So a wrapper can show a policy the same scores as the benchmark."""
    env = make_env(dataset, threads=1)
    env.reset(options={"sequence": PLANE})
    env.step(np.array([0.75, 0], np.float32))

    def look(view):
        view.wait(STILL)
        return view.score(view.now - STILL, view.now, "sd_calibrated")

    _, scores = run_benchmark(load(make_env(dataset)), look, 0.75)
    assert env.episode.score("sd_calibrated") == scores[1] != scores[0]
    assert "sd_calibratd" in refusal(env.episode.score, "sd_calibratd").problem


def test_a_measure_that_corrects_for_spikes_scores_no_photons(dataset, tmp_path, call):
    target = tmp_path / "photons"
    assert call("recapture", dataset, "--sensor", "qvga_spad", "--sequence", PLANE, "--out", target)[0] == 0
    env = make_env(target, threads=1)
    env.reset(options={"sequence": PLANE})
    assert env.episode.score("sd") > 0
    error = refusal(env.episode.score, "sd_calibrated")
    assert_says(error, "sd_calibrated corrects for the noise of spikes, and this recording holds single photons | sd")


def test_the_truth_is_out_of_reach_before_the_end(dataset):
    """With another truth all observations are the same to the bit, and only rewards differ."""
    original, changed = make_env(dataset), make_env(dataset)
    truth = load(original).capture.truth
    with_truth(changed, position=truth.position + 0.3, depth_of_focus=(0.1, 0.9))
    positions = (0.2, 0.9, 0.4)
    first, second = (play(env, *positions, options={"sequence": PLANE}) for env in (original, changed))
    assert are_equal(*([(seen, 0.0, {}) for seen, _, _ in rows] for rows in (first, second)))
    assert [row[2] for row in first[:-1]] == [row[2] for row in second[:-1]]
    assert [row[1] for row in first[1:]] != [row[1] for row in second[1:]]
    assert first[-1][2]["truth"] == truth.position
    for seen, _, info in first[:-1]:
        assert set(seen) == {"image", "lens", "left"}
        assert set(info) == {"sequence", "seconds"}


def test_a_control_period_is_a_whole_number_of_packets(dataset):
    for control_s, frames in ((1e-6, 8), (4e-4, 8), (4.5e-4, 16), (0.005, STILL)):
        _, info = make_env(dataset, control_s=control_s).reset(seed=1)
        assert info["seconds"] == frames / 20_000


def test_the_picture_shows_the_box_as_it_was_seen(dataset):
    env = make_env(dataset, render_mode="rgb_array", region="frame")
    seen, _ = env.reset(options={"sequence": PLANE})
    shown = env.render()
    assert shown.shape == (40, 64, 3)
    assert shown.dtype == np.uint8
    assert ((shown[..., 0] / 255.0) ** 2.2).mean() == pytest.approx(seen["image"].mean(), abs=0.005)


@pytest.mark.parametrize("shape", [(5, 7), (40, 31)])
def test_area_means_are_those_of_the_image_with_every_pixel_cut_up(shape):
    """The slow reference repeats pixels until each area is a block of pixels."""
    rows, columns = 6, 9
    image = np.random.default_rng(1).integers(0, 105, shape)
    fine = np.repeat(np.repeat(image, rows, axis=0), columns, axis=1)
    expected = fine.reshape(rows, shape[0], columns, shape[1]).mean(axis=(1, 3))
    found = average_observation(image, rows, columns=columns)
    assert found == pytest.approx(expected, abs=1e-9)
    assert found.mean() == pytest.approx(image.mean(), abs=1e-9)
    assert (average_observation(np.full(shape, 7), rows, columns=columns) == 7).all()


@pytest.mark.parametrize("sequence", [PLANE, "plane-dynamic-constant-00"])
def test_rewards_are_errors_over_time_and_a_bonus(dataset, sequence):
    """The return of an episode follows from the lens path, for a still and for a moving scene."""
    env = make_env(dataset)
    rows = play(env, 0.2, 0.6, options={"sequence": sequence})
    run = env.episode.run
    truth = env.load_sequence(next(j for j in env.tasks if j.id == sequence)).capture.truth
    best = np.full(800, truth.position) if truth.track is None else truth.track
    away = np.abs(run.path - best[: len(run.path)])
    left = (800 - len(run.path)) / 800
    bonus = 1.0 if abs(rows[-1][2]["error_dof"]) <= 1 else 0.0
    expected = bonus - away[STILL:].sum() / 800 - left * away[-1]
    assert sum(reward for _, reward, _ in rows) == pytest.approx(expected, abs=1e-12)


def test_without_a_truth_nothing_is_earned(dataset):
    env = with_truth(make_env(dataset), position=np.nan, depth_of_focus=(np.nan, np.nan))
    rows = play(env, 0.2, 0.6, options={"sequence": PLANE})
    assert [reward for _, reward, _ in rows] == [0.0] * 4
    assert rows[-1][2]["truth"] is None


def test_the_budget_ends_an_episode(dataset):
    env = make_env(dataset)
    env.reset(seed=1)
    hold = np.array([0.5, 0.5], np.float32)
    steps = [env.step(hold) for _ in range(-(-(800 - STILL) // STILL))]
    assert [step[2:4] for step in steps] == [(False, False)] * (len(steps) - 1) + [(False, True)]
    seen, *_, info = steps[-1]
    assert seen["left"][0] == 0
    assert info["seconds"] == 0.04
    assert info["status"] == "failed"
    assert env.episode.run.problem == "the budget of 800 frames was spent"
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(hold)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # since Python 3.12, if a process has threads
def test_environments_run_in_separate_processes(dataset):
    """Each gives the same results as in the parent for the same seed, even if the parent has used its own before."""
    here = make_env(dataset)
    action = np.array([0.2, 0.0], np.float32)
    first, _ = here.reset(seed=5)
    seen, reward, *_ = here.step(action)
    apart = gymnasium.vector.AsyncVectorEnv([partial(make_env, dataset)] * 2, context="fork")
    begun, _ = apart.reset(seed=[5, 5])
    others, rewards, *_ = apart.step(np.stack([action] * 2))
    apart.close()
    assert np.array_equal(begun["image"], [first["image"]] * 2)
    assert np.array_equal(others["image"], [seen["image"]] * 2)
    assert rewards.tolist() == [reward] * 2


def test_a_pickled_environment_must_be_reset(dataset):
    env = make_env(dataset)
    rows = play(env, 0.2, 0.6, seed=5)
    again = pickle.loads(pickle.dumps(env))
    with pytest.raises(gymnasium.error.ResetNeeded):
        again.step(np.array([0.5, 0.0], np.float32))
    assert are_equal(play(again, 0.2, 0.6, seed=5), rows)


@pytest.fixture(scope="module")
def folders(dataset, tmp_path_factory):
    """Two folders: with the records of two searches, and with those of a policy."""
    searches, policy = (tmp_path_factory.mktemp(name) for name in ("searches", "policy"))
    result = evaluate(dataset, methods=["sd+argmax", "sd+golden_section"], protocol=PROTOCOL)
    (searches / "records.jsonl").write_text(format_records(result.records))
    evaluate_policy(make_env(dataset), visit(0.25, 0.75), method="visitor", out=policy)
    return searches, policy


@pytest.mark.slow
def test_a_policy_is_in_one_table_with_searches(folders, tmp_path, call):
    both = tmp_path / "both"
    code, _, err = call("leaderboard", "merge", *folders, "--out", both)
    assert code == 0, err
    rows = json.loads((both / "leaderboard.json").read_text())["rows"]
    assert {row["method"] for row in rows} == {"sd+argmax", "sd+golden_section", "visitor"}


def test_the_record_of_a_policy_has_the_fields_of_that_of_a_search(folders):
    searches, policy = (read_records(folder) for folder in folders)
    assert [r.what.sequence for r in policy] == [r.what.sequence for r in searches if r.who.method == "sd+argmax"]
    for record in policy:
        other = next(r for r in searches if r.what.sequence == record.what.sequence)
        assert record.what == other.what
        assert record.who.region == other.who.region
        assert record.judgement.status == "answered"
        assert record.judgement.windows == len(record.judgement.trace) + 1
        assert record.judgement.seconds > 0
        assert record.who.parameters == "images of 16×16, every 5 ms"
        assert len(record.who.code) == 12


def test_what_a_policy_sees_is_part_of_its_code(dataset, folders):
    (finer,) = evaluate_policy(make_env(dataset, pixels=24, sequences=[PLANE]), visit(0.5), method="visitor")
    (usual, *_) = read_records(folders[1])
    assert finer.who.code != usual.who.code


def test_a_policy_sees_and_acts_through_wrappers(dataset):
    """Scaled actions and flattened observations give the same run as the environment without wrappers."""
    env = make_env(dataset, sequences=[PLANE])
    wrapped = gymnasium.wrappers.FlattenObservation(
        gymnasium.wrappers.RescaleAction(env, np.float32(-1), np.float32(1))
    )

    def made():
        inner = visit(0.25, 0.75)()
        return lambda seen: 2 * inner(None) - 1 if seen.shape == (16 * 16 + 2,) else None

    (through,) = evaluate_policy(wrapped, made, method="m", code="1")
    (plain,) = evaluate_policy(env, visit(0.25, 0.75), method="m", code="1")
    assert change(through, seconds=0.0) == change(plain, seconds=0.0)


@pytest.mark.parametrize(
    ("policy", "status", "note"),
    [
        (lambda seen: np.zeros(2) / np.array([0, 1]), "failed", "BadInput: the action is"),
        (lambda seen: np.array([1.2, 0.0]), "failed", "[position, stop], both 0 to 1"),
        (lambda seen: np.array([0.5]), "failed", "[position, stop]"),
        (lambda seen: (_ for _ in ()).throw(RuntimeError("two\nlines")), "failed", "RuntimeError: two lines"),
        (lambda seen: sys.exit(3), "failed", "CodeStopped: its code called exit(3)"),
        (lambda seen: "there", "failed", "ValueError: could not convert string to float: 'there'"),
        (lambda seen: np.array([0.5, 0.0]), "failed", "the budget of 800 frames was spent"),
        (lambda seen: None, "abstained", ""),
    ],
)
def test_a_policy_that_breaks_fails_and_one_that_abstains_abstains(dataset, policy, status, note):
    with np.errstate(invalid="ignore"):
        (record,) = evaluate_policy(make_env(dataset, sequences=[PLANE]), lambda: policy, method="m", code="1")
    assert record.judgement.status == status
    assert note in record.judgement.note
    assert record.judgement.position is None


def test_an_interrupt_of_a_policy_ends_the_evaluation_and_an_exit_or_a_wrapper_fails(dataset):
    env = make_env(dataset, sequences=[PLANE])

    def interrupt(seen):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate_policy(env, lambda: interrupt, method="m", code="1")
    (record,) = evaluate_policy(env, lambda: sys.exit("gone"), method="m", code="1")
    assert (record.judgement.status, record.judgement.note) == ("failed", "CodeStopped: its code called exit('gone')")
    limited = gymnasium.wrappers.TimeLimit(env, 2)
    (record,) = evaluate_policy(limited, lambda: lambda seen: np.array([0.5, 0.0]), method="m", code="1")
    assert record.judgement.note == "a wrapper of the environment ended the episode"


class Torn(SceneLight):
    """Light whose disk fails after the first readouts."""

    def weighted(self, span, lens):
        if span.begin >= STILL:
            raise BadInput("is cut short", where="a.exr")
        return super().weighted(span, lens)


def test_stacks_that_cannot_be_read_are_no_fault_of_a_policy(dataset):
    env = make_env(dataset, sequences=[PLANE])
    sequence = load(env)
    torn = replace(sequence, light=Torn(sequence.light.source, sequence.light.gain))
    env.load_sequence = lambda task: torn
    with pytest.raises(BadInput, match=r"a\.exr: is cut short"):
        evaluate_policy(env, visit(0.5), method="m", code="1")


def test_without_gymnasium_one_line_says_what_to_install():
    code = (
        "import sys\n"
        "sys.modules['gymnasium'] = None\n"
        "from saf_gen.errors import BadInput\n"
        "try: import saf_gen.benchmark.gym\n"
        "except BadInput as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "saf_gen.benchmark.gym needs the package gymnasium; pip install 'saf-gen[gym]'\n"


@pytest.mark.parametrize(
    ("more", "reset", "words"),
    [
        ({"sequences": ["plane-constant-01"]}, {}, f"'plane-constant-01' | {PLANE}"),
        ({"sequences": []}, {}, "sequences are [] | at least one id"),
        ({"sequences": PLANE}, {}, f"sequences are {PLANE!r} | a list"),
        ({"split": "train"}, {}, "split 'train' | test"),
        ({"region": "whole"}, {}, "region 'whole' | half, inside, shifted, target"),
        ({"control_s": 0.0}, {}, "0 s | above 0"),
        ({"pixels": 2.5}, {}, "pixels is 2.5 | whole number, 1 to 1024"),
        ({"threads": 0}, {}, "threads is 0 | 1 or more"),
        ({"render_mode": "human"}, {}, "'human' | rgb_array"),
        ({}, {"options": {"sequence": "x"}}, f"'x' | {PLANE}"),
        ({}, {"options": {"scene": "plane"}}, "'scene' | sequence"),
        ({"control_s": 0.03}, {}, "30 ms, the budget 40 ms | half the budget"),
        ({"protocol": ClosedLoopProtocol(PROTOCOL.actuator, budget_s=30.0)}, {}, "30000 ms | 20000 ms"),
    ],
)
def test_an_environment_or_an_episode_that_cannot_be_is_refused(dataset, more, reset, words):
    assert_says(refusal(lambda: make_env(dataset, **more).reset(seed=1, **reset)), words)


def test_a_policy_run_that_cannot_be_is_refused(dataset):
    env = make_env(dataset, sequences=[PLANE])
    policy = visit(0.5)
    assert "'my policy'" in refusal(evaluate_policy, env, policy, method="my policy").problem
    other = gymnasium.make("CartPole-v1")
    assert "AutofocusEnv" in refusal(evaluate_policy, other, policy, method="m").allowed
    policy.__module__ = "typed_in"
    assert "code='1'" in refusal(evaluate_policy, env, policy, method="m").hint


def test_there_is_no_judgement_before_the_end(dataset):
    env = make_env(dataset)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.array([0.5, 0.0], np.float32))
    env.reset(seed=1)
    assert "is not over" in refusal(env.episode.judge).problem
