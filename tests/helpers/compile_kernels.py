"""Compiles the kernels of numba once, for all processes of the tests: a small dataset, at rest and moving.

`make test` runs this beside the linters. Without it each process would compile what it needs first, at the same time.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from capture_dataset import make_dataset
from inline_jobs import run_jobs_inline

from saf_gen.benchmark.evaluate import evaluate
from saf_gen.generate import run

if __name__ == "__main__":
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "run_jobs", run_jobs_inline)
        evaluate(make_dataset(Path(folder), patch))
