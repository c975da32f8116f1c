"""Vote of the blocks of a picture: the focus of most of it, found by curves that all count alike."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from saf_gen.core.block_structure import block_edges
from saf_gen.errors import unknown
from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._light_windows import equal_light_windows
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers

KINDS = "f4", "gradient"
"""Curves that vote beside the Laplacian, the names of ``by``."""
SHORTEST = 4
"""Frames of the shortest step; a short recording has fewer steps."""
FEWEST = 3
"""Windows that a sweep needs for an answer."""
TINY = 1e-12


@dataclass(frozen=True)
class BlockVote:
    """Answers where the curves of small blocks of the picture, each scaled to its own range, add up to most.

    A measure of the whole box follows its strongest contrast: an edge of something nearer, a wall behind, the glint on
    one side of a column. The focus of a target is that of most of its area. The box is therefore cut into blocks of
    about ``block`` × ``block`` pixels, and each block votes with as much weight as any other, however little contrast
    it has.

    Windows have equal light, as in ``peak_fit``: after each of ``steps`` steps, the window that ends there is the
    shortest one with ``counts`` spikes per pixel, but no longer than the fraction ``longest`` of the recording. A
    recording with fewer than four frames per step has fewer steps. In each window every block has two curves over its
    squared brightness: Vollath's F4 along both axes, and the mean product of the Laplacians of the two halves of the
    window, in which counting noise cancels. Independent neighbours, as in
    counting noise and in the fixed pattern of the dark current, add nothing to F4 on average, so that it stands low
    texture in little light; but it is 0 for stripes with a period of three pixels. With ``by="gradient"``, the mean
    product of the differences of neighbours in both halves takes its place. It sees stripes of any period, and also the
    fixed pattern.

    All curves are smoothed by a Gaussian of one step, reduced by the median of their lower half, and divided by what is
    left of their largest value. The sums over the blocks, one for each kind, are scaled alike and added, and so is the
    curve of the method's own measure on the whole box, with the weight ``own``. The answer is the top of the parabola
    through the largest value and its neighbours.

    The search sees the whole sweep, and answers wherever there is light; ``reject`` lets it abstain. The trace holds
    the frame of the largest value.

    Raises BadInput for a recording of fewer than two frames, or an option out of range.

    References
    ----------
    This project. F4: Vollath, J. Microscopy 147(3), 1987, doi:10.1111/j.1365-2818.1987.tb02839.x.
    """

    counts: float = 12.0
    steps: int = 80
    longest: float = 0.15
    block: int = 10
    own: float = 0.5
    by: str = "f4"

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.by not in KINDS:
            raise unknown("kind of curve", self.by, allowed=KINDS)
        check_frame_count("steps", self.steps)
        check_frame_count("block", self.block)
        check_numbers(self, {"counts": 1e6, "longest": 1.0, "own": 1e6})

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep."""
        steps = max(min(self.steps, view.frames // SHORTEST), 1)
        frames, scores, blocks = list[float](), list[float](), list[np.ndarray]()
        for window in equal_light_windows(view, self.counts, steps=steps, longest=self.longest):
            middle = (window.first + window.stop) // 2
            first, second = view.counts(window.first, middle), view.counts(middle, window.stop)
            frames.append((window.first + window.stop) / 2 - 0.5)
            scores.append(view.score(window.first, window.stop))
            blocks.append(block_scores(first, second, size=self.block, f4=self.by == "f4"))
        if len(frames) < FEWEST:
            return Answer(None, (), "too dark")
        x = np.array(frames)
        near = np.exp(-(((x[:, None] - x) / (view.frames // steps)) ** 2) / 2)
        near /= near.sum(axis=1, keepdims=True)
        votes = np.tensordot(near, np.array(blocks), 1)  # (window, kind, block)
        total = scaled(scaled(votes).sum(axis=2)).sum(axis=1) + self.own * scaled(near @ np.array(scores))
        return Answer(vertex(x, total), (float(x[total.argmax()]),))


def scaled(curves: np.ndarray) -> np.ndarray:
    """Return curves (window, ...) less the median of their lower half, divided by their largest value then.

    A curve that is constant becomes 0.
    """
    floor = np.median(np.sort(curves, axis=0)[: max(len(curves) // 2, 1)], axis=0)
    height = curves.max(axis=0) - floor
    return np.where(height > TINY, (curves - floor) / np.maximum(height, TINY), 0.0)


def block_scores(first: np.ndarray, second: np.ndarray, *, size: int, f4: bool) -> np.ndarray:
    """Return F4 or the shared squared gradient, and the shared Laplacian, of blocks of about size × size pixels.

    ``first`` and ``second`` are the counts of the two halves of a window (row, col). The result is float64 (2, block).
    A pixel without the neighbours that it needs adds nothing. A block without light in one of the halves scores 0.
    """
    rows, columns = (block_edges(n, size) for n in first.shape)
    sums = _block_sums(first.astype(np.int64), second.astype(np.int64), rows, columns, f4).reshape(4, -1)
    pixels = np.outer(np.diff(rows), np.diff(columns)).ravel()
    lit = sums[2] * sums[3]
    brightness = np.stack([(sums[2] + sums[3]) ** 2 if f4 else lit, lit])
    return np.where(lit > 0, sums[:2] * pixels / np.maximum(brightness, 1), 0.0)


@njit(nogil=True, cache=True)
def _block_sums(a: np.ndarray, b: np.ndarray, row_edges: np.ndarray, column_edges: np.ndarray, f4: bool) -> np.ndarray:
    """Return the sums over blocks of both products and of the counts of both halves, float64 (4, n, m).

    ``a`` and ``b`` are int64, so that products are exact. The loop is compiled because temporary arrays would cost more
    than the arithmetic.
    """
    rows, columns = a.shape
    sums = np.zeros((4, row_edges.size - 1, column_edges.size - 1))
    for p in range(row_edges.size - 1):
        for q in range(column_edges.size - 1):
            fine, laplacian, first, second = 0, 0, 0, 0
            for i in range(row_edges[p], row_edges[p + 1]):
                for j in range(column_edges[q], column_edges[q + 1]):
                    first += a[i, j]
                    second += b[i, j]
                    if f4:
                        if i < rows - 2:
                            fine += (a[i, j] + b[i, j]) * (a[i + 1, j] + b[i + 1, j] - a[i + 2, j] - b[i + 2, j])
                        if j < columns - 2:
                            fine += (a[i, j] + b[i, j]) * (a[i, j + 1] + b[i, j + 1] - a[i, j + 2] - b[i, j + 2])
                    else:
                        if i < rows - 1:
                            fine += (a[i + 1, j] - a[i, j]) * (b[i + 1, j] - b[i, j])
                        if j < columns - 1:
                            fine += (a[i, j + 1] - a[i, j]) * (b[i, j + 1] - b[i, j])
                    if 0 < i < rows - 1 and 0 < j < columns - 1:
                        one = a[i - 1, j] + a[i + 1, j] + a[i, j - 1] + a[i, j + 1] - 4 * a[i, j]
                        two = b[i - 1, j] + b[i + 1, j] + b[i, j - 1] + b[i, j + 1] - 4 * b[i, j]
                        laplacian += one * two
            sums[0, p, q], sums[1, p, q], sums[2, p, q], sums[3, p, q] = fine, laplacian, first, second
    return sums


def vertex(x: np.ndarray, y: np.ndarray) -> float:
    """Return the top of the parabola through the largest of y at x, (n,), and its neighbours; at an end, that x."""
    k = int(y.argmax())
    if not 0 < k < len(y) - 1 or len(set(x[k - 1 : k + 2])) < 3:
        return float(x[k])
    bend, slope, _ = np.polyfit(x[k - 1 : k + 2] - x[k], y[k - 1 : k + 2], 2)
    return float(x[k] + np.clip(-slope / (2 * bend), x[k - 1] - x[k], x[k + 1] - x[k])) if bend < 0 else float(x[k])
