"""The records of the closed-loop track: every method moves the lens of a running camera."""

from collections.abc import Callable, Sequence

import numpy as np

from saf_gen.contest.jobs import Job, box_of, given, light_of
from saf_gen.contest.loop import Run, run_method
from saf_gen.contest.results import LensPath
from saf_gen.contest.setting import Setting
from saf_gen.contest.terms import Terms
from saf_gen.methods import Method
from saf_gen.parts import commands
from saf_gen.records import Record
from saf_gen.rig import Counts
from saf_gen.scores import depth_of_focus
from saf_gen.stream import open_stream
from saf_gen.take import Take

__all__ = ["live_sequence"]

PATH_POINTS = 400


def live_sequence(
    job: Job,
    methods: Sequence[Method],
    region: str,
    terms: Terms,
    step: Callable[[int, str], None],
    *,
    light_in: str,
) -> tuple[list[Record], list[LensPath]]:
    """The records of a sequence, and where each method took the lens.

    ``light_in`` is the region whose mean counts are told of the sequence.
    """
    records, paths = [], []
    with open_stream(job.path) as stream:
        setting = Setting.of(job, stream, region)
        light = light_of(Counts(stream, region=box_of(stream, light_in)[0]))
        said = given(job, stream, light, "closed_loop", frames=terms.frames(setting.take)[0])
    if not all(commands(method.search) for method in methods):  # the others are given a sweep
        terms.check_sweep(setting.take)
    for done, method in enumerate(methods):
        run = run_method(setting.take, setting.exposed, setting.box, method, terms)
        records.append(
            setting.record(
                run,
                terms,
                method=method.name,
                code=method.code,
                parameters=f"{method.measure!r} + {method.search!r}",
                tuning=method.tuning,
                said=said,
            )
        )
        paths.append(_lens_path(job, method.name, run, setting.take))
        step(done + 1, method.name)
    return records, paths


def _lens_path(job: Job, method: str, run: Run, take: Take) -> LensPath:
    frames = np.unique(np.linspace(0, len(run.path) - 1, min(len(run.path), PATH_POINTS)).astype(int))
    truth = take.truth
    best = np.full(len(frames), truth.position) if truth.track is None else truth.track[frames]
    return LensPath(
        method=method,
        sequence=job.id,
        split=job.split,
        scene=job.scene,
        light=job.light,
        seconds=(frames + 0.5) / take.sensor.readout_hz,
        position=run.path[frames],
        truth=best,
        depth_of_focus=depth_of_focus(truth.depth_of_focus),
        problem=run.problem,
    )
