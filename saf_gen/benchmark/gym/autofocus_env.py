"""Autofocus in the closed loop as a Gymnasium environment."""

import math
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from saf_gen.benchmark.gym.episode import Episode
from saf_gen.benchmark.gym.observation_images import draw_policy_observation
from saf_gen.benchmark.tracks.closed_loop_sequence import ClosedLoopSequence
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.sequence_tasks import SequenceTask, list_sequences_to_evaluate
from saf_gen.core import seeds
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, unknown
from saf_gen.optics.actuators import get_actuator
from saf_gen.stream.stream_file import open_stream

ENVIRONMENT_ID = "saf_gen/Autofocus-v0"
MAX_PIXELS = 1024


class AutofocusEnv(gymnasium.Env[dict[str, Any], np.ndarray]):
    """A policy moves the lens of a running spike camera, and says when it is in focus.

    Parameters
    ----------
    dataset : a dataset folder, or one of its streams; its focal stacks must hold every lens position.
    split, sequences : which of its sequences; None: all.
    protocol : the actuator and the budget; None: a voice coil, and as long as can be captured.
    region : ``target``, the box around the target, or ``frame``.
    control_s : the control period in seconds, rounded up to whole packets of 8 readouts.
    pixels : rows and columns of the observed image, 1 to 1024.
    keep : sequences that stay in memory, each with its focal stacks (1 GiB at most).
    threads : threads that encode; None: one for each core.
    render_mode : ``rgb_array``, or None.

    Raises
    ------
    BadInput : for a dataset, split, sequence, region, period or size that does not exist or is not allowed, and by
        ``reset`` for a protocol that the recording cannot keep.

    Notes
    -----
    Observation, of the last control period:
        ``image`` float32 (pixels, pixels), 0...1: counts per pixel and frame, as means over equal areas of
        the box, whatever its shape; ``lens`` float32 (1,), 0...1: the last reading of the position sensor,
        clipped to the travel; ``left`` float32 (1,), 0...1: the fraction of the budget that is left.
    Action: float32 (2,), 0...1, ``[position, stop]``. The lens moves to ``position``; with ``stop`` above 0.5
        that is the answer.
    Reward: minus the mean error of the lens in a step, in travels, times the fraction of the budget that the
        step took. On an answer, also minus its error times the fraction that is left, and plus 1 within one
        depth of focus. Errors are 0 where the truth is unknown.
    End: ``terminated`` by an answer, when the lens has settled; ``truncated`` when the budget is spent, which
        the benchmark counts as a failure.
    Info: ``sequence`` and ``seconds`` passed; at the end also the result of
        :func:`saf_gen.benchmark.tracks.closed_loop_judgement.judge_closed_loop_run`.

    ``reset(seed=n)`` draws the sequence, the initial lens position and the noise of camera and lens, all
    named by n and by the number of episodes since. ``reset(options={"sequence": ID})`` takes that sequence
    and begins as the benchmark does.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012

    def __init__(
        self,
        dataset: str | Path,
        *,
        split: str | None = None,
        sequences: Sequence[str] | None = None,
        protocol: ClosedLoopProtocol | None = None,
        region: str = "target",
        control_s: float = 0.005,
        pixels: int = 64,
        keep: int = 4,
        threads: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise unknown("render mode", render_mode, allowed=self.metadata["render_modes"])
        if region not in REGIONS:
            raise unknown("region", region, allowed=REGIONS)
        if not (math.isfinite(control_s) and control_s > 0):
            raise BadInput(f"the control period is {control_s:g} s", allowed="seconds, above 0")
        _check_whole("pixels", pixels, highest=MAX_PIXELS)
        _check_whole("keep", keep)
        if threads is not None:
            _check_whole("threads", threads)
        self.tasks = _select_tasks(list_sequences_to_evaluate(Path(dataset), split=split), sequences)
        self.protocol = ClosedLoopProtocol(get_actuator("voice_coil")) if protocol is None else protocol
        self.region, self.control_s, self.pixels = region, control_s, pixels
        self.render_mode = render_mode
        self.observation_space = spaces.Dict(
            {
                "image": spaces.Box(0, 1, (pixels, pixels), np.float32),
                "lens": spaces.Box(0, 1, (1,), np.float32),
                "left": spaces.Box(0, 1, (1,), np.float32),
            }
        )
        self.action_space = spaces.Box(0, 1, (2,), np.float32)
        self._keep, self._threads = keep, threads
        self._sequences: OrderedDict[str, ClosedLoopSequence] = OrderedDict()
        self._episodes = 0
        self._task: SequenceTask | None = None
        self._episode: Episode | None = None

    def __getstate__(self) -> dict[str, Any]:
        """A copy, in this process or another, reads its sequences again and begins with ``reset``."""
        return {**self.__dict__, "_sequences": OrderedDict(), "_episode": None}

    @property
    def parameters(self) -> str:
        """Everything that determines the observations, in one line, for records."""
        return f"images of {self.pixels}×{self.pixels}, every {self.control_s * 1e3:g} ms"

    def load_sequence(self, task: SequenceTask) -> ClosedLoopSequence:
        """Return a sequence ready to be captured, from memory if it is one of the last ``keep``."""
        if task.id not in self._sequences:
            with open_stream(task.path) as stream:
                found = ClosedLoopSequence.from_stream(task, stream, region=self.region)
            while len(self._sequences) >= self._keep:
                self._sequences.popitem(last=False)
            self._sequences[task.id] = found
        self._sequences.move_to_end(task.id)
        return self._sequences[task.id]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode and let one control period pass with the lens at rest; see the class."""
        super().reset(seed=seed)
        self._episodes = 0 if seed is not None else self._episodes + 1
        name = "gym", self.np_random_seed, self._episodes
        options = options or {}
        for key in options:
            if key != "sequence":
                raise unknown("option", key, allowed=["sequence"])
        self._episode = None
        if "sequence" in options:
            (self._task,), noise = _select_tasks(self.tasks, [options["sequence"]]), None
        else:
            self._task = self.tasks[int(seeds.make_generator(*name).integers(len(self.tasks)))]
            noise = seeds.derive_seed(*name, "noise")
        self._episode = Episode(
            self.load_sequence(self._task),
            self.protocol,
            control_s=self.control_s,
            pixels=self.pixels,
            seed=noise,
            threads=self._threads,
        )
        return self._episode.observe(), self._make_info()

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Take one control period, or answer. Raise BadInput for an action outside its space."""
        episode = self.episode
        if episode.run is not None:
            raise gymnasium.error.ResetNeeded("the episode is over: call reset")
        position, stop = _check_action(action)
        observation, reward = episode.stop(position) if stop > 0.5 else episode.move(position)
        over = episode.run is not None
        return observation, reward, over and stop > 0.5, over and stop <= 0.5, self._make_info()

    @property
    def episode(self) -> Episode:
        """The current or last episode. Raises ResetNeeded before the first."""
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("there is no episode yet: call reset")
        return self._episode

    def render(self) -> np.ndarray | None:
        """Return the box in the last control period with ``rgb_array``, uint8 (h, w, 3), by draw_policy_observation."""
        return draw_policy_observation(self.episode.rate) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Release the sequences in memory; streams are open only while they are read."""
        self._sequences.clear()
        self._episode = None

    def _make_info(self) -> dict[str, Any]:
        episode = self.episode
        info: dict[str, Any] = {"sequence": self._task.id if self._task else "", "seconds": episode.seconds}
        return info if episode.run is None else info | episode.judge()


def _select_tasks(tasks: Sequence[SequenceTask], sequences: Sequence[str] | None) -> list[SequenceTask]:
    known = {task.id: task for task in tasks}
    if sequences is None:
        return list(tasks)
    if isinstance(sequences, str) or not sequences:
        raise BadInput(f"sequences are {sequences!r}", allowed="a list of at least one id, or None for all")
    for sequence in sequences:
        if sequence not in known:
            raise unknown("sequence", sequence, allowed=known)
    return [known[sequence] for sequence in dict.fromkeys(sequences)]


def _check_action(action: np.ndarray) -> tuple[float, float]:
    values = np.asarray(action, dtype=np.float64)
    if values.shape != (2,) or not ((values >= 0) & (values <= 1)).all():
        raise BadInput(f"the action is {action!r:.60}", allowed="[position, stop], both 0 to 1")
    return float(values[0]), float(values[1])


def _check_whole(name: str, value: int, *, highest: int | None = None) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1 or (highest and value > highest):
        allowed = f"a whole number, 1 to {highest}" if highest else "a whole number, 1 or more"
        raise BadInput(f"{name} is {value!r}", allowed=allowed)
