"""Measurements of speed, memory and file size: ratios within one run, or rates together with their workload.

Each bench is a module of this folder and yields figures, most of them with a target. A bench is not a test: a busy or
old machine may miss a target although nothing is wrong.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

from saf_gen.acceptance.speed.bench_figure import BenchFigure, BenchSize
from saf_gen.acceptance.speed.fresh_process import peak_memory_of_bench_gib, run_bench_in_fresh_process
from saf_gen.acceptance.speed.grain_by_scene import SceneResult, bench_each_scene
from saf_gen.core.execution.job import ReportProgress
from saf_gen.errors import SafGenError, unknown

__all__ = ["BENCHES", "BenchFigure", "BenchResults", "BenchSize", "SceneResult", "run_benches"]

BENCHES = {
    "stack": "the focal stack against Mitsuba's thin lens: time, and error at equal samples",
    "grain": "noise that the renderer leaves in each scene's pictures, at rest and moving; time of a slice",
    "encode": "charge to spikes: rate, growth with the length, comparison with public encoders",
    "stream": "the stream file: write, size, three read patterns, file to scores",
    "windows": "random windows for training, read by two processes",
    "score": "ten methods on six sequences",
    "rates": "rates for `saf-gen plan --rates`: rendering, recording, and the scheduler on jobs that do nothing",
    "job": "the paper's synthetic set, recipe to leaderboard, and again under another light",
}
PEAK_MEMORY, MAX_MEMORY_GIB = "peak memory of a process", 2.0


@dataclass(frozen=True)
class BenchResults:
    """The results of a run of benches.

    Attributes
    ----------
    figures : tuple of BenchFigure
        All measured figures.
    remarks : tuple of str
        Sentences about what was left out, and why.
    failed : dict of str to SafGenError
        The error of each bench that failed, by the name of the bench.
    """

    figures: tuple[BenchFigure, ...]
    remarks: tuple[str, ...]
    failed: dict[str, SafGenError]


def run_benches(
    names: Sequence[str],
    size: BenchSize,
    *,
    folder: Path | None = None,
    report: ReportProgress = lambda stage, done: None,
    show: Callable[[SceneResult], None] = lambda found: None,
) -> BenchResults:
    """Run benches one after the other, each in a fresh process.

    The bench ``grain`` has a process for each scene. A bench that cannot run here (no LLVM, no recipe) is listed among
    the failed ones, and the others continue.

    Parameters
    ----------
    names : sequence of str
        Keys of BENCHES; all benches if empty.
    size : BenchSize
        Workload of the benches.
    folder : Path, optional
        Folder in which the bench ``grain`` saves the results of each scene, so that an interrupted run can be resumed.
    report : callable, optional
        Called with the name of the current measurement and the fraction of it that is done, 0 to 1.
    show : callable, optional
        Called with the results of the bench ``grain`` for each scene.

    Returns
    -------
    BenchResults

    Raises
    ------
    BadInput
        If a name is unknown, before anything is measured.
    """
    for name in names:
        if name not in BENCHES:
            raise unknown("bench", name, allowed=BENCHES)
    found: list[BenchFigure | str] = []
    failed: dict[str, SafGenError] = {}
    for name in dict.fromkeys(names or BENCHES):
        try:
            if name == "grain":
                found += _measure_grain(size, folder=folder, report=report, show=show)
            else:
                found += run_bench_in_fresh_process(_measure, name, size, report=report)
        except SafGenError as error:
            failed[name] = error
    figures = tuple(f for f in found if isinstance(f, BenchFigure))
    return BenchResults(figures, tuple(f for f in found if isinstance(f, str)), failed)


def _measure(name: str, size: BenchSize, *, report: ReportProgress) -> list[BenchFigure | str]:
    """Return the figures and remarks of a bench, and the peak memory of this process, which runs nothing else."""
    run_bench: Callable[[BenchSize, ReportProgress], Iterator[BenchFigure | str]]
    run_bench = import_module(f"saf_gen.acceptance.speed.bench_{name}").run_bench
    return [
        *run_bench(size, lambda stage, done: report(f"{name}: {stage}", done)),
        BenchFigure(name, PEAK_MEMORY, peak_memory_of_bench_gib(), "GiB", MAX_MEMORY_GIB, at_most=True),
    ]


def _measure_grain(
    size: BenchSize, *, folder: Path | None, report: ReportProgress, show: Callable[[SceneResult], None]
) -> list[BenchFigure | str]:
    """Return the figures and remarks of the bench ``grain`` for all scenes, the worst figures, and the peak memory."""
    found: list[BenchFigure | str] = []
    peaks = []

    def measure(size: BenchSize) -> list[BenchFigure | str]:
        return run_bench_in_fresh_process(_measure, "grain", size, report=report)

    for scene in bench_each_scene(size, measure=measure, folder=folder):
        peaks += [f for f in scene.found if isinstance(f, BenchFigure) and f.what == PEAK_MEMORY]
        rest = tuple(f for f in scene.found if isinstance(f, str) or f.what != PEAK_MEMORY)
        show(replace(scene, found=rest))
        found += rest
    from saf_gen.acceptance.speed.bench_grain import find_worst_benched_grain

    found += find_worst_benched_grain([f for f in found if isinstance(f, BenchFigure)])
    return [*found, *([max(peaks, key=lambda f: f.value)] if peaks else [])]
