"""Block vote: the focus of most of the picture, found by blocks whose curves all count alike."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from saf_gen.parts import Answer, View
from saf_gen.plugins.searches._light_windows import equal_light_windows
from saf_gen.plugins.searches._windows import check_frame_count, check_numbers

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
    window, in which counting noise cancels. All are smoothed by a Gaussian of one step, reduced by the median of their
    lower half, and divided by what is left of their largest value. The sums over the blocks, one for each kind, are
    scaled alike and added, and so is the curve of the method's own measure on the whole box, with the weight ``own``.
    The answer is the top of the parabola through the largest value and its neighbours.

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

    causal: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_frame_count("steps", self.steps)
        check_frame_count("block", self.block)
        check_numbers(self, {"counts": 1e6, "longest": 1.0, "own": 1e6})

    def __call__(self, view: View) -> Answer:
        """Return the answer for a sweep."""
        steps = max(min(self.steps, view.frames // SHORTEST), 1)
        frames, scores, blocks = list[float](), list[float](), list[np.ndarray]()
        for window in equal_light_windows(view, self.counts, steps=steps, longest=self.longest):
            middle = (window.first + window.stop) // 2
            halves = np.stack([view.counts(window.first, middle), view.counts(middle, window.stop)])
            frames.append((window.first + window.stop) / 2 - 0.5)
            scores.append(view.score(window.first, window.stop))
            blocks.append(block_scores(halves.astype(np.float64), self.block))
        if len(frames) < FEWEST:
            return Answer(None, (), "too dark")
        x = np.array(frames)
        near = np.exp(-(((x[:, None] - x) / (view.frames // steps)) ** 2) / 2)
        near /= near.sum(axis=1, keepdims=True)
        votes = np.tensordot(near, np.array(blocks), 1)  # (window, kind, block)
        total = sum(scaled(scaled(votes[:, kind]).sum(axis=1)) for kind in range(votes.shape[1]))
        total = total + self.own * scaled(near @ np.array(scores))
        return Answer(vertex(x, total), (float(x[total.argmax()]),))


def scaled(curves: np.ndarray) -> np.ndarray:
    """Return curves (window, ...) less the median of their lower half, divided by their largest value then.

    A curve that is constant becomes 0.
    """
    floor = np.median(np.sort(curves, axis=0)[: max(len(curves) // 2, 1)], axis=0)
    height = curves.max(axis=0) - floor
    return np.where(height > TINY, (curves - floor) / np.maximum(height, TINY), 0.0)


def block_scores(halves: np.ndarray, size: int) -> np.ndarray:
    """Return F4 and the shared squared Laplacian of blocks of about size × size pixels, float64 (2, block).

    ``halves`` are the counts of the halves A and B of a window, float64 (2, row, col). A pixel without the neighbours
    that it needs adds nothing. A block without light scores 0.
    """
    whole = halves.sum(axis=0)
    f4, shared = np.zeros_like(whole), np.zeros_like(whole)
    f4[:-2] += whole[:-2] * (whole[1:-1] - whole[2:])
    f4[:, :-2] += whole[:, :-2] * (whole[:, 1:-1] - whole[:, 2:])
    middle = halves[:, 1:-1, 1:-1]
    around = halves[:, :-2, 1:-1] + halves[:, 2:, 1:-1] + halves[:, 1:-1, :-2] + halves[:, 1:-1, 2:]
    shared[1:-1, 1:-1] = np.prod(around - 4 * middle, axis=0)
    mean, (first, second) = block_means(whole, size), (block_means(half, size) for half in halves)
    return np.stack(
        [
            block_means(f4, size) / np.maximum(mean**2, TINY),
            block_means(shared, size) / np.maximum(first * second, TINY),
        ]
    )


def block_means(picture: np.ndarray, size: int) -> np.ndarray:
    """Return the means of a picture (row, col) in blocks of about size × size pixels, (block,)."""
    edges = [np.linspace(0, n, max(n // size, 1) + 1).astype(int) for n in picture.shape]
    sums = np.add.reduceat(np.add.reduceat(picture, edges[0][:-1], axis=0), edges[1][:-1], axis=1)
    return (sums / np.outer(*map(np.diff, edges))).ravel()


def vertex(x: np.ndarray, y: np.ndarray) -> float:
    """Return the top of the parabola through the largest of y at x, (n,), and its neighbours; at an end, that x."""
    k = int(y.argmax())
    if not 0 < k < len(y) - 1 or len(set(x[k - 1 : k + 2])) < 3:
        return float(x[k])
    bend, slope, _ = np.polyfit(x[k - 1 : k + 2] - x[k], y[k - 1 : k + 2], 2)
    return float(x[k] + np.clip(-slope / (2 * bend), x[k - 1] - x[k], x[k + 1] - x[k])) if bend < 0 else float(x[k])
