"""How fast we are, measured where it counts: ratios in one run, or rates with their workload beside them.

Each bench is one file of this folder; it gives figures with the target that the design sets. Nothing here is
a test: a machine that is busy or old may miss a target without being wrong.
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
    "encode": "charge to spikes: rate, growth with the length, public encoders beside it",
    "stream": "the file: write, size, read in three ways, file to scores",
    "score": "ten methods on six sequences",
    "job": "the paper's synthetic set, recipe to leaderboard, and again under another light",
}
MAX_MEMORY_GIB = 2.0


@dataclass(frozen=True)
class BenchResults:
    """figures; remarks, on what was left out and why; failed benches, each with its error."""

    figures: tuple[BenchFigure, ...]
    remarks: tuple[str, ...]
    failed: dict[str, SafGenError]


def run_benches(
    names: Sequence[str], size: BenchSize, *, report: ReportProgress = lambda stage, done: None
) -> BenchResults:
    """Run these benches, or all where none is named, one after the other, each in a fresh process.

    ``report`` is told what is being measured and the share of it that is done. A bench that cannot run here
    (no LLVM, no recipe) is among the failed; the others go on.

    Raises BadInput for an unknown name, before anything is measured.
    """
    for name in names:
        if name not in BENCHES:
            raise unknown("bench", name, allowed=BENCHES)
    found: list[BenchFigure | str] = []
    failed: dict[str, SafGenError] = {}
    for name in dict.fromkeys(names or BENCHES):
        try:
            found += run_in_fresh_process(_measured, name, size, report=report)
        except SafGenError as error:
            failed[name] = error
    figures = tuple(f for f in found if isinstance(f, BenchFigure))
    return BenchResults(figures, tuple(f for f in found if isinstance(f, str)), failed)


def _measured(name: str, size: BenchSize, report: ReportProgress) -> list[BenchFigure | str]:
    """All that a bench gives, and the peak memory of this process, which does nothing else."""

    def told(stage: str, done: float) -> None:
        report(f"{name}: {stage}", done)

    measure: Callable[[BenchSize, ReportProgress], Iterator[BenchFigure | str]]
    measure = import_module(f"saf_gen.speed.bench_{name}").run_bench
    found = list(measure(size, told))
    return [
        *found,
        BenchFigure(name, "peak memory of a process", peak_memory_gib(), "GiB", MAX_MEMORY_GIB, at_most=True),
    ]
