"""The cloth as pictures: its weave, and cross-stitch on it; float32 in 0..1, row 0 on top."""

from __future__ import annotations

import numpy as np
from surfaces import cloudy, noise

SIZE_MM, TEXEL_MM = (220.0, 150.0), 0.1  # a pixel sees 0.29 mm to 0.34 mm
CROSS_MM = 1.9  # about the width of a cross: whole threads
# Rows of a motif from the top, # a cross.
MOTIFS = {
    "star": "......#......|.....###.....|#...#####...#|##..#####..##|###..###..###|.###..#..###.|"
    "..###...###..|.###..#..###.|###..###..###|##..#####..##|#...#####...#|.....###.....|"
    "......#......",
    "tree": "......#......|.....###.....|....#####....|.....###.....|....#####....|...#######...|"
    "....#####....|...#######...|..#########..|.###########.|......#......|......#......|"
    ".....###.....",
    "bird": ".............|..##.........|.####........|##.##........|..####....###|..######.####|"
    "..##########.|...########..|....######...|.....####....|......##.....|.....#..#....|"
    "....##.##....",
    "heart": ".............|..###...###..|.#####.#####.|#############|#####.#.#####|####.###.####|"
    ".###.#.#.###.|..###.#.###..|...#######...|....#####....|.....###.....|......#......|"
    ".............",
    "rose": "....##.##....|...#.###.#...|..#.##.##.#..|.#.##.#.##.#.|##.#.###.#.##|.###.#.#.###.|"
    "##.##.#.##.##|.###.#.#.###.|##.#.###.#.##|.#.##.#.##.#.|..#.##.##.#..|...#.###.#...|"
    "....##.##....",
}


def picture(params: dict, random: np.random.Generator) -> np.ndarray:
    """Reflectance of the whole cloth."""
    x, y = (((np.arange(round(s / TEXEL_MM)) + 0.5) * TEXEL_MM).astype(np.float32) for s in SIZE_MM)
    shape = y.size, x.size
    pitch = params["thread_mm"]
    drawn = 0.35 * pitch * cloudy(shape, 5, 3, random)  # cloth is never quite straight
    u, v = (x[None, :] + drawn) / pitch, (y[:, None] - drawn) / pitch
    grey = params["ground"] * _weave(u, v, params["weave"], random)
    cover, yarn = _crosses(u, v, pitch, random)
    grey += cover * (params["yarn"] * yarn - grey)
    fuzz = noise(shape, (shape[0] / 1.6, shape[1] / 1.6), random)
    grey *= (1 + 0.10 * fuzz) * (1 + 0.05 * cloudy(shape, 9, 4, random))
    return np.clip(grey, 0.02, 0.85)[::-1]


def _weave(u: np.ndarray, v: np.ndarray, kind: str, random: np.random.Generator) -> np.ndarray:
    """Threads over and under each other: brightness over that of a thread's ridge."""
    i, j = np.floor(u).astype(np.int32), np.floor(v).astype(np.int32)
    if kind == "plain":
        over = (i + j) % 2 == 0
    elif kind == "twill":
        over = (i + j) % 4 < 2
    else:  # herringbone: the twill turns round every ten threads
        way = np.where(i // 10 % 2 == 0, 1, -1)
        over = (way * i + j) % 4 < 2
    warp, weft = (1 + 0.13 * random.standard_normal(600).astype(np.float32) for _ in (0, 1))
    a, b = np.abs(u - i - 0.5) * 2, np.abs(v - j - 0.5) * 2  # 0 on a thread's middle, 1 between threads
    # The thread that is over is round across, and sinks where it goes under; its strands run askew.
    strands = (1 + 0.10 * np.sin(2 * np.pi * (2.0 * v + 1.2 * u)), 1 + 0.10 * np.sin(2 * np.pi * (2.0 * u - 1.2 * v)))
    on_warp = warp[i % 600] * (1 - 0.55 * a**3) * (1 - 0.35 * b**2) * strands[0]
    on_weft = weft[j % 600] * (1 - 0.55 * b**3) * (1 - 0.35 * a**2) * strands[1]
    return np.where(over, on_warp, 0.86 * on_weft).astype(np.float32)


def _crosses(u: np.ndarray, v: np.ndarray, pitch: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Cover of the yarn, and its brightness: two diagonal stitches in every cell of the chart."""
    cell = round(CROSS_MM / pitch)  # threads of the ground that a cross spans
    chart = _chart(int(np.ceil(v.max() / cell)) + 2, int(np.ceil(u.max() / cell)) + 2, random)
    i, j = (np.clip(np.floor(w / cell).astype(np.int32), 0, None) for w in (u, v))
    s, t = u / cell - i, v / cell - j
    full = chart[np.minimum(j, chart.shape[0] - 1), np.minimum(i, chart.shape[1] - 1)]
    first, second = np.abs(s - t), np.abs(s + t - 1)  # distances to the diagonals
    wide = 0.36
    upper, lower = np.clip((wide - second) / 0.1, 0, 1), np.clip((wide - first) / 0.1, 0, 1)
    twist = 1 + 0.28 * np.sin(2 * np.pi * 4.5 * (s - t)), 1 + 0.28 * np.sin(2 * np.pi * 4.5 * (s + t))
    round_ = 1.25 - 0.75 * (second / wide) ** 2, 1.0 - 0.7 * np.minimum(first / wide, 1) ** 2
    yarn = np.where(upper > 0, round_[0] * twist[0], 0.75 * round_[1] * twist[1])
    shade = 1 + 0.12 * random.standard_normal(chart.shape).astype(np.float32)
    yarn = yarn * shade[np.minimum(j, chart.shape[0] - 1), np.minimum(i, chart.shape[1] - 1)]
    return (np.maximum(upper, lower) * full).astype(np.float32), np.clip(yarn, 0.3, 2).astype(np.float32)


def _chart(rows: int, columns: int, random: np.random.Generator) -> np.ndarray:
    """Which cells are stitched: borders of zigzag, between them rows of motifs; row 0 at the bottom."""
    chart = np.zeros((rows, columns), dtype=bool)
    across = np.arange(columns)
    at = 3
    names = [str(name) for name in random.permutation(list(MOTIFS))]
    while at < rows:
        zigzag = np.abs(across % 8 - 4)
        for k in range(2):
            place = at + zigzag + 2 * k
            good = place < rows
            chart[place[good], across[good]] = True
        for line in (at - 2, at + 8):
            if 0 <= line < rows:
                chart[line] = across % 4 != 0
        at += 11
        row = [names[k % len(names)] for k in range(2)]
        names = names[1:] + names[:1]
        start = int(random.integers(-8, 0))
        for n, left in enumerate(range(start, columns, 16)):
            lines = MOTIFS[row[n % 2]].split("|")[::-1]
            for k, line in enumerate(lines):
                for m, sign in enumerate(line):
                    if sign == "#" and 0 <= left + m < columns and at + k < rows:
                        chart[at + k, left + m] = True
        at += 17
    return chart
