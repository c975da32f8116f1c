"""Random light paths across a picture, for tests of the splat."""

import numpy as np


def paths(seed, count, shape):
    focus, rows, columns = shape
    random = np.random.default_rng(seed)
    first_x = random.uniform(-3, columns + 3, count)
    first_y = random.uniform(-3, rows + 3, count)
    step_x = random.normal(0, 4 / focus, count)
    step_y = random.normal(0, 4 / focus, count)
    step_x[: count // 10] = 0.0  # rays through the lens centre do not move
    return [np.asarray(a, dtype=np.float32) for a in (first_x, first_y, step_x, step_y, random.random(count))]


def windows(seed, count, shape):
    """Return first and last positions of all kinds of windows: empty, one position, the entire travel, past its end."""
    random = np.random.default_rng(seed)
    begin = random.integers(0, shape[0], count)
    end = begin + random.integers(-1, shape[0], count)
    begin[: count // 10], end[: count // 10] = 0, shape[0]
    return begin.astype(np.int32), end.astype(np.int32)
