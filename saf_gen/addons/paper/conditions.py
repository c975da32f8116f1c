"""The conditions of the paper in a dataset, the recordings that its figures show, and what its methods do on them."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from saf_gen.benchmark.admission import admit_measure
from saf_gen.benchmark.judgement import lens_position
from saf_gen.benchmark.kept_sequences import KeptSequences
from saf_gen.benchmark.records import Record
from saf_gen.benchmark.results import SweepSummary
from saf_gen.benchmark.sequence_evaluation import by_region, evaluate_sequence, parse_methods
from saf_gen.benchmark.suitability import keep_those_that_suit
from saf_gen.benchmark.tracks.tasks import SequenceTask, select_sequences_to_evaluate
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.errors import BadInput
from saf_gen.plugins.searches._golden_narrowing import count_blocks, golden_feedback
from saf_gen.stream.measure_input import choose_region
from saf_gen.stream.recordings import open_recording

MOTIONS = ("static", "dynamic")
LIGHTS = ("constant", "continuous", "sudden")
MEASURES = {"sd_code": "SD", "gradient_code": "Gradient", "mfdct_code": "MF-DCT", "er_sumsq": "ER"}
"""The measures of the paper as its authors released them, and their names in the paper."""
EGS, SGFS = "sd_code+egs_code", "sd_code+sgfs_code"
BLOCK = 100
"""Frames per block of the curves."""
WINDOWS = (25, 50, 100, 200, 400, 800, 1600)
"""Values of Δt for the naive search, in frames; those longer than half of a recording are left out."""
FIGURE_4 = {"static": "camel", "dynamic": "crossroad"}
FIGURE_5, FIGURE_6, FIGURE_7 = ("usaf_microscope", "usaf_target"), ("lily_anther", "fan"), ("bottle", "cardiac_muscle")
"""The scenes of the paper's figures; other scenes take the place of those that a dataset lacks."""

Shown = tuple[tuple[str, str], ...]
"""What a figure shows: scenes, each with its motion."""


@dataclass(frozen=True)
class PaperRun:
    """What the methods of the paper did on the sequences of a dataset.

    Attributes
    ----------
    records : tuple of Record
        Results of all methods.
    sweeps : tuple of SweepSummary
        Lens, light, truth and focus curves of every sequence.
    scenes : dict of str to tuple of (str, str)
        Scenes and their motions by the name of the figure.
    naive : dict of int to str
        Name of the naive method by its Δt, in frames.
    feedback : dict of str to (ndarray of int, ndarray of float64)
        SD in real time of the sequences of Figure 7, by sequence: the numbers of frames after which it is known, shape
        (B,), and the difference of the scores of their later and earlier half, shape (B,).
    """

    records: tuple[Record, ...]
    sweeps: tuple[SweepSummary, ...]
    scenes: dict[str, Shown]
    naive: dict[int, str]
    feedback: dict[str, tuple[np.ndarray, np.ndarray]]

    def sweep(self, scene: str, *, motion: str, light: str) -> SweepSummary:
        """Return the first sweep of a scene under these conditions, which the dataset has."""
        return next(s for s in self.sweeps if (s.scene, s.scene_motion, s.light) == (scene, motion, light))

    def record(self, sequence: str, method: str) -> Record:
        """Return the result of a method on a sequence, which exists."""
        return next(r for r in self.records if (r.what.sequence, r.who.method) == (sequence, method))


def stop_frame(record: Record) -> int:
    """Return the number of frames after which ``sgfs_code`` stopped, or all frames if it did not answer."""
    found = re.match(r"stopped after (\d+) ", record.judgement.note)
    return int(found[1]) if found else record.what.frames


def positions(sweep: SweepSummary, frames: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the lens positions at frames (N,) counted from 0: float64 (N,), fractions of the travel."""
    lens = sweep.focus_position
    return np.array([np.nan if lens is None else lens_position(float(frame), lens) for frame in frames])


def select_sequences(data: Path) -> list[SequenceTask]:
    """Return the sequences of a dataset under the lights of the paper.

    Raises BadInput, naming what is missing, unless a static and a dynamic scene have all three lights, or if the path
    is no dataset.
    """
    if data.is_file():
        raise BadInput("this is a single file", where=str(data), allowed="a dataset folder")
    tasks = [task for task in select_sequences_to_evaluate(data, split="all").tasks if task.light in LIGHTS]
    for motion in MOTIONS:
        lit: dict[str, set[str | None]] = {}
        for task in tasks:
            if task.scene_motion == motion:
                lit.setdefault(task.scene, set()).add(task.light)
        best = max(lit, key=lambda scene: len(lit[scene]), default=None)
        missing = [light for light in LIGHTS if best is None or light not in lit[best]]
        if missing:
            under = f"under {' and '.join(', '.join(missing).rsplit(', ', 1))} light"
            raise BadInput(
                f"no {motion} scene" + (f" {under}, {best} neither" if best else ""),
                where=str(data),
                allowed="a static and a dynamic scene, each under constant, continuous and sudden light",
                hint="saf-gen generate paper_small makes them all",
            )
    return tasks


def choose_scenes(tasks: Sequence[SequenceTask]) -> dict[str, Shown]:
    """Return what Figures 4 to 7 show, scenes of the paper first; Figure 4 is left out if it would show the same as 5.

    The scenes of Figures 6 and 7 move if the dataset has them moving.
    """
    lit = {(task.scene, task.scene_motion, task.light) for task in tasks}
    scenes = list(dict.fromkeys(task.scene for task in tasks))
    whole = {m: [s for s in scenes if all((s, m, light) in lit for light in LIGHTS)] for m in MOTIONS}
    fifth = {m: next(s for s in (*FIGURE_5, *whole[m]) if s in whole[m]) for m in MOTIONS}
    rest = {m: [FIGURE_4[m], *(s for s in whole[m] if s != fifth[m]), fifth[m]] for m in MOTIONS}
    fourth = {m: next(s for s in rest[m] if s in whole[m]) for m in MOTIONS}
    rows = {"figure-4": fourth, "figure-5": fifth} if fourth != fifth else {"figure-5": fifth}
    shown = {name: tuple((scene, motion) for motion, scene in row.items()) for name, row in rows.items()}
    for name, light, paper in (("figure-6", "continuous", FIGURE_6), ("figure-7", "constant", FIGURE_7)):
        motions = {s: m for m in MOTIONS for s in scenes if (s, m, light) in lit}  # the last, dynamic, stays
        chosen = [*(s for s in paper if s in motions), *(s for s in scenes if s in motions and s not in paper)]
        shown[name] = tuple((scene, motions[scene]) for scene in chosen[:2])
    return shown


def run_methods(
    tasks: Sequence[SequenceTask], *, keep: KeptSequences, stacks: Path, progress: Callable[[int, int, str], None]
) -> PaperRun:
    """Run the methods of the paper on sequences, or take over what an earlier run that was stopped had finished.

    Raises BadInput if a recording is damaged, or holds no spikes.
    """
    frames = min(task.frames or 0 for task in tasks)
    specs = {dt: f"sd_code+naive:dt={dt},step={max(dt // 4, 1)}" for dt in WINDOWS if 2 * dt <= frames}
    naive = {dt: next(iter(parse_methods([spec]))) for dt, spec in specs.items()}
    methods = parse_methods([*(f"{measure}+argmax" for measure in MEASURES), EGS, SGFS, *specs.values()])
    groups = by_region(keep_those_that_suit(methods, list(tasks), asked=methods, tell=lambda line: None), "target")
    keep.begin(groups, protocol=None, predictions=None, stacks=stacks)
    records: list[Record] = []
    sweeps: list[SweepSummary] = []
    with keep:
        for number, task in enumerate(tasks):
            progress(number, len(tasks), task.id)
            part = keep.reuse(task, draw="sweep")
            if part is None:
                part = evaluate_sequence(
                    task, groups, protocol=None, predictions=None, step=lambda done, what: None, draw="sweep"
                )
                keep.keep(task, part, draw="sweep")
            records += part.records
            sweeps += part.sweeps
    scenes = choose_scenes(tasks)
    feedback = {
        task.id: score_in_real_time(task.path)
        for task in tasks
        if task.light == "constant" and (task.scene, task.scene_motion) in scenes["figure-7"]
    }
    progress(len(tasks), len(tasks), "")
    return PaperRun(tuple(records), tuple(sweeps), scenes, naive, feedback)


def score_in_real_time(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of frames, int (B,), after which ``sgfs_code`` compares, and its differences, float64 (B,)."""
    with open_recording(path) as recording:
        counts = WindowCounts(recording, choose_region(recording, "target")[0])
        view = RecordingView(counts, admit_measure("sd_code"))
        first, blocks = count_blocks(view, BLOCK)
        ends = BLOCK * np.arange(first, blocks + 1)
        return ends, np.array([golden_feedback(view, end) for end in ends.tolist()])


def curve_rows(run: PaperRun, scale: Callable[[np.ndarray], np.ndarray]) -> list[Mapping[str, object]]:
    """Return the points of all curves, each with its sequence, lens position, light and score, as drawn and before."""
    rows: list[Mapping[str, object]] = []
    for sweep in run.sweeps:
        what = {
            "sequence": sweep.sequence, "scene": sweep.scene, "motion": sweep.scene_motion, "light": sweep.light,
            "truth": sweep.truth,
        }  # fmt: skip
        curves = [(curve.measure, curve.frames, curve.scores) for curve in sweep.curves]
        if sweep.sequence in run.feedback:
            ends, scores = run.feedback[sweep.sequence]
            curves.append(("sd_rt", ends - 1, scores))
        for measure, frames, scores in curves:
            lens, rate = positions(sweep, frames), np.interp(frames, sweep.frames, sweep.rate)
            points = zip(
                frames.tolist(), lens.tolist(), rate.tolist(), scores.tolist(), scale(scores).tolist(), strict=True
            )
            rows += [
                {**what, "measure": measure, "frame": f, "position": p, "rate": r, "score": s, "normalised": n}
                for f, p, r, s, n in points
            ]
    return rows
