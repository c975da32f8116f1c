"""The cost of stacks and recordings: seconds on machines with known rates, and bytes on disk."""

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from saf_gen.stack.focal_stack import StackSpec

SLICE_BYTES_PER_VALUE = {"filtered": 1.3, "plain": 1.5}
"""Bytes per stored value of a time slice, by estimator; upper bounds. Filtered, with 16 samples: 1.15 to 1.29 in the
middle 200 × 125 pixels of fan, crossroad and cardiac_muscle, under each of their lights, at three positions and at all
129. Plain, with 15 % of noise: 1.3 to 1.5."""
SLICE_GEOMETRY_BYTES = 3.0  # per pixel, an upper bound: up to 2.8 in the middle of fan
STREAM_BITS_PER_PIXEL_FRAME = 0.4  # an upper bound for a stream on disk
FILTERED_TIME = 3.1
"""Time of a filtered sample divided by the time of a plain sample: the mean of the 985 test slices of saf_bench-v2.

By scene it is 1.3 (fabric), 1.6 to 2 (two_depths, gears), 2.7 to 3.5 (cardiac_muscle, crossroad, rain_window), and 11
for a target that is seen through a glass bottle."""


@dataclass(frozen=True)
class MachineRates:
    """The speed of a machine at each kind of work; the defaults are for two cores of 2.8 GHz with LLVM.

    Attributes
    ----------
    cores : float
        Cores that rendering uses, and that parallel recordings share.
    paths_per_s : float
        Plain light paths that all cores together trace and splat per second.
    load_s : float
        Seconds to load a scene, which is done for each light group of each stack.
    plane_s_per_pixel : float
        Seconds to sum and store one pixel at one focus position.
    pixel_frames_per_s : float
        Pixels times frames that one worker encodes, stores and verifies per second.
    pixel_frames_per_core_s : float
        Pixels times frames per second of processor time, a limit that many parallel workers cannot exceed.
    job_s : float
        Seconds that the scheduler spends on any job, measured on 100,000 jobs that do nothing.
    sequence_s : float
        Seconds that one process needs to draw a sequence and, at the end, to list its file in the manifest.
    start_s : float
        Seconds to start processes, load kernels and draw contact sheets; of the 25 s of quickstart, only 9 s are work.
    """

    cores: float = 2
    paths_per_s: float = 2.5e6
    load_s: float = 0.3
    plane_s_per_pixel: float = 8e-8
    pixel_frames_per_s: float = 0.7e9
    pixel_frames_per_core_s: float = 0.97e9
    job_s: float = 0.00024
    sequence_s: float = 0.004
    start_s: float = 15.0

    def recorded_per_s(self, workers: int) -> float:
        """Return the pixels times frames that ``workers`` workers on this machine record per second."""
        return min(workers * self.pixel_frames_per_s, max(1.0, self.cores) * self.pixel_frames_per_core_s)

    def render_seconds(self, spec: StackSpec) -> float:
        """Return the approximate time to render a stack, in seconds."""
        pixels = spec.rows * spec.columns
        sample = (FILTERED_TIME if spec.estimator == "filtered" else 1.0) / self.paths_per_s
        planes = spec.rendered_count * self.plane_s_per_pixel
        return len(spec.groups) * (self.load_s + pixels * (spec.samples * sample + planes))


@dataclass(frozen=True)
class WorkEstimate:
    """The jobs of a run, and the seconds that they take.

    Attributes
    ----------
    stacks, recordings : int
        Numbers of stacks to render and of sequences to record; each is a job.
    render_s, record_s : float
        Seconds of all rendering and of all recording on one machine.
    seconds : float
        Seconds from start to end on all machines, including the scheduler; 0 without a job.
    """

    stacks: int
    recordings: int
    render_s: float
    record_s: float
    seconds: float


def simulate_machines(
    works: Sequence[tuple[float, int]], *, record_s: float, machines: int, rates: MachineRates
) -> float:
    """Return the seconds from start to end if ``machines`` machines get jobs from one scheduler, in order.

    Stacks come first, and the recordings from a stack wait until it is rendered. The scheduler hands out one job after
    the other, each in ``rates.job_s`` seconds.

    Parameters
    ----------
    works : sequence of (float, int)
        Seconds to render each stack, 0 if it exists, and the number of recordings to make from it.
    record_s : float
        Seconds of one recording.
    machines : int
        Number of machines.
    rates : MachineRates
        Rates of each machine.
    """
    free, scheduler, rendered = [0.0] * machines, 0.0, []
    for render_s, recordings in works:
        if render_s:
            scheduler = max(scheduler, free[0]) + rates.job_s
            heapq.heapreplace(free, scheduler + render_s)
        rendered.append((scheduler + render_s if render_s else 0.0, recordings))
    for ready, recordings in sorted(rendered):
        for _ in range(recordings):
            scheduler = max(scheduler, free[0], ready) + rates.job_s
            heapq.heapreplace(free, scheduler + record_s)
    sequences = sum(recordings for _, recordings in works)
    return rates.start_s + max(free) + sequences * rates.sequence_s if max(free) else 0.0


def bytes_of_stacks(specs: Iterable[StackSpec]) -> int:
    """Return the approximate disk space of stacks, including their depth maps and targets, in bytes."""
    return sum(map(_stored_bytes, specs))


def bytes_of_streams(pixel_frames: float) -> int:
    """Return the approximate disk space of streams with this many pixels times frames, in bytes."""
    return int(pixel_frames * STREAM_BITS_PER_PIXEL_FRAME / 8)


def _stored_bytes(spec: StackSpec) -> int:
    pixels = spec.rows * spec.columns
    values = len(spec.groups) * spec.rendered_count * pixels
    if spec.window:
        return int(values * SLICE_BYTES_PER_VALUE[spec.estimator] + pixels * SLICE_GEOMETRY_BYTES)
    return values * 4 + pixels * 8
