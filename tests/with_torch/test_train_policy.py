"""The training of the learned policy: it sees and commands the same in the environment and in the evaluation."""

import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest
from small_dataset import HERE

from saf_gen.benchmark.gym import AutofocusEnv
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.tracks.closed_loop_run import run_closed_loop
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.optics.actuators import get_actuator
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.manifest import read_manifest, write_manifest

LEARNED = HERE.parent / "studies" / "learned"
PROTOCOL = ClosedLoopProtocol(get_actuator("voice_coil_hall"), budget_s=0.04, sweep_s=0.02)
PLANE, LAMP = "plane-constant-00", "plane-lamp_only-00"
ACTIONS = 7, 4, 5, 1, 0  # forward, backward, forward, to the peak, answer


@pytest.fixture(scope="module")
def training():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(LEARNED)
        import train_policy

        patch.setattr(train_policy, "PROTOCOL", PROTOCOL)
        for name, small in (("STEPS_PER_EPOCH", 64), ("CLONED", 64), ("ROUNDS", 2), ("PASSES", 2), ("LOOKS", 2)):
            patch.setattr(train_policy, name, small)
        yield train_policy


@pytest.fixture(scope="module")
def dataset(captured_dataset, tmp_path_factory):
    """A copy whose two static sequences are the splits train and validation."""
    folder = tmp_path_factory.mktemp("policy") / "takes"
    shutil.copytree(captured_dataset, folder)
    manifest = read_manifest(folder)
    split = {PLANE: "train", LAMP: "validation"}
    entries = tuple(replace(entry, split=split.get(entry.id, "test")) for entry in manifest.sequences)
    write_manifest(folder, replace(manifest, sequences=entries))
    return folder


def play(env, *actions, **reset):
    """Return the observations before each action and after the last, the rewards, and the last info."""
    seen, rewards = [env.reset(**reset)[0]], []
    for action in actions:
        now, reward, terminated, truncated, info = env.step(action)
        seen.append(now)
        rewards.append(reward)
        if terminated or truncated:
            break
    return seen, rewards, info


class ScriptedNetwork:
    """A network that prefers the given actions one after the other, and keeps its observations."""

    version = ""

    def __init__(self, actions):
        self.actions, self.seen = iter(actions), []

    def __call__(self, seen):
        self.seen.append(seen[0])
        return [np.eye(9)[[next(self.actions)]]]


def test_the_search_sees_and_commands_what_the_environment_showed_and_did(training, dataset, monkeypatch):
    inner = AutofocusEnv(dataset, sequences=[LAMP], protocol=PROTOCOL, control_s=0.005, pixels=1)
    env = training.PolicyView(inner, varied=False)
    shown, _, info = play(env, *ACTIONS, options={"sequence": LAMP})
    network = ScriptedNetwork(ACTIONS)
    monkeypatch.setattr(training.method.Policy, "_network", lambda self: network)
    search = training.method.Policy()
    (task,) = inner.tasks
    sequence = inner.load_sequence(task)
    method = Method("m", get_measure(training.MEASURE), search, "")
    run = run_closed_loop(sequence.make_captured(), method, protocol=PROTOCOL)
    assert run.problem == ""
    assert np.allclose(network.seen, shown[: len(ACTIONS)], atol=1e-5)
    assert run.commanded_positions == inner.episode.run.commanded_positions
    assert run.path[-1] == info["position"]


def explore(training, positions, *, peak, **options):
    explorer = training.method.Explorer(**options)
    for number, position in enumerate(positions):
        middle = (position + positions[max(number - 1, 0)]) / 2  # a window is where the lens was half-way
        score = float(np.exp(-(((middle - peak) / 0.1) ** 2)))
        explorer.look(position, left=1 - 0.03 * (number + 1), light=0.2, scores=(score, 1 + score))
    return explorer


def test_a_network_does_not_see_the_position_in_the_travel_and_directions_are_equivalent(training):
    positions = np.array([0.205, 0.265, 0.325, 0.305])
    here = explore(training, positions, peak=0.3, ends=(0.07, 0.63))
    there = explore(training, positions + 0.3, peak=0.6, ends=(0.37, 0.93))
    turned = explore(training, 1 - positions, peak=0.7, ends=(0.37, 0.93), mirrored=True)
    assert np.ptp(here.describe()) > 1
    assert np.allclose(here.describe(), there.describe(), atol=1e-5)
    assert np.allclose(here.describe(), turned.describe(), atol=1e-5)
    for action in (7, 4, 1, 0):
        to, stop = here.command(action)
        assert there.command(action) == (pytest.approx(to + 0.3, abs=1e-6), stop)
        assert turned.command(action) == (pytest.approx(1 - to, abs=1e-6), stop)
    assert here.turns == turned.turns > 0


def test_the_peak_is_the_top_of_a_parabola_and_the_best_place_where_there_is_none(training):
    assert explore(training, np.arange(0.105, 0.9, 0.05), peak=0.42).find_peak() == pytest.approx(0.42, abs=0.003)
    rising = explore(training, [0.105, 0.205, 0.305], peak=0.9)
    assert rising.find_peak() == pytest.approx(0.255)  # at its last look, not beyond
    dark = training.method.Explorer()
    dark.look(0.3, left=0.9, light=0.0, scores=(0.0, 0.0))
    assert dark.find_peak() == pytest.approx(0.3)
    assert np.isfinite(dark.describe()).all()


@pytest.mark.parametrize(("start", "peak", "mirrored"), [(0.1, 0.5, False), (0.9, 0.5, True), (0.45, 0.3, False)])
def test_the_climber_that_is_cloned_passes_the_peak_to_either_side_and_answers_with_it(training, start, peak, mirrored):
    explorer, here, looks = training.method.Explorer(mirrored=mirrored), start, 0
    while True:
        looks += 1
        before, here = here, here + 0.4 * (explorer.target - here) if looks > 1 else start
        score = float(np.exp(-((((before + here) / 2 - peak) / 0.1) ** 2)))
        explorer.look(here, left=1 - 0.025 * looks, light=0.2, scores=(score, 1 + score))
        action = training.choose_climbing_action(explorer, truth=peak, depth=0.06)
        to, stop = explorer.command(action)
        if stop:
            break
    positions = explorer.list_scores()[0]
    assert action == 0  # voluntarily, with time left
    assert to == pytest.approx(peak, abs=0.01)
    assert positions[0] < peak - 0.05 < peak + 0.05 < positions[-1]
    assert explorer.turns <= 3


def test_the_reward_is_that_of_the_environment_less_time_reversals_and_blur(training, dataset):
    inner = AutofocusEnv(dataset, sequences=[PLANE], protocol=PROTOCOL, pixels=1)
    env = training.PolicyView(inner, varied=False)
    actions = 3, 4, 3, 4, 0
    _, rewards, info = play(env, *actions, options={"sequence": PLANE})
    positions = inner.episode.run.commanded_positions[1:]
    inner.reset(options={"sequence": PLANE})
    plain = 0.0
    for number, position in enumerate(positions):
        now, reward, *_ = inner.step(np.array([position, number == len(positions) - 1], np.float32))
        plain += reward
    spent = 1 - 104 / 800 - float(now["left"][0])
    costs = 0.1 * spent + 0.05 * (env.explorer.turns - 2) + min(abs(info["error_dof"]), 1)
    assert env.explorer.turns > 2
    assert sum(rewards) == pytest.approx(plain - costs, abs=1e-6)


def test_what_cannot_be_trained_on_is_refused_in_one_line(training, captured_dataset, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("training.require_extra", lambda *names, of: None)
    monkeypatch.setattr(sys, "argv", ["train", str(captured_dataset), "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        training.run(training.main, "train_policy")
    assert ended.value.code == 2
    assert "has no split train and validation" in capsys.readouterr().err


@pytest.mark.slow  # four trainings, an export and an evaluation; importing torch takes seconds
def test_a_small_run_writes_weights_that_the_method_runs(training, dataset, tmp_path, monkeypatch):
    for package in ("torch", "stable_baselines3", "onnxscript", "onnxruntime"):
        pytest.importorskip(package, reason="the extra train is not installed")
    monkeypatch.setattr(sys, "argv", ["train", str(dataset), "--out", str(tmp_path), "--epochs", "1", "--seeds", "0"])
    training.main()
    assert {path.name for path in tmp_path.iterdir()} == {f"policy.{end}" for end in ("csv", "md", "onnx", "png")}
    card = (tmp_path / "policy.md").read_text()
    curve = (tmp_path / "policy.csv").read_text().splitlines()
    assert [line[:4] for line in curve[1:]] == ["0,0,", "0,1,"]  # cloning the climber, and one epoch of rewards
    assert "Seed 0 has the most successes" in card
    assert f"(loss {float(curve[-1].split(',')[3]):.3f})" in card  # of the last epoch, which is kept
    assert "| seed 0 |" in card
    first = training.train(dataset, seed=1, epochs=1).rows
    assert first == training.train(dataset, seed=1, epochs=1).rows != training.train(dataset, seed=2, epochs=1).rows
