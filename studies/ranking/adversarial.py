"""What each method does on sweeps that are hard on purpose: one Markdown table, made of numpy focal stacks.

    python -m studies.ranking.adversarial [--seeds 4] [--out FILE.md] [--method METHOD ...] [--stack FOLDER ...]

A flat texture of 128 × 128 pixels, periodic and averaged over pixels, is blurred by discs whose diameter grows by one
pixel per half depth of focus; the transfer function of the disc is exact. Our encoder turns the pictures into spikes of
``vidar_400x250`` with all its noise. A sweep passes 24 depths of focus in 4,000 frames. Focus, direction, texture and
noise are drawn from the seed and the name of the scene (:mod:`saf_gen.core.seeds`); light is constant at a mean rate of
0.1 unless the scene says otherwise.

``--stack`` adds boxes of a real focal stack, a folder of pictures in the order of their names and evenly spaced. Their
truth is the middle of the tops of three measures of the pictures, which agree within one picture, their unit.
"""

import argparse
import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.special import j1

from saf_gen.benchmark.admission import run_method
from saf_gen.benchmark.method_spec import parse_method
from saf_gen.benchmark.view.recording import RecordingView, WindowCounts
from saf_gen.camera import get_sensor
from saf_gen.camera.encoder import Encoder, knot_weights
from saf_gen.core.seeds import derive_seed, make_generator
from saf_gen.plugins.measures import get_measure
from saf_gen.stream.metadata import Metadata, Truth
from saf_gen.stream.stream_file import open_stream
from saf_gen.stream.stream_writer import StreamWriter

METHODS = (
    "fine_structure+bell_vote",
    "fine_structure+bell_vote:area=true",
    "octave_structure+peak_fit",
    "sd_code+egs_code",
    "sd_code+sgfs_code",
    "vollath_f4_n+argmax:window=300",
    "cen+egs_code",
    "octave_structure+argmax:window=300",
)
SIZE, FINE = 128, 4
"""Pixels along each side of a picture, and samples along each side of a pixel."""
HALF_DEPTHS, KNOTS = 48, 97
"""Half depths of focus in the travel, and pictures in a stack."""
MOST_BOXES = 12
REAL_MEASURES = "vollath_f4_n", "tenengrad_n", "sd"


@dataclass(frozen=True)
class Sweep:
    """Pictures over the travel and what happens while the lens passes it.

    Attributes
    ----------
    name : tuple of str and int
        Names the random streams of the sensor.
    pictures : ndarray, shape (focus, row, col)
        Light of each pixel, relative to the light that gives the mean rate.
    truth, unit : float
        Position of the focus, and the unit of errors, as fractions of the travel.
    rate : float
        Mean rate at a light of 1, spikes per pixel and frame.
    frames : int
        Length of the sweep.
    lens : ndarray of float64, shape (2,)
        Positions of the lens at the beginning and at the end.
    gain : callable
        Gain of the light for times from 0 to 1.
    """

    name: tuple[str, int]
    pictures: np.ndarray
    truth: float
    unit: float
    rate: float = 0.1
    frames: int = 4000
    lens: tuple[float, float] = (0.0, 1.0)
    gain: Callable[[np.ndarray], np.ndarray] = field(default=np.ones_like)


def main(given: Sequence[str] | None = None) -> None:
    """Run all methods on all scenes and stacks, and print or write one table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--method", nargs="+", default=METHODS)
    parser.add_argument("--stack", nargs="+", type=Path, default=[])
    asked = parser.parse_args(given)
    errors = {
        name: [run(make(name, seed), asked.method) for seed in range(asked.seeds)] for name in SCENES if asked.seeds
    }
    for folder in asked.stack:
        errors[folder.name] = [run(sweep, asked.method) for sweep in real_sweeps(folder)]
    text = table(errors, asked.method)
    if asked.out:
        asked.out.write_text(text, encoding="utf-8")
    print(text)


def run(sweep: Sweep, methods: Sequence[str]) -> list[float]:
    """Return the error of each method's answer, in units of the sweep; NaN for no answer."""
    with tempfile.TemporaryDirectory() as folder:
        path = write(sweep, Path(folder) / "sweep.h5")
        with open_stream(path) as stream:
            counts, errors = WindowCounts(stream), []
            for name in methods:
                method = parse_method(name)
                view = RecordingView(counts, method.measure)
                frame = run_method(method, view, scorer=view.scorer)[0].frame
                errors.append(math.nan if frame is None else (at(sweep, frame) - sweep.truth) / sweep.unit)
    return errors


def at(sweep: Sweep, frame: float) -> float:
    """Return the position of the lens at a frame, counted from 0."""
    first, last = sweep.lens
    return first + (last - first) * (frame + 0.5) / sweep.frames


def write(sweep: Sweep, path: Path) -> Path:
    """Write the spikes of a sweep as a stream, and return its path."""
    sensor = get_sensor("vidar_400x250")
    charge = (sweep.pictures * sweep.rate * sensor.threshold_e).astype(np.float32)
    times = (np.arange(sweep.frames) + 0.5) / sweep.frames
    lens = np.array([at(sweep, frame) for frame in range(sweep.frames)])
    index, fraction = knot_weights(lens, len(charge))
    encoder = Encoder(sensor, charge.shape[1:], seed=derive_seed("adversarial", *sweep.name))
    spikes = encoder.encode(
        charge[None], index=index, fraction=fraction, gain=sweep.gain(times)[:, None].astype(np.float32)
    )
    known = Metadata(focus_position=lens.astype(np.float32), truth=Truth(position=sweep.truth))
    with StreamWriter(path, shape=(sweep.frames, *charge.shape[1:]), metadata=known) as writer:
        writer.write(spikes)
    return path


def table(errors: dict[str, list[list[float]]], methods: Sequence[str]) -> str:
    """Return the Markdown table: the largest error of each method on each scene, and the answers that are missing."""
    lines = ["| scene | " + " | ".join(f"`{name}`" for name in methods) + " |", "|---" * (1 + len(methods)) + "|"]
    for scene, rows in errors.items():
        cells = [cell(column) for column in np.array(rows, dtype=float).T]
        lines.append(f"| {scene} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def cell(errors: np.ndarray) -> str:
    """Return the largest error and how many are within 1, or have no answer."""
    found = errors[~np.isnan(errors)]
    none = len(errors) - len(found)
    text = f"{found[np.abs(found).argmax()]:+.2f}" if len(found) else "–"
    text += f" ({np.sum(np.abs(found) <= 1)} of {len(errors)}"
    return text + (f", {none} none)" if none else ")")


# Textures: float64 (SIZE, SIZE), periodic, with a mean of about 1


def averaged(fine: np.ndarray) -> np.ndarray:
    """Return a texture of SIZE·FINE samples averaged over pixels."""
    return fine.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3))


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of each fine sample, in pixels, float64 (SIZE·FINE, SIZE·FINE) each."""
    rows, columns = (np.indices((SIZE * FINE,) * 2) + 0.5) / FINE
    return rows, columns


def cloud(random: np.random.Generator, *, contrast: float, power: float = 1.0, size: int = SIZE) -> np.ndarray:
    """Return a texture with amplitudes of 1/frequency to the given power; its rms contrast is given."""
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.fftfreq(size))
    frequency[0, 0] = np.inf
    image = np.fft.ifft2(np.fft.fft2(random.normal(size=(size, size))) / frequency**power).real
    return np.maximum(1 + contrast * (image - image.mean()) / image.std(), 0.02)


def halftone(random: np.random.Generator, period: float) -> np.ndarray:
    """Return dots on a square grid whose size follows the tone of a picture."""
    rows, columns = grid()
    screen = (np.cos(2 * np.pi * rows / period) + np.cos(2 * np.pi * columns / period)) / 4 + 0.5
    tone = np.repeat(np.repeat(0.5 * cloud(random, contrast=0.1, power=1.5), FINE, axis=0), FINE, axis=1)
    return averaged(np.where(screen < tone, 1.8, 0.2))


def weave(random: np.random.Generator, period: float) -> np.ndarray:
    """Return a plain weave whose threads are ``period`` pixels apart and round."""
    rows, columns = grid()
    shade = [np.sqrt(1 - (2 * (x / period % 1) - 1) ** 2 * 0.95) for x in (rows, columns)]
    over = (rows // period + columns // period) % 2 == 0
    return averaged(np.where(over, shade[0], 0.8 * shade[1])) * cloud(random, contrast=0.02)


def mesh(random: np.random.Generator, period: float) -> np.ndarray:
    """Return dark wires a fifth of the period wide before a plain ground."""
    rows, columns = grid()
    return averaged(np.where(np.minimum(rows / period % 1, columns / period % 1) < 0.2, 0.2, 1.4)) * cloud(
        random, contrast=0.03
    )


def display(random: np.random.Generator) -> np.ndarray:
    """Return a picture on a display whose red, green and blue stripes are one pixel wide each, with dark gaps."""
    rows, columns = grid()
    stripe = np.choose((columns % 3).astype(int), [0.64, 1.77, 0.33]) * (rows % 3 > 0.5)
    return averaged(1.3 * stripe) * cloud(random, contrast=0.3)


def lamps(random: np.random.Generator, *, number: int = 25, ground: float = 1.0) -> np.ndarray:
    """Return lamps of 20 to 2,000 times the light of a dim ground (of none, if 0), each about two pixels wide."""
    points = np.zeros((SIZE, SIZE))
    points[tuple(random.integers(8, SIZE - 8, (2, number)))] = 10 ** random.uniform(1.3, 3.3, number)
    return 0.3 * (ground * cloud(random, contrast=0.4) + gaussian_filter(points, 0.7, mode="wrap"))


def leaves(random: np.random.Generator) -> np.ndarray:
    """Return discs of all sizes that hide each other."""
    rows, columns = grid()
    image = np.ones_like(rows)
    for radius in np.sort(2 / random.uniform(0.06, 1, 300))[::-1]:
        y, x = random.uniform(0, SIZE, 2)
        image[(rows - y) ** 2 + (columns - x) ** 2 < radius**2] = random.uniform(0.3, 1.7)
    return averaged(image)


# Stacks


def disc(diameter: float) -> np.ndarray:
    """Return the transfer function of a disc, in pixels, for the frequencies of ``rfft2``."""
    frequency = np.hypot(np.fft.fftfreq(SIZE)[:, None], np.fft.rfftfreq(SIZE))
    x = np.pi * abs(diameter) * frequency
    return np.where(x > 1e-9, 2 * j1(x) / np.where(x > 1e-9, x, 1), 1.0)


def blurred(texture: np.ndarray, focus: float, psf: Callable[[float], np.ndarray] = disc) -> np.ndarray:
    """Return the pictures of a flat texture over the travel; ``psf`` takes the signed blur in pixels."""
    blur = (np.linspace(0, 1, KNOTS) - focus) * HALF_DEPTHS
    spectrum = np.fft.rfft2(texture)
    return np.stack([np.fft.irfft2(spectrum * psf(each), s=texture.shape).clip(0) for each in blur])


def skew(blur: float) -> np.ndarray:
    """Return the transfer function of a lens with a bright core on one side of the focus, and none on the other."""
    share = 0.35 if blur > 0 else 0.0
    return (1 - share) * disc(blur) + share * disc(0.4 * blur)


def drawn(
    name: str,
    seed: int,
    texture: Callable[[np.random.Generator], np.ndarray],
    *,
    psf: Callable[[float], np.ndarray] = disc,
    rate: float = 0.1,
    frames: int = 4000,
    gain: Callable[[np.ndarray], np.ndarray] = np.ones_like,
) -> Sweep:
    """Return a sweep over a flat texture, with a drawn focus and direction; options are those of :class:`Sweep`."""
    random = make_generator("adversarial", name, seed)
    focus, lens = random.uniform(0.3, 0.7), ((0.0, 1.0), (1.0, 0.0))[random.integers(2)]
    pictures = blurred(texture(random), focus, psf)
    return Sweep((name, seed), pictures, focus, 2 / HALF_DEPTHS, rate=rate, frames=frames, lens=lens, gain=gain)


def two_depths(name: str, seed: int, *, hidden: float = 0.3, contrast: float = 1.0) -> Sweep:
    """Return a sweep over a target that an object hides on a part of the box, five depths of focus from it.

    ``contrast`` multiplies that of the target.
    """
    random = make_generator("adversarial", name, seed)
    focus, lens = random.uniform(0.35, 0.65), ((0.0, 1.0), (1.0, 0.0))[random.integers(2)]
    nearer = focus + 10 / HALF_DEPTHS * random.choice([-1, 1])
    mask = np.zeros((SIZE, SIZE))
    mask[:, : int(hidden * SIZE)] = 1.0
    cover = blurred(mask, nearer)
    behind = 1 + contrast * (blurred(leaves(random), focus) - 1)
    pictures = blurred(leaves(random) * mask, nearer) + (1 - cover) * behind
    return Sweep((name, seed), pictures.clip(0), focus, 2 / HALF_DEPTHS, lens=lens)


def lamp_goes_out(times: np.ndarray) -> np.ndarray:
    """Return a gain of 1 that falls to 0.12 in the middle of the sweep."""
    return np.where(times < 0.5, 1.0, 0.12)


SCENES: dict[str, Callable[[str, int], Sweep]] = {
    "leaves, nothing hard": lambda n, s: drawn(n, s, leaves),
    "halftone, 4 px": lambda n, s: drawn(n, s, lambda r: halftone(r, 4)),
    "halftone, 3 px": lambda n, s: drawn(n, s, lambda r: halftone(r, 3)),
    "weave, 4 px": lambda n, s: drawn(n, s, lambda r: weave(r, 4)),
    "weave, 5 px": lambda n, s: drawn(n, s, lambda r: weave(r, 5)),
    "mesh, 6 px": lambda n, s: drawn(n, s, lambda r: mesh(r, 6)),
    "display, 3 px": lambda n, s: drawn(n, s, display),
    "night lamps": lambda n, s: drawn(n, s, lamps, rate=0.05),
    "14 lamps on black": lambda n, s: drawn(n, s, lambda r: lamps(r, number=14, ground=0.0), rate=0.05),
    "nearer object, 30 % of the box": two_depths,
    "nearer, richer object, 40 % of the box": lambda n, s: two_depths(n, s, hidden=0.4, contrast=0.5),
    "lamp that goes out": lambda n, s: drawn(n, s, leaves, gain=lamp_goes_out),
    "very dim (rate 0.01)": lambda n, s: drawn(n, s, leaves, rate=0.01),
    "hardly any light (rate 0.0015)": lambda n, s: drawn(n, s, leaves, rate=0.0015),
    "short (300 frames)": lambda n, s: drawn(n, s, leaves, frames=300),
    "skew lens": lambda n, s: drawn(n, s, lambda r: cloud(r, contrast=0.4), psf=skew),
}


def make(name: str, seed: int) -> Sweep:
    """Return the sweep of a scene."""
    return SCENES[name](name, seed)


# Real stacks


def real_sweeps(folder: Path) -> list[Sweep]:
    """Return sweeps over at most MOST_BOXES boxes of a stack in which three measures of the pictures agree.

    Their tops must be inside the stack and within one picture of each other; boxes are evenly spread over those.
    """
    pictures = np.stack([read_grey(path) for path in sorted(folder.iterdir()) if path.is_file()])
    last = len(pictures) - 1
    found: list[Sweep] = []
    for y in range(0, pictures.shape[1] - SIZE + 1, SIZE):
        for x in range(0, pictures.shape[2] - SIZE + 1, SIZE):
            box = pictures[:, y : y + SIZE, x : x + SIZE]
            tops = [top(np.array([get_measure(name)(picture) for picture in box])) for name in REAL_MEASURES]
            if min(tops) > 1 and max(tops) < last - 1 and np.ptp(tops) <= 1:
                found.append(
                    Sweep((folder.name, len(found)), box / box.mean(), float(np.median(tops)) / last, 1 / last)
                )
    return found[:: -(-len(found) // MOST_BOXES)] if found else []


def top(curve: np.ndarray) -> float:
    """Return the index of the vertex of the parabola through the largest value and its neighbours."""
    k = int(curve.argmax())
    if not 0 < k < len(curve) - 1:
        return float(k)
    before, here, after = curve[k - 1 : k + 2]
    return k + (before - after) / (2 * (before - 2 * here + after))


def read_grey(path: Path) -> np.ndarray:
    """Return the linear light of a picture, float64 (row, col); pictures of 8 bits are taken as sRGB."""
    with Image.open(path) as picture:
        if picture.mode in ("RGB", "L"):
            return (np.asarray(picture.convert("L"), np.float64) / 255) ** 2.2
        return np.asarray(picture, np.float64)


if __name__ == "__main__":
    main()
