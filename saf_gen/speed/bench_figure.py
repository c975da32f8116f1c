"""What a bench gives, and what it works on."""

from dataclasses import dataclass

__all__ = ["BenchFigure", "BenchSize", "format_shape"]


@dataclass(frozen=True)
class BenchFigure:
    """One measured number; ``target`` is what the design asks for, ``at_most`` which side of it is good."""

    bench: str
    what: str
    value: float
    unit: str
    target: float | None = None
    at_most: bool = False

    @property
    def met(self) -> bool | None:
        """Whether the target is reached; None where there is none."""
        if self.target is None:
            return None
        return self.value <= self.target if self.at_most else self.value >= self.target


@dataclass(frozen=True)
class BenchSize:
    """The workload of every bench; the defaults are the design's.

    sensor : name or YAML file; its array is the size of all pictures.
    frames : of a recording; its growth is measured from here to ten times as many.
    positions : of the focal stack, the usual and the fine one.
    samples, reference : a pixel, of the stack and of what its error is measured against.
    public_frames : given to the public encoders; the slower ones get a tenth and a hundredth.
    sequences : that ten methods are run on.
    recipe : of the whole job; '' is the project's recipes/sad_core.yaml.
    """

    sensor: str = "vidar_400x250"
    frames: int = 20_000
    positions: tuple[int, int] = (129, 513)
    samples: int = 256
    reference: int = 2048
    public_frames: int = 200
    sequences: int = 6
    recipe: str = ""


def format_shape(shape: tuple[int, int]) -> str:
    """An array's (rows, columns) as people write it: '400×250'."""
    return f"{shape[1]}×{shape[0]}"
