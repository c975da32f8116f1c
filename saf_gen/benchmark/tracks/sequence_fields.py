"""What a record says of the sequence, whatever a method answers: focus, light, sensor, grain, benchmark.

A lens with aberrations has its largest contrast (the truth) and its least blur at different positions. Where they are
far apart, what is in focus depends on the question, and answers are judged by both.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from saf_gen.benchmark.judgement import focus_crossing, judged_dof, light_ratio
from saf_gen.benchmark.records import SUCCESS_LIMITS_DOF, Blank, Obstacle, Stratum, Track, What
from saf_gen.benchmark.tracks.record_of_run import limited
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.benchmark.versions import evaluator_version
from saf_gen.benchmark.view.recording import WindowCounts
from saf_gen.camera import Sensor, parse_sensor
from saf_gen.camera.exposed_sensor import OF_PLACE
from saf_gen.camera.sensor_files import read_sensor, sensor_names
from saf_gen.core.config.frozen_benchmarks import BENCHMARK_KEY, read_frozen_digests
from saf_gen.errors import BadInput
from saf_gen.stream.metadata import Truth
from saf_gen.stream.recorded_grain import grain_of_stream
from saf_gen.stream.recordings import Recording

RATE_BLOCKS = 200
"""Minimum number of blocks in which mean counts are measured; a recording of fewer frames has one block per frame."""
REACH_LIMIT_DOF = SUCCESS_LIMITS_DOF[1]
"""Distance from the focus, in depths of focus, within which the lens has reached it, so that an answer can be right."""
MAX_APART_DOF = 0.15
"""Distance between largest contrast and least blur, in depths of focus, above which answers are judged by both."""
REST_DOF = 0.1
"""Range of the lens positions, in depths of focus, up to which a lens is at rest: no picture differs from another."""


def measure_rate(counts: WindowCounts) -> tuple[np.ndarray, np.ndarray]:
    """Return the centre of each block, in frames, and its mean counts, in spikes per pixel and readout."""
    window = max(1, counts.frames // RATE_BLOCKS)
    first = np.arange(0, counts.frames - window + 1, window)
    rate = np.array([float(np.mean(counts.window(a, a + window))) / window for a in first.tolist()])
    return first + (window - 1) / 2, rate


def find_blank(counts: WindowCounts, rate: tuple[np.ndarray, np.ndarray]) -> Blank | None:
    """Return what makes a recording blank if every readout of every pixel is the same, else None.

    ``rate`` is the result of measure_rate, whose blocks leave out a few frames at the end; these are read if needed.
    """
    if np.ptp(rate[1]) or rate[1][0] not in (0.0, 1.0):
        return None
    spikes = int(counts.window(0, counts.frames).sum(dtype=np.int64))
    if spikes == 0:
        return "no spikes"
    return "all spikes" if spikes == counts.frames * math.prod(counts.shape) else None


def describe_sequence(
    task: SequenceTask,
    stream: Recording,
    *,
    rate: tuple[np.ndarray, np.ndarray],
    blank: Obstacle | None,
    track: Track,
    frames: int | None = None,
    data: str = "",
    terms: str = "",
    stratum: Stratum | None = None,
) -> What:
    """Return what all records of a sequence have in common.

    Parameters
    ----------
    task : SequenceTask
        The sequence.
    stream : SpikeStream or EventRecording
        Its open stream.
    rate : tuple of ndarray
        Result of measure_rate.
    blank : str or None
        Result of find_blank, or another obstacle that comes before those of the lens.
    track : str
        ``recorded`` or ``closed_loop``.
    frames : int, optional
        Number of frames from the beginning that are described; by default the entire recording.
    data : str, optional
        Digest of what methods see; by default that of the stream.
    terms : str, optional
        Protocol of the closed loop.
    stratum : str, optional
        Stratum of the region of the evaluation.

    Returns
    -------
    What
        The sequence, and the conditions on it.
    """
    truth, gain = truncate_truth(stream.truth, frames or stream.shape[0]), stream.metadata.gain
    centres, mean_rate = rate
    if frames is not None:
        gain = None if gain is None else gain[:frames]
        mean_rate = mean_rate[: max(1, int((centres < frames).sum()))]
    if track == "recorded":
        location, off_dof = judge_crossing(truth, stream.metadata.lens_position)
    else:
        location, off_dof = judge_location(truth)
    obstacle = blank
    path = stream.metadata.lens_position if track == "recorded" else np.array([0.0, 1.0])  # where the lens can be
    if blank is None and path is not None and path.size and np.isfinite(path).all():
        if np.ptp(path) <= REST_DOF * (judged_dof(truth.depth_of_focus) or 0.0):
            obstacle = "lens at rest"
        elif location is None and _find_best_focus(truth) is not None:
            obstacle = "focus not reached"
    grain = grain_of_stream(stream.metadata.provenance)
    if track == "closed_loop" and truth.track is not None:  # in a moving scene, the recording has other slices
        grain = None
    return What(
        sequence=task.id,
        split=task.split,
        scene=task.scene,
        light=task.light,
        frames=frames or stream.shape[0],
        data=data or stream.content_sha256,
        track=track,
        terms=terms,
        rig=evaluator_version(track),
        benchmark=benchmark_of(stream.metadata.provenance),
        sensor=sensor_of(stream.metadata.provenance, kind=stream.counted),
        scene_motion=task.scene_motion,
        lens_motion=task.lens_motion,
        least_blur=_least_blur(stream.truth),
        focus_place=location,
        focus_off_dof=off_dof,
        mean_rate=float(mean_rate.mean()),
        light_ratio=light_ratio(gain),
        obstacle=obstacle,
        grain_rms=None if grain is None else limited(grain.rms_in_focus),
        stratum=stratum,
    )


def _least_blur(truth: Truth) -> float | None:
    """Return the distance of the least blur from the truth, in travels; None unless it is far."""
    dof = judged_dof(truth.depth_of_focus)
    apart = math.nan if truth.least_blur is None else truth.least_blur - truth.position
    return apart if dof is not None and abs(apart) > MAX_APART_DOF * dof else None


def judge_crossing(truth: Truth, focus_position: np.ndarray | None) -> tuple[float | None, float | None]:
    """Return the time at which the lens of a recording first meets the focus, and its smallest distance from the focus.

    Parameters
    ----------
    truth : Truth
        Truth of the recording.
    focus_position : ndarray of float, shape (T,), or None
        Where the lens was at each readout, as fractions of the travel.

    Returns
    -------
    when : float or None
        Time of the first meeting, as a fraction of the recording, 0...1. A lens that comes near without crossing the
        focus meets it where it is nearest. None if the lens stays farther away than REACH_LIMIT_DOF, or if unknown.
    distance : float or None
        Smallest distance over all readouts, in depths of focus, by which
        :func:`saf_gen.benchmark.judgement.judge` judges abstentions. None if unknown.
    """
    best = _find_best_focus(truth)
    lens = np.asarray([] if focus_position is None else focus_position, dtype=np.float64)
    if best is None or not lens.size or not np.isfinite(lens).all():
        return None, None
    offset = lens - best
    min_distance = _to_depths_of_focus(float(np.abs(offset).min()), truth)
    if min_distance is not None and min_distance > REACH_LIMIT_DOF:
        return None, min_distance
    frame = focus_crossing(None, offset=offset, truth_frame=truth.frame)
    if frame is None and min_distance is not None:
        frame = float(np.abs(offset).argmin())
    return None if frame is None else min(max((frame + 0.5) / lens.size, 0.0), 1.0), min_distance


def judge_location(truth: Truth) -> tuple[float | None, float | None]:
    """Return the position of the focus in the travel, and its distance from the travel, if the lens may move freely.

    Parameters
    ----------
    truth : Truth
        Truth of the recording. In a moving scene the position is ``truth.position``.

    Returns
    -------
    position : float or None
        Fraction of the travel, clipped to 0...1. None if unknown, or if the distance exceeds REACH_LIMIT_DOF.
    distance : float or None
        Distance of the focus beyond the ends of the travel, in depths of focus; in a moving scene, the smallest
        distance at any time. None if unknown.
    """
    best = _find_best_focus(truth)
    if best is None:
        return None, None
    min_distance = _to_depths_of_focus(float(np.maximum(0.0, np.maximum(-best, best - 1)).min()), truth)
    reached = min_distance is not None and min_distance <= REACH_LIMIT_DOF
    return min(max(truth.position, 0.0), 1.0) if reached else None, min_distance


def truncate_truth(truth: Truth, frames: int) -> Truth:
    """Return the truth of the first ``frames`` frames of a recording.

    If the target moves and the recorded lens met the focus later, the position is the best focus in the last of these
    frames.
    """
    if truth.track is None or frames >= len(truth.track):
        return truth
    track = truth.track[:frames]
    return replace(truth, track=track, position=truth.position if truth.frame < frames else float(track[-1]))


def _find_best_focus(truth: Truth) -> np.ndarray | None:
    """Return the best focus, shape (T,) or (1,), or None if it is unknown in any frame."""
    best = np.atleast_1d(np.float64(truth.position) if truth.track is None else truth.track)
    return best if math.isfinite(truth.position) and best.size and np.isfinite(best).all() else None


def _to_depths_of_focus(distance: float, truth: Truth) -> float | None:
    dof = judged_dof(truth.depth_of_focus)
    return 0.0 if distance == 0 else None if dof is None else distance / dof


def sensor_of(provenance: Mapping[str, str], *, kind: str = "spikes") -> str | None:
    """Return the name of the sensor that a recording states, or None if it states no readable sensor.

    If the numbers of the sensor differ from those of the registered sensor of that name, because a recipe changed them
    or because a user wrote the sensor file, six digits of their digest follow the name: ``vidar_400x250#1c2d3e``.
    """
    text = provenance.get("event_sensor", provenance.get("sensor"))
    return None if text is None else _name(text, kind)


@lru_cache(maxsize=64)
def _name(text: str, kind: str) -> str | None:
    try:
        sensor = parse_sensor(text, "/provenance/sensor", kind=kind)
    except BadInput:  # the sensor is from another version, or from an untrusted file
        return None
    digest = _digest(sensor)
    if sensor.name in sensor_names(kind) and digest == _digest(read_sensor(sensor.name)):
        return str(sensor.name)
    return f"{sensor.name}#{digest[:6]}"


def _digest(sensor: Any) -> str:
    """Return the digest of a sensor's numbers, without its name and sources.

    Those of a camera that stands in the place of a spike camera, and the exposure that it chose, are left out, too.
    """
    numbers = sensor.as_dict()
    for key in ("name", "sources", *(() if isinstance(sensor, Sensor) else (*OF_PLACE, "exposure_s"))):
        numbers.pop(key, None)
    return hashlib.sha256(json.dumps(numbers, sort_keys=True).encode()).hexdigest()


_DIGITS = 12
"""Number of digits of the digest that a record contains."""


def benchmark_of(provenance: Mapping[str, str]) -> str | None:
    """Return the name of a recording's frozen benchmark and 12 digits of its digest, or None if it belongs to none.

    The benchmark that a recording states is accepted only if this version of saf_gen knows its name and digest.
    """
    name, _, digest = provenance.get(BENCHMARK_KEY, "").partition(" ")
    frozen = read_frozen_digests().get(name)
    return f"{name} {digest[:_DIGITS]}" if frozen is not None and digest == frozen.digest else None
