"""Slow reference searches that list every frame of every window, as the authors' code does."""

import math


def listed_score(view, a, b):
    listed = [math.floor(a + j + 0.5) for j in range(math.floor(b - a) + 1)]
    assert listed == list(range(listed[0], listed[-1] + 1))
    return view.score(listed[0] - 1, listed[-1])


def literal_egs(view, left, right, threshold=10, ratio=0.618):
    trace = [(left + right) // 2]
    while right - left > threshold:
        w = right - left
        first = listed_score(view, left, left + ratio * w)
        second = listed_score(view, right - ratio * w, right)
        if first > second:
            right = left + ratio * w
        else:
            left = right - ratio * w
        trace.append((left + right) // 2)
    return trace


def literal_feedback(view, end):
    h = (end + 1) // 2
    return listed_score(view, h - 1, end) - listed_score(view, 1, h - 1)


def literal_sgfs(view, dt):
    n = view.frames // dt
    s = {k: literal_feedback(view, k * dt) if k >= n / 4 else 0.0 for k in range(1, n + 1)}
    later = {k: s[k] for k in range(max(n // 4, 1), n + 1)}
    stop = next(k for k in later if later[k] == max(later.values()))
    right = stop * dt
    return literal_egs(view, math.floor(right - 0.618 * (right - 1)), right)
