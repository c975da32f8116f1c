"""Train the policy of policy.py in the Gymnasium environment by proximal policy optimisation (PPO).

    saf-gen generate recipes/learned.yaml
    python studies/learned/train_policy.py datasets/learned

One policy per seed is trained on sequences of the split ``train``: first it imitates a climber, which is defined here,
and then it learns from rewards. The seed with the most successes on ``validation`` is kept. The script writes
policy.onnx, .csv and .png, and the figures of the card policy.md, to ``--out``. It needs
``pip install 'saf-gen[train]'``.
"""

import math
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import gymnasium
import numpy as np
import policy as method
from training import PROTOCOL, Trained, check_options, keep_best, parse_options, run, write_curves

from saf_gen.benchmark.gym import AutofocusEnv
from saf_gen.benchmark.tracks.closed_loop import ClosedLoopSequence
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.core import seeds
from saf_gen.stream.manifest import read_manifest

NAME = "policy"
MEASURE = "structure_calibrated"
RIVALS = "golden_section", "hill_climb", "photon_aware"
ROWS, COLUMNS, SMALLEST = 48, 200, 0.35
"""Size of the middle of the box, in pixels, that training uses; an episode may use only SMALLEST of each side."""
PER_SCENE = 8
"""Sequences of each scene on which a seed is trained; all stay in memory, with new noise in each episode."""
STEPS_PER_EPOCH, WIDTH = 2048, 64
CLONED, ROUNDS, DETOURS, PASSES = 2048, 4, 0.1, 60
"""Imitation: steps of a round, number of rounds, fraction of random actions, and passes over the data per round."""
LOOKS = 24
"""Episodes of validation after each epoch, which are the same each time."""
DISCOUNT = 0.995
TIME, TURN, BLUR = 0.1, 0.05, 1.0
"""Cost of the full budget, of each reversal beyond the second, and of an answer one depth of focus away or more."""


class CroppedEnv(AutofocusEnv):
    """The environment, limited to the middle of each sequence's box.

    With ``varied``, the size of the box is random, with a seed from the sequence's id. A smaller box has noisier
    scores; a policy that was trained on many of them answers only if it can be sure.
    """

    def __init__(self, dataset: Path, *, varied: bool, **more: Any) -> None:
        super().__init__(dataset, **more)
        self._varied = varied

    def load_sequence(self, task: SequenceTask) -> ClosedLoopSequence:
        kept = task.id in self._sequences
        found = super().load_sequence(task)
        if not kept:
            size = seeds.make_generator(NAME, "box", task.id).uniform(SMALLEST, 1) if self._varied else 1.0
            box = _crop(found.box[0], round(size * ROWS)), _crop(found.box[1], round(size * COLUMNS))
            charge_source = found.capture.open_charge_source(found.capture.encoder_rows(box))
            self._sequences[task.id] = found = replace(found, box=box, charge_source=charge_source)
        return found


class PolicyView(gymnasium.Wrapper[np.ndarray, int, dict[str, Any], np.ndarray]):
    """The environment as the policy sees it: the description of an Explorer, nine actions, and a shaped reward.

    With ``varied``, each episode moves the ends of the travel inwards at random, with the focus and the start between
    them, and may exchange the two directions; otherwise the policy would memorise the focus position of each scene. The
    reward is that of the environment, minus the costs TIME, TURN and BLUR.
    """

    def __init__(self, env: AutofocusEnv, *, varied: bool, seed: int = 0) -> None:
        super().__init__(env)
        self._inner, self._varied = env, varied
        self._random = seeds.make_generator(NAME, "ends", seed)
        self.observation_space = gymnasium.spaces.Box(-2, 2, (method.FEATURES,), np.float32)
        self.action_space = gymnasium.spaces.Discrete(method.ACTIONS)
        self.explorer, self.truth, self.depth = method.Explorer(), math.nan, math.nan

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, Any]:
        seen, info = self._inner.reset(seed=seed, options=options)
        (task,) = (task for task in self._inner.tasks if task.id == info["sequence"])
        truth = self._inner.load_sequence(task).capture.truth
        self.truth, self.depth = truth.position, abs(truth.depth_of_focus[1] - truth.depth_of_focus[0])
        ends, mirrored = (0.0, 1.0), False
        if self._varied:
            lens = float(seen["lens"][0])
            least, most = min(lens, self.truth), max(lens, self.truth)
            drawn = self._random.uniform(size=3)
            ends, mirrored = (float(drawn[0] * least), float(1 - drawn[1] * (1 - most))), bool(drawn[2] < 0.5)
        self.explorer = method.Explorer(ends=ends, mirrored=mirrored)
        return self._see(seen), info

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        before, turns = self.explorer.left, self.explorer.turns
        to, stop = self.explorer.command(int(action))
        seen, reward, terminated, truncated, info = self._inner.step(np.array([to, stop], np.float32))
        left = float(seen["left"][0])
        reward -= TIME * (before - left) + TURN * (self.explorer.turns - turns) * (self.explorer.turns > 2)
        if terminated:
            reward -= BLUR * min(abs(info["error_dof"] or 0.0), 1.0)
            return self.explorer.describe(), reward, True, False, info
        return self._see(seen), reward, terminated, truncated, info

    def _see(self, seen: dict[str, np.ndarray]) -> np.ndarray:
        scores = self._inner.episode.score(MEASURE), self._inner.episode.score(method.SECOND)
        lens, left, light = (float(seen[key].mean()) for key in ("lens", "left", "image"))
        self.explorer.look(lens, left=left, light=light, scores=scores)
        return self.explorer.describe()


def _crop(span: slice, most: int) -> slice:
    """Return the middle of a span, at most ``most`` long."""
    begin = span.start + max(span.stop - span.start - most, 0) // 2
    return slice(begin, min(begin + most, span.stop))


def choose_sequences(dataset: Path, split: str, *, seed: int) -> list[str]:
    """Return the ids of PER_SCENE sequences of each scene of a split, drawn at random."""
    drawn = seeds.make_generator(NAME, "sequences", seed)
    entries = [entry for entry in read_manifest(dataset).sequences if entry.split == split]
    ids: dict[str, list[str]] = {}
    for number in drawn.permutation(len(entries)):
        ids.setdefault(entries[int(number)].scene, []).append(entries[int(number)].id)
    return sorted(name for names in ids.values() for name in names[:PER_SCENE])


def make_environment(dataset: Path, split: str, *, seed: int, varied: bool) -> PolicyView:
    """Return the environment with the sequences of a split for a seed, all of which stay in memory."""
    chosen = choose_sequences(dataset, split, seed=seed)
    more = {"protocol": PROTOCOL, "control_s": method.PERIOD_S, "pixels": 1, "threads": 1}
    env = CroppedEnv(dataset, varied=varied, sequences=chosen, keep=len(chosen), **more)
    return PolicyView(env, varied=varied, seed=seed)


def choose_climbing_action(explorer: method.Explorer, *, truth: float, depth: float) -> int:
    """Return the action, 0 to ACTIONS − 1, of a climber that knows the focus and the depth of focus, in travels.

    It steps until it has been 0.05 beyond the focus on both sides, or at the end of the travel. Then it goes to the
    peak, waits there, and answers if the peak is at the focus; otherwise it looks at the focus.
    """
    places, peak = explorer.list_scores()[0], explorer.find_peak()
    edges = (1, places[-1], explorer.ends[1]), (-1, places[0], explorer.ends[0])
    undone = [side for side, edge, end in edges if side * (edge - truth) < 0.05 and side * (end - edge) >= 0.025]
    if undone:
        farther = 1 if explorer.ends[1] - explorer.here > explorer.here - explorer.ends[0] else -1
        side = explorer.direction or farther
        side = side if side in undone else undone[0]
        lead = side * (explorer.target - explorer.here)
        is_far = lead < 0.05 and abs(explorer.here - truth) > 0.25
        return 2 if lead > 0.14 else explorer.find_step(2 if is_far else 1, side)
    if abs(peak - truth) > 0.7 * depth:
        away = truth - explorer.target
        return 2 if abs(away) < 0.03 else explorer.find_step(int(abs(away) > 0.04), math.copysign(1, away))
    if abs(explorer.target - peak) > 0.006:
        return 1
    return 2 if abs(explorer.here - explorer.target) > 0.01 or explorer.smear > 0.01 else 0


def clone_climber(model: Any, env: PolicyView, *, seed: int) -> None:
    """Train a PPO model on the actions of the climber and the values of its states, in ROUNDS of CLONED steps.

    The climber acts in the first round, and the network as trained so far in the others, so that it learns to correct
    its errors (DAgger: Ross, Gordon and Bagnell 2011, arXiv:1011.0686).
    """
    import torch

    drawn = seeds.make_generator(NAME, "detours", seed)
    states, actions, worth = [], [], []
    optimiser = torch.optim.Adam(model.policy.parameters(), lr=1e-3)
    seen, _ = env.reset(seed=1000 + seed)
    for number in range(ROUNDS):
        rewards, until = [], len(states) + CLONED
        while len(states) < until or rewards:
            states.append(seen)
            actions.append(choose_climbing_action(env.explorer, truth=env.truth, depth=env.depth))
            action = model.predict(seen, deterministic=True)[0] if number else actions[-1]
            detour = drawn.uniform() < DETOURS
            seen, reward, terminated, truncated, _ = env.step(drawn.integers(1, method.ACTIONS) if detour else action)
            rewards.append(reward)
            if terminated or truncated:
                worth.extend(DISCOUNT ** np.arange(len(rewards) - k) @ rewards[k:] for k in range(len(rewards)))
                rewards = []
                seen, _ = env.reset()
        given = [torch.as_tensor(np.array(each)) for each in (states, actions, np.float32(worth))]
        for _ in range(PASSES):
            for part in torch.from_numpy(drawn.permutation(len(states))).split(128):
                batch, done, value = (each[part] for each in given)
                found, chance, _ = model.policy.evaluate_actions(batch, done)
                loss = -chance.mean() + 0.5 * ((found[:, 0] - value) ** 2).mean()
                optimiser.zero_grad()
                loss.backward()
                optimiser.step()


def run_episodes(network: Any, env: PolicyView) -> tuple[float, float]:
    """Return 1 − the mean reward, and the success rate, of LOOKS episodes with the most likely actions."""
    import torch

    rewards, right = [], []
    for number in range(LOOKS):
        seen, _ = env.reset(seed=0 if number == 0 else None)
        total, over = 0.0, False
        while not over:
            with torch.inference_mode():
                action = int(network(torch.from_numpy(seen)[None]).argmax())
            seen, reward, terminated, truncated, info = env.step(action)
            total, over = total + reward, terminated or truncated
        rewards.append(total)
        right.append(bool(info["success_1dof"]))
    return 1 - float(np.mean(rewards)), float(np.mean(right))


def train(dataset: Path, *, seed: int, epochs: int) -> Trained:
    """Return the policy of a seed, with 1 − reward per episode on both splits after each epoch of STEPS_PER_EPOCH.

    Epoch 0 is the state after imitation of the climber. The last epoch is kept, because the smallest loss over a few
    episodes would be chance.
    """
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from torch import nn

    rows: list[dict[str, float]] = []
    held_out = make_environment(dataset, "validation", seed=0, varied=False)
    env = make_environment(dataset, "train", seed=seed, varied=True)
    model = PPO(
        "MlpPolicy",
        env,
        learning_rate=lambda left: 4e-4 * left,
        n_steps=STEPS_PER_EPOCH,
        batch_size=min(128, STEPS_PER_EPOCH),
        n_epochs=10,
        gamma=DISCOUNT,
        ent_coef=0.001,
        policy_kwargs={"net_arch": [WIDTH, WIDTH]},
        seed=seed,
        stats_window_size=100,
        device="cpu",
    )
    network = nn.Sequential(model.policy.mlp_extractor.policy_net, model.policy.action_net)

    class Look(BaseCallback):
        """Evaluates both splits after each epoch."""

        def _on_step(self) -> bool:
            return True

        def _on_rollout_start(self) -> None:
            if self.num_timesteps:
                look(1 - float(np.mean([episode["r"] for episode in model.ep_info_buffer])))

    def look(learned: float) -> None:
        judged, right = run_episodes(network, held_out)
        rows.append({"epoch": len(rows), "train": learned, "validation": judged, "validation_within_1dof": right})
        print(f"seed {seed}  {'  '.join(f'{key} {value:.4g}' for key, value in rows[-1].items())}", flush=True)

    clone_climber(model, env, seed=seed)
    look(run_episodes(network, env)[0])
    model.learn(epochs * STEPS_PER_EPOCH, callback=Look())
    look(1 - float(np.mean([episode["r"] for episode in model.ep_info_buffer])))
    return Trained(seed, network, rows, is_last=True)


def main() -> None:
    options = parse_options(__doc__, epochs=20)
    check_options(options, "torch", "onnxscript", "stable_baselines3")
    import torch

    torch.set_num_threads(1)
    begin = process_time()
    trained = [train(options.dataset, seed=seed, epochs=options.epochs) for seed in options.seeds]
    train_s = process_time() - begin
    write_curves(options.out, NAME, trained, what="1 − reward of an episode", splits=("train", "validation"))
    keep_best(
        options,
        trained,
        method=f"{MEASURE}+{Path(method.__file__).resolve()}:Policy",
        inputs={"seen": (method.FEATURES,)},
        outputs=["worth"],
        rivals=[f"{MEASURE}+{rival}" for rival in RIVALS],
        protocol=PROTOCOL,
        train_s=train_s,
    )


if __name__ == "__main__":
    run(main, f"train_{NAME}")
