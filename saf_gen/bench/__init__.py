"""How fast we are, measured where it counts: ratios in one run, or rates with their workload beside them.

Each bench is one file of this folder; it gives figures with the target that the design sets. Nothing here is
a test: a machine that is busy or old may miss a target without being wrong.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module

from saf_gen.bench.child import alone, peak_gib
from saf_gen.bench.figure import Figure, Size
from saf_gen.cluster import Tell
from saf_gen.errors import SafGenError, unknown

__all__ = ["BENCHES", "Figure", "Results", "Size", "run"]

BENCHES = {
    "stack": "the focal stack against Mitsuba's thin lens: time, and error at equal samples",
    "encode": "charge to spikes: rate, growth with the length, public encoders beside it",
    "stream": "the file: write, size, read in three ways, file to scores",
    "score": "ten methods on six sequences",
    "job": "the paper's synthetic set, recipe to leaderboard, and again under another light",
}
MOST_GIB = 2.0


@dataclass(frozen=True)
class Results:
    """figures; remarks, on what was left out and why; failed benches, each with its error."""

    figures: tuple[Figure, ...]
    remarks: tuple[str, ...]
    failed: dict[str, SafGenError]


def run(names: Sequence[str], size: Size, *, tell: Tell = lambda stage, done: None) -> Results:
    """Run these benches, or all where none is named, one after the other, each in a fresh process.

    ``tell`` is told what is being measured and the share of it that is done. A bench that cannot run here
    (no LLVM, no recipe) is among the failed; the others go on.

    Raises BadInput for an unknown name, before anything is measured.
    """
    for name in names:
        if name not in BENCHES:
            raise unknown("bench", name, BENCHES)
    found: list[Figure | str] = []
    failed: dict[str, SafGenError] = {}
    for name in dict.fromkeys(names or BENCHES):
        try:
            found += alone(_measured, name, size, tell=tell)
        except SafGenError as error:
            failed[name] = error
    figures = tuple(f for f in found if isinstance(f, Figure))
    return Results(figures, tuple(f for f in found if isinstance(f, str)), failed)


def _measured(name: str, size: Size, tell: Tell) -> list[Figure | str]:
    """All that a bench gives, and the peak memory of this process, which does nothing else."""

    def told(stage: str, done: float) -> None:
        tell(f"{name}: {stage}", done)

    measure: Callable[[Size, Tell], Iterator[Figure | str]]
    measure = import_module(f"saf_gen.bench.{name}").measure
    found = list(measure(size, told))
    return [*found, Figure(name, "peak memory of a process", peak_gib(), "GiB", MOST_GIB, at_most=True)]
