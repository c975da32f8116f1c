"""Autofocus in the closed loop as a Gymnasium environment."""

import math
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from saf_gen.benchmark.gym.episode import Episode, draw_observation
from saf_gen.benchmark.tracks.closed_loop import ClosedLoopSequence
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.tracks.tasks import SequenceTask, select_sequences_to_evaluate
from saf_gen.core import seeds
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, unknown
from saf_gen.optics.actuators import get_actuator
from saf_gen.stream.manifest import ALL_SPLITS, check_single_split
from saf_gen.stream.stream_file import open_stream

ENVIRONMENT_ID = "saf_gen/Autofocus-v0"
MAX_PIXELS = 1024


class AutofocusEnv(gymnasium.Env[dict[str, Any], np.ndarray]):
    """A Gymnasium environment in which a policy moves the lens of a running spike camera until it is in focus.

    Its reward is computed from the true focus, which the environment holds in the process of the policy: code of others
    could read it there.

    Parameters
    ----------
    dataset : str or Path
        Dataset folder, or one of its streams; its focal stacks must hold every lens position.
    split : str, optional
        Split of the sequences to use, or ``all``. A dataset with several splits needs it, unless ``sequences`` are
        given, so that a policy does not learn on the test split by mistake.
    sequences : sequence of str, optional
        Ids of the sequences to use; by default all.
    protocol : ClosedLoopProtocol, optional
        Actuator and budget; by default a voice coil, and the longest time that can be captured.
    region : str, default 'target'
        Where the policy looks: ``target``, the box around the target, ``inside``, a rectangle within the target, or
        ``frame``.
    control_s : float, default 0.005
        Control period in seconds, rounded up to whole packets of 8 readouts.
    pixels : int, default 64
        Rows and columns of the observed image, 1 to 1024.
    keep : int, default 4
        Number of sequences that stay in memory, each with its focal stacks (1 GiB at most).
    threads : int, optional
        Number of threads that encode; by default one per core.
    render_mode : str, optional
        ``rgb_array``, or None.

    Raises
    ------
    BadInput
        If the dataset, the split or a sequence does not exist, if the dataset has several splits and neither a split
        nor sequences are given, or if another parameter is not allowed. ``reset`` raises it if the protocol does not
        suit the recording.

    Notes
    -----
    An observation describes the last control period:

    - ``image``, float32 (pixels, pixels), 0...1: counts per pixel and frame, averaged over equal areas of the box,
      whatever its shape.
    - ``lens``, float32 (1,), 0...1: the last reading of the position sensor, clipped to the travel.
    - ``left``, float32 (1,), 0...1: the fraction of the budget that is left.

    An action is ``[position, stop]``, float32 (2,), 0...1. The lens moves to ``position``; if ``stop`` is above 0.5,
    ``position`` is the answer.

    The reward of a step is minus the mean error of the lens during the step, in travels, times the fraction of the
    budget that the step took. An answer also costs its error times the fraction of the budget that is left, and earns
    1 if it is within one depth of focus. Errors are 0 if the truth is unknown.

    An episode is ``terminated`` by an answer, once the lens has settled, or ``truncated`` when the budget is spent,
    which the benchmark counts as a failure.

    The info has ``sequence`` and ``seconds`` (the time that has passed) and, at the end, ``status``, ``position``,
    ``truth``, ``error`` and ``error_dof`` of the :class:`saf_gen.benchmark.records.Judgement`.

    ``reset(seed=n)`` draws the sequence, the initial lens position and the noise of camera and lens; n and the number
    of episodes since then determine them. ``reset(options={"sequence": ID})`` uses that sequence, and the initial
    position and noise of the benchmark.
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
        _check_integer("pixels", pixels, highest=MAX_PIXELS)
        _check_integer("keep", keep)
        if threads is not None:
            _check_integer("threads", threads)
        self.tasks = _select_tasks(_list_tasks(Path(dataset), split, are_named=sequences is not None), sequences)
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
        self._max_sequences, self._threads = keep, threads
        self._sequences: OrderedDict[str, ClosedLoopSequence] = OrderedDict()
        self._episodes = 0
        self._task: SequenceTask | None = None
        self._episode: Episode | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without sequences and episode, so that a copy reads sequences again and needs ``reset``."""
        return {**self.__dict__, "_sequences": OrderedDict(), "_episode": None}

    @property
    def parameters(self) -> str:
        """All parameters that determine the observations, on one line, for records."""
        return f"images of {self.pixels}×{self.pixels}, every {self.control_s * 1e3:g} ms"

    def load_sequence(self, task: SequenceTask) -> ClosedLoopSequence:
        """Return a sequence that is ready to be captured, from memory if it is among the last ``keep`` used."""
        if task.id not in self._sequences:
            with open_stream(task.path) as stream:
                found = ClosedLoopSequence.from_stream(task, stream, region=self.region, protocol=self.protocol)
            while len(self._sequences) >= self._max_sequences:
                self._sequences.popitem(last=False)
            self._sequences[task.id] = found
        self._sequences.move_to_end(task.id)
        return self._sequences[task.id]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start an episode, let one control period pass with the lens at rest, and return observation and info.

        The docstring of the class describes ``seed`` and ``options``.
        """
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
        """Run one control period, or answer, and return observation, reward, terminated, truncated and info.

        Raises BadInput if the action is outside its space, and ResetNeeded if the episode is over.
        """
        episode = self.episode
        if episode.run is not None:
            raise gymnasium.error.ResetNeeded("the episode is over: call reset")
        position, stop = _check_action(action)
        observation, reward = episode.stop(position) if stop > 0.5 else episode.move(position)
        over = episode.run is not None
        return observation, reward, over and stop > 0.5, over and stop <= 0.5, self._make_info()

    @property
    def episode(self) -> Episode:
        """The current or last episode. Raises ResetNeeded before the first ``reset``."""
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("there is no episode yet: call reset")
        return self._episode

    def render(self) -> np.ndarray | None:
        """Return the box in the last control period as an image, uint8 (h, w, 3), if the render mode is ``rgb_array``.

        See draw_observation for the grey values.
        """
        return draw_observation(self.episode.rate) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Release the sequences in memory; streams need no closing, since they are open only while they are read."""
        self._sequences.clear()
        self._episode = None

    def _make_info(self) -> dict[str, Any]:
        episode = self.episode
        info: dict[str, Any] = {"sequence": self._task.id if self._task else "", "seconds": episode.seconds}
        if episode.run is None:
            return info
        judgement = episode.judge()
        return info | {key: getattr(judgement, key) for key in ("status", "position", "truth", "error", "error_dof")}


def _list_tasks(dataset: Path, split: str | None, *, are_named: bool) -> list[SequenceTask]:
    """Return the sequences of a split, or of all splits if there is one only or ``are_named``."""
    tasks = select_sequences_to_evaluate(dataset, split=ALL_SPLITS if split is None else split).tasks
    if split is None and not are_named:
        check_single_split(list(dict.fromkeys(str(task.split) for task in tasks)), where=str(dataset))
    return tasks


def _select_tasks(tasks: Sequence[SequenceTask], sequences: Sequence[str] | None) -> list[SequenceTask]:
    known = {task.id: task for task in tasks}
    if sequences is None:
        return list(tasks)
    if isinstance(sequences, str) or not sequences:
        raise BadInput(f"the sequences are {sequences!r}", allowed="a list of at least one id, or None for all")
    for sequence in sequences:
        if sequence not in known:
            raise unknown("sequence", sequence, allowed=known)
    return [known[sequence] for sequence in dict.fromkeys(sequences)]


def _check_action(action: np.ndarray) -> tuple[float, float]:
    values = np.asarray(action, dtype=np.float64)
    if values.shape != (2,) or not ((values >= 0) & (values <= 1)).all():
        raise BadInput(f"the action is {action!r:.60}", allowed="[position, stop], both 0 to 1")
    return float(values[0]), float(values[1])


def _check_integer(name: str, value: int, *, highest: int | None = None) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1 or (highest and value > highest):
        allowed = f"a whole number, 1 to {highest}" if highest else "a whole number, 1 or more"
        raise BadInput(f"{name} is {value!r}", allowed=allowed)
