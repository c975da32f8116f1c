"""What all benches share: figures with targets, the size of the workload, fresh processes, and time and memory.

A bench is a module of this folder whose ``run(size)`` yields figures, and remarks about what it leaves out. It is not a
test: a busy or old machine may miss a target although nothing is wrong.
"""

import argparse
import resource
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, TypeVar

from saf_gen.core.execution.executor import run_jobs
from saf_gen.core.execution.job import ReportProgress
from saf_gen.errors import SafGenError

T = TypeVar("T")

_STATUS, _IO = Path("/proc/self/status"), Path("/proc/self/io")
_UNIT = 1 if sys.platform == "darwin" else 1024  # bytes per unit of ru_maxrss


@dataclass(frozen=True)
class Figure:
    """One measured number.

    Parameters
    ----------
    what : str
        Name of the figure, with its workload.
    value : float
        The number, in ``unit``.
    unit : str
        Unit of all numbers of the figure.
    target : float, optional
        Upper limit of the value if ``at_most`` is true, otherwise its lower limit; None without a target.
    at_most : bool, default False
        Whether the target is an upper limit.
    low, high : float, optional
        Ends of the 95 % interval; None for a figure without an interval.
    """

    what: str
    value: float
    unit: str
    target: float | None = None
    at_most: bool = False
    low: float | None = None
    high: float | None = None

    @property
    def met(self) -> bool | None:
        """True if the target is met; None without a target."""
        if self.target is None:
            return None
        return self.value <= self.target if self.at_most else self.value >= self.target

    def __str__(self) -> str:
        """The figure as a line, with its interval and its target."""
        interval = "" if self.low is None or self.high is None else f" ({_short(self.low)} to {_short(self.high)})"
        line = f"{self.what}: {_short(self.value)}{interval} {self.unit}"
        if self.target is None:
            return line
        return f"{line}; target {'≤' if self.at_most else '≥'} {self.target:g}{'' if self.met else ', MISSED'}"


def _short(value: float) -> str:
    return f"{value:,.0f}" if 1000 <= value < float("inf") else f"{value:.3g}"


@dataclass(frozen=True)
class Size:
    """The workload of the benches; the defaults are full size.

    Parameters
    ----------
    sensor : str
        Name or YAML file of the sensor, whose pixels are those of all images.
    frames : int
        Frames of a recording; growth is measured from this number to ten times as many.
    positions : tuple of int
        Numbers of positions of the usual and of the fine focal stack.
    samples, reference : int
        Samples per pixel of a focal stack, and of the reference against which its error is measured.
    still_samples, slice_samples : int
        Samples per pixel for grain at rest and in a time slice; the defaults are those of the project's recipes.
    scenes : tuple of str
        Names of the scenes whose grain is measured; all scenes that can be found if empty.
    public_frames : int
        Frames for the public encoders; the slower ones get a tenth or a hundredth.
    sequences : int
        Recordings on which ten methods run.
    reads : int
        Windows that a process reads at random after the first pass.
    recipe : str
        Recipe of the bench ``job``, by name or file.
    """

    sensor: str = "vidar_400x250"
    frames: int = 20_000
    positions: tuple[int, int] = (129, 513)
    samples: int = 256
    reference: int = 2048
    still_samples: int = 64
    slice_samples: int = 16
    scenes: tuple[str, ...] = ()
    public_frames: int = 200
    sequences: int = 6
    reads: int = 20_000
    recipe: str = "sad_core"


def shape_text(shape: tuple[int, int]) -> str:
    """Return (rows, columns) as width × height: '400×250'."""
    return f"{shape[1]}×{shape[0]}"


def main(run: Callable[[Size], Iterator[Figure | str]], argv: Sequence[str] | None = None) -> int:
    """Print what a bench yields as soon as it is measured, and the peak memory of the process; return the exit code."""
    parser = argparse.ArgumentParser(description=(sys.modules[run.__module__].__doc__ or "").splitlines()[0])
    parser.add_argument("--scene", action="append", default=[], help="scene for the bench grain; repeatable")
    scenes = tuple(parser.parse_args(argv).scene)
    try:
        for found in run(Size(scenes=scenes)):
            print(found, flush=True)
    except SafGenError as error:
        print(f"studies.speed: {error}", file=sys.stderr)
        return error.exit_code
    print(memory_figure())
    return 0


def memory_figure() -> Figure:
    """Return the peak memory of this process, with its target."""
    return Figure("peak memory of a process", peak_gib(), "GiB", 2.0, at_most=True)


@dataclass(frozen=True)
class _Call:
    """A function and its arguments, as a job."""

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    options: dict[str, Any]
    takes_all_cores: bool = True
    wants_gpu: bool = False

    def run(self, report: ReportProgress) -> Any:
        return self.function(*self.arguments, **self.options)


def fresh(function: Callable[..., T], *arguments: Any, **options: Any) -> T:
    """Return ``function(*arguments, **options)``, called in a spawned process.

    Raises SafGenError if the call fails; a SafGenError raised by the function is raised here as well.
    """
    call = _Call(function.__name__, function, arguments, options)
    ((_, result, error),) = run_jobs([call], workers=1, report=lambda name, done: None)
    if error is not None:
        raise error
    return result


def peak_gib() -> float:
    """Return the peak resident memory (GiB) of this process, or of a child that it waited for if that is larger."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * _UNIT
    line = _field(_STATUS, "VmHWM")  # on Linux a child inherits ru_maxrss from its parent, but not VmHWM
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _UNIT if line is None else 1024 * line
    return max(own, children) / 2**30


def bytes_read() -> int | None:
    """Return the number of bytes that this process has read, from disk or cache; None if the system does not count."""
    return _field(_IO, "rchar")


def _field(path: Path, name: str) -> int | None:
    """Return the number in the line ``name: number ...`` of a file; None if the file or the line is missing."""
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith(f"{name}:")]
    return int(found[0]) if found else None


def timed(work: Callable[..., T], *arguments: Any, **options: Any) -> tuple[T, float]:
    """Return ``work(*arguments, **options)`` and the seconds that it took."""
    begin = perf_counter()
    return work(*arguments, **options), perf_counter() - begin
