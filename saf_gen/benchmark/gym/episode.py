"""One episode: a running camera controlled by a policy, one control period at a time, and its rewards.

It is independent of Gymnasium. The camera, the start, the end and the judgement are those of the benchmark.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from saf_gen.benchmark.gym.observation_images import average_policy_observation
from saf_gen.benchmark.tracks.closed_loop_judgement import judge_closed_loop_run
from saf_gen.benchmark.tracks.closed_loop_run import (
    ClosedLoopRun,
    explain_spent_method_budget,
    finish_closed_loop_run,
    start_closed_loop_camera,
)
from saf_gen.benchmark.tracks.closed_loop_sequence import ClosedLoopSequence
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.running_camera import PACKET_FRAMES
from saf_gen.errors import BadInput
from saf_gen.parts import Answer

FOCUS_BONUS = 1.0
"""Reward for a lens that ends within one depth of focus: as much as the errors of an episode cost at most."""


class Episode:
    """A running camera, its lens at rest before the first control period.

    Raises BadInput for a budget of less than two control periods.

    Parameters
    ----------
    sequence : what is in front of the camera.
    protocol : the actuator, and the budget of time.
    control_s : the control period in seconds, rounded up to whole packets of the camera.
    pixels : rows and columns of the observed image.
    seed : names the initial lens position and the noise; None: those of the benchmark.
    threads : threads that encode; None: one for each core.

    Attributes
    ----------
    run : the run once the episode is over, None before.
    rate : float64 (h, w), counts per pixel and frame of the last control period, in the whole box.
    observations : number of observations so far.
    """

    def __init__(
        self,
        sequence: ClosedLoopSequence,
        protocol: ClosedLoopProtocol,
        *,
        control_s: float,
        pixels: int,
        seed: int | None = None,
        threads: int | None = None,
    ) -> None:
        capture = sequence.capture if seed is None else replace(sequence.capture, seed=seed)
        captured = replace(sequence, capture=capture).make_captured_frames(threads=threads)
        self._camera = start_closed_loop_camera(captured, _no_score, protocol=protocol)
        self._truth, self._hz, self._pixels = capture.truth, capture.sensor.readout_hz, pixels
        self._budget = protocol.count_frames(capture)[0]
        self.period = max(-(-round(control_s * self._hz) // PACKET_FRAMES), 1) * PACKET_FRAMES
        frames, track = self._camera.frames, self._truth.track
        if frames < 2 * self.period:
            raise BadInput(
                f"a control period of {control_s * 1e3:g} ms, with a budget of {self._budget / self._hz * 1e3:g} ms",
                allowed="half the budget at most",
            )
        self._best = np.full(frames, self._truth.position) if track is None else track[:frames]
        self.rate = np.zeros((0, 0))
        self.observations = 0
        self.run: ClosedLoopRun | None = None

    @property
    def seconds(self) -> float:
        """Time that has passed."""
        return self._camera.now / self._hz

    def score(self, measure: str) -> float:
        """Return the score of the last control period by a focus measure, for what a wrapper shows a policy.

        Raises BadInput before the first period, for an unknown measure, and for a score that is not a finite number.
        """
        return self._camera.score(self._camera.now - self.period, self._camera.now, measure)

    def observe(self) -> dict[str, np.ndarray]:
        """Let a control period pass, or what is left of the budget, and return the observation."""
        self._camera.wait(min(self.period, self._camera.frames - self._camera.now))
        self.observations += 1
        return self._make_observation()

    def move(self, position: float) -> tuple[dict[str, np.ndarray], float]:
        """Send the lens to a position, and return the observation of the next period and the reward.

        Where no time is left then, the episode is over without an answer. Raises BadInput for a position
        outside the travel.
        """
        begin = self._camera.now
        self._camera.move(position)
        observation = self.observe()
        if self._camera.now == self._camera.frames:
            self.fail(explain_spent_method_budget(self._budget))
        return observation, -self._sum_errors(begin)

    def stop(self, position: float) -> tuple[dict[str, np.ndarray], float]:
        """Answer with a position, where the lens settles; return the last observation and the reward.

        The last error counts for the time that is left, so that an early stop is not a cheap one. Raises
        BadInput for a position outside the travel.
        """
        begin = self._camera.now
        self._finish(position)
        judged = self.judge()
        left = 1 - self._camera.now / self._camera.frames
        bonus = FOCUS_BONUS if judged["success_1dof"] else 0.0
        reward = bonus - self._sum_errors(begin) - left * abs(judged.get("error") or 0.0)
        return self._make_observation(), reward

    def abstain(self) -> None:
        """End the episode with the answer that the focus is not found."""
        self._finish(None)

    def fail(self, problem: str) -> None:
        """End the episode without an answer."""
        self.run = finish_closed_loop_run(self._camera, Answer(), to=None, budget=self._budget, problem=problem)

    def judge(self) -> dict[str, Any]:
        """Return truth, error and success of the run; None where unknown. Raise BadInput before the end."""
        if self.run is None:
            raise BadInput("the episode is still going on", hint="stop it, or let its time run out")
        return judge_closed_loop_run(self.run, self._truth, readout_hz=self._hz)

    def _finish(self, position: float | None) -> None:
        answer = Answer(trace=tuple(self._camera.commanded_positions[1:]), position=position)
        self.run = finish_closed_loop_run(self._camera, answer, to=position, budget=self._budget)

    def _make_observation(self) -> dict[str, np.ndarray]:
        """Return what a policy sees. The image covers a whole period, also where the last was cut short."""
        camera = self._camera
        first = camera.now - self.period
        counts = camera.run_until(first, camera.now).window(first, camera.now)
        self.rate = counts / self.period
        read = min(max(camera.position(camera.now - 1), 0.0), 1.0)
        image = average_policy_observation(counts, self._pixels, columns=self._pixels) / self.period
        return {
            "image": image.astype(np.float32),
            "lens": np.array([read], np.float32),
            "left": np.array([1 - camera.now / camera.frames], np.float32),
        }

    def _sum_errors(self, begin: int) -> float:
        """Return the errors of the lens since a frame, summed over frames, in travels per budget."""
        errors = np.abs(self._camera.path - self._best)[begin : self._camera.now]
        return float(np.nansum(errors)) / self._camera.frames  # NaN: unknown


def _no_score(counts: np.ndarray) -> float:
    raise TypeError("a policy sees images and has no scores")
