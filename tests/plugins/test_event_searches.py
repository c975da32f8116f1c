"""ELP and PBF against slow twins written from their formulas, against values by hand, and on spikes."""

import math

import numpy as np
import pytest

from saf_gen import get_search
from saf_gen.core.seeds import make_generator
from saf_gen.plugins.searches._events import count_events
from saf_gen.plugins.searches.elp import laplacian_product
from saf_gen.plugins.searches.pbf import mirror_centre


class Pictures:
    """A view of blocks of 10 frames whose counts are given, (block, row, col)."""

    def __init__(self, blocks):
        self.blocks, self.now = blocks, 0
        self.frames = 10 * len(blocks)

    def counts(self, first, stop):
        self.now = max(self.now, stop)
        return self.blocks[first // 10 : stop // 10].sum(axis=0)


def events_by_pixel(before, after, contrast):
    return [
        [math.trunc((math.log(b + 0.5) - math.log(a + 0.5)) / contrast) for a, b in zip(*rows, strict=True)]
        for rows in zip(before.tolist(), after.tolist(), strict=True)
    ]


def product_by_pixel(picture, events):
    """−Σ ∇²I·E/Σ|E|, with a median of 3 × 3 pixels, replicated, and a Laplacian that is mirrored at the borders."""
    rows, columns = picture.shape
    grey = picture * (128 / picture.mean())

    def inside(i, size):
        return min(max(i, 0), size - 1)

    def mirrored(i, size):
        return -i if i < 0 else 2 * size - 2 - i if i >= size else i

    smooth = np.zeros(picture.shape)
    for y in range(rows):
        for x in range(columns):
            near = [grey[inside(y + i, rows), inside(x + j, columns)] for i in (-1, 0, 1) for j in (-1, 0, 1)]
            smooth[y, x] = sorted(near)[4]
    total = number = 0.0
    for y in range(rows):
        for x in range(columns):
            beside = ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1))
            laplacian = sum(smooth[mirrored(r, rows), mirrored(c, columns)] for r, c in beside) - 4 * smooth[y, x]
            total -= laplacian * events[y][x]
            number += abs(events[y][x])
    return total / number


def elp_step_by_step(blocks, *, contrast, alpha, past, jump, swing, below):
    """The frame of ELP's answer for blocks of 10 frames, a picture of 3 blocks, or None."""
    raw, smooth, at = [], [], []
    for k in range(3, len(blocks) - 1):
        events = events_by_pixel(blocks[k], blocks[k + 1], contrast)
        if not any(any(row) for row in events):
            continue
        at.append(k)
        raw.append(product_by_pixel(blocks[k - 3 : k].sum(axis=0), events))
        mean = sum(raw[-past:]) / len(raw[-past:])
        kept = len(raw) == 1 or abs(raw[-1] - mean) > jump
        smooth.append(raw[-1] if kept else alpha * raw[-1] + (1 - alpha) * smooth[-1])
        turns = [i for i in range(1, len(smooth)) if smooth[i - 1] > 0 > smooth[i]]
        if max(smooth) - min(smooth) > swing and min(smooth) < -below and turns:
            start_of_events = 10 * at[turns[-1]] + 4.5  # the middle of the earlier block
            return start_of_events - 10
    return None


def focal_blocks(number=30, focus=14.0, *, seed="sharp"):
    """Counts of a random texture that is sharp in the block ``focus``; noise of counting is left out."""
    texture = make_generator("test_event_searches", seed).integers(0, 200, (12, 15)).astype(float)
    spectrum, frequency = np.fft.fft2(texture), np.hypot(np.fft.fftfreq(12)[:, None], np.fft.fftfreq(15))
    blur = 0.3 * np.abs(np.arange(number) - focus)
    pictures = np.fft.ifft2(spectrum * np.exp(-2 * (np.pi * frequency * blur[:, None, None]) ** 2)).real
    return np.round(pictures).clip(0).astype(np.uint32)


def test_events_by_hand():
    """ln(1.5/0.5) = 1.0986 are five steps of 0.2; ln(20.5/19.5) = 0.05 is none; ln(0.5/4.5) = −2.197 are ten down."""
    assert count_events(np.array([[0, 19, 4]]), np.array([[1, 20, 0]]), contrast=0.2).tolist() == [[5, 0, -10]]


def test_the_product_by_hand():
    """Two columns of 0 and two of 192 (grey 0 and 192·128/96 = 256): the Laplacian is (0, 256, −256, 0) in each row.

    An event up where it is −256 and one down where it is +256 give (256 + 256)/2.
    """
    picture = np.tile([0, 0, 192, 192], (4, 1))
    events = np.zeros((4, 4))
    events[1, 2], events[2, 1] = 1, -1
    assert laplacian_product(picture, events) == 256.0
    assert laplacian_product(picture, -3 * events) == -256.0
    assert laplacian_product(np.zeros((4, 4)), events) == laplacian_product(picture, 0 * events) == 0.0


def test_events_and_product_equal_their_slow_twins():
    random = make_generator("test_event_searches", "twins")
    before, after, picture = random.integers(0, 40, (3, 9, 13))
    events = count_events(before, after, contrast=0.2)
    assert events.tolist() == events_by_pixel(before, after, 0.2)
    assert laplacian_product(picture, events) == pytest.approx(product_by_pixel(picture, events), rel=1e-12)


@pytest.mark.parametrize("options", [{}, {"alpha": 0.7, "past": 3, "jump": 20.0}, {"swing": 12.0, "below": 6.0}])
def test_elp_answers_like_its_slow_twin_and_stops_behind_the_focus(options):
    blocks = focal_blocks()
    search = get_search("elp", window=10, picture=30, **options)
    keys = ("contrast", "alpha", "past", "jump", "swing", "below")
    view = Pictures(blocks)
    answer = search(view)
    assert answer.frame == elp_step_by_step(blocks, **{key: getattr(search, key) for key in keys})
    assert answer.frame == pytest.approx(144.5, abs=20)
    assert 144 < view.now < 240


def test_elp_has_no_answer_if_the_product_does_not_turn():
    assert get_search("elp", window=10, picture=30)(Pictures(focal_blocks(focus=40.0))).frame is None
    assert get_search("elp", window=10, picture=30)(Pictures(np.zeros((20, 4, 4), np.uint32))).frame is None


def test_the_mirror_centre_by_hand_and_by_its_sum():
    """p has 3 at 2, n has 3 at 6: they mirror each other about 4. The twin tries all centres."""
    assert mirror_centre(np.eye(9)[2] * 3, np.eye(9)[6] * 3) == 4.0
    random = make_generator("test_event_searches", "mirror")
    p, n = random.uniform(0, 1, (2, 17))
    sums = {}
    for twice in range(33):
        inside = [i for i in range(17) if 0 <= twice - i < 17]
        sums[twice / 2] = sum((p[i] - p.mean()) * (n[twice - i] - n.mean()) for i in inside)
    assert mirror_centre(p, n) == max(sums, key=sums.get)


@pytest.mark.parametrize("focus", [9.0, 14.0, 21.5])
def test_pbf_finds_the_centre_of_a_symmetric_sweep(focus):
    answer = get_search("pbf", window=10)(Pictures(focal_blocks(focus=focus, number=32)))
    assert answer.frame == pytest.approx(10 * focus + 4.5, abs=5.1)


def test_pbf_has_no_answer_without_events():
    assert get_search("pbf", window=10)(Pictures(np.full((20, 4, 4), 7))).frame is None
