"""An episode, in which a policy controls a running camera, one control period at a time, and earns rewards.

This module does not use Gymnasium. The camera, the start, the end and the judgement are those of the benchmark.
"""

from dataclasses import replace

import numpy as np

from saf_gen.benchmark.judgement import Run, judge
from saf_gen.benchmark.records import Judgement
from saf_gen.benchmark.suitability import measure_misfit
from saf_gen.benchmark.tracks.closed_loop import ClosedLoopSequence
from saf_gen.benchmark.tracks.closed_loop_run import explain_spent_budget, finish_run, start_camera
from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol
from saf_gen.benchmark.view.clock import PACKET_FRAMES
from saf_gen.errors import BadInput
from saf_gen.parts import Answer

FOCUS_BONUS = 1.0
"""Reward for a lens that ends within one depth of focus; equal to the largest possible cost of an episode's errors."""


class Episode:
    """A running camera that a policy controls; its lens is at rest before the first control period.

    Parameters
    ----------
    sequence : ClosedLoopSequence
        Scene in front of the camera, and the region where the policy looks.
    protocol : ClosedLoopProtocol
        Actuator, and budget of time.
    control_s : float
        Control period in seconds, rounded up to whole packets of the camera.
    pixels : int
        Rows and columns of the observed image.
    seed : int, optional
        Determines the initial lens position and the noise; by default they are those of the benchmark.
    threads : int, optional
        Number of threads that encode; by default one per core.

    Attributes
    ----------
    run : Run or None
        The run, once the episode is over; None before.
    rate : ndarray of float64, shape (h, w)
        Counts per pixel and frame in the last control period, in the entire box.
    observations : int
        Number of observations so far.

    Raises
    ------
    BadInput
        If the budget is shorter than two control periods.
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
        captured = replace(sequence, capture=capture).make_captured(threads=threads)
        self._camera = start_camera(captured, _no_score, protocol=protocol)
        self._capture, self._truth, self._pixels = capture, capture.truth, pixels
        self._hz = capture.sensor.readout_hz
        self._budget = protocol.count_frames(capture)[0]
        self.period = max(-(-round(control_s * self._hz) // PACKET_FRAMES), 1) * PACKET_FRAMES
        frames, track = self._camera.frames, self._truth.track
        if frames < 2 * self.period:
            raise BadInput(
                f"the control period is {control_s * 1e3:g} ms, the budget {self._budget / self._hz * 1e3:g} ms",
                allowed="a control period of at most half the budget",
            )
        self._best = np.full(frames, self._truth.position) if track is None else track[:frames]
        self.rate = np.zeros((0, 0))
        self.observations = 0
        self.run: Run | None = None

    @property
    def seconds(self) -> float:
        """Time that has passed, in seconds."""
        return self._camera.now / self._hz

    def score(self, measure: str) -> float:
        """Return the score of the last control period by a focus measure, for wrappers that show it to a policy.

        Raises BadInput before the first period, if the measure is unknown or does not suit the camera, and if the score
        is not a finite number.
        """
        if misfit := measure_misfit(measure, self._capture.kind, form=self._capture.camera.form):
            raise misfit
        return self._camera.score(self._camera.now - self.period, self._camera.now, measure)

    def observe(self) -> dict[str, np.ndarray]:
        """Let one control period pass, or the rest of the budget if that is shorter, and return the observation."""
        self._camera.wait(min(self.period, self._camera.frames - self._camera.now))
        self.observations += 1
        return self._make_observation()

    def move(self, position: float) -> tuple[dict[str, np.ndarray], float]:
        """Send the lens to a position, and return the observation of the next period and the reward.

        If no time is left afterwards, the episode is over without an answer. Raises BadInput if the position is
        outside the travel.
        """
        begin = self._camera.now
        self._camera.move(position)
        observation = self.observe()
        if self._camera.now == self._camera.frames:
            self.fail(explain_spent_budget(self._budget))
        return observation, -self._sum_errors(begin)

    def stop(self, position: float) -> tuple[dict[str, np.ndarray], float]:
        """Answer with a position, let the lens settle there, and return the last observation and the reward.

        The final error also counts for the time that is left, so that stopping early does not avoid its cost. Raises
        BadInput if the position is outside the travel.
        """
        begin = self._camera.now
        self._finish(position)
        judgement = self.judge()
        left = 1 - self._camera.now / self._camera.frames
        bonus = FOCUS_BONUS if judgement.error_dof is not None and abs(judgement.error_dof) <= 1 else 0.0
        reward = bonus - self._sum_errors(begin) - left * abs(judgement.error or 0.0)
        return self._make_observation(), reward

    def abstain(self) -> None:
        """End the episode with an abstention: the focus was not found."""
        self._finish(None)

    def fail(self, problem: str) -> None:
        """End the episode without an answer; ``problem`` says why."""
        self.run = finish_run(self._camera, Answer(), to=(), problem=problem)

    def judge(self) -> Judgement:
        """Return the judgement of the run.

        Raises BadInput before the end of the episode.
        """
        if self.run is None:
            raise BadInput("the episode is not over", hint="stop it, or let its time run out")
        return judge(self.run, self._truth, end_s=lambda frames: frames / self._hz)

    def _finish(self, position: float | None) -> None:
        answer = Answer(trace=tuple(self._camera.commanded_positions[1:]), position=position)
        self.run = finish_run(self._camera, answer, to=() if position is None else (position,))

    def _make_observation(self) -> dict[str, np.ndarray]:
        """Return the observation; its image covers a full period, even if the last period was cut short."""
        camera = self._camera
        first = camera.now - self.period
        counts = camera.run_until(first, camera.now).window(first, camera.now)
        self.rate = counts / self.period
        read = min(max(camera.position(camera.now - 1), 0.0), 1.0)
        image = average_observation(counts, self._pixels, columns=self._pixels) / self.period
        return {
            "image": image.astype(np.float32),
            "lens": np.array([read], np.float32),
            "left": np.array([1 - camera.now / camera.frames], np.float32),
        }

    def _sum_errors(self, begin: int) -> float:
        """Return the sum of the lens errors over the frames since ``begin``, in travels, divided by the budget."""
        errors = np.abs(self._camera.path - self._best)[begin : self._camera.now]
        return float(np.nansum(errors)) / self._camera.frames  # NaN means that the truth is unknown


def _no_score(counts: np.ndarray) -> float:
    raise TypeError("a policy sees images and has no scores")


GAMMA = 2.2


def average_observation(image: np.ndarray, rows: int, *, columns: int) -> np.ndarray:
    """Return the means of an image over a grid of equal areas.

    Pixels are divided between areas if necessary, and areas may be smaller than a pixel. The mean is kept, and the
    values stay in the range of the image. Sums are computed in a fixed order, so that the same counts give the same
    bits on every machine.

    Parameters
    ----------
    image : ndarray, shape (h, w)
        Image to resample.
    rows, columns : int
        Number of areas in each direction.

    Returns
    -------
    ndarray of float64, shape (rows, columns)
        Mean of each area.
    """
    means = image.astype(np.float64)
    for axis, parts in enumerate((rows, columns)):
        means = _average_along_first(means if axis == 0 else means.T, parts)
    clipped: np.ndarray = np.clip(means.T, image.min(), image.max())  # rounded differences of sums may leave the range
    return clipped


def _average_along_first(image: np.ndarray, parts: int) -> np.ndarray:
    size = len(image)
    integral = np.zeros((size + 1, image.shape[1]))  # sums from the top to each pixel edge
    np.cumsum(image, axis=0, out=integral[1:])
    edges = np.arange(parts + 1) * size / parts
    pixel = np.minimum(edges.astype(int), size - 1)
    weight = (edges - pixel)[:, None]
    at_edges = (1 - weight) * integral[pixel] + weight * integral[pixel + 1]
    means: np.ndarray = np.diff(at_edges, axis=0) * parts / size
    return means


def draw_observation(rate: np.ndarray) -> np.ndarray:
    """Return counts per pixel and frame, 0...1, as a grey image for display: uint8 (h, w, 3), gamma 2.2.

    White always means a spike in every frame, so that changes of the light are visible across images.
    """
    grey = np.rint(255 * np.clip(rate, 0, 1) ** (1 / GAMMA)).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)
