"""One episode: a running camera in the hands of a policy, a control period at a time, and what it earns.

It knows nothing of Gymnasium. The camera, the beginning, the end and the verdict are those of the contest.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from saf_gen.benchmark.gym.observation_images import average_areas
from saf_gen.benchmark.tracks.closed_loop_judgement import judge_closed_loop_run
from saf_gen.benchmark.tracks.closed_loop_run import (
    ClosedLoopRun,
    describe_spent_budget,
    finish_run,
    start_camera,
)
from saf_gen.benchmark.tracks.closed_loop_sequence import ClosedLoopSequence
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.running_camera import PACKET_FRAMES
from saf_gen.errors import BadInput
from saf_gen.parts import Answer

__all__ = ["FOCUS_BONUS", "Episode"]

FOCUS_BONUS = 1.0
"""For a lens that ends within one depth of focus: as much as errors can cost in all, within the travel."""


class Episode:
    """A camera that runs, the lens at rest.

    Parameters
    ----------
    setting, protocol : what is filmed, and what moves the lens for how long.
    control_s : a control period, seconds; it is rounded up to whole packets of the camera.
    pixels : rows and columns of what a policy sees.
    seed : names the start place and the noise; None: those of the contest.

    ``run`` is None until the episode is over. Raises BadInput for a budget of less than two control periods.
    """

    def __init__(
        self,
        setting: ClosedLoopSequence,
        protocol: ClosedLoopProtocol,
        *,
        control_s: float,
        pixels: int,
        seed: int | None = None,
    ) -> None:
        capture = setting.capture if seed is None else replace(setting.capture, seed=seed)
        self._live = start_camera(
            capture, _no_score, protocol=protocol, charge_source=setting.charge_source, region=setting.box
        )
        self._truth, self._hz, self._pixels = capture.truth, capture.sensor.readout_hz, pixels
        self._budget = protocol.count_frames(capture)[0]
        self.period = max(-(-round(control_s * self._hz) // PACKET_FRAMES), 1) * PACKET_FRAMES
        if self._live.frames < 2 * self.period:
            raise BadInput(
                f"a control period of {control_s * 1e3:g} ms, "
                f"with a budget of {self._budget / self._hz * 1e3:g} ms",
                allowed="half the budget at most",
            )
        track = self._truth.track
        frames = self._live.frames
        self._best = np.full(frames, self._truth.position) if track is None else track[:frames]
        self.rate = np.zeros((0, 0))
        """(h, w) counts a pixel and frame of the last control period, in the whole box."""
        self.observations = 0
        self.run: ClosedLoopRun | None = None

    @property
    def seconds(self) -> float:
        """Time that has passed."""
        return self._live.now / self._hz

    def look(self) -> dict[str, np.ndarray]:
        """Let a control period pass, or what is left of the budget: the observation."""
        self._live.wait(min(self.period, self._live.frames - self._live.now))
        self.observations += 1
        return self._seen()

    def move(self, place: float) -> tuple[dict[str, np.ndarray], float]:
        """Send the lens to a place: what is seen in the next period, and the reward.

        Where no time is left then, it is over, without an answer. Raises BadInput outside the travel.
        """
        begin = self._live.now
        self._live.move(place)
        seen = self.look()
        if self._live.now == self._live.frames:
            self.fail(describe_spent_budget(self._budget))
        return seen, -self._missed(begin)

    def stop(self, place: float) -> tuple[dict[str, np.ndarray], float]:
        """Answer with a place: the lens goes there and settles. What is seen at the end, and the reward.

        The last error stands for the time that is left, so that an early stop is not a cheap one. Raises
        BadInput outside the travel.
        """
        begin = self._live.now
        trace = tuple(self._live.commanded_positions[1:])
        self.run = finish_run(self._live, Answer(trace=trace, position=place), to=place, budget=self._budget)
        verdict = self.judge()
        left = 1 - self._live.now / self._live.frames
        bonus = FOCUS_BONUS if verdict["success_1dof"] else 0.0
        return self._seen(), bonus - self._missed(begin) - left * abs(verdict.get("error") or 0.0)

    def abstain(self) -> None:
        """End it with the answer that no place can be told."""
        self.run = finish_run(
            self._live, Answer(trace=tuple(self._live.commanded_positions[1:])), to=None, budget=self._budget
        )

    def fail(self, problem: str) -> None:
        """End it without an answer."""
        self.run = finish_run(self._live, Answer(), to=None, budget=self._budget, problem=problem)

    def judge(self) -> dict[str, Any]:
        """How the run that is over is judged: truth, error, success. None is unknown."""
        if self.run is None:
            raise BadInput("the episode is still going on", hint="stop it, or let its time run out")
        return judge_closed_loop_run(self.run, self._truth, readout_hz=self._hz)

    def _seen(self) -> dict[str, np.ndarray]:
        """What a policy is told. An image needs a whole period: it reaches back where the last was cut."""
        live = self._live
        first = live.now - self.period
        counts = live.run_until(first, live.now).window(first, live.now)
        self.rate = counts / self.period
        read = min(max(live.position(live.now - 1), 0.0), 1.0)
        return {
            "image": (average_areas(counts, self._pixels, self._pixels) / self.period).astype(np.float32),
            "lens": np.array([read], np.float32),
            "left": np.array([1 - live.now / live.frames], np.float32),
        }

    def _missed(self, begin: int) -> float:
        """Errors of the lens since a frame, travels, summed over the share of the budget that they took."""
        away = np.abs(self._live.path - self._best)[begin : self._live.now]
        return float(np.nansum(away)) / self._live.frames  # NaN: unknown


def _no_score(counts: np.ndarray) -> float:
    raise TypeError("a policy is shown images; it asks for no score")
