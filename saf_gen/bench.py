"""How fast we are, measured where it counts: ratios in one run, or rates with their workload beside them.

Each bench gives figures with the target that the design sets. Nothing here is a test: a machine that is busy
or old may miss a target without being wrong.
"""

import resource
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

from saf_gen import seeds
from saf_gen.camera import Encoder, get_sensor, knot_weights
from saf_gen.errors import BadInput, unknown
from saf_gen.measures import get_measure
from saf_gen.rig import Counts, Recording
from saf_gen.stream import StreamWriter, open_stream

__all__ = ["BENCHES", "Figure", "Size", "run"]

BLOCK = 2000


@dataclass(frozen=True)
class Figure:
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
class Size:
    """The workload: the camera's array and length, and the renders."""

    rows: int = 250
    columns: int = 400
    frames: int = 20_000
    positions: tuple[int, ...] = (129, 513)
    samples: int = 256


def run(names: list[str], size: Size, *, progress: Callable[[str], None] = lambda name: None) -> list[Figure]:
    """Run these benches (all where none is named) and give their figures, peak memory of the process last.

    Raises BadInput for an unknown name.
    """
    for name in names:
        if name not in BENCHES:
            raise unknown("bench", name, BENCHES)
    figures: list[Figure] = []
    for name in names or list(BENCHES):
        progress(name)
        figures += BENCHES[name](size)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return [*figures, Figure("process", "peak memory", peak, "GiB", 2.0, at_most=True)]


def _stack(size: Size) -> Iterator[Figure]:
    """One pass for all positions against Mitsuba's thin lens, position after position."""
    from saf_gen.render import one_pass, thinlens, variant, world
    from saf_gen.render.film import Film, Setup
    from saf_gen.scene import find_scene

    chosen = variant.choose("auto", variant.probe())
    if chosen == "scalar":
        raise BadInput("the stack bench needs a JIT variant", hint=variant.ADVICE)
    variant.use(chosen)
    scene = find_scene("usaf_target")
    film = Film(size.rows, size.columns, get_sensor("vidar_400x250").pitch_m * 400 / size.columns)
    loaded, integrator = world.load(world.build(scene), scene.card.lights["lamp"], 6)
    setup = Setup(loaded, integrator, world.camera_to_world(scene), scene.drive(), film)

    def one_render(position: float) -> None:
        thinlens.render_at(setup, position=position, samples=size.samples, seed=1)

    one_render(0.5)  # compiles
    one_pass.render_stack(setup, positions=2, samples=1, seed=1)
    apart = [_seconds(lambda p=position: one_render(p)) for position in (0.0, 0.5, 1.0)]  # type: ignore[misc]
    for positions, target in zip(size.positions, (45.0, 150.0), strict=False):

        def stack(positions: int = positions) -> None:
            one_pass.render_stack(setup, positions=positions, samples=size.samples, seed=1)

        together = _seconds(stack)
        what = f"{positions} positions, {size.samples} samples a pixel, {chosen}"
        yield Figure("stack", f"one pass, {what}", together, "s")
        ratio = positions * float(np.mean(apart)) / together
        yield Figure("stack", f"times faster than {positions} thin-lens renders", ratio, "×", target)


def _stream(size: Size) -> Iterator[Figure]:
    """Encode with all noise on, write, read: pixel·frames a second, bits, seconds."""
    sensor = get_sensor("vidar_400x250")
    shape = (size.rows, size.columns)
    random = seeds.generator("bench", "charge")
    # Mean rate 0.2, contrast that comes and goes with focus, as a scene's.
    texture = random.random(shape, dtype=np.float32) - 0.5
    contrast = np.exp(-((np.linspace(-2, 2, 129, dtype=np.float32)) ** 2))[:, None, None]
    charge = (0.2 * sensor.threshold_e * (1 + contrast * texture))[None].astype(np.float32)
    index, fraction = knot_weights((np.arange(size.frames) + 0.5) / size.frames, 129)
    gain = np.ones((size.frames, 1), dtype=np.float32)
    Encoder(sensor, shape, 1).encode(charge, index[:16], fraction[:16], gain[:16])  # compiles
    blocks: list[np.ndarray] = []

    def encode() -> None:
        encoder = Encoder(sensor, shape, 1)
        for begin in range(0, size.frames, BLOCK):
            part = slice(begin, begin + BLOCK)
            blocks.append(encoder.encode(charge, index[part], fraction[part], gain[part]))

    work = size.rows * size.columns * size.frames
    yield Figure("stream", "encode, all noise on", work / _seconds(encode) / 1e9, "10⁹ pixel·frames/s", 2.5)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bench.h5"

        def write() -> None:
            with StreamWriter(path, shape=(size.frames, *shape), readout_hz=sensor.readout_hz) as writer:
                for block in blocks:
                    writer.write(block)

        yield Figure("stream", "write, verified", work / _seconds(write) / 1e9, "10⁹ pixel·frames/s", 3.0)
        bits = path.stat().st_size * 8 / work
        yield Figure("stream", "size at mean rate 0.2", bits, "bit/pixel·frame", 0.32, at_most=True)

        def sd_curve() -> None:
            window = max(1, size.frames // 200)
            with open_stream(path) as stream:
                view = Recording(Counts(stream), get_measure("sd"))
                for first in range(0, size.frames - window + 1, window):
                    view.score(first, first + window)

        sd_curve()  # compiles
        yield Figure(
            "stream", "SD of 200 windows, file to scores", _seconds(sd_curve), "s", 0.5, at_most=True
        )


def _seconds(work: Callable[[], None]) -> float:
    begin = perf_counter()
    work()
    return perf_counter() - begin


BENCHES: dict[str, Callable[[Size], Iterator[Figure]]] = {"stream": _stream, "stack": _stack}
