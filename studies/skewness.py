"""How skew focus curves are, in real focal stacks and behind modelled lenses, and which cause is as large.

    python -m studies.skewness FOLDER... [--out FILE.md]

Each folder holds the pictures of a stack, in the order of their names and evenly spaced. Three kinds of places are
measured: small patches, boxes of four times their side, and boxes of eight times. The curve of a place is the relative
energy of its gradients, less its smallest value. Its skewness at a height h is (r - l)/(r + l), where l and r are the
distances from its peak to where it falls to h times the peak. A place counts if its curve falls below the lowest height
on both sides.

The models are sums over the pupil: the contrast of a texture of power 1/f² behind a lens of f/2 (pixels of 20 µm, 555
nm) or a microscope (image-side aperture 0.024), for one depth, for depths spread evenly or unevenly over a box, for
aberrations (:mod:`saf_gen.optics.texture_contrast`), and behind each lens that comes with saf_gen, at several points of
its picture and f-numbers, for a plane at 1 m. Depths are in half depths of focus.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from saf_gen.optics.fitted_file import read_lens, shipped_lenses
from saf_gen.optics.texture_contrast import Imaging, contrast_curve, squared_contrast
from saf_gen.optics.wavefront import Wavefront

HEIGHTS = (0.3, 0.6, 0.8)
SMALL = 24  # pixels, the side of a small patch
SCALES = (1, 4, 8)
MIN_RISE = 1.3  # of a curve's peak over its smallest value


@dataclass(frozen=True)
class Row:
    """Skewness at each height over many places: quartiles, float64 (height, 3), and the number of places."""

    name: str
    quartiles: np.ndarray
    places: int


def main() -> None:
    """Measure the folders, compute the models, and print or write one table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    rows = [row for folder in asked.folders for row in measure_stack(folder)]
    text = table([*rows, *model_rows()])
    if asked.out:
        asked.out.write_text(text, encoding="utf-8")
    print(text)


def measure_stack(folder: Path) -> Iterator[Row]:
    """Yield the skewness in places of each size of a stack of pictures."""
    energy = np.stack([gradient_energy(read_grey(path)) for path in sorted(folder.iterdir()) if path.is_file()])
    for scale in SCALES:
        side = SMALL * scale
        curves = list(box_curves(energy, side=side))
        found = [skew for curve in curves if (skew := skewness(curve)) is not None]
        if found:
            yield Row(f"{folder.name}, {side} × {side} pixels", quartiles(np.array(found)), len(found))


def read_grey(path: Path) -> np.ndarray:
    """Return a picture as linear light, float64 (row, col); 8-bit pictures are taken for sRGB."""
    with Image.open(path) as picture:
        values = np.asarray(picture)
    if values.dtype == np.uint8:
        values = (values / 255.0) ** 2.2
    return values.mean(axis=2) if values.ndim == 3 else values.astype(np.float64)


def gradient_energy(picture: np.ndarray) -> np.ndarray:
    """Return the squared gradient over two pixels, divided by the squared mean about it."""
    across = picture[1:-1, 2:] - picture[1:-1, :-2]
    down = picture[2:, 1:-1] - picture[:-2, 1:-1]
    return np.asarray(across**2 + down**2) / picture.mean() ** 2


def box_curves(energy: np.ndarray, *, side: int) -> Iterator[np.ndarray]:
    """Yield the curve over the stack of boxes that overlap by half, float64 (focus,)."""
    _, rows, columns = energy.shape
    for row in range(0, rows - side + 1, side // 2):
        for column in range(0, columns - side + 1, side // 2):
            yield energy[:, row : row + side, column : column + side].mean(axis=(1, 2))


def skewness(curve: np.ndarray) -> np.ndarray | None:
    """Return the skewness at each height, or None if the curve has no single peak that falls on both sides."""
    low, k = float(curve.min()), int(curve.argmax())
    if not 0 < k < curve.size - 1 or curve[k] < MIN_RISE * low:
        return None
    before, at, after = curve[k - 1 : k + 2]
    peak = k + (before - after) / (2 * (before - 2 * at + after))
    top = at - (before - after) * (peak - k) / 4
    scaled = (curve - low) / (top - low)
    found = []
    for height in HEIGHTS:
        left, right = _crossing(scaled[: k + 1][::-1], height), _crossing(scaled[k:], height)
        if left is None or right is None:
            return None
        from_peak = (left + (peak - k), right - (peak - k))
        found.append((from_peak[1] - from_peak[0]) / (from_peak[1] + from_peak[0]))
    return np.array(found)


def _crossing(falling: np.ndarray, height: float) -> float | None:
    """Return how many steps from its first value a curve first falls to a height."""
    below = np.flatnonzero(falling <= height)
    if not below.size:
        return None
    n = int(below[0])
    return n - 1 + float((falling[n - 1] - height) / (falling[n - 1] - falling[n])) if n else 0.0


def quartiles(found: np.ndarray) -> np.ndarray:
    """Return the quartiles at each height, float64 (height, 3)."""
    return np.percentile(found, [25, 50, 75], axis=0).T


# --- models: everything in half depths of focus, which is the defocus that blurs a point over a pixel ----------------

IMAGING = Imaging(0.0125, 0.055, 20e-6, 555e-9)
MICROSCOPE = Imaging(0.0045, 0.189, 20e-6, 555e-9)
DEFOCUS = np.arange(-16, 16.01, 0.1)
PLANE_M, STOPS, HEIGHTS_OF_LENS = 1.0, (1.0, 1.4, 2.0), 4
"""Of shipped lenses: the plane that they show, f-numbers over the smallest one, and points of the picture."""


def model_rows() -> Iterator[Row]:
    """Yield the skewness of each model at a single place."""
    perfect = contrast(Wavefront(1e-12, radius_m=IMAGING.radius_m))
    models = {
        "one depth": perfect(DEFOCUS),
        "tilt: depths even over ±2": spread(perfect, np.linspace(-2, 2, 81)),
        "tilt: depths even over ±4": spread(perfect, np.linspace(-4, 4, 81)),
        "tilt over ±4, contrast growing 1 to 3 across it": spread(
            perfect, np.linspace(-4, 4, 81), np.linspace(1, 3, 81) ** 2
        ),
        "two depths, 2 apart, a quarter of the texture behind": spread(perfect, np.array([0, 2.0]), np.array([3, 1.0])),
        "two depths, 3 apart, a quarter of the texture behind": spread(perfect, np.array([0, 3.0]), np.array([3, 1.0])),
    }
    for name, imaging, amounts in (
        ("f/2", IMAGING, (1.0, 2.0, 4.0, 8.0)),
        ("microscope", MICROSCOPE, (0.25, 0.5, 1.0)),
    ):
        for waves in amounts:
            wavefront = Wavefront(waves * 555e-9, radius_m=imaging.radius_m)
            models[f"{name}, spherical aberration, {waves:g} waves"] = contrast(wavefront, imaging)(DEFOCUS)
    for name in ("astigmatism", "coma"):
        wavefront = Wavefront(**{f"{name}_m": 2 * 555e-9}, radius_m=IMAGING.radius_m)
        models[f"f/2, {name}, 2 waves"] = contrast(wavefront, height_m=1.0)(DEFOCUS)
    models["field curvature over a box, 0 to 2 waves"] = spread(perfect, -1.25 * np.linspace(0, 1, 41) ** 2)
    for name, curve in [*models.items(), *shipped_curves()]:
        skew = skewness(curve)
        if skew is not None:
            yield Row(name, np.repeat(skew[:, None], 3, axis=1), 1)


def shipped_curves() -> Iterator[tuple[str, np.ndarray]]:
    """Yield the curves of the lenses that come with saf_gen, each about its own focus, with their names."""
    for name in shipped_lenses():
        lens = read_lens(name)
        rays = lens.rays_at(IMAGING.wavelength_m * 1e9)
        v = 1 / (1 / rays.focal_length_m - 1 / (rays.pupil_magnification * PLANE_M))
        seen = rays.seen_from(PLANE_M, v)
        for stop in STOPS:
            f_number = round(lens.f_number * stop, 2)
            imaging = IMAGING._replace(radius_m=rays.focal_length_m / (2 * f_number), image_distance_m=v)
            for height_mm in np.linspace(0, lens.height_mm, HEIGHTS_OF_LENS):
                sharpest = contrast_curve(seen, imaging, height_m=height_mm / 1e3).peak
                defocus = sharpest + DEFOCUS * imaging.resolved_defocus
                curve = squared_contrast(defocus, seen, imaging=imaging, height_m=height_mm / 1e3)
                yield f"{name}, f/{f_number:g}, {height_mm:g} mm off the axis", curve


def contrast(
    wavefront: Wavefront, imaging: Imaging = IMAGING, *, height_m: float = 0.0
) -> Callable[[np.ndarray], np.ndarray]:
    """Return the squared contrast as a function of defocus in half depths of focus."""
    grid = np.arange(-28, 28.01, 0.1)
    defocus = grid * imaging.resolved_defocus
    values = squared_contrast(defocus, wavefront, imaging=imaging, height_m=height_m)
    return lambda defocus: np.interp(defocus, grid, values)


def spread(
    single: Callable[[np.ndarray], np.ndarray], depths: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Return the curve of a box whose parts focus at several places; their squared contrasts add up."""
    return np.average([single(DEFOCUS - depth) for depth in depths], axis=0, weights=weights)


def table(rows: list[Row]) -> str:
    """Return all rows as one table: the median and, over many places, the middle half."""
    heads = " | ".join(f"at {height:g}" for height in HEIGHTS)
    lines = [f"| curve | places | {heads} |", "|---|---|" + "---|" * len(HEIGHTS)]
    for row in rows:
        cells = [
            f"{median:+.2f}" if row.places == 1 else f"{median:+.2f} ({low:+.2f} to {high:+.2f})"
            for low, median, high in row.quartiles
        ]
        lines.append(f"| {row.name} | {row.places:,} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
