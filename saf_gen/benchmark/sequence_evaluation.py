"""Run all methods on one sequence, in this process or as a job on another machine."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import TYPE_CHECKING, Self

import numpy as np

from saf_gen.benchmark.admission import admit_method
from saf_gen.benchmark.curve_quality import AssessedCurve, CurveQuality, assess_curve
from saf_gen.benchmark.guests.host import Limits
from saf_gen.benchmark.judgement import judged_dof, lens_position
from saf_gen.benchmark.method_spec import Method
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import Drawn, Evaluation, FocusCurve, LensPath, SweepSummary
from saf_gen.benchmark.tracks.predictions import PredictionSet
from saf_gen.benchmark.tracks.recorded import evaluate_recorded
from saf_gen.benchmark.tracks.tasks import SequenceTask
from saf_gen.core.execution import ReportProgress
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, unknown

if TYPE_CHECKING:
    from saf_gen.benchmark.tracks.protocol import ClosedLoopProtocol

MethodGroups = Mapping[str, Sequence[Method]]
"""Methods by the region that they look at; the region of the evaluation comes first, even if it has no methods."""


def by_region(methods: Mapping[str, Method], region: str) -> dict[str, list[Method]]:
    """Return the methods that look at each region.

    Parameters
    ----------
    methods : mapping of str to Method
        Methods by name.
    region : str
        Region of the evaluation: ``target``, ``frame`` or ``both``, which is ``target`` with ``METHOD@frame`` added for
        each method whose name includes no region.

    Returns
    -------
    dict of str to list of Method
        Methods by region; the region of the evaluation comes first, even if it has no methods.

    Raises
    ------
    BadInput
        If the region is unknown.
    """
    if region not in (*REGIONS, "both"):
        raise unknown("region", region, allowed=(*REGIONS, "both"))
    usual = "target" if region == "both" else region
    if region == "both":
        at_frame = [replace(m, name=f"{m.name}@frame", region="frame") for m in methods.values() if not m.region]
        methods = {**{method.name: method for method in at_frame}, **methods}
    groups: dict[str, list[Method]] = {usual: [], **{name: [] for name in REGIONS}}
    for method in methods.values():
        groups[method.region or usual].append(method)
    return {name: group for name, group in groups.items() if group or name == usual}


def parse_methods(specs: Sequence[str], limits: Limits | None = None) -> dict[str, Method]:
    """Return methods by name, without duplicates, since a method can be spelled in several ways; guests have limits.

    Raises BadInput if :func:`admit_method` does.
    """
    chosen: dict[str, Method] = {}
    for method in (admit_method(spec, limits) for spec in specs):
        chosen.setdefault(method.name, method)
    return chosen


def evaluate_sequence(
    task: SequenceTask,
    groups: MethodGroups,
    *,
    protocol: "ClosedLoopProtocol | None",
    predictions: PredictionSet | None,
    step: Callable[[int, str], None],
    draw: Drawn,
) -> Evaluation:
    """Run all methods on one sequence.

    Parameters
    ----------
    task : SequenceTask
        The sequence.
    groups : mapping of str to sequence of Method
        Methods by region. Predictions, charts and mean counts belong to the first region.
    protocol : ClosedLoopProtocol or None
        Protocol of the closed loop; None for the recorded track.
    predictions : PredictionSet or None
        Answers that were made elsewhere.
    step : callable
        Called with (methods done, what was done).
    draw : str
        Parts of the sequence that charts show, one of ``Drawn``.

    Returns
    -------
    Evaluation
        Result of this sequence. If it is not drawn, the result has the quality of its focus curves, but no sweep and
        no lens paths.
    """
    usual, before = next(iter(groups)), 0
    records: list[Record] = []
    sweeps: list[SweepSummary] = []
    lens_paths: list[LensPath] = []
    for region, group in groups.items():

        def group_step(done: int, what: str, before: int = before) -> None:
            step(before + done, what)

        if protocol is None:
            group_records, sweep = evaluate_recorded(
                task,
                group,
                region=region,
                rate_region=usual,
                step=group_step,
                predictions=predictions if region == usual else None,
                with_thumbnails=draw == "pictures" and region == usual,
            )
            sweeps += [sweep] if region == usual else []
        elif not group:
            continue
        else:
            # Imported late because this loads the reader of OpenEXR files.
            from saf_gen.benchmark.tracks.closed_loop import evaluate_closed_loop

            group_records, group_paths = evaluate_closed_loop(
                task, group, region=region, rate_region=usual, protocol=protocol, step=group_step
            )
            lens_paths += group_paths
        records += group_records
        before += len(group)
    curves = tuple(assess_curves(sweeps))
    if not draw:
        sweeps, lens_paths = [], []
    return Evaluation(tuple(records), tuple(sweeps), (), tuple(lens_paths), curves=curves)


@dataclass(frozen=True)
class NamedMethods:
    """Names from which another machine builds methods, because plug-ins from a user's file cannot be pickled.

    Attributes
    ----------
    specs : tuple of str
        Names of methods.
    region : str
        Region of the evaluation.
    folder : str
        Folder to which file paths in the names are relative.
    codes : tuple of (str, str)
        Name and code digest of each method, which must be equal on the other machine.
    limits : Limits
        What the methods of others may use.
    """

    specs: tuple[str, ...]
    region: str
    folder: str
    codes: tuple[tuple[str, str], ...]
    limits: Limits

    @classmethod
    def of(cls, specs: Sequence[str], region: str, *, groups: MethodGroups, limits: Limits) -> Self:
        """Return the names and the code digests of methods that this process has loaded."""
        return cls(tuple(specs), region, os.getcwd(), _codes(groups), limits)  # noqa: PTH109

    def find(self) -> dict[str, list[Method]]:
        """Return the methods by region; raise BadInput if one is missing on this machine or has different code."""
        with chdir(self.folder):
            groups = by_region(parse_methods(self.specs, self.limits), self.region)
        for (name, code), (_, found) in zip(self.codes, _codes(groups), strict=True):
            if code != found:
                raise BadInput(f"method {name!r} has different code on a worker ({found}, not {code})")
        return groups


def _codes(groups: MethodGroups) -> tuple[tuple[str, str], ...]:
    return tuple((method.name, method.code) for group in groups.values() for method in group)


@dataclass(frozen=True)
class EvaluateJob:
    """A job that evaluates the sequence ``number`` of a dataset and returns an Evaluation of this sequence alone."""

    number: int
    task: SequenceTask
    methods: NamedMethods
    protocol: "ClosedLoopProtocol | None"
    predictions: PredictionSet | None
    draw: Drawn
    takes_all_cores = True
    wants_gpu = False

    @property
    def name(self) -> str:
        return f"evaluate {self.task.id}"

    def run(self, report: ReportProgress) -> Evaluation:
        return evaluate_sequence(
            self.task,
            self.methods.find(),
            protocol=self.protocol,
            predictions=self.predictions,
            step=lambda done, what: None,
            draw=self.draw,
        )


def assess_curves(sweeps: Iterable[SweepSummary]) -> list[AssessedCurve]:
    """Return the quality of every focus curve, in the order of the sweeps."""
    return [
        AssessedCurve(
            curve.measure,
            sweep.sequence,
            sweep.split,
            sweep.scene,
            sweep.light,
            sweep.truth if isfinite(sweep.truth) else None,
            judged_dof(sweep.depth_of_focus),
            _assess(sweep, curve=curve),
        )
        for sweep in sweeps
        for curve in sweep.curves
    ]


def _assess(sweep: SweepSummary, *, curve: FocusCurve) -> CurveQuality | None:
    lens = sweep.focus_position
    if lens is None or not np.isfinite(lens).all():
        return None
    truth = sweep.truth
    if sweep.track is not None and curve.scores.size:  # if the target moves, the truth at the peak counts
        is_known = isfinite(truth) and np.isfinite(sweep.track).all()
        peak_frame = float(curve.frames[curve.scores.argmax()])
        truth = lens_position(peak_frame, sweep.track) if is_known else nan
    return assess_curve(
        np.interp(curve.frames, np.arange(len(lens)), lens),
        curve.scores,
        truth=truth if isfinite(truth) else None,
        depth=judged_dof(sweep.depth_of_focus),
    )
