"""The figures that a bench yields, and the size of its workload."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BenchFigure:
    """One measured number.

    Parameters
    ----------
    bench : str
        Name of the bench.
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
    cell : tuple of str, optional
        Row and column in the table of its scene; None for a figure that is not in the table.
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
        """True if the target is met; None without a target."""
        if self.target is None:
            return None
        return self.value <= self.target if self.at_most else self.value >= self.target


@dataclass(frozen=True)
class BenchSize:
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
    jobs : int
        Jobs that do nothing, on which the scheduler is measured.
    recipe : str
        Recipe of the bench ``job``; '' means sad_core.
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
