"""Measurements of speed, memory and file size: ratios within one run, or rates beside their workload.

Each bench has a module of its own in this folder and yields figures, most of them with a target. A bench is
not a test: a busy or old machine may miss a target without anything being wrong.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module

from saf_gen.errors import SafGenError, unknown
from saf_gen.generate.executor import ReportProgress
from saf_gen.speed.bench_figure import BenchFigure, BenchSize
from saf_gen.speed.fresh_process import peak_memory_gib, run_in_fresh_process

__all__ = ["BENCHES", "BenchFigure", "BenchResults", "BenchSize", "run_benches"]

BENCHES = {
    "stack": "the focal stack against Mitsuba's thin lens: time, and error at equal samples",
    "grain": "noise that the renderer leaves in each scene's pictures, at rest and moving; time of a slice",
    "encode": "charge to spikes: rate, growth with the length, comparison with public encoders",
    "stream": "the stream file: write, size, three read patterns, file to scores",
    "score": "ten methods on six sequences",
    "job": "the paper's synthetic set, recipe to leaderboard, and again under another light",
}
MAX_MEMORY_GIB = 2.0


@dataclass(frozen=True)
class BenchResults:
    """The figures, remarks on what was left out and why, and the failed benches, each with its error."""

    figures: tuple[BenchFigure, ...]
    remarks: tuple[str, ...]
    failed: dict[str, SafGenError]


def run_benches(
    names: Sequence[str], size: BenchSize, *, report: ReportProgress = lambda stage, done: None
) -> BenchResults:
    """Run benches (keys of BENCHES; all if empty) one after the other, each in a fresh process.

    ``report`` is called with what is being measured and the fraction of it that is done, 0 to 1. A bench that cannot
    run here (no LLVM, no recipe) is among the failed ones; the others continue. Raises BadInput for an unknown name,
    before anything is measured.
    """
    for name in names:
        if name not in BENCHES:
            raise unknown("bench", name, allowed=BENCHES)
    found: list[BenchFigure | str] = []
    failed: dict[str, SafGenError] = {}
    for name in dict.fromkeys(names or BENCHES):
        try:
            found += run_in_fresh_process(_measure, name, size, report=report)
        except SafGenError as error:
            failed[name] = error
    figures = tuple(f for f in found if isinstance(f, BenchFigure))
    return BenchResults(figures, tuple(f for f in found if isinstance(f, str)), failed)


def _measure(name: str, size: BenchSize, *, report: ReportProgress) -> list[BenchFigure | str]:
    """Return what a bench yields, and the peak memory of this process, which runs nothing else."""
    run_bench: Callable[[BenchSize, ReportProgress], Iterator[BenchFigure | str]]
    run_bench = import_module(f"saf_gen.speed.bench_{name}").run_bench
    return [
        *run_bench(size, lambda stage, done: report(f"{name}: {stage}", done)),
        BenchFigure(name, "peak memory of a process", peak_memory_gib(), "GiB", MAX_MEMORY_GIB, at_most=True),
    ]
