"""Compiles kernels of numba once, for all processes of the tests: ``compile_kernels.py renderer`` or ``encoder``.

`make test` runs both beside the linters. Without it each process would compile what it needs first, at the same time.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from saf_gen.camera import Encoder, get_sensor


def compile_encoder() -> None:
    """Encode a few readouts with and without skew of rows and jitter of the reset: each is a kernel of its own."""
    still = {"index": np.zeros(8, np.int64), "fraction": np.zeros(8), "gain": np.ones((8, 1))}
    for skew in (0.0, 0.5):
        for jitter in (0.0, 0.1):
            noise = {"reset_jitter": jitter > 0}
            sensor = get_sensor("vidar_400x250", row_skew=skew, reset_jitter=jitter, noise=noise)
            Encoder(sensor, (2, 3), seed=1).encode(np.full((1, 1, 2, 3), 1000, np.float32), **still)


def compile_renderer() -> None:
    """Generate and evaluate a small dataset, at rest and moving."""
    import pytest
    from capture_dataset import make_dataset  # it looks for a renderer
    from inline_jobs import run_jobs_inline

    from saf_gen.benchmark.evaluate import evaluate
    from saf_gen.generate import run

    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "run_jobs", run_jobs_inline)
        evaluate(make_dataset(Path(folder), patch))


if __name__ == "__main__":
    {"renderer": compile_renderer, "encoder": compile_encoder}[sys.argv[1]]()
