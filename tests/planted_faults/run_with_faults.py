"""Run tests under one planted fault after the other: ``python run_with_faults.py OUT JOBS``.

JOBS is JSON, a list of [fault, tests]; the fault '' plants nothing. Libraries are imported once, and each job then runs
in a process that is forked before anything of saf_gen is imported. OUT/N.json states which modules were changed for the
N-th job and how its tests ended; OUT/N.txt is what they printed.
"""

import gc
import json
import os
import signal
import sys
from importlib import import_module
from pathlib import Path

import numba
import numpy as np
import pytest
from _pytest.config import default_plugins
from fault_list import FAULTS
from planting import NotPlantedError, Outcomes, Planter, changed_sources

LIBRARIES = (
    "concurrent.futures.process h5py isal.igzip multiprocessing.queues OpenEXR pdb pydantic.dataclasses"
    " pydantic.json_schema pydantic.plugin._loader pydantic.type_adapter rich.progress scipy.signal scipy.stats tarfile"
    " tomllib typer urllib.request yaml zoneinfo"
)
OPTIONS = "-o addopts= -q --tb=no -p no:cacheprovider"
ROOT = Path(__file__).resolve().parents[2]
LONGEST_S = 1800  # kills a fault that makes a loop endless


def run_tests(fault: str, tests: list[str], *, file: Path) -> None:
    """Plant a fault, run tests under it, and write ``file``."""
    outcomes = Outcomes()
    found: dict[str, object] = {"outcomes": outcomes.by_test}
    try:
        sources = changed_sources(FAULTS[fault].changes) if fault else {}
        planter = Planter(sources)
        planter.install()
        if any("numba" in source or "compiled" in source for source in sources.values()):
            # Numba's cache identifies a kernel by its file: faulty kernels must not be stored, nor correct ones found.
            numba.config.CACHE_DIR = str(file.with_suffix(".numba"))  # type: ignore[attr-defined]
        pytest.main([*OPTIONS.split(), *(f"tests/{test}" for test in tests)], plugins=[outcomes])
        found["planted"] = sorted(planter.planted)
    except NotPlantedError as error:
        found["not planted"] = str(error)
    file.write_text(json.dumps(found, indent=1))


def main(out: Path, jobs: list[tuple[str, list[str]]]) -> None:
    os.chdir(ROOT)
    for library in (*LIBRARIES.split(), *(f"_pytest.{plugin}" for plugin in default_plugins)):
        import_module(library)
    numba.njit(lambda array: array.sum())(np.ones(2, np.float32))  # fills its type tables, which takes long
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"  # tests are selected by name and run in one process
    gc.freeze()  # so that no job searches libraries for garbage
    for n, (fault, tests) in enumerate(jobs):
        process = os.fork()
        if not process:
            shown = os.open(out / f"{n}.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(shown, 1)
            os.dup2(shown, 2)
            signal.alarm(LONGEST_S)
            run_tests(fault, tests, file=out / f"{n}.json")
            sys.stdout.flush()
            os._exit(0)
        os.waitpid(process, 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]), json.loads(sys.argv[2]))
