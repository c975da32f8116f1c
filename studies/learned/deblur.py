"""Sharpen windows of spikes whose blur is known: a Wiener filter with one learned number, and its PSNR on test.

    python -m studies.learned.deblur

generates the dataset of ``deblur.yaml``, beside this file, and learns on it; another dataset may be given. A window's
counts are sharpened by the Wiener filter of a disc of the blur in the middle of the target, ``stream.blur``. The number
is the ratio of the energies of noise and picture, and the one that gives the highest PSNR on the split ``train``. The
truth is the all-in-focus charge at the scale of the window: that of the stream, or if it holds none, rendered. Both
pictures are compared with it in the box of the target after the factor that fits them best, with the largest value of
the truth as peak.

References
----------
N. Wiener, "Extrapolation, Interpolation, and Smoothing of Stationary Time Series", MIT Press (1949).
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.special import j1

from saf_gen import open_stream
from saf_gen.core.region import Region, bounding_box
from saf_gen.errors import BadInput, SafGenError, unknown
from saf_gen.generate.resolve import resolve_recipe
from saf_gen.generate.run import generate
from saf_gen.stream.manifest import read_manifest
from saf_gen.stream.stream_file import SpikeStream

RECIPE, DATASET = Path(__file__).with_name("deblur.yaml"), Path("datasets/deblur")
WINDOW = 50
BLURS_PX = (1.0, 10.0)
"""Smallest and largest blur of the windows: less needs no sharpening, and more reaches far beyond the box."""
RATIOS = 10.0 ** np.arange(-4, 0.1, 0.25)
BANDS_PX = ((1.0, 3.0), (3.0, 6.0), (6.0, 10.0))


@dataclass(frozen=True, eq=False)
class Window:
    """The counts of a window, float64 (h, w), its sharp picture (h, w), the box of the target, and its blur in px."""

    counts: np.ndarray
    sharp: np.ndarray
    box: Region
    blur_px: float


def windows_of(stream: SpikeStream, stacks: Path) -> Iterator[Window]:
    """Yield the windows of a sweep over a scene at rest in which the target has a blur within BLURS_PX."""
    metadata, truth = stream.metadata, stream.truth
    if truth.target is None or metadata.gain is None or metadata.image_distance is None:
        raise BadInput("does not state its target, light and lens", where=str(stream.path), allowed="streams that do")
    charge, box = _sharp_charge(stream, stacks), bounding_box(truth.target)
    in_focus = int(np.argmin(np.abs(np.asarray(metadata.lens_position) - truth.position)))
    for first in range(0, stream.shape[0] - WINDOW + 1, WINDOW):
        middle = first + WINDOW // 2
        blur_px = float(np.median(np.abs(stream.blur(middle)[truth.target])))
        if BLURS_PX[0] <= blur_px < BLURS_PX[1]:
            gain = metadata.gain[first : first + WINDOW].mean(axis=0)
            breathing = float(metadata.image_distance[middle] / metadata.image_distance[in_focus])
            sharp = _scaled(np.tensordot(gain, charge, 1), breathing)
            yield Window(stream.counts(first, first + WINDOW).astype(np.float64), sharp, box, blur_px)


def _sharp_charge(stream: SpikeStream, stacks: Path) -> np.ndarray:
    """Return the all-in-focus charge of each light group of a scene at rest, float32 (light, row, col)."""
    if stream.truth.sharp is not None:
        return stream.truth.sharp[0]
    from saf_gen.render.all_in_focus import render_all_in_focus  # needs the renderer, which reading does not

    return render_all_in_focus(stream, stacks)


def _scaled(picture: np.ndarray, factor: float) -> np.ndarray:
    """Return a picture magnified about its middle, float64 (h, w)."""
    centre = (np.array(picture.shape) - 1)[:, None, None] / 2
    return map_coordinates(picture.astype(np.float64), (np.indices(picture.shape) - centre) / factor + centre, order=3,
                           mode="nearest")  # fmt: skip


def sharpened(counts: np.ndarray, blur_px: float, *, ratio: float) -> np.ndarray:
    """Return a picture (h, w) sharpened by the Wiener filter of a disc of this diameter, H / (H² + ratio).

    The picture is continued by its mirror image, so that its sides do not ring.
    """
    by = min(int(np.ceil(2 * blur_px)) + 8, min(counts.shape) - 1)
    wide = np.pad(counts, by, mode="reflect")
    along = np.hypot(np.fft.fftfreq(wide.shape[0])[:, None], np.fft.rfftfreq(wide.shape[1]))
    argument = np.pi * blur_px * along
    transfer = np.where(argument > 0, 2 * j1(argument) / np.where(argument > 0, argument, 1), 1.0)
    # The mean is not noise: at frequency 0 the filter is 1.
    gain = transfer * (1 + ratio) / (transfer**2 + ratio)
    found = np.fft.irfft2(np.fft.rfft2(wide) * gain, wide.shape)
    return np.asarray(found[by:-by, by:-by])


def psnr(picture: np.ndarray, window: Window) -> float:
    """Return the PSNR (dB) of a picture in the box of a window, after the factor that fits it best."""
    found, truth = picture[window.box], window.sharp[window.box]
    factor = float((found * truth).sum() / (found**2).sum())
    return float(10 * np.log10(truth.max() ** 2 / np.mean((factor * found - truth) ** 2)))


def learn_ratio(windows: list[Window]) -> float:
    """Return the ratio of RATIOS with the highest mean PSNR over these windows."""
    means = [np.mean([psnr(sharpened(w.counts, w.blur_px, ratio=ratio), w) for w in windows]) for ratio in RATIOS]
    return float(RATIOS[int(np.argmax(means))])


def windows_of_split(dataset: Path, split: str) -> list[Window]:
    """Return the windows of the still sequences of a split; raise BadInput if there are none."""
    manifest = read_manifest(dataset)
    if split not in manifest.splits:
        raise unknown("split", split, allowed=manifest.splits, where=str(dataset))
    found: list[Window] = []
    for entry in manifest.sequences:
        if entry.split == split and entry.scene_motion == "static":
            with open_stream(dataset / entry.file) as stream:
                found += windows_of(stream, dataset / "stacks")
    if not found:
        raise BadInput(f"split {split!r} has no window with a blur of {BLURS_PX} pixels", where=str(dataset))
    return found


def _generated() -> Path:
    """Return the folder of the dataset, of which what is missing is generated first."""
    for error in generate(resolve_recipe(RECIPE), DATASET).failed.values():
        raise error
    return DATASET


def main(arguments: list[str] | None = None) -> int:
    """Learn on one split, and print the PSNR of counts and of sharpened counts on the other."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path, nargs="?", help=f"by default {DATASET}, which is generated")
    parser.add_argument("--train", default="train")
    parser.add_argument("--test", default="test")
    given = parser.parse_args(arguments)
    try:
        dataset = given.dataset or _generated()
        ratio = learn_ratio(windows_of_split(dataset, given.train))
        judged = windows_of_split(dataset, given.test)
    except SafGenError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    before = np.array([psnr(w.counts, w) for w in judged])
    after = np.array([psnr(sharpened(w.counts, w.blur_px, ratio=ratio), w) for w in judged])
    blurs = np.array([w.blur_px for w in judged])
    print(f"ratio of noise to picture, learned on {given.train}: {ratio:.3g}")
    print("| blur, pixels | windows | counts, dB | sharpened, dB |\n|---|---|---|---|")
    for low, high in (*BANDS_PX, BLURS_PX):
        within = (blurs >= low) & (blurs < high)
        if within.any():
            print(
                f"| {low:g} to {high:g} | {within.sum()} | {before[within].mean():.1f} | {after[within].mean():.1f} |"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
