"""Compiles numba kernels once for all test processes; called with the argument ``renderer`` or ``encoder``.

`make test` runs both while the linters run. Otherwise all test processes would compile the same kernels at once.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from saf_gen.camera import Encoder, get_sensor


def compile_encoder() -> None:
    """Encode a few readouts with and without row skew and reset jitter; each combination is a separate kernel."""
    still = {"index": np.zeros(8, np.int64), "fraction": np.zeros(8), "gain": np.ones((8, 1))}
    for skew in (0.0, 0.5):
        for jitter in (0.0, 0.1):
            noise = {"reset_jitter": jitter > 0}
            sensor = get_sensor("vidar_400x250", row_skew=skew, reset_jitter=jitter, noise=noise)
            Encoder(sensor, (2, 3), seed=1).encode(np.full((1, 1, 2, 3), 1000, np.float32), **still)


def compile_renderer() -> None:
    """Generate and evaluate a small dataset of still and moving scenes."""
    import pytest
    from capture_dataset import make_dataset  # here, because importing it probes the renderers
    from inline_jobs import run_jobs_inline

    from saf_gen.benchmark.evaluate import evaluate
    from saf_gen.generate import run

    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "run_jobs", run_jobs_inline)
        evaluate(make_dataset(Path(folder), patch))


if __name__ == "__main__":
    {"renderer": compile_renderer, "encoder": compile_encoder}[sys.argv[1]]()
