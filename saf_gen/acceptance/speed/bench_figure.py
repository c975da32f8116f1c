"""The figures that a bench yields, and the size of its workload."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BenchFigure:
    """One measured number; ``target`` is its upper limit if ``at_most``, else its lower limit.

    ``low`` and ``high`` are the ends of its interval at 95 %, where it has one. ``cell`` is its row and column in the
    table of its scene, where it has one.
    """

    bench: str
    what: str
    value: float
    unit: str
    target: float | None = None
    at_most: bool = False
    low: float | None = None
    high: float | None = None
    cell: tuple[str, str] | None = None

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None without a target."""
        if self.target is None:
            return None
        return self.value <= self.target if self.at_most else self.value >= self.target


@dataclass(frozen=True)
class BenchSize:
    """The workload of the benches; the defaults are full size.

    Attributes
    ----------
    sensor : name or YAML file of the sensor; its pixels are those of all images.
    frames : frames of a recording; growth is measured from there to ten times as many.
    positions : positions of the usual and of the fine focal stack.
    samples, reference : samples per pixel of a focal stack, and of the reference that its error is measured against.
    still_samples, slice_samples : samples per pixel where grain is measured, at rest and in a time slice: those of the
        project's recipes.
    scenes : names of the scenes whose grain is measured; all that can be found if empty.
    public_frames : frames for the public encoders; the slower ones get a tenth or a hundredth.
    sequences : recordings that ten methods run on.
    reads : windows that a process reads at random, after the first pass over them.
    jobs : jobs that do nothing, on which the scheduler is measured.
    recipe : recipe of the whole job; '' stands for sad_core.
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
    jobs: int = 100_000
    recipe: str = ""


def format_bench_shape(shape: tuple[int, int]) -> str:
    """Return (rows, columns) as width × height: '400×250'."""
    return f"{shape[1]}×{shape[0]}"
