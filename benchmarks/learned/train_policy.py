"""Trains the policy of policy.py in the Gymnasium environment, by proximal policy optimisation (PPO).

    saf-gen generate recipes/learned.yaml
    python benchmarks/learned/train_policy.py datasets/learned

One policy per seed learns on sequences of the split ``train``. The seed with the most successes on ``validation`` is
kept. Writes policy.onnx, .csv and .png, and the figures of the card policy.md, to ``--out``. It needs
``pip install 'saf-gen[train]'``.
"""

from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import gymnasium
import numpy as np
import policy as method
from training import (
    PROTOCOL,
    Keeper,
    Trained,
    check_dataset,
    choose,
    describe_splits,
    describe_training,
    export,
    fill_card,
    format_table,
    judge,
    parse_options,
    run,
    write_curves,
)

from saf_gen.benchmark.gym import AutofocusEnv
from saf_gen.benchmark.tracks.closed_loop_sequence import ClosedLoopSequence
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask
from saf_gen.benchmark.view.captured_frames import rows_in_method_view
from saf_gen.core import seeds
from saf_gen.stream.manifest import read_manifest

NAME = "policy"
MEASURE = "structure_calibrated"
RIVALS = "golden_section", "hill_climb", "photon_aware"
ROWS, COLUMNS = 48, 200
"""The middle of the box, which is all that a training episode looks at: a step then takes a quarter of the time."""
PER_SCENE = 2
"""Sequences of each scene that a seed learns on: they stay in memory together, with new noise in each episode."""
STEPS_PER_EPOCH, WIDTH = 1024, 64
TIME, TURN, BLUR = 0.3, 0.1, 0.3
"""Cost of the whole budget, of each reversal beyond the second, and of an answer one depth of focus away or more."""


class CroppedEnv(AutofocusEnv):
    """The environment with the middle of each sequence's box."""

    def load_sequence(self, task: SequenceTask) -> ClosedLoopSequence:
        kept = task.id in self._sequences
        found = super().load_sequence(task)
        if not kept:
            box = _crop(found.box[0], ROWS), _crop(found.box[1], COLUMNS)
            charge_source = found.capture.open_charge_source(rows_in_method_view(found.capture, box))
            self._sequences[task.id] = found = replace(found, box=box, charge_source=charge_source)
        return found


class PolicyView(gymnasium.Wrapper[np.ndarray, int, dict[str, Any], np.ndarray]):
    """The environment as the policy sees it: what an Explorer describes, its nine actions, and a shaped reward.

    With ``varied``, each episode moves the ends of the travel in at random, with the focus and the start between them,
    and may turn left and right about: else the policy learns by heart where in its travel each scene has its focus.
    The reward is the environment's, less the costs TIME, TURN and BLUR.
    """

    def __init__(self, env: AutofocusEnv, *, varied: bool, seed: int = 0) -> None:
        super().__init__(env)
        self._inner, self._varied = env, varied
        self._random = seeds.make_generator(NAME, "ends", seed)
        self.observation_space = gymnasium.spaces.Box(-2, 2, (method.FEATURES,), np.float32)
        self.action_space = gymnasium.spaces.Discrete(method.ACTIONS)
        self.explorer = method.Explorer()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, Any]:
        seen, info = self._inner.reset(seed=seed, options=options)
        ends, mirrored = (0.0, 1.0), False
        if self._varied:
            (task,) = (task for task in self._inner.tasks if task.id == info["sequence"])
            lens, truth = float(seen["lens"][0]), self._inner.load_sequence(task).capture.truth.position
            least, most = min(lens, truth), max(lens, truth)
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
    """Return the middle of a span, at most so long."""
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
    """Return the environment of a seed's sequences of a split, all of which stay in memory."""
    chosen = choose_sequences(dataset, split, seed=seed)
    more = {"protocol": PROTOCOL, "control_s": method.PERIOD_S, "pixels": 1, "threads": 1}
    env = CroppedEnv(dataset, sequences=chosen, keep=len(chosen), **more)
    return PolicyView(env, varied=varied, seed=seed)


def run_episodes(network: Any, env: PolicyView) -> list[float]:
    """Return the reward of an episode on each sequence, with the network's likeliest actions."""
    import torch

    rewards = []
    for task in env.unwrapped.tasks:
        seen, _ = env.reset(options={"sequence": task.id})
        total, over = 0.0, False
        while not over:
            with torch.inference_mode():
                action = int(network(torch.from_numpy(seen)[None]).argmax())
            seen, reward, terminated, truncated, _ = env.step(action)
            total, over = total + reward, terminated or truncated
        rewards.append(total)
    return rewards


def train(dataset: Path, *, seed: int, epochs: int) -> Trained:
    """Return the policy of a seed, with 1 − reward of an episode on both splits after each epoch of STEPS_PER_EPOCH."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from torch import nn

    keeper, rows = Keeper(), []
    held_out = make_environment(dataset, "validation", seed=0, varied=False)

    class Look(BaseCallback):
        """Looks at both splits after each epoch, and keeps the network with the least loss on validation."""

        def _on_step(self) -> bool:
            return True

        def _on_rollout_start(self) -> None:
            if self.num_timesteps:
                look(self.model)

    def look(model: Any) -> None:
        policy = model.policy
        network = nn.Sequential(policy.mlp_extractor.policy_net, policy.action_net)
        learned = 1 - float(np.mean([episode["r"] for episode in model.ep_info_buffer]))
        judged = 1 - float(np.mean(run_episodes(network, held_out)))
        rows.append({"epoch": len(rows) + 1, "train": learned, "validation": judged})
        keeper.look(network, judged)
        print(f"seed {seed}  epoch {len(rows)}  train {learned:.4f}  validation {judged:.4f}", flush=True)

    model = PPO(
        "MlpPolicy",
        make_environment(dataset, "train", seed=seed, varied=True),
        learning_rate=7e-4,
        n_steps=STEPS_PER_EPOCH,
        batch_size=min(128, STEPS_PER_EPOCH),
        n_epochs=6,
        gamma=0.99,
        ent_coef=0.01,
        policy_kwargs={"net_arch": [WIDTH, WIDTH]},
        seed=seed,
        stats_window_size=50,
        device="cpu",
    )
    model.learn(epochs * STEPS_PER_EPOCH, callback=Look())
    look(model)
    return Trained(seed, keeper.network, rows)


def main() -> None:
    options = parse_options(__doc__, epochs=24)
    check_dataset(options.dataset, "torch", "onnxscript", "stable_baselines3")
    import torch

    torch.set_num_threads(1)
    out, begin = options.out, process_time()
    trained = [train(options.dataset, seed=seed, epochs=options.epochs) for seed in options.seeds]
    train_s = process_time() - begin
    write_curves(out, NAME, trained, what="1 − reward of an episode", splits=("train", "validation"))
    path = f"{Path(method.__file__).resolve()}:Policy"
    names, files = {}, {}
    for each in trained:
        file = out.resolve() / f"{NAME}-{each.seed}.onnx"
        export(each.network, file, inputs={"seen": (method.FEATURES,)}, outputs=["worth"])
        spec = f"{MEASURE}+{path}:weights={file}"
        names[spec], files[spec] = f"seed {each.seed}", file
    found = judge(options.dataset, [*names, *(f"{MEASURE}+{rival}" for rival in RIVALS)], protocol=PROTOCOL)
    best, chosen = choose(found, dict(zip(names, trained, strict=True)))
    files.pop(best).replace(out / f"{NAME}.onnx")
    for file in files.values():
        file.unlink()
    weights = sum(p.numel() for p in chosen.network.parameters())
    fill_card(
        out / f"{NAME}.md",
        data=describe_splits(options.dataset),
        training=describe_training(options, chosen, weights=weights, read_s=0.0, train_s=train_s),
        figures=format_table(found, names),
    )


if __name__ == "__main__":
    run(main, f"train_{NAME}")
